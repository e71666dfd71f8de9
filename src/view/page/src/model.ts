/** Data that the explorer shows: stores, slices, and arrays with named axes. */

export type AxisKind =
  | "y" | "x" | "v" | "u" | "t" | "bounces" | "component" | "label" | "stokes_out" | "stokes_in" | "wavelength";

/** The order of axes in every slice and result. */
export const AXES: readonly AxisKind[] =
  ["y", "x", "v", "u", "t", "bounces", "component", "label", "stokes_out", "stokes_in", "wavelength"];

export interface Axis {
  kind: AxisKind;
  /** UDUNITS: "ps", "nm", "pixel", or "1". */
  units: string;
  coords: number[];
}

/** Values over axes, row-major (the last axis varies fastest). NaN: not rendered yet. */
export interface Labelled {
  axes: Axis[];
  mean: Float32Array;
  /** Standard errors of `mean`, if they were requested. */
  stdError: Float32Array | null;
  /** What the result leaves out, in sentences for the user. */
  notes: string[];
}

/** A part of a slice over camera pixels. */
export interface ImageResult extends Labelled {
  /** First and last-plus-one entries of y and x: [y0, y1, x0, x1]. */
  region: [number, number, number, number];
  /** Entries that one value averages, along each of y and x. */
  bin: number;
  /** Fraction of the region that has been read, 0..1. */
  done: number;
}

export interface Slice {
  name: string;
  axes: Axis[];
  /** Attributes of the group: projector_size, projector_bin, projector_selection, time_bin_ps, ... */
  attributes: Record<string, unknown>;
}

/** A pinhole device as the store describes it. Vectors are in the scene's frame. */
export interface Pinhole {
  resolution: [number, number];
  focal_px: [number, number];
  principal_px: [number, number];
  origin_m: [number, number, number];
  right: [number, number, number];
  down: [number, number, number];
  forward: [number, number, number];
  /** Brown-Conrady distortion: k1, k2, k3, p1, p2. */
  distortion?: Record<string, number>;
}

/** Progress of a render that another process writes. */
export interface Progress {
  tilesDone: number;
  tiles: number;
  finished: boolean;
}

export interface Store {
  /** Position in the list of stores; requests name a store by it. */
  id: number;
  /** File name, for titles. */
  name: string;
  /** Path as the user gave it, for commands. */
  path: string;
  kind: "tensor" | "captures";
  finished: boolean;
  /** Attributes of the root: title, camera, projector, samples_per_pixel, seeds, ... (without the scene's text). */
  attributes: Record<string, unknown> & { camera?: Pinhole; projector?: Pinhole };
  slices: Slice[];
  /** Only for captures. */
  captures?: Captures;
}

/** A store of frames that `sunstone rig run` wrote. */
export interface Captures {
  /** Axes of the run, then axes of a frame. */
  axes: { name: string; units: string; coords: number[] }[];
  runAxes: number;
  /** Numbers per frame, such as measured angles: name, unit, one number a frame. */
  columns: { name: string; units: string; values: number[] }[];
}

export interface Description {
  /** Version of Sunstone. */
  version: string;
  stores: Store[];
  /** Static export: computed by the page from files; capture simulation is not available. */
  isStatic: boolean;
  /** Units of all tensor values. */
  valueUnits: string;
}

export const axisOf = (over: { axes: Axis[] }, kind: AxisKind): Axis | undefined =>
  over.axes.find((axis) => axis.kind === kind);

export const lengthOf = (over: { axes: Axis[] }, kind: AxisKind): number => axisOf(over, kind)?.coords.length ?? 1;

/** Whether a slice has all elements of Mueller matrices. Without, its values are M00. */
export const isPolarized = (over: { axes: Axis[] }): boolean => axisOf(over, "stokes_in") !== undefined;
