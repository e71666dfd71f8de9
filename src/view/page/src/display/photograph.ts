/** Colour photographs of Mueller images: contraction with the input state and the analyzer, and the colours of wavelengths. */

import { type ImageResult, axisOf, lengthOf } from "../model";
import type { Stokes } from "../state";
import { rgbWeights, SRGB, SRGB_STEPS, white } from "./colour";
import { UNDEFINED_RGBA } from "./colourmaps";

/** Where the numbers of a pixel are: a pixel's numbers are adjacent, because y and x are the first axes. */
interface Layout {
  pixels: number;
  /** Numbers per pixel. */
  inner: number;
  wavelengths: number;
  isPolarized: boolean;
}

function layoutOf(image: ImageResult): Layout {
  const pixels = lengthOf(image, "y") * lengthOf(image, "x");
  const isPolarized = lengthOf(image, "stokes_out") === 4 && lengthOf(image, "stokes_in") === 4;
  return { pixels, inner: image.mean.length / pixels, wavelengths: lengthOf(image, "wavelength"), isPolarized };
}

/** A contraction: Σ weight · number at offset, for every wavelength of a pixel with `inner` numbers. */
interface Contraction {
  values: Float32Array;
  inner: number;
  offsets: Int32Array;
  weights: Float64Array;
}

/** Returns the nonzero weights of the elements of a pixel's matrix in its intensity, and the offsets of these elements. */
function terms(layout: Layout, input: Stokes, analyzer: Stokes | null): { offsets: Int32Array; weights: Float64Array } {
  const offsets: number[] = [];
  const weights: number[] = [];
  if (!layout.isPolarized) return { offsets: Int32Array.of(0), weights: Float64Array.of(input[0]) };
  for (let i = 0; i < 4; i++) {
    for (let j = 0; j < 4; j++) {
      const weight = analyzer ? 0.5 * analyzer[i] * input[j] : i === 0 ? input[j] : 0;
      if (weight === 0) continue;
      offsets.push((4 * i + j) * layout.wavelengths);
      weights.push(weight);
    }
  }
  return { offsets: Int32Array.from(offsets), weights: Float64Array.from(weights) };
}

/** Sums of a matrix image over one of its Stokes axes, which stay valid while the other state changes. */
interface Half {
  image: ImageResult;
  side: "input" | "analyzer";
  state: string;
  values: Float32Array;
}

/** The last contraction with an analyzer of every slot, to know which of the two states the user is changing. */
const last = new Map<string, { input: string; analyzer: string; half: Half | null }>();

/** Returns Σ_i a_i M_ij / 2 for an analyzer, or Σ_j M_ij s_j for an input state: 4 numbers per wavelength of a pixel. */
function halfOf(image: ImageResult, side: Half["side"], by: Stokes, into: Float32Array): Half {
  const { pixels, wavelengths } = layoutOf(image);
  const n = 4 * wavelengths;
  const values = image.mean;
  const [a, b, c, d] = side === "analyzer" ? by.map((v) => v / 2) : by;
  // Numbers of a pixel: 4 rows of 4 columns of wavelengths.
  const [step, next] = side === "analyzer" ? [n, wavelengths] : [wavelengths, n];
  for (let p = 0, base = 0, to = 0; p < pixels; p++, base += 4 * n) {
    for (let k = 0; k < 4; k++) {
      for (let at = base + k * next, end = at + wavelengths; at < end; at++, to++) {
        into[to] = a * values[at] + b * values[at + step] + c * values[at + 2 * step] + d * values[at + 3 * step];
      }
    }
  }
  return { image, side, state: by.join(), values: into };
}

/**
 * Returns the contraction of an image with an input state and an analyzer. While the user changes one of them, the sums over the
 * other are kept, which makes the contraction four times as fast.
 */
function contractionOf(image: ImageResult, layout: Layout, input: Stokes, analyzer: Stokes | null, slot: string): Contraction {
  const { inner, wavelengths, isPolarized, pixels } = layout;
  if (!isPolarized || !analyzer) return { values: image.mean, inner, ...terms(layout, input, analyzer) };
  const before = last.get(slot);
  const now = { input: input.join(), analyzer: analyzer.join(), half: before?.half ?? null };
  last.set(slot, now);
  if (before?.input !== now.input && before?.analyzer !== now.analyzer) {
    return { values: image.mean, inner, ...terms(layout, input, analyzer) };
  }
  const side = before.analyzer === now.analyzer ? "analyzer" : "input";
  const by = side === "input" ? input : analyzer;
  const isKept = now.half?.image === image && now.half.side === side && now.half.state === by.join();
  const half = isKept ? now.half! : halfOf(image, side, by, buffer(`${slot} half`, 4 * wavelengths * pixels));
  now.half = half;
  const offsets = Int32Array.from([0, 1, 2, 3], (k) => k * wavelengths);
  const weights = Float64Array.from(side === "input" ? analyzer.map((v) => v / 2) : input);
  return { values: half.values, inner: 4 * wavelengths, offsets, weights };
}

/** A linear image: red, green and blue of every pixel. The array can be longer than needed, because it is used again. */
export interface Linear {
  pixels: number;
  rgb: Float32Array;
}

const buffers = new Map<string, Float32Array>();

/** Returns an array of at least `length` values that belongs to `name`. The last content is overwritten. */
function buffer(name: string, length: number): Float32Array {
  let found = buffers.get(name);
  if (!found || found.length < length || found.length > 4 * length) {
    found = new Float32Array(length);
    buffers.set(name, found);
  }
  return found;
}

/**
 * Returns linear red, green and blue of every pixel for an input state and an analyzer, of all wavelengths or of one as grey. The
 * result is valid until the next call with the same `slot`.
 */
