/**
 * Converts a query of a slice to one weighted sum, with the rules of `sunstone probe`: contraction with the pattern and the Stokes
 * state, convolution with the pulse, selection, sum. All steps are linear, so every entry of an axis has targets and weights.
 */

import { axisOf, type Axis, type AxisKind, type Slice } from "../../model";
import { SourceError, type Pattern } from "../source";
import { patternWeights } from "./pattern";
import { unitsOf, type Pulse, type Selection } from "./words";

/** Contribution of an entry to the result: the index of the slot along the axis, and the weight. */
export type Share = [slot: number, weight: number];

export interface AxisPlan {
  kind: AxisKind;
  /** First entry to read. */
  first: number;
  /** Last entry to read, plus 1. */
  end: number;
  /** Targets and weights of each of the entries `first..end`. */
  targets: Share[][];
  /** Length in the result; 1 if the axis is removed. A convolved axis has one more slot, for light that leaves the time bins. */
  slots: number;
}

export interface Plan {
  axes: AxisPlan[];
  /** Weights of all entries (v, u), row-major, if a pattern contracts them. */
  joint: Float64Array | null;
  /** Axes of the result. */
  kept: Axis[];
  /** Whether the time axis has the additional slot. */
  convolved: boolean;
  notes: string[];
}

/** A parsed query. */
export interface Query {
  select: Selection[];
  sum: AxisKind[];
  pattern?: Pattern;
  pulse?: Pulse;
  /** Weights of stokes_in. */
  input?: number[];
  /** Weights of stokes_out. */
  output?: number[];
  /** Camera pixels of an image: entries [y0, y1, x0, x1], averaged in blocks of bin x bin entries. */
  image?: { region: [number, number, number, number]; bin: number };
}

const MAX_ELEMENTS = 2 ** 30;
/** Maximum duration of half a pulse in time bins. */
const MAX_KERNEL = 1e6;
/** Wavelengths may be selected up to 5 nm beyond the axis. */
const BEYOND_NM = 5;

/** Returns the query without the steps along time, for arrays without this axis. */
export const withoutTime = (query: Query): Query =>
  ({ ...query, select: query.select.filter((s) => s.axis !== "t"), pulse: undefined });

/** Plans a query of an array with the given axes, which are those of the slice or a part of them. */
export function makePlan(query: Query, slice: Slice, axes: Axis[]): Plan {
  const plan: Plan = { axes: [], joint: null, kept: [], convolved: false, notes: [] };
  check(query, slice, axes);
  if (query.pattern) plan.joint = patternWeights(query.pattern, slice, plan.notes);
  const kernel = query.pulse && kernelOf(query.pulse, slice);
  for (const axis of axes) plan.axes.push(planAxis(query, axis, kernel, plan));
  if (plan.axes.reduce((n, a) => n * a.slots, 1) > MAX_ELEMENTS) {
    throw new SourceError("the result has too many elements: select fewer entries, or sum over an axis");
  }
  return plan;
}

function planAxis(query: Query, axis: Axis, kernel: Share[] | undefined, plan: Plan): AxisPlan {
  const { kind, coords } = axis;
  const weights = kind === "stokes_in" ? query.input : kind === "stokes_out" ? query.output : undefined;
  if (weights) return reduced(kind, 0, weights.map((weight) => [[0, weight]]));
  if (plan.joint && (kind === "v" || kind === "u")) return reduced(kind, 0, ones(coords.length));
  if (query.image && (kind === "y" || kind === "x")) return binned(axis, query.image, plan);
  const { first, end, drop } = rangeOf(query, axis);
  const keep = !drop && !query.sum.includes(kind);
  if (keep) plan.kept.push({ ...axis, coords: coords.slice(first, end) });
  if (kernel && kind === "t") {
    plan.convolved = true;
    return convolved(kernel, coords.length, first, end, keep);
  }
  if (!keep) return reduced(kind, first, ones(end - first));
  const targets = Array.from({ length: end - first }, (_, i): Share[] => [[i, 1]]);
  return { kind, first, end, targets, slots: end - first };
}

