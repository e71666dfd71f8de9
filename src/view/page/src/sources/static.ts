/** The source of a static export: a folder of files that any web server can host. The page computes all answers itself. */

import type { Description, ImageResult, Labelled, Slice } from "../model";
import { runImage, runProbe } from "./engine";
import { SourceError, type FrameResult, type ImageRequest, type ProbeRequest, type Source, type TrialResult } from "./source";
import { StoreArrays } from "./static/arrays";
import { request } from "./static/files";

/** Reads an export. Each tensor store in `describe.json` has the additional field `folder`. */
export class StaticSource implements Source {
  #description: Promise<Description> | null = null;
  #stores = new Map<number, StoreArrays>();
  private readonly base: string;

  /** `base` is the address of the folder with the export's data. */
  constructor(base: string) {
    this.base = base.endsWith("/") ? base : `${base}/`;
  }

  describe(): Promise<Description> {
    if (!this.#description) {
      this.#description = this.#read();
      this.#description.catch(() => { this.#description = null; });
    }
    return this.#description;
  }

  async probe(query: ProbeRequest, signal?: AbortSignal): Promise<Labelled> {
    const { slice, arrays } = await this.#find(query);
    return runProbe(query, slice, arrays, signal);
  }

  async *image(query: ImageRequest, signal?: AbortSignal): AsyncIterable<ImageResult> {
    const { slice, arrays } = await this.#find(query);
    yield* runImage(query, slice, arrays, signal);
  }

  async progress(): Promise<null> {
    return null;
  }

  async frame(): Promise<FrameResult> {
    throw new SourceError("A static export contains no captures; open the store with `sunstone view`.");
  }

  async trial(): Promise<TrialResult> {
    throw new SourceError("The simulation of captures needs `sunstone view`; a static export has no program behind it.");
  }

  async #read(): Promise<Description> {
    const url = `${this.base}describe.json`;
    const { bytes } = await request(url, null);
    try {
      return JSON.parse(new TextDecoder().decode(bytes)) as Description;
    } catch {
      throw new SourceError(`${url}: the file is not valid JSON; copy the folder of the export again`);
    }
  }

  async #find(query: ProbeRequest): Promise<{ slice: Slice; arrays: StoreArrays }> {
    const store = (await this.describe()).stores.find((s) => s.id === query.store);
    const slice = store?.slices.find((s) => s.name === query.slice);
    const folder = store && (store as { folder?: string }).folder;
    if (!store || !slice || folder === undefined) {
      throw new SourceError(`the export has no slice \`${query.slice}\` of store ${query.store}`);
    }
    let arrays = this.#stores.get(store.id);
    if (!arrays) {
      arrays = new StoreArrays(`${this.base}${folder}/`);
      this.#stores.set(store.id, arrays);
    }
    return { slice, arrays };
  }
}
