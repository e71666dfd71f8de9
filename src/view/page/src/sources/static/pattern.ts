/** Contracts a pattern with the projector axes: the mean drive of the projector pixels of every entry (v, u). */

import { axisOf, type Slice } from "../../model";
import { SourceError, type Pattern } from "../source";

/** First and last pixel of an entry. */
type Span = [number, number];

/** Returns the weights of all entries (v, u), row-major. Returns null if the pattern needs no contraction. */
export function patternWeights(pattern: Pattern, slice: Slice, notes: string[]): Float64Array | null {
  const { width, height, values } = pattern;
  const fault = (reason: string): SourceError =>
    new SourceError(`pattern of ${width} × ${height} pixels for slice \`${slice.name}\`: ${reason}`);
  if (values.length !== width * height) {
    throw fault(`the pattern has ${values.length} values; expected width × height values`);
  }
  const [v, u] = [axisOf(slice, "v"), axisOf(slice, "u")];
  if (!v || !u) {
    if (values.every((drive) => drive === 1)) return null;
    throw fault('the projector pixels of the slice are already summed: render the slice with `projector = "all"`');
  }
  const size = pair(slice.attributes.projector_size);
  if (size && (size[0] !== width || size[1] !== height)) {
    throw fault(`the projector has ${size[0]} × ${size[1]} pixels: use a pattern of this size`);
  }
  const bin = pair(slice.attributes.projector_bin);
  const spans = (coords: number[], pixels: number | undefined, total: number): Span[] => {
    const found = spansOf(coords, pixels, total);
    if (typeof found === "string") throw fault(found);
    return found;
  };
  const rows = spans(v.coords, bin?.[1], height);
  const columns = spans(u.coords, bin?.[0], width);
  const kept = new Uint8Array(values.length);
  const weights = new Float64Array(rows.length * columns.length);
  rows.forEach((row, i) => columns.forEach((column, j) => {
    let sum = 0;
    for (let y = row[0]; y <= row[1]; y++) {
      for (let x = column[0]; x <= column[1]; x++) {
        sum += values[y * width + x];
        kept[y * width + x] = 1;
      }
    }
    weights[i * columns.length + j] = sum / ((row[1] - row[0] + 1) * (column[1] - column[0] + 1));
  }));
  const lost = values.reduce((count, drive, i) => count + (drive !== 0 && !kept[i] ? 1 : 0), 0);
  if (lost > 0) {
    notes.push(`the pattern uses ${lost} projector pixels that slice \`${slice.name}\` does not contain, ` +
      "so the light of these pixels is missing");
  }
  return weights;
}

const pair = (value: unknown): [number, number] | null =>
  Array.isArray(value) && Number.isInteger(value[0]) && Number.isInteger(value[1]) ? [value[0], value[1]] : null;

/** Returns the first and last pixel of each entry, or the fault. `coords` are the centres of the entries. */
function spansOf(coords: number[], bin: number | undefined, total: number): Span[] | string {
  const whole = coords.every(Number.isInteger);
  const consecutive = coords.every((c, i) => i === 0 || c - coords[i - 1] === 1);
  if (bin === undefined && whole && !consecutive) {
    return "the attribute `projector_bin` is missing, so it is unknown whether projector pixels are binned; render the slice again";
  }
  const single = bin === undefined ? whole : bin <= 1;
  const spans: Span[] = [];
  let next = 0;
  for (const centre of coords) {
    const first = single ? centre : next;
    const last = 2 * centre - first;
    if (!(first >= 0 && last >= first && Number.isInteger(first) && Number.isInteger(last))) {
      return `projector coordinate ${centre} is not the centre of a block of whole pixels; render the slice again`;
    }
    if (last >= total) return `the slice contains projector pixel ${last}: use a pattern of the projector's resolution`;
    spans.push([first, last]);
    next = last + 1;
  }
  if (!single && next < total) {
    return `the slice's bins end at projector pixel ${next}: use a pattern of the projector's resolution`;
  }
  return spans;
}
