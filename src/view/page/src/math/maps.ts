/** Maps of quantities over the pixels of a Mueller image. All maps are row-major, height x width. Undefined values are NaN. */

import { type ImageResult, lengthOf } from "../model";
import type { Quantity, Stokes, ViewState } from "../state";
import { decompose, newParts } from "./decompose";
import { depolarization, diattenuation, orientation, polarizance, retardance, writeAxis } from "./properties";
import { angleOfLinearPolarization, degreeOfLinearPolarization, ellipticityAngle } from "./stokes";

export interface QuantityMap {
  values: Float32Array;
  height: number;
  width: number;
  label: string;
  unit: string;
  /** `positive`: 0 and above. `diverging`: around 0. `cyclic`: an angle. `unit`: 0..1. */
  kind: "positive" | "diverging" | "cyclic" | "unit";
  /** Range of values that the quantity can have, or null if it has no bound. */
  range: [number, number] | null;
}

/** Where the numbers of a pixel are. A pixel's numbers are adjacent, because y and x are the first axes. */
interface Layout {
  height: number;
  width: number;
  pixels: number;
  /** Numbers per pixel. */
  inner: number;
  wavelengths: number;
  /** Whether all 16 elements are present. Without, the only element is M00. */
  polarized: boolean;
  strideOut: number;
  strideIn: number;
}

function layoutOf(image: ImageResult): Layout {
  const [height, width] = [lengthOf(image, "y"), lengthOf(image, "x")];
  const wavelengths = lengthOf(image, "wavelength");
  const strideIn = wavelengths;
  const strideOut = strideIn * lengthOf(image, "stokes_in");
  const polarized = lengthOf(image, "stokes_out") >= 4 && lengthOf(image, "stokes_in") >= 4;
  const pixels = height * width;
  return { height, width, pixels, inner: image.mean.length / pixels, wavelengths, polarized, strideOut, strideIn };
}

/** A linear combination of a pixel's numbers: offsets within the pixel, and weights. */
interface Combination {
  offsets: Int32Array;
  weights: Float64Array;
}

/** Returns the combination Σ c_ij M_ij, at one wavelength or as the mean over wavelengths. Weights of 0 are left out. */
function combination(layout: Layout, wavelength: number | "all", c: (i: number, j: number) => number): Combination {
  const offsets: number[] = [];
  const weights: number[] = [];
  const [first, last] = wavelength === "all" ? [0, layout.wavelengths] : [wavelength, wavelength + 1];
  const size = layout.polarized ? 4 : 1;
  for (let i = 0; i < size; i++) {
    for (let j = 0; j < size; j++) {
      if (c(i, j) === 0) continue;
      for (let w = first; w < last; w++) {
        offsets.push(i * layout.strideOut + j * layout.strideIn + w);
        weights.push(c(i, j) / (last - first));
      }
    }
  }
  return { offsets: Int32Array.from(offsets), weights: Float64Array.from(weights) };
}

/** Writes a combination of every pixel to out[at], out[at + step], ... */
function combine(values: Float32Array, layout: Layout, { offsets, weights }: Combination, out: Float32Array, at = 0, step = 1): void {
  const { pixels, inner } = layout;
  const terms = offsets.length;
  if (terms === 1) {
    const [offset, weight] = [offsets[0], weights[0]];
    for (let p = 0, from = offset, to = at; p < pixels; p++, from += inner, to += step) out[to] = weight * values[from];
    return;
  }
  for (let p = 0, base = 0, to = at; p < pixels; p++, base += inner, to += step) {
    let sum = 0;
    for (let k = 0; k < terms; k++) sum += weights[k] * values[base + offsets[k]];
    out[to] = sum;
  }
}

/** Limits the index of a wavelength to the axis, so a state of another slice is harmless. */
const lane = (layout: Layout, wavelength: number | "all"): number | "all" =>
  wavelength === "all" ? "all" : Math.max(0, Math.min(layout.wavelengths - 1, wavelength));

/**
 * Returns the intensity of each pixel for the Stokes vector `input`: [M s]_0, or ½ aᵀ M s with an analyzer that transmits a. Without
 * polarization only M00 is known, and the result is M00 s0.
 */
export function contract(
  image: ImageResult, input: Stokes, analyzer: Stokes | null, wavelength: number | "all",
): Float32Array {
  const layout = layoutOf(image);
  const out = new Float32Array(layout.pixels);
  const weight = (i: number, j: number) =>
    !layout.polarized || !analyzer ? (i === 0 ? input[j] : 0) : 0.5 * analyzer[i] * input[j];
  combine(image.mean, layout, combination(layout, lane(layout, wavelength), weight), out);
  return out;
}

