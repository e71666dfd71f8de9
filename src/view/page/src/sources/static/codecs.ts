/** Codecs of stores for `zarrita`: Zstandard by `fzstd`, and a CRC-32C that is verified. */

import { decompress } from "fzstd";
import { registry } from "zarrita";
import { crc32c } from "./crc32c";

const encode = (): never => {
  throw new Error("a static export is read only");
};

const SEAL = 4;

/** Returns the bytes before the checksum at the end. */
function unsealed(sealed: Uint8Array): Uint8Array<ArrayBuffer> {
  const at = sealed.length - SEAL;
  if (at < 0) throw new Error("the data are shorter than their checksum");
  const bytes = sealed.subarray(0, at) as Uint8Array<ArrayBuffer>;
  const expected = new DataView(sealed.buffer, sealed.byteOffset + at, SEAL).getUint32(0, true);
  if (crc32c(bytes) !== expected) throw new Error("checksum mismatch");
  return bytes;
}

/** Registers the codecs. The codec `bytes` is the one of `zarrita`. */
export function registerCodecs(): void {
  registry.set("zstd", () => ({
    fromConfig: () => ({ kind: "bytes_to_bytes", encode, decode: (bytes: Uint8Array) => decompress(bytes) }),
  }) as never);
  registry.set("crc32c", () => ({
    fromConfig: () => ({ kind: "bytes_to_bytes", encode, decode: unsealed, computeEncodedSize: (size: number) => size + SEAL }),
  }) as never);
}
