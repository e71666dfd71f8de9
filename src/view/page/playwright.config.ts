import { execFileSync } from "node:child_process";
import { defineConfig } from "@playwright/test";

/** Returns the path of the system's browser. A missing browser is an error, so that no test is skipped. */
function chromium(): string {
  if (process.env.CHROMIUM) return process.env.CHROMIUM;
  for (const name of ["chromium", "chromium-browser", "google-chrome"]) {
    try {
      return execFileSync("sh", ["-c", `command -v ${name}`], { encoding: "utf8" }).trim();
    } catch {
      continue;
    }
  }
  throw new Error("no browser found: install chromium, or set CHROMIUM to the path of a Chromium browser");
}

export default defineConfig({
  testDir: "browser",
  outputDir: "../../../target/view/failures",
  globalSetup: "./browser/setup.ts",
  // The measurement of speed is no test.
  testIgnore: process.env.VIEW_SPEED ? [] : "speed.spec.ts",
  reporter: [["list"]],
  workers: 1,
  timeout: 60_000,
  expect: { timeout: 10_000 },
  use: {
    viewport: { width: 1280, height: 720 },
    permissions: ["clipboard-read", "clipboard-write"],
    launchOptions: { executablePath: chromium(), args: process.getuid?.() === 0 ? ["--no-sandbox"] : [] },
    screenshot: "only-on-failure",
  },
});
