/**
 * Lu-Chipman decomposition of a Mueller matrix into depolarizer, retarder and diattenuator, M = M_Δ M_R M_D (Lu & Chipman 1996,
 * J. Opt. Soc. Am. A 13:1106). With M = m00 [1 Dᵀ; P m],
 *
 *     M_D = m00 [1 Dᵀ; D m_D],  m_D = c·1 + D Dᵀ/(1 + c),  c = √(1 - D²),
 *     M_Δ = [1 0; P_Δ m_Δ],  P_Δ = (P - m D)/(1 - D²),  M_R = [1 0; 0 m_R],
 *
 * and m_Δ m_R is the polar decomposition of m', the lower right block of M M_D⁻¹. The conventions for matrices without a unique
 * decomposition are those of the command `sunstone decompose` (src/polarimetry/decompose/lu_chipman.rs).
 *
 * Matrices are 16 numbers, row by row. Functions write into buffers of the caller, so maps of many pixels do not allocate.
 */

/** Relative rounding error of single-precision matrices. Values of 1 - D² and singular values of m' below it are treated as zero. */
export const SINGLE = 1e-6;

/** The three factors. Light passes the last factor, the diattenuator, first. M_Δ and M_R have m00 = 1. */
export interface Parts {
  depolarizer: Float64Array;
  retarder: Float64Array;
  diattenuator: Float64Array;
}

export const newParts = (): Parts => ({
  depolarizer: new Float64Array(16),
  retarder: new Float64Array(16),
  diattenuator: new Float64Array(16),
});

// Scratch of `decompose`: 3 x 3 matrices, row by row, and vectors. The page has a single thread.
const inner = new Float64Array(9);
const delta = new Float64Array(9);
const turn = new Float64Array(9);
const d = new Float64Array(3);
const p = new Float64Array(3);
const pDelta = new Float64Array(3);
/** Columns u_k s_k, the orthogonal v_k, and s_k of a singular value decomposition. */
const w = new Float64Array(9);
const v = new Float64Array(9);
const s = new Float64Array(3);
/** Directions of the only nonzero singular value. */
const from = new Float64Array(3);
const to = new Float64Array(3);

/** Decomposes the matrix m into `parts`. Returns false without a decomposition: D > 1, m00 ≤ 0, or an element that is not finite. */
export function decompose(m: ArrayLike<number>, parts: Parts, rounding = SINGLE): boolean {
  const m00 = m[0];
  if (!(m00 > 0)) return false;
  for (let k = 0; k < 16; k++) if (!Number.isFinite(m[k])) return false;
  for (let i = 0; i < 3; i++) {
    d[i] = m[i + 1] / m00;
    p[i] = m[4 * i + 4] / m00;
  }
  const d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
  const rest = 1 - d2;
  if (rest < -rounding) return false;
  pDelta.fill(0);
  if (rest <= rounding) {
    // An ideal polarizer: the light behind M_D has one state, and m_R only has to turn D to P.
    const length = Math.sqrt(d2);
    for (let i = 0; i < 3; i++) d[i] /= length;
    smallestRotation(d, p);
    delta.fill(0);
    delta[0] = delta[4] = delta[8] = Math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
  } else {
    const c = Math.sqrt(rest);
    for (let i = 0; i < 3; i++) {
      const row = 4 * i + 5;
      const along = (m[row] * d[0] + m[row + 1] * d[1] + m[row + 2] * d[2]) / m00;
      pDelta[i] = (p[i] - along) / rest;
      for (let j = 0; j < 3; j++) inner[3 * i + j] = ((m[row + j] / m00) * c + (along / (1 + c) - p[i]) * d[j]) / rest;
    }
    polar(rounding);
  }
  compose(parts, m00);
  return true;
}

/** Writes the factors from the scratch of `decompose`. */
function compose(parts: Parts, m00: number): void {
  const { depolarizer, retarder, diattenuator } = parts;
  const c = Math.sqrt(Math.max(0, 1 - (d[0] * d[0] + d[1] * d[1] + d[2] * d[2])));
  depolarizer[0] = retarder[0] = 1;
  diattenuator[0] = m00;
  for (let i = 0; i < 3; i++) {
    const row = 4 * i + 4;
    depolarizer[i + 1] = retarder[i + 1] = retarder[row] = 0;
    depolarizer[row] = pDelta[i];
    diattenuator[i + 1] = diattenuator[row] = m00 * d[i];
    for (let j = 0; j < 3; j++) {
      depolarizer[row + j + 1] = delta[3 * i + j];
      retarder[row + j + 1] = turn[3 * i + j];
      diattenuator[row + j + 1] = m00 * ((d[i] * d[j]) / (1 + c) + (i === j ? c : 0));
    }
  }
}

