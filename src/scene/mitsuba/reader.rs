//! Parses Mitsuba 3's XML to a tree of plugins with typed properties, each with its location.
//!
//! Like Mitsuba's parser, this parser supports:
//! - `<default>` and `$name`.
//! - `<include>`.
//! - Nested transforms, in which each operation applies after the previous operations.
//! - Values separated by spaces or commas.
//!
//! The parser records errors and continues.

use super::folders::{Alias, Folders, read_text};
use super::source::{Source, parse};
use super::tree::{Child, Inside, Node, Property, Value, number, numbers, pairs};
use base::locate::InputError;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

const DEEPEST: usize = 32;

/// Maximum nesting depth of included files, as in Mitsuba.
const MOST_INCLUDES: usize = 15;

/// Parses the colour `#rrggbb` as older versions of Mitsuba do: each byte divided by 255 is a linear value.
fn hexadecimal(text: &str) -> Option<[f64; 3]> {
    let digits = text.trim().strip_prefix('#').filter(|d| d.len() == 6 && d.is_ascii())?;
    let byte = |i: usize| u8::from_str_radix(&digits[i..i + 2], 16).ok();
    Some([byte(0)?, byte(2)?, byte(4)?].map(|b| f64::from(b) / 255.0))
}

/// Converts a name to the spelling of Mitsuba 2 and 3, such as `toWorld` to `to_world` and `intIOR` to
/// `int_ior`.
fn snake(name: &str) -> String {
    let mut out = String::new();
    let mut after_lower = false;
    let mut upper_run = false;
    for c in name.chars() {
        upper_run = c.is_ascii_uppercase() && (after_lower || upper_run);
        if upper_run && after_lower {
            out.push('_');
        }
        out.push(if upper_run { c.to_ascii_lowercase() } else { c });
        after_lower = c.is_ascii_lowercase();
    }
    out
}

/// Replaces the names of properties and children in a plugin of a Mitsuba 0.x scene by current names, as
/// Mitsuba 3 does (`upgrade_from_v1` in `parser.cpp`).
fn upgrade(node: &mut Node) {
    let diffuse = node.kind == "diffuse";
    let upgraded = |name: &str| match snake(name) {
        name if diffuse && name == "diffuse_reflectance" => "reflectance".to_owned(),
        name => name,
    };
    for p in &mut node.properties {
        p.name = upgraded(&p.name);
    }
    for child in &mut node.children {
        let (Inside::Node(Node { name, .. }) | Inside::Reference { name, .. }) = &mut child.what;
        *name = name.as_deref().map(upgraded);
    }
    let names = ["uscale", "vscale", "uoffset", "voffset"];
    let given: Vec<(usize, f64)> = node
        .properties
        .iter()
        .filter_map(|p| {
            let value = p.value.number()?;
            Some((names.iter().position(|n| *n == p.name)?, value))
        })
        .collect();
    if given.is_empty() {
        return;
    }
    let mut values = [1.0, 1.0, 0.0, 0.0];
    for (i, value) in given {
        values[i] = value;
    }
    let [us, vs, uo, vo] = values;
    let map =
        DAffine3::from_scale(DVec3::new(us, vs, 1.0)) * DAffine3::from_translation(DVec3::new(uo, vo, 0.0));
    node.properties.retain(|p| !names.contains(&p.name.as_str()));
    node.properties.push(Property::new("to_uv".into(), Value::Transform(map), node.span.clone()));
}

/// Returns Mitsuba's rotation matrix. Mitsuba does not normalize the axis, so the matrix is a
/// rotation only if the axis has length 1.
fn rotation(axis: DVec3, radians: f64) -> DMat3 {
    let (sin, cos) = radians.sin_cos();
    let cross = DMat3::from_cols(
        DVec3::new(0.0, axis.z, -axis.y),
        DVec3::new(-axis.z, 0.0, axis.x),
        DVec3::new(axis.y, -axis.x, 0.0),
    );
    let outer = DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
    DMat3::IDENTITY * cos + cross * sin + outer * (1.0 - cos)
}

