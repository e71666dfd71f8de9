/** Starts the page: source, stores, state of the URL. */

import { effect } from "@preact/signals";
import { render } from "preact";
import { App, ignored } from "./App";
import { description, failure, playing, setDescription, source, startData } from "./data";
import { offerTour } from "./panels/Tour";
import { chooseSource } from "./sources/choose";
import { fromHash, state, toHash } from "./state";
import { startTheme } from "./theme";
import { validated } from "./validate";
import "./app.css";
import "./panels/panels.css";

/** Milliseconds between two changes of the URL. Browsers limit their number. */
const HASH_MS = 350;

/** Reads the state of the URL. */
function readHash(): void {
  const { view, ignored: unknown } = fromHash(location.hash);
  const open = description.value;
  if (!open) {
    state.value = view;
    ignored.value = unknown;
    return;
  }
  const { view: valid, replaced } = validated(view, open);
  state.value = valid;
  ignored.value = [...unknown, ...replaced];
}

/** Keeps the URL up to date with the state, not more often than browsers allow. */
function writeHash(): void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  effect(() => {
    void state.value;
    if (playing.value || timer !== undefined) return;
    timer = setTimeout(() => {
      timer = undefined;
      const hash = toHash(state.peek());
      if (hash !== location.hash.replace(/^#/, "")) history.replaceState(null, "", `${location.pathname}${location.search}#${hash}`);
    }, HASH_MS);
  });
}

async function start(): Promise<void> {
  const isFirst = location.hash.replace(/^#/, "") === "";
  readHash();
  startTheme();
  render(<App />, document.getElementById("app")!);
  try {
    source.value = await chooseSource(location);
    const replaced = setDescription(await source.value.describe());
    ignored.value = [...ignored.value, ...replaced];
  } catch (error) {
    failure.value = error instanceof Error ? error.message : String(error);
    return;
  }
  startData();
  writeHash();
  addEventListener("hashchange", readHash);
  if (isFirst) offerTour();
}

void start();
