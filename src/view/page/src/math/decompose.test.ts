import { describe, expect, it } from "vitest";
import { decompose, newParts } from "./decompose";
// Made by `python3 decomposed.py target/release/sunstone out/ci.zarr > decomposed.json` (see the script).
import decomposed from "./decomposed.json";
import { orientation, propertiesOf } from "./properties";
import { DEGREES } from "./stokes";
import { diagonal, diattenuator, direction, polarizer, product, random, reflection, retarder } from "./testing";

function close(got: ArrayLike<number>, want: ArrayLike<number>, tolerance: number): void {
  for (let k = 0; k < want.length; k++) expect(Math.abs(got[k] - want[k])).toBeLessThanOrEqual(tolerance);
}

function rebuilt(m: number[], tolerance = 1e-10): ReturnType<typeof newParts> {
  const parts = newParts();
  expect(decompose(m, parts)).toBe(true);
  close(product(product(parts.depolarizer, parts.retarder), parts.diattenuator), m, tolerance * m[0]);
  const block = (of: Float64Array, i: number, j: number) => of[4 * i + j + 5];
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) {
      const dot = [0, 1, 2].reduce((sum, k) => sum + block(parts.retarder, i, k) * block(parts.retarder, j, k), 0);
      expect(dot).toBeCloseTo(i === j ? 1 : 0, 10);
      expect(block(parts.depolarizer, i, j)).toBeCloseTo(block(parts.depolarizer, j, i), 10);
    }
  }
  const r = parts.retarder;
  const minor = (a: number, b: number, c: number, d: number) => r[a] * r[b] - r[c] * r[d];
  const determinant = r[5] * minor(10, 15, 11, 14) - r[6] * minor(9, 15, 11, 13) + r[7] * minor(9, 14, 10, 13);
  expect(determinant).toBeCloseTo(1, 10);
  return parts;
}

describe("decompose", () => {
  it("recovers the factors of random matrices", () => {
    const uniform = random(1);
    for (let n = 0; n < 500; n++) {
      const spin = retarder(direction(uniform), 3 * uniform());
      const sign = uniform() < 0.2 ? -1 : 1;
      const values = [1, 2, 3].map(() => sign * (0.05 + 0.95 * uniform()));
      const inverse = Array.from({ length: 16 }, (_, k) => spin[4 * (k % 4) + (k >> 2)]);
      const depolarizer = product(product(spin, diagonal([1, ...values])), inverse);
      direction(uniform).forEach((p, i) => (depolarizer[4 * i + 4] = 0.3 * p));
      const [axis, angle] = [direction(uniform), 0.05 + 3.04 * uniform()];
      const turning = retarder(axis, angle);
      const length = 0.95 * uniform();
      const passing = diattenuator(0.01 + 10 * uniform(), direction(uniform).map((e) => e * length));
      const m = product(product(depolarizer, turning), passing);
      const parts = rebuilt(m);
      close(parts.depolarizer, depolarizer, 1e-8);
      close(parts.retarder, turning, 1e-8);
      close(parts.diattenuator, passing, 1e-8);
      const found = propertiesOf(m)!;
      expect(found.retardance).toBeCloseTo(angle * DEGREES, 5);
      expect(found.diattenuation).toBeCloseTo(length, 10);
      close(found.axis, axis, 1e-6 / Math.sin(angle));
    }
  });

  it("rebuilds polarizers before and behind other elements", () => {
    const states = [[1, 0, 0], [0.6, 0.8, 0], [0, 0.6, -0.8], [-1, 0, 0]];
    for (const d of states) {
      for (const p of states) {
        const [row, column] = [[1, ...d], [1, ...p]];
        rebuilt(column.flatMap((a) => row.map((b) => 0.3 * a * b)), 1e-12);
      }
    }
    rebuilt([0.5, 0.5, 0, 0, 0.1, 0.1, 0, 0, 0.2, 0.2, 0, 0, 0, 0, 0, 0], 1e-12);
  });

  it("rebuilds singular and negative depolarizers", () => {
    for (const d of [
      [1, 0, 0, 0], [2, 1, 0, 0], [1, -0.5, 0, 0], [1, 0.5, 0.25, 0], [1, 0.5, -0.25, 0], [1, 0.3, 0.3, -0.3], [1, -1 / 3, -1 / 3, -1 / 3],
    ]) {
      rebuilt(diagonal(d), 1e-12);
    }
    const inverted = rebuilt(diagonal([1, -0.2, -0.3, -0.1]));
    close(inverted.retarder, diagonal([1, 1, 1, 1]), 1e-12);
    expect(inverted.depolarizer[10]).toBeCloseTo(-0.3, 12);
    close(rebuilt(diagonal([1, 0, 0, 0])).retarder, diagonal([1, 1, 1, 1]), 0);
  });

  it("rejects matrices that no element has", () => {
    const parts = newParts();
    expect(decompose(diagonal([0, 0, 0, 0]), parts)).toBe(false);
    expect(decompose(diagonal([-1, 0, 0, 0]), parts)).toBe(false);
    expect(decompose([1, 0.9, 0.9, 0, ...new Array(12).fill(0)], parts)).toBe(false);
    expect(decompose([1, NaN, 0, 0, ...new Array(12).fill(0)], parts)).toBe(false);
    expect(decompose([1, Infinity, 0, 0, ...new Array(12).fill(0)], parts)).toBe(false);
  });
});

