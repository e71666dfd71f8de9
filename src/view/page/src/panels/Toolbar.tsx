/** Choice of the store, the slice, and how they are shown. */

import { axisOf, isPolarized, lengthOf, type Slice } from "../model";
import { description, slice, store } from "../data";
import { state, update, type Comparison, type Quantity, type Scale } from "../state";
import { firstSlice, MAX_STOPS, MODES } from "../validate";
import { Choice, Slider, Switch } from "./Field";
import { OF_M00, toSlice } from "./showSlice";

/** Quantities that are always on a linear scale. */
const LINEAR: readonly Quantity[] =
  ["colour", "dolp", "aolp", "ellipticity", "diattenuation", "polarizance", "retardance", "depolarization", "fast_axis"];
/** Quantities whose range is fixed: angles that are shown around the circle. */
const CYCLIC: readonly Quantity[] = ["aolp", "fast_axis"];
const SCALE_LABELS: Record<Scale, string> = { linear: "Linear", arctan: "Arctan", symlog: "Symmetric log" };
const MODE_LABELS: Record<Comparison["mode"], string> = {
  side: "Side by side", difference: "Difference", flicker: "Flicker", split: "Split",
};
const ELEMENTS = [0, 1, 2, 3].map((i) => ({ value: String(i), label: String(i) }));
const FURTHER = ["bounces", "component", "label"] as const;
const FURTHER_LABELS = { bounces: "Bounces", component: "Component", label: "Path label" };

const QUANTITY_LABELS: Record<Quantity, string> = {
  colour: "Photograph",
  element: "Mueller element",
  grid: "4 × 4 grid",
  intensity: "Intensity",
  dolp: "DoLP",
  aolp: "AoLP",
  ellipticity: "Ellipticity",
  diattenuation: "Diattenuation",
  polarizance: "Polarizance",
  retardance: "Retardance",
  fast_axis: "Fast axis",
  depolarization: "Depolarization",
  std_error: "Standard error",
  snr: "Signal-to-noise ratio",
};

/** Returns the size of a slice for the list of slices: `polarimetric (256 × 256, Mueller)`. */
function sliceLabel(of: Slice): string {
  const parts = [`${lengthOf(of, "y")} × ${lengthOf(of, "x")}`];
  if (axisOf(of, "u") || axisOf(of, "v")) parts.push(`projector ${lengthOf(of, "v")} × ${lengthOf(of, "u")}`);
  if (axisOf(of, "t")) parts.push(`${lengthOf(of, "t")} time bins`);
  if (isPolarized(of)) parts.push("Mueller");
  return `${of.name} (${parts.join(", ")})`;
}

function labelNames(value: number): string {
  const names = ["medium", "specular", "glossy", "diffuse"].filter((_, bit) => value & (1 << bit));
  return names.length > 0 ? names.join(" + ") : "none";
}

const further = (kind: (typeof FURTHER)[number], value: number): string =>
  kind === "component" ? (["direct", "indirect"][value] ?? String(value)) : kind === "label" ? labelNames(value) : String(value);

/** Returns the words for an exposure. */
const stops = (exposure: number): string => `${exposure > 0 ? "+" : ""}${exposure.toFixed(1).replace("-", "−")} stops`;

function CompareControls() {
  const view = state.value;
  const stores = description.value?.stores.filter((s) => s.kind === "tensor") ?? [];
  const options = [
    { value: "", label: "Nothing" },
    ...stores.flatMap((s) => s.slices.map((of) => ({
      value: JSON.stringify([s.id, of.name]), label: stores.length > 1 ? `${s.name}: ${of.name}` : of.name,
    }))),
  ];
  const choose = (value: string): void => {
    if (value === "") return update({ compare: null });
    const [id, name] = JSON.parse(value) as [number, string];
    update({ compare: { store: id, slice: name, mode: view.compare?.mode ?? "side" } });
  };
  return (
    <>
      <Choice
        label="Compare" value={view.compare ? JSON.stringify([view.compare.store, view.compare.slice]) : ""}
        options={options} onChange={choose}
      />
      {view.compare && (
        <Choice
          label="Comparison" value={view.compare.mode} options={MODES.map((mode) => ({ value: mode, label: MODE_LABELS[mode] }))}
          onChange={(mode) => update({ compare: { ...view.compare!, mode } })}
        />
      )}
    </>
  );
}

