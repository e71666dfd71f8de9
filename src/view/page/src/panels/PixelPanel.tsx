/** What the chosen pixel sees: values, time profile, Mueller matrix, and the state of its light. */

import type { ComponentChildren } from "preact";
import { useMemo, useState } from "preact/hooks";
import { description, slice, store } from "../data";
import { brief } from "../display/scale";
import { SIGMAS, realizability } from "../math/cloude";
import { matrixOf, positions } from "../math/labelled";
import { type Properties, orientation, propertiesOf } from "../math/properties";
import { angleOfLinearPolarization, degreeOfLinearPolarization, degreeOfPolarization, ellipticityAngle } from "../math/stokes";
import { type Axis, type Labelled, type Slice, axisOf, isPolarized, lengthOf } from "../model";
import { queryProbe } from "../request";
import { type Stokes, type ViewState, state, update } from "../state";
import { Choice, NumberField, Panel, Switch, Toggle } from "./Field";
import { MatrixTable } from "./MatrixTable";
import { decimals, six } from "./numbers";
import { shortUnit } from "../display/units";
import { PoincareSphere } from "./PoincareSphere";
import { type Line, ProfileChart } from "./ProfileChart";
import { useProbe } from "./useProbe";

/** Patterns of dashes, so that lines also differ without colour. */
const DASHES = [undefined, "6 3", "2 3", "8 3 2 3"];

/** Returns the wavelengths of a result as text. */
export const wavelengthNames = (over: { axes: Axis[] }): string[] =>
  axisOf(over, "wavelength")?.coords.map((nm) => `${brief(nm)} nm`) ?? ["all wavelengths"];

/** Returns M s of a matrix. */
function outgoing(m: readonly number[], s: Stokes): Stokes {
  const row = (i: number) => m[4 * i] * s[0] + m[4 * i + 1] * s[1] + m[4 * i + 2] * s[2] + m[4 * i + 3] * s[3];
  return [row(0), row(1), row(2), row(3)];
}

export function PixelPanel() {
  const view = state.value;
  const [itsStore, itsSlice] = [store.value, slice.value];
  const { pixel, illumination, pulse, time, gate, select, panels } = view;
  const query = [pixel, illumination, pulse, select];
  const matrix = useProbe([...query, time, gate], (v, s, sl) => (v.pixel ? queryProbe("matrix", v, s, sl) : null));
  const showPart = (part: Partial<ViewState["panels"]>) => update({ panels: { ...panels, ...part } });
  const profile = useProbe([...query, panels.time], (v, s, sl) =>
    v.pixel && v.panels.time && axisOf(sl, "t") ? queryProbe("profile", v, s, sl) : null);
  if (!itsStore || !itsSlice) return null;
  const unit = shortUnit(description.value?.valueUnits ?? "1");
  const answer = pixel ? matrix.result : null;
  const isMissing = answer !== null && Number.isNaN(answer.mean[0]);
  const result = isMissing ? null : answer;
  const lanes = result ? lengthOf(result, "wavelength") : 1;
  return (
    <Panel
      name="pixel-panel" title="Pixel" error={matrix.error ?? profile.error} waiting={matrix.waiting || profile.waiting}
      notes={[...new Set([...(result?.notes ?? []), ...(pixel && profile.result ? profile.result.notes : [])])]}
    >
      <Position slice={itsSlice} pixel={pixel} />
      {!pixel && <p class="note">Click a pixel of the image, or enter a position, to see its light.</p>}
      {isMissing && <p class="note">This pixel is not rendered yet.</p>}
      {result && <Values result={result} input={view.input} unit={unit} />}
      {pixel && !isMissing && axisOf(itsSlice, "t") && (
        <Part name="profile" title="Time profile" open={panels.time} onToggle={(time) => showPart({ time })}>
          {profile.result && axisOf(profile.result, "t") && <Profile result={profile.result} unit={unit} />}
        </Part>
      )}
      {result && isPolarized(result) && (
        <>
          <Part name="matrix-block" title="Mueller matrix" open={panels.matrix} onToggle={(matrix) => showPart({ matrix })}>
            <Matrix result={result} lanes={lanes} shown={view.wavelength === "all" ? null : view.wavelength} unit={unit} />
          </Part>
          <Part name="outgoing" title="State of the outgoing light" open={panels.sphere} onToggle={(sphere) => showPart({ sphere })}>
            <OutgoingState result={result} input={view.input} />
          </Part>
        </>
      )}
      {pixel && !isPolarized(itsSlice) && (
        <p class="note">This slice has only M00. Choose a slice with Stokes axes to see Mueller matrices and polarization states.</p>
      )}
    </Panel>
  );
}

