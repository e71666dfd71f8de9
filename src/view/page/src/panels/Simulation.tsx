/** Simulated captures of the shown slice with a scheme and a detector, and the error of the matrices that they give. */

import { useEffect, useState } from "preact/hooks";
import { description, source } from "../data";
import { brief } from "../display/scale";
import { type Slice, type Store, axisOf } from "../model";
import type { TrialRequest, TrialResult } from "../sources/source";
import { state } from "../state";
import { Choice, NumberField, Slider, Switch } from "./Field";
import { MapCanvas } from "./MapCanvas";
import { shortUnit } from "../display/units";

const SCHEMES = [
  { value: "drr", label: "Dual rotating retarders" },
  { value: "qrpr", label: "Quad rotating polarizers and retarders, golden angle" },
  { value: "quad", label: "Quad rotating polarizers and retarders, start of learning" },
  { value: "liquid-crystal", label: "Liquid-crystal retarders" },
  { value: "file", label: "Scheme file" },
] as const;

type SchemeName = (typeof SCHEMES)[number]["value"];

/** A camera with the default settings of `sunstone capture --detector`. */
const CAMERA = `[cmos]
exposure_s = 0.01
photons_per_unit = 1e6    # per pixel, second and unit of radiance
quantum_efficiency = 0.65
read_noise_e = 2.4
dark_current_e_s = 1.0
full_well_e = 10700
bit_depth = 12
black_level_dn = 16
`;

/** Angles of a rotating element, for the text of a scheme file. */
const turned = (step: number): string => Array.from({ length: 36 }, (_, k) => k * step).join(", ");

/** What `sunstone scheme drr -k 36` writes. */
const SCHEME = `name = "own"
sensor = { kind = "intensity" }

[[generator]]
kind = "polarizer"
angle_deg = 0
[[generator]]
kind = "retarder"
retardance_deg = 90
angle_deg = [${turned(5)}]

[[analyzer]]
kind = "retarder"
retardance_deg = 90
angle_deg = [${turned(25)}]
[[analyzer]]
kind = "polarizer"
angle_deg = 0
`;

const PAUSE_MS = 150;

interface Outcome {
  result: TrialResult | null;
  error: string | null;
  waiting: boolean;
}

/** Runs the newest trial, 150 ms after its last change. */
function useTrial(request: TrialRequest): Outcome {
  const [outcome, setOutcome] = useState<Outcome>({ result: null, error: null, waiting: true });
  const from = source.value;
  useEffect(() => {
    const controller = new AbortController();
    const show = (change: Partial<Outcome>) => {
      if (!controller.signal.aborted) setOutcome((last) => ({ ...last, ...change }));
    };
    const timer = setTimeout(() => {
      show({ waiting: true });
      from?.trial(request, controller.signal).then(
        (result) => show({ result, error: null, waiting: false }),
        (error: unknown) => show({ result: null, error: error instanceof Error ? error.message : String(error), waiting: false }),
      );
    }, PAUSE_MS);
    return () => {
      clearTimeout(timer);
      controller.abort();
    };
  }, [from, JSON.stringify(request)]);
  return outcome;
}

