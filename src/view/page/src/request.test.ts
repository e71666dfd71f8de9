import { describe, expect, it } from "vitest";
import { AXES, type AxisKind, type Slice, type Store } from "./model";
import {
  baseProbe, command, figureCommand, illuminationPattern, imageRequest, movieRequest, pixelProbe, python, queryProbe, stokesWord,
} from "./request";
import { initialState, type ViewState } from "./state";

const range = (n: number, by = 1, from = 0): number[] => Array.from({ length: n }, (_, i) => from + i * by);

function sliceOf(name: string, coords: Partial<Record<AxisKind, number[]>>): Slice {
  const axes = AXES.filter((kind) => coords[kind]).map((kind) => ({ kind, units: "1", coords: coords[kind]! }));
  return { name, axes, attributes: {} };
}

const mueller = { stokes_out: range(4), stokes_in: range(4), wavelength: [450, 550, 660] };
const xt = sliceOf("xt", { y: [150], x: range(256), t: range(640, 25, 13012.5), ...mueller });
const ss = sliceOf("ss", { y: range(8), x: range(8), v: range(6), u: range(8), ...mueller });
const polarimetric = sliceOf("polarimetric", { y: range(4), x: range(4), ...mueller });
const bounces = sliceOf("bounces", {
  y: range(4, 2, 0.5), x: range(4, 2, 0.5), bounces: range(12, 1, 1), component: [0, 1], wavelength: [635],
});
const projector = {
  resolution: [8, 6], focal_px: [10, 10], principal_px: [4, 3], origin_m: [1, 0, 0], right: [1, 0, 0], down: [0, -1, 0],
  forward: [0, 0, -1],
} as const;
const store = {
  id: 0, name: "room.zarr", path: "out/room.zarr", kind: "tensor", finished: true, attributes: { projector: structuredClone(projector) },
  slices: [xt, ss, polarimetric, bounces],
} as unknown as Store;

const of = (change: Partial<ViewState>): ViewState => ({ ...initialState, ...change });

describe("requests", () => {
  it("selects the time bin, or the gate, by coordinates", () => {
    expect(baseProbe(of({ time: 2 }), store, xt).select).toEqual(["t=13062.5"]);
    expect(baseProbe(of({ gate: [1, 4] }), store, xt).select).toEqual(["t=13037.5:13112.5"]);
    expect(baseProbe(of({ time: 9999 }), store, xt).select).toEqual(["t=28987.5"]);
    expect(baseProbe(of({ time: 2, pulse: 50 }), store, polarimetric)).toEqual({ store: 0, slice: "polarimetric", select: [], sum: [] });
  });

  it("selects the pixel and further axes", () => {
    const view = of({ pixel: [1, 3], select: { bounces: 2, label: 1 } });
    expect(pixelProbe(view, store, bounces).select).toEqual(["y=2.5", "x=6.5", "bounces=2"]);
  });

  it("keeps matrices in images, and contracts movies", () => {
    const image = imageRequest(of({ pulse: 50 }), store, xt, [0, 1, 4, 9]);
    expect(image).toMatchObject({ pulse: "gaussian:50", time: false, errors: true, region: [0, 1, 4, 9] });
    expect(image.input ?? image.output).toBeUndefined();
    const analyzed = movieRequest(of({ time: 3, input: [1, 1, 0, 0], analyzer: [1, 0, 1, 0] }), store, xt);
    expect(analyzed).toMatchObject({ select: [], time: true, input: [1, 1, 0, 0], output: [0.5, 0, 0.5, 0] });
    const element = movieRequest(of({ quantity: "element", row: 2, column: 1 }), store, xt);
    expect(element).toMatchObject({ output: [0, 0, 1, 0], input: [0, 1, 0, 0] });
  });

  it("applies an illumination only where the slice resolves projector pixels", () => {
    const view = of({ illumination: { kind: "row", v: 2 } });
    expect(baseProbe(view, store, xt).pattern).toBeUndefined();
    const pattern = baseProbe(view, store, ss).pattern!;
    expect([pattern.width, pattern.height]).toEqual([8, 6]);
    expect([...pattern.values].map((drive, i) => (drive ? i : -1)).filter((i) => i >= 0)).toEqual(range(8, 1, 16));
  });
});

