//! MTL libraries of OBJ files (Wavefront; `Pr`, `Pm` and `norm` of the physically based extension).

use super::appearance::{Appearance, Picture, Source};
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

/// The materials of a library.
///
/// # Errors
/// Why it is none.
pub fn parse(bytes: &[u8]) -> Result<Vec<Appearance>, String> {
    let text = String::from_utf8_lossy(bytes);
    let (list, _) =
        tobj::load_mtl_buf(&mut text.as_bytes()).map_err(|e| format!("this is no MTL library: {e}"))?;
    Ok(list.iter().map(appearance).collect())
}

fn appearance(m: &tobj::Material) -> Appearance {
    let mut out = Appearance::new(m.name.clone());
    let number = |key: &str| {
        m.unknown_param
            .get(key)
            .and_then(|v| v.trim().parse::<f64>().ok())
    };
    let colour = |c: [f32; 3]| c.map(|v| f64::from(v).clamp(0.0, 1.0));
    let glossy = m.specular.is_some_and(|s| s.iter().any(|v| *v > 0.0));
    out.base = colour(m.diffuse.unwrap_or([0.8; 3]));
    out.image = m
        .diffuse_texture
        .as_deref()
        .and_then(|t| picture(t, &mut out.unused));
    out.metallic = number("Pm").unwrap_or(0.0).clamp(0.0, 1.0);
    out.ior = f64::from(m.optical_density.unwrap_or(1.5)).clamp(1.0, 5.0);
    let roughness = number("Pr").map(|r| (r * r).clamp(0.001, 1.0));
    // Blinn's exponent to Beckmann's α (Walter et al. 2007, sect. 5.1).
    let exponent = m.shininess.filter(|ns| glossy && *ns >= 0.0);
    let alpha = exponent.map(|ns| (2.0 / (f64::from(ns) + 2.0)).sqrt().clamp(0.001, 1.0));
    out.alpha = roughness.or(alpha).or((out.metallic > 0.0).then_some(0.5));
    let dissolve = f64::from(m.dissolve.unwrap_or(1.0)).clamp(0.0, 1.0);
    if matches!(m.illumination_model, Some(4 | 6 | 7 | 9)) || dissolve < 1.0 {
        out.transmission = 1.0 - dissolve;
    }
    let bump = m
        .normal_texture
        .as_deref()
        .or(m.unknown_param.get("norm").map(String::as_str));
    match bump {
        Some(name) if m.unknown_param.contains_key("norm") => {
            out.normals = picture(name, &mut out.unused).map(|p| (p, 1.0));
        }
        Some(_) => out.unused.push("map_Bump".into()),
        None => {}
    }
    let unread = [
        ("map_Ks", m.specular_texture.is_some()),
        ("map_Ns", m.shininess_texture.is_some()),
        ("map_d", m.dissolve_texture.is_some()),
        ("Ke", m.emissive.is_some_and(|e| e != [0.0; 3])),
    ];
    out.unused.extend(
        unread
            .iter()
            .filter(|(_, is)| *is)
            .map(|(name, _)| (*name).to_owned()),
    );
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
        let all = parse(text.as_bytes()).expect("reads");
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
