/** The Poincaré sphere in orthographic projection: display of states, and input of a state. */

import { useRef, useState } from "preact/hooks";
import { ellipticityAngle, angleOfLinearPolarization, stokesOf } from "../math/stokes";
import { decimals } from "./numbers";

type Vector = [number, number, number];

/** A state: its Stokes components divided by s0. The length is the degree of polarization. */
export interface SpherePoint {
  vector: Vector;
  label: string;
  /** Class that sets the colour, `line-0` to `line-3` or `chosen`. */
  colour: string;
}

export interface PoincareSphereProps {
  /** What the sphere shows, for screen readers. */
  label: string;
  points: readonly SpherePoint[];
  /** Called with a new state while the user drags on the sphere or presses arrow keys. Absent: the sphere only shows states. */
  onChange?: (vector: Vector) => void;
}

/** Half of the side of the drawing, and the radius of the sphere, in units of the drawing. */
const HALF = 120;
const RADIUS = 88;
/** Degrees by which an arrow key turns the view or changes the azimuth or the ellipticity angle. */
const KEY_DEG = 5;

interface View {
  /** Angles in radians: turn about s3, and height of the viewer above the equator. */
  yaw: number;
  pitch: number;
}

const START: View = { yaw: 0.6, pitch: 0.35 };

/** Returns the position on the screen (right, down) and the depth toward the viewer. */
export function project({ yaw, pitch }: View, [s1, s2, s3]: readonly number[]): Vector {
  const toward = Math.cos(yaw) * s1 + Math.sin(yaw) * s2;
  const right = -Math.sin(yaw) * s1 + Math.cos(yaw) * s2;
  const up = Math.cos(pitch) * s3 - Math.sin(pitch) * toward;
  return [right, -up, Math.cos(pitch) * toward + Math.sin(pitch) * s3];
}

/** Returns the point of the unit sphere whose projection is at a position on the screen; outside, the nearest point of the outline. */
export function unproject({ yaw, pitch }: View, right: number, down: number): Vector {
  const r = Math.hypot(right, down);
  const [x, y, z] = r > 1 ? [right / r, -down / r, 0] : [right, -down, Math.sqrt(1 - r * r)];
  const toward = Math.cos(pitch) * z - Math.sin(pitch) * y;
  const s3 = Math.sin(pitch) * z + Math.cos(pitch) * y;
  return [Math.cos(yaw) * toward - Math.sin(yaw) * x, Math.sin(yaw) * toward + Math.cos(yaw) * x, s3];
}

const POLES: readonly { at: Vector; name: string; axis?: string }[] = [
  { at: [1, 0, 0], name: "H", axis: "s1" }, { at: [-1, 0, 0], name: "V" }, { at: [0, 1, 0], name: "+45°", axis: "s2" },
  { at: [0, -1, 0], name: "−45°" }, { at: [0, 0, 1], name: "R", axis: "s3" }, { at: [0, 0, -1], name: "L" },
];

/** Circles in the planes perpendicular to the axes. */
const CIRCLES: readonly ((angle: number) => Vector)[] = [
  (a) => [Math.cos(a), Math.sin(a), 0], (a) => [Math.cos(a), 0, Math.sin(a)], (a) => [0, Math.cos(a), Math.sin(a)],
];

const STEPS = 72;

/** Returns the path of the part of a circle on the front or on the back of the sphere. */
function arc(view: View, circle: (angle: number) => Vector, front: boolean): string {
  let [text, pen] = ["", "M"];
  for (let i = 0; i <= STEPS; i++) {
    const [x, y, depth] = project(view, circle((2 * Math.PI * i) / STEPS));
    if (depth >= 0 !== front) {
      pen = "M";
      continue;
    }
    text += `${pen}${(RADIUS * x).toFixed(1)},${(RADIUS * y).toFixed(1)}`;
    pen = "L";
  }
  return text;
}

/** Writes a state for people. */
export function describe([s1, s2, s3]: readonly number[]): string {
  const degree = Math.hypot(s1, s2, s3);
  if (degree < 1e-9) return "unpolarized";
  const [azimuth, ellipticity] = [angleOfLinearPolarization(s1, s2), ellipticityAngle(s1, s2, s3)];
  return `degree of polarization ${decimals(degree, 3)}, AoLP ${decimals(azimuth, 1)}°, ellipticity ${decimals(ellipticity, 1)}°`;
}

/** Returns the state after the azimuth and the ellipticity angle change by a number of degrees. Unpolarized light becomes polarized. */
export function turned([s1, s2, s3]: readonly number[], azimuth: number, ellipticity: number): Vector {
  const degree = Math.hypot(s1, s2, s3);
  const from = angleOfLinearPolarization(s1, s2);
  const height = degree > 0 ? ellipticityAngle(s1, s2, s3) : 0;
  const next = Math.max(-45, Math.min(45, height + ellipticity));
  const [, a, b, c] = stokesOf(degree > 0 ? degree : 1, (Number.isNaN(from) ? 0 : from) + azimuth, next);
  return [a, b, c];
}