export function Simulation({ store: itsStore, slice: itsSlice }: { store: Store; slice: Slice }) {
  const view = state.value;
  const nm = axisOf(itsSlice, "wavelength")?.coords ?? [];
  const [name, setName] = useState<SchemeName>("drr");
  const [captures, setCaptures] = useState(36);
  const [array, setArray] = useState(false);
  const [kind, setKind] = useState<"sigma" | "toml">("sigma");
  const [percent, setPercent] = useState(0.1);
  const [toml, setToml] = useState(CAMERA);
  const [file, setFile] = useState(SCHEME);
  // The number of captures of a scheme file is known after the first trial.
  const [inFile, setInFile] = useState(1);
  const [own, setOwn] = useState(0);
  const [seed, setSeed] = useState(0);
  const [capture, setCapture] = useState(0);
  const wavelength = Math.min(view.wavelength === "all" ? own : view.wavelength, Math.max(0, nm.length - 1));
  // A sensor with polarizers records four images at once.
  const images = name === "file" ? inFile : captures * (array ? 4 : 1);
  const shown = Math.min(capture, images - 1);
  const { result, error, waiting } = useTrial({
    store: itsStore.id, slice: itsSlice.name, scheme: name === "file" ? { toml: file } : { name, captures, array },
    detector: kind === "sigma" ? { sigma: percent / 100 } : { toml }, wavelength, seed, capture: shown,
  });
  useEffect(() => {
    if (name === "file" && result) setInFile(result.captures);
  }, [name, result]);
  return (
    <div aria-busy={waiting ? "true" : "false"}>
      <Choice label="Scheme" value={name} options={SCHEMES} onChange={setName} />
      {name === "file" ? (
        <TextArea label="Scheme file (TOML, as of `sunstone scheme` and `sunstone learn`)" value={file} onChange={setFile} />
      ) : (
        <div class="row">
          <NumberField label="Number of captures" value={captures} min={1} max={400} onChange={(n) => setCaptures(Math.round(n))} />
          <Switch label="Polarizer-array sensor" checked={array} onChange={setArray} />
        </div>
      )}
      <div class="row">
        <Choice
          label="Detector" value={kind} onChange={setKind}
          options={[{ value: "sigma", label: "Normal noise" }, { value: "toml", label: "Detector file" }]}
        />
        {kind === "sigma" && (
          <NumberField
            label="Standard deviation" unit="% of mean M00" value={percent} min={0} max={1000} step="any" onChange={setPercent}
          />
        )}
      </div>
      {kind === "toml" && <TextArea label="Detector file (TOML, [cmos] or [spad])" value={toml} onChange={setToml} />}
      <div class="row">
        {view.wavelength === "all" && nm.length > 1 && (
          <Choice
            label="Wavelength" value={String(wavelength)} options={nm.map((n, i) => ({ value: String(i), label: `${brief(n)} nm` }))}
            onChange={(i) => setOwn(Number(i))}
          />
        )}
        <NumberField label="Seed" value={seed} min={0} max={2 ** 32 - 1} onChange={(n) => setSeed(Math.round(n))} />
      </div>
      <Slider label="Capture" value={shown} min={0} max={images - 1} text={`${shown + 1} of ${images}`} onChange={setCapture} />
      {error && <p class="error" role="alert">{error}</p>}
      {result && <Result result={result} shown={shown} />}
    </div>
  );
}

function TextArea({ label, value, onChange }: { label: string; value: string; onChange: (text: string) => void }) {
  return (
    <label class="field text-area">
      <span>{label}</span>
      <textarea rows={9} spellcheck={false} value={value} onInput={(event) => onChange(event.currentTarget.value)} />
    </label>
  );
}

function Result({ result, shown }: { result: TrialResult; shown: number }) {
  const unit = shortUnit(description.value?.valueUnits ?? "1");
  const { height, width, image, errors, errorWidth } = result;
  const saturated = image.reduce((n, value) => n + (Number.isNaN(value) ? 1 : 0), 0);
  const where = (y: number, x: number) => `y ${y}, x ${x}`;
  const percent = (value: number | null) => (value === null || !Number.isFinite(value) ? "–" : `${brief(100 * value, 4)} %`);
  const numbers: [string, string, number | string | null, string][] = [
    ["rank", "Rank", result.rank, `${result.rank} of 16`],
    ["condition", "Condition number", result.condition, result.condition === null ? "– (rank below 16)" : brief(result.condition)],
    ["estimator", "Estimator", result.estimator, result.estimator],
    ["predicted", "Predicted error", result.predicted, percent(result.predicted)],
    ["rmse", "RMSE of elements", result.rmse, percent(result.rmse)],
    ["normalized", "Mean error of Mij / M00", result.normalized, brief(result.normalized)],
    ["saturated", "Saturated pixels of this capture", saturated, `${saturated} of ${image.length}`],
    ["lost", "Pixels without a result", result.lost, percent(result.lost)],
  ];
  return (
    <>
      <table class="trial">
        <caption>Errors are relative to the mean M00</caption>
        <tbody>
          {numbers.map(([key, label, value, text]) => (
            <tr key={key} data-number={key}><th scope="row">{label}</th><td data-value={String(value)}>{text}</td></tr>
          ))}
        </tbody>
      </table>
      {result.notes.map((note) => <p key={note} class="note">{note}</p>)}
      <h3>{`Capture ${shown + 1}`}</h3>
      <MapCanvas
        values={image} height={height} width={width} label="Intensity" unit={unit} kind="grey" rows="y" columns="x" where={where}
      />
      <h3>Error of the reconstruction</h3>
      <MapCanvas
        values={errors} height={errors.length / errorWidth} width={errorWidth} label="Error over mean M00" unit="1" kind="positive"
        rows="y" columns="x" where={where}
      />
    </>
  );
}
