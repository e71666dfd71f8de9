/** The frames of a rig's run, with the numbers that the run recorded for each frame. */

import { useEffect, useRef, useState } from "preact/hooks";
import { source } from "../data";
import { white } from "../display/colour";
import { brief } from "../display/scale";
import type { Captures } from "../model";
import type { FrameResult } from "../sources/source";
import { Slider, Switch } from "./Field";
import { MapCanvas } from "./MapCanvas";
import { ProfileChart } from "./ProfileChart";

type RunAxis = Captures["axes"][number];

const coordinate = (axis: RunAxis, index: number): string =>
  `${brief(axis.coords[index], 6)}${axis.units === "1" ? "" : ` ${axis.units}`}`;

export function RunFrames({ id, captures }: { id: number; captures: Captures }) {
  const [run, ofFrame] = [captures.axes.slice(0, captures.runAxes), captures.axes.slice(captures.runAxes)];
  const [index, setIndex] = useState<number[]>(run.map(() => 0));
  const [frame, setFrame] = useState<FrameResult | null>(null);
  const [error, setError] = useState<string | null>(null);
  const from = source.value;
  useEffect(() => {
    let isCurrent = true;
    from?.frame(id, index).then(
      (next) => {
        if (!isCurrent) return;
        setFrame(next);
        setError(null);
      },
      (problem: unknown) => isCurrent && setError(problem instanceof Error ? problem.message : String(problem)),
    );
    return () => {
      isCurrent = false;
    };
  }, [from, id, index.join(",")]);
  const number = index.reduce((at, i, k) => at * run[k].coords.length + i, 0);
  const move = (k: number, to: number) => setIndex(index.map((i, j) => (j === k ? to : i)));
  return (
    <>
      {run.map((axis, k) => (
        <Slider
          key={axis.name} label={axis.name} value={index[k]} min={0} max={axis.coords.length - 1} disabled={axis.coords.length === 1}
          text={`${coordinate(axis, index[k])} (${index[k] + 1} of ${axis.coords.length})`} onChange={(to) => move(k, to)}
        />
      ))}
      {error && <p class="error" role="alert">{error}</p>}
      {frame && <Frame frame={frame} axes={ofFrame} />}
      {captures.columns.length > 0 && (
        <table class="columns">
          <caption>{`Recorded for frame ${number}`}</caption>
          <tbody>
            {captures.columns.map((column) => (
              <tr key={column.name}>
                <th scope="row">{column.name}</th>
                <td data-value={String(column.values[number])}>{brief(column.values[number] ?? NaN, 7)}</td>
                <td>{column.units === "1" ? "" : column.units}</td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
    </>
  );
}

/** A frame as an image of its last two axes, or as a chart if it has one axis. Further axes are chosen with sliders. */
function Frame({ frame, axes }: { frame: FrameResult; axes: RunAxis[] }) {
  const [exposure, setExposure] = useState(0);
  const [log, setLog] = useState(false);
  const [entries, setEntries] = useState<number[]>(axes.map(() => 0));
  // White is that of the brightest frame so far, so that frames can be compared.
  const brightest = useRef(0);
  if (frame.shape.length === 0) return <p>{`Value: ${brief(frame.values[0], 7)} DN`}</p>;
  if (frame.shape.length === 1) {
    const axis = axes[0];
    // Photon counts have Poisson statistics, so the square root of a count is its standard error.
    const line = { label: "counts", values: frame.values, errors: frame.values.map((n) => Math.sqrt(Math.max(n, 0))), colour: "line-0" };
    return (
      <>
        <Switch label="Logarithmic" checked={log} onChange={setLog} />
        <ProfileChart
          label="Histogram of photon counts; the band is the square root of the count" coords={axis.coords}
          xLabel={axis.name} xUnit={axis.units} yLabel="counts per bin" yUnit="1" lines={[line]} log={log}
        />
      </>
    );
  }
  const [height, width] = frame.shape.slice(-2);
  const further = axes.slice(0, -2);
  const plane = further.reduce((at, axis, k) => at * axis.coords.length + entries[k], 0);
  const values = frame.values.subarray(plane * height * width, (plane + 1) * height * width);
  brightest.current = Math.max(brightest.current, white(values, 0.995));
  const [rows, columns] = axes.slice(-2);
  return (
    <>
      {further.map((axis, k) => (
        <Slider
          key={axis.name} label={axis.name} value={entries[k]} min={0} max={axis.coords.length - 1} text={coordinate(axis, entries[k])}
          onChange={(to) => setEntries(entries.map((i, j) => (j === k ? to : i)))}
        />
      ))}
      <Slider
        label="Display exposure" value={exposure} min={-6} max={6} step={0.25} text={`${exposure > 0 ? "+" : ""}${exposure} stops`}
        onChange={setExposure}
      />
      <MapCanvas
        values={values} height={height} width={width} label="Frame" unit="DN" kind="grey" tall={560}
        range={[0, brightest.current * 2 ** -exposure]} rows={rows.name} columns={columns.name}
        where={(y, x) => `${rows.name} ${coordinate(rows, y)}, ${columns.name} ${coordinate(columns, x)}`}
      />
    </>
  );
}
