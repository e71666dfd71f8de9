/** The colour theme: that of the state, or that of the system. */

import { computed, effect, signal, type ReadonlySignal } from "@preact/signals";
import { state } from "./state";

const system = matchMedia("(prefers-color-scheme: dark)");
const systemIsDark = signal(system.matches);
system.addEventListener("change", () => (systemIsDark.value = system.matches));

/** Whether the dark theme is used. */
export const darkTheme: ReadonlySignal<boolean> = computed(() =>
  state.value.theme === "auto" ? systemIsDark.value : state.value.theme === "dark");

/** Keeps the theme of the document up to date. */
export function startTheme(): void {
  effect(() => {
    document.documentElement.dataset.theme = darkTheme.value ? "dark" : "light";
  });
}
