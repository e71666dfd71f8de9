/** Time: light in flight, gates, time profiles and pulses. */

import { bench, choosePixel, expect, expectShown, open, reading, ready, stateOf, test } from "./page";
import { probe } from "./program";

test("scrubbing shows the light of each time bin", async ({ page }) => {
  await open(page, bench.address, { slice: "flight", quantity: "intensity", wavelength: 1 });
  const [y, x] = await choosePixel(page, 0.5, 0.5);
  const profile = probe(bench.room, "flight", "-k", `y=${y}`, "-k", `x=${x}`, "-k", "wavelength=550");
  const brightest = profile.reduce((best, row, i) => (row.mean > profile[best].mean ? i : best), 0);
  const slider = page.getByRole("slider", { name: "Time bin", exact: true });
  for (const bin of [brightest, brightest + 3]) {
    await slider.fill(String(bin));
    await expect.poll(() => stateOf(page, "time")).toBe(bin);
    await expect(page.getByTestId("time")).toHaveText(`${profile[bin].t} ps`);
    await ready(page);
    await expect.poll(async () => Math.abs((await reading(page)).value - profile[bin].mean))
      .toBeLessThanOrEqual(1e-3 * profile[bin].mean);
  }
  await slider.focus();
  await page.keyboard.press("ArrowRight");
  await expect.poll(() => stateOf(page, "time")).toBe(brightest + 4);
  await page.getByRole("button", { name: "Sum over time" }).click();
  const sum = profile.reduce((total, row) => total + row.mean, 0);
  await expect.poll(async () => Math.abs((await reading(page)).value - sum)).toBeLessThan(1e-3 * sum);
});

test("light in flight is played and paused", async ({ page }) => {
  await open(page, bench.address, { slice: "flight" });
  const time = async (): Promise<number> => parseFloat(await page.getByTestId("time").innerText());
  await page.getByRole("button", { name: "Play" }).click();
  await expect.poll(time).toBeGreaterThan(0);
  const first = await time();
  await expect.poll(time).toBeGreaterThan(first + 1000);
  await page.getByRole("button", { name: "Pause" }).click();
  const paused = await time();
  await page.waitForTimeout(300);
  expect(await time()).toBe(paused);
});

test("a gate sums its time bins", async ({ page }) => {
  const gate: [number, number] = [10, 24];
  await open(page, bench.address, { slice: "flight", quantity: "intensity", wavelength: 0, pixel: [64, 70], gate });
  const { pixel: [y, x], value } = await reading(page);
  const profile = probe(bench.room, "flight", "-k", `y=${y}`, "-k", `x=${x}`, "-k", "wavelength=450");
  expectShown([value], [profile.slice(gate[0], gate[1] + 1).reduce((sum, row) => sum + row.mean, 0)], 1e-3);
});

test("the time profile of a pixel follows the pulse", async ({ page }) => {
  for (const pulse of [null, 200]) {
    await open(page, bench.address, { slice: "xt", pixel: [0, 163], pulse, time: 100 });
    const words = ["-k", "x=163", "-k", "stokes_out=0", "-k", "stokes_in=0", "--sum", "y"];
    const rows = probe(bench.room, "xt", ...words, ...(pulse === null ? [] : ["--pulse", `gaussian:${pulse}`]));
    const t = [...new Set(rows.map((row) => row.t))][100];
    const readouts = page.locator(".profile .readout[data-value]");
    await expect(readouts).toHaveCount(3);
    const shown = await readouts.evaluateAll((all) => all.map((span) => Number(span.getAttribute("data-value"))));
    expectShown(shown, rows.filter((row) => row.t === t).map((row) => row.mean), 1e-5);
  }
});
