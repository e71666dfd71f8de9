//! Converts mesh attributes that materials use to values at triangle corners ([`Textures::corners`]).
//!
//! A mesh has one set of texture coordinates, which index the attribute's values. A material can
//! therefore use only one attribute, and cannot combine the attribute with images.
//!
//! [`Textures::corners`]: transport::material::texture::Textures::corners

use super::context::Context;
use base::locate::{InputError, Located};
use glam::Vec2;
use import::attribute::Corners;
use import::picture;
use std::collections::BTreeMap;
use syntax::texture::AttributeFile;
use transport::geometry::mesh::Mesh;
use transport::material::texture::{MOST_CORNERS, corner_uv};

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Asked {
    pub name: Located<String>,
    /// Whether the attribute must have one number per vertex instead of a colour.
    pub number: bool,
    /// Largest factor by which the attribute is multiplied if it is used as an albedo.
    pub albedo: f64,
}

/// The attribute and the images that a material looks up by texture coordinates.
#[derive(Clone, Debug, Default)]
pub(crate) struct Uses {
    pub asked: Option<Asked>,
    pub images: bool,
    pub heights: bool,
}

/// Uses of attributes and images that are recorded while materials are built.
#[derive(Default)]
pub(crate) struct Attributes {
    /// Uses of the material being built.
    pub open: Uses,
    /// Uses of each finished material.
    pub of_material: BTreeMap<u32, Uses>,
}

impl Attributes {
    pub fn of(&self, material: u32) -> Option<&Asked> {
        self.of_material.get(&material)?.asked.as_ref()
    }

    pub fn has_image(&mut self) {
        self.open.images = true;
    }

    pub fn has_heights(&mut self) {
        self.open.heights = true;
    }

    pub fn heights(&self, material: u32) -> bool {
        self.of_material.get(&material).is_some_and(|uses| uses.heights)
    }

    /// Returns the first attribute that a material uses, or `None` if the materials use no attribute.
    pub fn first(&self) -> Option<&Asked> {
        self.of_material.values().find_map(|uses| uses.asked.as_ref())
    }
}

/// Starts to record the attributes and images that a material uses. Returns the uses of the outer material,
/// which refers to the new material.
pub(super) fn begin(ctx: &mut Context) -> Uses {
    std::mem::take(&mut ctx.attributes.open)
}

/// Ends the record of a material and adds its uses to those of `outer`, the material that refers to it.
pub(super) fn end(ctx: &mut Context, material: u32, outer: Uses) -> Result<(), InputError> {
    let own = std::mem::replace(&mut ctx.attributes.open, outer);
    if let Uses { asked: Some(asked), images: true, .. } = &own {
        let message = "a material uses a mesh attribute together with an image or a checkerboard, but a mesh can have only one \
                       set of texture coordinates";
        return Err(ctx.error(
            asked.name.span(),
            message,
            "remove the mesh attribute, or remove the image or the checkerboard",
        ));
    }
    ctx.attributes.of_material.insert(material, own);
    again(ctx, material)
}

/// Adds the uses of a finished material to the material that refers to it.
pub(super) fn again(ctx: &mut Context, material: u32) -> Result<(), InputError> {
    let Some(Uses { asked, images, heights }) = ctx.attributes.of_material.get(&material).cloned() else {
        return Ok(());
    };
    ctx.attributes.open.images |= images;
    ctx.attributes.open.heights |= heights;
    asked.map_or(Ok(()), |asked| join(ctx, asked))
}

/// Records that the current material uses an attribute, as a number or as an albedo.
pub(super) fn ask(ctx: &mut Context, file: &AttributeFile, number: bool) -> Result<(), InputError> {
    let asked = Asked { name: file.attribute.clone(), number, albedo: if number { 0.0 } else { file.scale } };
    join(ctx, asked)
}

fn join(ctx: &mut Context, more: Asked) -> Result<(), InputError> {
    match &mut ctx.attributes.open.asked {
        Some(open) if *open.name != *more.name => {
            let message = format!(
                "a material uses the mesh attributes `{}` and `{}`, but a mesh can have only one attribute for a material",
                *open.name, *more.name
            );
            return Err(ctx.error(more.name.span(), message, "use only one of the two attributes"));
        }
        Some(open) => {
            open.number |= more.number;
            open.albedo = open.albedo.max(more.albedo);
        }
        open @ None => *open = Some(more),
    }
    Ok(())
}

/// Sets the texture coordinates of a mesh so that they index the values of its attribute. If `mirrored` is
/// true, exchanges the second and third corner of each triangle of the file.
pub(super) fn give(
    ctx: &mut Context,
    asked: &Asked,
    file: &str,
    mesh: Mesh,
    corners: &Corners,
    mirrored: bool,
) -> Result<Mesh, InputError> {
    let fault = |ctx: &Context, what: String, fix: &str| {
        Err(ctx.error(asked.name.span(), format!("the attribute `{}` of {file} {what}", *asked.name), fix))
    };
    if asked.number && corners.coloured {
        let fix = "use an attribute with a single property";
        return fault(ctx, "is a colour, but a number is expected".into(), fix);
    }
    let first = ctx.textures.corners.len();
    if first + corners.values.len() > MOST_CORNERS {
        let what =
            format!("increases the number of triangles with attributes above the limit of {MOST_CORNERS}");
        return fault(ctx, what, "use a coarser mesh, or an image");
    }
    let values = corners.values.as_flattened().as_flattened();
    if let Some(wrong) = values.iter().find(|v| !(0.0..=1e30).contains(*v)) {
        let what = format!("has the value {wrong}");
        return fault(ctx, what, "give values from 0 to 1e30");
    }
    if values.iter().any(|v| f64::from(*v) * asked.albedo > 1.0) {
        ctx.note(format!(
            "{file}: values of `{}` are above 1, so the surface reflects more light than it receives",
            *asked.name
        ));
    }
    let order = if mirrored { [0, 2, 1] } else { [0, 1, 2] };
    let texel = |value| picture::texel(&ctx.wavelengths, value);
    let spectral = |triangle: &[[f32; 3]; 3]| order.map(|k| texel(triangle[k]));
    let more: Vec<_> = corners.values.iter().map(spectral).collect();
    ctx.textures.corners.extend(more);
    // Adjacent triangles do not share texture coordinates, so they do not share vertices either.
    let all = mesh.indices.as_flattened().iter().map(|i| *i as usize);
    let of_corner = |i: usize| Vec2::from_array(corner_uv((first + i / 3) as u32, i % 3));
    let count = mesh.indices.len() as u32;
    Ok(Mesh {
        normals: if mesh.normals.is_empty() {
            vec![]
        } else {
            all.clone().map(|i| mesh.normals[i]).collect()
        },
        positions: all.map(|i| mesh.positions[i]).collect(),
        uvs: (0..3 * mesh.indices.len()).map(of_corner).collect(),
        indices: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    })
}