describe("propertiesOf", () => {
  it("knows the elements", () => {
    expect(propertiesOf(polarizer(0.3))).toMatchObject({ diattenuation: expect.closeTo(1, 12), polarizance: expect.closeTo(1, 12) });
    // A quarter-wave plate with its fast axis at 0° turns +45° linear light into left circular light.
    const plate = retarder([1, 0, 0], Math.PI / 2);
    close(plate, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0], 1e-15);
    expect(propertiesOf(plate)).toMatchObject({ retardance: expect.closeTo(90, 10), depolarization: expect.closeTo(0, 12) });
    for (const angle of [0, 0.4, 1.2, 2.9]) {
      const axis = propertiesOf(retarder([Math.cos(2 * angle), Math.sin(2 * angle), 0], 1))!.axis;
      expect(orientation(axis)).toBeCloseTo(angle * DEGREES, 9);
    }
    const half = propertiesOf(retarder([Math.cos(0.6), Math.sin(0.6), 0], Math.PI))!;
    expect(half.retardance).toBeCloseTo(180, 6);
    close(half.axis, [Math.cos(0.6), Math.sin(0.6), 0], 1e-9);
    expect(propertiesOf(diagonal([2, 1, 1, 1]))).toMatchObject({ depolarization: 0.5, retardance: 0, axis: [0, 0, 0] });
    expect(orientation([0, 0, 1])).toBeNaN();
  });

  it("finds the diattenuation and retardance of the gold reflection at 60°", () => {
    const found = propertiesOf(reflection(0.792257, 0.102981, -0.406951, -0.671906))!;
    expect(found.diattenuation).toBeCloseTo(0.102981 / 0.792257, 12);
    expect(found.retardance).toBeCloseTo(DEGREES * Math.atan2(0.671906, -0.406951), 4);
    expect(found.depolarization).toBeCloseTo(0, 5);
  });

  it("equals `sunstone decompose`", () => {
    expect(decomposed).toHaveLength(20);
    for (const want of decomposed) {
      const found = propertiesOf(want.m)!;
      expect(found.polarizance).toBeCloseTo(want.polarizance[0], 6);
      expect(found.diattenuation).toBeCloseTo(want.diattenuation[0], 6);
      expect(found.depolarization).toBeCloseTo(want.depolarization[0], 6);
      expect(found.retardance).toBeCloseTo(want.retardance[0] * DEGREES, 3);
      close(found.axis, want.retardance_axis, 1e-4);
    }
  });
});
