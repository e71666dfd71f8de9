/** The image: pan, zoom, values of pixels, the chosen pixel, comparison. */

import { computed, effect, signal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { busy, hover, slice, visible } from "../data";
import { drawCrosshair, drawPicture, drawValues, filled, hitOf, indexOf, type CanvasColours } from "../display/draw";
import { readingText } from "../display/picture";
import { shown, type Shown } from "../display/shown";
import { fit, limited, panned, stretchOf, toImage, toScreen, visibleEntries, zoomedAt, type Frame, type Look } from "../display/viewport";
import { axisOf, lengthOf } from "../model";
import { state, update } from "../state";
import { darkTheme } from "../theme";
import { ColourBar } from "./ColourBar";
import { listen } from "./pointer";

/** Screen pixels that an arrow key moves the image. */
const STEP_PX = 48;
const ZOOM_STEP = Math.SQRT2;
/** Space between two images side by side. */
const GAP_PX = 8;
/** Frequency of the flicker comparison in Hz: each image is shown half of the time. */
const FLICKER_HZ = 2;

const size = signal({ width: 0, height: 0 });
/** Fraction of the width where the split comparison changes from the first to the second image. */
const divider = signal(0.5);
const flickerSecond = signal(false);
/** The element of a grid under the pointer. */
const hoverElement = signal<[number, number] | null>(null);

const prefersStill = (): boolean => matchMedia("(prefers-reduced-motion: reduce)").matches;

/** The frames that the images are shown in: two if they are side by side. */
const frames = computed((): Frame[] => {
  const s = shown.value;
  const { width, height } = size.value;
  if (!s || width === 0) return [];
  const whole = filled(s.main, s.rows, s.columns);
  const stretch = stretchOf(whole.rows, whole.columns);
  const frame = (left: number, w: number): Frame => ({ left, top: 0, width: w, height, ...whole, stretch });
  if (s.mode !== "side") return [frame(0, width)];
  const half = (width - GAP_PX) / 2;
  return [frame(0, half), frame(half + GAP_PX, half)];
});

/** The shown part of the image. */
const look = computed((): Look | null => {
  const first = frames.value[0];
  return first ? (state.value.look ? limited(first, state.value.look) : fit(first)) : null;
});

/** Returns the frame at a screen position. */
const frameAt = (left: number): Frame | undefined => frames.value.find((f) => left >= f.left && left < f.left + f.width) ?? frames.value[0];

/** Shows a part of the image. Digits that nobody sees would make the URL long. */
function show({ y, x, zoom }: Look): void {
  const brief = (v: number): number => Number(v.toFixed(3));
  update({ look: { y: brief(y), x: brief(x), zoom: brief(zoom) } });
}

/** Changes the zoom by a factor, about a position on the screen or the centre. */
export function zoomBy(factor: number, at?: { top: number; left: number }): void {
  const frame = at ? frameAt(at.left) : frames.value[0];
  if (!frame || !look.value) return;
  const { top, left } = at ?? { top: frame.top + frame.height / 2, left: frame.left + frame.width / 2 };
  show(zoomedAt(frame, look.value, factor, top, left));
}

function pan(down: number, right: number): void {
  const frame = frames.value[0];
  if (frame && look.value) show(panned(frame, look.value, down, right));
}

/** Shows the whole image. */
export const zoomToFit = (): void => update({ look: null });

/** Moves the chosen pixel by entries, and keeps it visible. Without a chosen pixel, chooses the one in the centre. */
function movePixel(down: number, right: number): void {
  const s = shown.value;
  const itsSlice = slice.value;
  if (!s || !itsSlice) return;
  const [rows, columns] = [lengthOf(itsSlice, "y"), lengthOf(itsSlice, "x")];
  const old = state.value.pixel;
  const clamp = (v: number, n: number): number => Math.max(0, Math.min(n - 1, v));
  const pixel: [number, number] = old
    ? [clamp(old[0] + down, rows), clamp(old[1] + right, columns)]
    : [Math.floor(rows / 2), Math.floor(columns / 2)];
  update({ pixel });
  const [frame, current] = [frames.value[0], look.value];
  if (!frame || !current || s.main.cellHeight > 0) return;
  const [top, left] = toScreen(frame, current, pixel[0] + 0.5, pixel[1] + 0.5);
  if (top < frame.top || top > frame.top + frame.height || left < frame.left || left > frame.left + frame.width) {
    show({ ...current, y: pixel[0] + 0.5, x: pixel[1] + 0.5 });
  }
}

const ARROWS: Record<string, [number, number]> = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };

