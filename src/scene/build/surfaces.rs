//! Converts objects, groups and instances of a scene file to geometry. Every filled object has its own
//! material index.

use super::context::{Context, HUGE};
use super::lights;
use super::places;
use super::shapes;
use super::volumes::{self, Volume};
use base::locate::{InputError, Located};
use glam::DAffine3;
use std::collections::BTreeMap;
use syntax::instance::{GroupFile, InstanceFile};
use syntax::shape::ObjectFile;
use transport::geometry::builder::GeometryBuilder;
use transport::light::area::AreaLight;
use transport::material::Materials;
use transport::medium::nesting::Boundary;
use transport::names::Names;

/// Maximum number of copies. A larger number is probably a mistake.
const MOST_COPIES: usize = 1 << 26;

pub(crate) struct Surfaces<'a> {
    pub geometry: GeometryBuilder,
    pub materials: &'a mut Materials,
    /// Boundaries (inside and outside medium), one per material index.
    pub boundaries: Vec<Boundary>,
    /// Names of objects, and for each material index the name of the material in the scene file.
    pub called: Names,
    /// Indices of materials by name.
    names: &'a BTreeMap<&'a str, u32>,
    /// Names of the materials that read images.
    textured: Vec<&'a str>,
    /// Indices of media by name.
    media: &'a BTreeMap<&'a str, u32>,
    /// Area lights of emissive surfaces, and for each material the index of its area light.
    pub shining: (Vec<AreaLight>, Vec<u32>),
}

impl<'a> Surfaces<'a> {
    pub fn new(
        materials: &'a mut Materials,
        names: &'a BTreeMap<&'a str, u32>,
        textured: Vec<&'a str>,
        media: &'a BTreeMap<&'a str, u32>,
    ) -> Self {
        let mut called = Names {
            objects: vec![],
            materials: vec![String::new(); materials.list.len()],
            material_of: (0..materials.list.len() as u32).collect(),
        };
        for (name, number) in names {
            (*name).clone_into(&mut called.materials[*number as usize]);
        }
        Self {
            geometry: GeometryBuilder::default(),
            boundaries: vec![Boundary::NONE; materials.list.len()],
            called,
            materials,
            names,
            textured,
            media,
            shining: (vec![], vec![]),
        }
    }

    /// Adds objects to the scene or to a named group.
    pub fn objects(
        &mut self,
        ctx: &mut Context,
        objects: &[Located<ObjectFile>],
        group: Option<&str>,
    ) -> Result<(), InputError> {
        let mut volumes = vec![];
        for (i, object) in objects.iter().enumerate() {
            self.geometry.object(self.called.objects.len() as u32);
            let own = object.name.clone().unwrap_or_else(|| format!("objects[{i}]"));
            self.called.objects.push(group.map_or(own.clone(), |group| format!("{group}/{own}")));
            self.geometry.facets(object.emission.is_some());
            let filling = filling(ctx, object, self.media, self.boundaries.len())?;
            let (mut solids, mut numbers) = (vec![], vec![]);
            let mut bare = None;
            for mut placed in shapes::place(ctx, object, self.names)? {
                if let Some(material) = self.without_coordinates(&placed) {
                    bare = Some(material);
                }
                if filling.is_some() || object.emission.is_some() {
                    // A separate index distinguishes this object's surfaces from other surfaces of the same
                    // material. Copies of an object share one index. Light that exits a copy is assumed to
                    // exit the copy that it entered last.
                    let material = self.materials.list[placed.material as usize];
                    self.materials.list.push(material);
                    self.boundaries.push(filling.unwrap_or(Boundary::NONE));
                    let original = self.called.material_of[placed.material as usize];
                    self.called.material_of.push(original);
                    placed.material = self.boundaries.len() as u32 - 1;
                }
                numbers.push(placed.material);
                solids.push(placed.solid(ctx, object)?);
            }
            if let Some(material) = bare {
                let name = self.called.objects.last().map_or("", String::as_str);
                ctx.note(format!(
                    "{name}: the material `{material}` has an image, but the mesh has no texture coordinates; each triangle shows the \
                     whole image; add texture coordinates to the mesh"
                ));
            }
            if let Some(filling) = filling {
                volumes.push(Volume::new(ctx, object, filling, &mut solids)?);
            }
            for (solid, material) in solids.into_iter().zip(numbers) {
                if let Some(emission) = &object.emission {
                    let light = lights::area(ctx, emission, &solid)?;
                    let (areas, of_material) = &mut self.shining;
                    of_material.resize(material as usize, transport::light::NONE);
                    of_material.push(areas.len() as u32);
                    areas.push(light);
                }
                solid.add(material, &mut self.geometry);
            }
        }
        volumes::overlaps(ctx, &volumes)
    }