describe("illuminations", () => {
  const lit = (view: ViewState["illumination"]): number[] =>
    [...illuminationPattern(view, store)!.values].flatMap((drive, i) => (drive > 0 ? [i] : []));

  it("lights a pixel and a column", () => {
    expect(lit({ kind: "pixel", v: 1, u: 3 })).toEqual([11]);
    expect(lit({ kind: "column", u: 7 })).toEqual(range(6, 8, 7));
    expect(illuminationPattern({ kind: "all" }, store)).toBeUndefined();
  });

  it("draws blocks whose drives an image of 8 bits can hold", () => {
    const { values } = illuminationPattern({ kind: "drawn", width: 2, height: 2, digits: "0904" }, store)!;
    expect([values[0], values[4], values[3 * 8 + 0], values[3 * 8 + 7]].map((v) => v * 255).map(Math.round)).toEqual([0, 255, 0, 113]);
    for (const value of values) expect(Math.fround(Math.round(value * 255) / 255)).toBe(value);
  });
});

describe("commands", () => {
  it("writes the query of a pixel", () => {
    const view = of({ pixel: [0, 180], gate: [1, 4], pulse: 50 });
    expect(command(queryProbe("matrix", view, store, xt), store, null)).toBe(
      "sunstone probe out/room.zarr xt --select y=150 --select x=180 --select t=13037.5:13112.5 --pulse gaussian:50 --sum t --csv -",
    );
    expect(python(queryProbe("matrix", view, store, xt), store)).toBe([
      "import pysunstone as ps",
      'light = ps.open_store("out/room.zarr")["xt"].sunstone.probe(pulse=50)',
      'print(light.sel(y=150, x=180, method="nearest").sel(t=slice(13037.5, 13112.5)).sunstone.probe(sum=["t"])["mean"].values)',
    ].join("\n"));
  });

  it("keeps time in a profile, and contracts a state", () => {
    const view = of({ pixel: [0, 180], time: 7, input: [1, 0.5, -0.25, 0] });
    expect(command(queryProbe("profile", view, store, xt), store, null)).toBe(
      "sunstone probe out/room.zarr xt --select y=150 --select x=180 --csv -",
    );
    expect(command(queryProbe("stokes", view, store, xt), store, null)).toBe(
      "sunstone probe out/room.zarr xt --select y=150 --select x=180 --select t=13187.5 --stokes 1,0.5,-0.25,0 --csv -",
    );
    expect(python(queryProbe("stokes", view, store, xt), store)).toContain("probe(state=[1, 0.5, -0.25, 0])");
  });

  it("writes an image, a pattern, and an unfinished store", () => {
    const view = of({ illumination: { kind: "pixel", v: 0, u: 0 } });
    const words = command(queryProbe("image", view, store, ss), { ...store, finished: false, path: "my room's.zarr" }, "ss.npy");
    expect(words).toBe("sunstone probe 'my room'\\''s.zarr' ss --partial --pattern pattern.png -o ss.npy");
    const all = command(queryProbe("image", of({ select: { component: 1 } }), store, bounces), store, "b.npy");
    expect(all).toBe("sunstone probe out/room.zarr bounces --select component=1 --sum bounces -o b.npy");
    expect(python(queryProbe("image", view, store, ss), store)).toContain('probe(pattern=plt.imread("pattern.png"))');
    expect(command(queryProbe("image", initialState, store, ss), store, "ss.npy")).toContain("--sum v,u");
  });

  it("draws the photograph and the grid", () => {
    expect(figureCommand(initialState, store, polarimetric, 0.5)).toBe(
      "sunstone figure out/room.zarr --view photo --slice polarimetric -o polarimetric.png",
    );
    expect(figureCommand(of({ exposure: 1 }), store, polarimetric, 0.25)).toContain("--limit 0.25");
    expect(figureCommand(of({ quantity: "grid", wavelength: 1, normalized: false }), store, polarimetric, 0)).toBe(
      "sunstone figure out/room.zarr --view mueller --slice polarimetric --scale arctan --wavelength 550 --raw -o polarimetric.png",
    );
    expect(figureCommand(of({ time: 3 }), store, xt, 1)).toBeNull();
    expect(figureCommand(of({ analyzer: [1, 1, 0, 0] }), store, polarimetric, 1)).toBeNull();
  });

  it("names states", () => {
    expect(stokesWord([1, 0, 0, 0])).toBe("unpolarized");
    expect(stokesWord([1, -0, 0, -1])).toBe("left");
    expect(stokesWord([1, 0.6, 0, 0.8])).toBe("1,0.6,0,0.8");
  });
});
