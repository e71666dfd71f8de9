import { describe, expect, it } from "vitest";
import type { AxisKind, Slice } from "../model";
import type { ProbeRequest } from "../sources/source";
import { initialState } from "../state";
import { duration, six } from "./numbers";
import { shortUnit } from "../display/units";
import { remaining } from "./ProgressPanel";
import { toSlice } from "./showSlice";
import { keeping, nearest } from "./useProbe";

const slice = (name: string, axes: [AxisKind, number[]][]): Slice =>
  ({ name, axes: axes.map(([kind, coords]) => ({ kind, units: "1", coords })), attributes: {} });

describe("numbers", () => {
  it("have six significant digits and short units", () => {
    expect(six(0.275499)).toBe("0.275499");
    expect(six(-0.0137840658)).toBe("−0.0137841");
    expect(six(4.29962e-8)).toBe("4.29962e−8");
    expect(six(0)).toBe("0");
    expect(six(NaN)).toBe("NaN");
    expect(shortUnit("W m-2 sr-1 nm-1 per unit projector drive")).toBe("W m⁻² sr⁻¹ nm⁻¹");
    expect([duration(89), duration(300), duration(7200)]).toEqual(["89 s", "5 min", "2.0 h"]);
  });
});

describe("keeping", () => {
  it("sums over axes that are not kept, selected or contracted", () => {
    const of = slice("s", [["y", [0]], ["x", [0]], ["v", [0]], ["u", [0]], ["t", [0, 1]], ["wavelength", [550]]]);
    const request: ProbeRequest = { store: 0, slice: "s", select: ["y=0", "t=0:1"], sum: [] };
    expect(keeping(request, of, ["x", "wavelength"]).sum).toEqual(["v", "u", "t"]);
    const pattern = { width: 1, height: 1, values: new Float32Array(1) };
    expect(keeping({ ...request, pattern }, of, ["t"]).sum).toEqual(["x", "wavelength"]);
  });
});

describe("toSlice", () => {
  it("keeps the position of the pixel", () => {
    const from = slice("image", [["y", [0, 1, 2, 3]], ["x", [0, 1, 2, 3]]]);
    const to = slice("binned", [["y", [0.5, 2.5]], ["x", [0.5, 2.5]]]);
    const change = toSlice({ ...initialState, pixel: [3, 1], quantity: "dolp" }, from, to);
    expect(change).toMatchObject({ slice: "binned", pixel: [1, 0], quantity: "colour", time: null });
    expect(nearest([0, 10, 20], 12)).toBe(1);
  });
});

describe("remaining", () => {
  it("uses the mean rate since the page opened", () => {
    const point = (seconds: number, tilesDone: number) => ({ seconds, tilesDone, error: null });
    expect(remaining([point(0, 10), point(10, 20)], 50)).toBe(30);
    expect(remaining([point(0, 10)], 50)).toBeNull();
  });
});
