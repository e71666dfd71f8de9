/**
 * Colours of spectral values, with the rules of `sunstone figure` (src/figure/colour.rs), so that a photograph here equals the
 * photograph that the command draws.
 */

/** Wavelengths in nanometres shown as red, green and blue. */
const PRIMARIES_NM = [660, 550, 450] as const;

const nearest = (values: readonly number[], wanted: number): number =>
  values.reduce((best, value, i) => (Math.abs(value - wanted) < Math.abs(values[best] - wanted) ? i : best), 0);

/**
 * Returns the weight of every wavelength in red, green and blue: `weights[channel][wavelength]`. Each row sums to 1. Three
 * wavelengths are assigned by order, a single wavelength is grey. Otherwise a channel is the mean of the wavelengths for which its
 * primary is the nearest, or the single nearest wavelength.
 */
export function rgbWeights(nm: readonly number[]): [number[], number[], number[]] {
  const n = nm.length;
  const weights: [number[], number[], number[]] = [Array<number>(n).fill(0), Array<number>(n).fill(0), Array<number>(n).fill(0)];
  if (n === 1) {
    weights.forEach((row) => (row[0] = 1));
  } else if (n === 3) {
    const order = [0, 1, 2].sort((a, b) => nm[b] - nm[a]);
    order.forEach((wavelength, channel) => (weights[channel][wavelength] = 1));
  } else if (n > 0) {
    weights.forEach((row, channel) => {
      const mine = nm.map((_, i) => i).filter((i) => nearest(PRIMARIES_NM, nm[i]) === channel);
      if (mine.length === 0) row[nearest(nm, PRIMARIES_NM[channel])] = 1;
      for (const i of mine) row[i] = 1 / mine.length;
    });
  }
  return weights;
}

/** Encodes a linear value, clamped to 0..1, with the sRGB transfer function. */
export function srgb(linear: number): number {
  const v = Math.min(1, Math.max(0, linear));
  return Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
}

/** Entries of [`SRGB`], minus 1. */
export const SRGB_STEPS = 65535;
/** The sRGB encoding of i / SRGB_STEPS. */
export const SRGB: Uint8Array = Uint8Array.from({ length: SRGB_STEPS + 1 }, (_, i) => srgb(i / SRGB_STEPS));

const counts = new Uint32Array(1 << 16);

/** Returns the quantile `q` (0..1) of the finite values, or null if no value is finite. Sorts nothing: two passes of a histogram. */
export function percentile(values: Float32Array, q: number): number | null {
  const bits = new Uint32Array(values.buffer, values.byteOffset, values.length);
  // The keys have the order of the values: the bits of a negative number are inverted.
  const key = (b: number): number => (b & 0x80000000 ? ~b : b | 0x80000000) >>> 0;
  const isFinite = (b: number): boolean => (b & 0x7f800000) !== 0x7f800000;
  let finite = 0;
  counts.fill(0);
  for (let i = 0; i < bits.length; i++) {
    const b = bits[i];
    if (!isFinite(b)) continue;
    counts[key(b) >>> 16]++;
    finite++;
  }
  if (finite === 0) return null;
  let rank = Math.round((finite - 1) * q);
  let high = 0;
  while (rank >= counts[high]) rank -= counts[high++];
  counts.fill(0);
  for (let i = 0; i < bits.length; i++) {
    const b = bits[i];
    if (isFinite(b) && key(b) >>> 16 === high) counts[key(b) & 0xffff]++;
  }
  let low = 0;
  while (rank >= counts[low]) rank -= counts[low++];
  const found = ((high << 16) | low) >>> 0;
  const value = new Float32Array(1);
  new Uint32Array(value.buffer)[0] = (found & 0x80000000 ? found & 0x7fffffff : ~found) >>> 0;
  return value[0];
}

/**
 * Returns the white level of values: the 99th percentile, or the maximum if that percentile is not positive. Returns 1 if no value
 * is positive.
 */
export function white(values: Float32Array, q = 0.99): number {
  const level = percentile(values, q);
  if (level !== null && level > 0) return level;
  const most = percentile(values, 1);
  return most !== null && most > 0 ? most : 1;
}