const ones = (n: number): Share[][] => Array.from({ length: n }, () => [[0, 1]]);

const reduced = (kind: AxisKind, first: number, targets: Share[][]): AxisPlan =>
  ({ kind, first, end: first + targets.length, targets, slots: 1 });

/** Adds the camera pixels of every bin. The caller divides by their number. */
function binned(axis: Axis, { region, bin }: NonNullable<Query["image"]>, plan: Plan): AxisPlan {
  const [first, end] = axis.kind === "y" ? [region[0], region[1]] : [region[2], region[3]];
  const slots = Math.ceil((end - first) / bin);
  const targets = Array.from({ length: end - first }, (_, i): Share[] => [[Math.floor(i / bin), 1]]);
  const coords = Array.from({ length: slots }, (_, i) => {
    const part = axis.coords.slice(first + i * bin, Math.min(first + (i + 1) * bin, end));
    return part.reduce((a, b) => a + b, 0) / part.length;
  });
  plan.kept.push({ ...axis, coords });
  return { kind: axis.kind, first, end, targets, slots };
}

/** Convolves time bins with the kernel. Light that leaves the stored bins is added to the last slot. */
function convolved(kernel: Share[], bins: number, first: number, end: number, keep: boolean): AxisPlan {
  const slots = keep ? end - first + 1 : 2;
  const targets = Array.from({ length: bins }, (_, i): Share[] => {
    const row = new Map<number, number>();
    const add = (slot: number, weight: number): void => { row.set(slot, (row.get(slot) ?? 0) + weight); };
    for (const [delay, weight] of kernel) {
      const j = i + delay;
      if (j < 0 || j >= bins) add(slots - 1, weight);
      else if (j >= first && j < end) add(keep ? j - first : 0, weight);
    }
    return [...row].filter(([, weight]) => weight !== 0);
  });
  return { kind: "t", first: 0, end: bins, targets, slots };
}

/** Returns the pulse as pairs of delay (in time bins) and weight. The sum of the weights is 1. */
function kernelOf(pulse: Pulse, slice: Slice): Share[] {
  const fault = (reason: string): SourceError => new SourceError(`pulse for slice \`${slice.name}\`: ${reason}`);
  const bin = slice.attributes.time_bin_ps;
  if (!axisOf(slice, "t") || typeof bin !== "number" || !(bin > 0)) {
    throw fault("the slice is not time-resolved: render the slice with time bins");
  }
  let weights: Share[];
  if ("fwhm" in pulse) {
    const fwhmInSigma = Math.sqrt(8 * Math.LN2);
    const sigma = pulse.fwhm / fwhmInSigma / bin;
    const reach = Math.ceil(6 * sigma);
    if (!(reach <= MAX_KERNEL)) {
      const widest = (MAX_KERNEL / 6) * fwhmInSigma * bin;
      throw fault(`the pulse has a width of ${pulse.fwhm} ps; expected 0 to ${widest.toFixed(0)} ps`);
    }
    weights = Array.from({ length: 2 * reach + 1 }, (_, i): Share => {
      const delay = i - reach;
      return [delay, delay === 0 ? 1 : Math.exp(-0.5 * (delay / sigma) ** 2)];
    });
  } else {
    weights = pulse.samples.map((weight, delay): Share => [delay, weight]);
  }
  const sum = weights.reduce((total, [, weight]) => total + weight, 0);
  const most = 2 * MAX_KERNEL + 1;
  if (weights.length > most || !(Number.isFinite(sum) && sum > 0)) {
    throw fault(`the pulse has ${weights.length} samples with the sum ${sum}; expected at most ${most} samples with a positive, ` +
      "finite sum");
  }
  return weights.map(([delay, weight]): Share => [delay, weight / sum]).filter(([, weight]) => weight !== 0);
}

