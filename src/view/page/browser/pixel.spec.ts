/** The image, the chosen pixel, and where its light came from. */

import { bench, choosePixel, expect, expectShown, imageOf, matrixOf, open, reading, stateOf, test } from "./page";
import { probe } from "./program";

test("the mirror room opens with an image", async ({ page }) => {
  await open(page, bench.address);
  const colours = await imageOf(page).evaluate((canvas: HTMLCanvasElement) => {
    const { data } = canvas.getContext("2d")!.getImageData(0, 0, canvas.width, canvas.height);
    return new Set(new Uint32Array(data.buffer)).size;
  });
  expect(colours).toBeGreaterThan(1000);
});

test("a click on a pixel shows the matrix that the command prints", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric", normalized: false, wavelength: 1 });
  const [y, x] = await choosePixel(page, 0.6, 0.55);
  await expect.poll(() => stateOf(page, "pixel")).toEqual([y, x]);
  const rows = probe(bench.room, "polarimetric", "-k", `y=${y}`, "-k", `x=${x}`, "-k", "wavelength=550");
  const { values, errors } = await matrixOf(page);
  expectShown(values, rows.map((row) => row.mean), 1e-6);
  expectShown(errors, rows.map((row) => row.std_error), 1e-6);
});

test("the image keeps its place while pixels are pointed at and chosen", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric" });
  const before = (await imageOf(page).boundingBox())!;
  await page.mouse.move(before.x + 0.4 * before.width, before.y + 0.4 * before.height);
  await expect(page.getByTestId("status")).toHaveText(/^Pixel/);
  expect(await imageOf(page).boundingBox()).toEqual(before);
  await choosePixel(page, 0.4, 0.4);
  await matrixOf(page);
  expect(await imageOf(page).boundingBox()).toEqual(before);
});

test("the values below the image are those of the command", async ({ page }) => {
  for (const [row, column] of [[0, 0], [1, 1], [2, 3]]) {
    await open(page, bench.address, { slice: "polarimetric", quantity: "element", row, column, normalized: false, wavelength: 2 });
    const [y, x] = await choosePixel(page, 0.45, 0.52);
    const words = [`y=${y}`, `x=${x}`, "wavelength=660", `stokes_out=${row}`, `stokes_in=${column}`].flatMap((word) => ["-k", word]);
    const [{ mean }] = probe(bench.room, "polarimetric", ...words);
    expectShown([(await reading(page)).value], [mean], 1e-3);
  }
});

test("the keyboard moves the chosen pixel", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric", pixel: [100, 120] });
  await imageOf(page).focus();
  await page.keyboard.press("Shift+ArrowRight");
  await page.keyboard.press("Shift+ArrowDown");
  await expect.poll(() => stateOf(page, "pixel")).toEqual([101, 121]);
  await page.keyboard.press("+");
  await expect.poll(() => stateOf(page, "look")).toBeTruthy();
  await page.keyboard.press("0");
  await expect.poll(() => stateOf(page, "look")).toBeUndefined();
});

test("the origin of a pixel's light sums to its value", async ({ page }) => {
  await open(page, bench.address, { slice: "ss", pixel: [0, 163], wavelength: 1 });
  const panel = page.getByRole("region", { name: "Origin of the light" });
  const origin = probe(bench.room, "ss", "-k", "x=163", "-k", "wavelength=550", "-k", "stokes_out=0", "-k", "stokes_in=0", "--sum", "y,v");
  const total = origin.reduce((sum, row) => sum + row.mean, 0);
  const strongest = origin.reduce((best, row) => (row.mean > best.mean ? row : best));
  const shown = panel.locator(".origin-total [data-value]");
  await expect(shown).toHaveCount(1);
  expectShown([Number(await shown.getAttribute("data-value"))], [total], 1e-5);
  await expect(panel.locator("[data-share]")).toContainText(`u ${strongest.u} px`);
});