function key(event: KeyboardEvent): void {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const arrow = ARROWS[event.key];
  if (arrow) {
    if (event.shiftKey) movePixel(...arrow);
    else pan(-arrow[0] * STEP_PX, -arrow[1] * STEP_PX);
  } else if (event.key === "+" || event.key === "=") zoomBy(ZOOM_STEP);
  else if (event.key === "-") zoomBy(1 / ZOOM_STEP);
  else if (event.key === "0") zoomToFit();
  else return;
  event.preventDefault();
  event.stopPropagation();
}

function draw(canvas: HTMLCanvasElement): void {
  const { width, height } = size.value;
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d", { alpha: false })!;
  const style = getComputedStyle(canvas);
  const colours: CanvasColours = {
    background: style.getPropertyValue("--image-background").trim(), hatch: style.getPropertyValue("--hatch").trim(),
  };
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.fillStyle = colours.background;
  context.fillRect(0, 0, width, height);
  const [s, current] = [shown.value, look.value];
  if (!s || !current) return;
  const { rows, columns } = s;
  const split = divider.value * width;
  frames.value.forEach((frame, i) => {
    const second = s.other && (s.mode === "side" ? i === 1 : s.mode === "flicker" && flickerSecond.value) ? s.other : null;
    const picture = second ?? s.main;
    drawPicture(context, frame, current, picture, rows, columns, colours, s.mode === "split" ? [0, split] : null, true);
    if (s.detail && !second) {
      drawPicture(context, frame, current, s.detail, rows, columns, colours, s.mode === "split" ? [0, split] : null, false);
    }
    if (s.mode === "split" && s.other) {
      drawPicture(context, frame, current, s.other, rows, columns, colours, [split, width], true);
    } else {
      drawValues(context, frame, current, s.detail && !second ? s.detail : picture, rows, columns);
    }
    if (state.value.pixel) drawCrosshair(context, frame, current, picture, state.value.pixel);
  });
}

/** Returns the text about the pixel under the pointer, or about the chosen pixel. */
const status = computed((): string => {
  const s = shown.value;
  const itsSlice = slice.value;
  const pixel = hover.value ?? state.value.pixel;
  if (!s || !itsSlice || !pixel) return "Point at a pixel to read its value. Click to choose it.";
  const [y, x] = (["y", "x"] as const).map((kind, i) => axisOf(itsSlice, kind)?.coords[pixel[i]] ?? pixel[i]);
  const of = (picture: Shown["main"] | null): string | null => {
    const index = picture && indexOf(picture, pixel);
    if (!picture || index === null) return null;
    const rgba = picture.rgba[Math.floor(index / picture.width) * picture.canvas.width + (index % picture.width)];
    if (rgba === 0) return busy.value < 1 ? "not read yet" : "not rendered";
    const element = hover.value ? hoverElement.value : null;
    return readingText(picture.read(index, element), picture.legend?.unit ?? s.unit);
  };
  const value = of(s.detail) ?? of(s.main) ?? "";
  const second = s.other ? ` | second image: ${of(s.other) ?? ""}` : "";
  const binned = s.main.bin > 1 && !s.detail ? ` (mean of ${s.main.bin} × ${s.main.bin} pixels)` : "";
  return `${hover.value ? "Pixel" : "Chosen pixel"} y ${y}, x ${x}: ${value}${binned}${second}`;
});

function choose(top: number, left: number): void {
  const [s, frame, current] = [shown.value, frameAt(left), look.value];
  if (!s || !frame || !current) return;
  const hit = hitOf(s.main, s.rows, s.columns, ...toImage(frame, current, top, left));
  if (!hit) return;
  update(hit.element ? { pixel: hit.pixel, row: hit.element[0], column: hit.element[1] } : { pixel: hit.pixel });
}

function point(top: number, left: number): void {
  const [s, frame, current] = [shown.value, frameAt(left), look.value];
  const hit = s && frame && current && hitOf(s.main, s.rows, s.columns, ...toImage(frame, current, top, left));
  hover.value = hit ? hit.pixel : null;
  hoverElement.value = hit ? hit.element : null;
}

