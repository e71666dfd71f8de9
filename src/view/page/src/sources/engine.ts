/** Answers queries in the page, with the results of `sunstone probe`: for static exports, which have no program behind them. */

import { lengthOf, type Axis, type ImageResult, type Labelled, type Slice } from "../model";
import { SourceError, type ImageRequest, type ProbeRequest } from "./source";
import type { ArrayOpener, Field } from "./static/arrays";
import { doubtNote } from "./static/doubt";
import { makePlan, withoutTime, type Plan, type Query } from "./static/plan";
import { accumulate, Sums } from "./static/sums";
import { parseAxes, parsePulse, parseSelection, parseStokes } from "./static/words";

/** Time between two incomplete images, in milliseconds. */
const IMAGE_MS = 100;

/** Answers a probe of a slice. */
export async function runProbe(request: ProbeRequest, slice: Slice, arrays: ArrayOpener, signal?: AbortSignal): Promise<Labelled> {
  const query = parseQuery(request);
  const plan = makePlan(query, slice, slice.axes);
  const sums = await sumsOf(plan, slice, arrays, ["mean", "std_error"], signal);
  const { inside: mean, outside } = finish(plan, sums.mean);
  if (mean.every((value) => !Number.isFinite(value))) {
    throw new SourceError("all values of the result are NaN, because the selected region is not rendered or the selection is empty; " +
      "change the selection, or finish the render");
  }
  const stdError = finish(plan, sums.variance.map(Math.sqrt)).inside;
  return { axes: plan.kept, mean, stdError, notes: await notesOf(query, plan, slice, arrays, mean, outside, signal) };
}

/** Answers an image of a slice: yields incomplete images about every 100 ms, and the complete image last. */
export async function* runImage(
  request: ImageRequest, slice: Slice, arrays: ArrayOpener, signal?: AbortSignal,
): AsyncGenerator<ImageResult> {
  const query = imageQuery(request, slice);
  const { region, bin } = query.image;
  const plan = makePlan(query, slice, slice.axes);
  const sums = new Sums(slotsOf(plan));
  const [mean, stdError] = await Promise.all(
    [arrays.open(slice.name, "mean"), request.errors ? arrays.open(slice.name, "std_error") : null]);
  const snapshot = (done: number, notes: string[]): ImageResult => ({
    axes: plan.kept,
    mean: finish(plan, sums.mean.map((sum, i) => (sums.count[i] > 0 ? sum / sums.count[i] : NaN))).inside,
    stdError: !stdError ? null
      : finish(plan, sums.variance.map((sum, i) => (sums.count[i] > 0 ? Math.sqrt(sum) / sums.count[i] : NaN))).inside,
    notes, region, bin, done,
  });
  let since = performance.now();
  for await (const done of accumulate(plan, { mean, stdError }, sums, true, signal)) {
    if (done < 1 && performance.now() - since > IMAGE_MS) {
      yield snapshot(done, plan.notes);
      since = performance.now();
    }
  }
  const outside = finish(plan, sums.mean).outside;
  const image = snapshot(1, []);
  yield { ...image, notes: await notesOf(query, plan, slice, arrays, image.mean, outside, signal) };
}

function parseQuery(request: ProbeRequest): Query {
  return {
    select: request.select.map(parseSelection),
    sum: parseAxes(request.sum),
    pattern: request.pattern,
    pulse: request.pulse === undefined ? undefined : parsePulse(request.pulse),
    input: request.stokes === undefined ? undefined : parseStokes(request.stokes),
  };
}

