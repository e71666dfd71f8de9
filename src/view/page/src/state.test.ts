import { describe, expect, it } from "vitest";
import type { Description, Slice } from "./model";
import { fromHash, initialState, toHash, type ViewState } from "./state";
import { firstSlice, isStokes, validated } from "./validate";

const axis = (kind: "y" | "x" | "t" | "stokes_out" | "stokes_in" | "wavelength", n: number) =>
  ({ kind, units: "1", coords: Array.from({ length: n }, (_, i) => i) });
const image: Slice = { name: "image", axes: [axis("y", 8), axis("x", 9), axis("wavelength", 3)], attributes: {} };
const matrices: Slice = {
  name: "matrices", axes: [axis("y", 8), axis("x", 9), axis("stokes_out", 4), axis("stokes_in", 4), axis("wavelength", 3)], attributes: {},
};
const xt: Slice = { name: "xt", axes: [axis("y", 1), axis("x", 9), axis("t", 20), axis("wavelength", 3)], attributes: {} };
const pinhole = {
  resolution: [9, 8] as [number, number], focal_px: [9, 9] as [number, number], principal_px: [4, 4] as [number, number],
  origin_m: [0, 0, 0] as [number, number, number], right: [1, 0, 0] as [number, number, number],
  down: [0, 1, 0] as [number, number, number], forward: [0, 0, 1] as [number, number, number],
};
const open: Description = {
  version: "1", isStatic: false, valueUnits: "W",
  stores: [{
    id: 0, name: "a", path: "a", kind: "tensor", finished: true, attributes: { camera: pinhole, projector: pinhole },
    slices: [image, xt, matrices],
  }],
};

const full: ViewState = {
  ...initialState, slice: "matrices", compare: { store: 0, slice: "image", mode: "split" }, quantity: "element", row: 1, column: 3,
  normalized: false, wavelength: 2, exposure: -1.5, scale: "symlog", look: { y: 3.5, x: 4.25, zoom: 12 }, pixel: [7, 8],
  illumination: { kind: "drawn", width: 2, height: 1, digits: "90" }, input: [1, 0.5, 0, -0.5], analyzer: [1, 0, 1, 0], pulse: 50,
  select: { bounces: 3 }, panels: { ...initialState.panels, captures: true }, theme: "dark",
};

describe("the state in the URL", () => {
  it("comes back unchanged", () => {
    for (const view of [initialState, full]) {
      const { view: read, ignored } = fromHash(`#${toHash(view)}`);
      expect(read).toEqual(view);
      expect(ignored).toEqual([]);
    }
    expect(toHash(initialState)).toBe("");
    expect(validated(full, open)).toEqual({ view: full, replaced: [] });
  });

  it("survives parts that are unknown, malformed or do not fit", () => {
    const { view, ignored } = fromHash('#row=2&nonsense=1&exposure=[&slice="gone"&pixel=[100,0]&time=3&theme="pink"&input=[1,1,1,1]');
    expect(ignored.sort()).toEqual(["exposure", "nonsense"]);
    const { view: valid, replaced } = validated(view, open);
    expect(replaced.sort()).toEqual(["input", "pixel", "slice", "theme", "time"]);
    expect(valid).toEqual({ ...initialState, row: 2, slice: "matrices" });
  });

  it("replaces every field that has a wrong type", () => {
    for (const key of Object.keys(initialState) as (keyof ViewState)[]) {
      for (const wrong of [{ a: { b: 1 } }, "wrong", -7.5, [1], true]) {
        const { view, replaced } = validated({ ...full, [key]: wrong } as ViewState, open);
        if (replaced.length === 0) expect(["normalized", "unwarp", "exposure"]).toContain(key);
        expect(validated(view, open).replaced).toEqual([]);
      }
    }
  });

  it("accepts time only where the slice resolves it", () => {
    expect(validated({ ...initialState, slice: "xt", time: 19, gate: [2, 19] }, open).replaced).toEqual([]);
    expect(validated({ ...initialState, slice: "xt", time: 20, gate: [5, 2] }, open).replaced).toEqual(["time", "gate"]);
  });

  it("chooses the first image with matrices", () => {
    expect(firstSlice(open.stores[0])?.name).toBe("matrices");
    expect(firstSlice({ ...open.stores[0], slices: [xt, image] })?.name).toBe("image");
    expect(firstSlice({ ...open.stores[0], slices: [] })).toBeUndefined();
  });

  it("works without stores", () => {
    expect(validated(initialState, { ...open, stores: [] }).view.slice).toBe("");
  });

  it("accepts physical Stokes vectors only", () => {
    expect(isStokes([1, 0.7071068, -0.7071068, 0])).toBe(true);
    for (const bad of [[0, 0, 0, 0], [1, 1, 1, 0], [1, 0, 0], ["1", 0, 0, 0], [1, NaN, 0, 0]]) expect(isStokes(bad)).toBe(false);
  });
});
