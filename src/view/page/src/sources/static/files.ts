/** The files of one exported store, read over HTTP by parts, or whole where the server does not support parts. */

import type { AbsolutePath, AsyncReadable, GetOptions, RangeQuery } from "zarrita";
import { SourceError } from "../source";
import { Cache } from "./cache";
import { crc32c } from "./crc32c";

/** Size and checksum of a file, as the manifest lists them. */
interface Entry {
  size: number;
  crc: number;
}

const MANIFEST = "manifest.txt";
const MAX_REQUESTS = 6;
const WHOLE_FILES_BYTES = 128 * 2 ** 20;

/** Limits the number of requests at a time, over all stores. */
class Gate {
  #free = MAX_REQUESTS;
  #waiting: (() => void)[] = [];

  async run<T>(task: () => Promise<T>, signal?: AbortSignal): Promise<T> {
    if (this.#free > 0) this.#free -= 1;
    else await new Promise<void>((resolve) => this.#waiting.push(resolve));
    try {
      signal?.throwIfAborted();
      return await task();
    } finally {
      const next = this.#waiting.shift();
      if (next) next();
      else this.#free += 1;
    }
  }
}

const gate = new Gate();
const wholeFiles = new Cache<Promise<Uint8Array>>(WHOLE_FILES_BYTES);

/**
 * A folder with a store. The manifest of the store lists all files, so an absent chunk needs no request, and a lost or truncated file
 * is an error.
 */
export class StoreFiles implements AsyncReadable {
  #manifest: Promise<{ entries: Map<string, Entry>; ranges: boolean }> | null = null;

  /** `base` is the address of the folder, with `/` at the end. */
  constructor(private readonly base: string) {}

  /** Returns whether the store has a file. */
  async has(path: string): Promise<boolean> {
    return (await this.#open()).entries.has(path);
  }

  async get(key: AbsolutePath, options?: GetOptions): Promise<Uint8Array | undefined> {
    const path = key.slice(1);
    const entry = (await this.#open()).entries.get(path);
    if (!entry) return undefined;
    options?.signal?.throwIfAborted();
    const bytes = await this.#whole(path, entry);
    if (path.endsWith("zarr.json") && crc32c(bytes) !== entry.crc) throw damaged(this.base + path, "checksum mismatch");
    return bytes;
  }

  async getRange(key: AbsolutePath, range: RangeQuery, options?: GetOptions): Promise<Uint8Array | undefined> {
    const path = key.slice(1);
    const { entries, ranges } = await this.#open();
    const entry = entries.get(path);
    if (!entry) return undefined;
    const length = "suffixLength" in range ? range.suffixLength : range.length;
    const start = "suffixLength" in range ? entry.size - length : range.offset;
    if (start < 0 || start + length > entry.size) throw damaged(this.base + path, "a chunk is outside the file");
    // Concurrent reads share the index of a shard, so one reader must not cancel it for the others.
    const signal = "suffixLength" in range ? undefined : options?.signal;
    signal?.throwIfAborted();
    if (!ranges) return (await this.#whole(path, entry)).subarray(start, start + length);
    const { status, bytes } = await request(this.base + path, `bytes=${start}-${start + length - 1}`, signal);
    const part = status === 206 ? bytes : bytes.subarray(start, start + length);
    if (part.length !== length) throw damaged(this.base + path, `the file is truncated: ${part.length} of ${length} bytes received`);
    return part;
  }

  /** Reads a whole file. Concurrent and later reads share the answer. */
  #whole(path: string, entry: Entry): Promise<Uint8Array> {
    const url = this.base + path;
    const known = wholeFiles.get(url);
    if (known) return known;
    const answer = request(url, null).then(({ bytes }) => {
      if (bytes.length === entry.size) return bytes;
      throw damaged(url, `the file has ${bytes.length} bytes, expected ${entry.size} bytes`);
    });
    wholeFiles.set(url, answer, entry.size);
    answer.catch(() => wholeFiles.delete(url));
    return answer;
  }

  #open(): Promise<{ entries: Map<string, Entry>; ranges: boolean }> {
    if (!this.#manifest) {
      // The range of the whole file shows whether the server supports ranges.
      this.#manifest = request(this.base + MANIFEST, "bytes=0-").then(({ status, bytes }) =>
        ({ entries: parseManifest(bytes, this.base + MANIFEST), ranges: status === 206 }));
      this.#manifest.catch(() => { this.#manifest = null; });
    }
    return this.#manifest;
  }
}

const damaged = (url: string, reason: string): SourceError =>
  new SourceError(`${url}: ${reason}; copy the folder of the export again`);

/** Requests a file or a part of it. */
export async function request(url: string, range: string | null, signal?: AbortSignal): Promise<{ status: number; bytes: Uint8Array }> {
  return gate.run(async () => {
    const headers: Record<string, string> = range ? { Range: range } : {};
    let answer: Response;
    let bytes: Uint8Array;
    try {
      answer = await fetch(url, { headers, signal });
      bytes = new Uint8Array(await answer.arrayBuffer());
    } catch (cause) {
      if (signal?.aborted) throw cause;
      throw new SourceError(`${url}: no answer from the server (${cause instanceof Error ? cause.message : cause}); check the connection`);
    }
    if (answer.status === 404) throw damaged(url, "the file is missing");
    if (!answer.ok) throw new SourceError(`${url}: the server answered with status ${answer.status} ${answer.statusText}`);
    return { status: answer.status, bytes };
  }, signal);
}

/** Parses the lines `CRC SIZE PATH` of a manifest and checks the checksum in the last line. */
function parseManifest(bytes: Uint8Array, url: string): Map<string, Entry> {
  const text = new TextDecoder().decode(bytes);
  const body = text.slice(0, text.trimEnd().lastIndexOf("\n") + 1);
  const seal = parseInt(text.slice(body.length), 16);
  if (crc32c(new TextEncoder().encode(body)) !== seal) throw damaged(url, "checksum mismatch");
  const entries = new Map<string, Entry>();
  for (const line of body.split("\n").slice(1, -1)) {
    const [crc, size, ...path] = line.split(" ");
    entries.set(path.join(" "), { crc: parseInt(crc, 16), size: Number(size) });
  }
  return entries;
}
