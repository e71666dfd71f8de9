/** A static export on a plain file server: the page computes the numbers itself. */

import { bench, choosePixel, expect, expectShown, matrixOf, open, reading, test } from "./page";
import { probe } from "./program";

test("a click on a pixel of an export shows the numbers of the command", async ({ page }) => {
  await open(page, bench.exported, { slice: "polarimetric", normalized: false, wavelength: 1 });
  const [y, x] = await choosePixel(page, 0.6, 0.55);
  const { values, errors } = await matrixOf(page);
  const rows = probe(bench.room, "polarimetric", "-k", `y=${y}`, "-k", `x=${x}`, "-k", "wavelength=550");
  expectShown(values, rows.map((row) => row.mean), 1e-6);
  expectShown(errors, rows.map((row) => row.std_error), 1e-6);
});

test("an export shows light in flight, pulses and states", async ({ page }) => {
  await open(page, bench.exported, {
    slice: "xt", quantity: "intensity", wavelength: 1, pixel: [0, 163], input: [1, 0.6, 0, -0.8], pulse: 80, time: 90,
  });
  const { value } = await reading(page);
  const words = ["-k", "x=163", "-k", "stokes_out=0", "-k", "wavelength=550", "-k", "t=15262.5", "--sum", "y"];
  const [{ mean }] = probe(bench.room, "xt", ...words, "--stokes", "1,0.6,0,-0.8", "--pulse", "gaussian:80");
  expectShown([value], [mean], 1e-3);
});

test("the notes of an export are those of the command", async ({ page }) => {
  await open(page, bench.exported, { slice: "flight", pixel: [64, 70] });
  await expect(page.getByRole("region", { name: "Pixel", exact: true })).toContainText("arrived outside the stored time bins");
});

test("an export says what it cannot do", async ({ page }) => {
  await open(page, bench.exported, { slice: "polarimetric" });
  await page.getByRole("button", { name: "Simulated captures" }).or(page.getByText("Simulated captures")).first().click();
  await expect(page.getByRole("region", { name: "Simulated captures" })).toContainText("cannot simulate captures");
});
