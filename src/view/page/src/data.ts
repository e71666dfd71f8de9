/** The data of what the view shows. Effects request them when the state changes, and cancel requests that are out of date. */

import { computed, effect, signal, untracked, type ReadonlySignal, type Signal } from "@preact/signals";
import { Cache } from "./cache";
import { type Description, type ImageResult, type Labelled, type Slice, type Store, axisOf, isPolarized } from "./model";
import { imageRequest, LIMIT, movieRequest, resolvesProjector, showsM00, totalLightProbe } from "./request";
import { SourceError, type ImageRequest, type ProbeRequest, type Source } from "./sources/source";
import { state, type ViewState } from "./state";
import { validated } from "./validate";

/** Where the data come from. Null until the page has chosen. */
export const source: Signal<Source | null> = signal(null);
/** The open stores. Null until the source has described them. */
export const description: Signal<Description | null> = signal(null);
/** A message for the user about the last request that failed. */
export const failure: Signal<string | null> = signal(null);

/** The store of the state. */
export const store: ReadonlySignal<Store | undefined> = computed(() => description.value?.stores[state.value.store]);
/** The slice of the state. */
export const slice: ReadonlySignal<Slice | undefined> = computed(() => store.value?.slices.find((s) => s.name === state.value.slice));
/** The store and the slice of the comparison. */
export const other: ReadonlySignal<{ store: Store; slice: Slice } | null> = computed(() => {
  const compare = state.value.compare;
  const itsStore = compare ? description.value?.stores[compare.store] : undefined;
  const itsSlice = itsStore?.slices.find((s) => s.name === compare?.slice);
  return itsStore && itsSlice ? { store: itsStore, slice: itsSlice } : null;
});

/** The Mueller image of the shown slice, not contracted with the input state or the analyzer. */
export const image: Signal<ImageResult | null> = signal(null);
/** The Mueller image of the comparison. */
export const otherImage: Signal<ImageResult | null> = signal(null);
/** A part of the image at full resolution, where the whole image has too many values. */
export const detail: Signal<ImageResult | null> = signal(null);
/** The image of every time bin, contracted with the input state and the analyzer. */
export const movie: Signal<ImageResult | null> = signal(null);
/** The light of all pixels together in every time bin. */
export const totalLight: Signal<Labelled | null> = signal(null);

/** Entries of y and x that the image panel shows: [y0, y1, x0, x1]. */
export const visible: Signal<ImageRequest["region"] | null> = signal(null);
/** Entry of y and x under the pointer. */
export const hover: Signal<[number, number] | null> = signal(null);
/** Whether the time bins are played. */
export const playing: Signal<boolean> = signal(false);
/** Whether a panel needs the movie also while it is not played, for example to unwarp time. */
export const needsMovie: ReadonlySignal<boolean> = computed(() => playing.value || (state.value.unwarp && state.value.time !== null));

/** Number of refreshes of stores that are being rendered. */
const refreshes = signal(0);

const CACHE_BYTES = 256 * 2 ** 20;
const REFRESH_MS = 1000;
const PAUSE_MS = 80;

const cache = new Cache<ImageResult | Labelled>(CACHE_BYTES);
const bytesOf = (result: Labelled): number => result.mean.byteLength + (result.stdError?.byteLength ?? 0);

/** Returns the text that identifies a request. The illumination stands for its pattern, which can be large. */
function keyOf(request: ProbeRequest, view: ViewState): string {
  return JSON.stringify({ ...request, pattern: request.pattern ? view.illumination : undefined });
}

/** Returns the view of another slice: the time bin and the gate at the same times. */
function viewOf(view: ViewState, from: Slice, to: Slice): ViewState {
  const [a, b] = [axisOf(from, "t"), axisOf(to, "t")];
  if (!a || !b) return { ...view, time: null, gate: null };
  const same = (index: number): number => {
    const wanted = a.coords[Math.min(index, a.coords.length - 1)];
    return b.coords.reduce((best, t, i) => (Math.abs(t - wanted) < Math.abs(b.coords[best] - wanted) ? i : best), 0);
  };
  return { ...view, time: view.time === null ? null : same(view.time), gate: view.gate && [same(view.gate[0]), same(view.gate[1])] };
}

interface Wanted<R> {
  request: R;
  key: string;
  finished: boolean;
}

/** Describes what is wanted, or null. A request that cannot be made reports why. */
function wanted<R extends ProbeRequest>(view: ViewState, itsStore: Store, make: () => R): Wanted<R> | null {
  try {
    const request = make();
    return { request, key: keyOf(request, view), finished: itsStore.finished };
  } catch (error) {
    if (!(error instanceof SourceError)) throw error;
    failure.value = error.message;
    return null;
  }
}

/** Results that follow one description of what is wanted. */
class Channel<R extends ProbeRequest, T extends Labelled> {
  readonly done = signal(1);
  private controller: AbortController | null = null;
  private key = "";
  private hasFailed = false;
  /** Whether the store was finished when the last request began. Then a result cannot change. */
  private isFinal = false;
  /** Time of the last request, in milliseconds. */
  private asked = 0;