function Divider() {
  const move = (event: KeyboardEvent): void => {
    const step = event.shiftKey ? 0.1 : 0.01;
    const to = { ArrowLeft: divider.value - step, ArrowRight: divider.value + step, Home: 0, End: 1 }[event.key];
    if (to === undefined) return;
    divider.value = Math.max(0, Math.min(1, to));
    event.preventDefault();
    event.stopPropagation();
  };
  const drag = (event: PointerEvent): void => {
    const handle = event.currentTarget as HTMLElement;
    if (!handle.hasPointerCapture(event.pointerId)) return;
    const box = handle.parentElement!.getBoundingClientRect();
    divider.value = Math.max(0, Math.min(1, (event.clientX - box.left) / box.width));
  };
  return (
    <div
      class="divider" role="separator" tabIndex={0} aria-orientation="vertical" aria-label="Divider between the two images"
      aria-valuemin={0} aria-valuemax={100} aria-valuenow={Math.round(100 * divider.value)}
      style={{ left: `${100 * divider.value}%` }} onKeyDown={move} onPointerMove={drag}
      onPointerDown={(event) => (event.currentTarget as HTMLElement).setPointerCapture(event.pointerId)}
    />
  );
}

export function ImagePanel() {
  const box = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);

  useEffect(() => {
    const observer = new ResizeObserver(([entry]) => {
      size.value = { width: entry.contentRect.width, height: entry.contentRect.height };
    });
    observer.observe(box.current!);
    let request = 0;
    const stop = effect(() => {
      // Read everything that `draw` reads, so that the effect runs when it changes. Several changes are drawn once.
      void [shown.value, look.value, frames.value, divider.value, flickerSecond.value, state.value.pixel, darkTheme.value];
      cancelAnimationFrame(request);
      // The panel may be gone when the frame is drawn.
      request = requestAnimationFrame(() => canvas.current && draw(canvas.current));
    });
    const silent = listen(canvas.current!, {
      drag: pan,
      zoom: (factor, top, left) => zoomBy(factor, { top, left }),
      click: choose,
      doubleClick: (top, left) => zoomBy(2, { top, left }),
      move: point,
      leave: () => (hover.value = null),
    });
    return () => {
      observer.disconnect();
      cancelAnimationFrame(request);
      stop();
      silent();
    };
  }, []);

  useSignalEffect(() => {
    const [s, frame, current] = [shown.value, frames.value[0], look.value];
    visible.value = s && frame && current && s.main.cellHeight === 0 ? visibleEntries(frame, current) : null;
  });

  useSignalEffect(() => {
    if (shown.value?.mode !== "flicker" || prefersStill()) {
      flickerSecond.value = false;
      return;
    }
    const timer = setInterval(() => (flickerSecond.value = !flickerSecond.value), 1000 / (2 * FLICKER_HZ));
    return () => clearInterval(timer);
  });

  const s = shown.value;
  const done = busy.value;
  return (
    <section class="image-panel" aria-label="Image">
      <div class="image-box" ref={box}>
        <canvas
          ref={canvas} class="image" tabIndex={0} role="application" onKeyDown={key} data-ready={s !== null && done >= 1}
          aria-label="Image. Arrow keys move it, plus and minus zoom, 0 shows all, Shift with arrow keys moves the chosen pixel."
        />
        {s?.mode === "split" && <Divider />}
        <div class="zoom-buttons" role="group" aria-label="Zoom">
          <button type="button" aria-label="Zoom in" title="Zoom in (+)" onClick={() => zoomBy(ZOOM_STEP)}>+</button>
          <button type="button" aria-label="Zoom out" title="Zoom out (−)" onClick={() => zoomBy(1 / ZOOM_STEP)}>−</button>
          <button type="button" aria-label="Show the whole image" title="Show the whole image (0)" onClick={zoomToFit}>⤢</button>
        </div>
        {!s && <p class="image-empty">{done < 1 ? "Reading …" : "No image. Choose a store and a slice."}</p>}
      </div>
      <div class="image-foot">
        <p class="status" data-testid="status" title={status.value}>{status.value}</p>
        {s?.main.legend ? <ColourBar legend={s.main.legend} /> : null}
        {s?.main.white != null && <p class="white">White: {s.main.white.toPrecision(3)} {s.unit}</p>}
        <progress
          class="busy" max={1} value={done} aria-label="Fraction of the image that has been read" data-idle={done >= 1}
        />
        {s?.main.hasMissing && done >= 1 && <p class="white">Hatched: not rendered</p>}
        {s && s.notes.length > 0 && <ul class="notes">{s.notes.map((note) => <li key={note}>{note}</li>)}</ul>}
      </div>
    </section>
  );
}
