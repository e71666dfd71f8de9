//! Exports a scene file to Mitsuba 3's XML, with meshes, images and tables in files next to it.
//!
//! Values for which Mitsuba has a default are written explicitly: exterior indices, wavelengths, frames and
//! filters. A feature that Mitsuba cannot express causes an error with the location of the feature. A feature
//! that Mitsuba models differently (masking of facets, unpolarized rough glass) produces a note.
//!
//! Mitsuba's spectral variants interpolate between the scene's wavelengths, so values at the scene's
//! wavelengths are exact. Mitsuba's mono variants reduce wavelength:value pairs to a luminance. A scene for
//! mono variants is therefore exported at one wavelength, as plain numbers.

use super::export_emitters::EmitterWriter;
use super::export_materials::MaterialWriter;
use super::export_output::{Needs, Output, bitmap, device, is_even, png, spectrum};
use super::files::{Contents, WriteError, write};
use super::names::{PROJECTOR_RESOLUTION, WAVELENGTHS, plain};
use super::xml::{Element, number};
use crate::build::assemble::settings;
use crate::build::calibrated;
use crate::build::context::{Context, read};
use crate::build::devices::{pinhole, projector};
use crate::build::file_materials;
use crate::build::lights;
use crate::build::shapes::{Form, Placed, moved, place};
use crate::build::surfaces::{copies, group_number};
use crate::build::{materials, slices};
use base::locate::{InputError, Located};
use glam::{DAffine3, DVec3};
use import::write_ply;
use optics::spectrum::Wavelengths;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::ops::Range;
use std::path::Path;
use syntax::Syntax;
use syntax::scene::SceneFile;
use syntax::shape::ObjectFile;
use transport::device::pinhole::Pinhole;
use transport::device::projector::Projector;
use transport::geometry::mesh::Mesh;
use transport::geometry::quadric::QuadricKind;
use transport::light::area::AreaLight;
use transport::material::texture::Image;
use transport::scene::Settings;

/// A scene in Mitsuba's format.
#[derive(Clone, Debug)]
pub struct Export {
    pub xml: String,
    /// Names and contents of the files to which the XML refers.
    pub files: Vec<(String, Contents)>,
    /// Notes about differences between the models of Mitsuba and Sunstone.
    pub notes: Vec<String>,
}

impl Export {
    /// Reads and converts a scene file. [`Self::from_text`] describes the options.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::from_text`], or an error if the file cannot be read.
    pub fn load(path: &Path, wavelength_nm: Option<f64>) -> Result<Self, InputError> {
        Self::from_text(path, &read(path, "scene file")?, wavelength_nm)
    }

    /// Converts a scene file. If `wavelength_nm` is given, the scene is exported only at this wavelength.
    /// Lists of values are then interpolated between the file's wavelengths.
    ///
    /// # Errors
    /// Returns [`InputError`] if the scene cannot be built, or for a feature that Mitsuba cannot express.
    pub fn from_text(path: &Path, text: &str, wavelength_nm: Option<f64>) -> Result<Self, InputError> {
        let file = SceneFile::read(path, text)?;
        let mut ctx = Context::new(path, text, &file.wavelengths_nm)?;
        if let Some(nm) = wavelength_nm {
            ctx.wavelengths = Wavelengths::new(vec![nm])
                .map_err(|e| ctx.error(0..0, e.to_string(), "give a vacuum wavelength in nanometres"))?;
        }
        export(&mut ctx, &file)
    }

    /// Writes `scene.xml` and the files to which it refers into `folder`. The folder must be absent or empty
    /// unless `force` is true.
    ///
    /// # Errors
    /// Returns [`WriteError`] if a file cannot be written. No file is partially written, even after an error.
    pub fn write(&self, folder: &Path, force: bool) -> Result<(), WriteError> {
        let mut files = self.files.clone();
        files.push(("scene.xml".into(), Contents::Bytes(self.xml.clone().into_bytes())));
        write(folder, &files, force)
    }
}

