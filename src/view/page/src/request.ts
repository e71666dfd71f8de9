/** Requests for what the view shows, and the same requests as a command and as Python. All functions are pure. */

import { type Axis, type AxisKind, type Slice, type Store, axisOf, isPolarized } from "./model";
import type { Illumination, Stokes, ViewState } from "./state";
import { epipolarLine } from "./geometry";
import type { ImageRequest, Pattern, ProbeRequest } from "./sources/source";

/** Maximum number of values per field of an image. */
export const LIMIT = 2 ** 24;

/** File of the pattern in commands. */
export const PATTERN_FILE = "pattern.png";

const CAMERA: readonly AxisKind[] = ["y", "x"];
const FURTHER: readonly AxisKind[] = ["bounces", "component", "label"];
/** Axes that images and panels keep unless they say otherwise. */
const MATRIX: readonly AxisKind[] = ["stokes_out", "stokes_in", "wavelength"];

const clamp = (index: number, axis: Axis): number => Math.max(0, Math.min(axis.coords.length - 1, Math.round(index)));

/** Returns whether a slice resolves projector pixels, so that an illumination changes it. */
export const resolvesProjector = (slice: Slice): boolean => axisOf(slice, "v") !== undefined && axisOf(slice, "u") !== undefined;

/**
 * Returns the drive of every projector pixel, or undefined if all pixels are on. Drives are multiples of 1/255, so that an image
 * file with 8 bits holds them exactly.
 */
export function illuminationPattern(illumination: Illumination, store: Store): Pattern | undefined {
  const { camera, projector } = store.attributes;
  if (illumination.kind === "all" || !projector) return undefined;
  const [width, height] = projector.resolution;
  if (illumination.kind === "epipolar") {
    return camera ? epipolarLine(camera, projector, illumination.y, illumination.x) : undefined;
  }
  const values = new Float32Array(width * height);
  if (illumination.kind === "pixel") {
    const isInside = illumination.v >= 0 && illumination.v < height && illumination.u >= 0 && illumination.u < width;
    if (isInside) values[illumination.v * width + illumination.u] = 1;
  } else if (illumination.kind === "row") {
    values.fill(1, illumination.v * width, (illumination.v + 1) * width);
  } else if (illumination.kind === "column") {
    if (illumination.u < width) for (let v = 0; v < height; v++) values[v * width + illumination.u] = 1;
  } else {
    const { width: columns, height: rows, digits } = illumination;
    for (let v = 0; v < height; v++) {
      for (let u = 0; u < width; u++) {
        const digit = digits[Math.floor((v * rows) / height) * columns + Math.floor((u * columns) / width)];
        values[v * width + u] = Math.round((Number(digit ?? 0) / 9) * 255) / 255;
      }
    }
  }
  return { width, height, values };
}

/** Returns the selection words of the view: further axes, and the time bin or the gate. */
function selection(view: ViewState, slice: Slice): string[] {
  const words: string[] = [];
  const t = axisOf(slice, "t");
  if (t && view.time !== null) words.push(`t=${t.coords[clamp(view.time, t)]}`);
  else if (t && view.gate) words.push(`t=${t.coords[clamp(view.gate[0], t)]}:${t.coords[clamp(view.gate[1], t)]}`);
  for (const kind of FURTHER) {
    const value = view.select[kind];
    if (value !== undefined && axisOf(slice, kind)) words.push(`${kind}=${value}`);
  }
  return words;
}

/** Returns the request of the view's illumination, pulse, time and `select`. It keeps all other axes and sums over none. */
export function baseProbe(view: ViewState, store: Store, slice: Slice): ProbeRequest {
  const request: ProbeRequest = { store: store.id, slice: slice.name, select: selection(view, slice), sum: [] };
  const pattern = resolvesProjector(slice) ? illuminationPattern(view.illumination, store) : undefined;
  if (pattern) request.pattern = pattern;
  if (view.pulse !== null && axisOf(slice, "t")) request.pulse = `gaussian:${view.pulse}`;
  return request;
}

/** Returns [`baseProbe`] for the chosen pixel, or for the first pixel if none is chosen. */
export function pixelProbe(view: ViewState, store: Store, slice: Slice): ProbeRequest {
  const request = baseProbe(view, store, slice);
  const words = CAMERA.flatMap((kind, i) => {
    const axis = axisOf(slice, kind);
    return axis ? [`${kind}=${axis.coords[clamp(view.pixel?.[i] ?? 0, axis)]}`] : [];
  });
  return { ...request, select: [...words, ...request.select] };
}

