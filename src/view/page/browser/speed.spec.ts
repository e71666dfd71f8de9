/**
 * Measures the speed of the explorer: medians of 20. `VIEW_SPEED=1 npx playwright test speed` renders a store of 512 x 512 pixels with
 * three wavelengths; `VIEW_SPEED=STORE` measures that store. `VIEW_SLICE` names the slice, which must have Mueller matrices.
 */

import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { expect, type Page } from "@playwright/test";
import { addressOf, bench, imageOf, matrixOf, test } from "./page";
import { ROOT, stop, sunstone, view } from "./program";

const TIMES = 20;
const SLICE = process.env.VIEW_SLICE ? { slice: process.env.VIEW_SLICE } : {};

/** Renders the mirror room with 512 x 512 camera pixels, and only the slice with Mueller matrices. */
function rendered(): string {
  const folder = join(ROOT, "scenes/mirror_room");
  const text = readFileSync(join(folder, "scene.toml"), "utf8")
    .replaceAll("resolution = [256, 256]", "resolution = [512, 512]")
    .replaceAll(/file = "/g, `file = "${folder}/`);
  const scene = join(bench.folder, "large.toml");
  writeFileSync(scene, text);
  const store = join(bench.folder, "large.zarr");
  sunstone("render", scene, "--spp", "2", "--slices", "polarimetric", "--no-figures", "-o", store);
  return store;
}

const median = (times: number[]): number => times.toSorted((a, b) => a - b)[Math.floor(times.length / 2)];

/** All measurements, in milliseconds or MB. */
const measured: Record<string, number[]> = {};
function row(name: string, times: number[]): string {
  measured[name] = times;
  return `${name.padEnd(52)} ${[median(times), Math.min(...times), Math.max(...times)].map((ms) => ms.toFixed(1).padStart(8)).join(" ")}`;
}

/** Opens a page, and returns the times from navigation to the first drawn image, or also to the complete image. */
async function firstImage(page: Page, address: string, complete: boolean): Promise<number[]> {
  await page.goto("about:blank");
  await page.goto(addressOf(address, { ...SLICE, pixel: [10, 10] }));
  const drawn = () => (window as unknown as { drawn: number[] }).drawn;
  await page.waitForFunction((n) => (window as unknown as { drawn: number[] }).drawn.length >= n, complete ? 2 : 1, { timeout: 300_000 });
  return page.evaluate(drawn);
}

/** Returns the time from a click to the change of the matrix. */
async function click(page: Page, down: number, right: number): Promise<number> {
  const box = (await imageOf(page).boundingBox())!;
  // The observer is installed before the click.
  await page.evaluate(() => {
    const matrix = (): string =>
      Array.from(document.querySelectorAll("td[data-element]"), (cell) => cell.getAttribute("data-value")).join();
    const before = matrix();
    let start = 0;
    addEventListener("pointerup", () => (start = performance.now()), { capture: true, once: true });
    (window as unknown as { clicked: Promise<number> }).clicked = new Promise((resolve) => {
      const observer = new MutationObserver(() => {
        if (start === 0 || matrix() === before) return;
        observer.disconnect();
        resolve(performance.now() - start);
      });
      observer.observe(document.body, { subtree: true, childList: true, attributes: true });
    });
  });
  await page.mouse.click(box.x + right * box.width, box.y + down * box.height);
  return page.evaluate(() => (window as unknown as { clicked: Promise<number> }).clicked);
}

/** Returns the times from a key that changes the state of the light to the end of the frame that shows it. */
function stateChanges(page: Page, times: number): Promise<number[]> {
  return page.getByRole("application", { name: /^Projector light/ }).evaluate(async (sphere, n) => {
    const all: number[] = [];
    for (let i = 0; i < n; i++) {
      const start = performance.now();
      sphere.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
      await new Promise((resolve) => requestAnimationFrame(resolve));
      await new Promise((resolve) => setTimeout(resolve));
      all.push(performance.now() - start);
    }
    return all;
  }, times);
}

test("speed", async ({ page }) => {
  test.setTimeout(600_000);
  const given = process.env.VIEW_SPEED!;
  const store = given === "1" ? rendered() : given;
  const server = await view(store);
  const address = server.ready[0];
  try {
    await page.addInitScript(() => {
      const drawn: number[] = [];
      (window as unknown as { drawn: number[] }).drawn = drawn;
      const look = (): void => {
        const image = document.querySelector("canvas.image");
        if (image && !document.querySelector(".image-empty") && drawn.length === 0) drawn.push(performance.now());
        if (image?.getAttribute("data-ready") === "true") drawn.push(performance.now());
        else requestAnimationFrame(look);
      };
      requestAnimationFrame(look);
    });
    const first: number[] = [];
    for (let i = 0; i < TIMES; i++) {
      // A new server has computed nothing yet.
      const fresh = await view(store);
      first.push((await firstImage(page, fresh.ready[0], false))[0]);
      await page.goto("about:blank");
      await stop(fresh);
    }
    // With VIEW_WAIT=0, clicks come while the image is still being read.
    const waits = process.env.VIEW_WAIT !== "0";
    const [, complete] = await firstImage(page, address, waits);
    await matrixOf(page);
    // Pixels of the lit wall, whose matrices differ.
    const clicks: number[] = [];
    for (let i = 0; i < TIMES; i++) clicks.push(await click(page, 0.15 + 0.01 * i, 0.5 + 0.005 * ((7 * i) % TIMES)));
    const lines = [row("navigation to first image", first)];
    if (waits) lines.push(row("navigation to complete image, once", [complete]));
    lines.push(row("click to numbers", clicks));
    for (const quantity of ["colour", "intensity", "dolp"] as const) {
      const light = { quantity, input: [1, 1, 0, 0] as [number, number, number, number] };
      await page.goto(addressOf(address, { ...SLICE, ...light, wavelength: quantity === "colour" ? "all" : 1 }));
      if (waits) await expect(imageOf(page)).toHaveAttribute("data-ready", "true", { timeout: 300_000 });
      else await page.waitForTimeout(3000);
      lines.push(row(`state change, ${quantity}`, await stateChanges(page, TIMES)));
    }
    const memory = /VmHWM:\s+(\d+) kB/.exec(readFileSync(`/proc/${server.process.pid}/status`, "utf8"));
    lines.push(row("largest memory of the server in MB", [Number(memory?.[1]) / 1000]));
    writeFileSync(join(ROOT, "target/view/speed.json"), JSON.stringify(measured));
    console.log([`${`medians of ${TIMES}, in ms`.padEnd(52)}   median  minimum  maximum`, ...lines].join("\n"));
  } finally {
    await stop(server);
  }
});
