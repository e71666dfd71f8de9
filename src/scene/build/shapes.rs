//! Converts objects of a scene file to triangles and quadrics.

use super::attributes::{self, Asked};
use super::context::{Context, HUGE};
use super::devices::vector;
use super::smooth;
use base::locate::{InputError, Located};
use glam::{Affine3A, DAffine3, DMat3, DQuat, DVec3, EulerRot, Vec3A};
use import::MeshPart;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use syntax::shape::{MeshFile, ObjectFile, ShapeFile};
use syntax::transform::TransformFile;
use syntax::values::SpectrumFile;
use transport::geometry::builder::GeometryBuilder;
use transport::geometry::mesh::Mesh;
use transport::geometry::quadric::{Quadric, QuadricKind};

/// A shape with its transform, before the conversion to the renderer's primitives.
#[derive(Clone)]
pub(crate) struct Placed {
    pub form: Form,
    pub material: u32,
    /// Whether front and back of the surface are exchanged.
    pub flipped: bool,
}

/// The geometry of a [`Placed`] shape. The contained maps transform object space to world space.
#[derive(Clone)]
pub(crate) enum Form {
    Quadric(QuadricKind, DAffine3),
    Rectangle(DAffine3),
    Cube(DAffine3),
    Mesh(Mesh),
}

/// A renderer primitive in world space.
pub(crate) enum Solid {
    Quadric(Quadric),
    Mesh(Mesh),
}

impl Placed {
    /// Returns whether the shape is a mesh without texture coordinates.
    pub(crate) fn lacks_coordinates(&self) -> bool {
        matches!(&self.form, Form::Mesh(mesh) if mesh.uvs.is_empty())
    }

    pub(crate) fn solid(self, ctx: &Context, object: &Located<ObjectFile>) -> Result<Solid, InputError> {
        let mut mesh = match self.form {
            Form::Quadric(kind, map) => {
                let quadric = Quadric::new(kind, affine(map), self.material);
                return Ok(Solid::Quadric(if self.flipped { quadric.flipped() } else { quadric }));
            }
            Form::Rectangle(map) => moved(ctx, Mesh::rectangle(), map, object)?,
            Form::Cube(map) => moved(ctx, Mesh::cube(), map, object)?,
            Form::Mesh(mesh) => mesh,
        };
        if self.flipped {
            mesh.flip();
        }
        Ok(Solid::Mesh(mesh))
    }
}

impl Solid {
    pub(crate) fn add(self, material: u32, geometry: &mut GeometryBuilder) {
        match self {
            Self::Quadric(quadric) => geometry.quadric(quadric),
            Self::Mesh(mesh) => geometry.own_mesh(mesh, material),
        }
    }
}

