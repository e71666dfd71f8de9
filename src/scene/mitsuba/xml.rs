//! Writes XML elements of Mitsuba scene files as text (W3C, Extensible Markup Language 1.0, 5th ed.).

use glam::DAffine3;
use std::fmt::Write;

/// An XML element with its attributes, in order, and its contents.
#[derive(Clone, Debug)]
pub(super) struct Element {
    tag: &'static str,
    attributes: Vec<(&'static str, String)>,
    inside: Vec<Node>,
}

#[derive(Clone, Debug)]
enum Node {
    Element(Element),
    Comment(String),
}

impl Element {
    pub fn new(tag: &'static str) -> Self {
        Self { tag, attributes: vec![], inside: vec![] }
    }

    /// Creates the element of a plugin, whose attribute `type` is `kind`.
    pub fn plugin(tag: &'static str, kind: &str) -> Self {
        Self::new(tag).with("type", kind)
    }

    pub fn with(mut self, key: &'static str, value: impl Into<String>) -> Self {
        let value = value.into();
        match self.attributes.iter_mut().find(|(known, _)| *known == key) {
            Some((_, old)) => *old = value,
            None => self.attributes.push((key, value)),
        }
        self
    }

    pub fn push(&mut self, child: Self) {
        self.inside.push(Node::Element(child));
    }

    pub fn child(mut self, child: Self) -> Self {
        self.push(child);
        self
    }

    pub fn comment(&mut self, text: impl Into<String>) {
        self.inside.push(Node::Comment(text.into()));
    }

    /// Adds a child `<tag name="…" value="…"/>`.
    pub fn property(self, tag: &'static str, name: &str, value: impl ToString) -> Self {
        self.child(Self::new(tag).with("name", name).with("value", value.to_string()))
    }

    pub fn float(self, name: &str, value: f64) -> Self {
        self.property("float", name, number(value))
    }

    pub fn integer(self, name: &str, value: impl ToString) -> Self {
        self.property("integer", name, value)
    }

    pub fn boolean(self, name: &str, value: bool) -> Self {
        self.property("boolean", name, value)
    }

    pub fn string(self, name: &str, value: &str) -> Self {
        self.property("string", name, value)
    }

    /// Adds a child `<transform>` with the row-major matrix of an affine map.
    pub fn transform(self, name: &str, map: &DAffine3) -> Self {
        let m = map.matrix3;
        let mut value = String::new();
        for row in 0..3 {
            for column in [m.x_axis, m.y_axis, m.z_axis, map.translation] {
                value += &number(column[row]);
                value.push(' ');
            }
        }
        value += "0 0 0 1";
        let matrix = Self::new("matrix").with("value", value);
        self.child(Self::new("transform").with("name", name).child(matrix))
    }

    pub fn document(&self) -> String {
        let mut out = String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n");
        self.write(0, &mut out);
        out
    }

    fn write(&self, depth: usize, out: &mut String) {
        let indent = "    ".repeat(depth);
        // Writing to a String cannot fail.
        let _ = write!(out, "{indent}<{}", self.tag);
        for (key, value) in &self.attributes {
            let _ = write!(out, " {key}=\"{}\"", escape(value));
        }
        if self.inside.is_empty() {
            out.push_str("/>\n");
            return;
        }
        out.push_str(">\n");
        for node in &self.inside {
            match node {
                Node::Element(child) => child.write(depth + 1, out),
                Node::Comment(text) => {
                    let _ = writeln!(out, "{indent}    <!-- {} -->", comment(text));
                }
            }
        }
        let _ = writeln!(out, "{indent}</{}>", self.tag);
    }
}

/// Returns the shortest decimal representation of an f64 that round-trips.
pub(super) fn number(value: f64) -> String {
    // Print -0 as 0 for readability.
    format!("{:?}", value + 0.0).trim_end_matches(".0").to_owned()
}

/// Returns the shortest decimal representation of an f32 that round-trips.
pub(super) fn single(value: f32) -> String {
    format!("{:?}", value + 0.0).trim_end_matches(".0").to_owned()
}

/// Escapes markup in an attribute value and replaces characters that XML does not allow.
fn escape(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' | '\r' | '\t' => out.push(' '),
            c if !legal(c) => out.push('_'),
            c => out.push(c),
        }
    }
    out
}

/// Makes the text of a comment valid. An XML comment must not contain two adjacent hyphens or end with a
/// hyphen. The caller adds a space after the text.
fn comment(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        if c == '-' && out.ends_with('-') {
            out.push(' ');
        }
        out.push(if legal(c) { c } else { '_' });
    }
    out
}

fn legal(c: char) -> bool {
    !(c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}'))
}
