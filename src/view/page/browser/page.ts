/** Opens the explorer in tests. Every test fails if the page writes an error or a warning to the console. */

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test as base, expect, type Locator, type Page } from "@playwright/test";
import type { ViewState } from "../src/state";
import { ROOT } from "./program";
import type { Bench } from "./setup";

/** Folder of screenshots. */
export const PICTURES = join(ROOT, "target/view");

/** The stores and addresses that `setup.ts` prepared. */
export const bench: Bench = process.env.VIEW_BENCH ? JSON.parse(process.env.VIEW_BENCH) : undefined;

/** A test whose page must not complain. */
export const test = base.extend<{ complaints: string[] }>({
  complaints: [async ({ page }, use) => {
    const complaints: string[] = [];
    page.on("console", (message) => {
      if (["error", "warning"].includes(message.type())) complaints.push(`${message.type()}: ${message.text()} ${message.location().url}`);
    });
    page.on("pageerror", (error) => complaints.push(`exception: ${error.stack ?? error.message}`));
    await serveBuilt(page);
    await use(complaints);
    expect(complaints, "messages of the page").toEqual([]);
  }, { auto: true }],
});

export { expect };

/**
 * With VIEW_BUILT, the page comes from that folder instead of the program, so that a change of the page is tested without
 * compilation of the program.
 */
async function serveBuilt(page: Page): Promise<void> {
  const folder = process.env.VIEW_BUILT;
  if (!folder) return;
  const types: Record<string, string> = { "index.html": "text/html", "app.js": "text/javascript", "app.css": "text/css" };
  for (const [name, contentType] of Object.entries(types)) {
    const isIt = (url: URL): boolean => url.pathname === `/${name}` || (name === "index.html" && url.pathname === "/");
    await page.context().route(isIt, (route) => route.fulfill({ contentType, body: readFileSync(join(folder, name)) }));
  }
}

/** Returns an address with a state after `#`. */
export function addressOf(address: string, view: Partial<ViewState>): string {
  const parameters = new URLSearchParams();
  for (const [key, value] of Object.entries(view)) parameters.set(key, JSON.stringify(value));
  return `${address}#${parameters}`;
}

/** Expects numbers that are shown with some digits to equal exact numbers. */
export function expectShown(shown: number[], exact: number[], relative: number): void {
  expect(shown.length).toBe(exact.length);
  const size = Math.max(...exact.map(Math.abs));
  exact.forEach((value, i) => expect(Math.abs(shown[i] - value), `${shown[i]} shown, ${value} expected`)
    .toBeLessThanOrEqual(relative * Math.abs(value) + 1e-9 * size));
}

/** The image of the explorer. */
export const imageOf = (page: Page): Locator => page.locator("canvas.image");

/** Opens an address with a state, and waits until the whole image is shown. */
export async function open(page: Page, address: string, view: Partial<ViewState> = {}): Promise<void> {
  await page.goto(addressOf(address, view));
  await ready(page);
}

/** Waits until the whole image is shown. */
export const ready = (page: Page): Promise<void> => expect(imageOf(page)).toHaveAttribute("data-ready", "true");

/** Returns a field of the state in the URL, or undefined if it has its initial value. */
export function stateOf<K extends keyof ViewState>(page: Page, field: K): ViewState[K] | undefined {
  const text = new URLSearchParams(new URL(page.url()).hash.slice(1)).get(field);
  return text === null ? undefined : JSON.parse(text);
}

/** Clicks on the image at fractions of its height and width, and returns the coordinates y and x of the chosen pixel. */
export async function choosePixel(page: Page, down: number, right: number): Promise<[number, number]> {
  const box = (await imageOf(page).boundingBox())!;
  await imageOf(page).click({ position: { x: right * box.width, y: down * box.height } });
  // Without a pointer, the line below the image is about the chosen pixel.
  await page.mouse.move(0, 0);
  await expect(page.getByTestId("status")).toHaveText(/^Chosen pixel/);
  const { pixel } = await reading(page);
  return pixel;
}

/** Returns the number of a text with typographic minus signs. */
export const number = (text: string): number => Number(text.replaceAll("−", "-"));

/** Returns the cell of a quantity in the pixel panel's table of values. */
export const cellOf = (page: Page, quantity: string, wavelength: string): Locator =>
  page.locator(`tr[data-quantity="${quantity}"] td[data-wavelength="${wavelength}"]`);

/** Returns the coordinates and the value in the line below the image. */
export async function reading(page: Page): Promise<{ pixel: [number, number]; value: number }> {
  const line = page.getByTestId("status");
  await expect(line).toHaveText(/y [\d.]+, x [\d.]+: /);
  const text = await line.innerText();
  const [, y, x] = /y ([\d.]+), x ([\d.]+): /.exec(text)!;
  return { pixel: [Number(y), Number(x)], value: number(text.split(": ").at(-1)!.split(" ")[0]) };
}

/** Returns the Mueller matrix that the pixel panel shows, and its errors, row by row. */
export async function matrixOf(page: Page): Promise<{ values: number[]; errors: number[] }> {
  const cells = page.locator("td[data-element]");
  await expect(cells).toHaveCount(16);
  const read = (name: string): Promise<number[]> =>
    cells.evaluateAll((all, attribute) => all.map((cell) => Number(cell.getAttribute(attribute))), name);
  return { values: await read("data-value"), errors: await read("data-error") };
}
