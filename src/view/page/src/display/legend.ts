/** The scale of an image of numbers: which map, which limits, which ticks. */

import type { Scale, ViewState } from "../state";
import type { QuantityMap } from "../math/maps";
import { white } from "./colour";
import { cyclic, diverging, packed, sequential, type ColourMap } from "./colourmaps";
import { barTicks, brief, place, type Tick } from "./scale";

export interface Legend {
  label: string;
  unit: string;
  map: ColourMap;
  low: number;
  high: number;
  scale: Scale;
  ticks: Tick[];
}

const magnitudes = (values: Float32Array): Float32Array => values.map(Math.abs);

/** Returns the legend of a map. The exposure narrows the limits by a factor of 2 per stop. */
export function legendOf(map: QuantityMap, view: ViewState): Legend {
  const { label, unit, kind, range } = map;
  if (kind === "cyclic") {
    const [low, high] = range ?? [0, 180];
    const ticks = [0, 1, 2, 3, 4].map((k) => ({ at: k / 4, label: brief(low + (k / 4) * (high - low)) }));
    return { label, unit, map: cyclic, low, high, scale: "linear", ticks };
  }
  const widest = range ? range[1] : white(kind === "diverging" ? magnitudes(map.values) : map.values);
  const high = widest / 2 ** view.exposure;
  const low = kind === "diverging" ? -high : 0;
  // Ratios between 0 and 1 and angles are read best from a linear scale.
  const scale = kind === "unit" || unit === "°" ? "linear" : view.scale;
  const table = kind === "diverging" ? diverging : sequential;
  return { label, unit, map: table, low, high, scale, ticks: barTicks(low, high, scale) };
}

/** Returns the position of a value on the bar of a legend, 0..1, not clamped. */
export function positionOf(legend: Legend, value: number): number {
  const { low, high, scale } = legend;
  if (scale === "linear") return (value - low) / (high - low);
  const at = place(scale, value / high);
  return low < 0 ? 0.5 + 0.5 * at : at;
}

const TABLE = 4096;

/** Returns the colours of [`TABLE`] values evenly spaced from low to high, which include the scale. */
function tableOf(legend: Legend): Uint32Array {
  const colours = packed(legend.map);
  return Uint32Array.from({ length: TABLE }, (_, i) => {
    const value = legend.low + ((i + 0.5) / TABLE) * (legend.high - legend.low);
    const at = Math.max(0, Math.min(1, positionOf(legend, value)));
    return colours[Math.min(255, Math.floor(256 * at))];
  });
}

/**
 * Writes the colours of values into an image whose row `y` begins at `start + y * stride`. Values that are NaN have the colour
 * `undefinedRgba`.
 */
export function paint(
  values: Float32Array, width: number, legend: Legend, undefinedRgba: number, out: Uint32Array, start = 0, stride = width,
): void {
  const table = tableOf(legend);
  const scale = TABLE / (legend.high - legend.low);
  const height = values.length / width;
  for (let y = 0, from = 0; y < height; y++) {
    for (let to = start + y * stride, end = to + width; to < end; to++, from++) {
      const value = values[from];
      if (value !== value) {
        out[to] = undefinedRgba;
        continue;
      }
      const i = (value - legend.low) * scale;
      out[to] = table[i <= 0 ? 0 : i >= TABLE ? TABLE - 1 : i | 0];
    }
  }
}
