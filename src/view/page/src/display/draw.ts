/** Draws pictures on the canvas of the image panel: the image, values of single pixels, the chosen pixel. */

import type { Picture } from "./picture";
import { brief } from "./scale";
import { toImage, toScreen, type Frame, type Look } from "./viewport";

/** Screen pixels per entry from which values are printed inside pixels. */
const VALUES_ZOOM = 40;
/** Most pixels whose values are printed. */
const MAX_VALUES = 4000;

/** Colours of the canvas that follow the theme. */
export interface CanvasColours {
  background: string;
  hatch: string;
}

let hatch: { colour: string; pattern: CanvasPattern } | null = null;

/** Returns diagonal lines, for values that are not rendered. */
function hatched(context: CanvasRenderingContext2D, { background, hatch: colour }: CanvasColours): CanvasPattern {
  if (hatch?.colour === colour + background) return hatch.pattern;
  const tile = document.createElement("canvas");
  tile.width = tile.height = 8;
  const c = tile.getContext("2d")!;
  c.fillStyle = background;
  c.fillRect(0, 0, 8, 8);
  c.strokeStyle = colour;
  c.lineWidth = 1.5;
  for (const shift of [-8, 0, 8]) {
    c.beginPath();
    c.moveTo(shift, 8);
    c.lineTo(shift + 8, 0);
    c.stroke();
  }
  hatch = { colour: colour + background, pattern: context.createPattern(tile, "repeat")! };
  return hatch.pattern;
}

/** The position of a picture in the image: its first entry along y and x, and its size in entries. */
function extent(picture: Picture): { y: number; x: number; height: number; width: number } {
  const { canvas, bin, region, cellHeight } = picture;
  const [y, x] = cellHeight > 0 ? [0, 0] : [region[0], region[2]];
  return { y, x, height: canvas.height * bin, width: canvas.width * bin };
}

/** The size in entries of what a picture fills when it shows the whole slice. A grid is larger than the slice. */
export function filled(picture: Picture, rows: number, columns: number): { rows: number; columns: number } {
  if (picture.cellHeight === 0) return { rows, columns };
  return { rows: picture.canvas.height * picture.bin, columns: picture.canvas.width * picture.bin };
}

/** Where a point of the image is: the entry of y and x and, for a grid, the element. Null: outside, or between cells. */
export interface Hit {
  pixel: [number, number];
  element: [number, number] | null;
}

/** Returns what a point of the image shows. */
export function hitOf(picture: Picture, rows: number, columns: number, y: number, x: number): Hit | null {
  const { cellHeight, cellWidth, bin } = picture;
  let [row, column] = [Math.floor(y), Math.floor(x)];
  let element: [number, number] | null = null;
  if (cellHeight > 0) {
    element = [Math.floor(row / (cellHeight * bin)), Math.floor(column / (cellWidth * bin))];
    row -= element[0] * cellHeight * bin;
    column -= element[1] * cellWidth * bin;
    if (element.some((k) => k < 0 || k > 3)) return null;
  }
  return row >= 0 && row < rows && column >= 0 && column < columns ? { pixel: [row, column], element } : null;
}

/** Returns the index of the value of an entry in a picture, or null if the picture does not have it. */
export function indexOf(picture: Picture, [row, column]: [number, number]): number | null {
  const { region, bin, height, width } = picture;
  const [i, j] = [Math.floor((row - region[0]) / bin), Math.floor((column - region[2]) / bin)];
  return i >= 0 && i < height && j >= 0 && j < width ? i * width + j : null;
}

/** Draws a picture into a frame. `clip` limits the drawing to a part of the frame: left and right, in screen pixels. */
export function drawPicture(
  context: CanvasRenderingContext2D, frame: Frame, look: Look, picture: Picture, rows: number, columns: number,
  colours: CanvasColours, clip: [number, number] | null, under: boolean,
): void {
  const { y, x, height, width } = extent(picture);
  const [top, left] = toScreen(frame, look, y, x);
  const [bottom, right] = toScreen(frame, look, y + height, x + width);
  context.save();
  context.beginPath();
  const [from, to] = clip ?? [frame.left, frame.left + frame.width];
  context.rect(from, frame.top, to - from, frame.height);
  context.clip();
  // Values of the last row and column of bins may average fewer entries than `bin`.
  const whole = filled(picture, rows, columns);
  const [endBottom, endRight] = toScreen(frame, look, Math.min(whole.rows, y + height), Math.min(whole.columns, x + width));
  context.beginPath();
  context.rect(left, top, endRight - left, endBottom - top);
  context.clip();
  if (under && picture.hasMissing) {
    context.fillStyle = hatched(context, colours);
    for (const [cellTop, cellLeft] of corners(frame, look, picture)) {
      const cell = picture.cellHeight > 0
        ? [rows * look.zoom * frame.stretch, columns * look.zoom] : [bottom - top, right - left];
      context.fillRect(cellLeft, cellTop, cell[1], cell[0]);
    }
  }
  context.imageSmoothingEnabled = look.zoom * picture.bin < 1;
  context.imageSmoothingQuality = "high";
  context.drawImage(picture.canvas, left, top, right - left, bottom - top);
  context.restore();
}

