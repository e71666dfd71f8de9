/**
 * Stokes vectors [s0, s1, s2, s3]: s1 is horizontal minus vertical, s2 is +45° minus -45°, s3 is right minus left circular. Angles are
 * counter-clockwise from image right, seen toward the source.
 */

import type { Stokes } from "../state";

export const DEGREES = 180 / Math.PI;

/** The states that the command `sunstone probe --stokes` knows by name. */
export const NAMED_STATES: readonly { name: string; label: string; stokes: Stokes }[] = [
  { name: "unpolarized", label: "Unpolarized", stokes: [1, 0, 0, 0] },
  { name: "horizontal", label: "Horizontal", stokes: [1, 1, 0, 0] },
  { name: "vertical", label: "Vertical", stokes: [1, -1, 0, 0] },
  { name: "plus45", label: "+45°", stokes: [1, 0, 1, 0] },
  { name: "minus45", label: "−45°", stokes: [1, 0, -1, 0] },
  { name: "right", label: "Right circular", stokes: [1, 0, 0, 1] },
  { name: "left", label: "Left circular", stokes: [1, 0, 0, -1] },
];

/** Returns the degree of polarization, or NaN without light. Noise can cause values above 1. */
export const degreeOfPolarization = (s0: number, s1: number, s2: number, s3: number): number =>
  s0 > 0 ? Math.sqrt(s1 * s1 + s2 * s2 + s3 * s3) / s0 : NaN;

/** Returns the degree of linear polarization, or NaN without light. */
export const degreeOfLinearPolarization = (s0: number, s1: number, s2: number): number =>
  s0 > 0 ? Math.sqrt(s1 * s1 + s2 * s2) / s0 : NaN;

/** Returns the angle of linear polarization in degrees, from 0 to below 180. NaN without linear polarization. */
export function angleOfLinearPolarization(s1: number, s2: number): number {
  if (s1 === 0 && s2 === 0) return NaN;
  const angle = 0.5 * DEGREES * Math.atan2(s2, s1);
  return angle < 0 ? angle + 180 : angle;
}

/** Returns the ellipticity angle in degrees, -45 (left circular) to 45 (right circular). NaN without polarization. */
export function ellipticityAngle(s1: number, s2: number, s3: number): number {
  return s1 === 0 && s2 === 0 && s3 === 0 ? NaN : 0.5 * DEGREES * Math.atan2(s3, Math.sqrt(s1 * s1 + s2 * s2));
}

/** Returns the Stokes vector with s0 = 1, a degree of polarization, an azimuth and an ellipticity angle in degrees. */
export function stokesOf(degree: number, azimuth: number, ellipticity: number): Stokes {
  const [psi, chi] = [(2 * azimuth) / DEGREES, (2 * ellipticity) / DEGREES];
  return [1, degree * Math.cos(chi) * Math.cos(psi), degree * Math.cos(chi) * Math.sin(psi), degree * Math.sin(chi)];
}
