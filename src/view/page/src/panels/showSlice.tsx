/** Buttons that show another slice, with the chosen pixel at the same coordinates. */

import { type Slice, axisOf, isPolarized, lengthOf } from "../model";
import { type Quantity, type ViewState, state, update } from "../state";
import { nearest } from "./useProbe";

/** Quantities of slices without Stokes axes. */
export const OF_M00: readonly Quantity[] = ["colour", "element", "intensity", "std_error", "snr"];

/** Returns the change of the state that shows another slice. The chosen pixel keeps its coordinates. */
export function toSlice(view: ViewState, from: Slice | undefined, to: Slice): Partial<ViewState> {
  const isSameSize = from && lengthOf(from, "y") === lengthOf(to, "y") && lengthOf(from, "x") === lengthOf(to, "x");
  const entry = (kind: "y" | "x", index: number) => {
    const [before, after] = [from && axisOf(from, kind)?.coords, axisOf(to, kind)?.coords];
    return before && after ? nearest(after, before[Math.min(index, before.length - 1)]) : 0;
  };
  const isKnown = isPolarized(to) || OF_M00.includes(view.quantity);
  return {
    slice: to.name, time: null, gate: null, select: {}, ...(isSameSize ? {} : { look: null }),
    pixel: view.pixel && [entry("y", view.pixel[0]), entry("x", view.pixel[1])],
    wavelength: view.wavelength === "all" ? "all" : Math.min(view.wavelength, lengthOf(to, "wavelength") - 1),
    quantity: isKnown ? view.quantity : "colour",
  };
}

export function SliceButtons({ from, slices }: { from: Slice; slices: readonly Slice[] }) {
  return (
    <div class="row">
      {slices.map((to) => (
        <button key={to.name} type="button" data-slice={to.name} onClick={() => update(toSlice(state.peek(), from, to))}>
          {`Show the slice ${to.name}`}
        </button>
      ))}
    </div>
  );
}
