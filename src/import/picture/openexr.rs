//! Decodes OpenEXR files and selects the image channels.
//!
//! The crate `image` is not used because its reader accepts only channels that are named exactly R, G and B.

use super::pixels::{PictureError, Pixels, pixel_count};
use super::primaries::{self, NoGamut};
use exr::prelude::{AnyChannel, FlatSamples, ReadChannels, ReadLayers, Vec2};
use std::collections::BTreeMap;
use std::io::Cursor;

/// Channels of a layer by key. The key is the last part of the channel's name in capitals: `R` for
/// `ViewLayer.Combined.R` and for `red`.
type Layer<'a> = BTreeMap<String, &'a FlatSamples>;

/// A layer of any part of the file, with the part's size in pixels.
struct Part<'a> {
    channels: Layer<'a>,
    size: [usize; 2],
}

pub(super) fn decode(bytes: &[u8], layer: Option<&str>) -> Result<Pixels, PictureError> {
    let headers = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false)
        .map_err(|e| PictureError::damaged("OpenEXR", e))?
        .headers;
    for header in &headers {
        if header.deep {
            return Err(PictureError::new(
                "the OpenEXR file has deep pixels",
                "flatten the image to one value per pixel",
            ));
        }
        pixel_count("OpenEXR", header.layer_size.0, header.layer_size.1)?;
        if let Some(channel) = header.channels.list.iter().find(|c| c.sampling != Vec2(1, 1)) {
            return Err(PictureError::new(
                format!("the OpenEXR channel `{}` is subsampled", channel.name),
                "export red, green and blue at full resolution",
            ));
        }
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| PictureError::damaged("OpenEXR", e))?;
    let mut notes = vec![];
    let mut layers: BTreeMap<String, Part> = BTreeMap::new();
    for part in &image.layer_data {
        let own = part.attributes.layer_name.as_ref().map(ToString::to_string);
        // Ignore the name of a single part, because many programs write a meaningless name.
        let own = own.filter(|_| image.layer_data.len() > 1).unwrap_or_default();
        let (origin, display) = (part.attributes.layer_position, image.attributes.display_window);
        if (origin, part.size) != (display.position, display.size) {
            let note =
                "the display window differs from the data window; the data window is used, as in Mitsuba";
            notes.push(note.to_owned());
        }
        for channel in &part.channel_data.list {
            let (prefix, last) = names(channel);
            let name = match (own.as_str(), prefix.as_str()) {
                (own, "") => own.to_owned(),
                ("", prefix) => prefix.to_owned(),
                (own, prefix) if prefix == own || prefix.starts_with(&format!("{own}.")) => prefix.to_owned(),
                (own, prefix) => format!("{own}.{prefix}"),
            };
            let known = layers
                .entry(name)
                .or_insert_with(|| Part { channels: Layer::new(), size: [part.size.0, part.size.1] });
            known.channels.insert(last, &channel.sample_data);
        }
    }
    notes.dedup();
    let name = choose(&layers, layer)?;
    let chosen = &layers[name];
    let (channels, is_xyz) = colours(name, &chosen.channels)?;
    if layers.len() > 1 && layer.is_none() {
        notes.push(format!("the file has {} layers; {} is used", layers.len(), described(name)));
    }
    let given = image
        .attributes
        .chromaticities
        .map(|c| [c.red, c.green, c.blue, c.white].map(|Vec2(x, y)| [f64::from(x), f64::from(y)]));
    let to_rgb = primaries::conversion(is_xyz, given).map_err(|NoGamut| {
        PictureError::damaged(
            "OpenEXR",
            "the primary colours in the attribute `chromaticities` are degenerate",
        )
    })?;
    // A single grey channel has no primaries.
    let to_rgb = to_rgb.filter(|_| channels.len() == 3);
    let [width, height] = chosen.size;
    let mut values = vec![[0.0; 3]; width * height];
    for (c, samples) in channels.iter().enumerate() {
        let all = match samples {
            FlatSamples::F16(v) => v.iter().map(|v| v.to_f32()).collect(),
            FlatSamples::F32(v) => v.clone(),
            FlatSamples::U32(_) => {
                return Err(PictureError::new(
                    format!(
                        "{} of the OpenEXR file has 32-bit integer channels (identifiers)",
                        described(name)
                    ),
                    "export the channels as half or float",
                ));
            }
        };
        for (pixel, v) in values.iter_mut().zip(all) {
            match channels.len() {
                1 => *pixel = [v; 3],
                _ => pixel[c] = v,
            }
        }
    }
    Ok(Pixels { width, height, values, encoded: false, to_rgb, notes })
}

