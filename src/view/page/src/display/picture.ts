/** Pictures: pixels of a Mueller image as colours, one picture pixel per value, with a legend and the numbers behind the colours. */

import { type ImageResult, lengthOf, isPolarized } from "../model";
import type { ViewState } from "../state";
import { quantityMap, type QuantityMap } from "../math/maps";
import { white } from "./colour";
import { diverging, UNDEFINED_RGBA } from "./colourmaps";
import { legendOf, paint, type Legend } from "./legend";
import { automaticWhite, encode, isRendered, linearImage, readPixel, type Reading } from "./photograph";
import { barTicks, withError } from "./scale";

/** A picture. Pictures with the same slot share their canvas, so a picture is valid until the next one of its slot. */
export interface Picture {
  canvas: HTMLCanvasElement;
  /** The colours of the canvas, little-endian RGBA. */
  rgba: Uint32Array;
  /** Whether some values are not rendered. */
  hasMissing: boolean;
  /** Values along y and x. The canvas of a grid is larger. */
  height: number;
  width: number;
  /** The part of the slice, and the entries that one value averages. */
  region: ImageResult["region"];
  bin: number;
  /** Distance of the cells of a 4 x 4 grid in canvas pixels, or 0 for a single image. */
  cellHeight: number;
  cellWidth: number;
  /** Null for colours. */
  legend: Legend | null;
  /** The value that is shown as white, for colours. */
  white: number | null;
  /** The numbers of one value: the wavelengths of a photograph, or the quantity. `element` is a cell of the grid. */
  read(index: number, element: [number, number] | null): Reading[];
  title: string;
}

interface Slot {
  canvas: HTMLCanvasElement;
  context: CanvasRenderingContext2D;
  data: ImageData;
  rgba: Uint32Array;
}

const slots = new Map<string, Slot>();

/** Returns the canvas of a slot with the given size. */
function slotOf(name: string, width: number, height: number): Slot {
  let slot = slots.get(name);
  if (!slot || slot.data.width !== width || slot.data.height !== height) {
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d")!;
    const data = context.createImageData(width, height);
    slot = { canvas, context, data, rgba: new Uint32Array(data.data.buffer) };
    slots.set(name, slot);
  }
  return slot;
}

/**
 * Makes the pixels that are not rendered transparent: only they are hatched. Other undefined values are grey. Returns whether there
 * are such pixels. `values` are NaN at least where the image is.
 */
function clearMissing(image: ImageResult, values: Float32Array, rgba: Uint32Array): boolean {
  let hasMissing = false;
  for (let p = 0; p < values.length; p++) {
    if (values[p] === values[p] || isRendered(image, p)) continue;
    rgba[p] = 0;
    hasMissing = true;
  }
  return hasMissing;
}

/** What to keep equal between pictures that are compared: the legend or the white level of the first. */
export interface Shared {
  legend?: Legend | null;
  white?: number | null;
}

const size = (image: ImageResult): [number, number] => [lengthOf(image, "y"), lengthOf(image, "x")];

/** Returns the picture of an image. `slot` names the canvas. */
export function pictureOf(image: ImageResult, view: ViewState, slot: string, valueUnits: string, shared: Shared = {}): Picture {
  if (view.quantity === "colour") return photograph(image, view, slot, shared.white ?? null);
  if (view.quantity === "grid" && isPolarized(image)) return grid(image, view, slot, valueUnits, shared);
  const shown: ViewState = view.quantity === "grid" ? { ...view, quantity: "element", row: 0, column: 0 } : view;
  return mapPicture(image, quantityMap(image, shown, valueUnits), shown, slot, shared.legend ?? null);
}