/** Returns the screen positions of the upper left corners of a picture's cells, or of the picture. */
function corners(frame: Frame, look: Look, picture: Picture): [number, number][] {
  const { cellHeight, cellWidth, bin } = picture;
  const { y, x } = extent(picture);
  if (cellHeight === 0) return [toScreen(frame, look, y, x)];
  return Array.from({ length: 16 }, (_, k) => toScreen(frame, look, (k >> 2) * cellHeight * bin, (k & 3) * cellWidth * bin));
}

/** Prints the values of pixels that are large enough on the screen. */
export function drawValues(
  context: CanvasRenderingContext2D, frame: Frame, look: Look, picture: Picture, rows: number, columns: number,
): void {
  const { zoom } = look;
  if (zoom * picture.bin < VALUES_ZOOM || zoom * picture.bin * frame.stretch < VALUES_ZOOM / 2) return;
  const { bin } = picture;
  const [y0, x0] = toImage(frame, look, frame.top, frame.left);
  const [y1, x1] = toImage(frame, look, frame.top + frame.height, frame.left + frame.width);
  const whole = filled(picture, rows, columns);
  const first = (v: number): number => Math.max(0, Math.floor(v / bin) * bin);
  const [lastY, lastX] = [Math.min(whole.rows, y1), Math.min(whole.columns, x1)];
  if (((lastY - first(y0)) * (lastX - first(x0))) / (bin * bin) > MAX_VALUES) return;
  const lines = picture.legend ? 1 : 3;
  const size = Math.min(13, (zoom * bin * frame.stretch) / (lines + 1), (zoom * bin) / 4.5);
  if (size < 6) return;
  context.save();
  context.beginPath();
  context.rect(frame.left, frame.top, frame.width, frame.height);
  context.clip();
  context.font = `${size}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (let y = first(y0); y < lastY; y += bin) {
    for (let x = first(x0); x < lastX; x += bin) {
      const hit = hitOf(picture, rows, columns, y, x);
      const index = hit && indexOf(picture, hit.pixel);
      if (hit === null || index === null) continue;
      const { y: startY, x: startX } = extent(picture);
      const rgba = picture.rgba[Math.floor((y - startY) / bin) * picture.canvas.width + Math.floor((x - startX) / bin)];
      if (rgba === 0) continue;
      const [r, g, b] = [rgba & 255, (rgba >> 8) & 255, (rgba >> 16) & 255];
      context.fillStyle = 0.299 * r + 0.587 * g + 0.114 * b > 140 ? "#000" : "#fff";
      const [top, left] = toScreen(frame, look, y + bin / 2, x + bin / 2);
      const texts = picture.read(index, hit.element).map(({ value }) => brief(value, 3)).slice(0, 4);
      texts.forEach((text, i) => context.fillText(text, left, top + (i - (texts.length - 1) / 2) * 1.15 * size, zoom * bin - 2));
    }
  }
  context.restore();
}

/** Marks the chosen pixel with lines that leave the pixel itself visible. */
export function drawCrosshair(
  context: CanvasRenderingContext2D, frame: Frame, look: Look, picture: Picture, [row, column]: [number, number],
): void {
  const { cellHeight, cellWidth, bin } = picture;
  const cells = cellHeight > 0 ? 16 : 1;
  context.save();
  context.beginPath();
  context.rect(frame.left, frame.top, frame.width, frame.height);
  context.clip();
  for (let k = 0; k < cells; k++) {
    const y = row + (k >> 2) * cellHeight * bin;
    const x = column + (k & 3) * cellWidth * bin;
    const [top, left] = toScreen(frame, look, y, x);
    const [bottom, right] = toScreen(frame, look, y + 1, x + 1);
    const [middleY, middleX] = [(top + bottom) / 2, (left + right) / 2];
    const [nearY, nearX] = [Math.max(4, (bottom - top) / 2), Math.max(4, (right - left) / 2)];
    const length = cells > 1 ? 6 : 12;
    context.beginPath();
    if (right - left >= 6) context.rect(left, top, right - left, bottom - top);
    for (const [dy, dx] of [[-1, 0], [1, 0], [0, -1], [0, 1]]) {
      context.moveTo(middleX + dx * nearX, middleY + dy * nearY);
      context.lineTo(middleX + dx * (nearX + length), middleY + dy * (nearY + length));
    }
    // Dark below light, so that the mark is visible on every colour.
    context.lineWidth = 4;
    context.strokeStyle = "#000";
    context.stroke();
    context.lineWidth = 2;
    context.strokeStyle = "#fff";
    context.stroke();
  }
  context.restore();
}