/// Returns Mitsuba's default up direction for a device that points along `z` (Duff et al. 2017, "Building an
/// orthonormal basis, revisited").
fn any_up(z: DVec3) -> DVec3 {
    let sign = 1f64.copysign(z.z);
    let a = -1.0 / (sign + z.z);
    DVec3::new(1.0 + sign * z.x * z.x * a, sign * z.x * z.y * a, -sign * z.x)
}

/// State of the parser for an XML file and its included files.
pub(super) struct Reader<'s> {
    source: &'s Source,
    /// Byte offset of the file's first byte in the concatenated texts.
    start: usize,
    /// Nesting depth of the current file: 0 for the main file.
    depth: usize,
    pub parameters: BTreeMap<String, String>,
    /// Names of the parameters that attributes use.
    pub used: Vec<String>,
    /// Additional ids of elements.
    pub aliases: Vec<Alias>,
    pub folders: Folders,
    /// Notes for the user about contents whose interpretation may be unexpected.
    pub notes: Vec<String>,
    folder: PathBuf,
    /// Whether the current file has the format of Mitsuba 0.x, so that its names must be converted.
    old: bool,
}

impl<'s> Reader<'s> {
    /// Creates a reader. `given` contains the command-line parameters.
    pub fn new(source: &'s Source, given: &BTreeMap<String, String>, folders: Folders) -> Self {
        Self {
            source,
            start: 0,
            depth: 0,
            parameters: given.clone(),
            used: vec![],
            aliases: vec![],
            notes: vec![],
            folder: folders.find(""),
            folders,
            old: false,
        }
    }

    fn note(&mut self, text: &str) {
        if !self.notes.iter().any(|n| n == text) {
            self.notes.push(text.to_owned());
        }
    }

    /// Reads the Mitsuba version from a file's root element.
    pub fn version(&mut self, root: &roxmltree::Node) -> Result<(), InputError> {
        let version = root.attribute("version").unwrap_or_default();
        let major = version.split('.').next().and_then(|v| v.trim().parse::<u32>().ok());
        self.old = match major {
            Some(0 | 1) => true,
            Some(2 | 3) => false,
            _ => {
                return Err(self.source.error(
                    &self.start_tag(root),
                    format!("unsupported Mitsuba version `{version}`"),
                    "give a scene of Mitsuba 0.x, 2 or 3 with its version, such as <scene version=\"3.0.0\">",
                ));
            }
        };
        if self.old {
            self.note("the file has the format of Mitsuba 0.x: names are converted as by Mitsuba 3, and the defaults of Mitsuba 3 apply");
        }
        Ok(())
    }

    fn moved(&self, range: Range<usize>) -> Range<usize> {
        self.start + range.start..self.start + range.end
    }

    /// Returns the byte range of an element's start tag, up to the first `>`.
    pub fn start_tag(&self, node: &roxmltree::Node) -> Range<usize> {
        let range = node.range();
        let text = node.document().input_text();
        let end = text[range.clone()].find('>').map_or(range.end, |i| range.start + i + 1);
        self.moved(range.start..end)
    }

    pub fn plugin(&mut self, xml: &roxmltree::Node, depth: usize) -> Result<Node, InputError> {
        let span = self.start_tag(xml);
        if depth > DEEPEST {
            bail!(
                self.source,
                &span,
                "elements are nested too deeply",
                "give elements an id, and refer to them with <ref>"
            );
        }
        let root = depth == 0;
        // An included file has its own root element.
        let of_file = xml.parent().is_none_or(|parent| parent.is_root());
        self.only(xml, if of_file { &["version", "type", "id", "name"] } else { &["type", "id", "name"] })?;
        let mut node = Node {
            tag: xml.tag_name().name().to_owned(),
            kind: if root { "scene".to_owned() } else { self.needed(xml, "type")? },
            id: self.attribute(xml, "id")?,
            name: self.attribute(xml, "name")?,
            span,
            properties: vec![],
            children: vec![],
            broken: false,
        };
        self.contents(xml, &mut node, depth)?;
        if self.old {
            upgrade(&mut node);
        }
        Ok(node)
    }