function photograph(image: ImageResult, view: ViewState, slot: string, level: number | null): Picture {
  const [height, width] = size(image);
  const { canvas, context, data, rgba } = slotOf(slot, width, height);
  const linear = linearImage(image, view.input, view.analyzer, view.wavelength, slot);
  const shownWhite = level ?? automaticWhite(image, view.wavelength) / 2 ** view.exposure;
  const hasMissing = encode(linear, shownWhite, rgba);
  context.putImageData(data, 0, 0);
  return {
    canvas, rgba, hasMissing, height, width, region: image.region, bin: image.bin, cellHeight: 0, cellWidth: 0, legend: null,
    white: shownWhite,
    read: (index) => {
      const all = readPixel(image, index, view.input, view.analyzer);
      return view.wavelength === "all" ? all : all.slice(view.wavelength, view.wavelength + 1);
    },
    title: view.analyzer ? "Intensity behind the analyzer" : "Intensity",
  };
}

/**
 * Returns the picture of a map. `errors` is whether the standard errors of the image are those of the map. `second` is a further
 * image that the map needs: values that it lacks are hatched too.
 */
export function mapPicture(
  image: ImageResult, map: QuantityMap, view: ViewState, slot: string, shared: Legend | null, errors = true,
  second: ImageResult | null = null,
): Picture {
  const { height, width, values } = map;
  const { canvas, context, data, rgba } = slotOf(slot, width, height);
  const legend = shared ?? legendOf(map, view);
  paint(values, width, legend, UNDEFINED_RGBA, rgba);
  const [lacksFirst, lacksSecond] = [image, second].map((of) => of !== null && clearMissing(of, values, rgba));
  const hasMissing = lacksFirst || lacksSecond;
  context.putImageData(data, 0, 0);
  return {
    canvas, rgba, hasMissing, height, width, region: image.region, bin: image.bin, cellHeight: 0, cellWidth: 0, legend,
    white: null, title: map.label,
    read: (index) => [{ label: map.label, value: values[index], error: errors ? errorOf(image, view, index) : null }],
  };
}

/** Returns the standard error of a value, where it follows directly from those of the elements. */
function errorOf(image: ImageResult, view: ViewState, index: number): number | null {
  if (!image.stdError) return null;
  if (view.quantity === "intensity") {
    const all = readPixel(image, index, view.input, view.analyzer);
    const used = view.wavelength === "all" ? all : [all[Math.min(view.wavelength, all.length - 1)]];
    return used.reduce((sum, reading) => sum + (reading.error ?? 0), 0) / used.length;
  }
  if (view.quantity !== "element") return null;
  const error = quantityMap(onePixel(image, index), { ...view, quantity: "std_error" }).values[0];
  return Number.isFinite(error) ? error : null;
}

/** Returns the image of one pixel. */
function onePixel(image: ImageResult, index: number): ImageResult {
  const [height, width] = size(image);
  const inner = image.mean.length / (height * width);
  const part = (all: Float32Array): Float32Array => all.subarray(index * inner, (index + 1) * inner);
  const axes = image.axes.map((axis) => (axis.kind === "y" || axis.kind === "x" ? { ...axis, coords: [0] } : axis));
  return { ...image, axes, mean: part(image.mean), stdError: image.stdError && part(image.stdError), region: [0, 1, 0, 1] };
}

/** Entries between the cells of a 4 x 4 grid. */
const gapOf = (width: number): number => Math.max(1, Math.round(width / 48));

/**
 * Returns the picture of all 16 elements with one scale. With `normalized`, M00 is shown relative to its 99th percentile in the
 * colours of positive values, and the other elements are divided by M00.
 */
