/** Parses the words of a query, such as `y=128`, `t=1000:2000`, `stokes_in=s1`, `gaussian:50` and `horizontal`. */

import { AXES, type AxisKind } from "../../model";
import { SourceError } from "../source";

/** The part of one axis that a query keeps. Coordinates are in the unit of the axis. */
export type Selection =
  /** The entry nearest to the coordinate. The axis is removed. */
  | { axis: AxisKind; nearest: number }
  /** All entries between two coordinates. The axis is kept. Infinite coordinates select the ends of the axis. */
  | { axis: AxisKind; from: number; to: number };

/** A pulse: a Gaussian with a full width at half maximum in picoseconds, or samples at the bin spacing. */
export type Pulse = { fwhm: number } | { samples: number[] };

/** Units of the coordinates of every axis; "1" for indices. */
export const unitsOf = (axis: AxisKind): string =>
  "yxvu".includes(axis) ? "pixel" : axis === "t" ? "ps" : axis === "wavelength" ? "nm" : "1";

const fault = (text: string, reason: string): SourceError => new SourceError(`\`${text}\`: ${reason}`);

/** Returns the finite number of a word, or NaN. */
const number = (word: string): number =>
  /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(word.trim()) ? Number(word) : NaN;

function axisNamed(text: string, name: string): AxisKind {
  const found = AXES.find((kind) => kind === name.trim());
  if (!found) throw fault(text, `unknown axis \`${name.trim()}\`; expected one of ${AXES.join(", ")}`);
  return found;
}

const LABELS = ["medium", "specular", "glossy", "diffuse"];

/** Returns the set of bits of a label such as `specular+diffuse`, or -1. */
function label(word: string): number {
  if (word === "none") return 0;
  const bits = word.split("+").map((name) => LABELS.indexOf(name.trim()));
  return bits.includes(-1) ? -1 : bits.reduce((set, bit) => set | (1 << bit), 0);
}

function coordinate(text: string, axis: AxisKind, word: string): number {
  const name = word.trim();
  const names = axis === "stokes_out" || axis === "stokes_in" ? ["s0", "s1", "s2", "s3"]
    : axis === "component" ? ["direct", "indirect"] : [];
  const index = axis === "label" ? label(name) : names.indexOf(name);
  if (index >= 0) return index;
  const value = number(word);
  if (!Number.isFinite(value)) {
    const units = unitsOf(axis);
    throw fault(text, `\`${name}\`: expected a number${units === "1" ? "" : ` in ${units}`}`);
  }
  return value;
}

/** Parses `AXIS=VALUE`, `AXIS=FROM:TO`, `AXIS=FROM:` or `AXIS=:TO`. */
export function parseSelection(text: string): Selection {
  const [name, value] = splitOnce(text, "=");
  if (value === undefined) throw fault(text, "expected AXIS=VALUE or AXIS=FROM:TO, such as `t=1000:2000`");
  const axis = axisNamed(text, name);
  const [first, last] = splitOnce(value, ":");
  if (last === undefined) return { axis, nearest: coordinate(text, axis, value) };
  const end = (word: string, open: number): number => (word.trim() === "" ? open : coordinate(text, axis, word));
  const [from, to] = [end(first, -Infinity), end(last, Infinity)];
  if (from > to) throw fault(text, "the range is reversed: write the smaller value first");
  return { axis, from, to };
}

/** Parses `gaussian:FWHM` (in picoseconds) or `samples:A,B,C` (at the bin spacing). */
export function parsePulse(text: string): Pulse {
  const [kind, rest] = splitOnce(text, ":");
  if (kind === "gaussian" && rest !== undefined) {
    const fwhm = number(rest);
    if (!(Number.isFinite(fwhm) && fwhm >= 0)) throw fault(text, "the width must be a number of picoseconds, 0 or more");
    return { fwhm };
  }
  if (kind === "samples" && rest !== undefined) {
    const samples = rest.split(",").map(number);
    if (!samples.every(Number.isFinite)) throw fault(text, "the samples must be numbers separated by commas");
    return { samples };
  }
  throw fault(text, "expected `gaussian:FWHM_PS` or `samples:A,B,C`");
}

/** Checks the names of axes. */
export const parseAxes = (names: string[]): AxisKind[] => names.map((name) => axisNamed(names.join(","), name));

const STATES: Record<string, number[]> = {
  unpolarized: [1, 0, 0, 0],
  horizontal: [1, 1, 0, 0],
  vertical: [1, -1, 0, 0],
  plus45: [1, 0, 1, 0],
  minus45: [1, 0, -1, 0],
  right: [1, 0, 0, 1],
  left: [1, 0, 0, -1],
};

/** Parses a physical Stokes vector: four numbers `s0,s1,s2,s3`, or a name such as `horizontal`. */
export function parseStokes(text: string): number[] {
  const named = STATES[text.trim()];
  if (named) return named;
  const stokes = text.split(",").map((word) => Math.fround(number(word)));
  if (stokes.length !== 4 || !stokes.every(Number.isFinite)) {
    throw fault(text, "expected four numbers `s0,s1,s2,s3`, or a name such as `horizontal`");
  }
  // The tolerance allows for rounding of the numbers in the text.
  if (!(stokes[0] > 0 && Math.hypot(stokes[1], stokes[2], stokes[3]) <= stokes[0] * (1 + 1e-4))) {
    throw fault(text, "not a physical Stokes vector: s0 must be above 0, and s1² + s2² + s3² at most s0²");
  }
  return stokes;
}

function splitOnce(text: string, separator: string): [string, string | undefined] {
  const at = text.indexOf(separator);
  return at < 0 ? [text, undefined] : [text.slice(0, at), text.slice(at + 1)];
}
