/** A Mueller matrix as a table with errors. The colour of a cell shows Mij / M00. */

import { diverging } from "../display/colourmaps";
import { brief, place } from "../display/scale";
import { six } from "./numbers";

export interface MatrixTableProps {
  /** The caption, with the wavelength. */
  label: string;
  /** 16 elements, row by row. */
  values: readonly number[];
  errors: readonly number[] | null;
  /** Divide all elements but M00 by M00. */
  normalized: boolean;
  unit: string;
  /** Row and column of the element that the image shows. */
  selected: [number, number] | null;
  onSelect: (row: number, column: number) => void;
}

/** Returns the colour of a quotient from -1 to 1 and a text colour with enough contrast. */
function colours(quotient: number): { background: string; color: string } | undefined {
  if (!Number.isFinite(quotient)) return undefined;
  const position = Math.max(-1, Math.min(1, place("arctan", quotient)));
  const k = 3 * Math.round(255 * (0.5 + 0.5 * position));
  const rgb = [diverging[k], diverging[k + 1], diverging[k + 2]];
  const [r, g, b] = rgb.map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
  const luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
  // Above this luminance, black text has more contrast than white text.
  return { background: `rgb(${rgb.join(" ")})`, color: luminance > 0.179 ? "#000" : "#fff" };
}

export function MatrixTable({ label, values, errors, normalized, unit, selected, onSelect }: MatrixTableProps) {
  const m00 = values[0];
  const scale = (e: number) => (normalized && e > 0 ? (m00 > 0 ? 1 / m00 : NaN) : 1);
  const cell = (e: number) => {
    const [row, column] = [e >> 2, e & 3];
    const value = values[e] * scale(e);
    const error = errors && errors[e] * scale(e);
    const name = `M${row}${column}${normalized && e > 0 ? " / M00" : ""}`;
    const text = `${name} = ${six(value)}${error === null ? "" : ` ± ${brief(error, 2)}`}`;
    return (
      <td key={e} data-element={`${row}${column}`} data-value={String(value)} data-error={error === null ? undefined : String(error)}>
        <button
          type="button" style={e > 0 ? colours(values[e] / m00) : undefined} aria-pressed={selected?.[0] === row && selected[1] === column}
          aria-label={`${text}; show this element in the image`} title={text} onClick={() => onSelect(row, column)}
        >
          <span>{six(value)}</span>
          {error !== null && <small>±&nbsp;{brief(error, 2)}</small>}
        </button>
      </td>
    );
  };
  return (
    <table class="matrix">
      <caption>{`${label}; ${normalized ? `M00 in ${unit}, other elements and their errors divided by M00` : `in ${unit}`}`}</caption>
      <tbody>{[0, 1, 2, 3].map((row) => <tr key={row}>{[0, 1, 2, 3].map((column) => cell(4 * row + column))}</tr>)}</tbody>
    </table>
  );
}
