//! Materials that other commands learn from: a folder of tables, or the stand-ins.

use super::stand_ins::{Resolution, Sets};
use crate::cli::failure::Failure;
use std::path::PathBuf;
use sunstone::pbrdf::data_set::{self, Analytic};
use sunstone::polarimetry::reconstruct::loss::{Moment, in_any_frames};
use sunstone::polarimetry::reconstruct::pca::data_set::{DataSet, Settings};
use sunstone::polarimetry::reconstruct::pca::moments::Moments;
use sunstone::transport::material::measured::axes::Axes;

/// Where materials come from.
#[derive(clap::Args)]
pub struct Source {
    /// Folder of .pbsdf tables; without it, the stand-ins for the materials of the KAIST set.
    #[arg(long = "data", value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Bands, nanometres; of tables the nearest they have.
    #[arg(long, value_delimiter = ',', default_values_t = [450, 550, 650])]
    bands: Vec<u16>,
    /// Frames between which matrices are expected.
    #[arg(long, value_enum, default_value_t)]
    frames: Frames,
    /// Entries of phi_d, theta_d and theta_h at which the stand-ins are evaluated.
    #[arg(
        long,
        value_name = "PHI_DxTHETA_DxTHETA_H",
        default_value = "41x31x91",
        conflicts_with = "folder"
    )]
    resolution: Resolution,
}

impl Source {
    /// Reads tables, or evaluates the stand-ins; keeps `samples` matrices of each.
    pub fn load(&self, samples: usize) -> Result<DataSet, Failure> {
        self.load_mapped(Settings::default().c, samples)
    }

    /// As [`Source::load`], with the c of arctan(c M).
    pub fn load_mapped(&self, c: f64, samples: usize) -> Result<DataSet, Failure> {
        let settings = Settings { c, samples };
        match &self.folder {
            Some(folder) => {
                let bands: Vec<f64> = self.bands.iter().copied().map(f64::from).collect();
                data_set::read(folder, &bands, &settings)
            }
            None => {
                let sets = Sets::load(None, &self.bands)?;
                let material = |name: &String| -> Analytic { (name.clone(), sets.sources(name)) };
                let materials: Vec<Analytic> = sets.stand_ins().iter().map(material).collect();
                let axes = Axes::even(self.resolution.0, self.bands.clone());
                data_set::evaluate(&axes, &materials, &settings)
            }
        }
        .map_err(Failure::input)
    }

    /// E[t tᵀ] of matrices, in the frames asked for.
    pub fn moment(&self, moments: &Moments) -> Moment {
        let s = moments.second();
        let s = Moment::from_fn(|i, j| s[i][j]);
        match self.frames {
            Frames::Any => in_any_frames(&s),
            Frames::Plane => s,
        }
    }

    /// The bands asked for, nanometres.
    pub fn bands(&self) -> &[u16] {
        &self.bands
    }

    /// What it is, for people.
    pub fn name(&self) -> String {
        self.folder
            .as_ref()
            .map_or_else(|| "stand-ins".to_owned(), |folder| folder.display().to_string())
    }
}

/// Frames of matrices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum Frames {
    /// Turned by any angle, as those of a camera and a projector are to the plane of scattering.
    #[default]
    Any,
    /// Of the plane of scattering, as in tables and in Baek & Heide's learning.
    Plane,
}