export function PoincareSphere({ label, points, onChange }: PoincareSphereProps) {
  const [view, setView] = useState<View>(START);
  const drag = useRef<{ state: boolean; x: number; y: number } | null>(null);
  const drawing = useRef<SVGSVGElement>(null);

  /** Returns the position of the pointer in radii of the sphere from its centre. */
  const pointer = (event: PointerEvent): [number, number] => {
    const box = drawing.current!.getBoundingClientRect();
    const scale = (2 * HALF) / box.width / RADIUS;
    return [(event.clientX - box.left - box.width / 2) * scale, (event.clientY - box.top - box.height / 2) * scale];
  };
  const turn = (right: number, down: number) =>
    setView(({ yaw, pitch }) => ({ yaw: yaw - right, pitch: Math.max(-Math.PI / 2, Math.min(Math.PI / 2, pitch + down)) }));
  const move = (right: number, down: number) => {
    const degree = Math.hypot(...points[0].vector);
    const direction = unproject(view, right, down);
    onChange?.(direction.map((s) => s * (degree > 1e-9 ? degree : 1)) as Vector);
  };
  const onDown = (event: PointerEvent) => {
    const [x, y] = pointer(event);
    const isState = onChange !== undefined && Math.hypot(x, y) <= 1.04;
    drag.current = { state: isState, x, y };
    drawing.current!.setPointerCapture(event.pointerId);
    if (isState) move(x, y);
  };
  const onMove = (event: PointerEvent) => {
    if (!drag.current) return;
    const [x, y] = pointer(event);
    if (drag.current.state) move(x, y);
    else turn(x - drag.current.x, y - drag.current.y);
    drag.current = { ...drag.current, x, y };
  };
  const onKey = (event: KeyboardEvent) => {
    const moves: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const by = moves[event.key];
    if (!by) return;
    if (onChange && !event.shiftKey) onChange(turned(points[0].vector, by[0] * KEY_DEG, by[1] * KEY_DEG));
    else turn((by[0] * KEY_DEG * Math.PI) / 180, (-by[1] * KEY_DEG * Math.PI) / 180);
    event.preventDefault();
    event.stopPropagation();
  };
  const states = points.map((point) => `${point.label}: ${describe(point.vector)}`).join("; ");
  const help = onChange
    ? "arrow keys change azimuth and ellipticity, Shift and arrow keys turn the view"
    : "arrow keys turn the view";
  return (
    <svg
      ref={drawing} class={onChange ? "sphere editable" : "sphere"} viewBox={`${-HALF} ${-HALF} ${2 * HALF} ${2 * HALF}`} tabindex={0}
      role="application" aria-label={`${label}. ${states}`} aria-roledescription={`Poincaré sphere; ${help}`}
      onPointerDown={onDown} onPointerMove={onMove} onKeyDown={onKey}
      onPointerUp={() => (drag.current = null)} onPointerCancel={() => (drag.current = null)}
    >
      <circle class="sphere-ball" r={RADIUS} />
      {CIRCLES.map((circle, i) => <path key={i} class="sphere-back" d={arc(view, circle, false)} />)}
      {points.filter((point) => project(view, point.vector)[2] < 0).map((point) => <State key={point.label} view={view} point={point} />)}
      {CIRCLES.map((circle, i) => <path key={i} class="sphere-front" d={arc(view, circle, true)} />)}
      {POLES.map((pole) => <Pole key={pole.name} view={view} {...pole} />)}
      {points.filter((point) => project(view, point.vector)[2] >= 0).map((point) => <State key={point.label} view={view} point={point} />)}
    </svg>
  );
}

function Pole({ view, at, name, axis }: { view: View; at: Vector; name: string; axis?: string }) {
  const [x, y, depth] = project(view, at);
  const [labelX, labelY] = [x * RADIUS * 1.14, y * RADIUS * 1.14 + 4];
  const isBack = depth < -0.02;
  return (
    <g class={isBack ? "pole back" : "pole"}>
      {axis && <line class="sphere-axis" x1={-x * RADIUS} y1={-y * RADIUS} x2={x * RADIUS} y2={y * RADIUS} />}
      <circle r="2" cx={x * RADIUS} cy={y * RADIUS} />
      <text x={labelX} y={labelY} text-anchor="middle">{axis ? `${name} (${axis})` : name}</text>
    </g>
  );
}

function State({ view, point }: { view: View; point: SpherePoint }) {
  const [x, y, depth] = project(view, point.vector);
  return (
    <g class={`state ${point.colour} ${depth < 0 ? "back" : ""}`}>
      <line x1="0" y1="0" x2={x * RADIUS} y2={y * RADIUS} />
      <circle r="5" cx={x * RADIUS} cy={y * RADIUS}><title>{`${point.label}: ${describe(point.vector)}`}</title></circle>
    </g>
  );
}
