import { describe, expect, it } from "vitest";
import type { AxisKind, Labelled } from "../model";
import { matrixOf, planeOf, positions, relativeError } from "./labelled";

const axis = (kind: AxisKind, n: number) => ({ kind, units: "1", coords: Array.from({ length: n }, (_, i) => i) });

function result(axes: [AxisKind, number][], errors = false): Labelled {
  const n = axes.reduce((product, [, length]) => product * length, 1);
  const mean = Float32Array.from({ length: n }, (_, i) => i);
  return { axes: axes.map(([kind, length]) => axis(kind, length)), mean, stdError: errors ? new Float32Array(n).fill(0.5) : null, notes: [] };
}

describe("positions", () => {
  it("follows the order of the axes", () => {
    const at = positions(result([["t", 3], ["stokes_out", 4], ["wavelength", 2]]));
    expect(at({ t: 2, stokes_out: 1, wavelength: 1 })).toBe(2 * 8 + 2 + 1);
    expect(at({})).toBe(0);
  });
});

describe("matrixOf", () => {
  it("returns rows of outgoing elements", () => {
    const of = result([["stokes_out", 4], ["stokes_in", 4], ["wavelength", 2]]);
    expect(matrixOf(of, of.mean, { wavelength: 1 })?.slice(0, 5)).toEqual([1, 3, 5, 7, 9]);
    const plain = result([["wavelength", 2]]);
    expect(matrixOf(plain, plain.mean, {})).toBeNull();
  });
});

describe("planeOf", () => {
  it("transposes, selects a wavelength, and averages wavelengths", () => {
    const of = result([["x", 2], ["u", 3], ["wavelength", 2]]);
    expect([...planeOf(of, "u", "x", 0)]).toEqual([0, 6, 2, 8, 4, 10]);
    expect([...planeOf(of, "x", "u", "all")]).toEqual([0.5, 2.5, 4.5, 6.5, 8.5, 10.5]);
    expect([...planeOf(result([["u", 2]]), "v", "u", 5)]).toEqual([0, 1]);
  });
});

describe("relativeError", () => {
  it("is the mean error of M00 over the mean of M00 of finished pixels", () => {
    const of = result([["y", 1], ["x", 3], ["wavelength", 1]], true);
    of.mean.set([1, 3, NaN]);
    expect(relativeError(of)).toBeCloseTo(0.25, 6);
    expect(relativeError({ ...of, stdError: null })).toBeNull();
    of.mean.fill(0);
    expect(relativeError(of)).toBeNull();
  });
});
