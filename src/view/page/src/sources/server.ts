/** The source that asks the server of `sunstone view`. Arrays arrive as a JSON header and little-endian 32-bit floats. */

import type { Axis, Description, ImageResult, Labelled, Progress } from "../model";
import {
  SourceError, type FrameResult, type ImageRequest, type Pattern, type ProbeRequest, type Source, type TrialRequest, type TrialResult,
} from "./source";

type Header = Record<string, unknown> & { fields?: string[]; notes?: string[] };

interface Arrays {
  header: Header;
  fields: Map<string, Float32Array>;
}

/** Splits an answer into its header and its arrays. `lengths` returns the number of values of each field. */
export function unpack(bytes: ArrayBuffer, lengths: (header: Header, name: string) => number): Arrays {
  const damaged = (): SourceError => new SourceError("the server's answer is damaged; reload the page");
  if (bytes.byteLength < 4) throw damaged();
  const size = new DataView(bytes).getUint32(0, true);
  if (4 + size > bytes.byteLength || size % 4 !== 0) throw damaged();
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, size))) as Header;
  const fields = new Map<string, Float32Array>();
  let at = 4 + size;
  for (const name of header.fields ?? []) {
    const length = lengths(header, name);
    if (at + 4 * length > bytes.byteLength) throw damaged();
    fields.set(name, new Float32Array(bytes, at, length));
    at += 4 * length;
  }
  return { header, fields };
}

const product = (lengths: number[]): number => lengths.reduce((a, b) => a * b, 1);
const overAxes = (header: Header): number => product((header.axes as Axis[]).map((axis) => axis.coords.length));

const withoutTyped = (key: string, value: unknown): unknown => (key === "pattern" && value ? plain(value as Pattern) : value);
const plain = (pattern: Pattern): unknown => ({ ...pattern, values: Array.from(pattern.values) });

/** Milliseconds between two posts of the same image request. The server itself waits about 150 ms for new values. */
const PAUSE_MS = 30;

/** Reads the data of the server that sent the page. */
export class ServerSource implements Source {
  constructor(private readonly token: string) {}

  private async ask(path: string, body?: unknown, signal?: AbortSignal): Promise<Response> {
    let response: Response;
    try {
      response = await fetch(path, {
        method: body === undefined ? "GET" : "POST",
        headers: {
          "x-sunstone-token": this.token,
          ...(body === undefined ? {} : { "content-type": "application/json" }),
        },
        body: body === undefined ? undefined : JSON.stringify(body, withoutTyped),
        signal,
        cache: "no-store",
      });
    } catch (error) {
      if (signal?.aborted) throw error;
      throw new SourceError("no connection to the server; check that `sunstone view` still runs");
    }
    if (response.ok) return response;
    const text = await response.text();
    let message = `the server answered ${response.status}`;
    try {
      message = (JSON.parse(text) as { error?: string }).error ?? message;
    } catch {
      // The answer is not of the server of Sunstone, for example that of a proxy: the status is all there is to say.
    }
    throw new SourceError(message);
  }

  async describe(): Promise<Description> {
    return (await this.ask("api/describe")).json() as Promise<Description>;
  }

  async progress(store: number): Promise<Progress | null> {
    return (await this.ask(`api/progress?store=${store}`)).json() as Promise<Progress | null>;
  }

  async probe(request: ProbeRequest, signal?: AbortSignal): Promise<Labelled> {
    const response = await this.ask("api/probe", request, signal);
    return labelled(unpack(await response.arrayBuffer(), overAxes));
  }

  async *image(request: ImageRequest, signal?: AbortSignal): AsyncGenerator<ImageResult> {
    for (;;) {
      const response = await this.ask("api/image", request, signal);
      const answer = unpack(await response.arrayBuffer(), overAxes);
      const { region, bin, done } = answer.header as { region: ImageResult["region"]; bin: number; done: number };
      yield { ...labelled(answer), region, bin, done };
      if (done >= 1) return;
      await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
      if (signal?.aborted) return;
    }
  }

  async frame(store: number, index: number[]): Promise<FrameResult> {
    const response = await this.ask(`api/frame?store=${store}&index=${index.join(",")}`);
    const { header, fields } = unpack(await response.arrayBuffer(), (h) => product(h.shape as number[]));
    return { shape: header.shape as number[], values: required(fields, "values") };
  }

  async trial(request: TrialRequest, signal?: AbortSignal): Promise<TrialResult> {
    const response = await this.ask("api/trial", request, signal);
    if (response.headers.get("content-type") === "application/json") throw new SourceError(((await response.json()) as { error: string }).error);
    const { header, fields } = unpack(await response.arrayBuffer(), (h, name) =>
      name === "errors" ? (h.errorHeight as number) * (h.errorWidth as number) : (h.height as number) * (h.width as number));
    const numbers = header as unknown as Omit<TrialResult, "image" | "errors">;
    return { ...numbers, notes: header.notes ?? [], image: required(fields, "image"), errors: required(fields, "errors") };
  }
}

function required(fields: Map<string, Float32Array>, name: string): Float32Array {
  const found = fields.get(name);
  if (!found) throw new SourceError(`the server's answer has no field ${name}; reload the page`);
  return found;
}

function labelled({ header, fields }: Arrays): Labelled {
  return {
    axes: header.axes as Axis[],
    mean: required(fields, "mean"),
    stdError: fields.get("std_error") ?? null,
    notes: header.notes ?? [],
  };
}