    /// Reads the contents of an element. Invalid children are reported and omitted.
    fn contents(&mut self, xml: &roxmltree::Node, node: &mut Node, depth: usize) -> Result<(), InputError> {
        for child in xml.children() {
            if child.is_text() && !child.text().unwrap_or_default().trim().is_empty() {
                return Err(self.source.error(
                    &self.moved(child.range()),
                    "unexpected text between elements",
                    "write values as attributes: value=\"…\"",
                ));
            }
            if child.is_element() {
                let read = self.inside(&child, node, depth);
                node.broken |= self.source.accept(read).is_none();
            }
        }
        Ok(())
    }

    /// Reads the elements of the file that an `<include>` names.
    fn include(&mut self, xml: &roxmltree::Node, node: &mut Node, depth: usize) -> Result<(), InputError> {
        let span = self.start_tag(xml);
        let name = self.needed(xml, "filename")?;
        if self.depth >= MOST_INCLUDES {
            return Err(self.source.error(
                &span,
                format!("includes are nested more than {MOST_INCLUDES} levels deep"),
                "remove circular includes, or nest fewer files",
            ));
        }
        // As in Mitsuba, search folders set in an included file apply only to the included file.
        let mut folders = self.folders.clone();
        folders.prepend(self.folder.clone());
        let path = folders.find(&name);
        let text = read_text(&path).map_err(|e| {
            self.source.error(
                &span,
                format!("cannot read {}: {e}", path.display()),
                "correct the file name; Sunstone searches next to the scene and in the folders of <path>",
            )
        })?;
        let start = self.source.add(&path, &text);
        let document = parse(self.source, start, &text)?;
        let root = document.root_element();
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let outer = (
            std::mem::replace(&mut self.folders, folders),
            std::mem::replace(&mut self.folder, folder),
            std::mem::replace(&mut self.start, start),
            self.old,
        );
        self.depth += 1;
        let done = self.included(&root, node, depth);
        self.depth -= 1;
        (self.folders, self.folder, self.start, self.old) = outer;
        done?;
        if let (Some(name), Some(Child { what: Inside::Node(child), .. })) =
            (self.attribute(xml, "name")?, node.children.last_mut())
        {
            child.name = Some(name);
        }
        Ok(())
    }

    /// Reads the root of an included file according to the file's version.
    fn included(&mut self, root: &roxmltree::Node, node: &mut Node, depth: usize) -> Result<(), InputError> {
        if root.attribute("version").is_some() {
            self.version(root)?;
        }
        if root.tag_name().name() == "scene" {
            self.contents(root, node, depth)
        } else {
            self.inside(root, node, depth)
        }
    }

    fn inside(&mut self, xml: &roxmltree::Node, node: &mut Node, depth: usize) -> Result<(), InputError> {
        let tag = xml.tag_name().name();
        let span = self.start_tag(xml);
        match tag {
            "default" => {
                self.only(xml, &["name", "value"])?;
                let (name, value) = (self.needed(xml, "name")?, self.needed(xml, "value")?);
                self.parameters.entry(name).or_insert(value);
            }
            "include" => {
                self.only(xml, &["filename", "name"])?;
                self.include(xml, node, depth)?;
            }
            "alias" => {
                self.only(xml, &["id", "as"])?;
                let (id, other) = (self.needed(xml, "id")?, self.needed(xml, "as")?);
                self.aliases.push(Alias { id, other, span });
            }
            "path" => {
                self.only(xml, &["value"])?;
                let name = self.needed(xml, "value")?;
                let own = self.folder.join(&name);
                let folder = if own.exists() { own } else { self.folders.find(&name) };
                if !folder.exists() {
                    return Err(self.source.error(
                        &span,
                        format!("the folder {} does not exist", folder.display()),
                        "correct the path, which is relative to the file that contains this element",
                    ));
                }
                self.folders.prepend(folder);
            }
            "ref" => {
                self.only(xml, &["id", "name"])?;
                let (id, name) = (self.needed(xml, "id")?, self.attribute(xml, "name")?);
                node.children.push(Child::new(Inside::Reference { id, name, span }));
            }
            "spectrum" if xml.attribute("type").is_none() => self.property(xml, node)?,
            "spectrum" | "texture" | "bsdf" | "shape" | "emitter" | "sensor" | "film" | "sampler"
            | "rfilter" | "integrator" | "medium" | "phase" | "volume" => {
                let inner = self.plugin(xml, depth + 1)?;
                node.broken |= inner.broken;
                node.children.push(Child::new(Inside::Node(inner)));
            }
            "float" | "integer" | "boolean" | "string" | "vector" | "point" | "rgb" | "transform" => {
                self.property(xml, node)?;
            }
            _ => {
                bail!(
                    self.source,
                    &span,
                    "unsupported element <{tag}>",
                    "replace this element with the elements that it contains"
                );
            }
        }
        Ok(())
    }

