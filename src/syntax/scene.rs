//! The syntax of a scene file (TOML). Unknown keys are errors. Values that need further checks are
//! [`Located`], so that errors have a location.

use super::defaults::{self, is_default};
use super::device::{EmitterFile, PinholeFile, ProjectorFile};
use super::instance::{GroupFile, InstanceFile};
use super::material::MaterialFile;
use super::medium::MediumFile;
use super::shape::ObjectFile;
use super::slice::SliceFile;
use super::vary::ParameterFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use transport::scene::Integrator;

/// A scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Sunstone scene")]
pub struct SceneFile {
    /// Short name of the scene. Default: the name of the folder or the file.
    pub name: Option<String>,
    /// One to four vacuum wavelengths in nanometres, increasing. Default: 450, 550, 660.
    #[serde(default = "defaults::wavelengths", skip_serializing_if = "defaults::is_wavelengths")]
    pub wavelengths_nm: Located<Vec<f64>>,
    /// Render settings.
    #[serde(default, skip_serializing_if = "is_default")]
    pub render: RenderFile,
    /// The camera.
    pub camera: Located<PinholeFile>,
    /// The projector.
    pub projector: Option<Located<ProjectorFile>>,
    /// Additional emitters.
    #[serde(default, skip_serializing_if = "is_default")]
    pub emitters: Vec<Located<EmitterFile>>,
    /// Materials by name.
    #[serde(default, skip_serializing_if = "is_default")]
    pub materials: BTreeMap<String, Located<MaterialFile>>,
    /// Participating media by name.
    #[serde(default, skip_serializing_if = "is_default")]
    pub media: BTreeMap<String, Located<MediumFile>>,
    /// Objects of the scene.
    #[serde(default, skip_serializing_if = "is_default")]
    pub objects: Vec<Located<ObjectFile>>,
    /// Groups of objects by name. A group is stored in memory once for any number of instances.
    #[serde(default, skip_serializing_if = "is_default")]
    pub groups: BTreeMap<String, Located<GroupFile>>,
    /// Instances of groups.
    #[serde(default, skip_serializing_if = "is_default")]
    pub instances: Vec<Located<InstanceFile>>,
    /// Slices of T(s, s', p, p', t) to keep.
    #[serde(default, skip_serializing_if = "is_default")]
    pub slices: Vec<Located<SliceFile>>,
    /// Figures drawn after a render. docs/figures.md describes their keys, which `figure::spec::Figure`
    /// parses.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(with = "Vec<BTreeMap<String, String>>")]
    pub figures: Vec<toml::Table>,
    /// Parameters, by name, whose values differ between the scene's variants.
    #[serde(default, skip_serializing_if = "is_default")]
    pub vary: BTreeMap<String, Located<ParameterFile>>,
}

/// Render settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RenderFile {
    /// Samples per camera pixel. Default: 64.
    #[serde(skip_serializing_if = "defaults::is_spp")]
    #[schemars(range(min = 1, max = 1_073_741_824))]
    pub spp: Located<u32>,
    /// Minimum number of independent groups of samples, from which standard errors are estimated. Samples are
    /// stratified within a group, so fewer groups give less noise. Default: 32.
    #[serde(skip_serializing_if = "defaults::is_replicates")]
    #[schemars(range(min = 1, max = 1_073_741_824))]
    pub replicates: Located<u32>,
    /// Maximum path length in Mitsuba's convention: n allows n - 1 surface interactions, so 2 gives only
    /// direct light. Default: 6.
    #[serde(skip_serializing_if = "defaults::is_max_depth")]
    #[schemars(range(min = 1, max = 1024))]
    pub max_depth: Located<u32>,
    /// Number of surface interactions before Russian roulette starts. Default: 5.
    #[serde(skip_serializing_if = "defaults::is_rr_depth")]
    pub rr_depth: u32,
    /// Integrator: the kind of paths to trace. Default: `auto`, which selects an integrator for the scene.
    #[serde(skip_serializing_if = "is_default")]
    pub integrator: Integrator,
    /// True to connect paths to emitters through smooth refractive interfaces such as glass and water.
    /// Default: true unless `integrator` is `path`.
    pub manifold: Option<bool>,
    /// Treatment of surfaces that touch or are too close for single precision. Default: `refuse`.
    #[serde(skip_serializing_if = "is_default")]
    pub gaps: GapsFile,
    /// Seed of the random streams. Default: 0.
    #[serde(skip_serializing_if = "is_default")]
    pub seed: u64,
    /// Edge length of a tile in camera pixels. Default: 32.
    #[serde(skip_serializing_if = "defaults::is_tile")]
    #[schemars(range(min = 1, max = 512))]
    pub tile: Located<u32>,
}

/// Treatment of scenes that lose light in a gap between surfaces, if no surface can be moved to close or
/// widen this gap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GapsFile {
    /// Refuse the scene with an error that names the gap.
    #[default]
    Refuse,
    /// Render the scene without the lost light, and add a note that names the gap.
    Warn,
}

impl Default for RenderFile {
    fn default() -> Self {
        Self {
            spp: defaults::spp(),
            replicates: defaults::replicates(),
            max_depth: defaults::max_depth(),
            rr_depth: defaults::rr_depth(),
            integrator: Integrator::Auto,
            manifold: None,
            gaps: GapsFile::Refuse,
            seed: 0,
            tile: defaults::tile(),
        }
    }
}

impl SceneFile {
    /// Creates a scene that contains only a camera. Optional keys have their defaults.
    pub fn new(camera: PinholeFile) -> Self {
        Self {
            name: None,
            wavelengths_nm: defaults::wavelengths(),
            render: RenderFile::default(),
            camera: Located::nowhere(camera),
            projector: None,
            emitters: vec![],
            materials: BTreeMap::new(),
            media: BTreeMap::new(),
            objects: vec![],
            groups: BTreeMap::new(),
            instances: vec![],
            slices: vec![],
            figures: vec![],
            vary: BTreeMap::new(),
        }
    }

    /// Returns the text of the scene file. Keys with default values are omitted.
    ///
    /// # Errors
    /// Returns [`toml::ser::Error`] if an integer is larger than TOML allows (2^63 - 1).
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}
