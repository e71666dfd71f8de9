/** Where the page gets its data: from the server of `sunstone view`, or from the files of a static export. */

import type { Description, ImageResult, Labelled, Progress } from "../model";

/** A drive image P(s') of the projector, 0..1, row-major. */
export interface Pattern {
  width: number;
  height: number;
  values: Float32Array;
}

/**
 * A query of a slice, with the steps and the words of the command `sunstone probe`: contraction with the pattern and the Stokes state,
 * convolution with the pulse, selection, sum.
 */
export interface ProbeRequest {
  store: number;
  slice: string;
  /** Words of `--select`: `t=1000:2000`, `stokes_in=s1`, `y=12`. Coordinates are in the unit of the axis. */
  select: string[];
  /** Axes to sum over. */
  sum: string[];
  /** State of `--stokes`: `horizontal` or `1,0.5,0,0`. */
  stokes?: string;
  pattern?: Pattern;
  /** Word of `--pulse`: `gaussian:50`. */
  pulse?: string;
}

/**
 * A probe that keeps camera pixels, answered tile by tile. All axes are summed but y, x, stokes_out, stokes_in, wavelength, and t if
 * `time` is set. The answer has at most `limit` values per field; the server averages blocks of `bin` x `bin` camera pixels for that.
 */
export interface ImageRequest extends ProbeRequest {
  /** Entries of y and x: [y0, y1, x0, x1], the end excluded. Absent: the whole image. */
  region?: [number, number, number, number];
  /** Keep the time axis. */
  time: boolean;
  /**
   * Contract stokes_out with these weights (a row of the analyzer) and stokes_in with `input`. Absent: keep the axis. Other than
   * `stokes`, weights need not be a physical state.
   */
  output?: [number, number, number, number];
  input?: [number, number, number, number];
  /** Return standard errors. */
  errors: boolean;
  /** Maximum number of values in `mean`. */
  limit: number;
}

/** A trial of a capture scheme on a slice's Mueller matrices. */
export interface TrialRequest {
  store: number;
  slice: string;
  /** Name and number of captures, as for `sunstone scheme`: drr, qrpr, quad, liquid-crystal; or the text of a scheme file (TOML). */
  scheme: { name: string; captures: number; array: boolean } | { toml: string };
  /** Text of a detector file (TOML with [cmos] or [spad]), or a standard deviation relative to the mean M00. */
  detector: { toml: string } | { sigma: number };
  wavelength: number;
  seed: number;
  /** The capture whose image is returned. */
  capture: number;
}

export interface TrialResult {
  captures: number;
  rank: number;
  condition: number | null;
  estimator: string;
  predicted: number | null;
  rmse: number;
  normalized: number;
  lost: number;
  height: number;
  width: number;
  /** The noisy image of the requested capture; NaN: saturated. */
  image: Float32Array;
  /** Error of every pixel over the mean M00, in rows of `errorWidth`. A sensor with binning has fewer pixels than the slice. */
  errors: Float32Array;
  errorWidth: number;
  notes: string[];
}

/** One frame of a store of captures. */
export interface FrameResult {
  shape: number[];
  values: Float32Array;
}

export interface Source {
  describe(): Promise<Description>;
  probe(request: ProbeRequest, signal?: AbortSignal): Promise<Labelled>;
  /** Yields an incomplete image soon, and the complete image last. Later results replace earlier ones. */
  image(request: ImageRequest, signal?: AbortSignal): AsyncIterable<ImageResult>;
  /** Progress of a store that is being rendered. Null in a static export. */
  progress(store: number): Promise<Progress | null>;
  frame(store: number, index: number[]): Promise<FrameResult>;
  trial(request: TrialRequest, signal?: AbortSignal): Promise<TrialResult>;
}

/** A message that is shown to the user as it is. */
export class SourceError extends Error {}
