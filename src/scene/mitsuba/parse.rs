//! Parses XML text to elements.

use super::source::Source;
use base::locate::InputError;

const MOST_NODES: u32 = 4_000_000;

/// Parses the elements of a file whose first byte has the offset `start`.
pub(super) fn parse<'t>(
    source: &Source,
    start: usize,
    text: &'t str,
) -> Result<roxmltree::Document<'t>, InputError> {
    let options = roxmltree::ParsingOptions { nodes_limit: MOST_NODES, ..Default::default() };
    roxmltree::Document::parse_with_options(text, options).map_err(|e| {
        let at = start + offset(text, e.pos());
        let message = e.to_string();
        let message = message.split(" at ").next().unwrap_or(&message);
        source.error(
            &(at..at),
            format!("invalid XML: {message}"),
            "correct the file; see Mitsuba's documentation of the scene format",
        )
    })
}

/// Returns the byte offset of a line and a column (from 1, in characters).
fn offset(text: &str, pos: roxmltree::TextPos) -> usize {
    let mut line_start = 0;
    for _ in 1..pos.row {
        match text[line_start..].find('\n') {
            Some(end) => line_start += end + 1,
            None => return text.len(),
        }
    }
    let column = pos.col.saturating_sub(1) as usize;
    text[line_start..].char_indices().nth(column).map_or(text.len(), |(i, _)| line_start + i)
}
