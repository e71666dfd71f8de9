import { expect, it } from "vitest";
import { unpack } from "./server";

/** Packs an answer as the server does. */
function packed(header: object, arrays: number[][]): ArrayBuffer {
  let text = JSON.stringify(header);
  text = text.padEnd(Math.ceil(text.length / 4) * 4);
  const bytes = new Uint8Array(4 + text.length + 4 * arrays.flat().length);
  new DataView(bytes.buffer).setUint32(0, text.length, true);
  bytes.set(new TextEncoder().encode(text), 4);
  new Float32Array(bytes.buffer, 4 + text.length).set(arrays.flat());
  return bytes.buffer;
}

it("splits an answer into header and arrays", () => {
  const { header, fields } = unpack(packed({ n: 3, fields: ["mean", "std_error"] }, [[1, 2, 3], [4, 5, 6]]), (h) => h.n as number);
  expect(header.n).toBe(3);
  expect([...fields.get("std_error")!]).toEqual([4, 5, 6]);
});

it("reports a damaged answer", () => {
  expect(() => unpack(new ArrayBuffer(2), () => 1)).toThrow("damaged");
  expect(() => unpack(packed({ fields: ["mean"] }, [[1]]), () => 2)).toThrow("damaged");
});