  constructor(
    private readonly target: Signal<T | null>,
    private readonly ask: (from: Source, request: R, signal: AbortSignal) => AsyncIterable<T>,
    private readonly part: (result: T) => number,
  ) {}

  /** Requests what is wanted. The same key is requested again only with `refresh`, and only if the store was not finished. */
  want(next: Wanted<R> | null, refresh = false): void {
    const from = source.value;
    if (!next || !from) {
      this.stop();
      this.key = "";
      this.target.value = null;
      return;
    }
    const isSame = next.key === this.key;
    // A complete answer that is still arriving comes before the refresh, unless the store has been finished since.
    const isArriving = this.done.value < 1 && !next.finished;
    if (isSame && (!refresh || this.isFinal || isArriving)) return;
    this.stop();
    this.key = next.key;
    this.isFinal = next.finished;
    const kept = next.finished ? cache.get(next.key) : undefined;
    if (kept) {
      this.target.value = kept as T;
      return;
    }
    void this.read(from, next, isSame);
  }

  private stop(): void {
    this.controller?.abort();
    this.controller = null;
    this.done.value = 1;
  }

  /** Reads all results. With `quiet`, shows only the complete one, because an older complete one is on the screen. */
  private async read(from: Source, { request, key, finished }: Wanted<R>, quiet: boolean): Promise<void> {
    const controller = new AbortController();
    // While the user moves a control, only the last of many requests is sent.
    const isMoving = performance.now() - this.asked < PAUSE_MS;
    this.asked = performance.now();
    this.controller = controller;
    this.done.value = 0;
    try {
      if (isMoving) await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
      if (controller.signal.aborted) return;
      for await (const result of this.ask(from, request, controller.signal)) {
        if (controller.signal.aborted) return;
        const part = this.part(result);
        if (!quiet || part >= 1) this.target.value = result;
        if (part >= 1 && finished) cache.set(key, result, bytesOf(result));
        this.done.value = part;
      }
      if (this.hasFailed) failure.value = null;
      this.hasFailed = false;
    } catch (error) {
      if (controller.signal.aborted) return;
      this.hasFailed = true;
      // The next change of the view asks again.
      this.key = "";
      failure.value = error instanceof SourceError ? error.message : String(error);
    } finally {
      if (this.controller === controller) {
        this.controller = null;
        this.done.value = 1;
      }
    }
  }
}

/** Number of values of a slice above which M00 is read before the other elements. */
const LARGE = 2 ** 27;

/**
 * Reads an image. Of a large slice, M00 is read first, because its chunks are a sixteenth of all. The other elements follow, and the
 * complete image replaces M00 when it has been read, or at once when the view needs it.
 */
async function* read(from: Source, request: ImageRequest, signal: AbortSignal): AsyncIterable<ImageResult> {
  const its = description.peek()?.stores[request.store]?.slices.find((s) => s.name === request.slice);
  const values = its?.axes.reduce((n, axis) => n * axis.coords.length, 1) ?? 0;
  if (!its || values < LARGE || !isPolarized(its) || !showsM00(state.peek())) return yield* from.image(request, signal);
  let first: ImageResult | null = null;
  for await (const result of from.image({ ...request, select: [...request.select, "stokes_out=0", "stokes_in=0"] }, signal)) {
    first = { ...result, done: result.done / 2 };
    yield first;
  }
  for await (const result of from.image(request, signal)) {
    const isWanted = result.done >= 1 || !first || !showsM00(state.peek());
    yield isWanted ? result : { ...first!, done: (1 + result.done) / 2 };
  }
}

const imageChannel = (target: Signal<ImageResult | null>): Channel<ImageRequest, ImageResult> =>
  new Channel(target, read, (result) => result.done);

const main = imageChannel(image);
const compared = imageChannel(otherImage);
const part = imageChannel(detail);
const frames = imageChannel(movie);
const light = new Channel<ProbeRequest, Labelled>(totalLight, async function* (from, request, signal) {
  yield await from.probe(request, signal);
}, () => 1);

/** Fraction that has been read of what is shown, 0..1. 1 means that nothing is being read. */
export const busy: ReadonlySignal<number> = computed(() =>
  Math.min(main.done.value, compared.done.value, part.done.value, frames.done.value, light.done.value));

/** Fields of the state that change which data are needed. */
const dataFields = computed(() => {
  const { store: s, slice: name, compare, illumination, pulse, time, gate, select } = state.value;
  return JSON.stringify([s, name, compare && [compare.store, compare.slice], illumination, pulse, time, gate, select]);
});

/** Fields of the state that change the movie and the total light. */
const movieFields = computed(() => {
  const { quantity, row, column, input, analyzer } = state.value;
  return JSON.stringify([quantity === "element" ? [row, column] : [input, analyzer]]);
});

