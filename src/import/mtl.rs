//! Parses MTL libraries of OBJ files (Wavefront; `Pr`, `Pm` and `norm` of the physically based extension).
//!
//! Meaning of the keys:
//!
//! - `Kd` is the albedo of the whole surface. `map_Kd` multiplies `Kd`, or is the albedo if `Kd` is absent.
//! - `Ks` makes a dielectric coat with reflectance 0.08 `Ks` at normal incidence, as in Blender's
//!   importer. `Ns` gives the coat's roughness. With `illum` 3 to 9 except 6 (ray-traced
//!   reflection) and without transparency, `Ks` is the reflectance of a mirror.
//!   Materials with `illum` 0 or 1 have no highlights.
//! - `d` (or 1 - `Tr`) is the share of the surface that is present. The remaining share is glass if `illum`
//!   is 4, 6, 7, 9 or absent and the refractive index `Ni` is not 1.

use super::appearance::{Appearance, Coat, Model, Opacity, Picture, Source};
use super::text;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use transport::material::texture::{Filter, Wrap};

/// Returns the library names of the `mtllib` lines of an OBJ file. A line can contain several
/// names, and names can contain spaces. For each line, the result lists two interpretations: the
/// line as one name, and one name per word.
pub fn libraries(obj: &[u8]) -> Vec<Vec<Vec<String>>> {
    let mut all: Vec<Vec<Vec<String>>> = vec![];
    for line in text::lines(&text::decode(obj)) {
        let line = line.split('#').next().unwrap_or("").trim();
        let Some((keyword, rest)) = line.split_once(char::is_whitespace) else {
            continue;
        };
        if !keyword.eq_ignore_ascii_case("mtllib") {
            continue;
        }
        let unquoted = |name: &str| name.trim().trim_matches('"').replace('\\', "/");
        let mut ways = vec![vec![unquoted(rest)]];
        let words: Vec<String> = rest.split_whitespace().map(unquoted).collect();
        if words.len() > 1 {
            ways.push(words);
        }
        if !all.contains(&ways) {
            all.push(ways);
        }
    }
    all
}

/// A material of a library: values by lower-case key.
struct Entry {
    name: String,
    /// Original spelling and value of each key, by lower-case key.
    keys: BTreeMap<String, (String, String)>,
    used: RefCell<BTreeSet<String>>,
}

impl Entry {
    /// Returns the value of a key and marks the key as used.
    fn text(&self, key: &str) -> Option<&str> {
        let (found, (_, value)) = self.keys.get_key_value(&key.to_lowercase())?;
        self.used.borrow_mut().insert(found.clone());
        Some(value)
    }

    fn numbers(&self, key: &str) -> Vec<f64> {
        let words = self.text(key).unwrap_or("").split_whitespace();
        words.map_while(|w| w.parse().ok()).filter(|v: &f64| v.is_finite()).collect()
    }

    fn number(&self, key: &str) -> Option<f64> {
        self.numbers(key).first().copied()
    }

    /// Returns the three numbers of a key. A single number is repeated three times.
    fn colour(&self, key: &str) -> Option<[f64; 3]> {
        let colour = match self.numbers(key)[..] {
            [r, g, b, ..] => [r, g, b],
            [grey] | [grey, _] => [grey; 3],
            [] => return None,
        };
        Some(colour.map(|v| v.clamp(0.0, 1.0)))
    }
}

pub fn parse(bytes: &[u8]) -> Vec<Appearance> {
    let mut all: Vec<Entry> = vec![];
    for line in text::lines(&text::decode(bytes)) {
        let line = line.split('#').next().unwrap_or("").trim();
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim().to_owned();
        match (key.to_lowercase().as_str(), all.last_mut()) {
            ("newmtl", _) => all.push(Entry { name: rest, keys: BTreeMap::new(), used: RefCell::default() }),
            (low, Some(entry)) if !key.is_empty() => {
                entry.keys.insert(low.to_owned(), (key.to_owned(), rest));
            }
            _ => {}
        }
    }
    all.iter().map(appearance).collect()
}

