//! Reads the Mueller matrices that commands use. The source is an array or a slice of a store.

use crate::{Failure, bail, source};
use std::path::PathBuf;
use sunstone::matrices::{Matrices, MatricesError};
use sunstone::polarimetry::capture::mueller_image::{ImageError, MuellerImage};
use sunstone::store::denoised;
use sunstone::store::place::is_address;
use sunstone::store::probe::Selection;

/// The source of Mueller matrices.
#[derive(clap::Args)]
pub struct MatrixSource {
    /// Array (.npy) of shape (..., 4, 4), or a store written by `render` or `merge`.
    #[arg(value_name = "M.npy|STORE")]
    pub source: PathBuf,
    /// Slice of the store.
    slice: Option<String>,
    /// Keep part of the slice's axis: AXIS=VALUE (nearest entry) or AXIS=FROM:TO, in the axis' unit.
    /// Repeatable.
    #[arg(short = 'k', long = "select", requires = "slice")]
    select: Vec<Selection>,
    /// Also read an unfinished render: values that are not rendered yet are NaN.
    #[arg(long, requires = "slice")]
    partial: bool,
}

impl MatrixSource {
    /// Reads all matrices. Error messages contain an example of `command` that ends with `rest`.
    pub fn read(&self, command: &str, rest: &str) -> Result<Matrices, Failure> {
        if let Some(slice) = &self.slice {
            return self.stored(command, slice);
        }
        if self.source.is_dir() || is_address(&self.source) {
            bail!(
                "{} is a store; name the slice, for example: sunstone {command} {0} polarimetric {rest}",
                self.source.display()
            );
        }
        Matrices::of_array(&self.source).map_err(Failure::input)
    }

    fn stored(&self, command: &str, slice: &str) -> Result<Matrices, Failure> {
        let (store, stored) = source::slice(&self.source, slice, self.partial)?;
        // These commands use the matrices as ground truth, so denoised matrices are refused.
        if ["capture", "trial"].contains(&command) {
            denoised::refuse(&store).map_err(Failure::input)?;
        }
        Matrices::of_slice(&stored, &self.select).map_err(|e| match e {
            MatricesError::NotMueller => {
                Failure::input(format!("slice {slice} of {} {e}", self.source.display()))
            }
            other => Failure::input(other),
        })
    }
}

/// Converts matrices to the input of captures. `wavelengths` contains the wavelengths, in nanometres, of an
/// array's last axis.
pub fn image(matrices: Matrices, wavelengths: &[f64]) -> Result<MuellerImage, Failure> {
    if matrices.facts.is_some() && !wavelengths.is_empty() {
        bail!(
            "--wavelengths: the slice already has wavelengths; remove the option, or select a wavelength with -k wavelength=550"
        );
    }
    matrices.image(wavelengths).map_err(|e| match e {
        ImageError::Wavelength(_) | ImageError::Wavelengths { .. } => {
            Failure::input(format!("--wavelengths: {e}"))
        }
        other => Failure::input(other),
    })
}
