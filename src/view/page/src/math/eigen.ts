/** Jacobi's eigenvalue method for small symmetric and Hermitian matrices. */

/** Eigenvalues in descending order, and one unit eigenvector for each, as rows. */
export interface Eigen {
  values: Float64Array;
  vectors: Float64Array;
}

/** Maximum number of sweeps. Six are enough for 8 x 8 in double precision. */
const SWEEPS = 30;

/** Returns the eigenvalues and eigenvectors of a real symmetric n x n matrix, given row by row. */
export function symmetricEigen(matrix: ArrayLike<number>, n: number): Eigen {
  const a = Float64Array.from(matrix);
  const v = new Float64Array(n * n);
  for (let i = 0; i < n; i++) v[i * n + i] = 1;
  let scale = 0;
  for (const e of a) scale = Math.max(scale, Math.abs(e));
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    let largest = 0;
    for (let p = 0; p < n; p++) for (let q = p + 1; q < n; q++) largest = Math.max(largest, Math.abs(a[p * n + q]));
    if (!(largest > 1e-17 * scale)) break;
    for (let p = 0; p < n; p++) for (let q = p + 1; q < n; q++) rotate(a, v, n, p, q);
  }
  const order = Array.from({ length: n }, (_, i) => i).sort((i, j) => a[j * n + j] - a[i * n + i]);
  const vectors = new Float64Array(n * n);
  order.forEach((from, to) => vectors.set(v.subarray(from * n, from * n + n), to * n));
  return { values: Float64Array.from(order, (i) => a[i * n + i]), vectors };
}

/** Rotates rows and columns p and q so that a_pq becomes 0. */
function rotate(a: Float64Array, v: Float64Array, n: number, p: number, q: number): void {
  const apq = a[p * n + q];
  if (apq === 0) return;
  const theta = (a[q * n + q] - a[p * n + p]) / (2 * apq);
  const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
  const c = 1 / Math.sqrt(t * t + 1);
  const s = t * c;
  for (let k = 0; k < n; k++) {
    const [kp, kq] = [a[k * n + p], a[k * n + q]];
    a[k * n + p] = c * kp - s * kq;
    a[k * n + q] = s * kp + c * kq;
  }
  for (let k = 0; k < n; k++) {
    const [pk, qk] = [a[p * n + k], a[q * n + k]];
    a[p * n + k] = c * pk - s * qk;
    a[q * n + k] = s * pk + c * qk;
    const [vp, vq] = [v[p * n + k], v[q * n + k]];
    v[p * n + k] = c * vp - s * vq;
    v[q * n + k] = s * vp + c * vq;
  }
}

/**
 * Returns the eigenvalues and complex eigenvectors of a Hermitian n x n matrix, given as real and imaginary parts. A vector has 2n numbers:
 * n real parts, then n imaginary parts.
 *
 * The real symmetric matrix [[Re, -Im], [Im, Re]] has every eigenvalue twice. Both eigenvectors of a pair are the same complex vector up to
 * a phase, so every second one is kept.
 */
export function hermitianEigen(re: ArrayLike<number>, im: ArrayLike<number>, n: number): Eigen {
  const m = 2 * n;
  const real = new Float64Array(m * m);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j < n; j++) {
      real[i * m + j] = re[i * n + j];
      real[(i + n) * m + j + n] = re[i * n + j];
      real[(i + n) * m + j] = im[i * n + j];
      real[i * m + j + n] = -im[i * n + j];
    }
  }
  const all = symmetricEigen(real, m);
  const out: Eigen = { values: new Float64Array(n), vectors: new Float64Array(n * m) };
  for (let k = 0; k < n; k++) {
    out.values[k] = all.values[2 * k];
    out.vectors.set(all.vectors.subarray(2 * k * m, (2 * k + 1) * m), k * m);
  }
  return out;
}
