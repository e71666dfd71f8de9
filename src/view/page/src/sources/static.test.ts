/** Compares the answers of a static export with those of `sunstone probe`. `fixture/make.py` writes the expected values. */

import { beforeEach, describe, expect, test, vi } from "vitest";
import type { Description, ImageResult, Labelled } from "../model";
import json from "./fixture/fixture.json";
import { SourceError, type ImageRequest, type Pattern, type ProbeRequest, type Source } from "./source";
import { StaticSource } from "./static";

interface Query {
  slice: string;
  select?: string[];
  sum?: string[];
  stokes?: string;
  pulse?: string;
  pattern?: boolean;
}

interface Fixture {
  description: Description;
  files: Record<string, string>;
  pattern: { width: number; height: number; values: number[] };
  answers: (Query & { axes: string[]; mean: number[]; std_error: number[]; notes: string[] })[];
  refusals: (Query & { message: string })[];
}

const fixture = json as unknown as Fixture;
const pattern: Pattern = { ...fixture.pattern, values: Float32Array.from(fixture.pattern.values) };

/** Names of the requested files, in order, and the largest number of requests at a time. */
let requested: string[] = [];
let most = 0;

/** Serves the files of the fixture at a new address. `alter` changes the bytes of a file. */
let served = 0;
function serve({ ranges = true, alter = (_: string, bytes: Uint8Array): Uint8Array | null => bytes } = {}): Source {
  served += 1;
  const base = `http://example.test/${served}/`;
  let open = 0;
  vi.stubGlobal("fetch", async (url: string, options: RequestInit) => {
    open += 1;
    most = Math.max(most, open);
    await new Promise((resolve) => setTimeout(resolve, 1));
    open -= 1;
    options.signal?.throwIfAborted();
    const path = url.slice(base.length);
    requested.push(path);
    const all = fileOf(path);
    const bytes = all && alter(path, all);
    if (!bytes) return new Response(null, { status: 404 });
    const range = ranges && /^bytes=(\d+)-(\d*)$/.exec((options.headers as Record<string, string>).Range ?? "");
    if (!range) return new Response(Uint8Array.from(bytes), { status: 200 });
    const part = bytes.slice(Number(range[1]), range[2] === "" ? undefined : Number(range[2]) + 1);
    return new Response(part, { status: 206 });
  });
  return new StaticSource(base);
}