/** Sets w, v and s to the singular value decomposition of m' by one-sided Jacobi rotations. The s_k are in descending order. */
function singularValues(): void {
  w.set(inner);
  v.fill(0);
  v[0] = v[4] = v[8] = 1;
  for (let sweep = 0; sweep < 30; sweep++) {
    let done = true;
    for (let i = 0; i < 2; i++) {
      for (let j = i + 1; j < 3; j++) {
        const alpha = w[i] * w[i] + w[i + 3] * w[i + 3] + w[i + 6] * w[i + 6];
        const beta = w[j] * w[j] + w[j + 3] * w[j + 3] + w[j + 6] * w[j + 6];
        const gamma = w[i] * w[j] + w[i + 3] * w[j + 3] + w[i + 6] * w[j + 6];
        if (Math.abs(gamma) <= 1e-15 * Math.sqrt(alpha * beta) || gamma === 0) continue;
        done = false;
        const zeta = (beta - alpha) / (2 * gamma);
        const t = (zeta < 0 ? -1 : 1) / (Math.abs(zeta) + Math.sqrt(1 + zeta * zeta));
        const cos = 1 / Math.sqrt(1 + t * t);
        turnColumns(w, i, j, cos, cos * t);
        turnColumns(v, i, j, cos, cos * t);
      }
    }
    if (done) break;
  }
  for (let k = 0; k < 3; k++) s[k] = Math.sqrt(w[k] * w[k] + w[k + 3] * w[k + 3] + w[k + 6] * w[k + 6]);
  if (s[0] < s[1]) swapColumns(0, 1);
  if (s[1] < s[2]) swapColumns(1, 2);
  if (s[0] < s[1]) swapColumns(0, 1);
}

function turnColumns(a: Float64Array, i: number, j: number, cos: number, sin: number): void {
  for (let row = 0; row < 9; row += 3) {
    const x = a[row + i];
    const y = a[row + j];
    a[row + i] = cos * x - sin * y;
    a[row + j] = sin * x + cos * y;
  }
}

function swapColumns(i: number, j: number): void {
  for (let row = 0; row < 9; row += 3) {
    const x = w[row + i];
    w[row + i] = w[row + j];
    w[row + j] = x;
    const y = v[row + i];
    v[row + i] = v[row + j];
    v[row + j] = y;
  }
  const z = s[i];
  s[i] = s[j];
  s[j] = z;
}

const determinant = (a: Float64Array): number =>
  a[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * a[7] - a[4] * a[6]);

/** Sets column 2 to the cross product of columns 0 and 1. */
function completeColumns(a: Float64Array): void {
  a[2] = a[3] * a[7] - a[6] * a[4];
  a[5] = a[6] * a[1] - a[0] * a[7];
  a[8] = a[0] * a[4] - a[3] * a[1];
}

/** Sets `delta` and `turn` to the symmetric factor and the rotation of m'. Singular values up to `rounding` are treated as zero. */
function polar(rounding: number): void {
  singularValues();
  const rank = s[2] > rounding ? 3 : s[1] > rounding ? 2 : s[0] > rounding ? 1 : 0;
  delta.fill(0);
  turn.fill(0);
  if (rank === 0) {
    turn[0] = turn[4] = turn[8] = 1;
    return;
  }
  for (let k = 0; k < rank; k++) for (let row = 0; row < 9; row += 3) w[row + k] /= s[k];
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) {
      for (let k = 0; k < rank; k++) delta[3 * i + j] += s[k] * w[3 * i + k] * w[3 * j + k];
    }
  }
  if (rank === 1) {
    for (let i = 0; i < 3; i++) {
      from[i] = v[3 * i];
      to[i] = w[3 * i];
    }
    smallestRotation(from, to);
    return;
  }
  if (rank === 2) {
    completeColumns(w);
    completeColumns(v);
  }
  const sign = rank === 3 && determinant(w) * determinant(v) < 0 ? -1 : 1;
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) {
      for (let k = 0; k < 3; k++) turn[3 * i + j] += sign * w[3 * i + k] * v[3 * j + k];
    }
  }
  if (sign < 0) for (let k = 0; k < 9; k++) delta[k] = -delta[k];
}

/** Sets `turn` to the smallest rotation from one direction to another, or to the identity if one of them is zero. */
function smallestRotation(a: Float64Array, b: Float64Array): void {
  turn.fill(0);
  turn[0] = turn[4] = turn[8] = 1;
  const lengths = Math.hypot(a[0], a[1], a[2]) * Math.hypot(b[0], b[1], b[2]);
  if (!(lengths > 0)) return;
  const cos = (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) / lengths;
  if (cos < -1 + 1e-12) {
    halfTurn(a);
    return;
  }
  const x = (a[1] * b[2] - a[2] * b[1]) / lengths;
  const y = (a[2] * b[0] - a[0] * b[2]) / lengths;
  const z = (a[0] * b[1] - a[1] * b[0]) / lengths;
  const f = 1 / (1 + cos);
  turn[0] = 1 - f * (y * y + z * z);
  turn[1] = f * x * y - z;
  turn[2] = f * x * z + y;
  turn[3] = f * x * y + z;
  turn[4] = 1 - f * (x * x + z * z);
  turn[5] = f * y * z - x;
  turn[6] = f * x * z - y;
  turn[7] = f * y * z + x;
  turn[8] = 1 - f * (x * x + y * y);
}

/** Sets `turn` to the rotation by 180° about the projection of the x axis (or the y axis) onto the plane perpendicular to a direction. */
function halfTurn(direction: Float64Array): void {
  const n = Math.hypot(...direction);
  const a = [...direction].map((component) => component / n);
  const across = (k: number) => a.map((component, i) => (i === k ? 1 : 0) - component * a[k]);
  let axis = across(0);
  if (Math.hypot(...axis) < 1e-3) axis = across(1);
  const length = Math.hypot(...axis);
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) turn[3 * i + j] = (2 * axis[i] * axis[j]) / (length * length) - (i === j ? 1 : 0);
  }
}
