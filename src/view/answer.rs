//! Answers with arrays: the length of a JSON header (u32, little-endian), the header, padded with spaces to a
//! multiple of 4 bytes, and the arrays as f32, little-endian.

use oxhttp::model::{Body, Response, StatusCode};
use serde_json::Value;
use std::io::{Cursor, Read};
use std::sync::Arc;

/// Arrays that an answer sends. They are shared with the cache of images, so that sending needs no copy.
pub(crate) type Array = Arc<Vec<f32>>;

/// The content of an answer.
pub(crate) enum Answer {
    Json(Value),
    Arrays(Value, Vec<Array>),
    /// A file of the page, with its media type.
    File(&'static [u8], &'static str),
    Refused(u16, String),
}

impl Answer {
    /// Returns the answer as a response of the server.
    pub(crate) fn into_response(self) -> Response<Body> {
        let (status, kind, body) = match self {
            Self::Json(value) => (200, "application/json", Body::from(value.to_string())),
            Self::Arrays(header, arrays) => (200, "application/octet-stream", arrays_body(&header, arrays)),
            Self::File(bytes, kind) => (200, kind, Body::from(bytes.to_vec())),
            Self::Refused(status, message) => {
                let error = serde_json::json!({"error": message});
                (status, "application/json", Body::from(error.to_string()))
            }
        };
        Response::builder()
            .status(StatusCode::from_u16(status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR))
            .header("content-type", kind)
            .header("cache-control", "no-store")
            .header("x-content-type-options", "nosniff")
            .header("referrer-policy", "no-referrer")
            .header("cross-origin-resource-policy", "same-origin")
            .header(
                "content-security-policy",
                "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; object-src 'none'; base-uri 'none'",
            )
            .body(body)
            .unwrap_or_else(|_| unreachable!("the status and the headers are constants"))
    }
}

fn arrays_body(header: &Value, arrays: Vec<Array>) -> Body {
    let mut text = header.to_string();
    while !text.len().is_multiple_of(4) {
        text.push(' ');
    }
    let mut head = (text.len() as u32).to_le_bytes().to_vec();
    head.extend(text.as_bytes());
    Body::from_read(arrays.into_iter().fold(Box::new(Cursor::new(head)) as Box<dyn Read>, |read, array| {
        Box::new(read.chain(Floats { array, at: 0 }))
    }))
}

/// Reads the values of an array as little-endian bytes.
struct Floats {
    array: Array,
    at: usize,
}

impl Read for Floats {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let bytes: &[u8] = if cfg!(target_endian = "little") {
            bytemuck::cast_slice(&self.array)
        } else {
            return Err(std::io::Error::other("processors that are not little-endian are not supported"));
        };
        let n = into.len().min(bytes.len() - self.at);
        into[..n].copy_from_slice(&bytes[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_follow_a_padded_header() {
        let header = serde_json::json!({"axes": []});
        let bytes = arrays_body(&header, vec![Arc::new(vec![1.0, f32::NAN]), Arc::new(vec![-2.5])]);
        let bytes = bytes.to_vec().unwrap();
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        assert_eq!(length % 4, 0);
        assert_eq!(serde_json::from_slice::<Value>(&bytes[4..4 + length]).unwrap(), header);
        let values: Vec<f32> =
            bytes[4 + length..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert!(values[0] == 1.0 && values[1].is_nan() && values[2] == -2.5 && values.len() == 3);
    }
}
