//! Represents the contents of a Mitsuba scene as plugins with typed properties. Each property has a location.
//!
//! Properties are requested by name. A property that is never requested is an error
//! ([`Node::finish`]), so no property is ignored silently.

use super::source::Source;
use base::locate::{InputError, Located};
use glam::{DAffine3, DVec3};
use std::cell::Cell;
use std::ops::Range;

#[derive(Clone, Debug)]
pub(super) enum Value {
    Float(f64),
    Integer(i64),
    Boolean(bool),
    Text(String),
    Vector(DVec3),
    Rgb([f64; 3]),
    /// Pairs of a wavelength in nanometres and a value, in order of increasing wavelength.
    Pairs(Vec<[f64; 2]>),
    Transform(DAffine3),
}

impl Value {
    /// Returns the value of a float or an integer, or `None` for other types.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Float(v) => Some(*v),
            Self::Integer(v) => Some(*v as f64),
            _ => None,
        }
    }
}

#[derive(Debug)]
pub(super) struct Property {
    pub name: String,
    pub value: Value,
    pub span: Range<usize>,
    used: Cell<bool>,
}

/// A plugin, that is, an XML element with a type.
#[derive(Debug)]
pub(super) struct Node {
    /// XML tag, such as `bsdf` or `shape`.
    pub tag: String,
    /// The value of `type`, or `scene` for the root.
    pub kind: String,
    pub id: Option<String>,
    pub name: Option<String>,
    pub span: Range<usize>,
    pub(super) properties: Vec<Property>,
    pub(super) children: Vec<Child>,
    /// Whether a part of the plugin could not be read. The error has been reported.
    pub broken: bool,
}

#[derive(Debug)]
pub(super) struct Child {
    pub what: Inside,
    used: Cell<bool>,
}

#[derive(Debug)]
pub(super) enum Inside {
    Node(Node),
    Reference { id: String, name: Option<String>, span: Range<usize> },
}

pub(super) fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

/// Returns the words of a text, which are separated by spaces or commas.
fn tokens(text: &str) -> impl Iterator<Item = &str> {
    text.split([' ', ',', '\t', '\n', '\r']).filter(|t| !t.is_empty())
}

/// Parses numbers separated by spaces or commas. Returns `None` if a word is not a number.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    tokens(text).map(number).collect()
}

pub(super) fn pairs(text: &str) -> Option<Vec<[f64; 2]>> {
    let pair = |t: &str| {
        let (nm, v) = t.split_once(':')?;
        Some([number(nm)?, number(v)?])
    };
    let pairs: Vec<[f64; 2]> = tokens(text).map(pair).collect::<Option<_>>()?;
    pairs.is_sorted_by(|a, b| a[0] < b[0]).then_some(pairs)
}

impl Property {
    pub fn new(name: String, value: Value, span: Range<usize>) -> Self {
        Self { name, value, span, used: Cell::new(false) }
    }
}

impl Node {
    /// Returns a property by name and marks it as used.
    pub fn get(&self, name: &str) -> Option<&Property> {
        let found = self.properties.iter().find(|p| p.name == name)?;
        found.used.set(true);
        Some(found)
    }

    /// Returns the value of a property, converted by `convert`. Messages contain `wanted`, a description of
    /// the values that `convert` accepts.
    fn typed<'a, T>(
        &'a self,
        source: &Source,
        name: &str,
        wanted: &str,
        convert: impl Fn(&'a Value) -> Option<T>,
    ) -> Result<Option<T>, InputError> {
        let Some(p) = self.get(name) else {
            return Ok(None);
        };
        convert(&p.value).map(Some).ok_or_else(|| {
            let message = format!(
                "the value of `{}` of {} `{}` has the wrong type: expected {wanted}",
                p.name, self.tag, self.kind
            );
            source.error(&p.span, message, "correct the name or the value of the element")
        })
    }

    pub fn float(&self, source: &Source, name: &str) -> Result<Option<f64>, InputError> {
        self.typed(source, name, "a number", Value::number)
    }

    pub fn integer(&self, source: &Source, name: &str) -> Result<Option<i64>, InputError> {
        self.typed(source, name, "an integer", |v| if let Value::Integer(v) = v { Some(*v) } else { None })
    }

    pub fn boolean(&self, source: &Source, name: &str) -> Result<Option<bool>, InputError> {
        self.typed(source, name, "true or false", |v| if let Value::Boolean(v) = v { Some(*v) } else { None })
    }

    pub fn text(&self, source: &Source, name: &str) -> Result<Option<&str>, InputError> {
        self.typed(source, name, "a string", |v| if let Value::Text(v) = v { Some(v.as_str()) } else { None })
    }

    pub fn vector(&self, source: &Source, name: &str) -> Result<Option<DVec3>, InputError> {
        self.typed(
            source,
            name,
            "a point or vector",
            |v| if let Value::Vector(v) = v { Some(*v) } else { None },
        )
    }

    pub fn transform(&self, source: &Source, name: &str) -> Result<Option<DAffine3>, InputError> {
        self.typed(source, name, "a transform", |v| if let Value::Transform(v) = v { Some(*v) } else { None })
    }

    /// Attaches the location of this plugin to a value.
    pub fn at<T>(&self, value: T) -> Located<T> {
        Located::at(self.span.clone(), value)
    }

    /// Returns a child by name and marks it as used.
    pub fn named(&self, name: &str) -> Option<&Child> {
        let found = self.children.iter().find(|c| c.name() == Some(name))?;
        found.used.set(true);
        Some(found)
    }

    /// Returns all children in order without marking them as used.
    pub fn children(&self) -> &[Child] {
        &self.children
    }

    /// Reports an error for each property and child that was not used. `ignored` lists names that have no
    /// effect.
    pub fn finish(&self, source: &Source, ignored: &[&str]) {
        let unknown = |name: &str, span: &Range<usize>| {
            source.report(source.error(
                span,
                format!("unsupported parameter `{name}` of {} `{}`", self.tag, self.kind),
                "remove the parameter, or export the scene without this parameter",
            ));
        };
        for p in &self.properties {
            if !p.used.get() && !ignored.contains(&p.name.as_str()) {
                unknown(&p.name, &p.span);
            }
        }
        for c in &self.children {
            if !c.used.get() {
                unknown(c.name().unwrap_or(c.tag()), c.span());
            }
        }
    }

    /// Calls `found` for this plugin and then for all plugins nested in it.
    pub fn walk<'a>(&'a self, found: &mut impl FnMut(&'a Self)) {
        found(self);
        for child in &self.children {
            if let Inside::Node(node) = &child.what {
                node.walk(found);
            }
        }
    }
}

impl Child {
    pub fn new(what: Inside) -> Self {
        Self { what, used: Cell::new(false) }
    }

    pub fn take(&self) -> &Inside {
        self.used.set(true);
        &self.what
    }

    pub fn name(&self) -> Option<&str> {
        match &self.what {
            Inside::Node(node) => node.name.as_deref(),
            Inside::Reference { name, .. } => name.as_deref(),
        }
    }

    /// Returns the tag of a plugin, or `ref` for a reference.
    pub fn tag(&self) -> &str {
        match &self.what {
            Inside::Node(node) => &node.tag,
            Inside::Reference { .. } => "ref",
        }
    }

    pub fn span(&self) -> &Range<usize> {
        match &self.what {
            Inside::Node(node) => &node.span,
            Inside::Reference { span, .. } => span,
        }
    }
}
