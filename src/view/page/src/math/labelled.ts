/** Access to arrays with named axes, and statistics of them. */

import { type AxisKind, type Labelled, axisOf, lengthOf } from "../model";

/** Returns a function from an index along each axis to the position in `mean`. Axes that are left out have index 0. */
export function positions(over: Labelled): (index: Partial<Record<AxisKind, number>>) => number {
  const strides: { kind: AxisKind; stride: number }[] = [];
  let stride = 1;
  for (const axis of [...over.axes].reverse()) {
    strides.push({ kind: axis.kind, stride });
    stride *= axis.coords.length;
  }
  return (index) => strides.reduce((at, axis) => at + axis.stride * (index[axis.kind] ?? 0), 0);
}

/** Returns the 16 elements at a wavelength, or null if the values are not polarized. `values` is `mean` or `stdError`. */
export function matrixOf(over: Labelled, values: Float32Array, index: Partial<Record<AxisKind, number>>): number[] | null {
  if (lengthOf(over, "stokes_out") < 4 || lengthOf(over, "stokes_in") < 4) return null;
  const at = positions(over);
  return Array.from({ length: 16 }, (_, e) => values[at({ ...index, stokes_out: e >> 2, stokes_in: e & 3 })]);
}

/** Returns the map of two axes at a wavelength, or the mean over wavelengths, with rows along the first axis. */
export function planeOf(over: Labelled, rows: AxisKind, columns: AxisKind, wavelength: number | "all"): Float32Array {
  const at = positions(over);
  const [height, width, lanes] = [lengthOf(over, rows), lengthOf(over, columns), lengthOf(over, "wavelength")];
  const [first, last] = wavelength === "all" ? [0, lanes] : [Math.min(wavelength, lanes - 1), Math.min(wavelength, lanes - 1) + 1];
  const [down, right, deep] = [at({ [rows]: 1 }), at({ [columns]: 1 }), axisOf(over, "wavelength") ? at({ wavelength: 1 }) : 0];
  const out = new Float32Array(height * width);
  for (let y = 0, to = 0; y < height; y++) {
    for (let x = 0; x < width; x++, to++) {
      let sum = 0;
      for (let w = first; w < last; w++) sum += over.mean[y * down + x * right + w * deep];
      out[to] = sum / (last - first);
    }
  }
  return out;
}

/**
 * Returns the mean over pixels of the standard error of M00 (summed over wavelengths), divided by the mean of M00. Pixels that are not
 * rendered yet are left out. Null without errors or without light.
 */
export function relativeError(over: Labelled): number | null {
  if (!over.stdError) return null;
  const lanes = lengthOf(over, "wavelength");
  const inner = lanes * lengthOf(over, "stokes_out") * lengthOf(over, "stokes_in");
  let [light, errors] = [0, 0];
  for (let base = 0; base < over.mean.length; base += inner) {
    let [sum, error] = [0, 0];
    for (let w = 0; w < lanes; w++) {
      sum += over.mean[base + w];
      error += over.stdError[base + w];
    }
    if (!Number.isFinite(sum + error)) continue;
    light += sum;
    errors += error;
  }
  return light > 0 ? errors / light : null;
}
