/** Arrays of an exported store, read chunk by chunk. */

import * as zarr from "zarrita";
import { SourceError } from "../source";
import { Cache } from "./cache";
import { registerCodecs } from "./codecs";
import { StoreFiles } from "./files";

/** Arrays of a slice, in the order of the store. */
export type Field = "mean" | "std_error" | "overflow" | "overflow_std_error" | "total_std_error";

/** Reads the chunks of one array. */
export interface ChunkReader {
  /** Shape of a chunk, along all axes. */
  chunk: number[];
  /** Returns the values of a chunk, row-major. Values outside the array are unspecified. */
  read(index: number[], signal?: AbortSignal): Promise<Float32Array>;
}

/** Opens the arrays of slices. */
export interface ArrayOpener {
  has(slice: string, field: Field): Promise<boolean>;
  open(slice: string, field: Field): Promise<ChunkReader>;
}

const CHUNKS_BYTES = 128 * 2 ** 20;

registerCodecs();

/** The arrays of a folder with a store. */
export class StoreArrays implements ArrayOpener {
  #files: StoreFiles;
  #opened = new Map<string, Promise<ChunkReader>>();
  #chunks = new Cache<Float32Array>(CHUNKS_BYTES);

  constructor(private readonly base: string) {
    this.#files = new StoreFiles(base);
  }

  has(slice: string, field: Field): Promise<boolean> {
    return this.#files.has(`${slice}/${field}/zarr.json`);
  }

  open(slice: string, field: Field): Promise<ChunkReader> {
    const path = `${slice}/${field}`;
    const known = this.#opened.get(path);
    if (known) return known;
    const reader = this.#open(path);
    this.#opened.set(path, reader);
    reader.catch(() => this.#opened.delete(path));
    return reader;
  }

  async #open(path: string): Promise<ChunkReader> {
    const named = async <T>(work: () => Promise<T>, signal?: AbortSignal): Promise<T> => {
      try {
        return await work();
      } catch (error) {
        if (signal?.aborted) throw error;
        throw sourceError(error, this.base + path);
      }
    };
    const array = await named(() => zarr.open.v3(zarr.root(this.#files).resolve(path), { kind: "array" }));
    if (!array.is("float32")) throw new SourceError(`${this.base}${path}: expected values of type float32, found ${array.dtype}`);
    const length = array.chunks.reduce((a, b) => a * b, 1);
    const read = async (index: number[], signal?: AbortSignal): Promise<Float32Array> => {
      const key = `${path} ${index}`;
      const known = this.#chunks.get(key);
      if (known) return known;
      const { data } = await named(() => array.getChunk(index, { signal }), signal);
      if (data.length !== length) throw new SourceError(`${this.base}${path}: chunk ${index} has ${data.length} of ${length} values`);
      this.#chunks.set(key, data, data.byteLength);
      return data;
    };
    return { chunk: array.chunks, read };
  }
}

/** Returns the message of the innermost cause, with the name of the file or array. */
function sourceError(error: unknown, place: string): SourceError {
  let cause = error;
  while (cause instanceof Error && !(cause instanceof SourceError) && cause.cause !== undefined) cause = cause.cause;
  if (cause instanceof SourceError) return cause;
  return new SourceError(`${place}: ${cause instanceof Error ? cause.message : cause}; copy the folder of the export again`);
}