/** A part of the panel that can be hidden. */
function Part({ name, title, open, onToggle, children }: {
  name: string;
  title: string;
  open: boolean;
  onToggle: (open: boolean) => void;
  children: ComponentChildren;
}) {
  return (
    <div class={name}>
      <h3><Toggle title={title} open={open} onToggle={onToggle} /></h3>
      {open && children}
    </div>
  );
}

/** The entries of y and x, and their coordinates. */
function Position({ slice: itsSlice, pixel }: { slice: Slice; pixel: [number, number] | null }) {
  const field = (kind: "y" | "x", i: 0 | 1) => {
    const axis = axisOf(itsSlice, kind);
    const last = (axis?.coords.length ?? 1) - 1;
    return (
      <NumberField
        label={`${kind} entry`} value={pixel?.[i] ?? 0} min={0} max={last}
        onChange={(index) => {
          const next: [number, number] = [pixel?.[0] ?? 0, pixel?.[1] ?? 0];
          next[i] = Math.round(index);
          update({ pixel: next });
        }}
      />
    );
  };
  const coordinate = (kind: "y" | "x", i: 0 | 1) => {
    const axis = axisOf(itsSlice, kind);
    return axis && pixel ? `${kind} = ${brief(axis.coords[Math.min(pixel[i], axis.coords.length - 1)], 7)}` : "";
  };
  return (
    <div class="row">
      {field("y", 0)}
      {field("x", 1)}
      {pixel && <span class="pixel-position">{`${coordinate("y", 0)}, ${coordinate("x", 1)} pixel`}</span>}
    </div>
  );
}

