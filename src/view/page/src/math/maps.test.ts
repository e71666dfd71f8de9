import { describe, expect, it } from "vitest";
import type { ImageResult } from "../model";
import { type Quantity, type Stokes, initialState } from "../state";
import { contract, quantityMap, stokesImage } from "./maps";
import { propertiesOf } from "./properties";
import { angleOfLinearPolarization, degreeOfPolarization, ellipticityAngle, stokesOf } from "./stokes";
import { polarizer, product, random, reflection, retarder } from "./testing";

const range = (n: number) => Array.from({ length: n }, (_, i) => i);

/** Returns an image of one row; each pixel has one matrix for each wavelength. */
function imageOf(pixels: number[][][], stdError: number | null = null): ImageResult {
  const wavelengths = pixels[0].length;
  const mean = Float32Array.from(pixels.flatMap((lanes) => range(16).flatMap((e) => lanes.map((m) => m[e]))));
  const axis = (kind: "y" | "x" | "stokes_out" | "stokes_in" | "wavelength", n: number) => ({ kind, units: "1", coords: range(n) });
  return {
    axes: [axis("y", 1), axis("x", pixels.length), axis("stokes_out", 4), axis("stokes_in", 4), axis("wavelength", wavelengths)],
    mean,
    stdError: stdError === null ? null : new Float32Array(mean.length).fill(stdError),
    notes: [],
    region: [0, 1, 0, pixels.length],
    bin: 1,
    done: 1,
  };
}

const gold = reflection(0.792257, 0.102981, -0.406951, -0.671906);
const plate = retarder([1, 0, 0], Math.PI / 2);
const image = imageOf([[gold, plate], [polarizer(0.5), gold]], 0.1);
const value = (quantity: Quantity, change = {}) => [...quantityMap(image, { ...initialState, quantity, wavelength: 0, ...change }).values];

describe("Stokes vectors", () => {
  it("have angles in degrees", () => {
    expect(angleOfLinearPolarization(1, 0)).toBe(0);
    expect(angleOfLinearPolarization(0, 1)).toBe(45);
    expect(angleOfLinearPolarization(-1, 0)).toBe(90);
    expect(angleOfLinearPolarization(0, -1)).toBe(135);
    expect(ellipticityAngle(0, 0, 1)).toBe(45);
    expect(ellipticityAngle(0, 0, -1)).toBe(-45);
    const [s0, s1, s2, s3] = stokesOf(0.7, 130, -20);
    expect(degreeOfPolarization(s0, s1, s2, s3)).toBeCloseTo(0.7, 12);
    expect(angleOfLinearPolarization(s1, s2)).toBeCloseTo(130, 10);
    expect(ellipticityAngle(s1, s2, s3)).toBeCloseTo(-20, 10);
  });
});

describe("contract", () => {
  it("is [M s]_0, and ½ aᵀ M s with an analyzer", () => {
    const s: Stokes = [1, 0.3, -0.5, 0.2];
    const a: Stokes = [1, 0, 1, 0];
    const out = product(gold, [s[0], 0, 0, 0, s[1], 0, 0, 0, s[2], 0, 0, 0, s[3], 0, 0, 0]);
    expect(contract(image, s, null, 0)[0]).toBeCloseTo(out[0], 6);
    expect(contract(image, s, a, 0)[0]).toBeCloseTo(0.5 * (out[0] + out[8]), 6);
    expect(contract(image, s, null, "all")[0]).toBeCloseTo((out[0] + s[0]) / 2, 6);
    // Crossed polarizers transmit nothing.
    const crossed = stokesOf(1, (0.5 + Math.PI / 2) * (180 / Math.PI), 0);
    expect(contract(image, [1, 0, 0, 0], crossed, 0)[1]).toBeCloseTo(0, 7);
  });
});

describe("stokesImage", () => {
  it("turns +45° into left circular light behind a quarter-wave plate", () => {
    const s = stokesImage(image, [1, 0, 1, 0], 1);
    [1, 0, 0, -1].forEach((want, k) => expect(s[k]).toBeCloseTo(want, 6));
  });
});

describe("quantityMap", () => {
  it("shows elements, errors and signal-to-noise ratios", () => {
    expect(value("element", { row: 2, column: 3 })[0]).toBeCloseTo(-0.671906 / 0.792257, 6);
    expect(value("element", { row: 2, column: 3, normalized: false })[0]).toBeCloseTo(-0.671906, 6);
    expect(value("element")[0]).toBeCloseTo(0.792257, 6);
    expect(value("std_error", { normalized: false })[0]).toBeCloseTo(0.1, 6);
    // The wavelengths may be correlated: the error of the mean is the mean of the errors.
    expect(value("std_error", { normalized: false, wavelength: "all" })[0]).toBeCloseTo(0.1, 6);
    expect(value("snr", { row: 0, column: 1 })[0]).toBeCloseTo(1.02981, 5);
  });

  it("shows the state of the outgoing light", () => {
    expect(value("dolp")[1]).toBeCloseTo(1, 6);
    expect(value("aolp")[1]).toBeCloseTo(0.5 * (180 / Math.PI), 4);
    expect(value("ellipticity", { wavelength: 1, input: [1, 0, 1, 0] })[0]).toBeCloseTo(-45, 4);
  });

  it("decomposes like single matrices, after the mean over wavelengths", () => {
    const mean = gold.map((e, k) => (e + plate[k]) / 2);
    const want = propertiesOf(mean)!;
    for (const quantity of ["diattenuation", "polarizance", "retardance", "depolarization"] as const) {
      expect(value(quantity, { wavelength: "all" })[0]).toBeCloseTo(want[quantity], 4);
    }
    expect(value("fast_axis", { wavelength: 1 })[0]).toBeCloseTo(0, 4);
  });

  it("has only M00 of slices without polarization", () => {
    const axes = image.axes.filter((a) => !a.kind.startsWith("stokes"));
    const plain: ImageResult = { ...image, axes, mean: new Float32Array([1, 2, 3, 4]) };
    expect([...quantityMap(plain, { ...initialState, quantity: "intensity", wavelength: 1 }).values]).toEqual([2, 4]);
    expect(quantityMap(plain, { ...initialState, quantity: "dolp" }).values[0]).toBeNaN();
    expect(quantityMap(plain, { ...initialState, quantity: "retardance" }).values[0]).toBeNaN();
    expect(quantityMap(plain, { ...initialState, quantity: "element", row: 1 }).values[0]).toBeNaN();
  });

  // The limit is 20 ms on an idle processor; the test allows for a busy one.
  it("computes a 512 x 512 image of 3 wavelengths in interactive time", () => {
    const uniform = random(2);
    const n = 512;
    const mean = Float32Array.from({ length: n * n * 48 }, () => uniform() - 0.5);
    for (let p = 0; p < mean.length; p += 48) mean.fill(2, p, p + 3);
    const coords = range(n);
    const large: ImageResult = {
      ...image, mean, stdError: null, axes: image.axes.map((a) => (a.kind === "y" || a.kind === "x" ? { ...a, coords }
        : a.kind === "wavelength" ? { ...a, coords: range(3) } : a)),
    };
    const time = (quantity: Quantity) => {
      const view = { ...initialState, quantity, input: [1, 0.2, 0.3, 0.4] as Stokes };
      const times = range(5).map(() => {
        const start = performance.now();
        quantityMap(large, view);
        return performance.now() - start;
      });
      return Math.min(...times);
    };
    for (const quantity of ["intensity", "dolp", "aolp", "element", "retardance"] as const) {
      expect(time(quantity)).toBeLessThan(quantity === "retardance" ? 4000 : 200);
    }
  });
});
