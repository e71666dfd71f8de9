/** Progress of a store that is being rendered. */

import { useEffect, useRef, useState } from "preact/hooks";
import { image, source, store } from "../data";
import { relativeError } from "../math/labelled";
import type { Progress } from "../model";
import { Panel } from "./Field";
import { duration } from "./numbers";
import { ProfileChart } from "./ProfileChart";

const POLL_MS = 1000;
/** Maximum number of points of the chart. When it is reached, every second point is removed. */
const POINTS = 400;

interface Point {
  /** Seconds since the page opened the store. */
  seconds: number;
  tilesDone: number;
  error: number | null;
}

/** Returns the seconds until all tiles are done at the mean rate since the first point, or null if it is not known. */
export function remaining(points: readonly Point[], tiles: number): number | null {
  const [first, last] = [points[0], points.at(-1)];
  if (!first || !last || last.tilesDone <= first.tilesDone) return null;
  const rate = (last.tilesDone - first.tilesDone) / (last.seconds - first.seconds);
  return (tiles - last.tilesDone) / rate;
}

export function ProgressPanel() {
  const [from, itsStore] = [source.value, store.value];
  const [progress, setProgress] = useState<Progress | null>(null);
  const [points, setPoints] = useState<Point[]>([]);
  const [error, setError] = useState<string | null>(null);
  const id = itsStore?.id;
  const isOpen = itsStore !== undefined && !itsStore.finished;
  // The panel announces the end only of a render that it has seen.
  const seen = useRef<number | null>(null);
  if (isOpen) seen.current = itsStore.id;
  useEffect(() => {
    if (!from || id === undefined || !isOpen) return;
    const start = performance.now();
    let [isCurrent, asking] = [true, false];
    setPoints([]);
    const poll = async () => {
      if (asking) return;
      asking = true;
      try {
        const next = await from.progress(id);
        if (!isCurrent) return;
        setProgress(next);
        setError(null);
        if (!next) return;
        const shown = image.peek();
        // The server leaves the error to the page, which has the values.
        const relative = shown && relativeError(shown);
        const point = { seconds: (performance.now() - start) / 1000, tilesDone: next.tilesDone, error: relative };
        setPoints((last) => [...(last.length < POINTS ? last : last.filter((_, i) => i % 2 === 0)), point]);
      } catch (problem) {
        if (isCurrent) setError(problem instanceof Error ? problem.message : String(problem));
      } finally {
        asking = false;
      }
    };
    void poll();
    const timer = setInterval(() => void poll(), POLL_MS);
    return () => {
      isCurrent = false;
      clearInterval(timer);
    };
  }, [from, id, isOpen]);

  if (!itsStore) return null;
  if (!isOpen) {
    if (seen.current !== itsStore.id) return null;
    return (
      <Panel name="progress-panel" title="Render">
        <p role="status">The store has been finished. All values are final.</p>
      </Panel>
    );
  }
  const tiles = progress?.tiles ?? 0;
  const share = progress && tiles > 0 ? progress.tilesDone / tiles : 0;
  const left = remaining(points, tiles);
  const known = points.filter((point) => point.error !== null);
  const now = known.at(-1)?.error;
  return (
    <Panel name="progress-panel" title="Render in progress" error={error}>
      <label class="field slider">
        <span>Tiles</span>
        <progress value={share} max={1} />
        <output>{progress ? `${progress.tilesDone} of ${tiles} (${Math.round(100 * share)} %)` : "–"}</output>
      </label>
      <p data-left={left === null ? undefined : String(left)}>
        {left === null ? "Time left: not known yet." : `Time left at the rate since the page opened: about ${duration(left)}.`}
        {now != null && ` Relative error of finished pixels: ${(100 * now).toPrecision(3)} %.`}
      </p>
      {known.length > 1 && (
        <ProfileChart
          label="Relative error of finished pixels since the page opened" coords={known.map((point) => point.seconds)}
          xLabel="time since opening" xUnit="s" yLabel="relative error" yUnit="%" log={false}
          lines={[{ label: "relative error", values: known.map((point) => 100 * point.error!), errors: null, colour: "line-0" }]}
        />
      )}
    </Panel>
  );
}
