/** Units as text. */

const SUPERSCRIPTS: Record<string, string> = { "-": "⁻", "1": "¹", "2": "²", "3": "³", "4": "⁴" };

/** Writes a unit of values for labels: "W m-2 sr-1 per unit projector drive" becomes "W m⁻² sr⁻¹". */
export const shortUnit = (unit: string): string =>
  unit.replace(/ per .*$/, "").replace(/-[1-4]/g, (power) => Array.from(power, (c) => SUPERSCRIPTS[c]).join(""));