fn appearance(m: &Entry) -> Appearance {
    let mut out = Appearance::new(m.name.clone(), Model::Mtl);
    let illum = m.number("illum").map(|v| v as i64);
    out.image = m.text("map_Kd").and_then(|t| picture(t, &mut out.unused));
    let missing = if out.image.is_some() { 1.0 } else { 0.8 };
    out.base = m.colour("Kd").unwrap_or([missing; 3]);
    out.metallic = m.number("Pm").unwrap_or(0.0).clamp(0.0, 1.0);
    let index = m.number("Ni").filter(|n| *n > 0.0);
    out.ior = index.unwrap_or(1.5).clamp(1.0, 5.0);
    let roughness = m.number("Pr").map(|r| r * r);
    // Converts Blinn's exponent to Beckmann's α (Walter et al. 2007, sect. 5.1).
    let exponent = m.number("Ns").filter(|ns| *ns >= 0.0);
    let shine = exponent.map(|ns| (2.0 / (ns + 2.0)).sqrt());
    out.alpha = roughness.or(shine).unwrap_or(0.5).clamp(0.001, 1.0);
    opacity(m, illum, &mut out);
    let glossy = m.colour("Ks").filter(|_| !matches!(illum, Some(0 | 1)));
    let strongest = glossy.map_or(0.0, |s| s.into_iter().fold(0.0, f64::max));
    if let Some(colour) = glossy.filter(|_| strongest > 0.0) {
        let reflects =
            matches!(illum, Some(3 | 4 | 5 | 7 | 8 | 9)) && out.opacity == 1.0 && out.transmission == 0.0;
        if reflects {
            out.mirror = colour;
            let sum = [0, 1, 2].map(|i| colour[i] + out.base[i]);
            let most = sum.into_iter().fold(0.0, f64::max);
            if most > 1.0 {
                out.notes.push(format!("Kd + Ks is {most:.2}, above 1; Kd is reduced to conserve energy"));
                out.base = [0, 1, 2].map(|i| out.base[i].min(1.0 - colour[i]));
            }
        } else {
            out.coat = Some(Coat {
                ior: {
                    let root = (0.08 * strongest).sqrt();
                    (1.0 + root) / (1.0 - root)
                },
                colour: colour.map(|v| v / strongest),
            });
        }
    } else if roughness.is_some() {
        out.coat = Some(Coat { ior: out.ior.max(1.01), colour: [1.0; 3] });
    }
    out.normals = m.text("norm").and_then(|name| picture(name, &mut out.unused)).map(|p| (p, 1.0));
    // A black colour has no effect, and light transport has no ambient term.
    let silent = |key: &str| ["ka", "ke", "ks", "tf"].contains(&key) && m.colour(key) == Some([0.0; 3]);
    let white = |key: &str| key == "tf" && m.colour(key) == Some([1.0; 3]);
    let used = m.used.borrow().clone();
    for (low, (key, _)) in &m.keys {
        if !used.contains(low) && !silent(low) && !white(low) {
            out.unused.push(key.clone());
        }
    }
    out
}

/// Reads the transparency of a material: `d`, `Tr` and their images.
fn opacity(m: &Entry, illum: Option<i64>, out: &mut Appearance) {
    let (dissolve, transparent) = (m.number("d"), m.number("Tr"));
    let mut there = dissolve.or(transparent.map(|t| 1.0 - t)).unwrap_or(1.0).clamp(0.0, 1.0);
    if dissolve.is_none() && transparent == Some(1.0) && matches!(illum, Some(0..=2)) {
        out.notes
            .push("Tr is 1, but illum selects an opaque model: the material is imported as opaque".into());
        there = 1.0;
    }
    let image = m.text("map_d").and_then(|t| picture(t, &mut out.unused));
    let glass =
        matches!(illum, Some(4 | 6 | 7 | 9) | None) && m.number("Ni").is_some_and(|n| n > 0.0 && n != 1.0);
    if glass && there < 1.0 {
        out.transmission = 1.0 - there;
        out.refracts = true;
        out.alpha = 0.001;
    } else {
        out.opacity = there;
    }
    out.opacity_image = image.map(|p| (p, Opacity::First));
}

