/** Writes pictures as PNG and SVG files, with a colour bar. */

import type { Legend } from "./legend";
import type { Picture } from "./picture";
import { stretchOf } from "./viewport";

/** Side in pixels that a small image is enlarged to, by a whole factor. */
const SIDE = 1024;
const BAR = { height: 72, margin: 24, thickness: 14 };

/** Returns the size of a picture in the file. Every value has a whole number of pixels. */
function sizeOf(picture: Picture): { width: number; height: number } {
  const { width, height } = picture.canvas;
  const factor = Math.max(1, Math.floor(SIDE / Math.max(width, height)));
  return { width: width * factor, height: height * factor * stretchOf(height, width) };
}

const escaped = (text: string): string => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll('"', "&quot;");

/** Offers a file to the user. */
export function download(name: string, content: BlobPart, type: string): void {
  const url = URL.createObjectURL(new Blob([content], { type }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  // The browser reads the file after the click.
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/** Returns the canvas of a picture, with a colour bar if `title` is given. */
export function pictureCanvas(picture: Picture, title: string | null): HTMLCanvasElement {
  const { width, height } = sizeOf(picture);
  const { legend } = picture;
  const hasBar = title !== null && legend !== null;
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height + (hasBar ? BAR.height : 0);
  const context = canvas.getContext("2d")!;
  if (hasBar) {
    context.fillStyle = "#fff";
    context.fillRect(0, height, width, BAR.height);
  }
  context.imageSmoothingEnabled = false;
  context.drawImage(picture.canvas, 0, 0, width, height);
  if (hasBar) {
    const length = width - 2 * BAR.margin;
    const top = height + 28;
    context.drawImage(barCanvas(legend), BAR.margin, top, length, BAR.thickness);
    context.fillStyle = "#000";
    context.font = "14px system-ui, sans-serif";
    context.fillText(title, BAR.margin, height + 20, length);
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    for (const tick of legend.ticks) {
      const left = BAR.margin + tick.at * length;
      context.fillRect(left - 0.5, top + BAR.thickness, 1, 4);
      context.fillText(tick.label, left, top + BAR.thickness + 17);
    }
  }
  return canvas;
}

function barCanvas(legend: Legend): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = 256;
  canvas.height = 1;
  const context = canvas.getContext("2d")!;
  const data = context.createImageData(256, 1);
  for (let k = 0; k < 256; k++) data.data.set([...legend.map.subarray(3 * k, 3 * k + 3), 255], 4 * k);
  context.putImageData(data, 0, 0);
  return canvas;
}

/** Returns a picture as SVG: the image embedded, the colour bar and its labels as vectors. */
export function pictureSvg(picture: Picture, title: string): string {
  const { width, height } = sizeOf(picture);
  const { legend } = picture;
  const image = picture.canvas.toDataURL("image/png");
  const length = width - 2 * BAR.margin;
  const top = height + 28;
  const lines = [
    `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height + BAR.height}"` +
      ` viewBox="0 0 ${width} ${height + BAR.height}" font-family="sans-serif">`,
    `<rect width="100%" height="100%" fill="#fff"/>`,
    `<image width="${width}" height="${height}" preserveAspectRatio="none" image-rendering="pixelated" href="${image}"/>`,
    `<text x="${BAR.margin}" y="${height + 20}" font-size="14">${escaped(title)}</text>`,
  ];
  if (legend) {
    const stops = Array.from({ length: 33 }, (_, i) => {
      const k = Math.round((i * 255) / 32);
      const [r, g, b] = legend.map.subarray(3 * k, 3 * k + 3);
      return `<stop offset="${(i / 32).toFixed(5)}" stop-color="rgb(${r},${g},${b})"/>`;
    });
    lines.push(
      `<defs><linearGradient id="bar">${stops.join("")}</linearGradient></defs>`,
      `<rect x="${BAR.margin}" y="${top}" width="${length}" height="${BAR.thickness}" fill="url(#bar)"/>`,
    );
    for (const tick of legend.ticks) {
      const left = BAR.margin + tick.at * length;
      lines.push(
        `<path d="M${left.toFixed(2)} ${top + BAR.thickness}v4" stroke="#000"/>`,
        `<text x="${left.toFixed(2)}" y="${top + BAR.thickness + 17}" font-size="12" text-anchor="middle">${escaped(tick.label)}</text>`,
      );
    }
  }
  return `${lines.join("\n")}\n</svg>\n`;
}

/** Returns a canvas as the bytes of a PNG file. */
export const canvasPng = (canvas: HTMLCanvasElement): Promise<Blob> =>
  new Promise((resolve, reject) => {
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("cannot encode the image"))), "image/png");
  });