    fn property(&mut self, xml: &roxmltree::Node, node: &mut Node) -> Result<(), InputError> {
        let name = self.needed(xml, "name")?;
        let span = self.start_tag(xml);
        if node.properties.iter().any(|p| p.name == name) {
            return Err(self.source.error(
                &span,
                format!("duplicate `{name}`"),
                "remove one of the two elements",
            ));
        }
        let value = self.value(xml)?;
        node.properties.push(Property::new(name, value, span));
        Ok(())
    }

    fn value(&mut self, xml: &roxmltree::Node) -> Result<Value, InputError> {
        let tag = xml.tag_name().name();
        match tag {
            "vector" | "point" => {
                self.only(xml, &["name", "x", "y", "z", "value"])?;
                return Ok(Value::Vector(self.xyz(xml, None)?));
            }
            "transform" => {
                self.only(xml, &["name"])?;
                return self.transform(xml).map(Value::Transform);
            }
            _ => {}
        }
        if tag == "spectrum" && xml.attribute("filename").is_some() {
            self.only(xml, &["name", "filename"])?;
            let name = self.needed(xml, "filename")?;
            return self.spectrum_file(xml, &name).map(Value::Pairs);
        }
        self.only(xml, &["name", "value"])?;
        let text = self.needed(xml, "value")?;
        let wrong = |what: &str| {
            Err(self.source.error(
                &self.start_tag(xml),
                format!("`{text}` is {what}"),
                "correct the value of this element",
            ))
        };
        Ok(match tag {
            "integer" => match text.trim().parse() {
                Ok(v) => Value::Integer(v),
                Err(_) => return wrong("not an integer"),
            },
            "boolean" => match text.trim().to_ascii_lowercase().as_str() {
                "true" => Value::Boolean(true),
                "false" => Value::Boolean(false),
                _ => return wrong("not true or false"),
            },
            "string" => Value::Text(text),
            "rgb" if text.starts_with('#') => match hexadecimal(&text) {
                Some(rgb) => Value::Rgb(rgb),
                None => return wrong("not a colour of the form #rrggbb"),
            },
            "rgb" => match numbers(&text).as_deref() {
                Some([v]) => Value::Rgb([*v; 3]),
                Some([r, g, b]) => Value::Rgb([*r, *g, *b]),
                _ => return wrong("not one or three numbers"),
            },
            "spectrum" if text.contains(':') => match pairs(&text) {
                Some(pairs) => Value::Pairs(pairs),
                None => return wrong("not a list of pairs wavelength:value with increasing wavelengths"),
            },
            _ => match number(&text) {
                Some(v) => Value::Float(v),
                None => return wrong("not a number"),
            },
        })
    }

    /// Reads a file with one pair of wavelength and value per line. The character `#` starts a comment.
    fn spectrum_file(&self, xml: &roxmltree::Node, name: &str) -> Result<Vec<[f64; 2]>, InputError> {
        let path = self.folders.find(name);
        let wrong = |what: String| {
            let fix = "give one wavelength in nanometres and one value per line, with increasing wavelengths";
            self.source.error(&self.start_tag(xml), what, fix)
        };
        let text = read_text(&path).map_err(|e| wrong(format!("cannot read {}: {e}", path.display())))?;
        let lines = text.lines().map(|l| l.split('#').next().unwrap_or_default().trim());
        let pair = |line: &str| match numbers(line).as_deref() {
            Some(&[nm, value]) => Some([nm, value]),
            _ => None,
        };
        let pairs: Option<Vec<[f64; 2]>> = lines.filter(|l| !l.is_empty()).map(pair).collect();
        match pairs {
            Some(pairs) if !pairs.is_empty() && pairs.is_sorted_by(|a, b| a[0] < b[0]) => Ok(pairs),
            Some(pairs) if pairs.is_empty() => {
                Err(wrong(format!("the spectrum file {} contains no values", path.display())))
            }
            Some(_) => Err(wrong(format!("the wavelengths of {} do not increase", path.display()))),
            None => Err(wrong(format!(
                "{} is not a spectrum file: a line does not contain exactly two numbers",
                path.display()
            ))),
        }
    }

