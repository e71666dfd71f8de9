//! The syntax of a scene file (TOML). Unknown keys are errors; every value that can be wrong in meaning is [`Located`].

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

/// A whole scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Sunstone scene")]
pub struct SceneFile {
    /// Short name; absent: the folder's (or the file's) name.
    pub name: Option<String>,
    /// Vacuum wavelengths in nanometres, 1 to 4, rising.
    #[serde(
        default = "defaults::wavelengths",
        skip_serializing_if = "defaults::is_wavelengths"
    )]
    pub wavelengths_nm: Located<Vec<f64>>,
    /// How to render.
    #[serde(default, skip_serializing_if = "is_default")]
    pub render: RenderFile,
    /// The camera.
    pub camera: Located<PinholeFile>,
    /// The projector.
    pub projector: Option<Located<ProjectorFile>>,
    /// Further emitters, for tests and cross-checks.
    #[serde(default, skip_serializing_if = "is_default")]
    pub emitters: Vec<Located<EmitterFile>>,
    /// Materials by name.
    #[serde(default, skip_serializing_if = "is_default")]
    pub materials: BTreeMap<String, Located<MaterialFile>>,
    /// Participating media by name.
    #[serde(default, skip_serializing_if = "is_default")]
    pub media: BTreeMap<String, Located<MediumFile>>,
    /// What there is to see.
    #[serde(default, skip_serializing_if = "is_default")]
    pub objects: Vec<Located<ObjectFile>>,
    /// Groups of objects by name, which are in memory once however many copies there are.
    #[serde(default, skip_serializing_if = "is_default")]
    pub groups: BTreeMap<String, Located<GroupFile>>,
    /// Copies of groups.
    #[serde(default, skip_serializing_if = "is_default")]
    pub instances: Vec<Located<InstanceFile>>,
    /// What to keep of T(s, s', p, p', t).
    #[serde(default, skip_serializing_if = "is_default")]
    pub slices: Vec<Located<SliceFile>>,
    /// Pictures drawn at the end of a render: their syntax is that of `figure::spec::Figure`, which reads them.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(with = "Vec<BTreeMap<String, String>>")]
    pub figures: Vec<toml::Table>,
    /// Parameters by name, of which the scene's variants have other values: [`crate::variant`].
    #[serde(default, skip_serializing_if = "is_default")]
    pub vary: BTreeMap<String, Located<ParameterFile>>,
}

/// How to render.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RenderFile {
    /// Samples per camera pixel.
    #[serde(skip_serializing_if = "defaults::is_spp")]
    #[schemars(range(min = 1, max = 1_073_741_824))]
    pub spp: Located<u32>,
    /// Least number of groups of these that are independent, and that standard errors are estimated from; inside of a group they
    /// are stratified, so that the fewer groups, the less noise.
    #[serde(skip_serializing_if = "defaults::is_replicates")]
    #[schemars(range(min = 1, max = 1_073_741_824))]
    pub replicates: Located<u32>,
    /// Longest path as Mitsuba counts it: 2 is direct light alone, n allows n - 1 surface interactions.
    #[serde(skip_serializing_if = "defaults::is_max_depth")]
    #[schemars(range(min = 1, max = 1024))]
    pub max_depth: Located<u32>,
    /// Surface interactions before Russian roulette sets in.
    #[serde(skip_serializing_if = "defaults::is_rr_depth")]
    pub rr_depth: u32,
    /// Which paths are traced; absent: what the scene needs.
    #[serde(skip_serializing_if = "is_default")]
    pub integrator: Integrator,
    /// Look for emitters through smooth interfaces that bend light, such as glass and water; absent: unless `integrator` is
    /// `path`.
    pub manifold: Option<bool>,
    /// What becomes of scenes in which surfaces touch, or are nearer together than single precision tells.
    #[serde(skip_serializing_if = "is_default")]
    pub gaps: GapsFile,
    /// Key of the random streams.
    #[serde(skip_serializing_if = "is_default")]
    pub seed: u64,
    /// Edge of a tile in camera pixels.
    #[serde(skip_serializing_if = "defaults::is_tile")]
    #[schemars(range(min = 1, max = 512))]
    pub tile: Located<u32>,
}

/// What becomes of scenes in which light is lost in gaps, where no surface can be moved to close or open them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GapsFile {
    /// They are refused.
    #[default]
    Refuse,
    /// They are rendered without the light that is lost, and a note names the gap.
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
    /// A scene with this camera and nothing else in it; every key that a file may leave out has its default.
    #[must_use]
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

    /// The text of the scene file that says this, without keys that have their defaults.
    ///
    /// # Errors
    /// If a whole number is larger than TOML can hold (2^63 - 1).
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}
