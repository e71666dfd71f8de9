/** A map of numbers as colours, with a colour bar and the value under the pointer. */

import { useLayoutEffect, useRef, useState } from "preact/hooks";
import { srgb, white } from "../display/colour";
import { type ColourMap, UNDEFINED_RGBA, cyclic, diverging, packed, sequential } from "../display/colourmaps";
import { barTicks, brief, linearTicks, place } from "../display/scale";
import type { Scale } from "../state";
import { six } from "./numbers";

const grey: ColourMap = Uint8Array.from({ length: 3 * 256 }, (_, i) => srgb(Math.floor(i / 3) / 255));

type Kind = "positive" | "diverging" | "cyclic" | "unit" | "grey";

const MAPS: Record<Kind, ColourMap> = { positive: sequential, unit: sequential, diverging, cyclic, grey };

export interface MapCanvasProps {
  /** Row-major values. NaN is drawn grey. */
  values: Float32Array;
  height: number;
  width: number;
  label: string;
  unit: string;
  kind: Kind;
  /** Values at the ends of the colour bar. Absent: 0 or the negative limit, and the 99.5th percentile of the magnitude. */
  range?: [number, number];
  scale?: Scale;
  /** Names of the directions, for the axes. */
  rows: string;
  columns: string;
  /** Returns the coordinates of an entry as text. */
  where: (row: number, column: number) => string;
  /** Entry of the cross. A null row or column draws a single line. */
  marker?: { row: number | null; column: number | null } | null;
  /** Height divided by width on the screen. Absent: that of the values. */
  aspect?: number;
  /** Maximum height on the screen in pixels. */
  tall?: number;
  onPick?: (row: number, column: number) => void;
}

/** Returns the values at the ends of the colour bar. */
export function limits(values: Float32Array, kind: Kind): [number, number] {
  if (kind === "unit") return [0, 1];
  if (kind === "cyclic") return [0, 180];
  if (kind !== "diverging") return [0, white(values, 0.995)];
  const high = white(values.map(Math.abs), 0.995);
  return [-high, high];
}

/** Returns the position of a value on the colour bar, 0..1 within its ends. */
function position(value: number, [low, high]: [number, number], scale: Scale): number {
  if (scale === "linear" || (low !== 0 && low !== -high)) return (value - low) / (high - low);
  const p = place(scale, value / high);
  return low < 0 ? 0.5 + 0.5 * p : p;
}

function paint(canvas: HTMLCanvasElement, props: MapCanvasProps, range: [number, number], scale: Scale): void {
  const { values, height, width, kind } = props;
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d");
  if (!context || width === 0 || height === 0) return;
  const image = context.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  const colours = packed(MAPS[kind]);
  for (let i = 0; i < height * width; i++) {
    const value = values[i];
    const k = Math.max(0, Math.min(255, Math.round(255 * position(value, range, scale))));
    pixels[i] = Number.isNaN(value) ? UNDEFINED_RGBA : colours[k];
  }
  context.putImageData(image, 0, 0);
}

/** Returns one sentence about the values, for screen readers. */
function summary({ values, height, width, label, unit }: MapCanvasProps): string {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  const range = low <= high ? `values from ${brief(low)} to ${brief(high)} ${unit}` : "no values";
  return `${label}: ${height} rows, ${width} columns, ${range}`;
}

const bounded = (value: number, length: number): number => Math.max(0, Math.min(length - 1, value));

