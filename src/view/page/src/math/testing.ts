/** Optical elements and random matrices for tests. Matrices are 16 numbers, row by row. */

export function product(a: ArrayLike<number>, b: ArrayLike<number>): number[] {
  const out = new Array<number>(16).fill(0);
  for (let i = 0; i < 4; i++) {
    for (let j = 0; j < 4; j++) for (let k = 0; k < 4; k++) out[4 * i + j] += a[4 * i + k] * b[4 * k + j];
  }
  return out;
}

export const diagonal = (d: readonly number[]): number[] =>
  Array.from({ length: 16 }, (_, k) => (k % 5 === 0 ? d[k / 5] : 0));

/** Returns the ideal linear polarizer at an angle in radians. */
export function polarizer(angle: number): number[] {
  const [c, s] = [Math.cos(2 * angle), Math.sin(2 * angle)];
  return [1, c, s, 0, c, c * c, c * s, 0, s, c * s, s * s, 0, 0, 0, 0, 0].map((e) => e / 2);
}

/** Returns the retarder with a unit fast axis on the Poincaré sphere and a retardance in radians. */
export function retarder(axis: readonly number[], retardance: number): number[] {
  // The rotation by -R about the axis (Rodrigues), so that +45° linear light becomes left circular at 90° and axis s1.
  const [c, s] = [Math.cos(retardance), -Math.sin(retardance)];
  const [x, y, z] = axis;
  const cross = [0, -z, y, z, 0, -x, -y, x, 0];
  const out = diagonal([1, 0, 0, 0]);
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) {
      out[4 * i + j + 5] = (i === j ? c : 0) + s * cross[3 * i + j] + (1 - c) * axis[i] * axis[j];
    }
  }
  return out;
}

/** Returns the diattenuator m00 [1 Dᵀ; D m_D]. */
export function diattenuator(m00: number, d: readonly number[]): number[] {
  const c = Math.sqrt(1 - d[0] ** 2 - d[1] ** 2 - d[2] ** 2);
  const out = [1, ...d, ...new Array<number>(12).fill(0)];
  for (let i = 0; i < 3; i++) {
    out[4 * i + 4] = d[i];
    for (let j = 0; j < 3; j++) out[4 * i + j + 5] = (i === j ? c : 0) + (d[i] * d[j]) / (1 + c);
  }
  return out.map((e) => m00 * e);
}

/** Returns the block of a reflection, with m22 = m33 and m23 = -m32. */
export const reflection = (m00: number, m01: number, m22: number, m23: number): number[] =>
  [m00, m01, 0, 0, m01, m00, 0, 0, 0, 0, m22, m23, 0, 0, -m23, m22];

/** Returns a generator of numbers in [0, 1) (mulberry32). */
export function random(seed: number): () => number {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let z = Math.imul(state ^ (state >>> 15), state | 1);
    z ^= z + Math.imul(z ^ (z >>> 7), z | 61);
    return ((z ^ (z >>> 14)) >>> 0) / 4294967296;
  };
}

/** Returns a random unit vector. */
export function direction(uniform: () => number): [number, number, number] {
  const z = 2 * uniform() - 1;
  const angle = 2 * Math.PI * uniform();
  const r = Math.sqrt(1 - z * z);
  return [r * Math.cos(angle), r * Math.sin(angle), z];
}
