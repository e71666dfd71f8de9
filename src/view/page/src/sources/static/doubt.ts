/**
 * Counts camera pixels with unreliable error estimates. A pixel is unreliable if its error is less than half of the root mean square
 * of the errors around it: its neighbours then found bright samples that the pixel missed.
 */

import { axisOf, type Slice } from "../../model";
import type { ChunkReader } from "./arrays";
import type { Plan } from "./plan";

const LEAST = 0.5;

/** Returns a note if pixels that the plan reads have unreliable errors. `reader` reads the standard errors of totals. */
export async function doubtNote(plan: Plan, slice: Slice, reader: ChunkReader, signal?: AbortSignal): Promise<string | null> {
  const [y, x] = [axisOf(slice, "y"), axisOf(slice, "x")];
  const [rows, columns] = plan.axes;
  if (!y || !x || rows?.kind !== "y" || columns?.kind !== "x") return null;
  const single = slice.attributes.pixels_per_element === 1;
  const [top, bottom] = [Math.max(0, rows.first - 1), Math.min(y.coords.length, rows.end + 1)];
  const [left, right] = [Math.max(0, columns.first - 1), Math.min(x.coords.length, columns.end + 1)];
  const width = right - left;
  const errors = await readBox(reader, top, bottom, left, right, signal);
  // Pixels whose coordinates differ by more than 1 are no neighbours, unless the slice has bins of pixels.
  const beside = (coords: number[], a: number): boolean => !single || coords[a + 1] - coords[a] <= 1;
  let [lit, doubtful] = [0, 0];
  for (let row = rows.first; row < rows.end; row++) {
    const first = row > top && beside(y.coords, row - 1) ? row - 1 : row;
    const last = row + 1 < bottom && beside(y.coords, row) ? row + 1 : row;
    for (let column = columns.first; column < columns.end; column++) {
      const own = errors[(row - top) * width + column - left];
      if (own === 0) continue;
      lit += 1;
      const from = column > left && beside(x.coords, column - 1) ? column - 1 : column;
      const to = column + 1 < right && beside(x.coords, column) ? column + 1 : column;
      let [squares, count] = [0, 0];
      for (let i = first; i <= last; i++) {
        for (let j = from; j <= to; j++) {
          const error = errors[(i - top) * width + j - left];
          if (error > 0) {
            squares += error ** 2;
            count += 1;
          }
        }
      }
      if (Number.isNaN(own) || own * own * count < LEAST * LEAST * squares) doubtful += 1;
    }
  }
  if (doubtful === 0) return null;
  return `unreliable error estimates (too few samples) in ${doubtful} of ${lit} lit pixels of \`${slice.name}\`: neighbouring pixels ` +
    "found light that these pixels missed";
}

/** Reads a box of a two-dimensional array. */
async function readBox(
  reader: ChunkReader, top: number, bottom: number, left: number, right: number, signal?: AbortSignal,
): Promise<Float64Array> {
  const [height, width] = reader.chunk;
  const box = new Float64Array((bottom - top) * (right - left));
  const indices: [number, number][] = [];
  for (let i = Math.floor(top / height); i * height < bottom; i++) {
    for (let j = Math.floor(left / width); j * width < right; j++) indices.push([i, j]);
  }
  await Promise.all(indices.map(async ([i, j]) => {
    const values = await reader.read([i, j], signal);
    for (let row = Math.max(top, i * height); row < Math.min(bottom, (i + 1) * height); row++) {
      for (let column = Math.max(left, j * width); column < Math.min(right, (j + 1) * width); column++) {
        box[(row - top) * (right - left) + column - left] = values[(row - i * height) * width + column - j * width];
      }
    }
  }));
  return box;
}
