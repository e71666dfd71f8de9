//! What a scene of Mitsuba holds: plugins with typed properties, each with its place in the file.
//!
//! Whoever understands a property asks for it by name. What nobody asked for is an error ([`Node::finish`]), so that nothing
//! is silently ignored.

use super::source::Source;
use base::locate::InputError;
use glam::{DAffine3, DVec3};
use std::cell::Cell;
use std::ops::Range;

/// A value of a property.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Float(f64),
    Integer(i64),
    Boolean(bool),
    Text(String),
    Vector(DVec3),
    Rgb([f64; 3]),
    /// Wavelengths in nanometres, rising, and values.
    Pairs(Vec<[f64; 2]>),
    Transform(DAffine3),
}

/// A property of a plugin.
#[derive(Debug)]
pub(super) struct Property {
    pub name: String,
    pub value: Value,
    pub span: Range<usize>,
    used: Cell<bool>,
}

/// A plugin: an element with a type.
#[derive(Debug)]
pub(super) struct Node {
    /// `bsdf`, `shape`, …
    pub tag: String,
    /// The value of `type`; that of the scene is `scene`.
    pub kind: String,
    pub id: Option<String>,
    pub name: Option<String>,
    pub span: Range<usize>,
    pub(super) properties: Vec<Property>,
    pub(super) children: Vec<Child>,
    /// Something in it could not be read, and has been reported.
    pub broken: bool,
}

/// What is inside of a plugin.
#[derive(Debug)]
pub(super) struct Child {
    pub what: Inside,
    used: Cell<bool>,
}

#[derive(Debug)]
pub(super) enum Inside {
    Node(Node),
    Reference {
        id: String,
        name: Option<String>,
        span: Range<usize>,
    },
}

/// A finite number.
pub(super) fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

/// Numbers with spaces or commas between them.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    let tokens = text.split([' ', ',', '\t', '\n', '\r']).filter(|t| !t.is_empty());
    tokens.map(number).collect()
}

pub(super) fn pairs(text: &str) -> Option<Vec<[f64; 2]>> {
    let tokens = text.split([' ', ',', '\t', '\n', '\r']).filter(|t| !t.is_empty());
    let pair = |t: &str| {
        let (nm, v) = t.split_once(':')?;
        Some([number(nm)?, number(v)?])
    };
    let pairs: Vec<[f64; 2]> = tokens.map(pair).collect::<Option<_>>()?;
    pairs.is_sorted_by(|a, b| a[0] < b[0]).then_some(pairs)
}

impl Property {
    /// Not used yet.
    pub fn new(name: String, value: Value, span: Range<usize>) -> Self {
        Self {
            name,
            value,
            span,
            used: Cell::new(false),
        }
    }
}

impl Node {
    /// A property by name, which counts as used from now on.
    pub fn get(&self, name: &str) -> Option<&Property> {
        let found = self.properties.iter().find(|p| p.name == name)?;
        found.used.set(true);
        Some(found)
    }

    fn mistyped<T>(&self, source: &Source, p: &Property, wanted: &str) -> Result<T, InputError> {
        let message = format!(
            "expected {wanted} for `{}` of {} `{}`",
            p.name, self.tag, self.kind
        );
        Err(source.error(&p.span, message, "correct the name or the value of the element"))
    }

    pub fn float(&self, source: &Source, name: &str) -> Result<Option<f64>, InputError> {
        match self.get(name) {
            None => Ok(None),
            Some(p) => match p.value {
                Value::Float(v) => Ok(Some(v)),
                Value::Integer(v) => Ok(Some(v as f64)),
                _ => self.mistyped(source, p, "a number"),
            },
        }
    }

    pub fn integer(&self, source: &Source, name: &str) -> Result<Option<i64>, InputError> {
        match self.get(name) {
            None => Ok(None),
            Some(p) => match p.value {
                Value::Integer(v) => Ok(Some(v)),
                _ => self.mistyped(source, p, "an integer"),
            },
        }
    }

    pub fn boolean(&self, source: &Source, name: &str) -> Result<Option<bool>, InputError> {
        match self.get(name) {
            None => Ok(None),
            Some(p) => match p.value {
                Value::Boolean(v) => Ok(Some(v)),
                _ => self.mistyped(source, p, "true or false"),
            },
        }
    }

    pub fn text(&self, source: &Source, name: &str) -> Result<Option<&str>, InputError> {
        match self.get(name) {
            None => Ok(None),
            Some(p) => match &p.value {
                Value::Text(v) => Ok(Some(v)),
                _ => self.mistyped(source, p, "a string"),
            },
        }
    }

    pub fn vector(&self, source: &Source, name: &str) -> Result<Option<DVec3>, InputError> {
        match self.get(name) {
            None => Ok(None),
            Some(p) => match p.value {
                Value::Vector(v) => Ok(Some(v)),
                _ => self.mistyped(source, p, "a point or vector"),
            },
        }
    }

    pub fn transform(&self, source: &Source, name: &str) -> Result<Option<DAffine3>, InputError> {
        match self.get(name) {
            None => Ok(None),
            Some(p) => match p.value {
                Value::Transform(v) => Ok(Some(v)),
                _ => self.mistyped(source, p, "a transform"),
            },
        }
    }

    /// What is inside under a name.
    pub fn named(&self, name: &str) -> Option<&Child> {
        let found = self.children.iter().find(|c| c.name() == Some(name))?;
        found.used.set(true);
        Some(found)
    }

    /// All that is inside, in order; nothing counts as used yet.
    pub fn children(&self) -> &[Child] {
        &self.children
    }

    /// Reports what the element has and nobody asked for, apart from what is known not to matter.
    pub fn finish(&self, source: &Source, ignored: &[&str]) {
        let unknown = |name: &str, span: &Range<usize>| {
            source.report(source.error(
                span,
                format!("unsupported parameter `{name}` of {} `{}`", self.tag, self.kind),
                "remove it, or export the scene without it",
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

    /// Gives every plugin with an id to `found`, this one first.
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
    /// Not used yet.
    pub fn new(what: Inside) -> Self {
        Self {
            what,
            used: Cell::new(false),
        }
    }

    /// Counts as used from now on.
    pub fn take(&self) -> &Inside {
        self.used.set(true);
        &self.what
    }

    /// The name under which it stands.
    pub fn name(&self) -> Option<&str> {
        match &self.what {
            Inside::Node(node) => node.name.as_deref(),
            Inside::Reference { name, .. } => name.as_deref(),
        }
    }

    /// The tag of a plugin, or `ref`.
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