export function MapCanvas(props: MapCanvasProps) {
  const { values, height, width, label, unit, kind, rows, columns, where, marker, onPick } = props;
  const scale = props.scale ?? "linear";
  const aspect = props.aspect ?? height / width;
  const tall = props.tall ?? 340;
  const range = props.range ?? limits(values, kind);
  const canvas = useRef<HTMLCanvasElement>(null);
  const [cursor, setCursor] = useState<[number, number] | null>(null);
  useLayoutEffect(() => {
    if (canvas.current) paint(canvas.current, props, range, scale);
  }, [values, height, width, kind, range[0], range[1], scale]);

  const entryAt = (event: PointerEvent): [number, number] => {
    const box = canvas.current!.getBoundingClientRect();
    const row = Math.floor(((event.clientY - box.top) / box.height) * height);
    const column = Math.floor(((event.clientX - box.left) / box.width) * width);
    return [bounded(row, height), bounded(column, width)];
  };
  const chosen: [number, number] = [bounded(marker?.row ?? 0, height), bounded(marker?.column ?? 0, width)];
  const onKey = (event: KeyboardEvent) => {
    const by = event.shiftKey ? 10 : 1;
    const moves: Record<string, [number, number]> = { ArrowUp: [-by, 0], ArrowDown: [by, 0], ArrowLeft: [0, -by], ArrowRight: [0, by] };
    const [row, column] = cursor ?? chosen;
    if (moves[event.key]) {
      const [down, right] = moves[event.key];
      setCursor([bounded(row + down, height), bounded(column + right, width)]);
    } else if ((event.key === "Enter" || event.key === " ") && onPick) {
      onPick(row, column);
    } else {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
  };
  const shown = cursor ?? (marker?.row != null && marker.column != null ? chosen : null);
  const isInside = shown && shown[0] < height && shown[1] < width;
  const readout = isInside ? `${where(...shown)}: ${six(values[shown[0] * width + shown[1]])} ${unit === "1" ? "" : unit}` : "";
  const percent = (index: number, length: number) => `${(100 * (index + 0.5)) / length}%`;
  return (
    <figure class="map">
      <div class="map-body">
        <span class="map-rows">{rows}</span>
        <div
          class={onPick ? "map-frame pickable" : "map-frame"} tabIndex={0} role="application" aria-label={summary(props)}
          aria-roledescription={onPick ? "map; arrow keys move the cursor, Enter chooses an entry" : "map; arrow keys move the cursor"}
          style={{ aspectRatio: `1 / ${aspect}`, maxWidth: `${tall / aspect}px` }} onKeyDown={onKey} onBlur={() => setCursor(null)}
          onPointerMove={(event) => setCursor(entryAt(event))} onPointerLeave={() => setCursor(null)}
          onClick={(event) => onPick?.(...entryAt(event as unknown as PointerEvent))}
        >
          <canvas ref={canvas} class={width > 600 || height > 600 ? "smooth" : ""} aria-hidden="true" />
          {marker?.row != null && <div class="map-line across" style={{ top: percent(chosen[0], height) }} />}
          {marker?.column != null && <div class="map-line down" style={{ left: percent(chosen[1], width) }} />}
          {cursor && <div class="map-cursor" style={{ top: percent(cursor[0], height), left: percent(cursor[1], width) }} />}
        </div>
      </div>
      <span class="map-columns" style={{ maxWidth: `${tall / aspect + 24}px` }}>{columns}</span>
      <Bar kind={kind} range={range} scale={scale} label={`${label}${unit === "1" ? "" : ` [${unit}]`}`} />
      <output class="readout">{readout || "\u00a0"}</output>
    </figure>
  );
}

function Bar({ kind, range, scale, label }: { kind: Kind; range: [number, number]; scale: Scale; label: string }) {
  const [low, high] = range;
  const map = MAPS[kind];
  const stops = Array.from({ length: 33 }, (_, i) => 3 * Math.round((255 * i) / 32));
  const gradient = `linear-gradient(to right, ${stops.map((k) => `rgb(${map[k]} ${map[k + 1]} ${map[k + 2]})`).join(", ")})`;
  const all = scale === "linear" || (low !== 0 && low !== -high) ? linearTicks(low, high, 4) : barTicks(low, high, scale);
  // Ticks that are too close to the previous one would overlap.
  const ticks = all.filter((tick, i) => i === 0 || tick.at - all[i - 1].at > 0.09);
  const side = (at: number) => (at < 0.04 ? "first" : at > 0.96 ? "last" : "");
  return (
    <figcaption class="map-bar">
      <div class="map-bar-fill" style={{ background: gradient }} />
      <div class="map-bar-ticks" aria-hidden="true">
        {ticks.map((tick) => <span key={tick.label} class={side(tick.at)} style={{ left: `${100 * tick.at}%` }}>{tick.label}</span>)}
      </div>
      <span>{label}</span>
    </figcaption>
  );
}