pub(crate) fn place(
    ctx: &mut Context,
    object: &Located<ObjectFile>,
    materials: &BTreeMap<&str, u32>,
) -> Result<Vec<Placed>, InputError> {
    let find = |ctx: &Context, name: &Located<String>| {
        let unknown = || ctx.unknown("material", "materials", name, materials.keys().copied());
        materials.get(name.as_str()).copied().ok_or_else(unknown)
    };
    let material = find(ctx, &object.material)?;
    let asked = ctx.attributes.of(material).cloned();
    let is_ply = matches!(*object.shape, ShapeFile::Ply(_));
    let lacks = |ctx: &Context, asked: &Asked| {
        ctx.error(
            object.shape.span(),
            format!(
                "the material requires the mesh attribute `{}`, which this shape does not have",
                *asked.name
            ),
            "use a PLY mesh with the attribute, or another material",
        )
    };
    if let Some(asked) = asked.as_ref().filter(|_| !is_ply) {
        return Err(lacks(ctx, asked));
    }
    if matches!(*object.shape, ShapeFile::Disk(_)) && ctx.attributes.heights(material) {
        bail!(ctx, object.shape.span(), "a disk has no texture coordinates for a bump map", "use a mesh");
    }
    if let (Some(_), Some(image)) = (&asked, object.emission.as_ref().and_then(|e| e.image.as_ref())) {
        return Err(ctx.error(
            image.span(),
            "the emission has an image and the material uses a mesh attribute, but a mesh can have only one set of texture coordinates",
            "use another material for the object",
        ));
    }
    let place = transform(ctx, object.transform.as_ref())?;
    let span = object.shape.span();
    let quadric = |ctx: &Context, kind, shape: DAffine3| {
        let world = place * shape;
        if !is_solid(&world) {
            bail!(ctx, span.clone(), "the shape has zero size", "give a radius and extents above 0");
        }
        let columns = [world.matrix3.x_axis, world.matrix3.y_axis, world.matrix3.z_axis, world.translation];
        if columns.iter().any(|c| c.abs().max_element() > HUGE) {
            return Err(ctx.error(span.clone(), "the shape is too large", "keep coordinates below 1e12 m"));
        }
        Ok(Placed { form: Form::Quadric(kind, world), material, flipped: object.flip_normals })
    };
    let form = match &*object.shape {
        ShapeFile::Obj(m) | ShapeFile::Gltf(m) | ShapeFile::Ply(m) | ShapeFile::Serialized(m) => {
            let parts = load(ctx, m, &object.shape, asked.as_ref())?;
            if m.flat && m.smooth {
                return Err(ctx.error(
                    object.shape.span(),
                    "the mesh sets both `flat` and `smooth`",
                    "remove one of the two keys: flat removes vertex normals, smooth computes missing vertex normals",
                ));
            }
            let (mut used, mut meshes, mut numbers, mut corners) = (vec![], vec![], vec![], vec![]);
            for mut part in parts {
                let own = part.material.as_deref().and_then(|n| object.part_materials.get_key_value(n));
                let material = if let Some((key, name)) = own {
                    used.push(key.clone());
                    find(ctx, name)?
                } else {
                    if let Some(name) = part.material.as_ref().filter(|_| m.materials) {
                        ctx.note(format!(
                            "{}: material `{name}` is not in any material library; using `{}`",
                            *m.file, *object.material
                        ));
                    }
                    material
                };
                if let Some(asked) = ctx.attributes.of(material).filter(|_| !is_ply) {
                    return Err(lacks(ctx, asked));
                }
                if m.flat {
                    part.mesh.normals.clear();
                }
                corners.push(part.corners);
                meshes.push(moved(ctx, part.mesh, place, object)?);
                numbers.push(material);
            }
            if m.smooth {
                smooth::smooth(&mut meshes);
            }
            if let Some(asked) = &asked {
                let mirrored = place.matrix3.determinant() < 0.0;
                for (mesh, corners) in meshes.iter_mut().zip(&corners) {
                    let whole = std::mem::take(mesh);
                    *mesh = attributes::give(ctx, asked, &m.file, whole, corners, mirrored)?;
                }
            }
            if let Some((key, name)) = object.part_materials.iter().find(|(k, _)| !used.contains(k)) {
                return Err(ctx.error(
                    name.span(),
                    format!("the file {} has no part with the material `{key}`", *m.file),
                    "correct this key of part_materials, or remove the key",
                ));
            }
            let placed =
                |(mesh, material)| Placed { form: Form::Mesh(mesh), material, flipped: object.flip_normals };
            return Ok(meshes.into_iter().zip(numbers).map(placed).collect());
        }
        ShapeFile::Sphere(s) => {
            sized(ctx, s.radius, span.clone())?;
            let c = vector(ctx, s.center, span.clone(), "center")?;
            let shape = DAffine3::from_scale_rotation_translation(
                DVec3::splat(s.radius),
                DQuat::IDENTITY,
                c.as_dvec3(),
            );
            return Ok(vec![quadric(ctx, QuadricKind::Sphere, shape)?]);
        }
        ShapeFile::Disk(d) => {
            sized(ctx, d.radius, span.clone())?;
            let c = vector(ctx, d.center, span.clone(), "center")?;
            let n = vector(ctx, d.normal, span.clone(), "normal")?;
            if n.length_squared() < 1e-30 {
                bail!(ctx, span, "the disk's normal is zero", "give a direction, such as normal = [0, 0, 1]");
            }
            let disk = toward(c, n, d.radius, d.radius);
            return Ok(vec![quadric(ctx, QuadricKind::Disk, disk)?]);
        }
        ShapeFile::Cylinder(c) => {
            sized(ctx, c.radius, span.clone())?;
            let p0 = vector(ctx, c.p0, span.clone(), "p0")?;
            let p1 = vector(ctx, c.p1, span.clone(), "p1")?;
            let axis = p1 - p0;
            let tube = toward(p0, axis, c.radius, f64::from(axis.length()));
            let mut placed = vec![quadric(ctx, QuadricKind::Cylinder, tube)?];
            if c.caps {
                for (end, out) in [(p0, -axis), (p1, axis)] {
                    let cap = toward(end, out, c.radius, c.radius);
                    placed.push(quadric(ctx, QuadricKind::Disk, cap)?);
                }
            }
            return Ok(placed);
        }
        ShapeFile::Rectangle(r) => {
            let corner = DVec3::from_array(r.corner);
            let (u, v) = (DVec3::from_array(r.u), DVec3::from_array(r.v));
            let shape = DAffine3::from_mat3_translation(
                DMat3::from_cols(u / 2.0, v / 2.0, u.cross(v).normalize_or(DVec3::Z)),
                corner + (u + v) / 2.0,
            );
            Form::Rectangle(place * shape)
        }
        ShapeFile::Cube(c) => {
            let (lo, hi) = (DVec3::from_array(c.min), DVec3::from_array(c.max));
            if !lo.cmplt(hi).all() {
                return Err(ctx.error(span, "the cube is empty", "give min below max on every axis"));
            }
            let shape =
                DAffine3::from_scale_rotation_translation((hi - lo) / 2.0, DQuat::IDENTITY, (hi + lo) / 2.0);
            Form::Cube(place * shape)
        }
    };
    Ok(vec![Placed { form, material, flipped: object.flip_normals }])
}

