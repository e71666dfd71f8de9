/** Frames of light in flight, with the option of unwarped camera time. */

import { type ImageResult, type Pinhole, axisOf, lengthOf } from "../model";
import { isPinhole, LIGHT_M_PER_PS, ray, surfaceDistance } from "../geometry";
import { percentile } from "./colour";

/** Fraction of the peak of a pixel above which its first light has arrived. */
const ARRIVAL = 0.01;

interface Layout {
  pixels: number;
  bins: number;
  wavelengths: number;
}

const layoutOf = (movie: ImageResult): Layout => ({
  pixels: lengthOf(movie, "y") * lengthOf(movie, "x"), bins: lengthOf(movie, "t"), wavelengths: lengthOf(movie, "wavelength"),
});

const whites = new WeakMap<ImageResult, number>();

/** Returns the white level of all frames: the 99.5th percentile of the positive values, as in `sunstone figure --view flight`. */
export function movieWhite(movie: ImageResult): number {
  const known = whites.get(movie);
  if (known !== undefined) return known;
  const level = percentile(movie.mean.filter((value) => value > 0), 0.995) ?? 1;
  whites.set(movie, level);
  return level;
}

/**
 * Returns by how many bins each pixel's light is late because of its way from the first surface to the camera, relative to the pixel
 * whose surface is the nearest. Valid for light that the projector sends directly. Pixels without light have 0. Null if the devices
 * are not known.
 */
export function unwarpShifts(movie: ImageResult, camera: Pinhole | undefined, projector: Pinhole | undefined): Int32Array | null {
  const t = axisOf(movie, "t");
  const [ys, xs] = [axisOf(movie, "y")?.coords, axisOf(movie, "x")?.coords];
  if (!isPinhole(camera) || !isPinhole(projector) || !t || t.coords.length < 2 || !ys || !xs) return null;
  const { pixels, bins, wavelengths } = layoutOf(movie);
  const distances = new Float64Array(pixels).fill(NaN);
  for (let p = 0; p < pixels; p++) {
    const light = (k: number): number => {
      let sum = 0;
      for (let w = 0; w < wavelengths; w++) sum += movie.mean[(p * bins + k) * wavelengths + w];
      return sum;
    };
    let peak = 0;
    for (let k = 0; k < bins; k++) peak = Math.max(peak, light(k));
    if (!(peak > 0)) continue;
    let first = 0;
    while (light(first) <= ARRIVAL * peak) first++;
    const direction = ray(camera, ys[Math.floor(p / xs.length)], xs[p % xs.length]);
    distances[p] = surfaceDistance(LIGHT_M_PER_PS * t.coords[first], projector, camera, direction);
  }
  const nearest = distances.reduce((least, d) => (d < least ? d : least), Infinity);
  const binLength = LIGHT_M_PER_PS * (t.coords[1] - t.coords[0]);
  return Int32Array.from(distances, (d) => (Number.isFinite(d) ? Math.round((d - nearest) / binLength) : 0));
}

let frame = new Float32Array(0);

/** Returns the image of one time bin. The result is valid until the next call. */
export function frameOf(movie: ImageResult, bin: number, shifts: Int32Array | null): ImageResult {
  const { pixels, bins, wavelengths } = layoutOf(movie);
  if (frame.length !== pixels * wavelengths) frame = new Float32Array(pixels * wavelengths);
  for (let p = 0; p < pixels; p++) {
    const k = bin + (shifts ? shifts[p] : 0);
    const from = (p * bins + k) * wavelengths;
    for (let w = 0; w < wavelengths; w++) frame[p * wavelengths + w] = k < bins ? movie.mean[from + w] : 0;
  }
  return { ...movie, axes: movie.axes.filter((axis) => axis.kind !== "t"), mean: frame, stdError: null };
}
