/** A chart of lines with error bands over a coordinate, such as the time profile of a pixel. */

import { useState } from "preact/hooks";
import { brief, linearTicks, type Tick } from "../display/scale";
import { six } from "./numbers";
import { useWidth } from "./useWidth";

export interface Line {
  label: string;
  values: ArrayLike<number>;
  /** One standard error of each value. */
  errors: ArrayLike<number> | null;
  /** Class that sets the colour, `line-0` to `line-3`. */
  colour: string;
  /** Pattern of dashes in pixels, so that lines differ not only by colour. */
  dash?: string;
  /** Draw a bar for each entry instead of a line. */
  bars?: boolean;
}

export interface ProfileChartProps {
  /** What the chart shows, for screen readers. */
  label: string;
  coords: readonly number[];
  /** Name of the coordinate, and its unit in brackets. */
  xLabel: string;
  xUnit: string;
  yLabel: string;
  yUnit: string;
  lines: readonly Line[];
  log: boolean;
  /** The chosen entry. Null: none. */
  cursor?: number | null;
  /** First and last entry of a shaded range. */
  shaded?: [number, number] | null;
  /** Called when the user chooses an entry. Absent: the chart only shows values. */
  onCursor?: (index: number | null) => void;
}

const HEIGHT = 200;
const LEFT = 62;
const RIGHT = 10;
const TOP = 8;
const BOTTOM = 36;
/** Ratio of the largest and the smallest value of a logarithmic axis. */
const DECADES = 6;

interface Vertical {
  ticks: Tick[];
  /** Returns the distance from the bottom, 0..1. */
  place: (value: number) => number;
}

/** Returns the vertical axis that contains all values. */
function vertical(lines: readonly Line[], log: boolean): Vertical {
  let [low, high, least] = [0, 0, Infinity];
  for (const { values } of lines) {
    for (let i = 0; i < values.length; i++) {
      const value = values[i];
      if (!Number.isFinite(value)) continue;
      if (value < low) low = value;
      if (value > high) high = value;
      if (value > 0 && value < least) least = value;
    }
  }
  if (log && high > 0) {
    const top = Math.ceil(Math.log10(high) - 1e-9);
    const bottom = Math.min(top - 1, Math.max(Math.floor(Math.log10(least)), top - DECADES));
    const ticks = Array.from({ length: top - bottom + 1 }, (_, i) => ({ at: i / (top - bottom), label: `1e${bottom + i}` }));
    return { ticks, place: (value) => Math.max(0, (Math.log10(Math.max(value, 1e-300)) - bottom) / (top - bottom)) };
  }
  const span = high - low || 1;
  const [from, to] = [low < 0 ? low - 0.04 * span : 0, high + 0.04 * span || 1];
  return { ticks: linearTicks(from, to, 5), place: (value) => (value - from) / (to - from) };
}

/** Returns the path of a line. NaN leaves a gap. */
function path(coords: number[], values: ArrayLike<number>, y: (value: number) => number): string {
  let [text, pen] = ["", "M"];
  for (let i = 0; i < coords.length; i++) {
    if (!Number.isFinite(values[i])) {
      pen = "M";
      continue;
    }
    text += `${pen}${coords[i].toFixed(1)},${y(values[i]).toFixed(1)}`;
    pen = "L";
  }
  return text;
}

/** Returns the path of the band of one standard error on both sides. Values that are not finite have no band. */
function band(coords: number[], line: Line, y: (value: number) => number): string {
  const { values, errors } = line;
  if (!errors) return "";
  const inside = coords.map((_, i) => i).filter((i) => Number.isFinite(values[i] + errors[i]));
  const upper = inside.map((i) => `${coords[i].toFixed(1)},${y(values[i] + errors[i]).toFixed(1)}`);
  const lower = inside.reverse().map((i) => `${coords[i].toFixed(1)},${y(values[i] - errors[i]).toFixed(1)}`);
  return upper.length > 1 ? `M${upper.join("L")}L${lower.join("L")}Z` : "";
}

/** Returns the path of vertical lines from 0 to each value. */
function bars(coords: number[], values: ArrayLike<number>, y: (value: number) => number): string {
  return coords.map((x, i) => (values[i] ? `M${x.toFixed(1)},${y(0).toFixed(1)}V${y(values[i]).toFixed(1)}` : "")).join("");
}

