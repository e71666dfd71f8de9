/** The pictures of the view: computed when the data or the way of showing them change, but not when the user pans or zooms. */

import { computed, type ReadonlySignal } from "@preact/signals";
import { description, detail, image, movie, other, otherImage, playing, slice, store } from "../data";
import { quantityMap, type QuantityMap } from "../math/maps";
import { type ImageResult, isPolarized, lengthOf } from "../model";
import { state, type ViewState } from "../state";
import { frameOf, movieWhite, unwarpShifts } from "./movie";
import { shortUnit } from "./units";
import { differencePicture, mapPicture, pictureOf, type Picture } from "./picture";

/** What the image panel shows. */
export interface Shown {
  main: Picture;
  /** The image behind `main`. */
  image: ImageResult;
  /** A part of `main` at full resolution. */
  detail: Picture | null;
  other: Picture | null;
  mode: "single" | "side" | "flicker" | "split";
  /** Entries of the whole slice along y and x. */
  rows: number;
  columns: number;
  /** The unit of intensities. */
  unit: string;
  notes: string[];
}

const paintFields = computed(() => {
  const { quantity, row, column, normalized, wavelength, exposure, scale, input, analyzer, time, unwarp, compare } = state.value;
  return JSON.stringify([quantity, row, column, normalized, wavelength, exposure, scale, input, analyzer, time, unwarp, compare]);
});

const shifts = computed(() => {
  const frames = movie.value;
  const attributes = store.value?.attributes;
  return frames && state.value.unwarp ? unwarpShifts(frames, attributes?.camera, attributes?.projector) : null;
});

/** The unit of all values. */
export const valueUnits: ReadonlySignal<string> = computed(() => shortUnit(description.value?.valueUnits ?? ""));

/** Returns the picture of a time bin of the movie. The movie is already contracted, so its matrices are intensities. */
function framePicture(frames: ImageResult, bin: number, view: ViewState): { picture: Picture; frame: ImageResult } {
  const frame = frameOf(frames, bin, shifts.value);
  const contracted: ViewState = { ...view, input: [1, 0, 0, 0], analyzer: null };
  if (view.quantity === "colour") {
    const white = movieWhite(frames) / 2 ** view.exposure;
    return { picture: pictureOf(frame, contracted, "main", valueUnits.value, { white }), frame };
  }
  const map = quantityMap(frame, { ...contracted, quantity: "intensity" }, valueUnits.value);
  const isElement = view.quantity === "element" && view.row + view.column > 0;
  const limit = movieWhite(frames);
  const element: QuantityMap = {
    ...map,
    label: view.quantity === "element" ? `M${view.row}${view.column}` : map.label,
    kind: isElement ? "diverging" : "positive",
    range: [isElement ? -limit : 0, limit],
  };
  return { picture: mapPicture(frame, element, view, "main", null, false), frame };
}

/** The pictures of the view, or null while there are none. */
export const shown: ReadonlySignal<Shown | null> = computed(() => {
  void paintFields.value;
  const [found, frames, itsSlice] = [image.value, movie.value, slice.value];
  const view = state.peek();
  if (!itsSlice) return null;
  const [rows, columns] = [lengthOf(itsSlice, "y"), lengthOf(itsSlice, "x")];
  const units = valueUnits.value;

  if (frames && view.time !== null && (playing.value || view.unwarp)) {
    const { picture, frame } = framePicture(frames, view.time, view);
    const unwarped = "The image shows unwarped time. The time bar and the panels show camera time.";
    const all = view.unwarp ? [unwarped, ...frames.notes] : frames.notes;
    return { main: picture, image: frame, detail: null, other: null, mode: "single", rows, columns, unit: units, notes: all };
  }
  if (!found) return null;
  // Comparable with the frames that were played before.
  const white = frames && view.time !== null && view.quantity === "colour" ? movieWhite(frames) / 2 ** view.exposure : null;
  const notes = [...found.notes];
  const second = other.value ? otherImage.value : null;
  const isNotPolarized = !isPolarized(itsSlice) && !["colour", "intensity", "std_error", "snr"].includes(view.quantity);
  if (isNotPolarized && (view.quantity !== "element" || view.row + view.column > 0)) {
    notes.push("This slice has intensity only, so the quantity is not defined. Choose the photograph or another slice.");
  }
  if (view.compare?.mode === "difference" && second) {
    const difference = differencePicture(found, second, view, "main", units);
    if (difference) return { main: difference, image: found, detail: null, other: null, mode: "single", rows, columns, unit: units, notes };
    notes.push("The two images have different sizes, so there is no difference.");
  }
  const main = pictureOf(found, view, "main", units, { white });
  const shared = { legend: main.legend, white: main.white };
  const part = detail.value && view.quantity !== "grid" ? pictureOf(detail.value, view, "detail", units, shared) : null;
  const otherPicture = second ? pictureOf(second, view, "other", units, shared) : null;
  const mode = otherPicture && view.compare && view.compare.mode !== "difference" ? view.compare.mode : "single";
  return { main, image: found, detail: part, other: otherPicture, mode, rows, columns, unit: units, notes };
});
