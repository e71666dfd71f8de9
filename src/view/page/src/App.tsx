/** The layout, the keys, and the dialogs. */

import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { description, failure, hasProjector, slice, store } from "./data";
import { isPolarized } from "./model";
import { CapturesPanel } from "./panels/CapturesPanel";
import { Help } from "./panels/Help";
import { ImagePanel } from "./panels/ImagePanel";
import { OriginPanel } from "./panels/OriginPanel";
import { Out } from "./panels/Out";
import { PixelPanel } from "./panels/PixelPanel";
import { ProgressPanel } from "./panels/ProgressPanel";
import { ProjectorPanel } from "./panels/ProjectorPanel";
import { SsPanel } from "./panels/SsPanel";
import { StatePanel } from "./panels/StatePanel";
import { stepTime, TimeBar, togglePlay } from "./panels/TimeBar";
import { Toolbar } from "./panels/Toolbar";
import { endTour, startTour, Tour, tourStep } from "./panels/Tour";
import { XtPanel } from "./panels/XtPanel";
import { state, update } from "./state";
import { MAX_STOPS } from "./validate";

const dialog = signal<"help" | "out" | null>(null);
/** Names of the fields of the URL that were not used. */
export const ignored = signal<string[]>([]);

const expose = (by: number): void => update({ exposure: Math.max(-MAX_STOPS, Math.min(MAX_STOPS, state.value.exposure + by)) });

/** Actions of keys. They work unless a field that takes letters has the focus. */
const ACTIONS: Record<string, () => void> = {
  "?": () => (dialog.value = "help"),
  " ": togglePlay,
  ",": () => stepTime(-1),
  ".": () => stepTime(1),
  "[": () => expose(-0.5),
  "]": () => expose(0.5),
  p: () => update({ quantity: "colour" }),
  m: () => slice.value && isPolarized(slice.value) && update({ quantity: "element" }),
  g: () => slice.value && isPolarized(slice.value) && update({ quantity: "grid" }),
  o: () => slice.value && (dialog.value = "out"),
};

function onKey(event: KeyboardEvent): void {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || dialog.value !== null) return;
  const target = event.target as HTMLElement;
  const isText = target.matches("textarea, select, [contenteditable], input:not([type=range], [type=checkbox], [type=radio])");
  // Space activates buttons and check boxes.
  const isSpaceTaken = event.key === " " && target.matches("button, input, a, summary, [role=button]");
  if (isText || isSpaceTaken) return;
  if (event.key === "Escape" && tourStep.value !== null) return endTour();
  const action = ACTIONS[event.key.toLowerCase()];
  if (!action) return;
  event.preventDefault();
  action();
}

function Messages() {
  return (
    <div class="messages">
      {failure.value && (
        <p role="alert" class="error">
          {failure.value}
          <button type="button" aria-label="Dismiss the message" onClick={() => (failure.value = null)}>✕</button>
        </p>
      )}
      {ignored.value.length > 0 && (
        <p role="status" class="note">
          Parts of the address do not fit these stores and were ignored: {ignored.value.join(", ")}.
          <button type="button" aria-label="Dismiss the note" onClick={() => (ignored.value = [])}>✕</button>
        </p>
      )}
    </div>
  );
}

/** The page. */
export function App() {
  useEffect(() => {
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  }, []);
  const open = description.value;
  const close = (): void => {
    dialog.value = null;
  };
  if (!open) {
    return (
      <main class="start">
        <h1>Sunstone</h1>
        {failure.value ? <p role="alert" class="error">{failure.value}</p> : <p role="status">Reading the stores …</p>}
      </main>
    );
  }
  const isTensor = store.value?.kind !== "captures";
  return (
    <div class="app">
      <Toolbar onHelp={() => (dialog.value = "help")} onOut={() => (dialog.value = "out")} />
      <Messages />
      <main class="stage">
        <h1 class="hidden">{`Sunstone: ${store.value?.name ?? "no store"}`}</h1>
        {isTensor && <ImagePanel />}
        {isTensor && <TimeBar />}
        {!isTensor && <CapturesPanel />}
      </main>
      <aside class="side" aria-label="Panels">
        <ProgressPanel />
        {isTensor && (
          <>
            {hasProjector.value && <OriginPanel />}
            <PixelPanel />
            {!hasProjector.value && <OriginPanel />}
            <ProjectorPanel />
            <StatePanel />
            <XtPanel />
            <SsPanel />
            <CapturesPanel />
          </>
        )}
      </aside>
      <Tour />
      {dialog.value === "help" && (
        <Help
          onClose={close}
          onTour={() => {
            close();
            startTour();
          }}
        />
      )}
      {dialog.value === "out" && <Out onClose={close} />}
    </div>
  );
}