/** Returns the Stokes vector M s of each pixel, 4 numbers a pixel. Without polarization, s1 to s3 are NaN. */
export function stokesImage(image: ImageResult, input: Stokes, wavelength: number | "all"): Float32Array {
  const layout = layoutOf(image);
  const out = new Float32Array(4 * layout.pixels);
  const { pixels, inner, strideOut } = layout;
  const { offsets, weights } = combination(layout, lane(layout, wavelength), (i, j) => (i === 0 ? input[j] : 0));
  if (!layout.polarized) {
    combine(image.mean, layout, { offsets, weights }, out.fill(NaN), 0, 4);
    return out;
  }
  // All four rows in one pass: the time is that of reading the image from memory.
  const values = image.mean;
  for (let p = 0, base = 0; p < pixels; p++, base += inner) {
    let [s0, s1, s2, s3] = [0, 0, 0, 0];
    for (let k = 0; k < offsets.length; k++) {
      const at = base + offsets[k];
      const weight = weights[k];
      s0 += weight * values[at];
      s1 += weight * values[at + strideOut];
      s2 += weight * values[at + 2 * strideOut];
      s3 += weight * values[at + 3 * strideOut];
    }
    out[4 * p] = s0;
    out[4 * p + 1] = s1;
    out[4 * p + 2] = s2;
    out[4 * p + 3] = s3;
  }
  return out;
}

/** Returns the element M_ij of each pixel, not divided by M00. NaN if the image does not have the element. */
function element(values: Float32Array, layout: Layout, row: number, column: number, wavelength: number | "all"): Float32Array {
  const out = new Float32Array(layout.pixels);
  if (!layout.polarized && row + column > 0) return out.fill(NaN);
  combine(values, layout, combination(layout, wavelength, (i, j) => (i === row && j === column ? 1 : 0)), out);
  return out;
}

/**
 * Returns the standard error of M_ij of each pixel. Values of a pixel may be correlated in any way, so the error of a mean over wavelengths is
 * the mean of the errors, as in `sunstone probe`.
 */
function elementError(image: ImageResult, layout: Layout, row: number, column: number, wavelength: number | "all"): Float32Array {
  const out = new Float32Array(layout.pixels);
  const errors = image.stdError;
  if (!errors || (!layout.polarized && row + column > 0)) return out.fill(NaN);
  const { offsets, weights } = combination(layout, wavelength, (i, j) => (i === row && j === column ? 1 : 0));
  for (let p = 0, base = 0; p < layout.pixels; p++, base += layout.inner) {
    let sum = 0;
    for (let k = 0; k < offsets.length; k++) sum += Math.abs(weights[k]) * errors[base + offsets[k]];
    out[p] = sum;
  }
  return out;
}

/** Divides by M00. NaN where M00 is not positive. */
function divide(values: Float32Array, m00: Float32Array): void {
  for (let p = 0; p < values.length; p++) values[p] = m00[p] > 0 ? values[p] / m00[p] : NaN;
}

const DECOMPOSED: Partial<Record<Quantity, Pick<QuantityMap, "label" | "unit" | "kind" | "range">>> = {
  diattenuation: { label: "Diattenuation", unit: "1", kind: "unit", range: [0, 1] },
  polarizance: { label: "Polarizance", unit: "1", kind: "unit", range: [0, 1] },
  retardance: { label: "Retardance", unit: "°", kind: "positive", range: [0, 180] },
  fast_axis: { label: "Fast axis", unit: "°", kind: "cyclic", range: [0, 180] },
  depolarization: { label: "Depolarization", unit: "1", kind: "unit", range: [0, 1] },
};

