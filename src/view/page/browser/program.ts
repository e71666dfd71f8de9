/** Runs the program `sunstone`, and servers that tests need. */

import { execFileSync, spawn, spawnSync, type ChildProcess } from "node:child_process";
import { dirname, resolve } from "node:path";
import { fileURLToPath } from "node:url";

/** Root of the repository. */
export const ROOT = resolve(dirname(fileURLToPath(import.meta.url)), "../../../..");

/** Path of the program. */
export const SUNSTONE = resolve(process.env.SUNSTONE ?? `${ROOT}/target/release/sunstone`);

/** Runs the program and returns what it prints to standard output. */
export function sunstone(...words: string[]): string {
  const { status, stdout, stderr, error } = spawnSync(SUNSTONE, words, { cwd: ROOT, encoding: "utf8", maxBuffer: 2 ** 28 });
  if (error) throw error;
  if (status !== 0) throw new Error(`sunstone ${words.join(" ")} exited with code ${status}: ${stderr}`);
  return stdout;
}

/** Runs a command line in a shell, with the program on the PATH, and returns what it prints to standard output. */
export function shell(line: string, folder: string): string {
  const env = { ...process.env, PATH: `${dirname(SUNSTONE)}:${process.env.PATH}` };
  return execFileSync("sh", ["-c", line], { cwd: folder, env, encoding: "utf8", maxBuffer: 2 ** 28 });
}

/** Rows of the CSV that `sunstone probe --csv -` prints: coordinates by axis, value and standard error. */
export function parseCsv(text: string): Record<string, number>[] {
  const [head, ...rows] = text.trim().split("\n");
  const names = head.split(",");
  return rows.map((row) => Object.fromEntries(row.split(",").map((word, i) => [names[i], Number(word)])));
}

/** Runs `sunstone probe` and returns its rows. */
export const probe = (store: string, slice: string, ...words: string[]): Record<string, number>[] =>
  parseCsv(sunstone("probe", store, slice, ...words, "--csv", "-"));

/** A process that runs in the background. */
export interface Running {
  process: ChildProcess;
  /** What it printed before it was ready. */
  ready: RegExpExecArray;
}

const START_MS = 20_000;

/** Starts a process and waits until its output matches `pattern`. */
export function start(program: string, words: string[], pattern: RegExp): Promise<Running> {
  const process = spawn(program, words, { cwd: ROOT, stdio: ["ignore", "pipe", "pipe"] });
  return new Promise((found, failed) => {
    let output = "";
    const fail = (reason: string): void => {
      process.kill();
      failed(new Error(`${program} ${words.join(" ")}: ${reason}; it printed: ${output}`));
    };
    const timer = setTimeout(() => fail(`no match of ${pattern}`), START_MS);
    const read = (text: Buffer): void => {
      output += text;
      const ready = pattern.exec(output);
      if (!ready) return;
      clearTimeout(timer);
      found({ process, ready });
    };
    process.stdout.on("data", read);
    process.stderr.on("data", read);
    process.on("error", (error) => fail(error.message));
    // After the start, only `stop` ends the process. Otherwise the reason is printed, because tests see only a refused connection.
    process.on("exit", (code, signal) => {
      if (signal === "SIGTERM" && process.killed) return;
      const reason = `it ended early with code ${code}, signal ${signal}`;
      if (pattern.test(output)) console.error(`${program} ${words.join(" ")}: ${reason}; it printed: ${output}`);
      else fail(reason);
    });
  });
}

/** Stops a process and waits for its end. */
export async function stop({ process }: Running): Promise<void> {
  if (process.exitCode !== null || process.signalCode !== null) return;
  const ended = new Promise((resolve) => process.once("exit", resolve));
  process.kill("SIGTERM");
  await ended;
}

/** Starts `sunstone view` for stores. The address is `ready[0]`. */
export const view = (...stores: string[]): Promise<Running> =>
  start(SUNSTONE, ["view", ...stores, "--no-open", "--port", "0"], /http:\/\/127\.0\.0\.1:\d+\/\?token=[\w-]+/);

/** Serves a folder with Python's file server, which does not support ranges. Returns the process and the address. */
export async function fileServer(folder: string): Promise<Running & { address: string }> {
  const words = ["-u", "-m", "http.server", "0", "--bind", "127.0.0.1", "--directory", folder];
  const running = await start("python3", words, /port (\d+)/);
  return { ...running, address: `http://127.0.0.1:${running.ready[1]}/` };
}
