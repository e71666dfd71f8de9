/**
 * Executes a plan: reads chunks and computes weighted sums in f64.
 *
 * Elements of one camera pixel may be correlated in any way, so the standard error of a sum over them has the bound Σ|w|·se. Camera
 * pixels are independent, so errors add in quadrature over y and x.
 */

import type { ChunkReader } from "./arrays";
import type { Plan, Share } from "./plan";

/** Half-open range of entries of one axis. */
type Range = [first: number, end: number];

/** Number of boxes whose chunks are read in advance. */
const AHEAD = 4;
/** Time of computation after which other events of the page are handled, in milliseconds. */
const BUSY_MS = 20;

/** Sums over all slots of a plan, row-major. */
export class Sums {
  readonly mean: Float64Array;
  readonly variance: Float64Array;
  /** Camera pixels in each sum. */
  readonly count: Float64Array;

  constructor(length: number) {
    this.mean = new Float64Array(length);
    this.variance = new Float64Array(length);
    this.count = new Float64Array(length);
  }
}

/** Arrays that one plan reads: values, and standard errors if they are requested. */
export interface Fields {
  mean: ChunkReader;
  stdError: ChunkReader | null;
}

/**
 * Adds all entries of a plan to `sums`. Yields the fraction of camera pixels that has been added, after each block of camera pixels.
 * With `skipUnknown`, unknown values (NaN) are left out; otherwise their sum is NaN.
 */
export async function* accumulate(
  plan: Plan, fields: Fields, sums: Sums, skipUnknown: boolean, signal?: AbortSignal,
): AsyncGenerator<number> {
  const { chunk } = fields.mean;
  const camera = plan.axes.filter((axis) => axis.kind === "y" || axis.kind === "x").length;
  const segments = plan.axes.map((axis, i) => split([axis.first, axis.end], chunk[i]));
  const blocks = boxes(segments.slice(0, camera));
  const inner = boxes(segments.slice(camera));
  const rest = plan.axes.slice(camera).reduce((n, axis) => n * axis.slots, 1);
  const jobs = blocks.flatMap((block) => inner.map((part) => [...block, ...part]));
  const reads = readAhead(jobs, (box) => {
    const index = box.map(([first], i) => Math.floor(first / chunk[i]));
    return Promise.all([fields.mean.read(index, signal), fields.stdError?.read(index, signal) ?? null]);
  });
  let partial = new Partial(0, rest);
  let done = 0;
  let since = performance.now();
  for await (const [box, [values, errors]] of reads) {
    signal?.throwIfAborted();
    const block = box.slice(0, camera);
    if (done % inner.length === 0) partial = new Partial(block.reduce((n, [first, end]) => n * (end - first), 1), rest);
    walk(plan, chunk, box, camera, rest, values, errors, partial);
    done += 1;
    if (done % inner.length === 0) {
      fold(plan, block, rest, partial, sums, skipUnknown);
      yield done / jobs.length;
    }
    if (performance.now() - since > BUSY_MS) {
      await new Promise((resolve) => setTimeout(resolve));
      since = performance.now();
    }
  }
}

/** Splits a range at chunk boundaries. */
function split([first, end]: Range, chunk: number): Range[] {
  const pieces: Range[] = [];
  for (let at = first; at < end;) {
    const next = Math.min((Math.floor(at / chunk) + 1) * chunk, end);
    pieces.push([at, next]);
    at = next;
  }
  return pieces;
}

/** Returns all boxes that consist of one range per axis. The last axis varies fastest. */
const boxes = (segments: Range[][]): Range[][] =>
  segments.reduce<Range[][]>((all, pieces) => all.flatMap((box) => pieces.map((piece) => [...box, piece])), [[]]);

/** Starts some reads before their turn, and yields every item with its result, in order. */
async function* readAhead<T, R>(items: T[], read: (item: T) => Promise<R>): AsyncGenerator<[T, R]> {
  const started: Promise<R>[] = [];
  for (let i = 0; i < items.length; i++) {
    while (started.length < Math.min(i + 1 + AHEAD, items.length)) {
      const next = read(items[started.length]);
      // The loop reports the failure of a read when its turn comes, if it comes.
      next.catch(() => undefined);
      started.push(next);
    }
    yield [items[i], await started[i]];
    started[i] = Promise.resolve() as never;
  }
}

/** Sums of the camera pixels of one block. */
class Partial {
  readonly mean: Float64Array;
  readonly bound: Float64Array;

  constructor(pixels: number, rest: number) {
    this.mean = new Float64Array(pixels * rest);
    this.bound = new Float64Array(pixels * rest);
  }
}