/** Returns the request for the Mueller image that the view shows. */
export function imageRequest(view: ViewState, store: Store, slice: Slice, region?: ImageRequest["region"]): ImageRequest {
  const request: ImageRequest = { ...baseProbe(view, store, slice), time: false, errors: true, limit: LIMIT };
  if (region) request.region = region;
  return request;
}

const unit = (i: number): Stokes => [0, 1, 2, 3].map((k) => (k === i ? 1 : 0)) as Stokes;

/** Returns the request for the image of every time bin: an element, or otherwise the intensity for the input state and the analyzer. */
export function movieRequest(view: ViewState, store: Store, slice: Slice): ImageRequest {
  const request: ImageRequest = {
    ...baseProbe({ ...view, time: null, gate: null }, store, slice), time: true, errors: false, limit: LIMIT,
  };
  if (!isPolarized(slice)) return request;
  if (view.quantity === "element") return { ...request, input: unit(view.column), output: unit(view.row) };
  const output: Stokes = view.analyzer ? (view.analyzer.map((a) => a / 2) as Stokes) : unit(0);
  return { ...request, input: view.input, output };
}

/** Returns the request for the light of all pixels together over time: M00, or S0 for the input state. */
export function totalLightProbe(view: ViewState, store: Store, slice: Slice): ProbeRequest {
  const request = baseProbe({ ...view, time: null, gate: null }, store, slice);
  const sum = slice.axes.map((axis) => axis.kind).filter((kind) => kind !== "t" && !MATRIX.includes(kind));
  if (!isPolarized(slice)) return { ...request, sum: [...sum, "wavelength"] };
  const whole: ProbeRequest = { ...request, sum: [...sum, "wavelength"] };
  // One element is read faster than a row of the matrix.
  if (!isPolarizedState(view.input)) return { ...whole, select: [...request.select, "stokes_out=0", "stokes_in=0"] };
  return { ...whole, select: [...request.select, "stokes_out=0"], stokes: stokesWord(view.input) };
}

const isPolarizedState = ([, s1, s2, s3]: Stokes): boolean => s1 !== 0 || s2 !== 0 || s3 !== 0;

/** Whether the view shows only M00 of a slice with Mueller matrices, so that the other elements are not needed at once. */
export const showsM00 = (view: ViewState): boolean =>
  (view.quantity === "colour" || view.quantity === "intensity") && !isPolarizedState(view.input) && view.analyzer === null;

/** What a command returns. */
export type Query = "matrix" | "profile" | "stokes" | "image";

/** Returns the request of a query that `sunstone probe` answers with the numbers that the panels show. */
export function queryProbe(query: Query, view: ViewState, store: Store, slice: Slice): ProbeRequest {
  const ofTime = query === "profile" ? { ...view, time: null, gate: null } : view;
  const request = query === "image" ? baseProbe(view, store, slice) : pixelProbe(ofTime, store, slice);
  const kept: readonly AxisKind[] = [...MATRIX, ...(query === "image" ? CAMERA : []), ...(query === "profile" ? ["t" as const] : [])];
  const single = new Set(request.select.filter((word) => !word.includes(":")).map((word) => word.split("=")[0]));
  const byPattern = (kind: AxisKind): boolean => request.pattern !== undefined && (kind === "v" || kind === "u");
  const sum = slice.axes.map((axis) => axis.kind).filter((kind) => !kept.includes(kind) && !single.has(kind) && !byPattern(kind));
  const result: ProbeRequest = { ...request, sum };
  if (query === "stokes" && isPolarized(slice)) result.stokes = stokesWord(view.input);
  return result;
}

const NAMED: Record<string, string> = {
  "1,0,0,0": "unpolarized",
  "1,1,0,0": "horizontal",
  "1,-1,0,0": "vertical",
  "1,0,1,0": "plus45",
  "1,0,-1,0": "minus45",
  "1,0,0,1": "right",
  "1,0,0,-1": "left",
};

/** Returns a Stokes vector as a word of `--stokes`: a name or four numbers. */
export function stokesWord(stokes: Stokes): string {
  const text = stokes.map((s) => Number(s.toFixed(7))).map((s) => (s === 0 ? 0 : s)).join(",");
  return NAMED[text] ?? text;
}