/** Returns the values of a property of the Lu-Chipman decomposition. */
function decomposed(image: ImageResult, layout: Layout, wavelength: number | "all", quantity: Quantity): Float32Array {
  const out = new Float32Array(layout.pixels).fill(NaN);
  if (!layout.polarized) return out;
  const { pixels, inner, strideOut, strideIn } = layout;
  const values = image.mean;
  const [first, last] = wavelength === "all" ? [0, layout.wavelengths] : [wavelength, wavelength + 1];
  // Buffers that all pixels share.
  const m = new Float64Array(16);
  const parts = newParts();
  const axis: [number, number, number] = [0, 0, 0];
  for (let p = 0, base = 0; p < pixels; p++, base += inner) {
    for (let e = 0; e < 16; e++) {
      const from = base + (e >> 2) * strideOut + (e & 3) * strideIn;
      let sum = 0;
      for (let w = first; w < last; w++) sum += values[from + w];
      m[e] = sum / (last - first);
    }
    if (!decompose(m, parts)) continue;
    if (quantity === "diattenuation") out[p] = diattenuation(m);
    else if (quantity === "polarizance") out[p] = polarizance(m);
    else if (quantity === "retardance") out[p] = retardance(parts);
    else if (quantity === "depolarization") out[p] = depolarization(parts);
    else {
      writeAxis(parts, axis);
      out[p] = orientation(axis);
    }
  }
  return out;
}

/** Returns a property of the outgoing Stokes vectors. */
function ofStokes(
  image: ImageResult, view: ViewState, wavelength: number | "all", f: (s: Float32Array, at: number) => number,
): Float32Array {
  const s = stokesImage(image, view.input, wavelength);
  const out = new Float32Array(s.length / 4);
  for (let p = 0; p < out.length; p++) out[p] = f(s, 4 * p);
  return out;
}

/**
 * Returns the map of the quantity that the view shows; `colour` and `grid` are shown by other means and give the intensity. For the
 * wavelength `all`, the mean of the matrices over wavelengths is used. Values of elements have the unit `valueUnits`.
 */
export function quantityMap(image: ImageResult, view: ViewState, valueUnits = "W/(m² sr nm)"): QuantityMap {
  const layout = layoutOf(image);
  const { height, width } = layout;
  const wavelength = lane(layout, view.wavelength);
  const { row, column, normalized, quantity } = view;
  const name = `M${row}${column}`;
  const ratio = normalized && row + column > 0;
  const map = (values: Float32Array, label: string, unit: string, kind: QuantityMap["kind"], range: [number, number] | null): QuantityMap =>
    ({ values, height, width, label, unit, kind, range });

  switch (quantity) {
    case "element": {
      const values = element(image.mean, layout, row, column, wavelength);
      if (ratio) divide(values, element(image.mean, layout, 0, 0, wavelength));
      if (ratio) return map(values, `${name} / M00`, "1", "diverging", [-1, 1]);
      return map(values, name, valueUnits, row + column > 0 ? "diverging" : "positive", null);
    }
    case "std_error": {
      const values = elementError(image, layout, row, column, wavelength);
      if (ratio) divide(values, element(image.mean, layout, 0, 0, wavelength));
      return map(values, `Standard error of ${name}${ratio ? " / M00" : ""}`, ratio ? "1" : valueUnits, "positive", null);
    }
    case "snr": {
      const values = element(image.mean, layout, row, column, wavelength);
      const errors = elementError(image, layout, row, column, wavelength);
      for (let p = 0; p < values.length; p++) values[p] = errors[p] > 0 ? Math.abs(values[p]) / errors[p] : NaN;
      return map(values, `Signal-to-noise ratio of ${name}`, "1", "positive", null);
    }
    case "dolp": {
      const dolp = (s: Float32Array, k: number) => degreeOfLinearPolarization(s[k], s[k + 1], s[k + 2]);
      return map(ofStokes(image, view, wavelength, dolp), "DoLP", "1", "unit", [0, 1]);
    }
    case "aolp": {
      const aolp = (s: Float32Array, k: number) => (s[k] > 0 ? angleOfLinearPolarization(s[k + 1], s[k + 2]) : NaN);
      return map(ofStokes(image, view, wavelength, aolp), "AoLP", "°", "cyclic", [0, 180]);
    }
    case "ellipticity": {
      const angle = (s: Float32Array, k: number) => (s[k] > 0 ? ellipticityAngle(s[k + 1], s[k + 2], s[k + 3]) : NaN);
      return map(ofStokes(image, view, wavelength, angle), "Ellipticity angle", "°", "diverging", [-45, 45]);
    }
    case "diattenuation":
    case "polarizance":
    case "retardance":
    case "fast_axis":
    case "depolarization": {
      const about = DECOMPOSED[quantity]!;
      return map(decomposed(image, layout, wavelength, quantity), about.label, about.unit, about.kind, about.range);
    }
    default: {
      const values = contract(image, view.input, view.analyzer, wavelength);
      return map(values, layout.polarized ? "Intensity" : "M00", valueUnits, "positive", null);
    }
  }
}
