//! Builds scenes in code, with the same values and the same build steps as for scene files.

use crate::build::assemble;
use crate::build::context::Context;
use base::document::in_code;
use base::locate::InputError;
use import::write_ply;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use syntax::Syntax;
use syntax::device::{EmitterFile, PinholeFile, ProjectorFile};
use syntax::instance::{GroupFile, InstanceFile};
use syntax::material::MaterialFile;
use syntax::medium::MediumFile;
use syntax::scene::{RenderFile, SceneFile};
use syntax::shape::{ObjectFile, ShapeFile};
use syntax::slice::SliceFile;
use transport::geometry::mesh::Mesh;
use transport::scene::{Integrator, Scene};

/// Prefix of error locations, in place of a file name.
const IN_CODE: &str = "scene in code";

/// Builds a [`Scene`] in code.
///
/// Each call sets a value of a [`SceneFile`], and [`Self::build`] builds it as if it were read from a file.
/// Checks, defaults and the built scene are therefore the same as for a file.
///
/// ```
/// use sunstone_scene::{Camera, Material, Object, Projector, SceneBuilder, Slice};
///
/// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).fov_x_deg(40.0).resolution(128, 96);
/// let light = Camera::look_at([1.0, 1.0, 4.0], [0.0; 3]).fov_x_deg(45.0).resolution(64, 64);
/// let scene = SceneBuilder::new()
///     .camera(camera)
///     .projector(Projector::new(light).irradiance(2.0))
///     .material("gold", Material::rough_metal("Au", 0.2))
///     .object(Object::sphere([0.0; 3], 1.0).material("gold"))
///     .slice(Slice::new("all").mueller().time(0.0, 100.0, 400))
///     .spp(16)
///     .build()?;
/// assert_eq!(scene.geometry.counts().1, 1);
///
/// let error = SceneBuilder::from(scene_without_its_material()).build().err().expect("refused");
/// assert_eq!(
///     error.to_string().lines().next(),
///     Some("scene in code: objects[0].material: unknown material `silver`")
/// );
/// # fn scene_without_its_material() -> sunstone_scene::syntax::scene::SceneFile {
/// #     use sunstone_scene::{Emitter, syntax::scene::SceneFile};
/// #     let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).fov_x_deg(40.0).resolution(4, 4);
/// #     let mut file = SceneFile::new(camera);
/// #     file.emitters.push(Emitter::environment(1.0).into());
/// #     file.objects.push(Object::sphere([0.0; 3], 1.0).material("silver").into());
/// #     file
/// # }
/// # Ok::<(), base::locate::InputError>(())
/// ```
#[derive(Clone, Debug)]
pub struct SceneBuilder {
    file: SceneFile,
    has_camera: bool,
    /// Files that exist in memory only, by the names that the scene uses.
    memory: BTreeMap<String, Vec<u8>>,
    folder: PathBuf,
    /// The first error of the builder calls. [`Self::build`] returns this error.
    fault: Option<InputError>,
}

impl Default for SceneBuilder {
    fn default() -> Self {
        Self::new()
    }
}

impl From<SceneFile> for SceneBuilder {
    /// Creates a builder from the contents of a scene file.
    fn from(file: SceneFile) -> Self {
        Self { file, has_camera: true, memory: BTreeMap::new(), folder: PathBuf::new(), fault: None }
    }
}

impl SceneBuilder {
    /// Creates an empty scene, which needs at least a camera and a light.
    pub fn new() -> Self {
        Self { has_camera: false, ..Self::from(SceneFile::new(PinholeFile::look_at([0.0; 3], [0.0; 3]))) }
    }

    /// Sets the short name of the scene, used in titles.
    pub fn name(mut self, name: impl Into<String>) -> Self {
        self.file.name = Some(name.into());
        self
    }

    /// Sets one to four vacuum wavelengths in nanometres, in increasing order.
    pub fn wavelengths_nm(mut self, nm: impl Into<Vec<f64>>) -> Self {
        self.file.wavelengths_nm = nm.into().into();
        self
    }

    pub fn camera(mut self, camera: PinholeFile) -> Self {
        self.file.camera = camera.into();
        self.has_camera = true;
        self
    }

    /// Sets the projector. If a camera is passed, the projector has an irradiance of 1 W/(m² nm) at 1 m on
    /// its axis.
    pub fn projector(mut self, projector: impl Into<ProjectorFile>) -> Self {
        self.file.projector = Some(projector.into().into());
        self
    }

    pub fn emitter(mut self, emitter: EmitterFile) -> Self {
        self.file.emitters.push(emitter.into());
        self
    }

    /// Adds a material under a unique name.
    pub fn material(mut self, name: impl Into<String>, material: MaterialFile) -> Self {
        let name = name.into();
        if self.file.materials.insert(name.clone(), material.into()).is_some() {
            self.twice(format!("materials.{name}"));
        }
        self
    }

    /// Adds a medium under a unique name.
    pub fn medium(mut self, name: impl Into<String>, medium: MediumFile) -> Self {
        let name = name.into();
        if self.file.media.insert(name.clone(), medium.into()).is_some() {
            self.twice(format!("media.{name}"));
        }
        self
    }

