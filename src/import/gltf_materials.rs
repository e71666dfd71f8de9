//! Reads glTF's materials (specification, section 3.9 and appendix B; `KHR_materials_ior`, `_transmission`,
//! `_volume`, `_pbrSpecularGlossiness`, `_unlit`; `KHR_texture_transform`). `_volume` determines whether a
//! surface refracts light, and has no other effect. All other keys of a material are listed as unused.
//!
//! glTF's texture coordinates start at the image's upper left corner, with v downward. Sunstone's texture
//! coordinates start at the lower left corner. Colour factors are linear, and colours of images are
//! sRGB-encoded.

use super::accessor::percent_decoded;
use super::appearance::{Appearance, Coat, Model, Opacity, Picture, Source};
use super::error::{ImportError, broken};
use super::gltf::container;
use gltf::json::Value;
use syntax::texture::UvRows;
use transport::material::texture::{Filter, Wrap};

/// Returns the materials of a glTF document or GLB container, with the names that the parts of the mesh use.
///
/// # Errors
/// Returns [`ImportError`] if the file is invalid.
pub fn appearances(bytes: &[u8]) -> Result<Vec<Appearance>, ImportError> {
    let (json, blob) = container(bytes)?;
    let root: Value = gltf::json::deserialize::from_slice(&json)
        .map_err(|e| broken(format!("cannot parse the glTF JSON ({e})")))?;
    let file = File { root: &root, blob: blob.as_deref() };
    let list = items(&root, "materials").iter().enumerate();
    let all = list.map(|(i, m)| file.appearance(i, m)).collect();
    Ok(all)
}

fn items<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

fn number(value: &Value, missing: f64) -> f64 {
    value.as_f64().filter(|v| v.is_finite()).unwrap_or(missing)
}

/// Keys of a material that are used or do not affect light. For example, `doubleSided` controls only culling
/// in rasterizers.
const MATERIAL: &[&str] = &[
    "name",
    "extras",
    "extensions",
    "pbrMetallicRoughness",
    "normalTexture",
    "alphaMode",
    "alphaCutoff",
    "doubleSided",
];

const METALLIC_ROUGHNESS: &[&str] =
    &["baseColorFactor", "baseColorTexture", "metallicFactor", "roughnessFactor", "metallicRoughnessTexture"];

const EXTENSIONS: &[&str] = &[
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
];

fn colour(value: &Value, missing: f64) -> [f64; 3] {
    [0, 1, 2].map(|i| number(&value[i], missing).clamp(0.0, 1.0))
}

/// Sets the reflectance at normal incidence, `f0`. If `f0` is within the range of glass, the reflectance
/// belongs to a coat, and otherwise to a mirror.
fn specular(f0: [f64; 3], out: &mut Appearance) {
    const MOST: f64 = 0.16;
    let strongest = f0.into_iter().fold(0.0, f64::max);
    out.coat = None;
    if strongest > MOST {
        out.mirror = f0;
        // The extension multiplies the diffuse colour by 1 minus the largest reflectance.
        out.base = out.base.map(|v| v * (1.0 - strongest));
    } else if strongest > 0.0 {
        let root = strongest.sqrt();
        out.ior = (1.0 + root) / (1.0 - root);
        out.coat = Some(Coat { ior: out.ior, colour: f0.map(|v| v / strongest) });
    }
}

struct File<'a> {
    root: &'a Value,
    blob: Option<&'a [u8]>,
}

