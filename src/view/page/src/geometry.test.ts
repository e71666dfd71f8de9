import { describe, expect, it } from "vitest";
import { epipolarLine, LIGHT_M_PER_PS, ray, surfaceDistance } from "./geometry";
import type { Pinhole } from "./model";

type Vector = [number, number, number];

/** Returns a device at a point that looks at another, as scene files do. */
function device(origin: Vector, target: Vector, resolution: [number, number], focal: number): Pinhole {
  const unit = (v: Vector): Vector => v.map((c) => c / Math.hypot(...v)) as Vector;
  const cross = (a: Vector, b: Vector): Vector =>
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const forward = unit([target[0] - origin[0], target[1] - origin[1], target[2] - origin[2]]);
  const right = unit(cross(forward, [0, 1, 0]));
  const down = cross(forward, right);
  const principal = resolution.map((n) => n / 2) as [number, number];
  return { resolution, focal_px: [focal, focal], principal_px: principal, origin_m: origin, right, down, forward };
}

/** Returns the pixel coordinates (y, x) of a point, where the centre of the first pixel is 0, 0. */
function project(to: Pinhole, point: Vector): [number, number] {
  const from = point.map((c, i) => c - to.origin_m[i]);
  const along = (axis: Vector): number => from.reduce((sum, c, i) => sum + c * axis[i], 0);
  const z = along(to.forward);
  return [
    (along(to.down) / z) * to.focal_px[1] + to.principal_px[1] - 0.5, (along(to.right) / z) * to.focal_px[0] + to.principal_px[0] - 0.5,
  ];
}

const camera = device([-0.12, 1.05, 1.75], [0, 0.72, -0.6], [256, 192], 270);
const projector = device([0.3, 1.08, 1.7], [0, 0.7, -0.5], [200, 160], 230);
const points: Vector[] = [[0, 0.7, -0.6], [0.2, 0.5, -0.3], [-0.3, 0.9, -1], [0.1, 1, 0]];

describe("rays and epipolar lines", () => {
  it("passes through the pixel that sees a point", () => {
    for (const point of points) {
      const [y, x] = project(camera, point);
      const direction = ray(camera, y, x);
      const distance = Math.hypot(...point.map((c, i) => c - camera.origin_m[i]));
      point.forEach((c, i) => expect(camera.origin_m[i] + distance * direction[i]).toBeCloseTo(c, 9));
    }
  });

  it("contains the projector pixel of a point that the camera pixel sees", () => {
    for (const point of points) {
      const { values, width } = epipolarLine(camera, projector, ...project(camera, point));
      const [v, u] = project(projector, point).map(Math.round);
      expect(values[v * width + u]).toBe(1);
      // A line is thin: three pixels wide, and at most as long as the diagonal.
      const count = values.reduce((sum, drive) => sum + drive, 0);
      expect(count).toBeGreaterThan(200);
      expect(count).toBeLessThan(3.3 * Math.hypot(200, 160));
    }
  });

  it("contains the pixel also if a lens distorts", () => {
    const bent: Pinhole = { ...camera, distortion: { k1: -0.2, k2: 0.05, k3: 0, p1: 0.001, p2: -0.002 } };
    const [y, x] = [30, 200];
    const direction = ray(bent, y, x);
    const [v, u] = project(projector, bent.origin_m.map((c, i) => c + 2 * direction[i]) as Vector).map(Math.round);
    const { values, width } = epipolarLine(bent, projector, y, x);
    expect(values[v * width + u]).toBe(1);
  });

  it("reports devices at the same position", () => {
    expect(() => epipolarLine(camera, { ...projector, origin_m: camera.origin_m }, 3, 4)).toThrow("same position");
  });
});

describe("unwarped time", () => {
  it("finds the distance of a surface from the arrival of direct light", () => {
    for (const point of points) {
      const distance = Math.hypot(...point.map((c, i) => c - camera.origin_m[i]));
      const way = distance + Math.hypot(...point.map((c, i) => c - projector.origin_m[i]));
      const picoseconds = way / LIGHT_M_PER_PS;
      const direction = ray(camera, ...project(camera, point));
      expect(surfaceDistance(LIGHT_M_PER_PS * picoseconds, projector, camera, direction)).toBeCloseTo(distance, 9);
    }
  });
});
