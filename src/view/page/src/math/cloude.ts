/**
 * Cloude's coherency matrix H = ¼ Σ m_ij σ_i ⊗ σ_j* (Cloude 1986, Optik 75:26), with the Pauli matrices in the order of the Stokes
 * elements. A Mueller matrix is realizable, which means that it is a mixture of Jones matrices, if and only if H has no negative
 * eigenvalue. The eigenvalues sum to m00. The definition is that of src/polarimetry/decompose/cloude.rs.
 */

import { SINGLE } from "./decompose";
import { hermitianEigen } from "./eigen";

/** Real and imaginary parts of the Pauli matrices, row by row. */
const PAULI: readonly { re: number[]; im: number[] }[] = [
  { re: [1, 0, 0, 1], im: [0, 0, 0, 0] },
  { re: [1, 0, 0, -1], im: [0, 0, 0, 0] },
  { re: [0, 1, 1, 0], im: [0, 0, 0, 0] },
  { re: [0, 0, 0, 0], im: [0, -1, 1, 0] },
];

/** Real and imaginary parts of σ_i ⊗ σ_j*, 16 numbers each. */
const BASIS = PAULI.flatMap((a) => PAULI.map((b) => kronecker(a, b)));

function kronecker(a: { re: number[]; im: number[] }, b: { re: number[]; im: number[] }): { re: Float64Array; im: Float64Array } {
  const out = { re: new Float64Array(16), im: new Float64Array(16) };
  for (let row = 0; row < 4; row++) {
    for (let column = 0; column < 4; column++) {
      const i = 2 * (row >> 1) + (column >> 1);
      const j = 2 * (row & 1) + (column & 1);
      out.re[4 * row + column] = a.re[i] * b.re[j] + a.im[i] * b.im[j];
      out.im[4 * row + column] = a.im[i] * b.re[j] - a.re[i] * b.im[j];
    }
  }
  return out;
}

/** Number of standard errors within which a negative eigenvalue is compatible with zero. */
export const SIGMAS = 3;

export interface Realizability {
  /** Eigenvalues of H in descending order. */
  eigenvalues: Float64Array;
  /** Standard error of the smallest eigenvalue for independent errors of the elements. Null without errors. */
  error: number | null;
  /** `uncertain`: the smallest eigenvalue is negative, by at most `SIGMAS` standard errors. */
  verdict: "realizable" | "uncertain" | "unrealizable";
}

/** Returns whether a matrix of 16 numbers is realizable, or null if an element is not finite. Rounding errors of m00 · 1e-6 are ignored. */
export function realizability(m: ArrayLike<number>, errors: ArrayLike<number> | null): Realizability | null {
  const [re, im] = [new Float64Array(16), new Float64Array(16)];
  for (let e = 0; e < 16; e++) {
    if (!Number.isFinite(m[e])) return null;
    for (let k = 0; k < 16; k++) {
      re[k] += (m[e] / 4) * BASIS[e].re[k];
      im[k] += (m[e] / 4) * BASIS[e].im[k];
    }
  }
  const { values, vectors } = hermitianEigen(re, im, 4);
  const error = errors && smallestError(vectors.subarray(24, 32), errors);
  const smallest = values[3];
  if (smallest >= -SINGLE * Math.max(m[0], 0)) return { eigenvalues: values, error, verdict: "realizable" };
  return { eigenvalues: values, error, verdict: error !== null && smallest >= -SIGMAS * error ? "uncertain" : "unrealizable" };
}

/** Returns the error of the eigenvalue λ = v† H v to first order, with ∂λ/∂m_ij = ¼ v† (σ_i ⊗ σ_j*) v. */
function smallestError(v: Float64Array, errors: ArrayLike<number>): number {
  let variance = 0;
  for (let e = 0; e < 16; e++) {
    let slope = 0;
    for (let row = 0; row < 4; row++) {
      for (let column = 0; column < 4; column++) {
        const re = v[row] * v[column] + v[row + 4] * v[column + 4];
        const im = v[row] * v[column + 4] - v[row + 4] * v[column];
        slope += (BASIS[e].re[4 * row + column] * re - BASIS[e].im[4 * row + column] * im) / 4;
      }
    }
    variance += (slope * errors[e]) ** 2;
  }
  return Math.sqrt(variance);
}
