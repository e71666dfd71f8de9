/** Writes results as CSV, in the form of `sunstone probe --csv -`: a column for every axis, then the mean and its standard error. */

import type { Labelled } from "../model";

/** Returns a result as CSV. */
export function labelledCsv({ axes, mean, stdError }: Labelled): string {
  const lines = [[...axes.map((axis) => axis.kind), "mean", ...(stdError ? ["std_error"] : [])].join(",")];
  const lengths = axes.map((axis) => axis.coords.length);
  for (let i = 0; i < mean.length; i++) {
    const cells: (number | string)[] = [];
    let rest = i;
    for (let k = axes.length - 1; k >= 0; k--) {
      cells.unshift(axes[k].coords[rest % lengths[k]]);
      rest = Math.floor(rest / lengths[k]);
    }
    cells.push(single(mean[i]));
    if (stdError) cells.push(single(stdError[i]));
    lines.push(cells.join(","));
  }
  return lines.join("\n") + "\n";
}

/** Writes a number of single precision with the digits that identify it. */
export function single(value: number): string {
  for (let digits = 6; digits < 9; digits++) {
    const text = value.toExponential(digits - 1);
    if (Math.fround(Number(text)) === value) return text;
  }
  return value.toExponential(8);
}
