/** A row of camera pixels against the columns or rows of the projector. */

import { useState } from "preact/hooks";
import { description, slice, store } from "../data";
import { brief } from "../display/scale";
import { planeOf } from "../math/labelled";
import { axisOf, lengthOf } from "../model";
import { baseProbe, resolvesProjector } from "../request";
import { state, update } from "../state";
import { Choice, Panel } from "./Field";
import { MapCanvas } from "./MapCanvas";
import { shortUnit } from "../display/units";
import { elementWords, keeping, laneName, nearest, useProbe } from "./useProbe";

export function SsPanel() {
  const view = state.value;
  const [itsStore, itsSlice] = [store.value, slice.value];
  const [chosen, setChosen] = useState<"u" | "v">("u");
  const [rows, columns] = itsSlice ? [lengthOf(itsSlice, "v"), lengthOf(itsSlice, "u")] : [1, 1];
  const projector = columns === 1 ? "v" : rows === 1 ? "u" : chosen;
  const [height, width] = itsSlice ? [lengthOf(itsSlice, "y"), lengthOf(itsSlice, "x")] : [1, 1];
  // A slice with a single image column is shown along its rows.
  const along = width > 1 ? "x" : "y";
  // Open without being asked where the slice is a single row or column, which has no other use.
  const [opened, setOpened] = useState<boolean | null>(null);
  const open = opened ?? (height === 1 || width === 1);
  const [y, x] = view.pixel ?? [Math.floor(height / 2), Math.floor(width / 2)];
  const fixed = along === "x" ? { kind: "y" as const, index: y } : { kind: "x" as const, index: x };
  const { pulse, time, gate, select, quantity, row, column } = view;
  const inputs = [open, projector, along, fixed.index, pulse, time, gate, select, quantity === "element" ? [row, column] : null];
  const probed = useProbe(inputs, (v, s, sl) => {
    const across = axisOf(sl, fixed.kind);
    if (!open || !axisOf(sl, projector) || !axisOf(sl, along)) return null;
    const request = baseProbe({ ...v, illumination: { kind: "all" } }, s, sl);
    const place = across ? [`${fixed.kind}=${across.coords[Math.min(fixed.index, across.coords.length - 1)]}`] : [];
    const words = [...place, ...request.select, ...elementWords(v, sl).words];
    return keeping({ ...request, select: words }, sl, [along, projector, "wavelength"]);
  });
  if (!itsStore || !itsSlice || !axisOf(itsSlice, projector)) return null;
  const result = probed.result;
  const label = elementWords(view, itsSlice).label;
  const camera = result && axisOf(result, along)?.coords;
  const drive = result && axisOf(result, projector)?.coords;
  const { illumination } = view;
  const illuminated = drive && projector in illumination ? nearest(drive, (illumination as { u: number; v: number })[projector]) : null;
  const pick = (entry: number, pixel: number) => {
    const at = Math.floor(drive![entry]);
    update({
      pixel: along === "x" ? [y, pixel] : [pixel, x],
      ...(resolvesProjector(itsSlice) ? { illumination: projector === "u" ? { kind: "column", u: at } : { kind: "row", v: at } } : {}),
    });
  };
  return (
    <Panel
      name="ss-panel" title={`Camera ${along} against projector ${projector}`} error={probed.error} waiting={probed.waiting}
      notes={result?.notes} open={open} onToggle={setOpened}
    >
      {rows > 1 && columns > 1 && (
        <Choice
          label="Projector" value={projector} onChange={setChosen}
          options={[{ value: "u", label: "columns u, summed over rows" }, { value: "v", label: "rows v, summed over columns" }]}
        />
      )}
      {camera && drive && (
        <MapCanvas
          values={planeOf(result, projector, along, view.wavelength)} height={drive.length} width={camera.length}
          label={`${label}${laneName(result, view.wavelength)}`} unit={shortUnit(description.value?.valueUnits ?? "1")}
          kind={label === "M00" ? "positive" : "diverging"} scale={view.scale}
          rows={`projector ${projector} [px]`} columns={`camera ${along} [px]`} aspect={0.9} where={(entry, pixel) => `${along} ${brief(camera[pixel], 6)} px, ${projector} ${brief(drive[entry], 6)} px`}
          marker={{ row: illuminated, column: view.pixel ? (along === "x" ? x : y) : null }} onPick={pick}
        />
      )}
    </Panel>
  );
}
