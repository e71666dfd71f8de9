//! A map with one number per pixel. Text files store the map as one string, which is the base64 (RFC 4648) of
//! little-endian 32-bit floats.
//!
//! A map of 1224 × 1024 pixels takes 7 MB in a TOML file. Writing and reading preserve all bits. A NaN means
//! that the pixel's value is unknown.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// A map with one number per pixel, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PixelMap(pub Vec<f32>);

impl PixelMap {
    /// Returns the value of a pixel, or NaN if the pixel is outside the map.
    pub fn at(&self, pixel: usize) -> f64 {
        self.0.get(pixel).map_or(f64::NAN, |v| f64::from(*v))
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl FromIterator<f64> for PixelMap {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        Self(values.into_iter().map(|v| v as f32).collect())
    }
}

impl Serialize for PixelMap {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = self.0.iter().flat_map(|v| v.to_le_bytes()).collect();
        to.serialize_str(&BASE64_STANDARD.encode(bytes))
    }
}

impl<'de> Deserialize<'de> for PixelMap {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let text = String::deserialize(from)?;
        let bytes = BASE64_STANDARD.decode(text.trim()).map_err(|e| {
            de::Error::custom(format!("a pixel map is not valid base64 ({e}); calibrate again"))
        })?;
        let (values, rest) = bytes.as_chunks::<4>();
        if !rest.is_empty() {
            return Err(de::Error::custom("a pixel map is truncated; calibrate again"));
        }
        Ok(Self(values.iter().map(|b| f32::from_le_bytes(*b)).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize, Deserialize)]
    struct File {
        map: PixelMap,
    }

    #[test]
    fn maps_round_trip_bit_for_bit() {
        let map = PixelMap(vec![0.0, -1.5, f32::NAN, f32::INFINITY, 1e-40]);
        let text = toml::to_string(&File { map: map.clone() }).expect("a text");
        let read: File = toml::from_str(&text).expect("a map");
        let bits = |m: &PixelMap| m.0.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&read.map), bits(&map));
        // RFC 4648: 1.0 is 00 00 80 3f.
        assert!(
            toml::to_string(&File { map: PixelMap(vec![1.0]) }).expect("a text").contains("\"AACAPw==\"")
        );
        for bad in ["map = \"AACA\"", "map = \"§\"", "map = 3"] {
            assert!(toml::from_str::<File>(bad).is_err(), "{bad}");
        }
        assert!(map.at(9).is_nan());
    }
}
