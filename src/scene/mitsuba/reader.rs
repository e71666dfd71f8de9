//! Mitsuba 3's XML as a tree of plugins with typed properties, each with its place in the file.
//!
//! Follows Mitsuba's parser: `<default>` and `$name`, nested transforms (each operation acts after those before it),
//! values separated by spaces or commas. What nobody asked for by name is an error ([`Node::finish`]), so that nothing is
//! silently ignored.

use super::tree::{Child, Inside, Node, Property, Source, Value, number, numbers, pairs};
use base::locate::InputError;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

/// Deepest nesting of elements that is followed.
const DEEPEST: usize = 32;

/// The most elements, attributes and texts of a file.
const MOST_NODES: u32 = 4_000_000;

/// A whole file.
pub(super) struct Document {
    pub source: Source,
    pub scene: Node,
    /// Values of `<default>` and of the command line.
    pub parameters: BTreeMap<String, String>,
}

impl Document {
    /// Reads a file; `given` are the parameters of the command line, which win over `<default>`.
    ///
    /// # Errors
    /// [`InputError`] with the place.
    pub fn parse(file: &Path, text: &str, given: &BTreeMap<String, String>) -> Result<Self, InputError> {
        let source = Source {
            file: file.to_owned(),
            text: text.into(),
        };
        let options = roxmltree::ParsingOptions {
            nodes_limit: MOST_NODES,
            ..Default::default()
        };
        let xml = roxmltree::Document::parse_with_options(text, options).map_err(|e| {
            let at = offset(text, e.pos());
            let message = e.to_string();
            let message = message.split(" at ").next().unwrap_or(&message);
            source.error(
                &(at..at),
                format!("this is no XML: {message}"),
                "mend the file; Mitsuba's documentation shows its form",
            )
        })?;
        let mut reader = Reader {
            source: &source,
            parameters: given.clone(),
            used: vec![],
        };
        let root = xml.root_element();
        if root.tag_name().name() != "scene" {
            return Err(source.error(
                &start_tag(&root),
                format!("the file holds <{}>, not <scene>", root.tag_name().name()),
                "give the file of a whole scene",
            ));
        }
        let version = root.attribute("version").unwrap_or_default();
        if !(version.starts_with("3.") || version.starts_with("2.")) {
            return Err(source.error(
                &start_tag(&root),
                format!("the file is of Mitsuba's version `{version}`"),
                "give a scene of Mitsuba 3; older ones name their parameters otherwise",
            ));
        }
        let scene = reader.plugin(&root, 0)?;
        if let Some(name) = given.keys().find(|name| !reader.used.contains(*name)) {
            let known = RESERVED.contains(&name.as_str());
            if !known {
                return Err(source.error(
                    &start_tag(&root),
                    format!("nothing in the file uses the parameter `{name}`"),
                    "correct the name after -D, or leave it out",
                ));
            }
        }
        let parameters = reader.parameters;
        Ok(Self {
            source,
            scene,
            parameters,
        })
    }
}

/// Parameters that mean something to us without being used in the file.
const RESERVED: [&str; 2] = [super::names::WAVELENGTHS, super::names::PROJECTOR_RESOLUTION];

/// Byte of a line and a column (from 1, in characters).
fn offset(text: &str, pos: roxmltree::TextPos) -> usize {
    let mut line_start = 0;
    for _ in 1..pos.row {
        match text[line_start..].find('\n') {
            Some(end) => line_start += end + 1,
            None => return text.len(),
        }
    }
    let column = pos.col.saturating_sub(1) as usize;
    text[line_start..]
        .char_indices()
        .nth(column)
        .map_or(text.len(), |(i, _)| line_start + i)
}

/// Where an element begins, as far as the first `>`.
fn start_tag(node: &roxmltree::Node) -> Range<usize> {
    let range = node.range();
    let text = node.document().input_text();
    let end = text[range.clone()]
        .find('>')
        .map_or(range.end, |i| range.start + i + 1);
    range.start..end
}

