/** Where the light of the chosen camera pixel came from: the projector pixels that contribute to it. */

import { description, slice, store } from "../data";
import { brief } from "../display/scale";
import { planeOf } from "../math/labelled";
import { type Labelled, axisOf, lengthOf } from "../model";
import { pixelProbe, resolvesProjector } from "../request";
import { type ViewState, state, update } from "../state";
import { Panel } from "./Field";
import { MapCanvas } from "./MapCanvas";
import { six } from "./numbers";
import { shortUnit } from "../display/units";
import { type Line, ProfileChart } from "./ProfileChart";
import { SliceButtons } from "./showSlice";
import { elementWords, keeping, laneName, nearest, useProbe } from "./useProbe";

export function OriginPanel() {
  const view = state.value;
  const [itsStore, itsSlice] = [store.value, slice.value];
  const { pixel, pulse, time, gate, select, quantity, row, column, panels } = view;
  const inputs = [pixel, panels.origin, pulse, time, gate, select, quantity === "element" ? [row, column] : null];
  const probed = useProbe(inputs, (v, s, sl) => {
    if (!v.pixel || !v.panels.origin || !(axisOf(sl, "v") || axisOf(sl, "u"))) return null;
    // All projector pixels are on: the panel shows what each of them contributes.
    const request = pixelProbe({ ...v, illumination: { kind: "all" } }, s, sl);
    return keeping({ ...request, select: [...request.select, ...elementWords(v, sl).words] }, sl, ["v", "u", "wavelength"]);
  });
  if (!itsStore || !itsSlice) return null;
  const hasOrigin = axisOf(itsSlice, "v") !== undefined || axisOf(itsSlice, "u") !== undefined;
  const others = itsStore.slices.filter((s) => axisOf(s, "v") || axisOf(s, "u"));
  return (
    <Panel
      name="origin-panel" title="Origin of the light" error={probed.error} waiting={probed.waiting} notes={probed.result?.notes}
      open={panels.origin} onToggle={(origin) => update({ panels: { ...panels, origin } })}
    >
      {!hasOrigin && (
        <>
          <p class="note">
            {others.length === 0
              ? "No slice of this store resolves projector pixels, so the origin of the light is not known."
              : `The slice "${itsSlice.name}" does not resolve projector pixels. These slices do:`}
          </p>
          <SliceButtons from={itsSlice} slices={others} />
        </>
      )}
      {hasOrigin && !pixel && <p class="note">Click a pixel of the image to see which projector pixels its light came from.</p>}
      {pixel && probed.result && (
        <Origin result={probed.result} view={view} name={elementWords(view, itsSlice).label} canPick={resolvesProjector(itsSlice)} />
      )}
    </Panel>
  );
}

function Origin({ result, view, name, canPick }: { result: Labelled; view: ViewState; name: string; canPick: boolean }) {
  const unit = shortUnit(description.value?.valueUnits ?? "1");
  const [height, width] = [lengthOf(result, "v"), lengthOf(result, "u")];
  // An axis with one entry is a sum over projector rows or columns, not a position.
  const [v, u] = (["v", "u"] as const).map((kind) => (lengthOf(result, kind) > 1 ? axisOf(result, kind)?.coords : undefined));
  const values = planeOf(result, "v", "u", view.wavelength);
  const { total, strongest, largest } = statistics(values);
  const at = (index: number) => place(index, width, v, u);
  const label = name + laneName(result, view.wavelength);
  const isSigned = name !== "M00";
  return (
    <>
      {height > 1 && width > 1 ? (
        <MapCanvas
          values={values} height={height} width={width} label={`${label} from each projector pixel`} unit={unit}
          kind={isSigned ? "diverging" : "positive"} range={isSigned ? [-largest, largest] : [0, largest]}
          scale={view.scale} rows="v" columns="u" where={(row, column) => at(row * width + column)}
          marker={illuminated(view, v, u)}
          onPick={canPick ? (row, column) => pick(v?.[row], u?.[column], true) : undefined}
        />
      ) : (
        <Bars
          values={values} coords={(width > 1 ? u : v) ?? [0]} axis={width > 1 ? "u" : "v"} name={name} label={label} unit={unit}
          onPick={canPick ? (index) => pick(width > 1 ? undefined : v?.[index], width > 1 ? u?.[index] : undefined, false) : undefined}
          chosen={width > 1 ? illuminated(view, v, u).column : illuminated(view, v, u).row}
        />
      )}
      <p class="origin-total">
        <span data-value={String(total)}>{`Sum: ${six(total)} ${unit}. `}</span>
        {strongest >= 0 && (
          <span data-share={String(values[strongest] / total)}>
            {`Strongest: ${at(strongest)}, ${six(values[strongest])} ${unit}`}
            {total !== 0 && `, ${brief((100 * values[strongest]) / total, 3)} % of the sum`}.
          </span>
        )}
      </p>
    </>
  );
}

/** Returns the sum, the entry of the largest magnitude (-1: none), and this magnitude or 1. */
function statistics(values: Float32Array): { total: number; strongest: number; largest: number } {
  let [total, strongest, largest] = [0, -1, 0];
  for (let i = 0; i < values.length; i++) {
    if (Number.isNaN(values[i])) continue;
    total += values[i];
    if (Math.abs(values[i]) > largest) {
      largest = Math.abs(values[i]);
      strongest = i;
    }
  }
  return { total, strongest, largest: largest || 1 };
}

const place = (index: number, width: number, v: readonly number[] | undefined, u: readonly number[] | undefined): string =>
  [v && `v ${brief(v[Math.floor(index / width)], 6)} px`, u && `u ${brief(u[index % width], 6)} px`].filter(Boolean).join(", ");

/** Returns the entries of the illuminated projector row and column. */
function illuminated({ illumination }: ViewState, v: readonly number[] | undefined, u: readonly number[] | undefined) {
  return {
    row: v && "v" in illumination ? nearest(v, illumination.v) : null,
    column: u && "u" in illumination ? nearest(u, illumination.u) : null,
  };
}

/** Illuminates a projector pixel, or a row or column if only one coordinate is known. */
function pick(v: number | undefined, u: number | undefined, both: boolean): void {
  if (both && v !== undefined && u !== undefined) update({ illumination: { kind: "pixel", v: Math.floor(v), u: Math.floor(u) } });
  else if (v !== undefined) update({ illumination: { kind: "row", v: Math.floor(v) } });
  else if (u !== undefined) update({ illumination: { kind: "column", u: Math.floor(u) } });
}

/** A chart for slices that resolve only rows or only columns of the projector. */
function Bars({ values, coords, axis, name, label, unit, chosen, onPick }: {
  values: Float32Array;
  coords: readonly number[];
  axis: "v" | "u";
  name: string;
  label: string;
  unit: string;
  chosen: number | null;
  onPick?: (index: number) => void;
}) {
  const line: Line = { label, values, errors: null, colour: "line-0", bars: true };
  return (
    <ProfileChart
      label={`${label} over projector ${axis === "u" ? "columns" : "rows"}`} coords={coords} xLabel={axis} xUnit="px"
      yLabel={name} yUnit={unit}
      lines={[line]} log={false} cursor={chosen}
      onCursor={onPick && ((index) => (index === null ? update({ illumination: { kind: "all" } }) : onPick(index)))}
    />
  );
}