function fileOf(path: string): Uint8Array | null {
  if (path === "describe.json") return new TextEncoder().encode(JSON.stringify(fixture.description));
  const text = fixture.files[path.replace(/^0\//, "")];
  if (text === undefined) return null;
  if (/c[.\d]+$/.test(path)) return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new TextEncoder().encode(text);
}

const requestOf = (query: Query): ProbeRequest => ({
  store: 0,
  slice: query.slice,
  select: query.select ?? [],
  sum: query.sum ?? [],
  stokes: query.stokes,
  pulse: query.pulse,
  pattern: query.pattern ? pattern : undefined,
});

const nameOf = (query: Query): string => {
  const { slice, select, sum, stokes, pulse, pattern: lit } = query;
  return [slice, ...(select ?? []), sum && `sum ${sum}`, stokes, pulse, lit && "pattern"].filter(Boolean).join(" ");
};

/** Expects equal numbers within a relative difference of 1e-6. */
function expectEqual(found: Float32Array | null, expected: number[]): void {
  expect(found?.length).toBe(expected.length);
  expected.forEach((value, i) => expect(Math.abs(found![i] - value), `value ${i}`).toBeLessThanOrEqual(1e-6 * Math.abs(value)));
}

async function lastOf(images: AsyncIterable<ImageResult>): Promise<ImageResult> {
  let last: ImageResult | undefined;
  for await (const image of images) last = image;
  return last!;
}

const imageOf = (change: Partial<ImageRequest>): ImageRequest =>
  ({ store: 0, slice: "image", select: [], sum: [], time: false, errors: true, limit: 1e6, ...change });

beforeEach(() => {
  requested = [];
  most = 0;
});

describe("probe", () => {
  for (const query of fixture.answers) {
    test(nameOf(query), async () => {
      for (const ranges of [true, false]) {
        const result = await serve({ ranges }).probe(requestOf(query));
        expect(result.axes.map((axis) => axis.kind)).toEqual(query.axes);
        expectEqual(result.mean, query.mean);
        expectEqual(result.stdError, query.std_error);
        expect(result.notes).toEqual(query.notes);
      }
    });
  }

  for (const query of fixture.refusals) {
    test(`refused: ${nameOf(query)}`, async () => {
      const error = await serve().probe(requestOf(query)).then(() => null, (reason: unknown) => reason);
      expect(error).toBeInstanceOf(SourceError);
      // The command adds `error:` and, for words of options, the name of the option.
      expect(query.message).toContain((error as Error).message);
    });
  }
});

describe("image", () => {
  const select = (result: Labelled, from: number, length: number): number[] => Array.from(result.mean.subarray(from, from + length));

  test("an image equals the probe that keeps y and x", async () => {
    const source = serve();
    const probe = await source.probe(requestOf({ slice: "full", sum: ["v", "u", "t"] }));
    const image = await lastOf(source.image(imageOf({ slice: "full" })));
    expect(image.axes).toEqual(probe.axes);
    expect(image.region).toEqual([0, 5, 0, 6]);
    expect([image.bin, image.done]).toEqual([1, 1]);
    expectEqual(image.mean, Array.from(probe.mean));
    expectEqual(image.stdError, Array.from(probe.stdError!));
    expect(image.notes).toEqual(probe.notes);
  });

  test("a region of an image keeps the time axis", async () => {
    const source = serve();
    const words = { slice: "full", select: ["wavelength=550", "y=1:3", "x=2:4"], sum: ["v", "u"], pulse: "gaussian:900" };
    const probe = await source.probe(requestOf(words));
    const image = await lastOf(source.image(imageOf({
      ...words, sum: [], select: ["wavelength=550"], region: [1, 4, 2, 5], time: true, errors: false,
    })));
    expect(image.axes).toEqual(probe.axes);
    expectEqual(image.mean, Array.from(probe.mean));
    expect(image.stdError).toBeNull();
  });

  test("weights contract both Stokes axes", async () => {
    const source = serve();
    const [input, output]: [number, number, number, number][] = [[1, 0.5, -2, 0], [0.5, 0, 0.5, 0.25]];
    const matrices = await lastOf(source.image(imageOf({})));
    const image = await lastOf(source.image(imageOf({ input, output })));
    expect(image.axes.map((axis) => axis.kind)).toEqual(["y", "x", "wavelength"]);
    const sums = Array.from(image.mean, (_, i) => {
      const [pixel, wavelength] = [Math.floor(i / 2), i % 2];
      const m = (row: number, column: number): number => matrices.mean[((pixel * 4 + row) * 4 + column) * 2 + wavelength];
      return output.reduce((sum, a, row) => sum + a * input.reduce((s, b, column) => s + b * m(row, column), 0), 0);
    });
    sums.forEach((sum, i) => expect(image.mean[i]).toBeCloseTo(sum, 6));
  });

  test("bins average the entries that they have", async () => {
    const source = serve();
    const whole = await lastOf(source.image(imageOf({ output: [1, 0, 0, 0], input: [1, 0, 0, 0] })));
    // 5 x 6 pixels with 2 wavelengths: 2 x 2 bins of 4 pixels have 8 values.
    const image = await lastOf(source.image(imageOf({ output: [1, 0, 0, 0], input: [1, 0, 0, 0], limit: 8 })));
    expect(image.bin).toBe(4);
    expect(image.axes.slice(0, 2).map((axis) => axis.coords)).toEqual([[1.5, 4], [1.5, 4.5]]);
    const corner = [4, 5].map((x) => (4 * 6 + x) * 2);
    const mean = corner.map((i) => whole.mean[i]).reduce((a, b) => a + b) / 2;
    const error = Math.hypot(...corner.map((i) => whole.stdError![i])) / 2;
    expectEqual(image.mean.subarray(6, 7), [mean]);
    expectEqual(image.stdError!.subarray(6, 7), [error]);
    const first = whole.axes[0].coords.slice(0, 4).flatMap((y) => [0, 1, 2, 3].map((x) => select(whole, (y * 6 + x) * 2, 1)[0]));
    expect(image.mean[0]).toBeCloseTo(first.reduce((a, b) => a + b) / 16, 6);
  });

  test("requests that make no sense are refused", async () => {
    const source = serve();
    for (const change of [
      { region: [0, 6, 0, 6] as [number, number, number, number] }, { limit: 1 }, { select: ["y=1"] },
      { slice: "blocks", input: [1, 1, 0, 0] as [number, number, number, number] },
    ]) {
      await expect(lastOf(source.image(imageOf(change)))).rejects.toBeInstanceOf(SourceError);
    }
  });
});

describe("files", () => {
  const query = requestOf({ slice: "image", sum: ["y", "x"] });
  const failure = async (alter: (path: string, bytes: Uint8Array) => Uint8Array | null, ranges: boolean): Promise<string> => {
    const error = await serve({ ranges, alter }).probe(query).then(() => null, (reason: unknown) => reason);
    expect(error).toBeInstanceOf(SourceError);
    return (error as Error).message;
  };

  test("without ranges, every file is requested once", async () => {
    const source = serve({ ranges: false });
    await source.probe(query);
    await source.probe({ ...query, sum: [] });
    expect(requested.length).toBe(new Set(requested).size);
  });

  test("at most six requests run at a time", async () => {
    const source = serve();
    await Promise.all(["full", "blocks", "image"].flatMap((slice) => [["y"], ["x"]].map((sum) => source.probe({ ...query, slice, sum }))));
    expect(most).toBeLessThanOrEqual(6);
    expect(most).toBeGreaterThan(2);
  });

  test("absent chunks are zero and are not requested", async () => {
    const name = fixture.description.stores[0].slices[0].name;
    expect(name).toBe("full");
    await serve().probe(requestOf({ slice: "full", select: ["y=0", "x=0"] }));
    expect(requested.filter((path) => fileOf(path) === null)).toEqual([]);
  });

  for (const ranges of [true, false]) {
    test(`damage is reported with the name of the file, ${ranges ? "with" : "without"} ranges`, async () => {
      const shard = "0/image/mean/c.0.0.0.0.0";
      const changed = (path: string, change: (bytes: Uint8Array) => Uint8Array | null) =>
        failure((p, bytes) => (p === path ? change(bytes) : bytes), ranges);
      const flipped = (at: number) => (bytes: Uint8Array): Uint8Array => {
        const copy = bytes.slice();
        copy.set([copy.at(at)! ^ 1], at < 0 ? copy.length + at : at);
        return copy;
      };
      expect(await changed(shard, flipped(9))).toContain("0/image/mean: checksum mismatch");
      expect(await changed(shard, flipped(-9))).toContain("0/image/mean: checksum mismatch");
      expect(await changed(shard, (bytes) => bytes.slice(0, -7))).toContain(`${shard}: the file`);
      expect(await changed(shard, () => null)).toContain(`${shard}: the file is missing`);
      expect(await changed("0/image/mean/zarr.json", flipped(30))).toContain("0/image/mean/zarr.json: checksum mismatch");
      expect(await changed("0/manifest.txt", flipped(50))).toContain("0/manifest.txt: checksum mismatch");
      expect(await changed("0/manifest.txt", () => null)).toContain("0/manifest.txt: the file is missing");
      expect(await changed("describe.json", () => new Uint8Array(3))).toContain("describe.json: the file is not valid JSON");
    });
  }

  test("a cancelled query does not disturb the others", async () => {
    const source = serve();
    const control = new AbortController();
    const cancelled = source.probe(query, control.signal);
    const other = source.probe(query);
    setTimeout(() => control.abort(), 4);
    await expect(cancelled).rejects.toMatchObject({ name: "AbortError" });
    expect((await other).mean.length).toBe(32);
  });

  test("captures and trials need the program", async () => {
    const source = serve();
    expect(await source.progress(0)).toBeNull();
    await expect(source.frame(0, [0])).rejects.toThrow("sunstone view");
    await expect(source.trial({} as never)).rejects.toThrow("no program behind it");
  });
});
