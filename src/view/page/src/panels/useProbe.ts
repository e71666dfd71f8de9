/** Requests of panels. */

import { useEffect, useState } from "preact/hooks";
import { slice, source, store } from "../data";
import { brief } from "../display/scale";
import { type AxisKind, type Labelled, type Slice, type Store, axisOf } from "../model";
import type { ProbeRequest } from "../sources/source";
import { type ViewState, state } from "../state";

/** The answer to the newest request that has been answered. */
export interface Probed {
  result: Labelled | null;
  error: string | null;
  /** A newer request has not been answered yet. */
  waiting: boolean;
}

/** Milliseconds between two requests of a store that is being rendered. */
const REFRESH_MS = 2000;

/**
 * Sends the probe of a panel whenever `inputs` or the shown slice change, and cancels the previous one. `make` returns null if there is
 * nothing to ask. Stores in progress are probed again every two seconds.
 */
export function useProbe(
  inputs: readonly unknown[], make: (view: ViewState, store: Store, slice: Slice) => ProbeRequest | null,
): Probed {
  const [probed, setProbed] = useState<Probed & { subject: string }>({ result: null, error: null, waiting: false, subject: "" });
  const [from, itsStore, itsSlice] = [source.value, store.value, slice.value];
  const subject = JSON.stringify([itsStore?.id, itsStore?.finished, itsSlice?.name]);
  useEffect(() => {
    const controller = new AbortController();
    const show = (change: Partial<Probed>) => {
      if (!controller.signal.aborted) setProbed((last) => ({ ...(last.subject === subject ? last : EMPTY), ...change, subject }));
    };
    const ask = async () => {
      if (!from || !itsStore || !itsSlice) return show(EMPTY);
      try {
        const request = make(state.peek(), itsStore, itsSlice);
        if (!request) return show(EMPTY);
        show({ waiting: true });
        show({ result: await from.probe(request, controller.signal), error: null, waiting: false });
      } catch (error) {
        show({ error: error instanceof Error ? error.message : String(error), waiting: false });
      }
    };
    void ask();
    const timer = itsStore && !itsStore.finished ? setInterval(() => void ask(), REFRESH_MS) : undefined;
    return () => {
      controller.abort();
      clearInterval(timer);
    };
  }, [from, subject, JSON.stringify(inputs)]);
  return probed.subject === subject ? probed : EMPTY;
}

const EMPTY: Probed = { result: null, error: null, waiting: false };

/** Returns a request that sums over all axes but those kept, those selected to one entry, and those that a pattern contracts. */
export function keeping(request: ProbeRequest, itsSlice: Slice, kept: readonly AxisKind[]): ProbeRequest {
  const single = request.select.filter((word) => !word.includes(":")).map((word) => word.split("=")[0]);
  const isContracted = (kind: AxisKind) => request.pattern !== undefined && (kind === "v" || kind === "u");
  const sum = itsSlice.axes.map((axis) => axis.kind)
    .filter((kind) => !kept.includes(kind) && !single.includes(kind) && !isContracted(kind));
  return { ...request, sum };
}

/** Returns the words that select the element that the view shows, or M00 if it shows another quantity. */
export function elementWords(view: ViewState, itsSlice: Slice): { words: string[]; label: string } {
  if (!itsSlice.axes.some((axis) => axis.kind === "stokes_in")) return { words: [], label: "M00" };
  const [row, column] = view.quantity === "element" ? [view.row, view.column] : [0, 0];
  return { words: [`stokes_out=s${row}`, `stokes_in=s${column}`], label: `M${row}${column}` };
}

/** Returns the words that say which wavelength [`planeOf`] shows, to follow the name of an element. */
export function laneName(over: Labelled, wavelength: number | "all"): string {
  const nm = axisOf(over, "wavelength")?.coords;
  if (!nm) return "";
  if (wavelength !== "all") return ` at ${brief(nm[Math.min(wavelength, nm.length - 1)])} nm`;
  return nm.length > 1 ? ", mean over wavelengths" : ` at ${brief(nm[0])} nm`;
}

/** Returns the entry of an axis that is nearest to a coordinate. */
export const nearest = (coords: readonly number[], value: number): number =>
  coords.reduce((best, c, i) => (Math.abs(c - value) < Math.abs(coords[best] - value) ? i : best), 0);
