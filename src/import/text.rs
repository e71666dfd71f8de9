//! Decodes text files of any encoding and line ending.

use std::borrow::Cow;

/// Decodes UTF-8, UTF-16 with a byte order mark, or otherwise Latin-1. The byte order mark is removed.
pub(super) fn decode(bytes: &[u8]) -> Cow<'_, str> {
    let utf16 = |rest: &[u8], word: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = rest.as_chunks().0.iter().map(|&b| word(b)).collect();
        Cow::Owned(String::from_utf16_lossy(&words))
    };
    match bytes {
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        _ => {
            let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
            match std::str::from_utf8(bytes) {
                Ok(text) => text.into(),
                Err(_) => bytes.iter().map(|&b| char::from(b)).collect::<String>().into(),
            }
        }
    }
}

/// Splits text into lines that end with LF, CR or both.
pub(super) fn lines(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = Some(text).filter(|t| !t.is_empty());
    std::iter::from_fn(move || {
        let text = rest?;
        let Some(end) = text.find(['\n', '\r']) else {
            rest = None;
            return Some(text);
        };
        let after = text[end..].strip_prefix("\r\n").unwrap_or_else(|| &text[end + 1..]);
        rest = Some(after).filter(|t| !t.is_empty());
        Some(&text[..end])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_end_ends_a_line() {
        let expected = ["a", "", "b", "c", " d"];
        assert_eq!(lines("a\n\nb\r\nc\r d").collect::<Vec<_>>(), expected);
        assert_eq!(lines("a\r\rb\r\nc\n d\r").collect::<Vec<_>>(), expected);
        assert_eq!(lines("").count(), 0);
    }

    #[test]
    fn every_encoding_gives_the_same_text() {
        let text = "vé\n";
        let words: Vec<u16> = text.encode_utf16().collect();
        let little: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        let big: Vec<u8> = words.iter().flat_map(|w| w.to_be_bytes()).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            [b"\xef\xbb\xbf", text.as_bytes()].concat(),
            [&[0xff, 0xfe], &little[..]].concat(),
            [&[0xfe, 0xff], &big[..]].concat(),
            b"v\xe9\n".to_vec(),
        ] {
            assert_eq!(decode(&bytes), text);
        }
    }
}
