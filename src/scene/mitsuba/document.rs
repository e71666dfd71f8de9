//! Parses a Mitsuba scene in XML, or in JSON as a dump of Mitsuba's Python dictionary.

use super::folders::{Alias, Folders};
use super::json;
use super::names::{PROJECTOR_RESOLUTION, WAVELENGTHS};
use super::reader::Reader;
use super::source::{Source, parse};
use super::tree::Node;
use base::locate::InputError;
use std::collections::BTreeMap;
use std::path::Path;

/// Names of the parameters that Sunstone reads even if the scene does not refer to them.
const RESERVED: [&str; 2] = [WAVELENGTHS, PROJECTOR_RESOLUTION];

pub(super) struct Document {
    pub source: Source,
    pub scene: Node,
    /// Parameter values from `<default>` elements and from the command line.
    pub parameters: BTreeMap<String, String>,
    /// Additional ids of elements.
    pub aliases: Vec<Alias>,
    pub folders: Folders,
    pub notes: Vec<String>,
}

impl Document {
    /// Parses a scene. `given` contains the command-line parameters, which override `<default>`. Errors
    /// inside the scene are recorded in the [`Source`] of the scene.
    ///
    /// # Errors
    /// Returns [`InputError`] with a location if the text does not contain a scene.
    pub fn parse(file: &Path, text: &str, given: &BTreeMap<String, String>) -> Result<Self, InputError> {
        let source = Source::new(file, text);
        let folders = Folders::of(file);
        if text.trim_start().starts_with('{') {
            let scene = json::scene(&source, text)?;
            let used = |name: &str| RESERVED.contains(&name);
            if let Some(name) = given.keys().find(|name| !used(name)) {
                return Err(unused(&source, &scene, name));
            }
            return Ok(Self {
                scene,
                source,
                parameters: given.clone(),
                aliases: vec![],
                folders,
                notes: vec![],
            });
        }
        let xml = parse(&source, 0, text)?;
        let mut reader = Reader::new(&source, given, folders);
        let root = xml.root_element();
        if root.tag_name().name() != "scene" {
            return Err(source.error(
                &reader.start_tag(&root),
                format!("expected the root element <scene>, got <{}>", root.tag_name().name()),
                "give the file of a complete scene",
            ));
        }
        reader.version(&root)?;
        let scene = reader.plugin(&root, 0)?;
        let known = |name: &String| reader.used.contains(name) || RESERVED.contains(&name.as_str());
        if let Some(name) = given.keys().find(|name| !known(name)) {
            return Err(unused(&source, &scene, name));
        }
        let Reader { parameters, aliases, folders, notes, .. } = reader;
        Ok(Self { source, scene, parameters, aliases, folders, notes })
    }
}

fn unused(source: &Source, scene: &Node, name: &str) -> InputError {
    source.error(
        &scene.span,
        format!("the file does not use the parameter `{name}`"),
        "correct the name after -D, or omit the option",
    )
}