/// Reads a mesh file of the shape's format.
fn load(
    ctx: &mut Context,
    m: &MeshFile,
    shape: &ShapeFile,
    asked: Option<&Asked>,
) -> Result<Vec<MeshPart>, InputError> {
    if m.index > 0 && !matches!(shape, ShapeFile::Serialized(_)) {
        return Err(ctx.error(
            m.file.span(),
            format!("`index` is {}, but only `serialized` files contain several meshes", m.index),
            "remove index",
        ));
    }
    let bytes = ctx.bytes(&m.file, m.file.span())?;
    let path = ctx.path(&m.file);
    if let ShapeFile::Gltf(_) = shape {
        let folder = Path::new(m.file.as_str()).parent().unwrap_or(Path::new(""));
        for name in import::gltf_buffers(&bytes) {
            ctx.uses(folder.join(name).to_string_lossy());
        }
    }
    let parse = || match shape {
        ShapeFile::Gltf(_) => import::parse_gltf(&bytes, path.parent()),
        ShapeFile::Ply(_) => match asked {
            Some(asked) => import::parse_ply_attribute(&bytes, &asked.name),
            None => import::parse_ply(&bytes),
        },
        ShapeFile::Serialized(m) => import::parse_serialized(&bytes, m.index),
        _ => import::parse_obj(&bytes),
    };
    let (parsed, ()) = rayon::join(parse, || ctx.count(&bytes));
    drop(bytes);
    let model = parsed.map_err(|mut e| {
        e.file = Some(path.clone());
        ctx.error(
            m.file.span(),
            e.to_string(),
            "repair or re-export the file, or use the shape key of its format (obj, gltf, ply, serialized)",
        )
    })?;
    for note in model.notes {
        ctx.note(format!("{}: {note}", *m.file));
    }
    Ok(model.parts)
}

pub(crate) fn moved(
    ctx: &Context,
    mut mesh: Mesh,
    place: DAffine3,
    object: &Located<ObjectFile>,
) -> Result<Mesh, InputError> {
    if !is_solid(&place) {
        return Err(ctx.error(
            object.shape.span(),
            "the shape or its transform has zero extent along a direction",
            "give an extent above 0 along every direction",
        ));
    }
    mesh.transform(&affine(place));
    if !import::lies_within(&mesh, HUGE) {
        bail!(ctx, object.shape.span(), "the shape is too large", "keep coordinates below 1e12 m");
    }
    Ok(mesh)
}