/** M00 with its error, and properties of the outgoing light, at each wavelength. */
function Values({ result, input, unit }: { result: Labelled; input: Stokes; unit: string }) {
  const at = positions(result);
  const names = wavelengthNames(result);
  const states = names.map((_, wavelength) => {
    const m = matrixOf(result, result.mean, { wavelength });
    return m && outgoing(m, input);
  });
  const rows: [string, string, (s: Stokes) => string][] = [
    ["s0", "S0", (s) => six(s[0])],
    ["dop", "DoP", (s) => decimals(degreeOfPolarization(...s), 3)],
    ["dolp", "DoLP", (s) => decimals(degreeOfLinearPolarization(s[0], s[1], s[2]), 3)],
    ["aolp", "AoLP [°]", (s) => decimals(angleOfLinearPolarization(s[1], s[2]), 1)],
    ["ellipticity", "Ellipticity [°]", (s) => decimals(ellipticityAngle(s[1], s[2], s[3]), 1)],
  ];
  return (
    <table class="values">
      <caption>
        {isPolarized(result) ? `M00 and S0 in ${unit}; S0 to ellipticity are of the outgoing light for the input state` : `M00 in ${unit}`}
      </caption>
      <WavelengthHeads names={names} />
      <tbody>
        <tr data-quantity="m00">
          <th scope="row">M00</th>
          {names.map((name, wavelength) => {
            const k = at({ wavelength });
            return (
              <td
                key={name} data-wavelength={name} data-value={String(result.mean[k])}
                data-error={result.stdError ? String(result.stdError[k]) : undefined}
              >
                {six(result.mean[k])}
                {result.stdError && <small>{`± ${brief(result.stdError[k], 2)}`}</small>}
              </td>
            );
          })}
        </tr>
        {isPolarized(result) && rows.map(([key, label, text]) => (
          <tr key={key} data-quantity={key}>
            <th scope="row">{label}</th>
            {states.map((s, i) => <td key={names[i]} data-wavelength={names[i]}>{s ? text(s) : "–"}</td>)}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** The head of a table with one column for each wavelength. */
function WavelengthHeads({ names }: { names: string[] }) {
  return (
    <thead>
      <tr>
        <td />
        {names.map((name) => <th key={name} scope="col">{name}</th>)}
      </tr>
    </thead>
  );
}

/** Returns the values of an element along t. */
function alongTime(
  result: Labelled, index: { stokes_out: number; stokes_in: number; wavelength: number },
): Pick<Line, "values" | "errors"> {
  const at = positions(result);
  const [from, stride, n] = [at(index), at({ t: 1 }), lengthOf(result, "t")];
  const values = new Float64Array(n);
  const errors = result.stdError && new Float64Array(n);
  for (let i = 0; i < n; i++) {
    values[i] = result.mean[from + i * stride];
    if (errors) errors[i] = result.stdError![from + i * stride];
  }
  return { values, errors };
}

function Profile({ result, unit }: { result: Labelled; unit: string }) {
  const view = state.value;
  const [log, setLog] = useState(false);
  const [lines, setLines] = useState<"wavelengths" | "elements">("wavelengths");
  const names = wavelengthNames(result);
  const polarized = isPolarized(result);
  const lane = Math.min(view.wavelength === "all" ? 0 : view.wavelength, names.length - 1);
  const [row, column] = polarized ? [view.row, view.column] : [0, 0];
  const shown = useMemo<Line[]>(() => {
    if (polarized && lines === "elements") {
      return Array.from({ length: 16 }, (_, e) => {
        const [stokes_out, stokes_in] = [e >> 2, e & 3];
        const series = alongTime(result, { stokes_out, stokes_in, wavelength: lane });
        return { label: `M${stokes_out}${stokes_in}`, ...series, colour: `line-${stokes_out}`, dash: DASHES[stokes_in] };
      });
    }
    return names.map((label, wavelength) => ({
      label, ...alongTime(result, { stokes_out: row, stokes_in: column, wavelength }),
      colour: `line-${wavelength % 4}`, dash: DASHES[wavelength % 4],
    }));
  }, [result, lines, lane, row, column, polarized]);
  const t = axisOf(result, "t")!;
  const ofElements = polarized && lines === "elements";
  return (
    <>
      <div class="row">
        {polarized && (
          <Choice
            label="Lines" value={lines} onChange={setLines}
            options={[
              { value: "wavelengths", label: `M${row}${column} at every wavelength` },
              { value: "elements", label: `every element, ${names[lane]}` },
            ]}
          />
        )}
        <Switch label="Logarithmic" checked={log} onChange={setLog} />
      </div>
      <ProfileChart
        label="Time profile; bands are one standard error; arrow keys choose the time bin" coords={t.coords} xLabel="t" xUnit={t.units}
        yLabel={ofElements ? "Mij" : `M${row}${column}`} yUnit={unit} lines={shown} log={log} cursor={view.time}
        shaded={view.time === null ? view.gate : null} onCursor={(time) => update({ time })}
      />
    </>
  );
}

function Matrix({ result, lanes, shown, unit }: { result: Labelled; lanes: number; shown: number | null; unit: string }) {
  const view = state.value;
  const names = wavelengthNames(result);
  const [own, setOwn] = useState(0);
  const wavelength = Math.min(shown ?? own, lanes - 1);
  const m = matrixOf(result, result.mean, { wavelength });
  if (!m) return null;
  const errors = result.stdError && matrixOf(result, result.stdError, { wavelength });
  return (
    <>
      <div class="row">
        {shown === null && lanes > 1 && (
          <Choice
            label="Wavelength" value={String(wavelength)} onChange={(index) => setOwn(Number(index))}
            options={names.map((label, index) => ({ value: String(index), label }))}
          />
        )}
        <Switch label="Divide by M00" checked={view.normalized} onChange={(normalized) => update({ normalized })} />
      </div>
      <MatrixTable
        label={names[wavelength]} values={m} errors={errors} normalized={view.normalized} unit={unit}
        selected={view.quantity === "element" ? [view.row, view.column] : null}
        onSelect={(row, column) => update({ quantity: "element", row, column })}
      />
      <Realizability m={m} errors={errors} />
      <Decomposition result={result} names={names} />
    </>
  );
}

/** Whether the matrix is a mixture of Jones matrices. */
function Realizability({ m, errors }: { m: number[]; errors: number[] | null }) {
  const found = realizability(m, errors);
  if (!found) return <p class="realizability">Realizability: not defined, because an element is not known.</p>;
  const smallest = found.eigenvalues[3];
  const [text, meaning] = {
    realizable: ["Realizable", "No eigenvalue is negative, so the matrix is a mixture of Jones matrices."],
    uncertain: ["Realizable within errors", `The smallest eigenvalue is negative, but by less than ${SIGMAS} standard errors.`],
    unrealizable: ["Not realizable", "The smallest eigenvalue is negative by more than its error, so no physical element has this matrix."],
  }[found.verdict];
  return (
    <p class={`realizability ${found.verdict}`} data-verdict={found.verdict}>
      <strong>{text}.</strong>{" "}
      <span data-value={String(smallest)}>
        {`Smallest eigenvalue of Cloude's coherency matrix: ${six(smallest)}${found.error === null ? "" : ` ± ${brief(found.error, 2)}`}`}
        {m[0] > 0 && ` (${brief(smallest / m[0], 3)} of M00)`}.
      </span>{" "}
      {meaning}
    </p>
  );
}

/** Numbers of the Lu-Chipman decomposition at every wavelength. */
function Decomposition({ result, names }: { result: Labelled; names: string[] }) {
  const found = names.map((_, wavelength) => {
    const m = matrixOf(result, result.mean, { wavelength });
    return m && propertiesOf(m);
  });
  const rows: [string, string, (p: Properties) => number, number][] = [
    ["diattenuation", "Diattenuation", (p) => p.diattenuation, 4],
    ["polarizance", "Polarizance", (p) => p.polarizance, 4],
    ["retardance", "Retardance [°]", (p) => p.retardance, 2],
    ["fast_axis", "Fast axis [°]", (p) => orientation(p.axis), 2],
    ["depolarization", "Depolarization", (p) => p.depolarization, 4],
  ];
  return (
    <table class="decomposition">
      <caption>Lu–Chipman decomposition</caption>
      <WavelengthHeads names={names} />
      <tbody>
        {rows.map(([key, label, of, digits]) => (
          <tr key={key} data-property={key}>
            <th scope="row">{label}</th>
            {found.map((p, i) => {
              const value = p ? of(p) : NaN;
              return <td key={names[i]} data-wavelength={names[i]} data-value={String(value)}>{decimals(value, digits)}</td>;
            })}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** The state of the outgoing light at every wavelength. */
function OutgoingState({ result, input }: { result: Labelled; input: Stokes }) {
  const points = wavelengthNames(result).flatMap((label, wavelength) => {
    const m = matrixOf(result, result.mean, { wavelength });
    const s = m && outgoing(m, input);
    if (!s || !(s[0] > 0)) return [];
    return [{ label, vector: [s[1] / s[0], s[2] / s[0], s[3] / s[0]] as [number, number, number], colour: `line-${wavelength % 4}` }];
  });
  return (
    <>
      {points.length === 0 && <p class="note">The pixel receives no light.</p>}
      <PoincareSphere label="State of the outgoing light; the radius is the degree of polarization" points={points} />
      <ul class="legend">
        {points.map((point) => (
          <li key={point.label}>
            <svg width="12" height="12" aria-hidden="true"><g class={`state ${point.colour}`}><circle cx="6" cy="6" r="5" /></g></svg>
            {point.label}
          </li>
        ))}
      </ul>
    </>
  );
}
