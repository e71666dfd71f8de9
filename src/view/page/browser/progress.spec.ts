/** A store that is being rendered. */

import { spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { join } from "node:path";
import { bench, cellOf, expect, imageOf, open, PICTURES, test } from "./page";
import { probe, ROOT, stop, SUNSTONE, view } from "./program";

test("a store in progress is shown as it grows, and announces its end", async ({ page }) => {
  test.setTimeout(180_000);
  const store = join(bench.folder, "growing.zarr");
  const words = ["render", "scenes/mirror_room/scene.toml", "--spp", "96", "--slices", "polarimetric", "--no-figures", "--threads", "1"];
  const render = spawn(SUNSTONE, [...words, "-o", store], { cwd: ROOT, stdio: "ignore" });
  try {
    await expect.poll(() => existsSync(join(store, "zarr.json"))).toBe(true);
    const server = await view(store);
    try {
      await open(page, server.ready[0], { slice: "polarimetric", pixel: [16, 16], normalized: false });
      const panel = page.getByRole("region", { name: "Render in progress" });
      const tiles = async (): Promise<number> => Number(/^(\d+) of 64/.exec(await panel.locator("output").first().innerText())?.[1] ?? NaN);
      /** Size of the image as a PNG file, which grows as noisy pixels replace the hatching of missing ones. */
      const size = (): Promise<number> => imageOf(page).evaluate((canvas: HTMLCanvasElement) => canvas.toDataURL().length);
      await expect.poll(tiles, { timeout: 60_000 }).toBeGreaterThan(3);
      const [before, small] = [await tiles(), await size()];
      await page.screenshot({ path: join(PICTURES, "progress.png") });
      await expect.poll(tiles, { timeout: 60_000 }).toBeGreaterThan(before + 8);
      await expect.poll(size).toBeGreaterThan(1.05 * small);
      await expect(panel).toContainText("Time left");
      await expect(page.getByRole("region", { name: "Render" })).toContainText("The store has been finished", { timeout: 120_000 });
      const [{ mean }] = probe(store, "polarimetric", "-k", "y=16", "-k", "x=16", "-k", "stokes_out=0", "-k", "stokes_in=0");
      const shown = cellOf(page, "m00", "450 nm");
      await expect.poll(async () => Number(await shown.getAttribute("data-value"))).toBeCloseTo(mean, 6);
    } finally {
      await stop(server);
    }
  } finally {
    render.kill("SIGKILL");
  }
});