    /// Returns the name of the material if it reads an image and is on a mesh without texture coordinates.
    fn without_coordinates(&self, placed: &shapes::Placed) -> Option<&'a str> {
        let of = |name: &&&str| self.names.get(**name) == Some(&placed.material);
        placed.lacks_coordinates().then(|| self.textured.iter().find(of).copied())?
    }

    pub fn instances(
        &mut self,
        ctx: &mut Context,
        groups: &BTreeMap<String, Located<GroupFile>>,
        instances: &[Located<InstanceFile>],
    ) -> Result<(), InputError> {
        let mut numbers = BTreeMap::new();
        for (name, group) in groups {
            if group.objects.is_empty() {
                return Err(ctx.error(
                    group.span(),
                    format!("the group `{name}` is empty"),
                    format!("add [[groups.{name}.objects]], or remove the group"),
                ));
            }
            if let Some(emission) = group.objects.iter().find_map(|o| o.emission.as_ref()) {
                return Err(ctx.error(
                    emission.span(),
                    "an object in a group has emission, but copies cannot emit light",
                    "move the object to [[objects]]",
                ));
            }
            numbers.insert(name.as_str(), self.geometry.begin_group());
            self.objects(ctx, &group.objects, Some(name))?;
            self.geometry.end_group();
        }
        let mut count = 0;
        for instance in instances {
            let number = group_number(ctx, &instance.group, &numbers)?;
            let all = copies(ctx, instance)?;
            count += all.len();
            if count > MOST_COPIES {
                return Err(ctx.error(
                    instance.span(),
                    format!("the scene has more than {MOST_COPIES} copies of groups"),
                    "combine several objects into one group",
                ));
            }
            for place in all {
                self.geometry.instance(number, place);
            }
        }
        Ok(())
    }
}

pub(crate) fn group_number<T: Copy>(
    ctx: &Context,
    name: &Located<String>,
    groups: &BTreeMap<&str, T>,
) -> Result<T, InputError> {
    let unknown = || ctx.unknown("group", "groups", name, groups.keys().copied());
    groups.get(name.as_str()).copied().ok_or_else(unknown)
}

/// Returns the transforms of all copies of an object or instance.
pub(crate) fn copies(
    ctx: &mut Context,
    instance: &Located<InstanceFile>,
) -> Result<Vec<DAffine3>, InputError> {
    let outer = shapes::transform(ctx, instance.transform.as_ref())?;
    let places = match &instance.places {
        Some(file) => places::read(ctx, file)?,
        None => vec![DAffine3::IDENTITY],
    };
    let mut all = Vec::with_capacity(places.len());
    for (i, inner) in places.into_iter().enumerate() {
        let place = outer * inner;
        let m = place.matrix3;
        let columns = [m.x_axis, m.y_axis, m.z_axis, place.translation];
        let fault = if !columns.iter().all(|c| c.abs().max_element() <= HUGE) {
            Some(("is too large", "keep coordinates below 1e12 m"))
        } else if !shapes::is_solid(&place) {
            Some(("has zero extent along a direction", "give an extent above 0 along every direction"))
        } else {
            None
        };
        if let Some((what, help)) = fault {
            let span = instance.places.as_ref().map_or(instance.span(), Located::span);
            let which = if instance.places.is_some() {
                format!("copy {} of the group", i + 1)
            } else {
                "the copy of the group".into()
            };
            return Err(ctx.error(span, format!("{which} {what}"), help));
        }
        all.push(place);
    }
    Ok(all)
}

/// Returns the medium that fills an object. `first` is the index of the object's first boundary.
fn filling(
    ctx: &Context,
    object: &ObjectFile,
    media: &BTreeMap<&str, u32>,
    first: usize,
) -> Result<Option<Boundary>, InputError> {
    let Some(name) = &object.interior else {
        return Ok(None);
    };
    if object.flip_normals {
        return Err(ctx.error(
            name.span(),
            "an object with an interior cannot have flip_normals",
            "remove flip_normals: the interior determines the orientation",
        ));
    }
    let Some(medium) = media.get(name.as_str()) else {
        return Err(ctx.unknown("medium", "media", name, media.keys().copied()));
    };
    Ok(Some(Boundary { medium: *medium, priority: object.priority, object: first as u32 }))
}