fn export(ctx: &mut Context, file: &SceneFile) -> Result<Export, InputError> {
    let file = file_materials::expand(ctx, file)?;
    let file = &calibrated::expand(ctx, file)?;
    let settings = settings(ctx, file)?;
    let camera = pinhole(ctx, &file.camera, file.camera.span())?;
    let projector =
        file.projector.as_ref().map(|p| Ok((projector(ctx, p, p.span(), &camera)?, p.span()))).transpose()?;
    slices::build(ctx, file, &camera, projector.as_ref().map(|(p, _)| p))?;
    let mut emitters = lights::emitters(ctx, &file.emitters)?;
    let materials::Built { table: mut materials, names } = materials::build(ctx, &file.materials)?;
    if let Some(asked) = ctx.attributes.first() {
        return Err(ctx.error(
            asked.name.span(),
            "mesh attributes cannot be exported",
            "use an image or a constant value",
        ));
    }
    let mut out = Output::default();
    lights::slides(ctx, &file.emitters, &mut emitters.points)?;
    let shapes = all_placed(ctx, &file.objects, &names)?;
    let mut groups = vec![];
    for (name, group) in &file.groups {
        let shapes = all_placed(ctx, &group.objects, &names)?;
        groups.push((name.as_str(), shapes));
    }
    materials.textures = std::mem::take(&mut ctx.textures);
    let all = groups.iter().flat_map(|g| &g.1).chain(&shapes);
    let used: Vec<u32> = all.map(|s| s.placed.material).collect();
    let mut writer = MaterialWriter::new(ctx, &file.materials, &materials, &names, &mut out);
    let bsdfs = writer.all(&used)?;
    let (ids, needs) = (writer.ids, writer.needs);

    let mut scene = Element::new("scene").with("version", "3.0.0");
    scene.comment(
        "Written by sunstone export. Units are metres; light is unpolarized, so images are column 0 of the tensor.",
    );
    let list: Vec<String> = ctx.wavelengths.nm().iter().map(|w| number(*w)).collect();
    scene.push(default(WAVELENGTHS, &list.join(", ")));
    if let Some((p, _)) = &projector {
        let [w, h] = p.pinhole.resolution;
        scene.push(default(PROJECTOR_RESOLUTION, &format!("{w}, {h}")));
    }
    scene.push(integrator(&settings));
    scene.push(sensor(ctx, &camera, file.camera.span(), settings.spp)?);
    bsdfs.into_iter().for_each(|b| scene.push(b));
    let mut count = 0;
    let mut add = |shapes: &[Shape], parent: &mut Element| {
        for Shape { object, placed, light } in shapes {
            let bsdf = Element::new("ref").with("id", ids[&placed.material].as_str());
            let mut needs = needs[&placed.material];
            needs.uv |= light.as_ref().is_some_and(|l| l.radiance.texture.is_some());
            let mut shape = shape(ctx, count, object, placed, needs, &mut out)?.child(bsdf);
            if let (Some(light), Some(emission)) = (light, &object.emission) {
                let mut writer = EmitterWriter { ctx, out: &mut out };
                shape.push(writer.area(light, &materials.textures, emission.span())?);
            }
            count += 1;
            if let Some(name) = &object.name {
                parent.comment(name.as_str());
            }
            parent.push(shape);
        }
        Ok::<_, InputError>(())
    };
    add(&shapes, &mut scene)?;
    let mut group_ids = BTreeMap::new();
    for (name, shapes) in &groups {
        let taken = |id: &String| ids.values().any(|i| i == id) || group_ids.values().any(|i| i == id);
        let mut id = plain(name);
        while taken(&id) {
            id += "_group";
        }
        let mut element = Element::plugin("shape", "shapegroup").with("id", &id);
        add(shapes, &mut element)?;
        scene.push(element);
        group_ids.insert(*name, id);
    }
    let group_ids = group_ids.iter().map(|(name, id)| (*name, id.as_str())).collect();
    for instance in &file.instances {
        let id = group_number(ctx, &instance.group, &group_ids)?;
        if let Some(name) = &instance.name {
            scene.comment(name.as_str());
        }
        for place in copies(ctx, instance)? {
            let group = Element::new("ref").with("id", id);
            let shape = Element::plugin("shape", "instance").transform("to_world", &place);
            scene.push(shape.child(group));
        }
    }
    if let Some((p, span)) = &projector {
        scene.push(projector_element(ctx, p, span.clone(), &mut out)?);
    }
    let mut writer = EmitterWriter { ctx, out: &mut out };
    for emitter in writer.all(file, &emitters, &materials.textures)? {
        scene.push(emitter);
    }
    Ok(Export {
        xml: scene.document(),
        files: out.files,
        notes: std::mem::take(&mut ctx.notes).into_iter().chain(out.notes).collect(),
    })
}

/// A shape to export, with its object and its area light.
struct Shape<'a> {
    object: &'a Located<ObjectFile>,
    placed: Placed,
    light: Option<AreaLight>,
}

fn all_placed<'a>(
    ctx: &mut Context,
    objects: &'a [Located<ObjectFile>],
    names: &BTreeMap<&str, u32>,
) -> Result<Vec<Shape<'a>>, InputError> {
    let mut shapes = vec![];
    for object in objects {
        if let Some(name) = &object.interior {
            return Err(ctx.error(
                name.span(),
                "objects with an interior medium cannot be exported",
                "remove `interior` and the medium",
            ));
        }
        for placed in place(ctx, object, names)? {
            let light = match &object.emission {
                None => None,
                Some(emission) => {
                    let solid = placed.clone().solid(ctx, object)?;
                    Some(lights::area(ctx, emission, &solid)?)
                }
            };
            shapes.push(Shape { object, placed, light });
        }
    }
    Ok(shapes)
}