    /// Adds a mesh with coordinates in metres under a unique name. [`ObjectFile::mesh`] accepts the name as a
    /// file name.
    pub fn mesh(mut self, name: impl Into<String>, mesh: &Mesh) -> Self {
        let name = name.into();
        let place = format!("mesh(\"{name}\")");
        if let Err(e) = mesh.validate() {
            self.refuse(fault(&place, format!("invalid mesh: {e}"), "correct the mesh"));
            return self;
        }
        if !matches!(ShapeFile::mesh(name.as_str()), ShapeFile::Ply(_)) {
            self.refuse(fault(
                &place,
                format!("the name `{name}` of a mesh in memory has the extension of a file format"),
                "use a name without the extension .obj, .gltf or .glb",
            ));
            return self;
        }
        self.file_in_memory(name, write_ply::write(mesh))
    }

    /// Adds a file, such as an image or a mesh, that exists in memory only. Materials, objects and slices
    /// refer to the file by `name`. Tables of measured materials must be on disk.
    pub fn file_in_memory(mut self, name: impl Into<String>, bytes: Vec<u8>) -> Self {
        let name = name.into();
        if self.memory.insert(name.clone(), bytes).is_some() {
            self.twice(format!("file_in_memory(\"{name}\")"));
        }
        self
    }

    /// Returns the files that exist in memory only, by name.
    pub fn files_in_memory(&self) -> &BTreeMap<String, Vec<u8>> {
        &self.memory
    }

    /// Sets the folder to which relative paths refer. The default is the current folder.
    pub fn folder(mut self, folder: impl Into<PathBuf>) -> Self {
        self.folder = folder.into();
        self
    }

    pub fn object(mut self, object: ObjectFile) -> Self {
        self.file.objects.push(object.into());
        self
    }

    /// Adds a group of objects under a unique name. The group is visible only through its instances.
    pub fn group(mut self, name: impl Into<String>, group: GroupFile) -> Self {
        let name = name.into();
        if self.file.groups.insert(name.clone(), group.into()).is_some() {
            self.twice(format!("groups.{name}"));
        }
        self
    }

    /// Adds one or more copies of a group.
    pub fn instance(mut self, instance: InstanceFile) -> Self {
        self.file.instances.push(instance.into());
        self
    }

    pub fn slice(mut self, slice: SliceFile) -> Self {
        self.file.slices.push(slice.into());
        self
    }

    /// Replaces all settings in the table `[render]` of the scene.
    pub fn render(mut self, render: RenderFile) -> Self {
        self.file.render = render;
        self
    }

    pub fn spp(mut self, spp: u32) -> Self {
        self.file.render.spp = spp.into();
        self
    }

    /// Sets the maximum path length in segments. A length of n allows n - 1 surface interactions, so a length
    /// of 2 renders only direct light.
    pub fn max_depth(mut self, max_depth: u32) -> Self {
        self.file.render.max_depth = max_depth.into();
        self
    }

    pub fn integrator(mut self, integrator: Integrator) -> Self {
        self.file.render.integrator = integrator;
        self
    }

    pub fn seed(mut self, seed: u64) -> Self {
        self.file.render.seed = seed;
        self
    }

    /// Sets the edge length of a tile in camera pixels.
    pub fn tile(mut self, tile: u32) -> Self {
        self.file.render.tile = tile.into();
        self
    }

    /// Builds the scene from all values that were set.
    ///
    /// # Errors
    /// Returns [`InputError`] as for a scene file. The field `file` of the error contains the argument
    /// instead of line and column, such as `scene in code: objects[0].material`.
    pub fn build(self) -> Result<Scene, InputError> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        if !self.has_camera {
            return Err(fault(
                "camera",
                "the scene has no camera".into(),
                "add a camera: .camera(Camera::look_at(origin, target).fov_x_deg(40.0).resolution(640, 480))",
            ));
        }
        let text = self.file.to_toml().map_err(|e| {
            fault("render", format!("cannot serialize the scene: {e}"), "keep seeds below 2^63")
        })?;
        // Serialize and parse the value, so that every part has a location that an error can name.
        let path = Path::new(IN_CODE);
        let built = SceneFile::read(path, &text).and_then(|file| {
            let mut ctx = Context::new(path, &text, &file.wavelengths_nm)?
                .in_folder(&self.folder)
                .with_files(self.memory);
            assemble::build(&mut ctx, &file)
        });
        built.map_err(|e| in_code(IN_CODE, e))
    }

    fn refuse(&mut self, fault: InputError) {
        self.fault.get_or_insert(fault);
    }

    fn twice(&mut self, place: String) {
        self.refuse(fault(&place, "duplicate name".into(), "use unique names"));
    }
}

/// Returns an error located at an argument of the builder.
fn fault(place: &str, message: String, fix: &str) -> InputError {
    InputError::new(format!("{IN_CODE}: {place}"), "", None, message, fix)
}

#[cfg(test)]
mod tests;
