//! glTF's materials (specification, section 3.9; `KHR_materials_ior`, `_transmission`, `_unlit`; `KHR_texture_transform`).
//!
//! Its texture coordinates count from the image's upper left corner, v downward; ours from the lower left. Colours of factors
//! are linear, those of images sRGB-encoded.

use super::accessor::{broken, percent_decoded};
use super::appearance::{Appearance, Picture, Source};
use super::error::ImportError;
use super::gltf::container;
use gltf::json::Value;
use syntax::texture::UvRows;
use transport::material::texture::{Filter, Wrap};

/// The materials of a glTF document or GLB container, as its parts name them, and whether vertices have colours.
///
/// # Errors
/// [`ImportError`] if the file is broken.
pub fn appearances(bytes: &[u8]) -> Result<(Vec<Appearance>, bool), ImportError> {
    let (json, blob) = container(bytes)?;
    let root: Value = gltf::json::deserialize::from_slice(&json)
        .map_err(|e| broken(format!("the glTF JSON cannot be read ({e})")))?;
    let file = File {
        root: &root,
        blob: blob.as_deref(),
    };
    let list = items(&root, "materials").iter().enumerate();
    let all = list.map(|(i, m)| file.appearance(i, m)).collect();
    let coloured = items(&root, "meshes")
        .iter()
        .flat_map(|m| items(m, "primitives"))
        .any(|p| p["attributes"].get("COLOR_0").is_some());
    Ok((all, coloured))
}

fn items<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

fn number(value: &Value, missing: f64) -> f64 {
    value.as_f64().filter(|v| v.is_finite()).unwrap_or(missing)
}

struct File<'a> {
    root: &'a Value,
    blob: Option<&'a [u8]>,
}

impl File<'_> {
    fn appearance(&self, index: usize, m: &Value) -> Appearance {
        let name = m["name"]
            .as_str()
            .map_or_else(|| format!("material_{index}"), str::to_owned);
        let mut out = Appearance::new(name);
        let pbr = &m["pbrMetallicRoughness"];
        let factor = &pbr["baseColorFactor"];
        out.base = [0, 1, 2].map(|i| number(&factor[i], 1.0).clamp(0.0, 1.0));
        out.image = self.picture(&pbr["baseColorTexture"], "baseColorTexture", &mut out.unused);
        out.metallic = number(&pbr["metallicFactor"], 1.0).clamp(0.0, 1.0);
        let roughness = number(&pbr["roughnessFactor"], 1.0).clamp(0.0, 1.0);
        out.alpha = Some((roughness * roughness).max(0.001));
        if pbr.get("metallicRoughnessTexture").is_some() {
            out.unused.push("metallicRoughnessTexture".into());
        }
        let more = &m["extensions"];
        out.ior = number(&more["KHR_materials_ior"]["ior"], 1.5).clamp(1.0, 5.0);
        let glass = &more["KHR_materials_transmission"];
        out.transmission = number(&glass["transmissionFactor"], 0.0).clamp(0.0, 1.0);
        if glass.get("transmissionTexture").is_some() {
            out.unused.push("transmissionTexture".into());
        }
        let map = &m["normalTexture"];
        let strength = number(&map["scale"], 1.0).clamp(0.0, 100.0);
        out.normals = self
            .picture(map, "normalTexture", &mut out.unused)
            .map(|p| (p, strength));
        for key in ["occlusionTexture", "emissiveTexture"] {
            if m.get(key).is_some() {
                out.unused.push(key.into());
            }
        }
        if (0..3).any(|i| number(&m["emissiveFactor"][i], 0.0) > 0.0) {
            out.unused.push("emissiveFactor".into());
        }
        if m["alphaMode"].as_str().is_some_and(|mode| mode != "OPAQUE") {
            out.unused.push("alphaMode".into());
        }
        let read = ["KHR_materials_ior", "KHR_materials_transmission"];
        if let Some(extensions) = more.as_object() {
            let unread = extensions.keys().filter(|k| !read.contains(&k.as_str()));
            out.unused.extend(unread.cloned());
        }
        out
    }

    /// The image that a texture reference leads to.
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
                return data
                    .starts_with("image/")
                    .then_some(Source::Embedded(image, bytes));
            }
            return percent_decoded(uri).map(Source::File);
        }
        let view = &self.root["bufferViews"][usize::try_from(file["bufferView"].as_u64()?).ok()?];
        // Of images in bytes those of a GLB alone.
        if view["buffer"].as_u64()? != 0 {
            return None;
        }
        let at = |key: &str| usize::try_from(view[key].as_u64().unwrap_or(0)).ok();
        let (start, length) = (at("byteOffset")?, at("byteLength")?);
        let bytes = self.blob?.get(start..start.checked_add(length)?)?;
        Some(Source::Embedded(image, bytes.to_vec()))
    }
}

/// `KHR_texture_transform` on coordinates of which v runs the other way.
fn turned(t: &Value) -> Option<UvRows> {
    if t.is_null() {
        return None;
    }
    let two = |key: &str, missing: f64| [0, 1].map(|i| number(&t[key][i], missing));
    let ([ox, oy], [sx, sy]) = (two("offset", 0.0), two("scale", 1.0));
    let (sin, cos) = number(&t["rotation"], 0.0).sin_cos();
    // translation × rotation × scale of the extension's text, counter-clockwise in an upright image.
    let [[a, b, c], [d, e, f]] = [[cos * sx, sin * sy, ox], [-sin * sx, cos * sy, oy]];
    let rows = [[a, -b, b + c], [-d, e, 1.0 - e - f]];
    (rows != [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).then_some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(value: &serde_json::Value) -> Vec<Appearance> {
        appearances(value.to_string().as_bytes()).expect("reads").0
    }

    #[test]
    fn factors_and_defaults() {
        let all = read(&json!({"materials": [
            {},
            {"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.1, 0.2, 1], "metallicFactor": 0, "roughnessFactor": 0.5},
             "extensions": {"KHR_materials_ior": {"ior": 1.4}, "KHR_materials_clearcoat": {}}, "emissiveFactor": [0, 1, 0]},
        ]}));
        assert_eq!(
            (all[0].name.as_str(), all[0].metallic, all[0].alpha),
            ("material_0", 1.0, Some(1.0))
        );
        let red = &all[1];
        assert_eq!(
            (red.base, red.metallic, red.alpha, red.ior),
            ([0.8, 0.1, 0.2], 0.0, Some(0.25), 1.4)
        );
        assert_eq!(red.unused, ["emissiveFactor", "KHR_materials_clearcoat"]);
    }

    /// The extension's own example: an upright image turned by a quarter about its upper left corner.
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
        let all = read(
            &json!({"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 7}},
            "normalTexture": {"index": 0}}], "textures": [{"source": 9}]}),
        );
        assert!(all[0].image.is_none() && all[0].normals.is_none());
        assert_eq!(all[0].unused, ["baseColorTexture", "normalTexture"]);
    }
}
