//! MTL libraries of OBJ files (Wavefront; `Pr`, `Pm` and `norm` of the physically based extension).

use super::appearance::{Appearance, Picture, Source};
use std::collections::BTreeMap;
use transport::material::texture::{Filter, Wrap};

/// Names of the libraries that an OBJ file refers to.
#[must_use]
pub fn libraries(obj: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(obj);
    let mut names: Vec<String> = text
        .lines()
        .filter_map(|line| line.trim().strip_prefix("mtllib"))
        .filter(|rest| rest.starts_with(char::is_whitespace))
        .map(|rest| rest.trim().to_owned())
        .collect();
    names.dedup();
    names
}

/// Whether vertices of an OBJ file have colours behind their coordinates.
#[must_use]
pub fn has_colours(obj: &[u8]) -> bool {
    let text = String::from_utf8_lossy(obj);
    let first = text.lines().find_map(|line| line.trim().strip_prefix("v "));
    first.is_some_and(|rest| rest.split_whitespace().count() >= 6)
}

/// What a library says of a material, by its keys.
struct Entry {
    name: String,
    keys: BTreeMap<String, String>,
}

impl Entry {
    fn numbers(&self, key: &str) -> Vec<f64> {
        let words = self.keys.get(key).map_or("", String::as_str).split_whitespace();
        words
            .map_while(|w| w.parse().ok())
            .filter(|v: &f64| v.is_finite())
            .collect()
    }

    fn number(&self, key: &str) -> Option<f64> {
        self.numbers(key).first().copied()
    }

    /// Three numbers, or one for all three.
    fn colour(&self, key: &str) -> Option<[f64; 3]> {
        let colour = match self.numbers(key)[..] {
            [r, g, b, ..] => [r, g, b],
            [grey] => [grey; 3],
            _ => return None,
        };
        Some(colour.map(|v| v.clamp(0.0, 1.0)))
    }

    /// The text of the first of these keys that is there.
    fn text(&self, keys: &[&str]) -> Option<&str> {
        keys.iter().find_map(|k| self.keys.get(*k)).map(String::as_str)
    }
}

/// The materials of a library. Not by `tobj`, which panics on numbers that are none.
#[must_use]
pub fn parse(bytes: &[u8]) -> Vec<Appearance> {
    let text = String::from_utf8_lossy(bytes);
    let mut all: Vec<Entry> = vec![];
    for line in text.lines() {
        let line = line.split('#').next().unwrap_or("").trim();
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim().to_owned();
        match (key, all.last_mut()) {
            ("newmtl", _) => all.push(Entry {
                name: rest,
                keys: BTreeMap::new(),
            }),
            (_, Some(entry)) if !key.is_empty() => {
                entry.keys.insert(key.to_owned(), rest);
            }
            _ => {}
        }
    }
    all.iter().map(appearance).collect()
}

fn appearance(m: &Entry) -> Appearance {
    let mut out = Appearance::new(m.name.clone());
    let glossy = m.colour("Ks").is_some_and(|s| s.iter().any(|v| *v > 0.0));
    out.base = m.colour("Kd").unwrap_or([0.8; 3]);
    out.image = m.text(&["map_Kd"]).and_then(|t| picture(t, &mut out.unused));
    out.metallic = m.number("Pm").unwrap_or(0.0).clamp(0.0, 1.0);
    out.ior = m.number("Ni").unwrap_or(1.5).clamp(1.0, 5.0);
    let roughness = m.number("Pr").map(|r| (r * r).clamp(0.001, 1.0));
    // Blinn's exponent to Beckmann's α (Walter et al. 2007, sect. 5.1).
    let exponent = m.number("Ns").filter(|ns| glossy && *ns >= 0.0);
    let alpha = exponent.map(|ns| (2.0 / (ns + 2.0)).sqrt().clamp(0.001, 1.0));
    out.alpha = roughness.or(alpha).or((out.metallic > 0.0).then_some(0.5));
    let dissolve = m.number("d").or(m.number("Tr").map(|t| 1.0 - t));
    out.transmission = 1.0 - dissolve.unwrap_or(1.0).clamp(0.0, 1.0);
    out.normals = m
        .text(&["norm"])
        .and_then(|name| picture(name, &mut out.unused))
        .map(|p| (p, 1.0));
    for key in [
        "map_Bump", "map_bump", "bump", "map_Ks", "map_Ns", "map_d", "map_Pr", "map_Pm", "disp",
    ] {
        if m.keys.contains_key(key) {
            out.unused.push(key.to_owned());
        }
    }
    if m.colour("Ke").is_some_and(|e| e != [0.0; 3]) {
        out.unused.push("Ke".to_owned());
    }
    out
}