/// Parses an image name and the options before the name. Options other than `-o`, `-s` and `-clamp` are not
/// used.
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
                // Skip the word argument of options such as `-imfchan r` and `-type sphere`.
                next += usize::from(matches!(other, "-imfchan" | "-type" | "-blendu" | "-blendv" | "-cc"));
            }
        }
        i = next;
    }
    let name = words.get(i..)?.join(" ").replace('\\', "/");
    let name = name.trim_matches('"');
    let uv = [[scale[0], 0.0, move_[0]], [0.0, scale[1], move_[1]]];
    (!name.is_empty()).then(|| Picture {
        source: Source::File(name.to_owned()),
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
        let [wall, lacquer, gold, pane] = &all[..] else { panic!("{all:?}") };
        assert_eq!((wall.base, wall.coat), ([0.5, 0.25, 1.0], None));
        let image = wall.image.as_ref().expect("an image");
        assert_eq!(image.source, Source::File("wood grain.png".into()));
        assert_eq!((image.uv, image.wrap), (Some([[2.0, 0.0, 0.5], [0.0, 2.0, 0.0]]), Wrap::Clamp));
        assert_eq!(((lacquer.alpha * 1e6).round(), &lacquer.unused[..]), (1e5, &["map_Bump".to_owned()][..]));
        // The coat has reflectance 0.08 at normal incidence.
        let ior = lacquer.coat.expect("a coat").ior;
        assert!((((ior - 1.0) / (ior + 1.0)).powi(2) - 0.08).abs() < 1e-12);
        assert_eq!((gold.metallic, gold.alpha), (1.0, 0.25));
        assert_eq!(gold.unused, ["Ke"]);
        assert!((pane.transmission - 0.9).abs() < 1e-6 && pane.refracts && pane.opacity == 1.0);
    }

    /// Tests that a byte order mark, line endings, letter case and quotes have no effect, and that
    /// a line can name several libraries.
    #[test]
    fn spellings_of_other_programs_are_read() {
        let plain = parse(b"newmtl a\nKd .1 .2 .3\nillum 1\n");
        for text in [
            "\u{feff}newmtl a\nKd .1 .2 .3\nillum 1\n",
            "newmtl a\rKd .1 .2 .3\rillum 1\r",
            "newmtl a\r\n\tKD\t.1 .2 .3 # red\r\nillum 1",
            "NEWMTL a\nkd .1 .2 .3\nIllum 1",
        ] {
            assert_eq!(parse(text.as_bytes()), plain, "{text:?}");
        }
        assert_eq!(libraries(b"mtllibx\nmtllib a.mtl\nMTLLIB a.mtl\nv 0 0 0\n"), [[["a.mtl"]]]);
        assert_eq!(
            libraries("\u{feff}mtllib a b.mtl\r\n".as_bytes()),
            [vec![vec!["a b.mtl".to_owned()], vec!["a".into(), "b.mtl".into()]]]
        );
    }

    /// Tests that every key is used or listed as unused.
    #[test]
    fn every_key_is_accounted_for() {
        let material = |line: &str| parse(format!("newmtl a\nKd .5 .5 .5\n{line}\n").as_bytes()).remove(0);
        let bare = material("");
        let mut named = 0;
        let keys = "Kd Ks Ka Ke Tf Ns Ni d Tr illum sharpness map_Kd map_Ks map_Ka map_Ke map_Ns map_d \
                    map_Tr map_Bump map_bump bump disp decal refl norm Pr Pm Ps Pc Pcr aniso anisor \
                    map_Pr map_Pm map_Ps map_aat xyz Kx";
        for key in keys.split(' ') {
            let found = material(&format!("{key} .25 .25 .25"));
            let used = Appearance { unused: vec![], ..found.clone() } != bare;
            named += usize::from(found.unused.iter().any(|u| u == key));
            // Some keys have no effect alone, such as an index of refraction without glass.
            let silent = ["Ni", "illum", "map_Kd", "norm", "map_d"].contains(&key);
            assert!(used || found.unused.iter().any(|u| u == key) || silent, "{key}: {found:?}");
        }
        assert!(named > 20, "{named}");
    }

    /// Tests the transparency keys. MeshLab writes `Tr 1` for opaque materials, but `d` has the same meaning
    /// in all programs.
    #[test]
    fn transparency_follows_the_illumination_model() {
        let material = |text: &str| parse(format!("newmtl a\n{text}\n").as_bytes()).remove(0);
        assert_eq!(material("Tr 1.0\nillum 1").opacity, 1.0);
        assert_eq!(material("Tr 0.25\nillum 2").opacity, 0.75);
        assert_eq!(material("d .5").opacity, 0.5);
        assert_eq!(material("d .5").transmission, 0.0);
        let glass = material("d 0\nNi 1.5\nillum 6");
        assert_eq!((glass.opacity, glass.transmission, glass.refracts), (1.0, 1.0, true));
        assert_eq!(material("Kd 0 0 0\nKs 1 1 1\nillum 3").mirror, [1.0; 3]);
        assert_eq!(material("Kd .2 .2 .2\nKs 1 1 1\nillum 1").coat, None);
        assert_eq!(material("map_Kd a.png").base, [1.0; 3]);
        assert_eq!(material("illum 2").base, [0.8; 3]);
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "(newmtl|map_Kd|Kd|Ns|-o|-s|-clamp|-bm|norm|[ 0-9.\n-]|[a-z]){0,60}") {
            let _ = parse(text.as_bytes());
        }
    }
}