export function linearImage(
  image: ImageResult, input: Stokes, analyzer: Stokes | null, wavelength: number | "all", slot: string,
): Linear {
  const layout = layoutOf(image);
  const { pixels, wavelengths } = layout;
  const { values, inner, offsets, weights } = contractionOf(image, layout, input, analyzer, slot);
  const rgb = buffer(slot, 3 * pixels);
  const count = offsets.length;
  const nm = axisOf(image, "wavelength")?.coords ?? [0];

  if (wavelength !== "all" || nm.length === 1) {
    const lane = wavelength === "all" ? 0 : Math.min(wavelength, wavelengths - 1);
    for (let p = 0, base = lane, to = 0; p < pixels; p++, base += inner, to += 3) {
      let sum = 0;
      for (let k = 0; k < count; k++) sum += weights[k] * values[base + offsets[k]];
      rgb[to] = rgb[to + 1] = rgb[to + 2] = sum;
    }
    return { pixels, rgb };
  }

  const channels = rgbWeights(nm);
  if (wavelengths === 3) {
    // Every channel shows one wavelength, so the weights are a permutation.
    const [r, g, b] = channels.map((row) => row.indexOf(1));
    for (let p = 0, base = 0, to = 0; p < pixels; p++, base += inner, to += 3) {
      let [red, green, blue] = [0, 0, 0];
      for (let k = 0; k < count; k++) {
        const at = base + offsets[k];
        const weight = weights[k];
        red += weight * values[at + r];
        green += weight * values[at + g];
        blue += weight * values[at + b];
      }
      rgb[to] = red;
      rgb[to + 1] = green;
      rgb[to + 2] = blue;
    }
    return { pixels, rgb };
  }

  const lanes = new Float64Array(wavelengths);
  for (let p = 0, base = 0, to = 0; p < pixels; p++, base += inner, to += 3) {
    for (let w = 0; w < wavelengths; w++) {
      let sum = 0;
      for (let k = 0; k < count; k++) sum += weights[k] * values[base + offsets[k] + w];
      lanes[w] = sum;
    }
    for (let c = 0; c < 3; c++) {
      let sum = 0;
      for (let w = 0; w < wavelengths; w++) sum += channels[c][w] * lanes[w];
      rgb[to + c] = sum;
    }
  }
  return { pixels, rgb };
}

const whites = new WeakMap<ImageResult, Map<string, number>>();

/**
 * Returns the white level of the automatic exposure of an image: that of its photograph in unpolarized light without an analyzer.
 * The level therefore does not change with the input state, and crossed polarizers are dark.
 */
export function automaticWhite(image: ImageResult, wavelength: number | "all"): number {
  const known = whites.get(image) ?? new Map<string, number>();
  whites.set(image, known);
  const key = String(wavelength);
  const found = known.get(key);
  if (found !== undefined) return found;
  const { pixels, rgb } = linearImage(image, [1, 0, 0, 0], null, wavelength, "white");
  const level = white(rgb.subarray(0, 3 * pixels));
  known.set(key, level);
  return level;
}

/**
 * Encodes a linear image relative to a white level. Pixels that are not rendered (NaN) are transparent. Returns whether there are
 * such pixels.
 */
export function encode({ pixels, rgb }: Linear, level: number, out: Uint32Array): boolean {
  const scale = SRGB_STEPS / level;
  let hasMissing = false;
  for (let p = 0, at = 0; p < pixels; p++, at += 3) {
    const r = rgb[at] * scale;
    const g = rgb[at + 1] * scale;
    const b = rgb[at + 2] * scale;
    const sum = r + g + b;
    if (sum - sum !== 0) {
      out[p] = sum === sum ? UNDEFINED_RGBA : 0;
      hasMissing ||= sum !== sum;
      continue;
    }
    const red = SRGB[r <= 0 ? 0 : r >= SRGB_STEPS ? SRGB_STEPS : (r + 0.5) | 0];
    const green = SRGB[g <= 0 ? 0 : g >= SRGB_STEPS ? SRGB_STEPS : (g + 0.5) | 0];
    const blue = SRGB[b <= 0 ? 0 : b >= SRGB_STEPS ? SRGB_STEPS : (b + 0.5) | 0];
    out[p] = 0xff000000 | (blue << 16) | (green << 8) | red;
  }
  return hasMissing;
}

/** The intensity of a pixel at every wavelength. */
export interface Reading {
  label: string;
  value: number;
  error: number | null;
}

/**
 * Returns the intensity of a pixel at every wavelength. The error is the bound Σ|w|·se, which `sunstone probe` reports, because the
 * elements of a pixel can be correlated.
 */
export function readPixel(image: ImageResult, index: number, input: Stokes, analyzer: Stokes | null): Reading[] {
  const layout = layoutOf(image);
  const { offsets, weights } = terms(layout, input, analyzer);
  const nm = axisOf(image, "wavelength")?.coords ?? [];
  return Array.from({ length: layout.wavelengths }, (_, w) => {
    let [value, error] = [0, 0];
    offsets.forEach((offset, k) => {
      const at = index * layout.inner + offset + w;
      value += weights[k] * image.mean[at];
      if (image.stdError) error += Math.abs(weights[k]) * image.stdError[at];
    });
    return { label: nm[w] === undefined ? "" : `${nm[w]} nm`, value, error: image.stdError ? error : null };
  });
}

/** Returns whether a pixel has been rendered. */
export function isRendered(image: ImageResult, index: number): boolean {
  return !Number.isNaN(image.mean[index * (image.mean.length / (lengthOf(image, "y") * lengthOf(image, "x")))]);
}
