/** A row or column of the image against time. */

import { useState } from "preact/hooks";
import { description, slice, store } from "../data";
import { brief } from "../display/scale";
import { planeOf } from "../math/labelled";
import { axisOf, lengthOf } from "../model";
import { baseProbe } from "../request";
import { state, update } from "../state";
import { Choice, Panel } from "./Field";
import { MapCanvas } from "./MapCanvas";
import { shortUnit } from "../display/units";
import { elementWords, keeping, laneName, useProbe } from "./useProbe";

export function XtPanel() {
  const view = state.value;
  const [itsStore, itsSlice] = [store.value, slice.value];
  const [chosen, setChosen] = useState<"x" | "y">("x");
  const t = itsSlice && axisOf(itsSlice, "t");
  // Open without being asked where the slice is a single row or column, which has no other use.
  const [opened, setOpened] = useState<boolean | null>(null);
  const [height, width] = itsSlice ? [lengthOf(itsSlice, "y"), lengthOf(itsSlice, "x")] : [1, 1];
  // An axis with one entry is not worth a map.
  const along = width === 1 ? "y" : height === 1 ? "x" : chosen;
  const open = opened ?? (height === 1 || width === 1);
  const [y, x] = view.pixel ?? [Math.floor(height / 2), Math.floor(width / 2)];
  const fixed = along === "x" ? { kind: "y" as const, index: y } : { kind: "x" as const, index: x };
  const { illumination, pulse, select, quantity, row, column } = view;
  const inputs = [open, along, fixed.index, illumination, pulse, select, quantity === "element" ? [row, column] : null];
  const probed = useProbe(inputs, (v, s, sl) => {
    const across = axisOf(sl, fixed.kind);
    if (!open || !axisOf(sl, "t") || !axisOf(sl, along)) return null;
    const request = baseProbe({ ...v, time: null, gate: null }, s, sl);
    const place = across ? [`${fixed.kind}=${across.coords[Math.min(fixed.index, across.coords.length - 1)]}`] : [];
    return keeping({ ...request, select: [...place, ...request.select, ...elementWords(v, sl).words] }, sl, [along, "t", "wavelength"]);
  });
  if (!itsStore || !itsSlice || !t) return null;
  const result = probed.result;
  const label = elementWords(view, itsSlice).label;
  const coords = result && axisOf(result, along)?.coords;
  const times = result && axisOf(result, "t")?.coords;
  const unit = shortUnit(description.value?.valueUnits ?? "1");
  const pick = (time: number, entry: number) => update({ time, pixel: along === "x" ? [y, entry] : [entry, x] });
  const across = axisOf(itsSlice, fixed.kind)?.coords;
  const fixedText = across ? ` at ${fixed.kind} = ${brief(across[Math.min(fixed.index, across.length - 1)], 6)}` : "";
  return (
    <Panel
      name="xt-panel" title={`Time along ${along}${fixedText}`} error={probed.error} waiting={probed.waiting} notes={result?.notes}
      open={open} onToggle={setOpened}
    >
      {height > 1 && width > 1 && (
        <Choice
          label="Along" value={along} onChange={setChosen}
          options={[{ value: "x", label: "x, the row of the pixel" }, { value: "y", label: "y, the column of the pixel" }]}
        />
      )}
      {coords && times && (
        <MapCanvas
          values={planeOf(result, "t", along, view.wavelength)} height={times.length} width={coords.length}
          label={`${label}${laneName(result, view.wavelength)}`} unit={unit} kind={label === "M00" ? "positive" : "diverging"}
          scale={view.scale}
          rows="t [ps]" columns={`${along} [px]`} aspect={0.75}
          where={(time, entry) => `${along} ${brief(coords[entry], 6)} px, t ${brief(times[time], 7)} ps`}
          marker={{ row: view.time, column: view.pixel ? (along === "x" ? x : y) : null }} onPick={pick}
        />
      )}
    </Panel>
  );
}
