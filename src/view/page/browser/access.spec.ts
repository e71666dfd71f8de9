/** Accessibility and layout: axe in both themes, and pictures of the views at two sizes. */

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import type { Page } from "@playwright/test";
import type { ViewState } from "../src/state";
import { bench, expect, open, PICTURES, test } from "./page";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

interface Violation {
  id: string;
  impact: string;
  help: string;
  nodes: { html: string; failureSummary: string }[];
}

/** Expects that axe finds nothing serious or critical. */
async function expectAccessible(page: Page): Promise<void> {
  await page.evaluate(AXE);
  const violations = await page.evaluate(async () => {
    const axe = (window as unknown as { axe: { run: () => Promise<{ violations: Violation[] }> } }).axe;
    return (await axe.run()).violations;
  });
  const bad = violations.filter(({ impact }) => impact === "serious" || impact === "critical");
  const places = (nodes: Violation["nodes"]): string => nodes.map((node) => `${node.html} ${node.failureSummary}`).join("\n");
  expect(bad.map(({ id, impact, help, nodes }) => `${impact} ${id}: ${help}: ${places(nodes)}`)).toEqual([]);
}

const VIEWS: Record<string, Partial<ViewState>> = {
  photograph: { slice: "polarimetric", pixel: [150, 163] },
  grid: { slice: "polarimetric", quantity: "grid", wavelength: 1, pixel: [150, 163] },
  element: {
    slice: "polarimetric", quantity: "element", row: 2, column: 2, wavelength: 1, pixel: [100, 70],
    input: [1, 0, 1, 0], analyzer: [1, 0, -1, 0],
  },
  flight: { slice: "flight", time: 31, pixel: [64, 70] },
  time: { slice: "xt", pixel: [0, 163], wavelength: 1, quantity: "intensity" },
  origin: { slice: "ss", pixel: [0, 163], wavelength: 1, quantity: "intensity" },
  split: { slice: "epipolar", compare: { store: 0, slice: "nonepipolar", mode: "side" }, pixel: [150, 163] },
};

for (const theme of ["dark", "light"] as const) {
  for (const [name, view] of Object.entries(VIEWS)) {
    test(`axe finds nothing serious: ${name}, ${theme}`, async ({ page }) => {
      await open(page, bench.address, { ...view, theme });
      await page.waitForLoadState("networkidle");
      await page.screenshot({ path: join(PICTURES, `${name}-${theme}.png`) });
      await expectAccessible(page);
    });
  }

  test(`axe finds nothing serious: dialogs, ${theme}`, async ({ page }) => {
    await open(page, bench.address, { ...VIEWS.photograph, theme });
    for (const name of ["Take out", "Help"]) {
      await page.getByRole("button", { name, exact: true }).click();
      await expect(page.getByRole("dialog")).toBeVisible();
      await expectAccessible(page);
      await page.keyboard.press("Escape");
      await expect(page.getByRole("dialog")).toBeHidden();
    }
  });
}

test("a newcomer sees the tour", async ({ page }) => {
  await open(page, bench.address);
  const tour = page.getByRole("complementary", { name: "Tour" });
  await expect(tour).toBeVisible();
  await page.screenshot({ path: join(PICTURES, "tour.png") });
  await expectAccessible(page);
  while (await tour.getByRole("button", { name: "Next" }).isVisible()) await tour.getByRole("button", { name: "Next" }).click();
  await tour.getByRole("button", { name: "Explore" }).click();
  await expect(tour).toBeHidden();
});

/** Expects that nothing is wider than the page. */
async function expectNoOverflow(page: Page): Promise<void> {
  const [inner, scroll] = await page.evaluate(() => [innerWidth, document.documentElement.scrollWidth]);
  expect(scroll).toBeLessThanOrEqual(inner);
}

test("nothing is wider than the page", async ({ page }) => {
  for (const view of Object.values(VIEWS)) {
    await open(page, bench.address, view);
    await expectNoOverflow(page);
  }
});

test.describe("on a tablet", () => {
  test.use({ viewport: { width: 1024, height: 768 }, hasTouch: true });

  for (const [name, view] of Object.entries(VIEWS)) {
    test(`the view ${name} fits and answers to touch`, async ({ page }) => {
      await open(page, bench.address, view);
      await expectNoOverflow(page);
      const box = (await page.locator("canvas.image").boundingBox())!;
      await page.touchscreen.tap(box.x + 0.5 * box.width, box.y + 0.5 * box.height);
      await expect(page.getByTestId("status")).toContainText(/y [\d.]+, x [\d.]+: /);
      await page.waitForLoadState("networkidle");
      await page.screenshot({ path: join(PICTURES, `tablet-${name}.png`) });
    });
  }
});