const selectionFault = (axis: AxisKind, reason: string): SourceError =>
  new SourceError(`selection on axis \`${axis}\`: ${reason}`);

function check(query: Query, slice: Slice, axes: Axis[]): void {
  const has = (kind: AxisKind): boolean => axes.some((axis) => axis.kind === kind);
  query.select.forEach((selection, i) => {
    const { axis } = selection;
    const contracts = (what: string): SourceError =>
      selectionFault(axis, `${what} already contracts the axis: remove the selection or ${what.replace("a ", "the ")}`);
    if (query.select.slice(0, i).some((s) => s.axis === axis)) {
      throw selectionFault(axis, "the axis is selected twice: use one selection per axis");
    }
    if ((axis === "v" || axis === "u") && query.pattern) throw contracts("a pattern");
    if (axis === "stokes_in" && query.input) throw contracts("a Stokes state");
    if (axis === "stokes_out" && query.output) throw contracts("an analyzer");
    if ((axis === "y" || axis === "x") && query.image) throw selectionFault(axis, "an image keeps the axis: use a region");
    // Intensity slices contain M00 only, so selecting element 0 has no effect.
    const isM00 = (axis === "stokes_out" || axis === "stokes_in") && "nearest" in selection && selection.nearest === 0;
    if (!has(axis) && !(isM00 && !has("stokes_in"))) {
      throw new SourceError(`slice \`${slice.name}\` has no axis \`${axis}\`; available: ${axes.map((a) => a.kind).join(", ")}`);
    }
  });
  for (const weights of [query.input, query.output]) {
    if (weights && !has("stokes_in") && weights.join() !== "1,0,0,0") {
      throw new SourceError(`slice \`${slice.name}\` contains only intensity: use the Stokes state 1,0,0,0, or render with polarization ` +
        "`mueller`");
    }
  }
}

/** Returns the index of the entry nearest to a coordinate; of two equally near entries, the first. */
const nearestEntry = (coords: number[], value: number): number =>
  coords.reduce((best, c, i) => (Math.abs(c - value) < Math.abs(coords[best] - value) ? i : best), 0);

/** Returns the selected entries of an axis. */
function rangeOf(query: Query, axis: Axis): { first: number; end: number; drop: boolean } {
  const { coords, kind } = axis;
  const n = coords.length;
  const selection = query.select.find((s) => s.axis === kind);
  if (!selection) return { first: 0, end: n, drop: false };
  // A coordinate may be up to half a spacing beyond the axis, and a wavelength up to a few nanometres.
  const spacing = coords.reduce((most, c, i) => (i === 0 ? 0 : Math.max(most, Math.abs(c - coords[i - 1]))), 0);
  const slack = kind === "wavelength" ? BEYOND_NM : n < 2 ? Infinity : spacing / 2;
  const [low, high] = [coords[0] - slack, coords[n - 1] + slack];
  const [from, to] = "nearest" in selection ? [selection.nearest, selection.nearest] : [selection.from, selection.to];
  if (!(from <= high && to >= low)) {
    const units = unitsOf(kind) === "1" ? "" : ` ${unitsOf(kind)}`;
    const asked = from === to ? `${from}` : `${from}:${to}`;
    throw selectionFault(kind, `the value ${asked} is outside the range ${coords[0]} to ${coords[n - 1]}${units}`);
  }
  if ("nearest" in selection) {
    const first = nearestEntry(coords, from);
    return { first, end: first + 1, drop: true };
  }
  const last = to === Infinity ? n - 1 : nearestEntry(coords, to);
  let first = from === -Infinity ? 0 : nearestEntry(coords, from);
  // Halfway between two entries, a range begins with the later entry, so ranges may be given by bin edges.
  if (from !== -Infinity && first + 1 < n && Math.abs(coords[first + 1] - from) <= Math.abs(coords[first] - from)) first += 1;
  return { first, end: Math.max(last, first) + 1, drop: false };
}