/** The row of controls above the image. `onHelp` and `onOut` open dialogs. */
export function Toolbar({ onHelp, onOut }: { onHelp: () => void; onOut: () => void }) {
  const view = state.value;
  const stores = description.value?.stores ?? [];
  const [itsStore, itsSlice] = [store.value, slice.value];
  const nm = itsSlice ? axisOf(itsSlice, "wavelength")?.coords ?? [] : [];
  const polarized = itsSlice !== undefined && isPolarized(itsSlice);
  const ofElement = view.quantity === "element" || view.quantity === "std_error" || view.quantity === "snr";
  const isColour = view.quantity === "colour";
  const chooseStore = (value: string): void => {
    const next = stores[Number(value)];
    const first = next && (next.slices.find((s) => s.name === view.slice) ?? firstSlice(next));
    update({
      store: Number(value), slice: "", compare: null, illumination: { kind: "all" },
      ...(first ? toSlice(view, itsSlice, first) : { time: null, gate: null, select: {} }),
    });
  };
  return (
    <nav class="toolbar" aria-label="View">
      <span class="brand">Sunstone</span>
      {stores.length > 1 && (
        <Choice
          label="Store" value={String(view.store)} options={stores.map((s) => ({ value: String(s.id), label: s.name }))}
          onChange={chooseStore}
        />
      )}
      {itsStore && itsStore.slices.length > 0 && (
        <Choice
          label="Slice" value={view.slice} options={itsStore.slices.map((of) => ({ value: of.name, label: sliceLabel(of) }))}
          onChange={(name) => update(toSlice(view, itsSlice, itsStore.slices.find((s) => s.name === name)!))}
        />
      )}
      {itsSlice && (
        <>
          <Choice
            label="Quantity" value={view.quantity}
            options={(Object.keys(QUANTITY_LABELS) as Quantity[]).map((value) => ({
              value, label: QUANTITY_LABELS[value], disabled: !polarized && !OF_M00.includes(value),
            }))}
            onChange={(quantity) => update({ quantity })}
          />
          {ofElement && polarized && (
            <>
              <Choice label="Row" value={String(view.row)} options={ELEMENTS} onChange={(v) => update({ row: Number(v) })} />
              <Choice label="Column" value={String(view.column)} options={ELEMENTS} onChange={(v) => update({ column: Number(v) })} />
            </>
          )}
          {nm.length > 1 && (
            <Choice
              label="Wavelength" value={String(view.wavelength)}
              options={[
                { value: "all", label: isColour ? "All, as colours" : "Mean" },
                ...nm.map((value, i) => ({ value: String(i), label: `${value} nm` })),
              ]}
              onChange={(v) => update({ wavelength: v === "all" ? "all" : Number(v) })}
            />
          )}
          {FURTHER.map((kind) => {
            const axis = axisOf(itsSlice, kind);
            if (!axis || axis.coords.length < 2) return null;
            const { [kind]: value, ...rest } = view.select;
            return (
              <Choice
                key={kind} label={FURTHER_LABELS[kind]} value={value === undefined ? "" : String(value)}
                options={[{ value: "", label: "Sum" }, ...axis.coords.map((c) => ({ value: String(c), label: further(kind, c) }))]}
                onChange={(v) => update({ select: v === "" ? rest : { ...rest, [kind]: Number(v) } })}
              />
            );
          })}
          <Slider
            label="Exposure" value={view.exposure} min={-MAX_STOPS} max={MAX_STOPS} step={0.1} text={stops(view.exposure)}
            disabled={CYCLIC.includes(view.quantity)}
            onChange={(exposure) => update({ exposure })}
          />
          {view.exposure !== 0 && <button type="button" onClick={() => update({ exposure: 0 })}>Auto exposure</button>}
          {!LINEAR.includes(view.quantity) && (
            <Choice
              label="Scale" value={view.scale}
              options={(Object.keys(SCALE_LABELS) as Scale[]).map((value) => ({ value, label: SCALE_LABELS[value] }))}
              onChange={(scale) => update({ scale })}
            />
          )}
          {polarized && (ofElement || view.quantity === "grid") && (
            <Switch label="Divide by M00" checked={view.normalized} onChange={(normalized) => update({ normalized })} />
          )}
          <CompareControls />
        </>
      )}
      <span class="spring" />
      <Choice
        label="Theme" value={view.theme}
        options={[{ value: "auto", label: "System" }, { value: "dark", label: "Dark" }, { value: "light", label: "Light" }]}
        onChange={(theme) => update({ theme })}
      />
      {itsSlice && <button type="button" onClick={onOut}>Take out</button>}
      <button type="button" aria-label="Help" title="Help (?)" onClick={onHelp}>?</button>
    </nav>
  );
}