impl File<'_> {
    fn appearance(&self, index: usize, m: &Value) -> Appearance {
        let name = m["name"].as_str().map_or_else(|| format!("material_{index}"), str::to_owned);
        let mut out = Appearance::new(name, Model::Gltf);
        let unused = &mut out.unused;
        let pbr = &m["pbrMetallicRoughness"];
        out.base = colour(&pbr["baseColorFactor"], 1.0);
        out.image = self.picture(&pbr["baseColorTexture"], "baseColorTexture", unused);
        out.metallic = number(&pbr["metallicFactor"], 1.0).clamp(0.0, 1.0);
        let mut roughness = number(&pbr["roughnessFactor"], 1.0).clamp(0.0, 1.0);
        out.metallic_roughness =
            self.picture(&pbr["metallicRoughnessTexture"], "metallicRoughnessTexture", unused);
        let mut opacity = number(&pbr["baseColorFactor"][3], 1.0);
        let more = &m["extensions"];
        let glossy = &more["KHR_materials_pbrSpecularGlossiness"];
        if glossy.is_object() {
            (out.metallic, out.metallic_roughness) = (0.0, None);
            out.base = colour(&glossy["diffuseFactor"], 1.0);
            opacity = number(&glossy["diffuseFactor"][3], 1.0);
            out.image = self.picture(&glossy["diffuseTexture"], "diffuseTexture", unused);
            roughness = 1.0 - number(&glossy["glossinessFactor"], 1.0).clamp(0.0, 1.0);
            specular(colour(&glossy["specularFactor"], 1.0), &mut out);
        } else {
            out.ior = number(&more["KHR_materials_ior"]["ior"], 1.5).clamp(1.0, 5.0);
            out.coat = Some(Coat { ior: out.ior, colour: [1.0; 3] });
        }
        out.alpha = (roughness * roughness).max(0.001);
        let unlit = more.get("KHR_materials_unlit").is_some();
        if unlit {
            (out.coat, out.metallic, out.metallic_roughness) = (None, 0.0, None);
            out.notes.push("KHR_materials_unlit is approximated by a diffuse surface".to_owned());
        }
        let glass = &more["KHR_materials_transmission"];
        out.transmission = number(&glass["transmissionFactor"], 0.0).clamp(0.0, 1.0);
        out.refracts = number(&more["KHR_materials_volume"]["thicknessFactor"], 0.0) > 0.0;
        match m["alphaMode"].as_str() {
            Some("BLEND") => out.opacity = opacity.clamp(0.0, 1.0),
            Some("MASK") => {
                let cutoff = number(&m["alphaCutoff"], 0.5);
                match &out.image {
                    Some(_) if opacity > 0.0 => {
                        out.opacity_image = out.image.clone().map(|p| (p, Opacity::Cut(cutoff / opacity)));
                    }
                    _ => out.opacity = f64::from(opacity >= cutoff),
                }
            }
            _ => {}
        }
        if m["alphaMode"] == "BLEND" {
            out.opacity_image = out.image.clone().map(|p| (p, Opacity::Alpha));
        }
        let unused = &mut out.unused;
        let map = &m["normalTexture"];
        let strength = number(&map["scale"], 1.0).clamp(0.0, 10.0);
        out.normals = self.picture(map, "normalTexture", unused).map(|p| (p, strength));
        let dark = (0..3).all(|i| number(&m["emissiveFactor"][i], 0.0) <= 0.0);
        for (place, known) in [
            (m, MATERIAL),
            (pbr, METALLIC_ROUGHNESS),
            (&more["KHR_materials_ior"], &["ior"]),
            (glass, &["transmissionFactor"]),
            (&more["KHR_materials_volume"], &["thicknessFactor"]),
            (glossy, &["diffuseFactor", "diffuseTexture", "specularFactor", "glossinessFactor"]),
            (more, EXTENSIONS),
        ] {
            for (key, _) in place.as_object().into_iter().flatten() {
                // A black emissive factor has no effect, even with an emissive image.
                let silent = dark && ["emissiveFactor", "emissiveTexture"].contains(&key.as_str());
                if !known.contains(&key.as_str()) && !silent {
                    unused.push(key.clone());
                }
            }
        }
        out
    }

    fn picture(&self, info: &Value, what: &str, unused: &mut Vec<String>) -> Option<Picture> {
        let texture = &self.root["textures"][usize::try_from(info["index"].as_u64()?).ok()?];
        let transform = &info["extensions"]["KHR_texture_transform"];
        let coordinates = transform.get("texCoord").or(info.get("texCoord"));
        let source = texture["source"].as_u64().and_then(|i| usize::try_from(i).ok());
        let source = source.and_then(|i| self.source(i));
        if coordinates.and_then(Value::as_u64).unwrap_or(0) != 0 || source.is_none() {
            unused.push(what.to_owned());
            return None;
        }
        let sampler = &self.root["samplers"][texture["sampler"].as_u64().map_or(usize::MAX, |i| i as usize)];
        for (key, _) in info["extensions"].as_object().into_iter().flatten() {
            if key != "KHR_texture_transform" {
                unused.push(format!("{key} of {what}"));
            }
        }
        let wrap = |key: &str| match sampler[key].as_u64() {
            Some(33071) => Wrap::Clamp,
            Some(33648) => Wrap::Mirror,
            _ => Wrap::Repeat,
        };
        if wrap("wrapS") != wrap("wrapT") {
            unused.push(format!("wrapT of {what}"));
        }
        Some(Picture {
            source: source?,
            uv: turned(transform),
            wrap: wrap("wrapS"),
            filter: match sampler["magFilter"].as_u64() {
                Some(9728) => Filter::Nearest,
                _ => Filter::Bilinear,
            },
        })
    }

    fn source(&self, image: usize) -> Option<Source> {
        let file = &self.root["images"][image];
        if let Some(uri) = file["uri"].as_str() {
            if let Some(data) = uri.strip_prefix("data:") {
                let source = gltf::buffer::Source::Uri(uri);
                let bytes = gltf::buffer::Data::from_source(source, None).ok()?.0;
                return data.starts_with("image/").then_some(Source::Embedded(image, bytes));
            }
            return percent_decoded(uri).map(Source::File);
        }
        let view = &self.root["bufferViews"][usize::try_from(file["bufferView"].as_u64()?).ok()?];
        // Embedded images are read from the GLB's buffer only.
        if view["buffer"].as_u64()? != 0 {
            return None;
        }
        let at = |key: &str| usize::try_from(view[key].as_u64().unwrap_or(0)).ok();
        let (start, length) = (at("byteOffset")?, at("byteLength")?);
        let bytes = self.blob?.get(start..start.checked_add(length)?)?;
        Some(Source::Embedded(image, bytes.to_vec()))
    }
}

