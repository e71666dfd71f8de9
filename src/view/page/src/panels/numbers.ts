/** Numbers as text. */

import { brief } from "../display/scale";

const MINUS = "\u2212";

/** Writes a number with six significant digits, which is what `sunstone probe` gives to single precision. */
export function six(value: number): string {
  if (!Number.isFinite(value) || value === 0) return brief(value);
  const size = Math.abs(value);
  const text = size !== 0 && (size < 1e-4 || size >= 1e6) ? value.toExponential(5) : value.toPrecision(6);
  return text.replaceAll("-", MINUS);
}

/** Writes an angle or another derived number with two decimals, or a dash if it is not defined. */
export const decimals = (value: number, digits = 2): string =>
  Number.isFinite(value) ? value.toFixed(digits).replace("-", MINUS) : "–";

/** Writes a number of seconds. */
export function duration(seconds: number): string {
  if (seconds < 90) return `${Math.round(seconds)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return `${(seconds / 3600).toFixed(1)} h`;
}
