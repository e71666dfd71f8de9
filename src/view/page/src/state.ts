/** The state of the view. It is a plain value, it is in the URL after `#`, and every panel is a function of it. */

import { signal } from "@preact/signals";

export type Stokes = [number, number, number, number];

export type Quantity =
  | "colour" | "element" | "grid" | "intensity" | "dolp" | "aolp" | "ellipticity"
  | "diattenuation" | "polarizance" | "retardance" | "fast_axis" | "depolarization"
  | "std_error" | "snr";

export type Scale = "linear" | "arctan" | "symlog";

export type Illumination =
  | { kind: "all" }
  | { kind: "pixel"; v: number; u: number }
  | { kind: "row"; v: number }
  | { kind: "column"; u: number }
  /** The epipolar line of a camera pixel, in projector pixels. */
  | { kind: "epipolar"; y: number; x: number }
  /** Blocks that the user drew: a grid of `width` x `height` drives 0..9, one digit each, over the whole projector. */
  | { kind: "drawn"; width: number; height: number; digits: string };

export interface Comparison {
  store: number;
  slice: string;
  mode: "side" | "difference" | "flicker" | "split";
}

export interface ViewState {
  store: number;
  slice: string;
  compare: Comparison | null;
  quantity: Quantity;
  /** Element Mij that `element`, `std_error` and `snr` show. */
  row: number;
  column: number;
  /** Divide elements by M00. */
  normalized: boolean;
  /** Index along the wavelength axis, or all as colours. */
  wavelength: number | "all";
  /** Exposure in stops, relative to the automatic exposure. */
  exposure: number;
  scale: Scale;
  /** Centre of the image panel in entries of the slice, and screen pixels per entry. Null: the whole image. */
  look: { y: number; x: number; zoom: number } | null;
  /** The chosen entry (not coordinate) of y and x. */
  pixel: [number, number] | null;
  illumination: Illumination;
  /** Stokes state of the projector's light; default: unpolarized. */
  input: Stokes;
  /** Analyzer before the camera: the Stokes vector that it transmits; null: no analyzer. Weights are 1/2 of it. */
  analyzer: Stokes | null;
  /** Pulse width (FWHM) in ps; null: an ideal pulse. */
  pulse: number | null;
  /** Index of the shown time bin; null: the sum over time. */
  time: number | null;
  /** First and last time bin of the gate, both included; null: no gate. Used where `time` is null. */
  gate: [number, number] | null;
  /** Subtract each pixel's travel time from its first surface to the camera. */
  unwarp: boolean;
  /** Selected coordinates of further axes (bounces, component, label); absent: the sum. */
  select: Record<string, number>;
  panels: { time: boolean; matrix: boolean; origin: boolean; sphere: boolean; captures: boolean };
  theme: "auto" | "dark" | "light";
}

export const initialState: ViewState = {
  store: 0,
  slice: "",
  compare: null,
  quantity: "colour",
  row: 0,
  column: 0,
  normalized: true,
  wavelength: "all",
  exposure: 0,
  scale: "arctan",
  look: null,
  pixel: null,
  illumination: { kind: "all" },
  input: [1, 0, 0, 0],
  analyzer: null,
  pulse: null,
  time: null,
  gate: null,
  unwarp: false,
  select: {},
  panels: { time: true, matrix: true, origin: true, sphere: true, captures: false },
  theme: "auto",
};

export const state = signal<ViewState>(initialState);

/** Changes some fields of the state. A grid has other places than a single image, so entering or leaving it shows the whole image. */
export function update(change: Partial<ViewState>): void {
  const before = state.value;
  const isOfGrid = change.quantity !== undefined && (change.quantity === "grid") !== (before.quantity === "grid");
  state.value = { ...before, ...(isOfGrid ? { look: null } : {}), ...change };
}

/** Returns the state as text for the URL: only fields that differ from the initial state. */
export function toHash(view: ViewState): string {
  const parameters = new URLSearchParams();
  for (const key of Object.keys(initialState) as (keyof ViewState)[]) {
    const text = JSON.stringify(view[key]);
    if (text !== JSON.stringify(initialState[key])) parameters.set(key, text);
  }
  return parameters.toString();
}

/** Returns the state of a URL. Unknown and malformed parts are ignored; their names are returned in `ignored`. */
export function fromHash(hash: string): { view: ViewState; ignored: string[] } {
  const view: Record<string, unknown> = { ...initialState };
  const ignored: string[] = [];
  for (const [key, text] of new URLSearchParams(hash.replace(/^#/, ""))) {
    try {
      const value: unknown = JSON.parse(text);
      if (!Object.hasOwn(initialState, key)) throw new Error("unknown");
      view[key] = value;
    } catch {
      ignored.push(key);
    }
  }
  return { view: view as unknown as ViewState, ignored };
}
