/** What the dialog takes out: commands that give the shown numbers, files, and the address of the view. */

import { existsSync, mkdtempSync, readFileSync } from "node:fs";
import { join } from "node:path";
import type { Page } from "@playwright/test";
import { bench, expect, expectShown, matrixOf, open, reading, test } from "./page";
import { parseCsv, shell } from "./program";

/** Copies a text of the dialog by its button, and returns the clipboard. */
async function copied(page: Page, label: string): Promise<string> {
  const button = page.getByRole("button", { name: `Copy: ${label}`, exact: true });
  await button.click();
  await expect(button).toHaveText("Copied");
  return page.evaluate(() => navigator.clipboard.readText());
}

const takeOut = (page: Page): Promise<void> => page.getByRole("button", { name: "Take out" }).click();

test("the copied command prints the matrix of the panel", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric", pixel: [140, 101], normalized: false, wavelength: 0 });
  const { values, errors } = await matrixOf(page);
  await takeOut(page);
  const line = await copied(page, "Command");
  const rows = parseCsv(shell(line, bench.folder)).filter((row) => row.wavelength === 450);
  expectShown(values, rows.map((row) => row.mean), 1e-6);
  expectShown(errors, rows.map((row) => row.std_error), 1e-6);
});

test("the copied command prints the light of a state, a pulse and a time bin", async ({ page }) => {
  await open(page, bench.address, {
    slice: "xt", quantity: "intensity", pixel: [0, 163], wavelength: 1, input: [1, 0.6, 0, -0.8], pulse: 80, time: 90,
  });
  const shown = (await reading(page)).value;
  await takeOut(page);
  await page.getByRole("combobox", { name: "Query" }).selectOption({ label: "Stokes vector of the chosen pixel for the input state" });
  const rows = parseCsv(shell(await copied(page, "Command"), bench.folder));
  const light = rows.find((row) => row.wavelength === 550 && row.stokes_out === 0)!;
  expectShown([shown], [light.mean], 1e-3);
});

test("the copied command uses the pattern that the dialog downloads", async ({ page }) => {
  const folder = mkdtempSync(join(bench.folder, "pattern-"));
  const digits = Array.from({ length: 256 }, (_, i) => (i * 7) % 10).join("");
  await open(page, bench.address, {
    slice: "ss", quantity: "intensity", pixel: [0, 163], wavelength: 1, illumination: { kind: "drawn", width: 16, height: 16, digits },
  });
  const shown = (await reading(page)).value;
  await takeOut(page);
  await page.getByRole("combobox", { name: "Query" }).selectOption({ label: "Stokes vector of the chosen pixel for the input state" });
  const download = page.waitForEvent("download");
  await page.getByRole("button", { name: "Download pattern.png" }).click();
  await (await download).saveAs(join(folder, "pattern.png"));
  const rows = parseCsv(shell(await copied(page, "Command"), folder));
  const light = rows.find((row) => row.wavelength === 550 && row.stokes_out === 0)!;
  expectShown([shown], [light.mean], 1e-3);
});

test("the copied command draws the figure", async ({ page }) => {
  const folder = mkdtempSync(join(bench.folder, "figure-"));
  await open(page, bench.address, { slice: "polarimetric" });
  await takeOut(page);
  shell(await copied(page, "Command that draws the image"), folder);
  expect(existsSync(join(folder, "polarimetric.png"))).toBe(true);
});

test("images and numbers are downloaded", async ({ page }) => {
  await open(page, bench.address, { slice: "polarimetric", quantity: "dolp", pixel: [140, 101] });
  await takeOut(page);
  const kinds: [string, (bytes: Buffer) => boolean][] = [
    ["Download PNG", (bytes) => bytes.subarray(1, 4).toString() === "PNG"],
    ["Download SVG", (bytes) => bytes.toString().includes("<svg")],
    ["Download CSV of the query", (bytes) => parseCsv(bytes.toString()).length === 48],
    ["Download CSV of the image", (bytes) => parseCsv(bytes.toString()).length === 256 * 256],
  ];
  for (const [name, isValid] of kinds) {
    const download = page.waitForEvent("download");
    await page.getByRole("button", { name, exact: true }).click();
    expect(isValid(readFileSync(await (await download).path())), name).toBe(true);
  }
});

test("the copied address opens the same view", async ({ page, context }) => {
  await open(page, bench.address, { slice: "flight", quantity: "intensity", wavelength: 1, pixel: [64, 70], time: 26 });
  const line = await page.getByTestId("status").innerText();
  await takeOut(page);
  const address = await copied(page, "Address of this view");
  const second = await context.newPage();
  await second.goto(address);
  await expect(second.getByTestId("status")).toHaveText(line);
});
