/** Time of slices that resolve it: a bin, all bins, a gate, light in flight, and the total light as background. */

import { signal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { movie, playing, slice, store, totalLight } from "../data";
import { isPinhole } from "../geometry";
import { axisOf } from "../model";
import { state, update } from "../state";
import { Choice, Switch } from "./Field";

/** Bins per second. */
const rate = signal(10);
const RATES = [2, 5, 10, 20, 40] as const;

const UNWARP_TITLE =
  "Subtract the travel time from the first surface to the camera, relative to the nearest surface. Valid for light that the projector " +
  "sends directly to the surface.";

/** Returns the number of time bins of the shown slice, or 0 if it does not resolve time. */
const bins = (): number => (slice.value ? axisOf(slice.value, "t")?.coords.length ?? 0 : 0);

/** Shows a time bin. The gate does not apply to a single bin. */
const show = (bin: number): void => update({ time: Math.max(0, Math.min(bins() - 1, bin)) });

/** Starts or stops playing the time bins. */
export function togglePlay(): void {
  if (bins() < 2) return;
  if (!playing.value && state.value.time === null) update({ time: state.value.gate?.[0] ?? firstLight() });
  playing.value = !playing.value;
}

/** Shows the bin before or after the shown one. */
export function stepTime(by: number): void {
  playing.value = false;
  if (bins() > 0) show((state.value.time ?? firstLight()) + by);
}

/** Returns the first bin with at least a thousandth of the most light. */
function firstLight(): number {
  const light = totalLight.value?.mean;
  if (!light) return 0;
  const most = light.reduce((a, b) => Math.max(a, b), 0);
  return Math.max(0, light.findIndex((value) => value >= most / 1000));
}

function Profile({ count }: { count: number }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const light = totalLight.value?.mean;
  useEffect(() => {
    const element = canvas.current;
    const context = element?.getContext("2d");
    if (!element || !context) return;
    const [width, height] = [element.width, element.height];
    context.clearRect(0, 0, width, height);
    if (!light || light.length !== count) return;
    const most = light.reduce((a, b) => (b > a ? b : a), 0);
    if (!(most > 0)) return;
    context.fillStyle = getComputedStyle(element).color;
    light.forEach((value, i) => {
      const tall = Math.sqrt(Math.max(0, value) / most) * height;
      context.fillRect((i / count) * width, height - tall, width / count + 0.5, tall);
    });
  });
  return (
    <canvas
      ref={canvas} class="time-profile" width={1024} height={48} role="img"
      aria-label="Light of all pixels in every time bin, square root scale"
    />
  );
}

/** The bar below the image. It shows nothing if the slice does not resolve time. */
export function TimeBar() {
  useSignalEffect(() => {
    if (!playing.value || bins() < 2) {
      playing.value = false;
      return;
    }
    const timer = setInterval(() => {
      // Frames that have not arrived cannot be shown.
      if (!movie.value) return;
      const [first, last] = state.value.gate ?? [0, bins() - 1];
      const next = (state.value.time ?? first) + 1;
      show(next > last || next < first ? first : next);
    }, 1000 / rate.value);
    return () => clearInterval(timer);
  });

  const itsSlice = slice.value;
  const t = itsSlice && axisOf(itsSlice, "t");
  if (!t || t.coords.length < 2) return null;
  const { time, gate, unwarp } = state.value;
  const count = t.coords.length;
  const ps = (bin: number): string => `${Number(t.coords[bin].toFixed(3))} ps`;
  const { camera, projector } = store.value?.attributes ?? {};
  const canUnwarp = isPinhole(camera) && isPinhole(projector);
  const text = time !== null ? ps(time) : gate ? `Sum from ${ps(gate[0])} to ${ps(gate[1])}` : "Sum over time";
  const [first, last] = gate ?? [0, count - 1];
  const setGate = (next: [number, number]): void =>
    update({ gate: next[0] === 0 && next[1] === count - 1 ? null : next, time: null });
  return (
    <section class="time-bar" aria-label="Time">
      <button type="button" class="play" aria-pressed={playing.value} title="Play or pause (space)" onClick={togglePlay}>
        {playing.value ? "Pause" : "Play"}
      </button>
      <div class="time-tracks">
        <div class="time-plot">
          <Profile count={count} />
          {gate && (
            <div class="gate-window" style={{ left: `${(100 * first) / count}%`, right: `${(100 * (count - 1 - last)) / count}%` }} />
          )}
        </div>
        <input
          type="range" class="time-slider" aria-label="Time bin" aria-valuetext={text} min={0} max={count - 1} step={1}
          value={time ?? first} data-summed={time === null} onInput={(event) => show(Number(event.currentTarget.value))}
        />
        <input
          type="range" class="gate-handle" aria-label="Start of the gate" aria-valuetext={ps(first)} min={0} max={count - 1} step={1}
          value={first} onInput={(event) => setGate([Math.min(Number(event.currentTarget.value), last), last])}
        />
        <input
          type="range" class="gate-handle" aria-label="End of the gate" aria-valuetext={ps(last)} min={0} max={count - 1} step={1}
          value={last} onInput={(event) => setGate([first, Math.max(Number(event.currentTarget.value), first)])}
        />
      </div>
      <div class="time-controls">
        <output class="time-text" data-testid="time">{text}</output>
        <button
          type="button" disabled={time === null && !gate}
          onClick={() => {
            playing.value = false;
            update({ time: null, gate: null });
          }}
        >
          Sum over time
        </button>
        {time !== null && gate && <button type="button" onClick={() => update({ time: null })}>Sum over gate</button>}
        <Choice
          label="Speed" value={String(rate.value)} options={RATES.map((r) => ({ value: String(r), label: `${r} bins/s` }))}
          onChange={(value) => (rate.value = Number(value))}
        />
        <span title={UNWARP_TITLE}>
          <Switch label="Unwarp camera time" checked={unwarp} disabled={!canUnwarp} onChange={(on) => update({ unwarp: on })} />
        </span>
      </div>
    </section>
  );
}
