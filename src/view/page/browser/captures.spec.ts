/** Frames of a rig's run, and simulated captures. */

import type { Page } from "@playwright/test";
import { bench, expect, open, ready, test } from "./page";

test("a run of captures shows frames and recorded angles", async ({ page }) => {
  await page.goto(bench.address);
  await page.getByRole("complementary", { name: "Tour" }).getByRole("button", { name: "Skip the tour" }).click();
  await page.getByRole("combobox", { name: "Store" }).selectOption({ label: "captures.zarr" });
  const panel = page.getByRole("region", { name: "Captured frames" });
  const map = panel.getByRole("application", { name: /^Frame/ });
  await expect(map).toHaveAttribute("aria-label", /64 rows, 64 columns, values from .* DN/);
  const angles = panel.locator("table.columns [data-value]");
  const read = async (): Promise<string> => {
    const values = await angles.evaluateAll((all) => all.map((cell) => cell.getAttribute("data-value")));
    return [await map.getAttribute("aria-label"), ...values].join(" ");
  };
  const seen = new Set([await read()]);
  const capture = panel.getByRole("slider", { name: "capture", exact: true });
  for (const index of [1, 7, 15]) {
    await capture.fill(String(index));
    await expect.poll(read).not.toBe([...seen].at(-1));
    seen.add(await read());
  }
  expect(seen.size).toBe(4);
});

/** Returns a number of the trial, after the trial has been answered. */
async function trialNumber(page: Page, name: string): Promise<number> {
  const panel = page.getByRole("region", { name: "Simulated captures" });
  await page.waitForTimeout(300);
  await expect(panel.locator("[aria-busy=true]")).toHaveCount(0);
  return Number(await panel.locator(`tr[data-number="${name}"] [data-value]`).getAttribute("data-value"));
}

test("the error of simulated captures follows the scheme and the detector", async ({ page }) => {
  await open(page, bench.address, {
    slice: "polarimetric", wavelength: 1, panels: { time: true, matrix: true, origin: true, sphere: true, captures: true },
  });
  await ready(page);
  const panel = page.getByRole("region", { name: "Simulated captures" });
  await expect(panel.locator('tr[data-number="rmse"]')).toBeVisible();
  const first = await trialNumber(page, "rmse");
  const predicted = await trialNumber(page, "predicted");
  expect(first / predicted).toBeGreaterThan(0.9);
  expect(first / predicted).toBeLessThan(1.1);
  await panel.getByRole("spinbutton", { name: "Standard deviation" }).fill("1");
  const noisy = await trialNumber(page, "rmse");
  expect(noisy / first).toBeGreaterThan(9);
  expect(noisy / first).toBeLessThan(11);
  await panel.getByRole("combobox", { name: "Scheme" }).selectOption("liquid-crystal");
  const other = await trialNumber(page, "rmse");
  expect(Math.abs(other / noisy - 1)).toBeGreaterThan(1e-3);
  await panel.getByRole("combobox", { name: "Detector" }).selectOption("toml");
  const camera = await trialNumber(page, "rmse");
  expect(camera).toBeGreaterThan(0);
  expect(Math.abs(camera / other - 1)).toBeGreaterThan(1e-3);
});