/** Returns the query of an image, with the smallest bin (a power of two) whose result has at most `limit` values. */
function imageQuery(request: ImageRequest, slice: Slice): Query & { image: NonNullable<Query["image"]> } {
  const [height, width] = [lengthOf(slice, "y"), lengthOf(slice, "x")];
  const [y0, y1, x0, x1] = request.region ?? [0, height, 0, width];
  if (![y0, y1, x0, x1].every(Number.isInteger) || !(y0 >= 0 && y0 < y1 && y1 <= height && x0 >= 0 && x0 < x1 && x1 <= width)) {
    const whole = `the ${height} × ${width} entries of slice \`${slice.name}\``;
    throw new SourceError(`region ${y0},${y1},${x0},${x1}: expected a part of ${whole}`);
  }
  if (request.input && request.stokes !== undefined) throw new SourceError("use either the weights `input` or the state `stokes`");
  const query: Query = parseQuery(request);
  const keeps = (axis: Axis): boolean =>
    ["y", "x", "stokes_out", "stokes_in", "wavelength"].includes(axis.kind) || (axis.kind === "t" && request.time);
  query.sum = [...query.sum, ...slice.axes.filter((axis) => !keeps(axis)).map((axis) => axis.kind)];
  query.input ??= request.input;
  query.output = request.output;
  const region: [number, number, number, number] = [y0, y1, x0, x1];
  const inner = makePlan({ ...query, image: { region, bin: 1 } }, slice, slice.axes).kept
    .filter((axis) => axis.kind !== "y" && axis.kind !== "x").reduce((n, axis) => n * axis.coords.length, 1);
  let bin = 1;
  while (Math.ceil((y1 - y0) / bin) * Math.ceil((x1 - x0) / bin) * inner > request.limit) {
    if (bin >= Math.max(y1 - y0, x1 - x0)) {
      throw new SourceError(`an image of one pixel has ${inner} values, more than the limit of ${request.limit}`);
    }
    bin *= 2;
  }
  return { ...query, image: { region, bin } };
}

const slotsOf = (plan: Plan): number => plan.axes.reduce((n, axis) => n * axis.slots, 1);

async function sumsOf(
  plan: Plan, slice: Slice, arrays: ArrayOpener, fields: [Field, Field | null], signal?: AbortSignal,
): Promise<Sums> {
  const [mean, stdError] = await Promise.all(fields.map((field) => (field ? arrays.open(slice.name, field) : null)));
  const sums = new Sums(slotsOf(plan));
  for await (const _ of accumulate(plan, { mean: mean!, stdError }, sums, false, signal)) { /* only the complete sums count */ }
  return sums;
}

/** Separates the sums in the stored time bins from those that the pulse shifted out of them. */
function finish(plan: Plan, sums: Float64Array): { inside: Float32Array; outside: Float32Array | null } {
  if (!plan.convolved) return { inside: new Float32Array(sums), outside: null };
  const t = plan.axes.findIndex((axis) => axis.kind === "t");
  const { slots } = plan.axes[t];
  const inner = plan.axes.slice(t + 1).reduce((n, axis) => n * axis.slots, 1);
  const lanes = sums.length / (slots * inner);
  const inside = new Float32Array(lanes * (slots - 1) * inner);
  const outside = new Float32Array(lanes * inner);
  for (let lane = 0; lane < lanes; lane++) {
    const at = lane * slots * inner;
    const leave = at + (slots - 1) * inner;
    inside.set(sums.subarray(at, leave), lane * (slots - 1) * inner);
    outside.set(sums.subarray(leave, leave + inner), lane * inner);
  }
  return { inside, outside };
}

/** Returns the notes that the command prints: what the result leaves out. */
async function notesOf(
  query: Query, plan: Plan, slice: Slice, arrays: ArrayOpener, mean: Float32Array, shiftedOut: Float32Array | null,
  signal?: AbortSignal,
): Promise<string[]> {
  const notes = [...plan.notes];
  if (await arrays.has(slice.name, "total_std_error")) {
    const note = await doubtNote(plan, slice, await arrays.open(slice.name, "total_std_error"), signal);
    if (note) notes.push(note);
  }
  const missing = (values: Float32Array, how: string): void => {
    const sum = values.reduce((total, value) => total + value, 0);
    if (sum !== 0) {
      const number = sum.toExponential(6).replace("e+", "e");
      notes.push(`the result does not include the light that ${how}; the sum of this light is ${number}`);
    }
  };
  if (await arrays.has(slice.name, "overflow")) {
    const overflow = makePlan(withoutTime(query), slice, slice.axes.filter((axis) => axis.kind !== "t"));
    const sums = await sumsOf(overflow, slice, arrays, ["overflow", null], signal);
    const sum = new Float32Array(sums.mean);
    missing(sum, "arrived outside the stored time bins");
  }
  if (shiftedOut) missing(shiftedOut, "was shifted out of the stored time bins by the pulse");
  const unknown = mean.reduce((count, value) => count + (Number.isFinite(value) ? 0 : 1), 0);
  if (unknown > 0) notes.push(`${unknown} of ${mean.length} values are unknown (NaN)`);
  return notes;
}
