//! The surfaces of a scene by the number of the object that they belong to: what a camera's ray meets, for ground truth.

use super::context::Context;
use super::{calibrated, file_materials, shapes};
use base::locate::InputError;
use std::collections::BTreeMap;
use std::path::Path;
use syntax::scene::SceneFile;
use transport::geometry::builder::GeometryBuilder;
use transport::geometry::bvh::Geometry;

/// Surfaces of all objects of a scene file; those of instances are left out.
pub struct ObjectSurfaces {
    /// Surfaces, whose material is the number of their object.
    pub geometry: Geometry,
    /// Names of the objects' materials, by number of the object.
    pub materials: Vec<String>,
}

impl ObjectSurfaces {
    /// Of the value of a scene file, whose places are those in `text`; `path` names it in messages and anchors its files.
    ///
    /// # Errors
    /// [`InputError`] as where the scene is built.
    pub fn new(path: &Path, text: &str, file: &SceneFile) -> Result<Self, InputError> {
        let mut ctx = Context::new(path, text, &file.wavelengths_nm)?;
        let file = file_materials::expand(&mut ctx, file)?;
        let file = calibrated::expand(&ctx, file)?;
        let names: BTreeMap<&str, u32> = file.materials.keys().map(String::as_str).zip(0..).collect();
        let mut builder = GeometryBuilder::default();
        for (number, object) in (0..).zip(&file.objects) {
            for mut placed in shapes::place(&mut ctx, object, &names)? {
                placed.material = number;
                placed.solid(&ctx, object)?.add(number, &mut builder);
            }
        }
        Ok(Self {
            geometry: builder.build(),
            materials: file.objects.iter().map(|o| o.material.to_string()).collect(),
        })
    }
}
