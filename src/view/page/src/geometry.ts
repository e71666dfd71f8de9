/** Geometry of the two pinhole devices: rays of pixels, epipolar lines, and the travel time from a surface to the camera. */

import type { Pinhole } from "./model";
import { SourceError, type Pattern } from "./sources/source";

type Vector = [number, number, number];

/** Speed of light in metres per picosecond. */
export const LIGHT_M_PER_PS = 2.99792458e-4;

/** Half width of an epipolar line in projector pixels, as in the slices of the shipped scenes. */
const HALF_WIDTH_PX = 1.5;

const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a: Vector, b: Vector): Vector =>
  [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** Returns whether a device is a pinhole. An orthographic device has no focal length. */
export const isPinhole = (device: Pinhole | undefined): device is Pinhole => Array.isArray(device?.focal_px);

/** Returns the distorted normalized coordinates (Brown-Conrady) of an ideal point on the plane at distance 1. */
function distort(device: Pinhole, a: number, b: number): [number, number] {
  const { k1 = 0, k2 = 0, k3 = 0, p1 = 0, p2 = 0 } = device.distortion ?? {};
  const r = a * a + b * b;
  const radial = 1 + r * (k1 + r * (k2 + r * k3));
  return [a * radial + 2 * p1 * a * b + p2 * (r + 2 * a * a), b * radial + p1 * (r + 2 * b * b) + 2 * p2 * a * b];
}

/** Returns where the ray of a pixel crosses the plane at distance 1: the coordinates along `right` and `down`. */
export function normalized(device: Pinhole, y: number, x: number): [number, number] {
  const a = (x + 0.5 - device.principal_px[0]) / device.focal_px[0];
  const b = (y + 0.5 - device.principal_px[1]) / device.focal_px[1];
  if (!Object.values(device.distortion ?? {}).some((k) => k !== 0)) return [a, b];
  // The inverse of the distortion by fixed-point iteration, which converges for lenses.
  let [u, v] = [a, b];
  for (let i = 0; i < 20; i++) {
    const [du, dv] = distort(device, u, v);
    [u, v] = [u + a - du, v + b - dv];
  }
  return [u, v];
}

/** Returns the unit vector, in the scene's frame, from a device along the ray through the centre of a pixel. */
export function ray(device: Pinhole, y: number, x: number): Vector {
  const [a, b] = normalized(device, y, x);
  const at = (i: number): number => a * device.right[i] + b * device.down[i] + device.forward[i];
  const length = Math.hypot(at(0), at(1), at(2));
  return [at(0) / length, at(1) / length, at(2) / length];
}

/**
 * Returns the pattern with drive 1 on the projector pixels that can directly illuminate the points that a camera pixel sees: those
 * within 1.5 pixels of the epipolar line. `y` and `x` are coordinates of the camera pixel. Fails for devices without such lines.
 */
export function epipolarLine(camera: Pinhole, projector: Pinhole, y: number, x: number): Pattern {
  if (!isPinhole(camera) || !isPinhole(projector)) {
    throw new SourceError("an orthographic camera or projector has no epipolar lines; choose another illumination");
  }
  const baseline = minus(projector.origin_m, camera.origin_m);
  if (Math.hypot(...baseline) < 1e-9) {
    throw new SourceError("camera and projector are at the same position, so there are no epipolar lines; choose another illumination");
  }
  // The plane through both origins and the camera's ray cuts the projector's image plane in the line.
  const normal = cross(baseline, ray(camera, y, x));
  const [a, b, c] = [dot(normal, projector.right), dot(normal, projector.down), dot(normal, projector.forward)];
  const perPixel = Math.hypot(a / projector.focal_px[0], b / projector.focal_px[1]);
  const [width, height] = projector.resolution;
  const values = new Float32Array(width * height);
  for (let v = 0; v < height; v++) {
    for (let u = 0; u < width; u++) {
      const [p, q] = normalized(projector, v, u);
      values[v * width + u] = Math.abs(a * p + b * q + c) <= HALF_WIDTH_PX * perPixel ? 1 : 0;
    }
  }
  return { width, height, values };
}

/**
 * Returns the distance in metres from the camera to the surface that light reaches first from the projector: the light travels
 * `path` metres from the projector to the surface and to the camera, and arrives along `direction` (a unit vector from the camera).
 */
export function surfaceDistance(path: number, projector: Pinhole, camera: Pinhole, direction: Vector): number {
  const b = minus(projector.origin_m, camera.origin_m);
  return (path * path - dot(b, b)) / (2 * (path - dot(b, direction)));
}
