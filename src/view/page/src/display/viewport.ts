/** Maps between screen pixels and entries of an image that is panned and zoomed. Pure functions. */

/** The shown part: the entry in the centre, and screen pixels per entry. */
export interface Look {
  y: number;
  x: number;
  zoom: number;
}

/** A rectangle on the screen, and the image that is shown in it. `stretch` is the height of an entry over its width. */
export interface Frame {
  left: number;
  top: number;
  width: number;
  height: number;
  rows: number;
  columns: number;
  stretch: number;
}

/** Largest zoom in screen pixels per entry. */
export const MAX_ZOOM = 256;

/** Returns how many times higher than wide entries are drawn, so that an image of few rows is still visible. */
export const stretchOf = (rows: number, columns: number): number => Math.max(1, Math.floor(columns / (8 * rows)));

/** Returns the look that shows the whole image. */
export function fit(frame: Frame): Look {
  const zoom = Math.min(frame.width / frame.columns, frame.height / (frame.rows * frame.stretch));
  return { y: frame.rows / 2, x: frame.columns / 2, zoom: Math.max(1e-3, zoom) };
}

/** Returns the screen position of a point of the image; entry (i, j) covers [i, i + 1) x [j, j + 1). */
export const toScreen = (frame: Frame, look: Look, y: number, x: number): [number, number] => [
  frame.top + frame.height / 2 + (y - look.y) * look.zoom * frame.stretch,
  frame.left + frame.width / 2 + (x - look.x) * look.zoom,
];

/** Returns the point of the image at a screen position. */
export const toImage = (frame: Frame, look: Look, top: number, left: number): [number, number] => [
  look.y + (top - frame.top - frame.height / 2) / (look.zoom * frame.stretch),
  look.x + (left - frame.left - frame.width / 2) / look.zoom,
];

/** Returns a look that is limited so that part of the image stays visible. */
export function limited(frame: Frame, look: Look): Look {
  const least = Math.min(fit(frame).zoom / 2, 1);
  const clamp = (v: number, low: number, high: number): number => Math.max(low, Math.min(high, v));
  return { y: clamp(look.y, 0, frame.rows), x: clamp(look.x, 0, frame.columns), zoom: clamp(look.zoom, least, MAX_ZOOM) };
}

/** Returns the look after zooming by a factor, with the point at the screen position in place. */
export function zoomedAt(frame: Frame, look: Look, factor: number, top: number, left: number): Look {
  const [y, x] = toImage(frame, look, top, left);
  const zoom = limited(frame, { ...look, zoom: look.zoom * factor }).zoom;
  const moved = { y: y - (y - look.y) * (look.zoom / zoom), x: x - (x - look.x) * (look.zoom / zoom), zoom };
  return limited(frame, moved);
}

/** Returns the look after moving the image by screen pixels. */
export const panned = (frame: Frame, look: Look, down: number, right: number): Look =>
  limited(frame, { ...look, y: look.y - down / (look.zoom * frame.stretch), x: look.x - right / look.zoom });

/** Returns the entries that a frame shows: [y0, y1, x0, x1], the end excluded. */
export function visibleEntries(frame: Frame, look: Look): [number, number, number, number] {
  const [y0, x0] = toImage(frame, look, frame.top, frame.left);
  const [y1, x1] = toImage(frame, look, frame.top + frame.height, frame.left + frame.width);
  return [
    Math.max(0, Math.floor(y0)), Math.min(frame.rows, Math.ceil(y1)), Math.max(0, Math.floor(x0)), Math.min(frame.columns, Math.ceil(x1)),
  ];
}
