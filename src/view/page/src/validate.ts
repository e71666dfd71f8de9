/** Checks a state from a URL against what the stores have. Invalid parts are replaced by defaults, and named. */

import { type Description, type Slice, type Store, axisOf, isPolarized, lengthOf } from "./model";
import { initialState, type Comparison, type Illumination, type Quantity, type Scale, type Stokes, type ViewState } from "./state";

/** All quantities. */
export const QUANTITIES: readonly Quantity[] = [
  "colour", "element", "grid", "intensity", "dolp", "aolp", "ellipticity", "diattenuation", "polarizance", "retardance", "fast_axis",
  "depolarization", "std_error", "snr",
];
/** All scales. */
export const SCALES: readonly Scale[] = ["linear", "arctan", "symlog"];
/** All modes of comparison. */
export const MODES: readonly Comparison["mode"][] = ["side", "difference", "flicker", "split"];

/** Largest exposure, in stops, to both sides. */
export const MAX_STOPS = 10;
/** Longest pulse in picoseconds. */
const MAX_PULSE_PS = 1e6;
/** Most blocks of a drawn pattern along one axis. */
const MAX_BLOCKS = 128;

/**
 * Returns the slice that is shown at the start: the first image that has Mueller matrices, otherwise the first image, otherwise the
 * first slice.
 */
export function firstSlice(store: Store): Slice | undefined {
  const images = store.slices.filter((slice) => lengthOf(slice, "y") > 1 && lengthOf(slice, "x") > 1);
  const still = images.filter((slice) => !axisOf(slice, "t"));
  return still.find(isPolarized) ?? images.find(isPolarized) ?? images[0] ?? store.slices[0];
}

type Record_ = Record<string, unknown>;
const isRecord = (value: unknown): value is Record_ => typeof value === "object" && value !== null && !Array.isArray(value);
const isNumber = (value: unknown, low: number, high: number): value is number =>
  typeof value === "number" && value >= low && value <= high;
const isIndex = (value: unknown, length: number): value is number => Number.isInteger(value) && isNumber(value, 0, length - 1);
const isOneOf = <T>(value: unknown, all: readonly T[]): value is T => all.includes(value as T);

/** Returns whether a value is a physical Stokes vector. */
export function isStokes(value: unknown): value is Stokes {
  if (!Array.isArray(value) || value.length !== 4 || !value.every((s) => isNumber(s, -1e3, 1e3))) return false;
  const [s0, s1, s2, s3] = value as Stokes;
  return s0 > 0 && Math.hypot(s1, s2, s3) <= s0 * (1 + 1e-4);
}

function isIllumination(value: unknown, store: Store | undefined): value is Illumination {
  if (!isRecord(value)) return false;
  const [width, height] = store?.attributes.projector?.resolution ?? [0, 0];
  const [columns, rows] = store?.attributes.camera?.resolution ?? [0, 0];
  switch (value.kind) {
    case "all": return true;
    case "pixel": return isIndex(value.v, height) && isIndex(value.u, width);
    case "row": return isIndex(value.v, height);
    case "column": return isIndex(value.u, width);
    case "epipolar": return isNumber(value.y, 0, rows) && isNumber(value.x, 0, columns);
    case "drawn":
      return isIndex(value.width, MAX_BLOCKS + 1) && isIndex(value.height, MAX_BLOCKS + 1) && typeof value.digits === "string" &&
        /^[0-9]+$/.test(value.digits) && value.digits.length === value.width * value.height;
    default: return false;
  }
}

function isComparison(value: unknown, stores: Store[]): value is Comparison {
  return isRecord(value) && isIndex(value.store, stores.length) && isOneOf(value.mode, MODES) &&
    stores[value.store].slices.some((slice) => slice.name === value.slice);
}

const isPair = (value: unknown, lengths: [number, number]): value is [number, number] =>
  Array.isArray(value) && value.length === 2 && isIndex(value[0], lengths[0]) && isIndex(value[1], lengths[1]);

/** Returns a state that the stores can show, and the names of the fields that were replaced. */
export function validated(view: ViewState, { stores }: Description): { view: ViewState; replaced: string[] } {
  const replaced: string[] = [];
  const result = { ...view };
  const check = <K extends keyof ViewState>(key: K, isValid: (value: unknown) => boolean, otherwise: ViewState[K]): void => {
    if (isValid(view[key])) return;
    replaced.push(key);
    result[key] = otherwise;
  };

  check("store", (v) => isIndex(v, stores.length), 0);
  const store = stores[result.store] as Store | undefined;
  const first = store && firstSlice(store);
  const has = (name: unknown): boolean => store?.slices.some((slice) => slice.name === name) ?? false;
  // An empty name is the initial state: not a mistake of the URL.
  if (view.slice === "") result.slice = first?.name ?? "";
  else check("slice", has, first?.name ?? "");
  const slice = store?.slices.find((s) => s.name === result.slice);
  const length = (kind: Parameters<typeof lengthOf>[1]): number => (slice ? lengthOf(slice, kind) : 1);
  const lengths: [number, number] = [length("y"), length("x")];
  const bins = slice && axisOf(slice, "t") ? length("t") : 0;

  check("compare", (v) => v === null || isComparison(v, stores), null);
  check("quantity", (v) => isOneOf(v, QUANTITIES), "colour");
  check("row", (v) => isIndex(v, 4), 0);
  check("column", (v) => isIndex(v, 4), 0);
  check("normalized", (v) => typeof v === "boolean", true);
  check("wavelength", (v) => v === "all" || isIndex(v, length("wavelength")), "all");
  check("exposure", (v) => isNumber(v, -MAX_STOPS, MAX_STOPS), 0);
  check("scale", (v) => isOneOf(v, SCALES), initialState.scale);
  check("look", (v) => v === null ||
    (isRecord(v) && isNumber(v.y, -1e6, 1e6) && isNumber(v.x, -1e6, 1e6) && isNumber(v.zoom, 1e-4, 1e4)), null);
  check("pixel", (v) => v === null || isPair(v, lengths), null);
  check("illumination", (v) => isIllumination(v, store), { kind: "all" });
  check("input", isStokes, initialState.input);
  check("analyzer", (v) => v === null || isStokes(v), null);
  check("pulse", (v) => v === null || isNumber(v, 0, MAX_PULSE_PS), null);
  check("time", (v) => v === null || isIndex(v, bins), null);
  check("gate", (v) => v === null || (isPair(v, [bins, bins]) && v[0] <= v[1]), null);
  check("unwarp", (v) => typeof v === "boolean", false);
  check("select", (v) => isRecord(v) && Object.values(v).every((c) => isNumber(c, -1e9, 1e9)), {});
  check("panels", (v) => isRecord(v) && Object.values(v).every((on) => typeof on === "boolean"), initialState.panels);
  result.panels = { ...initialState.panels, ...result.panels };
  check("theme", (v) => isOneOf(v, ["auto", "dark", "light"]), "auto");
  return { view: result, replaced };
}