/// An image with options before its name; those but `-o`, `-s` and `-clamp` are not used.
fn picture(text: &str, unused: &mut Vec<String>) -> Option<Picture> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let (mut i, mut wrap, mut move_, mut scale) = (0, Wrap::Repeat, [0.0; 2], [1.0; 2]);
    while let Some(option) = words.get(i).filter(|w| w.starts_with('-')) {
        let mut numbers = vec![];
        let mut next = i + 1;
        while let Some(v) = words.get(next).and_then(|w| w.parse::<f64>().ok()) {
            numbers.push(v);
            next += 1;
        }
        let two = |list: &[f64], missing: f64| [0, 1].map(|k| list.get(k).copied().unwrap_or(missing));
        match *option {
            "-o" => move_ = two(&numbers, 0.0),
            "-s" => scale = two(&numbers, 1.0),
            "-clamp" => {
                if words.get(next) == Some(&"on") {
                    wrap = Wrap::Clamp;
                }
                next += 1;
            }
            other => {
                unused.push(other.to_owned());
                // A word that is no number: of `-imfchan r` and `-type sphere`, but of no others.
                next += usize::from(matches!(
                    other,
                    "-imfchan" | "-type" | "-blendu" | "-blendv" | "-cc"
                ));
            }
        }
        i = next;
    }
    let name = words.get(i..)?.join(" ").replace('\\', "/");
    let uv = [[scale[0], 0.0, move_[0]], [0.0, scale[1], move_[1]]];
    (!name.is_empty()).then(|| Picture {
        source: Source::File(name),
        uv: (uv != [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).then_some(uv),
        wrap,
        filter: Filter::Bilinear,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_library_is_read() {
        let text = "newmtl wall\nKd 0.5 0.25 1\nmap_Kd -s 2 2 1 -o 0.5 0 0 -clamp on wood grain.png\n\
                    newmtl lacquer\nKd 1 0 0\nKs 1 1 1\nNs 198\nNi 1.6\nmap_Bump x.png\n\
                    newmtl gold\nKd 1 .8 .3\nPr 0.5\nPm 1\nKe 1 1 1\nnewmtl pane\nd 0.1\nillum 4\nNi 1.52\n";
        let all = parse(text.as_bytes());
        let [wall, lacquer, gold, pane] = &all[..] else {
            panic!("{all:?}")
        };
        assert_eq!((wall.base, wall.alpha), ([0.5, 0.25, 1.0], None));
        let image = wall.image.as_ref().expect("an image");
        assert_eq!(image.source, Source::File("wood grain.png".into()));
        assert_eq!(
            (image.uv, image.wrap),
            (Some([[2.0, 0.0, 0.5], [0.0, 2.0, 0.0]]), Wrap::Clamp)
        );
        assert_eq!(
            (lacquer.alpha.map(|a| (a * 1e6).round()), lacquer.unused.len()),
            (Some(1e5), 1)
        );
        assert!((lacquer.ior - 1.6).abs() < 1e-6);
        assert_eq!((gold.metallic, gold.alpha), (1.0, Some(0.25)));
        assert_eq!(gold.unused, ["Ke"]);
        assert!((pane.transmission - 0.9).abs() < 1e-6);
        assert_eq!(libraries(b"mtllib a b.mtl\nv 0 0 0\nmtllibx\n"), ["a b.mtl"]);
        assert!(has_colours(b"v 0 0 0 1 0 0\n") && !has_colours(b"v 0 0 0\n"));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "(newmtl|map_Kd|Kd|Ns|-o|-s|-clamp|-bm|norm|[ 0-9.\n-]|[a-z]){0,60}") {
            let _ = parse(text.as_bytes());
        }
    }
}