/// Returns the map of `KHR_texture_transform` for texture coordinates whose v points up instead of down.
fn turned(t: &Value) -> Option<UvRows> {
    if t.is_null() {
        return None;
    }
    let two = |key: &str, missing: f64| [0, 1].map(|i| number(&t[key][i], missing));
    let ([ox, oy], [sx, sy]) = (two("offset", 0.0), two("scale", 1.0));
    let (sin, cos) = number(&t["rotation"], 0.0).sin_cos();
    // The extension specifies translation × rotation × scale, counter-clockwise in an upright image.
    let [[a, b, c], [d, e, f]] = [[cos * sx, sin * sy, ox], [-sin * sx, cos * sy, oy]];
    let rows = [[a, -b, b + c], [-d, e, 1.0 - e - f]];
    (rows != [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).then_some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(value: &serde_json::Value) -> Vec<Appearance> {
        appearances(value.to_string().as_bytes()).expect("reads")
    }

    #[test]
    fn factors_and_defaults() {
        let all = read(&json!({"materials": [
            {},
            {"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.1, 0.2, 1], "metallicFactor": 0, "roughnessFactor": 0.5},
             "extensions": {"KHR_materials_ior": {"ior": 1.4}, "KHR_materials_clearcoat": {}}, "emissiveFactor": [0, 1, 0]},
        ]}));
        assert_eq!((all[0].name.as_str(), all[0].metallic, all[0].alpha), ("material_0", 1.0, 1.0));
        let red = &all[1];
        assert_eq!((red.base, red.metallic, red.alpha, red.ior), ([0.8, 0.1, 0.2], 0.0, 0.25, 1.4));
        assert_eq!(red.unused, ["emissiveFactor", "KHR_materials_clearcoat"]);
    }

    /// Tests that every key is used or listed as unused.
    #[test]
    fn every_key_is_accounted_for() {
        let bare = read(&json!({"materials": [{}]})).remove(0);
        for (place, key, value) in [
            ("", "emissiveFactor", json!([1, 1, 1])),
            ("", "occlusionTexture", json!({"index": 0})),
            ("", "anything", json!(1)),
            ("pbrMetallicRoughness", "diffuseFactor", json!([1, 1, 1])),
            ("extensions", "KHR_materials_clearcoat", json!({})),
            ("extensions", "KHR_materials_sheen", json!({})),
            ("extensions", "KHR_materials_specular", json!({"specularFactor": 0})),
            ("extensions", "KHR_materials_unlit", json!({})),
            ("extensions", "KHR_materials_ior", json!({"ior": 1.2})),
            ("extensions", "KHR_materials_transmission", json!({"transmissionFactor": 1})),
            (
                "extensions",
                "KHR_materials_pbrSpecularGlossiness",
                json!({"diffuseFactor": [0.5, 0.5, 0.5, 1]}),
            ),
            ("", "alphaMode", json!("MASK")),
            ("pbrMetallicRoughness", "metallicFactor", json!(0)),
            ("pbrMetallicRoughness", "roughnessFactor", json!(0)),
            ("pbrMetallicRoughness", "baseColorFactor", json!([0.5, 0.5, 0.5, 0.5])),
        ] {
            let mut material = json!({});
            let target = if place.is_empty() { &mut material } else { &mut material[place] };
            target[key] = value;
            // A texture that the file lacks is also listed.
            let found = read(&json!({"materials": [material]})).remove(0);
            let changed = Appearance { unused: vec![], ..found.clone() } != bare;
            let named = found.unused.iter().any(|u| u == key);
            assert!(changed || named || key == "alphaMode", "{key}: {found:?}");
        }
    }

    /// Tests the example of the extension's specification: an upright image rotated by a quarter turn about
    /// the upper left corner.
    #[test]
    fn texture_transforms_are_those_of_the_upright_image() {
        let t = json!({"offset": [0.1, 0.2], "scale": [2, 3], "rotation": 0.5});
        let rows = turned(&t).expect("a map");
        for [u, v] in [[0.0, 0.0], [0.3, 0.9], [1.0, 0.4]] {
            let (s, c) = 0.5_f64.sin_cos();
            let (x, y) = (2.0 * u, 3.0 * v);
            let (tu, tv) = (c * x + s * y + 0.1, -s * x + c * y + 0.2);
            let ours = rows.map(|[a, b, c]| a * u + b * (1.0 - v) + c);
            assert!((ours[0] - tu).abs() < 1e-12 && (ours[1] - (1.0 - tv)).abs() < 1e-12);
        }
        assert_eq!(turned(&json!(null)), None);
        assert_eq!(turned(&json!({})), None);
    }

    #[test]
    fn broken_references_are_left_out() {
        let all = read(&json!({"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 7}},
            "normalTexture": {"index": 0}}], "textures": [{"source": 9}]}));
        assert!(all[0].image.is_none() && all[0].normals.is_none());
        assert_eq!(all[0].unused, ["baseColorTexture", "normalTexture"]);
    }
}
