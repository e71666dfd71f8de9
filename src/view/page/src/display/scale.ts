/** Scales between values and positions along a colour bar, with ticks at round numbers. */

import type { Scale } from "../state";

/** Ratio of the limit and the value where the symmetric logarithmic scale changes from linear to logarithmic. */
const SYMLOG_RATIO = 100;

/** Returns the position of a quotient of a value and the limit of its scale: -1..1. */
export function place(scale: Scale, v: number): number {
  if (scale === "arctan") return Math.atan(8 * v) / Math.atan(8);
  if (scale === "symlog") return (Math.sign(v) * Math.log1p(SYMLOG_RATIO * Math.abs(v))) / Math.log1p(SYMLOG_RATIO);
  return v;
}

/** A tick: its position, 0..1 from the low end of the bar, and its label. */
export interface Tick {
  at: number;
  label: string;
}

const MINUS = "\u2212";

/** Writes a number with at most `digits` significant digits, for people: 0.0123, 1.2e-7. */
export function brief(value: number, digits = 4): string {
  if (Number.isNaN(value)) return "NaN";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : `${MINUS}∞`;
  const size = Math.abs(value);
  const text = size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(digits - 1) : String(Number(value.toPrecision(digits)));
  return text.replaceAll("-", MINUS);
}

/** Writes a value with its standard error. */
export function withError(value: number, error: number | null): string {
  return error === null || !Number.isFinite(error) ? brief(value) : `${brief(value)} ± ${brief(error, 2)}`;
}

/** Returns the step of ticks, 1, 2 or 5 times a power of ten, at least `least`. */
function step(least: number): number {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * ([1, 2, 5].find((m) => m * power >= least * (1 - 1e-9)) ?? 10);
}

/** Returns about `most` ticks at round numbers from `low` to `high`. */
export function linearTicks(low: number, high: number, most: number): Tick[] {
  const span = high - low;
  if (!(span > 0 && Number.isFinite(span))) return [];
  const by = step(span / most);
  const first = Math.ceil(low / by - 1e-9);
  const last = Math.floor(high / by + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, i) => {
    const value = (first + i) * by;
    return { at: (value - low) / span, label: brief(value) };
  });
}

/** Returns ticks of a colour bar from `low` to `high`, where low is 0 or the negative of high if the scale is not linear. */
export function barTicks(low: number, high: number, scale: Scale): Tick[] {
  if (scale === "linear") return linearTicks(low, high, 5);
  const signed = low < 0;
  const apart = signed ? 0.28 : 0.16;
  const magnitude = Math.floor(Math.log10(high * (1 + 1e-6)));
  const found: number[] = [];
  for (const power of [magnitude, magnitude - 1, magnitude - 2]) {
    for (const m of [5, 2, 1]) {
      const value = m * 10 ** power;
      const last = found.at(-1);
      const at = place(scale, value / high);
      const isFar = at >= apart && (last === undefined || place(scale, last / high) - at >= apart);
      if (value <= high * (1 + 1e-6) && isFar) found.push(value);
    }
  }
  const at = (value: number): number => (signed ? 0.5 + 0.5 * place(scale, value / high) : place(scale, value / high));
  const values = [...(signed ? found.map((v) => -v) : []), 0, ...found.reverse()];
  return values.map((value) => ({ at: Math.min(1, Math.max(0, at(value))), label: brief(value, 2) }));
}
