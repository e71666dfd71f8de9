import { describe, expect, it } from "vitest";
import { hermitianEigen, symmetricEigen } from "./eigen";
import { random } from "./testing";

describe("symmetricEigen", () => {
  it("solves a 3 x 3 matrix with known eigenvalues", () => {
    const { values, vectors } = symmetricEigen([2, 1, 0, 1, 2, 0, 0, 0, -1], 3);
    [3, 1, -1].forEach((want, k) => expect(values[k]).toBeCloseTo(want, 14));
    expect(Math.abs(vectors[0])).toBeCloseTo(Math.SQRT1_2, 14);
    expect(vectors[0]).toBeCloseTo(vectors[1], 14);
  });

  it("leaves diagonal and zero matrices unchanged", () => {
    expect([...symmetricEigen([1, 0, 0, 0, 3, 0, 0, 0, 2], 3).values]).toEqual([3, 2, 1]);
    expect([...symmetricEigen(new Array(9).fill(0), 3).values]).toEqual([0, 0, 0]);
  });

  it("returns orthonormal vectors that rebuild random matrices", () => {
    const uniform = random(3);
    for (const n of [3, 8]) {
      const a = new Float64Array(n * n);
      for (let i = 0; i < n; i++) for (let j = i; j < n; j++) a[i * n + j] = a[j * n + i] = uniform() - 0.5;
      const { values, vectors } = symmetricEigen(a, n);
      for (let i = 0; i < n; i++) {
        for (let j = 0; j < n; j++) {
          let [rebuilt, dot] = [0, 0];
          for (let k = 0; k < n; k++) {
            rebuilt += values[k] * vectors[k * n + i] * vectors[k * n + j];
            dot += vectors[i * n + k] * vectors[j * n + k];
          }
          expect(rebuilt).toBeCloseTo(a[i * n + j], 13);
          expect(dot).toBeCloseTo(i === j ? 1 : 0, 13);
        }
      }
    }
  });
});

describe("hermitianEigen", () => {
  it("rebuilds random Hermitian matrices", () => {
    const uniform = random(5);
    const [re, im] = [new Float64Array(16), new Float64Array(16)];
    for (let i = 0; i < 4; i++) {
      for (let j = i; j < 4; j++) {
        re[4 * i + j] = re[4 * j + i] = uniform() - 0.5;
        im[4 * i + j] = i === j ? 0 : uniform() - 0.5;
        im[4 * j + i] = -im[4 * i + j];
      }
    }
    const { values, vectors } = hermitianEigen(re, im, 4);
    for (let i = 0; i < 4; i++) {
      for (let j = 0; j < 4; j++) {
        let [a, b] = [0, 0];
        for (let k = 0; k < 4; k++) {
          const v = vectors.subarray(8 * k, 8 * k + 8);
          a += values[k] * (v[i] * v[j] + v[i + 4] * v[j + 4]);
          b += values[k] * (v[i + 4] * v[j] - v[i] * v[j + 4]);
        }
        expect(a).toBeCloseTo(re[4 * i + j], 13);
        expect(b).toBeCloseTo(im[4 * i + j], 13);
      }
    }
  });
});