fn default(name: &str, value: &str) -> Element {
    Element::new("default").with("name", name).with("value", value)
}

/// Returns the XML element of the integrator. Mitsuba's `rr_depth`, like `max_depth`, counts the path segment
/// that starts at the camera.
fn integrator(settings: &Settings) -> Element {
    let path = Element::plugin("integrator", "path")
        .integer("max_depth", settings.max_depth)
        .integer("rr_depth", u64::from(settings.rr_depth) + 1);
    Element::plugin("integrator", "stokes").child(path)
}

/// Returns the horizontal field of view in degrees, or an error for a lens that Mitsuba cannot express.
/// Mitsuba's pinhole cameras have square pixels and no distortion.
fn field_of_view(ctx: &Context, p: &Pinhole, span: Range<usize>, what: &str) -> Result<f64, InputError> {
    if !p.distortion.is_none() {
        bail!(ctx, span, "Mitsuba cannot express the lens distortion of the {what}", "remove the distortion");
    }
    if (p.focal.x - p.focal.y).abs() > 1e-9 * p.focal.x {
        return Err(ctx.error(
            span,
            format!("Mitsuba cannot express the non-square pixels of the {what}"),
            "give only fx, or the field of view",
        ));
    }
    Ok(2.0 * (f64::from(p.resolution[0]) / 2.0 / p.focal.x).atan().to_degrees())
}

/// Returns the offset of the principal point from the image centre, as fractions of width and height.
fn off_centre(p: &Pinhole) -> [f64; 2] {
    let [w, h] = p.resolution.map(f64::from);
    [0.5 - p.principal.x / w, 0.5 - p.principal.y / h]
}

/// Distance, in metres, from the device to the near clipping plane, where Mitsuba's rays start.
const NEAR: f64 = 1e-3;

fn sensor(ctx: &Context, camera: &Pinhole, span: Range<usize>, spp: u32) -> Result<Element, InputError> {
    let [x, y] = off_centre(camera);
    let mut sensor = if camera.parallel {
        if [x, y] != [0.0; 2] {
            return Err(ctx.error(
                span,
                "Mitsuba cannot express an orthographic camera with an off-centre principal point",
                "remove cx and cy, and move the camera",
            ));
        }
        Element::plugin("sensor", "orthographic")
    } else {
        Element::plugin("sensor", "perspective")
            .float("fov", field_of_view(ctx, camera, span, "camera")?)
            .string("fov_axis", "x")
    }
    .float("near_clip", NEAR);
    let mut place = device(camera.origin, camera.axes);
    if camera.parallel {
        // The rays of Mitsuba's camera start at the near plane, and the image spans -1 to 1 horizontally.
        let half = f64::from(camera.resolution[0]) / camera.focal.x / 2.0;
        place.translation -= place.matrix3.z_axis * NEAR;
        place *= DAffine3::from_scale(DVec3::new(half, half, 1.0));
    }
    if [x, y] != [0.0; 2] {
        sensor = sensor.float("principal_point_offset_x", x).float("principal_point_offset_y", y);
    }
    let film = Element::plugin("film", "hdrfilm")
        .integer("width", camera.resolution[0])
        .integer("height", camera.resolution[1])
        .string("component_format", "float32")
        .child(Element::plugin("rfilter", "box"));
    let sampler = Element::plugin("sampler", "independent").integer("sample_count", spp);
    Ok(sensor.transform("to_world", &place).child(film).child(sampler))
}

/// Returns the XML element of the projector. The actual irradiance of Mitsuba's projector is π times the
/// value that Mitsuba's documentation states.
fn projector_element(
    ctx: &Context,
    p: &Projector,
    span: Range<usize>,
    out: &mut Output,
) -> Result<Element, InputError> {
    let pinhole = &p.pinhole;
    if off_centre(pinhole) != [0.0; 2] {
        return Err(ctx.error(
            span,
            "Mitsuba cannot express a projector with an off-centre principal point",
            "remove cx and cy, or rotate the projector",
        ));
    }
    let [w, h] = pinhole.resolution;
    let element = Element::plugin("emitter", "projector")
        .float("fov", field_of_view(ctx, pinhole, span.clone(), "projector")?)
        .string("fov_axis", "x")
        .transform("to_world", &device(pinhole.origin, pinhole.axes));
    if p.coaxial {
        out.note("the coaxial projector is exported as a separate projector at the camera's position");
    }
    if w == h {
        // Mitsuba projects a spectrum as an image of one square pixel.
        return Ok(element.float("scale", PI.recip()).child(spectrum(
            &ctx.wavelengths,
            "irradiance",
            p.irradiance,
        )));
    }
    if !is_even(&ctx.wavelengths, p.irradiance) {
        return Err(ctx.error(
            span,
            "Mitsuba cannot express a wavelength-dependent irradiance of a non-square projector",
            "export one wavelength (--wavelength), or use a square projector image",
        ));
    }
    let white = image::GrayImage::from_pixel(w, h, image::Luma([255]));
    out.files.push(("white.png".into(), png(ctx, span, &white.into())?));
    Ok(element.float("scale", f64::from(p.irradiance.to_array()[0]) / PI).child(bitmap(
        "irradiance",
        "white.png",
        true,
        &Image::new([w, h], 0),
    )))
}