/** Quotes a word for a POSIX shell. */
const quoted = (word: string): string => (/^[\w./:@%+=,-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

/** Returns a path as a word of a command line that is not read as an option. */
const path = (text: string): string => quoted(text.startsWith("-") ? `./${text}` : text);

/** Returns a request as a command line of `sunstone probe`. `output` is a file, or null to print CSV. */
export function command(request: ProbeRequest, store: Store, output: string | null): string {
  const words = ["sunstone probe", path(store.path), quoted(request.slice)];
  if (!store.finished) words.push("--partial");
  for (const word of request.select) words.push(`--select ${quoted(word)}`);
  if (request.pattern) words.push(`--pattern ${PATTERN_FILE}`);
  if (request.stokes) words.push(`--stokes ${quoted(request.stokes)}`);
  if (request.pulse) words.push(`--pulse ${quoted(request.pulse)}`);
  if (request.sum.length > 0) words.push(`--sum ${request.sum.join(",")}`);
  words.push(output === null ? "--csv -" : `-o ${quoted(output)}`);
  return words.join(" ");
}

/**
 * Returns the command line of `sunstone figure` that draws the shown photograph or 4 x 4 grid, or null if that command cannot draw
 * the view, because the view contracts, selects or compares.
 */
export function figureCommand(view: ViewState, store: Store, slice: Slice, white: number): string | null {
  const isWhole = baseProbe(view, store, slice).select.length === 0 && !(resolvesProjector(slice) && view.illumination.kind !== "all");
  const isUnpolarized = stokesWord(view.input) === "unpolarized" && view.analyzer === null;
  if (!isWhole || view.pulse !== null || view.compare !== null || store.kind !== "tensor") return null;
  const words = ["sunstone figure", path(store.path)];
  if (view.quantity === "colour" && view.wavelength === "all" && isUnpolarized) {
    words.push("--view photo", `--slice ${quoted(slice.name)}`);
    if (view.exposure !== 0) words.push(`--limit ${white}`);
  } else if (view.quantity === "grid" && isPolarized(slice) && view.wavelength !== "all" && view.scale !== "symlog") {
    const nm = axisOf(slice, "wavelength")?.coords[view.wavelength];
    words.push("--view mueller", `--slice ${quoted(slice.name)}`, `--scale ${view.scale}`);
    if (nm !== undefined) words.push(`--wavelength ${nm}`);
    if (!view.normalized) words.push("--raw");
  } else {
    return null;
  }
  if (!store.finished) words.push("--partial");
  return [...words, `-o ${quoted(`${slice.name}.png`)}`].join(" ");
}

/** Writes a text as a Python string. JSON strings are Python strings. */
const pythonText = (text: string): string => JSON.stringify(text);

/** Returns a word of `--stokes` as Python. */
const pythonState = (word: string): string => (/^[a-z]/.test(word) ? pythonText(word) : `[${word.replaceAll(",", ", ")}]`);

/**
 * Returns three lines of Python that give the numbers of [`command`]. The steps are in the order of the command: contraction and
 * pulse, selection, sum.
 */
export function python(request: ProbeRequest, store: Store): string {
  const steps: string[] = [];
  if (request.pattern) steps.push(`pattern=plt.imread(${pythonText(PATTERN_FILE)})`);
  if (request.stokes) steps.push(`state=${pythonState(request.stokes)}`);
  if (request.pulse) steps.push(`pulse=${request.pulse.replace("gaussian:", "")}`);
  const nearest: string[] = [];
  const ranges: string[] = [];
  for (const word of request.select) {
    const [axis, value] = word.split("=");
    if (value.includes(":")) ranges.push(`${axis}=slice(${value.replace(":", ", ")})`);
    else nearest.push(`${axis}=${value}`);
  }
  const open = [pythonText(store.path), ...(store.finished ? [] : ["unfinished=True"])].join(", ");
  const selected = [
    nearest.length > 0 ? `.sel(${nearest.join(", ")}, method="nearest")` : "",
    ranges.length > 0 ? `.sel(${ranges.join(", ")})` : "",
  ].join("");
  const sum = request.sum.length > 0 ? `.sunstone.probe(sum=[${request.sum.map(pythonText).join(", ")}])` : "";
  return [
    request.pattern ? "import matplotlib.pyplot as plt, pysunstone as ps" : "import pysunstone as ps",
    `light = ps.open_store(${open})[${pythonText(request.slice)}].sunstone.probe(${steps.join(", ")})`,
    `print(light${selected}${sum}["mean"].values)`,
  ].join("\n");
}
