/** Captures: the frames of a rig's run, or simulated captures of the shown slice. */

import { description, slice, store } from "../data";
import { isPolarized } from "../model";
import { state, update } from "../state";
import { Panel } from "./Field";
import { RunFrames } from "./RunFrames";
import { SliceButtons } from "./showSlice";
import { Simulation } from "./Simulation";

export function CapturesPanel() {
  const [itsStore, itsSlice] = [store.value, slice.value];
  if (!itsStore) return null;
  if (itsStore.kind === "captures" && itsStore.captures) {
    return (
      <Panel name="captures-panel" title="Captured frames">
        <RunFrames key={itsStore.id} id={itsStore.id} captures={itsStore.captures} />
      </Panel>
    );
  }
  if (!itsSlice) return null;
  const { panels } = state.value;
  const polarized = itsStore.slices.filter(isPolarized);
  return (
    <Panel
      name="captures-panel" title="Simulated captures" open={panels.captures}
      onToggle={(captures) => update({ panels: { ...panels, captures } })}
    >
      {description.value?.isStatic ? (
        <p class="note">
          This page is a static export, which cannot simulate captures. Open the store with <code>sunstone view {itsStore.path}</code>.
        </p>
      ) : isPolarized(itsSlice) ? (
        <Simulation store={itsStore} slice={itsSlice} />
      ) : (
        <>
          <p class="note">
            {`Captures need Mueller matrices, but the slice "${itsSlice.name}" has only M00. `}
            {polarized.length > 0 ? "These slices have them:" : "Render a slice with `polarization = \"mueller\"`."}
          </p>
          <SliceButtons from={itsSlice} slices={polarized} />
        </>
      )}
    </Panel>
  );
}
