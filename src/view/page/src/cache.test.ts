import { expect, it } from "vitest";
import { Cache } from "./cache";

it("drops the entries that were used least recently", () => {
  const cache = new Cache<number>(10);
  cache.set("a", 1, 4);
  cache.set("b", 2, 4);
  expect(cache.get("a")).toBe(1);
  cache.set("c", 3, 4);
  expect([cache.get("a"), cache.get("b"), cache.get("c")]).toEqual([1, undefined, 3]);
  cache.set("huge", 4, 11);
  expect([cache.get("huge"), cache.get("a")]).toEqual([undefined, 1]);
});
