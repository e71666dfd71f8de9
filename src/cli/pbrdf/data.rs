//! Reads the materials for commands that learn from data. The source is a folder of measured tables, or the
//! built-in substitutes.

use crate::Failure;
use std::path::PathBuf;
use std::str::FromStr;
use sunstone::pbrdf::data_set;
use sunstone::pbrdf::stand_ins::{BandedError, BandedMaterials};
use sunstone::polarimetry::reconstruct::cross_validation::Frames;
use sunstone::polarimetry::reconstruct::pca::data_set::{DataSet, Settings};
use sunstone::transport::material::measured::axes::Axes;

/// The source of materials.
#[derive(clap::Args)]
pub struct MaterialSource {
    /// Folder of .pbsdf tables [default: the stand-ins for the materials of the KAIST set].
    #[arg(long = "data", value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Bands, nanometres; for tables, the nearest bands of each.
    #[arg(long, value_delimiter = ',', default_values_t = [450, 550, 650], value_parser = clap::value_parser!(u16).range(100..))]
    bands: Vec<u16>,
    /// Frames of the expected matrices.
    #[arg(long, value_enum, default_value_t)]
    frames: FramesArgument,
    /// Number of entries of phi_d, theta_d and theta_h at which the stand-ins are evaluated.
    #[arg(long, value_name = "PHI_DxTHETA_DxTHETA_H", default_value = "41x31x91", conflicts_with = "folder")]
    resolution: Resolution,
}

impl MaterialSource {
    /// Reads the tables, or evaluates the stand-ins, and keeps `samples` matrices of each material.
    pub fn load(&self, samples: usize) -> Result<DataSet, Failure> {
        self.load_mapped(Settings::default().c, samples)
    }

    /// Loads data as [`MaterialSource::load`] does, but maps the matrices by arctan(c M).
    pub fn load_mapped(&self, c: f64, samples: usize) -> Result<DataSet, Failure> {
        let settings = Settings { c, samples };
        if let Some(folder) = &self.folder {
            let bands: Vec<f64> = self.bands.iter().copied().map(f64::from).collect();
            data_set::read(folder, &bands, &settings)
        } else {
            let banded = BandedMaterials::load(None, &self.bands).map_err(banded_failure)?;
            let axes = Axes::even(self.resolution.0, self.bands.clone());
            data_set::evaluate(&axes, &banded.analytic(), &settings)
        }
        .map_err(Failure::input)
    }

    /// Returns the folder of tables, if one is given.
    pub fn folder(&self) -> Option<&PathBuf> {
        self.folder.as_ref()
    }

    pub fn frames(&self) -> Frames {
        match self.frames {
            FramesArgument::Any => Frames::Any,
            FramesArgument::Plane => Frames::Plane,
        }
    }

    /// Returns the bands, in nanometres.
    pub fn bands(&self) -> &[u16] {
        &self.bands
    }

    /// Returns a name of the source for messages.
    pub fn name(&self) -> String {
        self.folder.as_ref().map_or_else(|| "stand-ins".to_owned(), |folder| folder.display().to_string())
    }
}

/// Converts an error in the materials to a failure of the command.
pub fn banded_failure(e: BandedError) -> Failure {
    match e {
        BandedError::File(e) => e.into(),
        other => Failure::input(other),
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum FramesArgument {
    /// Rotated by any angle, like the frames of a camera and a projector relative to the plane of scattering.
    #[default]
    Any,
    /// Those of the plane of scattering, as in tables and in Baek & Heide's learning.
    Plane,
}

/// Number of entries of a table along phi_d, theta_d and theta_h.
#[derive(Clone, Copy, Debug)]
pub struct Resolution(pub [usize; 3]);

impl FromStr for Resolution {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Option<Vec<usize>> = text.split('x').map(|n| n.trim().parse().ok()).collect();
        match parts.as_deref() {
            Some(&[a, b, c]) if [a, b, c].iter().all(|n| (2..=4096).contains(n)) => Ok(Self([a, b, c])),
            _ => Err("expected three numbers from 2 to 4096, such as 361x91x91".into()),
        }
    }
}