struct Reader<'s> {
    source: &'s Source,
    parameters: BTreeMap<String, String>,
    /// Parameters that some attribute used.
    used: Vec<String>,
}

impl Reader<'_> {
    fn plugin(&mut self, xml: &roxmltree::Node, depth: usize) -> Result<Node, InputError> {
        let span = start_tag(xml);
        if depth > DEEPEST {
            return Err(self.source.error(
                &span,
                "elements are nested too deeply",
                "name them by id, and use <ref>",
            ));
        }
        let root = depth == 0;
        self.only(
            xml,
            if root {
                &["version", "type", "id", "name"]
            } else {
                &["type", "id", "name"]
            },
        )?;
        let mut node = Node {
            tag: xml.tag_name().name().to_owned(),
            kind: if root {
                "scene".to_owned()
            } else {
                self.needed(xml, "type")?
            },
            id: self.attribute(xml, "id")?,
            name: self.attribute(xml, "name")?,
            span,
            properties: vec![],
            children: vec![],
        };
        for child in xml.children() {
            if child.is_text() && !child.text().unwrap_or_default().trim().is_empty() {
                return Err(self.source.error(
                    &child.range(),
                    "there is text between the elements",
                    "values belong into attributes: value=\"…\"",
                ));
            }
            if child.is_element() {
                self.inside(&child, &mut node, depth)?;
            }
        }
        Ok(node)
    }

    fn inside(&mut self, xml: &roxmltree::Node, node: &mut Node, depth: usize) -> Result<(), InputError> {
        let tag = xml.tag_name().name();
        let span = start_tag(xml);
        match tag {
            "default" => {
                self.only(xml, &["name", "value"])?;
                let (name, value) = (self.needed(xml, "name")?, self.needed(xml, "value")?);
                self.parameters.entry(name).or_insert(value);
            }
            "ref" => {
                self.only(xml, &["id", "name"])?;
                let (id, name) = (self.needed(xml, "id")?, self.attribute(xml, "name")?);
                node.children
                    .push(Child::new(Inside::Reference { id, name, span }));
            }
            "spectrum" if xml.attribute("type").is_none() => self.property(xml, node)?,
            "spectrum" | "texture" | "bsdf" | "shape" | "emitter" | "sensor" | "film" | "sampler"
            | "rfilter" | "integrator" | "medium" | "phase" | "volume" => {
                let inner = self.plugin(xml, depth + 1)?;
                node.children.push(Child::new(Inside::Node(inner)));
            }
            "float" | "integer" | "boolean" | "string" | "vector" | "point" | "rgb" | "transform" => {
                self.property(xml, node)?;
            }
            _ => {
                return Err(self.source.error(
                    &span,
                    format!("sunstone cannot read <{tag}>"),
                    "put what it stands for into the file itself",
                ));
            }
        }
        Ok(())
    }

    fn property(&mut self, xml: &roxmltree::Node, node: &mut Node) -> Result<(), InputError> {
        let name = self.needed(xml, "name")?;
        let span = start_tag(xml);
        if node.properties.iter().any(|p| p.name == name) {
            return Err(self
                .source
                .error(&span, format!("`{name}` is given twice"), "keep one of the two"));
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
            return Err(self.source.error(
                &start_tag(xml),
                "sunstone does not read spectra from files",
                "give the pairs: value=\"400:0.1, 500:0.2, …\"",
            ));
        }
        self.only(xml, &["name", "value"])?;
        let text = self.needed(xml, "value")?;
        let wrong = |what: &str| {
            Err(self.source.error(
                &start_tag(xml),
                format!("`{text}` is {what}"),
                "correct the value",
            ))
        };
        Ok(match tag {
            "integer" => match text.trim().parse() {
                Ok(v) => Value::Integer(v),
                Err(_) => return wrong("not a whole number"),
            },
            "boolean" => match text.trim().to_ascii_lowercase().as_str() {
                "true" => Value::Boolean(true),
                "false" => Value::Boolean(false),
                _ => return wrong("neither true nor false"),
            },
            "string" => Value::Text(text),
            "rgb" => match numbers(&text).as_deref() {
                Some([v]) => Value::Rgb([*v; 3]),
                Some([r, g, b]) => Value::Rgb([*r, *g, *b]),
                _ => return wrong("neither one number nor three"),
            },
            "spectrum" if text.contains(':') => match pairs(&text) {
                Some(pairs) => Value::Pairs(pairs),
                None => return wrong("not a list of pairs wavelength:value with rising wavelengths"),
            },
            _ => match number(&text) {
                Some(v) => Value::Float(v),
                None => return wrong("not a number"),
            },
        })
    }

    /// The product of the operations inside; later ones act after earlier ones.
    fn transform(&mut self, xml: &roxmltree::Node) -> Result<DAffine3, InputError> {
        let mut all = DAffine3::IDENTITY;
        for op in xml.children().filter(roxmltree::Node::is_element) {
            all = self.operation(&op)? * all;
        }
        if all.is_finite() {
            return Ok(all);
        }
        Err(self.source.error(
            &start_tag(xml),
            "the transform is not finite",
            "correct its numbers; axes and directions must have a length",
        ))
    }

    fn operation(&mut self, op: &roxmltree::Node) -> Result<DAffine3, InputError> {
        let wrong = |reader: &Self, message: &str, mend: &str| {
            Err(reader.source.error(&start_tag(op), message, mend))
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
                let angle = self.needed(op, "angle")?;
                let (Some(axis), Some(angle)) = (self.xyz(op, Some(0.0))?.try_normalize(), number(&angle))
                else {
                    return wrong(
                        self,
                        "the rotation has no axis or no angle",
                        "give x, y, z and angle",
                    );
                };
                DAffine3::from_axis_angle(axis, angle.to_radians())
            }
            "lookat" => {
                self.only(op, &["origin", "target", "up"])?;
                let origin = self.triple(op, "origin")?;
                let target = self.triple(op, "target")?;
                let up = match op.attribute("up") {
                    Some(_) => self.triple(op, "up")?,
                    None => DVec3::ZERO,
                };
                let forward = (target - origin).try_normalize();
                // Mitsuba's x axis points left.
                let left = forward.and_then(|f| up.cross(f).try_normalize());
                let (Some(forward), Some(left)) = (forward, left) else {
                    return wrong(
                        self,
                        "lookat does not define a pose",
                        "target must differ from origin, and up must be given and not be parallel to the view",
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
                let message = format!("a transform cannot hold <{other}>");
                return wrong(self, &message, "use translate, rotate, scale, matrix or lookat");
            }
        })
    }

    /// `x`, `y`, `z`, or one or three numbers in `value`.
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
                        &start_tag(xml),
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
                &start_tag(xml),
                format!("`{text}` is not three numbers"),
                "give x, y, z",
            )),
        }
    }

    /// An attribute with `$name` replaced; longer names are tried first, a backslash keeps the dollar sign.
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
            let known = self
                .parameters
                .iter()
                .filter(|(name, _)| rest.starts_with(name.as_str()));
            let Some((name, value)) = known.max_by_key(|(name, _)| name.len()) else {
                return Err(self.source.error(
                    &start_tag(xml),
                    format!("`{text}` uses a parameter that has no value"),
                    "give it with -D name=value, or add <default name=\"…\" value=\"…\"/> before it",
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
                &start_tag(xml),
                format!("<{tag}> lacks the attribute `{key}`"),
                "add it",
            )
        })
    }

    fn only(&self, xml: &roxmltree::Node, known: &[&str]) -> Result<(), InputError> {
        match xml.attributes().find(|a| !known.contains(&a.name())) {
            None => Ok(()),
            Some(other) => Err(self.source.error(
                &other.range(),
                format!("<{}> has no attribute `{}`", xml.tag_name().name(), other.name()),
                &format!("use one of {}", known.join(", ")),
            )),
        }
    }
}
