/** Numbers that summarize a Mueller matrix (Lu & Chipman 1996, eqs. 16 to 19, 48), as in src/polarimetry/decompose/properties.rs. */

import { type Parts, decompose, newParts } from "./decompose";
import { DEGREES } from "./stokes";

export interface Properties {
  /** Degree of polarization of the output for unpolarized input, 0..1. */
  polarizance: number;
  /** Dependence of the transmittance on polarization, 0..1. */
  diattenuation: number;
  /** Retardance of M_R in degrees, 0..180. */
  retardance: number;
  /** Depolarization power 1 - |tr m_Δ|/3, 0..1. */
  depolarization: number;
  /** Stokes components (s1, s2, s3) of the fast axis, a unit vector. Zero without retardance. */
  axis: [number, number, number];
}

const scratch = newParts();

/** Returns the properties of a matrix, or null without a decomposition. */
export function propertiesOf(m: ArrayLike<number>): Properties | null {
  if (!decompose(m, scratch)) return null;
  const axis: [number, number, number] = [0, 0, 0];
  writeAxis(scratch, axis);
  return {
    polarizance: polarizance(m),
    diattenuation: diattenuation(m),
    retardance: retardance(scratch),
    depolarization: depolarization(scratch),
    axis,
  };
}

export const polarizance = (m: ArrayLike<number>): number => Math.sqrt(m[4] * m[4] + m[8] * m[8] + m[12] * m[12]) / m[0];

export const diattenuation = (m: ArrayLike<number>): number => Math.sqrt(m[1] * m[1] + m[2] * m[2] + m[3] * m[3]) / m[0];

/** Returns the retardance in degrees. For small angles the sine is precise and the cosine is not. */
export function retardance({ retarder: r }: Parts): number {
  const [x, y, z] = [r[11] - r[14], r[13] - r[7], r[6] - r[9]];
  return DEGREES * Math.atan2(Math.sqrt(x * x + y * y + z * z), r[5] + r[10] + r[15] - 1);
}

export const depolarization = ({ depolarizer }: Parts): number =>
  1 - Math.abs(depolarizer[5] + depolarizer[10] + depolarizer[15]) / 3;

/** Writes the Stokes components of the fast axis. At 180°, the axis whose first nonzero component is positive is chosen. */
export function writeAxis({ retarder: r }: Parts, out: [number, number, number]): void {
  const [x, y, z] = [r[11] - r[14], r[13] - r[7], r[6] - r[9]];
  const sine = Math.sqrt(x * x + y * y + z * z);
  const trace = r[5] + r[10] + r[15];
  out[0] = out[1] = out[2] = 0;
  if (sine > 1e-6 || (trace > 1 && sine > 1e-12)) {
    out[0] = x / sine;
    out[1] = y / sine;
    out[2] = z / sine;
    return;
  }
  if (trace > 1) return;
  // For a rotation by 180°, m_R = 2 a aᵀ - 1. The largest column of m_R + 1 is the most precise.
  let best = 0;
  for (let k = 1; k < 3; k++) if (r[5 * k + 5] >= r[5 * best + 5]) best = k;
  let length = 0;
  for (let i = 0; i < 3; i++) {
    out[i] = r[4 * i + 5 + best] + (i === best ? 1 : 0);
    length += out[i] * out[i];
  }
  length = Math.sqrt(length);
  const first = out.find((a) => Math.abs(a) > 1e-9 * length) ?? 1;
  for (let i = 0; i < 3; i++) out[i] *= Math.sign(first) / length;
}

/** Returns the orientation of a fast axis in degrees, 0 to below 180. NaN for a circular retarder and without retardance. */
export function orientation(axis: readonly [number, number, number]): number {
  if (axis[0] * axis[0] + axis[1] * axis[1] < 1e-12) return NaN;
  const angle = 0.5 * DEGREES * Math.atan2(axis[1], axis[0]);
  return angle < 0 ? angle + 180 : angle;
}
