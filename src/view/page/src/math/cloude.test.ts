import { describe, expect, it } from "vitest";
import { realizability } from "./cloude";
import { diagonal, polarizer, product, reflection, retarder } from "./testing";

const eigenvalues = (m: number[]) => [...realizability(m, null)!.eigenvalues];

describe("realizability", () => {
  it("has the eigenvalues of known matrices", () => {
    const cases: [number[], number[]][] = [
      [diagonal([1, 1, 1, 1]), [1, 0, 0, 0]],
      [diagonal([1, 0, 0, 0]), [0.25, 0.25, 0.25, 0.25]],
      [diagonal([1, 1, 1, -1]), [0.5, 0.5, 0.5, -0.5]],
      [diagonal([1, -1, -1, -1]), [0.5, 0.5, 0.5, -0.5]],
      [diagonal([1, 0.5, 0.3, 0.1]), [0.475, 0.275, 0.175, 0.075]],
      [polarizer(0.3), [0.5, 0, 0, 0]],
      [retarder([0.6, 0.48, 0.64], 1.1), [1, 0, 0, 0]],
    ];
    for (const [m, want] of cases) eigenvalues(m).forEach((value, k) => expect(value).toBeCloseTo(want[k], 13));
  });

  it("accepts optical elements and their products", () => {
    const gold = reflection(0.792257, 0.102981, -0.406951, -0.671906);
    const glass = reflection(0.0502399, 0.0417735, -0.0279111, 0);
    for (const m of [gold, glass, product(gold, polarizer(1)), product(retarder([0, 1, 0], 2), gold)]) {
      expect(realizability(m, null)?.verdict).toBe("realizable");
    }
  });

  it("compares a negative eigenvalue with its error", () => {
    const m = diagonal([1, 1.01, 1, 1]);
    // The smallest eigenvalue is -0.0025.
    const errors = (sigma: number) => new Array<number>(16).fill(sigma);
    expect(realizability(m, errors(0.01))).toMatchObject({ verdict: "uncertain" });
    expect(realizability(m, errors(1e-4))).toMatchObject({ verdict: "unrealizable" });
    expect(realizability(m, null)).toMatchObject({ verdict: "unrealizable", error: null });
    // For equal errors σ, Σ (v† B v / 4)² σ² = (4/16) σ², because the B/2 are an orthonormal basis of the Hermitian matrices.
    expect(realizability(m, errors(0.01))!.error).toBeCloseTo(0.005, 12);
    expect(realizability(diagonal([-1, 0, 0, 0]), null)?.verdict).toBe("unrealizable");
    expect(realizability(diagonal([0, 0, 0, 0]), null)?.verdict).toBe("realizable");
    expect(realizability(diagonal([NaN, 0, 0, 0]), null)).toBeNull();
  });
});
