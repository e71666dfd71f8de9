//! Converts Mitsuba's `shapegroup` and `instance` to groups and instances of a scene file.

use super::import_shapes::{self, Readers};
use super::importer::Importer;
use super::names::{free, plain};
use super::tree::Node;
use crate::build::pose::matrix;
use base::locate::{InputError, Located};
use glam::DAffine3;
use std::collections::BTreeMap;
use syntax::instance::{GroupFile, InstanceFile};

#[derive(Default)]
pub(super) struct Groups<'a> {
    pub groups: BTreeMap<String, Located<GroupFile>>,
    pub instances: Vec<Located<InstanceFile>>,
    /// Groups that have been read, and their names in the scene file.
    read: Vec<(&'a Node, String)>,
}

impl<'a> Groups<'a> {
    /// Adds the group of a `shapegroup` unless it has been added before, and returns the group's name.
    pub fn group(&mut self, importer: &mut Importer<'a>, reader: &mut Readers, node: &'a Node) -> String {
        if let Some((_, name)) = self.read.iter().find(|(n, _)| std::ptr::eq(*n, node)) {
            return name.clone();
        }
        let wanted = plain(node.id.as_deref().unwrap_or("group"));
        let name = free(&wanted, |name| self.groups.contains_key(name));
        self.read.push((node, name.clone()));
        // Reserve the name even if the group has errors.
        let mut group = GroupFile::default();
        self.groups.insert(name.clone(), node.at(group.clone()));
        for child in node.children() {
            let objects = importer.resolve(child).and_then(|inner| match inner.kind.as_str() {
                "shapegroup" | "instance" => importer.error(
                    &inner.span,
                    format!("a shapegroup cannot contain `{}`", inner.kind),
                    "move the shapes into the group or out of it: groups cannot be nested",
                ),
                _ if inner.tag != "shape" => importer.error(
                    child.span(),
                    format!("a {} in a shapegroup has no effect", inner.tag),
                    "move the element into a shape of the group, or remove the element",
                ),
                _ => Ok((inner, import_shapes::all(importer, reader, inner)?)),
            });
            if let Some((inner, new)) = importer.source.accept(objects) {
                group.objects.extend(new.into_iter().map(|o| inner.at(o)));
            }
        }
        if node.children().is_empty() {
            let message = "the shapegroup is empty";
            let fix = "add shapes, or remove the shapegroup and its instances";
            importer.source.report(importer.source.error(&node.span, message, fix));
        }
        node.finish(importer.source, &[]);
        self.groups.insert(name.clone(), node.at(group));
        name
    }

    pub fn instance(
        &mut self,
        importer: &mut Importer<'a>,
        reader: &mut Readers,
        node: &'a Node,
    ) -> Result<(), InputError> {
        let place = node.transform(importer.source, "to_world")?;
        let mut group = None;
        for child in node.children() {
            let inner = importer.resolve(child)?;
            if inner.kind != "shapegroup" || group.is_some() {
                return importer.error(
                    child.span(),
                    "an instance must contain exactly one shapegroup and nothing else",
                    "refer to one shapegroup; its shapes already have materials",
                );
            }
            group = Some(inner);
        }
        let Some(group) = group else {
            return importer.error(
                &node.span,
                "the instance has no shapegroup",
                "add <ref id=\"…\"/> with the id of a shapegroup",
            );
        };
        node.finish(importer.source, &[]);
        let name = self.group(importer, reader, group);
        let at = || node.span.clone();
        let mut instance = InstanceFile::new(name);
        instance.group = Located::at(at(), instance.group.to_string());
        instance.name.clone_from(&node.id);
        if let Some(place) = place.filter(|p| *p != DAffine3::IDENTITY) {
            instance.transform = Some(Located::at(at(), matrix(&place)));
        }
        self.instances.push(Located::at(at(), instance));
        Ok(())
    }
}
