/** The Stokes state of the projector's light, the analyzer before the camera, and the pulse. */

import { useState } from "preact/hooks";
import { slice } from "../data";
import { NAMED_STATES, angleOfLinearPolarization, degreeOfPolarization, ellipticityAngle, stokesOf } from "../math/stokes";
import { axisOf, isPolarized } from "../model";
import { type Stokes, state, update } from "../state";
import { NumberField, Panel, Slider, Switch } from "./Field";
import { PoincareSphere } from "./PoincareSphere";

/** Width of a pulse when the user switches it on, in ps. */
const PULSE_PS = 100;

/** Returns a state with s0 = 1. A degree of polarization above 1 is reduced to 1. */
function physical(s1: number, s2: number, s3: number): Stokes {
  const degree = Math.hypot(s1, s2, s3);
  const scale = degree > 1 ? 1 / degree : 1;
  return [1, s1 * scale, s2 * scale, s3 * scale];
}

/** Rounds to seven decimals, so that the URL and commands stay short. */
const rounded = (stokes: Stokes): Stokes => stokes.map((s) => Math.round(s * 1e7) / 1e7 + 0) as Stokes;

const isSame = (a: Stokes, b: Stokes): boolean => a.every((s, i) => Math.abs(s - b[i]) < 1e-6);

/** Numbers in fields have as many digits as fit. */
const fitted = (value: number, digits: number): number => Number(value.toFixed(digits));

export function StatePanel() {
  const view = state.value;
  const itsSlice = slice.value;
  const [open, setOpen] = useState(true);
  const hasStates = itsSlice !== undefined && isPolarized(itsSlice);
  const hasTime = itsSlice !== undefined && axisOf(itsSlice, "t") !== undefined;
  return (
    <Panel name="state-panel" title="Light and analyzer" open={open} onToggle={setOpen}>
      {hasStates ? (
        <div class="states">
          <Editor title="Projector light" value={view.input} onChange={(input) => update({ input })} />
          <div>
            <Switch
              label="Analyzer before the camera" checked={view.analyzer !== null}
              onChange={(on) => update({ analyzer: on ? [1, 1, 0, 0] : null })}
            />
            {view.analyzer && (
              <Editor title="Analyzer" value={view.analyzer} onChange={(analyzer) => update({ analyzer })} />
            )}
          </div>
        </div>
      ) : (
        <p class="note">This slice has only M00, so polarization states do not change it. Choose a slice with Stokes axes.</p>
      )}
      <fieldset class="row">
        <legend>Pulse</legend>
        <Switch
          label="Pulse of finite width" checked={view.pulse !== null} disabled={!hasTime}
          onChange={(on) => update({ pulse: on ? PULSE_PS : null })}
        />
        <NumberField
          label="Width (FWHM)" unit="ps" value={view.pulse ?? PULSE_PS} min={0} max={1e6} step="any"
          disabled={!hasTime || view.pulse === null} onChange={(pulse) => update({ pulse })}
        />
        {!hasTime && <p class="note">A pulse needs a slice with a time axis.</p>}
      </fieldset>
    </Panel>
  );
}

/** A sphere, buttons, a slider and numbers for one state. */
function Editor({ title, value, onChange }: { title: string; value: Stokes; onChange: (stokes: Stokes) => void }) {
  const [s0, s1, s2, s3] = value;
  const degree = degreeOfPolarization(s0, s1, s2, s3);
  const azimuth = angleOfLinearPolarization(s1, s2);
  const ellipticity = ellipticityAngle(s1, s2, s3);
  const set = (a: number, b: number, c: number) => onChange(rounded(physical(a, b, c)));
  // Without polarization, the angles are those of horizontal light.
  const [psi, chi] = [Number.isNaN(azimuth) ? 0 : azimuth, Number.isNaN(ellipticity) ? 0 : ellipticity];
  const setAngles = (p: number, a: number, e: number) => {
    const [, x, y, z] = stokesOf(p, a, e);
    set(x, y, z);
  };
  return (
    <fieldset class="state-editor">
      <legend>{title}</legend>
      <PoincareSphere
        label={title} points={[{ vector: [s1 / s0, s2 / s0, s3 / s0], label: title, colour: "chosen" }]} onChange={(v) => set(...v)}
      />
      <div class="named-states" role="group" aria-label={`${title}: named states`}>
        {NAMED_STATES.map(({ name, label, stokes }) => (
          <button key={name} type="button" data-state={name} aria-pressed={isSame(value, stokes)} onClick={() => onChange(stokes)}>
            {label}
          </button>
        ))}
      </div>
      <Slider
        label="Degree of polarization" value={degree} min={0} max={1} step={0.01} text={degree.toFixed(2)}
        onChange={(p) => setAngles(p, psi, chi)}
      />
      <div class="row">
        <NumberField
          label="AoLP" unit="°" value={fitted(psi, 2)} min={-180} max={180} step="any"
          onChange={(a) => setAngles(degree || 1, a, chi)}
        />
        <NumberField
          label="Ellipticity" unit="°" value={fitted(chi, 2)} min={-45} max={45} step="any"
          onChange={(e) => setAngles(degree || 1, psi, e)}
        />
      </div>
      <div class="row">
        <NumberField label="s1" value={fitted(s1, 4)} min={-1} max={1} step="any" onChange={(v) => set(v, s2, s3)} />
        <NumberField label="s2" value={fitted(s2, 4)} min={-1} max={1} step="any" onChange={(v) => set(s1, v, s3)} />
        <NumberField label="s3" value={fitted(s3, 4)} min={-1} max={1} step="any" onChange={(v) => set(s1, s2, v)} />
      </div>
    </fieldset>
  );
}
