import { describe as suite, expect, it } from "vitest";
import { project, turned, unproject } from "./PoincareSphere";

suite("PoincareSphere", () => {
  const view = { yaw: 0.6, pitch: 0.35 };

  it("finds the state under the pointer", () => {
    for (const [right, down] of [[0, 0], [0.3, -0.5], [-0.7, 0.6]]) {
      const state = unproject(view, right, down);
      expect(Math.hypot(...state)).toBeCloseTo(1, 12);
      const [x, y, depth] = project(view, state);
      expect(x).toBeCloseTo(right, 12);
      expect(y).toBeCloseTo(down, 12);
      expect(depth).toBeGreaterThanOrEqual(0);
    }
    const [x, y] = project(view, unproject(view, 3, 4));
    expect([x, y].map((v) => Number(v.toFixed(9)))).toEqual([0.6, 0.8]);
  });

  it("shows right circular light above and keeps the handedness of s1, s2, s3", () => {
    expect(project(view, [0, 0, 1])[1]).toBeLessThan(0);
    expect(project({ yaw: 0, pitch: 0 }, [0, 1, 0])).toEqual([1, -0, 0]);
    expect(project({ yaw: 0, pitch: 0 }, [1, 0, 0])[2]).toBe(1);
  });

  it("changes azimuth and ellipticity by keys", () => {
    const [s1, s2, s3] = turned([1, 0, 0], 45, 0);
    expect([s1, s2, s3].map((v) => Number(v.toFixed(12)))).toEqual([0, 1, 0]);
    expect(turned([0, 0, 0.5], 0, 10)[2]).toBeCloseTo(0.5, 12);
    expect(Math.hypot(...turned([0, 0, 0], 5, 0))).toBeCloseTo(1, 12);
  });
});
