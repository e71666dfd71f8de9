//! Reconstructs images in pieces. Each thread reads, reconstructs and writes separate pieces. Input, output
//! and computation therefore overlap, and the data is in the cache when the thread uses it.

use crate::{Failure, bail};
use rayon::prelude::*;
use std::time::{Duration, Instant};
use sunstone::polarimetry::capture::element::Ray;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::polarimetry::reconstruct::along_rays::{self, Places};
use sunstone::polarimetry::reconstruct::pixels::{Options, PixelNumber, Reconstruction, Tally};
use sunstone::store::numpy::NumpyReader;

/// Number of pixels per piece. The intensities of a piece fit into the L2 cache, and pieces are
/// large enough for efficient reads and writes.
const PIECE: usize = 4096;

/// An image to reconstruct.
pub struct Work<'a, T> {
    pub scheme: &'a Scheme,
    pub options: Options,
    /// Reconstruction for rays along the optical axis, with one estimator for each wavelength.
    pub estimates: Reconstruction<T>,
    /// Rays of all pixel positions and wavelengths, or `None` if all rays are along the optical axis.
    pub rays: Option<&'a [Ray]>,
    /// Number of consecutive pixels with the same ray.
    pub times: usize,
    /// Number of wavelengths.
    pub lanes: usize,
    pub intensities: NumpyReader,
    pub variances: Option<NumpyReader>,
    pub pixels: usize,
}

/// The result of a reconstruction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Done {
    pub tally: Tally,
    /// Computing time, averaged over the threads.
    pub computing: Duration,
}

/// Buffers for the pieces that a thread reconstructs one after another.
struct Buffers<T> {
    intensities: Vec<T>,
    variances: Vec<T>,
    elements: Vec<T>,
    errors: Vec<T>,
}

/// A function that receives three arguments. The first argument is 0 for matrix elements or 1 for standard
/// errors. The other arguments are the index of the first pixel, and the values.
type Write<'a, T> = dyn Fn(usize, usize, &[T]) -> Result<(), Failure> + Sync + 'a;

impl<T: PixelNumber> Work<'_, T> {
    /// Reconstructs all pixels in any order, and passes the results to `write`.
    ///
    /// # Errors
    /// Returns [`Failure`] if an input cannot be read or `write` fails.
    pub fn all(&self, write: &Write<'_, T>, errors: bool) -> Result<Done, Failure> {
        let whole = (self.times * self.lanes).max(1);
        let most = (PIECE / whole).max(1) * whole;
        let pieces = self.pixels.div_ceil(most);
        let one = |buffers: &mut Buffers<T>, k: usize| {
            self.piece(buffers, k * most, most.min(self.pixels - k * most), write)
        };
        let with = |a: Done, b: Done| -> Result<Done, Failure> {
            Ok(Done { tally: a.tally.with(b.tally), computing: a.computing + b.computing })
        };
        let buffers = || self.buffers(most, errors);
        let mut done = (0..pieces).into_par_iter().map_init(buffers, one).try_reduce(Done::default, with)?;
        done.computing /= rayon::current_num_threads() as u32;
        Ok(done)
    }

    fn buffers(&self, pixels: usize, errors: bool) -> Buffers<T> {
        let numbers = |n: usize| vec![T::default(); n];
        let count = self.scheme.measurements() * pixels;
        Buffers {
            intensities: numbers(count),
            variances: numbers(if self.variances.is_some() { count } else { 0 }),
            elements: numbers(16 * pixels),
            errors: numbers(if errors { 16 * pixels } else { 0 }),
        }
    }

    fn piece(
        &self,
        buffers: &mut Buffers<T>,
        first: usize,
        n: usize,
        write: &Write<'_, T>,
    ) -> Result<Done, Failure> {
        let count = self.scheme.measurements();
        let intensities = &mut buffers.intensities[..n * count];
        self.read(&self.intensities, intensities, first, n)?;
        let mut weights = None;
        if let Some(variances) = &self.variances {
            let v = &mut buffers.variances[..n * count];
            self.read(variances, v, first, n)?;
            if let Some(bad) = v.iter().map(|v| v.get()).find(|v| *v < 0.0) {
                bail!("--variance: expected values of 0 or more, got {bad}");
            }
            weights = Some(&*v);
        }
        let begun = Instant::now();
        let elements = &mut buffers.elements[..n * 16];
        let mut errors = (!buffers.errors.is_empty()).then(|| &mut buffers.errors[..n * 16]);
        let wanted = errors.as_deref_mut();
        let tally = if let Some(rays) = self.rays {
            let places = Places {
                rays: &rays[first / self.times..(first + n) / self.times],
                times: self.times,
                lanes: self.lanes,
            };
            along_rays::reconstruct(
                self.scheme,
                places,
                &self.options,
                intensities,
                weights,
                elements,
                wanted,
            )
            .map_err(Failure::input)?
        } else {
            self.estimates.apply(intensities, weights, elements, wanted)
        };
        let computing = begun.elapsed();
        write(0, first, elements)?;
        if let Some(errors) = errors {
            write(1, first, errors)?;
        }
        Ok(Done { tally, computing })
    }

    /// Reads pixels `first..first + n` of all measurements.
    fn read(&self, reader: &NumpyReader, out: &mut [T], first: usize, n: usize) -> Result<(), Failure> {
        for (m, plane) in out.chunks_exact_mut(n).enumerate() {
            reader.read(m * self.pixels + first, plane).map_err(Failure::input)?;
        }
        Ok(())
    }
}