/// Returns the layer of a channel, and the last part of the channel's name in capitals.
fn names(channel: &AnyChannel<FlatSamples>) -> (String, String) {
    let name = channel.name.to_string();
    let (layer, last) = name.rsplit_once('.').unwrap_or(("", &name));
    let last = match last.to_uppercase().as_str() {
        "RED" => "R".to_owned(),
        "GREEN" => "G".to_owned(),
        "BLUE" => "B".to_owned(),
        "ALPHA" => "A".to_owned(),
        other => other.to_owned(),
    };
    (layer.to_owned(), last)
}

/// Returns a layer's name for messages.
fn described(name: &str) -> String {
    if name.is_empty() { "the unnamed layer".to_owned() } else { format!("layer `{name}`") }
}

/// Returns the name of the requested layer. Without a request, returns the first layer of this list that
/// exists:
/// 1. The only layer.
/// 2. The unnamed layer.
/// 3. The only colour layer.
/// 4. Blender's `Combined`.
/// 5. The only usable layer.
fn choose<'a>(layers: &'a BTreeMap<String, Part>, asked: Option<&str>) -> Result<&'a str, PictureError> {
    let list = layers.keys().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    if let Some(asked) = asked {
        return match layers.get_key_value(asked) {
            Some((name, _)) => Ok(name),
            None => Err(PictureError::new(
                format!("the OpenEXR file has no layer `{asked}`"),
                format!("set `layer` to one of: {list}"),
            )),
        };
    }
    let is_colour = |l: &Layer| ["R", "G", "B"].iter().all(|c| l.contains_key(*c));
    let only = |fits: &dyn Fn(&str, &Layer) -> bool| {
        let mut all = layers.iter().filter(|(n, p)| fits(n, &p.channels)).map(|(n, _)| n.as_str());
        all.next().filter(|_| all.next().is_none())
    };
    let is_usable = |l: &Layer| colours("", l).is_ok();
    only(&|_, _| true)
        .or_else(|| only(&|n, l| n.is_empty() && is_usable(l)))
        .or_else(|| only(&|_, l| is_colour(l)))
        .or_else(|| only(&|n, l| is_colour(l) && n.rsplit('.').next() == Some("Combined")))
        .or_else(|| only(&|_, l| is_usable(l)))
        .ok_or_else(|| {
            PictureError::new(
                format!("the OpenEXR file has {} layers, and the image layer is ambiguous", layers.len()),
                format!("set `layer` to one of: {list}"),
            )
        })
}

/// Returns the one or three image channels of a layer, and whether the channels are CIE XYZ.
fn colours<'a>(name: &str, layer: &Layer<'a>) -> Result<(Vec<&'a FlatSamples>, bool), PictureError> {
    let all = |names: &[&str]| names.iter().map(|n| layer.get(*n).copied()).collect::<Option<Vec<_>>>();
    if let Some(rgb) = all(&["R", "G", "B"]) {
        return Ok((rgb, false));
    }
    if layer.contains_key("RY") || layer.contains_key("BY") {
        return Err(PictureError::new(
            "the OpenEXR file has luminance and chroma channels (Y, RY, BY)",
            "export red, green and blue channels",
        ));
    }
    if let Some(xyz) = all(&["X", "Y", "Z"]) {
        return Ok((xyz, true));
    }
    let without_alpha: Vec<_> = layer.iter().filter(|(n, _)| *n != "A").map(|(_, c)| *c).collect();
    match (&without_alpha[..], layer.len()) {
        ([one], _) => Ok((vec![one], false)),
        ([], 1) => Ok((layer.values().copied().collect(), false)),
        _ => {
            let list = layer.keys().cloned().collect::<Vec<_>>().join(", ");
            Err(PictureError::new(
                format!("{} of the OpenEXR file has unsupported channels: {list}", described(name)),
                "provide channels R, G and B, or X, Y and Z, or a single channel",
            ))
        }
    }
}
