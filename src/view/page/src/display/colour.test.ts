import { describe, expect, it } from "vitest";
import { percentile, rgbWeights, SRGB, SRGB_STEPS, srgb, white } from "./colour";
import { diverging, sequential } from "./colourmaps";

// The expected values are those of the tests of src/figure/colour.rs.
describe("colours of wavelengths", () => {
  it("assigns three wavelengths by order and shows one as grey", () => {
    expect(rgbWeights([450, 550, 660])).toEqual([[0, 0, 1], [0, 1, 0], [1, 0, 0]]);
    expect(rgbWeights([700, 800, 750])).toEqual([[0, 1, 0], [0, 0, 1], [1, 0, 0]]);
    expect(rgbWeights([635])).toEqual([[1], [1], [1]]);
  });

  it("averages the wavelengths of a primary, and uses the nearest if there are none", () => {
    expect(rgbWeights([400, 450, 550, 660])).toEqual([[0, 0, 0, 1], [0, 0, 1, 0], [0.5, 0.5, 0, 0]]);
    expect(rgbWeights([450, 635])).toEqual([[0, 1], [0, 1], [1, 0]]);
    expect(rgbWeights([700, 800])).toEqual([[0.5, 0.5], [1, 0], [1, 0]]);
    expect(rgbWeights([])).toEqual([[], [], []]);
  });

  it("encodes sRGB", () => {
    expect(srgb(1)).toBe(255);
    expect(srgb(0.215861)).toBe(128);
    expect(srgb(-1)).toBe(0);
    for (const v of [0.001, 0.0031, 0.02, 0.3, 0.7]) expect(Math.abs(SRGB[Math.round(v * SRGB_STEPS)] - srgb(v))).toBeLessThanOrEqual(1);
  });
});

describe("automatic exposure", () => {
  it("selects the value that sorting selects", () => {
    const values = Float32Array.from({ length: 1001 }, (_, i) => Math.sin(37 * i) * 10 ** ((i % 7) - 3));
    values[3] = NaN;
    values[4] = -Infinity;
    const sorted = values.filter(Number.isFinite).sort();
    for (const q of [0, 0.01, 0.5, 0.99, 1]) expect(percentile(values, q)).toBe(sorted[Math.round((sorted.length - 1) * q)]);
    expect(percentile(Float32Array.of(NaN, Infinity), 0.5)).toBeNull();
  });

  it("ignores values that are not finite, and uses the maximum of sparse images", () => {
    expect(white(Float32Array.of(NaN, 0, Infinity, 2))).toBe(2);
    expect(white(Float32Array.of(0, 0, 0, 0))).toBe(1);
    const sparse = new Float32Array(1000);
    sparse[7] = 3;
    expect(white(sparse)).toBe(3);
  });
});

describe("colour maps", () => {
  it("shows the sign and the centre", () => {
    const [blue, centre, red] = [0, 128, 255].map((k) => diverging.subarray(3 * k, 3 * k + 3));
    expect(red[0]).toBeGreaterThan(2 * red[2]);
    expect(blue[2]).toBeGreaterThan(2 * blue[0]);
    expect(Math.min(...centre)).toBeGreaterThan(230);
    expect([...sequential.subarray(0, 3)]).toEqual([0, 0, 4]);
    expect([...sequential.subarray(-3)]).toEqual([252, 255, 164]);
  });
});