/** Adds the values of one box, which lies in one chunk, to the sums of its camera pixels. */
function walk(
  plan: Plan, chunk: number[], box: Range[], camera: number, rest: number,
  values: Float32Array, errors: Float32Array | null, into: Partial,
): void {
  const strides = new Array<number>(box.length);
  for (let i = box.length - 1, stride = 1; i >= 0; i--) {
    strides[i] = stride;
    stride *= chunk[i];
  }
  const start = box.reduce((offset, [first], i) => offset + (first % chunk[i]) * strides[i], 0);
  const targets = boxTargets(plan, box, camera, rest);
  const { tail, run } = trailingRun(plan, chunk, box, camera);
  const v = plan.joint ? plan.axes.findIndex((axis) => axis.kind === "v") : -1;
  const { mean, bound } = into;

  const go = (axis: number, source: number, to: number, weight: number): void => {
    if (axis === tail) {
      const size = Math.abs(weight);
      for (let k = 0; k < run; k++) mean[to + k] += weight * values[source + k];
      if (errors) for (let k = 0; k < run; k++) bound[to + k] += size * errors[source + k];
    } else if (axis === v) {
      const columns = plan.axes[v + 1].end;
      for (let i = box[v][0]; i < box[v][1]; i++) {
        for (let j = box[v + 1][0]; j < box[v + 1][1]; j++) {
          const w = plan.joint![i * columns + j];
          if (w === 0) continue;
          go(axis + 2, source + (i - box[v][0]) * strides[v] + (j - box[v + 1][0]) * strides[v + 1], to, weight * w);
        }
      }
    } else {
      const rows = targets[axis];
      for (let i = 0; i < rows.length; i++) {
        for (const [offset, w] of rows[i]) if (w !== 0) go(axis + 1, source + i * strides[axis], to + offset, weight * w);
      }
    }
  };
  go(0, start, 0, 1);
}

/** Returns the targets, as offsets into the sums of the block, of every entry of a box, for every axis. */
function boxTargets(plan: Plan, box: Range[], camera: number, rest: number): Share[][][] {
  const all = new Array<Share[][]>(box.length);
  for (let i = box.length - 1, stride = 1, pixels = 1; i >= 0; i--) {
    const [first, end] = box[i];
    const axis = plan.axes[i];
    if (i < camera) {
      const step = pixels * rest;
      all[i] = Array.from({ length: end - first }, (_, k): Share[] => [[k * step, 1]]);
      pixels *= end - first;
    } else {
      const step = stride;
      all[i] = axis.targets.slice(first - axis.first, end - axis.first)
        .map((row) => row.map(([slot, weight]): Share => [slot * step, weight]));
      stride *= axis.slots;
    }
  }
  return all;
}

/**
 * Returns the first axis of a run, and the number of values in the run. A run combines the trailing axes that the query keeps
 * unchanged and that fill the chunk.
 */
function trailingRun(plan: Plan, chunk: number[], box: Range[], camera: number): { tail: number; run: number } {
  let [tail, run] = [box.length, 1];
  while (tail > camera) {
    const axis = plan.axes[tail - 1];
    const [first, end] = box[tail - 1];
    const joint = plan.joint !== null && (axis.kind === "v" || axis.kind === "u");
    const whole = first === axis.first && end === axis.end && axis.slots === axis.targets.length && end - first === chunk[tail - 1];
    if (joint || !whole || !axis.targets.every((row, i) => row.length === 1 && row[0][0] === i && row[0][1] === 1)) break;
    run *= axis.slots;
    tail -= 1;
  }
  return { tail, run };
}

/** Adds the sums of a block of camera pixels to the result. */
function fold(plan: Plan, block: Range[], rest: number, partial: Partial, sums: Sums, skipUnknown: boolean): void {
  let pixel = 0;
  const go = (axis: number, slot: number): void => {
    if (axis < block.length) {
      const { first, slots, targets } = plan.axes[axis];
      for (let i = block[axis][0]; i < block[axis][1]; i++) go(axis + 1, slot * slots + targets[i - first][0][0]);
      return;
    }
    const [from, to] = [pixel * rest, slot * rest];
    for (let k = 0; k < rest; k++) {
      if (skipUnknown && Number.isNaN(partial.mean[from + k])) continue;
      sums.mean[to + k] += partial.mean[from + k];
      sums.variance[to + k] += partial.bound[from + k] ** 2;
      sums.count[to + k] += 1;
    }
    pixel += 1;
  };
  go(0, 0);
}