function grid(image: ImageResult, view: ViewState, slot: string, valueUnits: string, shared: Shared): Picture {
  const [height, width] = size(image);
  const gap = gapOf(Math.max(width, height));
  const [cellHeight, cellWidth] = [height + gap, width + gap];
  const stride = 4 * cellWidth - gap;
  const { canvas, context, data, rgba } = slotOf(slot, stride, 4 * cellHeight - gap);
  const elementView = (row: number, column: number): ViewState => ({ ...view, quantity: "element", row, column });
  const first = quantityMap(image, elementView(0, 0), valueUnits);
  const limit = view.normalized ? 1 : white(first.values);
  const legend: Legend = shared.legend ?? {
    label: view.normalized ? "Mij / M00" : "Mij", unit: view.normalized ? "1" : valueUnits, map: diverging, scale: view.scale,
    low: -limit / 2 ** view.exposure, high: limit / 2 ** view.exposure,
    ticks: barTicks(-limit / 2 ** view.exposure, limit / 2 ** view.exposure, view.scale),
  };
  const maps: QuantityMap[] = [];
  for (let row = 0; row < 4; row++) {
    for (let column = 0; column < 4; column++) {
      const map = row + column === 0 ? first : quantityMap(image, elementView(row, column), valueUnits);
      maps.push(map);
      const ofCell = row + column === 0 && view.normalized ? legendOf(first, { ...view, scale: "linear" }) : legend;
      paint(map.values, width, ofCell, UNDEFINED_RGBA, rgba, row * cellHeight * stride + column * cellWidth, stride);
    }
  }
  let hasMissing = false;
  for (let p = 0; p < height * width; p++) {
    if (first.values[p] === first.values[p]) continue;
    hasMissing = true;
    const at = Math.floor(p / width) * stride + (p % width);
    for (let cell = 0; cell < 16; cell++) rgba[at + (cell >> 2) * cellHeight * stride + (cell & 3) * cellWidth] = 0;
  }
  context.putImageData(data, 0, 0);
  return {
    canvas, rgba, hasMissing, height, width, region: image.region, bin: image.bin, cellHeight, cellWidth, legend, white: null,
    title: legend.label,
    read: (index, element) => {
      const [row, column] = element ?? [view.row, view.column];
      const map = maps[4 * row + column];
      return [{ label: map.label, value: map.values[index], error: errorOf(image, elementView(row, column), index) }];
    },
  };
}

/** Returns the picture of the first image minus the second, or null if their sizes differ. */
export function differencePicture(
  a: ImageResult, b: ImageResult, view: ViewState, slot: string, valueUnits: string,
): Picture | null {
  const shown: ViewState = view.quantity === "grid" ? { ...view, quantity: "element" } : view;
  const [first, second] = [quantityMap(a, shown, valueUnits), quantityMap(b, shown, valueUnits)];
  if (first.height !== second.height || first.width !== second.width) return null;
  const values = first.values.map((value, i) => value - second.values[i]);
  if (first.kind === "cyclic") {
    const [low, high] = first.range ?? [0, 180];
    const period = high - low;
    // The shorter way around.
    for (let i = 0; i < values.length; i++) values[i] -= period * Math.round(values[i] / period);
  }
  const map: QuantityMap = { ...first, values, kind: "diverging", range: null, label: `Difference of ${first.label}` };
  return mapPicture(a, map, view, slot, null, false, b);
}

/** Returns the value of a picture as text for the status line. */
export function readingText(readings: Reading[], unit: string): string {
  return readings.map(({ label, value, error }) => {
    const number = Number.isNaN(value) ? "not defined" : withError(value, error);
    return label ? `${label}: ${number}` : number;
  }).join(", ") + (unit && unit !== "1" ? ` ${unit}` : "");
}

/** Returns the values of a picture as CSV: y, x, and one column for every wavelength of a photograph, or the quantity. */
export function pictureCsv(image: ImageResult, picture: Picture): string {
  const ys = image.axes.find((axis) => axis.kind === "y")?.coords ?? [0];
  const xs = image.axes.find((axis) => axis.kind === "x")?.coords ?? [0];
  const names = picture.read(0, null).map(({ label }) => (label || "intensity").replaceAll(",", ""));
  const lines = [["y", "x", ...names].join(",")];
  ys.forEach((y, i) => xs.forEach((x, j) => {
    lines.push([y, x, ...picture.read(i * xs.length + j, null).map(({ value }) => value)].join(","));
  }));
  return lines.join("\n") + "\n";
}