fn sized(ctx: &Context, radius: f64, span: Range<usize>) -> Result<(), InputError> {
    // A radius of 0 or infinity is reported later by the checks for all shapes.
    if radius >= 0.0 {
        return Ok(());
    }
    let message = format!("the radius is {radius}, but must be above 0");
    Err(ctx.error(span, message, "give a radius above 0, in metres"))
}

/// Returns whether an affine map is finite and invertible.
pub(crate) fn is_solid(map: &DAffine3) -> bool {
    map.is_finite() && map.matrix3.determinant().abs() > 1e-30
}

fn affine(a: DAffine3) -> Affine3A {
    Affine3A::from_mat3_translation(a.matrix3.as_mat3(), a.translation.as_vec3())
}

/// Returns the map of the unit disk or cylinder to a disk or cylinder of `radius` and `length` (metres) at
/// `origin`. The map rotates the z axis to `axis`.
fn toward(origin: Vec3A, axis: Vec3A, radius: f64, length: f64) -> DAffine3 {
    let z = axis.normalize_or(Vec3A::Z);
    let m = optics::polarization::frame::basis(z);
    DAffine3::from_mat3_translation(
        DMat3::from_cols(
            m.x_axis.as_dvec3() * radius,
            m.y_axis.as_dvec3() * radius,
            m.z_axis.as_dvec3() * length,
        ),
        origin.as_dvec3(),
    )
}

/// Returns the affine map of a transform, or the identity if there is no transform.
pub(crate) fn transform(
    ctx: &Context,
    transform: Option<&Located<TransformFile>>,
) -> Result<DAffine3, InputError> {
    let Some(t) = transform else {
        return Ok(DAffine3::IDENTITY);
    };
    if let Some(m) = t.matrix {
        if t.scale.is_some() || t.rotate_deg.is_some() || t.translate.is_some() {
            return Err(ctx.error(
                t.span(),
                "the transform has other keys besides matrix",
                "give either only matrix, or only scale, rotate_deg and translate",
            ));
        }
        if m[3] != [0.0, 0.0, 0.0, 1.0] {
            return Err(ctx.error(
                t.span(),
                format!("the last row of matrix is {:?}, not [0.0, 0.0, 0.0, 1.0]", m[3]),
                "give an affine matrix in row-major order",
            ));
        }
        let column = |j: usize| DVec3::new(m[0][j], m[1][j], m[2][j]);
        return Ok(DAffine3::from_mat3_translation(
            DMat3::from_cols(column(0), column(1), column(2)),
            column(3),
        ));
    }
    let scale = match t.scale.as_deref() {
        None => DVec3::ONE,
        Some(SpectrumFile::Scalar(s)) => DVec3::splat(*s),
        Some(SpectrumFile::PerWavelength(v)) if v.len() == 3 => DVec3::new(v[0], v[1], v[2]),
        Some(other) => {
            let found = match other {
                SpectrumFile::PerWavelength(v) => format!("{} numbers", v.len()),
                _ => "a table".to_owned(),
            };
            return Err(ctx.error(
                t.span(),
                format!("scale is {found}, but one or three numbers are expected"),
                "give one factor, or three factors (x, y, z)",
            ));
        }
    };
    let turned = t.rotate_deg.unwrap_or([0.0; 3]);
    if !turned.iter().all(|deg| deg.abs() <= 36_000.0) {
        return Err(ctx.error(
            t.span(),
            format!("rotate_deg is {turned:?}, outside the supported range"),
            "give angles in degrees about x, y and z, each in -36000..36000",
        ));
    }
    let [x, y, z] = turned.map(f64::to_radians);
    Ok(DAffine3::from_scale_rotation_translation(
        scale,
        // Rotate about x first, then y, then z.
        DQuat::from_euler(EulerRot::ZYX, z, y, x),
        DVec3::from_array(t.translate.unwrap_or([0.0; 3])),
    ))
}
