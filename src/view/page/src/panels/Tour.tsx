/** A short tour: each step sets the view and explains it. */

import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { slice, store } from "../data";
import { resolvesProjector } from "../request";
import { axisOf, isPolarized, lengthOf, type Slice, type Store } from "../model";
import { initialState, update, type ViewState } from "../state";
import { firstSlice } from "../validate";

const SEEN = "sunstone-tour-seen";

/** The shown step, or null. */
export const tourStep = signal<number | null>(null);

interface Step {
  title: string;
  text: string;
  view: Partial<ViewState>;
  /** Selector of the panel that the text is about. */
  panel?: string;
}

const isImage = (of: Slice): boolean => lengthOf(of, "y") > 1 && lengthOf(of, "x") > 1;
const isWith = (condition: (of: Slice) => boolean, itsStore: Store): Slice | undefined =>
  itsStore.slices.find((of) => condition(of) && isImage(of)) ?? itsStore.slices.find(condition);

/** Returns the middle pixel of a slice. */
const middle = (of: Slice): [number, number] => [Math.floor(lengthOf(of, "y") / 2), Math.floor(lengthOf(of, "x") / 2)];

/** Returns the steps that the slices of a store allow. */
export function steps(itsStore: Store): Step[] {
  const first = firstSlice(itsStore);
  if (!first) return [];
  const plain: Partial<ViewState> = { ...initialState, store: itsStore.id, slice: first.name };
  const { theme: _, ...whole } = plain;
  const polarized = isWith(isPolarized, itsStore);
  const timed = isWith((of) => axisOf(of, "t") !== undefined, itsStore);
  const resolved = isWith(resolvesProjector, itsStore);
  const all: (Step | null)[] = [
    {
      title: "The photograph",
      text: "This is what the camera sees when all projector pixels are on. Drag to move the image, use the wheel to zoom, and click a " +
        "pixel.",
      view: whole,
    },
    polarized ? {
      title: "A Mueller element",
      text: "M22 / M00 shows how the scene preserves ±45° polarization: red is preserved, blue is reversed, white is depolarized.",
      view: { ...whole, slice: polarized.name, quantity: "element", row: 2, column: 2 },
    } : null,
    timed ? {
      title: "A pixel over time",
      text: "The panel at the right shows when light arrives at the chosen pixel. Press space to play light in flight.",
      view: { ...whole, slice: timed.name, pixel: middle(timed) },
    } : {
      title: "A pixel",
      text: "The panel at the right shows the numbers of the chosen pixel with their standard errors.",
      view: { ...whole, pixel: middle(first) },
    },
    resolved ? {
      title: "Where light comes from",
      text: "This slice separates projector pixels. The panel Origin of the light shows which of them illuminate the chosen " +
        "pixel. Click a bar or a pixel there to light only this part of the projector.",
      view: { ...whole, slice: resolved.name, pixel: middle(resolved) },
      panel: ".origin-panel",
    } : null,
    polarized ? {
      title: "Polarization states",
      text: "The projector emits horizontal polarization, and the analyzer transmits vertical polarization. Drag the points on the " +
        "Poincaré spheres to change both.",
      view: { ...whole, slice: polarized.name, input: [1, 1, 0, 0], analyzer: [1, -1, 0, 0], pixel: middle(polarized) },
      panel: ".state-panel",
    } : null,
  ];
  return all.filter((step) => step !== null);
}

function go(itsStore: Store, index: number | null): void {
  tourStep.value = index;
  const step = index === null ? undefined : steps(itsStore)[index];
  if (!step) return;
  update(step.view);
  const { panel } = step;
  // The panels are drawn again for the new state first.
  if (panel) setTimeout(() => document.querySelector(panel)?.scrollIntoView({ block: "start" }), 100);
}

const remember = (): void => {
  try {
    localStorage.setItem(SEEN, "1");
  } catch {
    // Storage is blocked: the tour is offered again the next time.
  }
};

/** Starts the tour at its first step. */
export function startTour(): void {
  if (store.value && steps(store.value).length > 0) go(store.value, 0);
}

/** Starts the tour for a user who has not seen it. */
export function offerTour(): void {
  try {
    if (localStorage.getItem(SEEN) === null) startTour();
  } catch {
    // Storage is blocked: a tour that cannot be dismissed for good would be a nuisance.
  }
}

/** Ends the tour. The view stays. */
export function endTour(): void {
  remember();
  tourStep.value = null;
}

/** The card of the current step. */
export function Tour() {
  const next = useRef<HTMLButtonElement>(null);
  const index = tourStep.value;
  useEffect(() => {
    if (index !== null) next.current?.focus();
  }, [index]);
  const itsStore = store.value;
  if (index === null || !itsStore || !slice.value) return null;
  const all = steps(itsStore);
  const step = all[index];
  if (!step) return null;
  const isLast = index === all.length - 1;
  return (
    <aside class="tour" aria-label="Tour">
      <h2>{step.title}</h2>
      <p aria-live="polite">{step.text}</p>
      <p class="dialog-actions">
        <span>Step {index + 1} of {all.length}</span>
        {!isLast && <button type="button" onClick={endTour}>Skip the tour</button>}
        {index > 0 && <button type="button" onClick={() => go(itsStore, index - 1)}>Back</button>}
        {!isLast && <button type="button" ref={next} class="primary" onClick={() => go(itsStore, index + 1)}>Next</button>}
        {isLast && <button type="button" ref={next} class="primary" onClick={endTour}>Explore</button>}
      </p>
    </aside>
  );
}
