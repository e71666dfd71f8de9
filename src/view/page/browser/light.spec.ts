/** The state of the projector's light, the analyzer, and the projector's pattern. */

import type { Locator } from "@playwright/test";
import { bench, cellOf, expect, expectShown, number, open, reading, ready, stateOf, test } from "./page";
import { probe } from "./program";

const PIXEL: [number, number] = [150, 163];
const AT = ["-k", `y=${PIXEL[0]}`, "-k", `x=${PIXEL[1]}`, "-k", "wavelength=550"];

/** Drags on a sphere, at fractions of its width and height. */
async function drag(sphere: Locator, from: [number, number], to: [number, number]): Promise<void> {
  await sphere.scrollIntoViewIfNeeded();
  const box = (await sphere.boundingBox())!;
  const mouse = sphere.page().mouse;
  await mouse.move(box.x + from[0] * box.width, box.y + from[1] * box.height);
  await mouse.down();
  for (let i = 1; i <= 5; i++) {
    const [right, down] = [0, 1].map((k) => from[k] + (i / 5) * (to[k] - from[k]));
    await mouse.move(box.x + right * box.width, box.y + down * box.height);
  }
  await mouse.up();
}

test("the image follows the state that is dragged on the sphere", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric", quantity: "intensity", wavelength: 1, pixel: PIXEL });
  await drag(page.getByRole("application", { name: /^Projector light/ }), [0.5, 0.5], [0.35, 0.4]);
  await expect.poll(() => stateOf(page, "input")).toBeTruthy();
  const input = stateOf(page, "input")!;
  expect(Math.hypot(...input.slice(1))).toBeCloseTo(1, 5);
  const light = probe(bench.room, "polarimetric", ...AT, "--stokes", input.join(","));
  await ready(page);
  await expect.poll(async () => (await reading(page)).value).toBeCloseTo(light[0].mean, 3);
  expectShown([(await reading(page)).value], [light[0].mean], 1e-3);
  expectShown([number(await cellOf(page, "s0", "550 nm").innerText())], [light[0].mean], 1e-5);
});

test("an analyzer transmits half of its product with the light", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric", quantity: "intensity", wavelength: 1, pixel: PIXEL, input: [1, 0, 1, 0] });
  await page.getByRole("checkbox", { name: "Analyzer before the camera" }).check();
  await expect.poll(() => stateOf(page, "analyzer")).toEqual([1, 1, 0, 0]);
  await page.getByRole("group", { name: "Analyzer: named states" }).locator('[data-state="minus45"]').click();
  await expect.poll(() => stateOf(page, "analyzer")).toEqual([1, 0, -1, 0]);
  const light = probe(bench.room, "polarimetric", ...AT, "--stokes", "plus45").map((row) => row.mean);
  const expected = 0.5 * (light[0] - light[2]);
  await expect.poll(async () => Math.abs((await reading(page)).value - expected)).toBeLessThan(1e-3 * Math.abs(expected));
});

test("DoLP of the image is that of the outgoing light", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric", quantity: "dolp", wavelength: 1, pixel: PIXEL, input: [1, 1, 0, 0] });
  const light = probe(bench.room, "polarimetric", ...AT, "--stokes", "horizontal").map((row) => row.mean);
  expectShown([(await reading(page)).value], [Math.hypot(light[1], light[2]) / light[0]], 1e-3);
});

test("the arrow keys change the state", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric", input: [1, 1, 0, 0] });
  const sphere = page.getByRole("application", { name: /^Projector light/ });
  await sphere.focus();
  await page.keyboard.press("ArrowUp");
  await expect.poll(() => stateOf(page, "input")?.[3] ?? 0).toBeGreaterThan(0.01);
});

test("a projector column lights the image through the pattern", async ({ page }) => {
  const u = 131;
  await open(page, bench.address, {
    slice: "ss", quantity: "intensity", wavelength: 1, pixel: [0, 163], illumination: { kind: "column", u },
  });
  const words = ["-k", "x=163", "-k", "wavelength=550", "-k", `u=${u}`, "-k", "stokes_out=0", "-k", "stokes_in=0"];
  const [{ mean }] = probe(bench.room, "ss", ...words, "--sum", "y,v");
  expectShown([(await reading(page)).value], [mean], 1e-3);
});