    /// Returns the product of the operations in a `<transform>`. Later operations apply after earlier
    /// operations.
    fn transform(&mut self, xml: &roxmltree::Node) -> Result<DAffine3, InputError> {
        let mut all = DAffine3::IDENTITY;
        for op in xml.children().filter(roxmltree::Node::is_element) {
            all = self.operation(&op)? * all;
        }
        if all.is_finite() {
            return Ok(all);
        }
        Err(self.source.error(
            &self.start_tag(xml),
            "the transform is not finite",
            "correct the numbers; axes and directions must not be zero",
        ))
    }

    fn operation(&mut self, op: &roxmltree::Node) -> Result<DAffine3, InputError> {
        let wrong = |reader: &Self, message: &str, fix: &str| {
            Err(reader.source.error(&reader.start_tag(op), message, fix))
        };
        Ok(match op.tag_name().name() {
            "translate" => {
                self.only(op, &["x", "y", "z", "value"])?;
                DAffine3::from_translation(self.xyz(op, Some(0.0))?)
            }
            "scale" => {
                self.only(op, &["x", "y", "z", "value"])?;
                DAffine3::from_scale(self.xyz(op, Some(1.0))?)
            }
            "rotate" => {
                self.only(op, &["x", "y", "z", "value", "angle"])?;
                let text = self.needed(op, "angle")?;
                let axis = self.xyz(op, Some(0.0))?;
                let Some(angle) = number(&text) else {
                    let message = format!("the angle of the rotation is `{text}`, which is not a number");
                    return wrong(self, &message, "give the angle in degrees");
                };
                if axis == DVec3::ZERO {
                    return wrong(self, "the rotation has no axis: x, y and z are 0", "give x, y and z");
                }
                if (axis.length() - 1.0).abs() > 1e-4 {
                    self.note(
                        "the axis of a <rotate> is not a unit vector: the transform contains scale and shear, as in Mitsuba 3",
                    );
                }
                DAffine3::from_mat3(rotation(axis, angle.to_radians()))
            }
            "lookAt" if !self.old => {
                return wrong(self, "a transform cannot contain <lookAt>", "write <lookat>");
            }
            "lookat" | "lookAt" => {
                self.only(op, &["origin", "target", "up"])?;
                let origin = self.triple(op, "origin")?;
                let target = self.triple(op, "target")?;
                let forward = (target - origin).try_normalize();
                let up = match op.attribute("up") {
                    Some(_) => self.triple(op, "up")?,
                    None => DVec3::ZERO,
                };
                let up = match forward {
                    Some(forward) if up == DVec3::ZERO => any_up(forward),
                    _ => up,
                };
                // Mitsuba's x axis points left.
                let left = forward.and_then(|f| up.cross(f).try_normalize());
                let (Some(forward), Some(left)) = (forward, left) else {
                    return wrong(
                        self,
                        match forward {
                            None => "the target of lookat is equal to the origin",
                            Some(_) => "the vector up of lookat is parallel to the viewing direction",
                        },
                        "target must differ from origin, and up must not be parallel to the viewing direction",
                    );
                };
                let up = forward.cross(left);
                DAffine3::from_mat3_translation(DMat3::from_cols(left, up, forward), origin)
            }
            "matrix" => {
                self.only(op, &["value"])?;
                let text = self.needed(op, "value")?;
                match numbers(&text).as_deref() {
                    Some(&[a, b, c, d, e, f, g, h, i]) => {
                        DAffine3::from_mat3(DMat3::from_cols_array(&[a, b, c, d, e, f, g, h, i]).transpose())
                    }
                    Some(&[a, b, c, x, d, e, f, y, g, h, i, z, l0, l1, l2, l3])
                        if [l0, l1, l2, l3] == [0.0, 0.0, 0.0, 1.0] =>
                    {
                        DAffine3::from_mat3_translation(
                            DMat3::from_cols_array(&[a, b, c, d, e, f, g, h, i]).transpose(),
                            DVec3::new(x, y, z),
                        )
                    }
                    _ => {
                        return wrong(
                            self,
                            "the matrix is not affine",
                            "give 9 numbers, or 16 with the last row 0 0 0 1",
                        );
                    }
                }
            }
            other => {
                let message = format!("a transform cannot contain <{other}>");
                return wrong(self, &message, "use translate, rotate, scale, matrix or lookat");
            }
        })
    }