/** Runs `act` with the shown store and slice whenever data have to be requested. */
function whenShown(act: (view: ViewState, itsStore: Store, itsSlice: Slice, refresh: boolean) => void, nothing: () => void): void {
  let last = 0;
  effect(() => {
    void dataFields.value;
    void source.value;
    const [itsStore, itsSlice] = [store.value, slice.value];
    const isRefresh = refreshes.value !== last;
    last = refreshes.value;
    untracked(() => (itsStore && itsSlice ? act(state.value, itsStore, itsSlice, isRefresh) : nothing()));
  });
}

/** Rounds a region outward, so that small movements of the view ask for the same region. */
function rounded([y0, y1, x0, x1]: [number, number, number, number], height: number, width: number): ImageRequest["region"] {
  const step = 64;
  const low = (v: number): number => Math.max(0, Math.floor(v / step) * step);
  const high = (v: number, most: number): number => Math.min(most, Math.ceil(v / step) * step);
  return [low(y0), high(y1, height), low(x0), high(x1, width)];
}

/** Starts the effects that request data. */
export function startData(): void {
  whenShown((view, itsStore, itsSlice, refresh) => {
    // While the time bins are played, the movie has the image of the bin.
    if (playing.value) return;
    main.want(wanted(view, itsStore, () => imageRequest(view, itsStore, itsSlice)), refresh);
  }, () => main.want(null));

  whenShown((view, _, itsSlice, refresh) => {
    const second = other.value;
    const itsView = second && viewOf(view, itsSlice, second.slice);
    const next = second && itsView && wanted(itsView, second.store, () => imageRequest(itsView, second.store, second.slice));
    compared.want(next, refresh);
  }, () => compared.want(null));

  effect(() => {
    if (!playing.value) untracked(() => {
      const [itsStore, itsSlice] = [store.value, slice.value];
      if (itsStore && itsSlice) main.want(wanted(state.value, itsStore, () => imageRequest(state.value, itsStore, itsSlice)));
    });
  });

  effect(() => {
    void movieFields.value;
    void dataFields.value;
    const [itsStore, itsSlice, isNeeded] = [store.value, slice.value, needsMovie.value];
    untracked(() => {
      const hasTime = itsStore && itsSlice && axisOf(itsSlice, "t");
      const total = hasTime ? wanted(state.value, itsStore, () => totalLightProbe(state.value, itsStore, itsSlice)) : null;
      light.want(total, itsStore?.finished);
      const next = hasTime && isNeeded ? wanted(state.value, itsStore, () => movieRequest(state.value, itsStore, itsSlice)) : null;
      frames.want(next, itsStore?.finished);
    });
  });

  let timer: ReturnType<typeof setTimeout> | undefined;
  effect(() => {
    void dataFields.value;
    const [itsStore, itsSlice, shown, seen] = [store.value, slice.value, image.value, visible.value];
    clearTimeout(timer);
    if (!itsStore || !itsSlice || !shown || !seen || shown.bin === 1) {
      part.want(null);
      return;
    }
    const [height, width] = [axisOf(itsSlice, "y")?.coords.length ?? 1, axisOf(itsSlice, "x")?.coords.length ?? 1];
    const region = rounded(seen, height, width)!;
    const perEntry = shown.mean.length / ((axisOf(shown, "y")?.coords.length ?? 1) * (axisOf(shown, "x")?.coords.length ?? 1));
    const fits = (region[1] - region[0]) * (region[3] - region[2]) * perEntry <= LIMIT;
    if (!fits) {
      part.want(null);
      return;
    }
    // The user may still be moving.
    timer = setTimeout(() => {
      part.want(wanted(state.value, itsStore, () => imageRequest(state.value, itsStore, itsSlice, region)));
    }, 150);
  });

  setInterval(() => void refresh(), REFRESH_MS);
}

/** Reads stores in progress again. When a store has been finished, reads the description again. */
async function refresh(): Promise<void> {
  const [from, open] = [source.value, description.value];
  if (!from || !open || open.isStatic || open.stores.every((s) => s.finished)) return;
  try {
    const ids = open.stores.filter((s) => !s.finished).map((s) => s.id);
    const progress = await Promise.all(ids.map((id) => from.progress(id)));
    if (progress.some((p) => p?.finished)) setDescription(await from.describe());
    refreshes.value++;
  } catch (error) {
    failure.value = error instanceof SourceError ? error.message : String(error);
  }
}

/** Shows a description. The state is made valid for it. Returns the names of the fields that were replaced. */
export function setDescription(next: Description): string[] {
  const { view, replaced } = validated(state.peek(), next);
  description.value = next;
  state.value = view;
  return replaced;
}

/** Whether the shown slice resolves projector pixels, so that an illumination changes it. */
export const hasProjector: ReadonlySignal<boolean> = computed(() => slice.value !== undefined && resolvesProjector(slice.value));