export function ProfileChart(props: ProfileChartProps) {
  const { label, coords, xLabel, xUnit, yLabel, yUnit, lines, log, cursor = null, shaded, onCursor } = props;
  const [box, width] = useWidth<HTMLDivElement>(420);
  const [hover, setHover] = useState<number | null>(null);
  const last = coords.length - 1;
  const [low, high] = [coords[0], last > 0 ? coords[last] : coords[0] + 1];
  const inner = Math.max(10, width - LEFT - RIGHT);
  const tall = HEIGHT - TOP - BOTTOM;
  const x = (coord: number) => LEFT + ((coord - low) / (high - low)) * inner;
  const axis = vertical(lines, log);
  const y = (value: number) => TOP + tall * (1 - Math.max(0, Math.min(1, axis.place(value))));
  const xs = coords.map(x);
  const barWidth = Math.max(1, (0.8 * inner) / coords.length);

  // Bars may be as thin as a pixel: within 4 pixels of the pointer, the highest bar is meant.
  const reach = lines.some((line) => line.bars) ? (4 / inner) * (high - low) : 0;
  const entryAt = (event: MouseEvent) => {
    const left = box.current!.getBoundingClientRect().left;
    // A click has whole coordinates, a move of the pointer may have fractions.
    const coord = low + ((Math.floor(event.clientX) - left - LEFT) / inner) * (high - low);
    const distance = (i: number) => Math.abs(coords[i] - coord);
    const nearest = coords.reduce((best, _, i) => (distance(i) < distance(best) ? i : best), 0);
    const size = (i: number) => Math.max(...lines.map((line) => Math.abs(line.values[i]) || 0));
    return coords.reduce((best, _, i) => (distance(i) <= reach && size(i) > size(best) ? i : best), nearest);
  };
  const onKey = (event: KeyboardEvent) => {
    if (!onCursor) return;
    const steps: Record<string, number> = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };
    if (steps[event.key]) onCursor(Math.max(0, Math.min(last, cursor === null ? 0 : cursor + steps[event.key])));
    else if (event.key === "Home") onCursor(0);
    else if (event.key === "End") onCursor(last);
    else if (event.key === "Escape" && cursor !== null) onCursor(null);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  const coordinate = (i: number) => `${xLabel} = ${brief(coords[i], 7)} ${xUnit}`;
  const shown = hover ?? cursor;
  const slider = onCursor
    ? {
        role: "slider" as const, tabindex: 0, "aria-valuemin": 0, "aria-valuemax": last, "aria-valuenow": cursor ?? 0,
        "aria-valuetext": cursor === null ? "no entry chosen" : coordinate(cursor),
      }
    : { role: "img" as const };
  return (
    <div class="chart" ref={box}>
      <svg
        width={width} height={HEIGHT} aria-label={label} {...slider} onKeyDown={onKey}
        onPointerMove={(event) => setHover(entryAt(event))} onPointerLeave={() => setHover(null)}
        onClick={(event) => onCursor?.(entryAt(event))}
      >
        {shaded && (
          <rect class="shaded" x={xs[shaded[0]]} width={Math.max(1, xs[shaded[1]] - xs[shaded[0]])} y={TOP} height={tall} />
        )}
        {axis.ticks.map((tick) => (
          <g key={tick.label}>
            <line class="grid-line" x1={LEFT} x2={width - RIGHT} y1={TOP + tall * (1 - tick.at)} y2={TOP + tall * (1 - tick.at)} />
            <text x={LEFT - 5} y={TOP + tall * (1 - tick.at) + 4} text-anchor="end">{tick.label}</text>
          </g>
        ))}
        {linearTicks(low, high, Math.max(2, Math.floor(inner / 55))).map((tick) => (
          <text key={tick.label} x={LEFT + tick.at * inner} y={HEIGHT - BOTTOM + 14} text-anchor="middle">{tick.label}</text>
        ))}
        <text class="axis-label" x={LEFT + inner / 2} y={HEIGHT - 4} text-anchor="middle">{`${xLabel} [${xUnit}]`}</text>
        <text class="axis-label" transform={`translate(11 ${TOP + tall / 2}) rotate(-90)`} text-anchor="middle">
          {yUnit === "1" ? yLabel : `${yLabel} [${yUnit}]`}
        </text>
        {lines.map((line) => <path key={line.label} class={`band ${line.colour}`} d={band(xs, line, y)} />)}
        {lines.map((line) =>
          line.bars ? (
            <path key={line.label} class={`bars ${line.colour}`} stroke-width={barWidth} d={bars(xs, line.values, y)} />
          ) : (
            <path key={line.label} class={`line ${line.colour}`} stroke-dasharray={line.dash} d={path(xs, line.values, y)} />
          ))}
        {cursor !== null && cursor <= last && <line class="cursor" x1={xs[cursor]} x2={xs[cursor]} y1={TOP} y2={TOP + tall} />}
        {hover !== null && hover <= last && <line class="hover" x1={xs[hover]} x2={xs[hover]} y1={TOP} y2={TOP + tall} />}
        <rect class="plot-frame" x={LEFT} y={TOP} width={inner} height={tall} />
      </svg>
      <ul class="legend">
        {lines.map((line) => (
          <li key={line.label}>
            <svg width="26" height="8" aria-hidden="true">
              <path class={`line ${line.colour}`} stroke-dasharray={line.dash} d="M0,4L26,4" />
            </svg>
            {line.label}
            {shown !== null && shown <= last && (
              <span class="readout" data-value={String(line.values[shown])}>
                {` ${six(line.values[shown])}${line.errors ? ` ± ${brief(line.errors[shown], 2)}` : ""}`}
              </span>
            )}
          </li>
        ))}
      </ul>
      <output class="readout chart-coordinate">{shown !== null && shown <= last ? coordinate(shown) : "\u00a0"}</output>
    </div>
  );
}