    /// Reads a vector from the attributes `x`, `y`, `z`, or from one or three numbers in `value`.
    fn xyz(&mut self, xml: &roxmltree::Node, missing: Option<f64>) -> Result<DVec3, InputError> {
        if xml.attribute("value").is_some() {
            return self.triple(xml, "value");
        }
        let mut out = [0.0; 3];
        for (slot, key) in out.iter_mut().zip(["x", "y", "z"]) {
            let text = self.attribute(xml, key)?;
            *slot = match (text.as_deref().map(number), missing) {
                (Some(Some(v)), _) | (None, Some(v)) => v,
                _ => {
                    return Err(self.source.error(
                        &self.start_tag(xml),
                        format!("`{key}` is not a number"),
                        "give x, y and z, or value=\"x, y, z\"",
                    ));
                }
            };
        }
        Ok(DVec3::from_array(out))
    }

    fn triple(&mut self, xml: &roxmltree::Node, key: &str) -> Result<DVec3, InputError> {
        let text = self.needed(xml, key)?;
        match numbers(&text).as_deref() {
            Some(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
            Some(&[v]) => Ok(DVec3::splat(v)),
            _ => Err(self.source.error(
                &self.start_tag(xml),
                format!("`{text}` is not a list of three numbers"),
                "give x, y, z",
            )),
        }
    }

    /// Returns the value of an attribute after replacing each `$name` by the value of the parameter. If
    /// several parameter names match, the longest is used. A backslash escapes the dollar sign.
    fn attribute(&mut self, xml: &roxmltree::Node, key: &str) -> Result<Option<String>, InputError> {
        let Some(text) = xml.attribute(key) else {
            return Ok(None);
        };
        let mut out = String::new();
        let mut rest = text;
        while let Some(at) = rest.find('$') {
            let before = &rest[..at];
            rest = &rest[at + 1..];
            if let Some(escaped) = before.strip_suffix('\\') {
                out.push_str(escaped);
                out.push('$');
                continue;
            }
            out.push_str(before);
            let known = self.parameters.iter().filter(|(name, _)| rest.starts_with(name.as_str()));
            let Some((name, value)) = known.max_by_key(|(name, _)| name.len()) else {
                return Err(self.source.error(
                    &self.start_tag(xml),
                    format!("`{text}` uses an undefined parameter"),
                    "define the parameter with -D name=value, or add <default name=\"…\" value=\"…\"/> before this element",
                ));
            };
            out.push_str(value);
            rest = &rest[name.len()..];
            self.used.push(name.clone());
        }
        out.push_str(rest);
        Ok(Some(out))
    }

    fn needed(&mut self, xml: &roxmltree::Node, key: &str) -> Result<String, InputError> {
        let value = self.attribute(xml, key)?.filter(|v| !v.is_empty());
        value.ok_or_else(|| {
            let tag = xml.tag_name().name();
            self.source.error(
                &self.start_tag(xml),
                format!("<{tag}> requires the attribute `{key}`"),
                "add this attribute to the element",
            )
        })
    }

    fn only(&self, xml: &roxmltree::Node, known: &[&str]) -> Result<(), InputError> {
        match xml.attributes().find(|a| !known.contains(&a.name())) {
            None => Ok(()),
            Some(other) => Err(self.source.error(
                &self.moved(other.range()),
                format!("unknown attribute `{1}` of <{0}>", xml.tag_name().name(), other.name()),
                &format!("use one of: {}", known.join(", ")),
            )),
        }
    }
}