fn shape(
    ctx: &Context,
    index: usize,
    object: &Located<ObjectFile>,
    placed: &Placed,
    needs: Needs,
    out: &mut Output,
) -> Result<Element, InputError> {
    let cannot = |what: &str, fix: &str| {
        let name = object.name.as_deref().unwrap_or(&object.material);
        let message = format!("Mitsuba cannot express {what} (object `{name}`)");
        Err(ctx.error(object.shape.span(), message, fix))
    };
    // A reflection reverses the normals of Mitsuba's spheres, but not of Sunstone's.
    let mut flipped = placed.flipped;
    let element = match &placed.form {
        Form::Quadric(QuadricKind::Sphere, map) => {
            if !is_similar(map, true) {
                return cannot("an ellipsoid", "scale all axes equally, or use a mesh");
            }
            flipped ^= map.matrix3.determinant() < 0.0;
            Element::plugin("shape", "sphere").transform("to_world", map)
        }
        Form::Quadric(QuadricKind::Cylinder, map) => {
            if !is_similar(map, false) {
                return cannot(
                    "a cylinder with an elliptic or oblique cross section",
                    "scale x and y equally, or use a mesh",
                );
            }
            // Mitsuba samples the emission of a mirrored cylinder on the wrong side. A cylinder is
            // symmetric, so remove the reflection.
            let mirrored = map.matrix3.determinant() < 0.0 && needs == Needs::default();
            let map = if mirrored { *map * DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)) } else { *map };
            Element::plugin("shape", "cylinder").transform("to_world", &map)
        }
        Form::Quadric(QuadricKind::Disk, map) => {
            if needs.tangent {
                return cannot(
                    "a disk with an anisotropic material (the u direction of a disk is radial in Mitsuba)",
                    "use a rectangle",
                );
            }
            Element::plugin("shape", "disk").transform("to_world", map)
        }
        Form::Rectangle(map) => Element::plugin("shape", "rectangle").transform("to_world", map),
        // The texture coordinates of Mitsuba's cube differ from Sunstone's, so export a mesh if the material
        // uses texture coordinates.
        Form::Cube(map) if needs == Needs::default() => {
            Element::plugin("shape", "cube").transform("to_world", map)
        }
        Form::Cube(map) => mesh(index, &moved(ctx, Mesh::cube(), *map, object)?, out),
        Form::Mesh(m) if m.uvs.is_empty() && needs.tangent => {
            return cannot(
                "an anisotropic material on a mesh without texture coordinates",
                "add texture coordinates to the mesh, or use a rectangle",
            );
        }
        Form::Mesh(m) => mesh(index, m, out),
    };
    Ok(if flipped { element.boolean("flip_normals", true) } else { element })
}

fn mesh(index: usize, mesh: &Mesh, out: &mut Output) -> Element {
    let name = format!("mesh_{index:03}.ply");
    out.files.push((name.clone(), Contents::Bytes(write_ply::write(mesh))));
    let shape = Element::plugin("shape", "ply").string("filename", &name);
    if mesh.normals.is_empty() {
        // Without `face_normals`, Mitsuba would compute vertex normals.
        return shape.boolean("face_normals", true);
    }
    shape
}

/// Returns whether a map preserves circles about the z axis and keeps the z axis perpendicular to the
/// circles. If `all` is true, returns whether the map preserves all angles.
fn is_similar(map: &DAffine3, all: bool) -> bool {
    let [x, y, z]: [DVec3; 3] = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis];
    let (rx, ry, rz) = (x.length(), y.length(), z.length());
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-5 * a.max(b);
    let square = |a: DVec3, b: DVec3| a.dot(b).abs() <= 1e-5 * a.length() * b.length();
    near(rx, ry) && square(x, y) && square(y, z) && square(z, x) && (!all || near(rx, rz))
}
