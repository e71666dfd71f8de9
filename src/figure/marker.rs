//! Defines the markers of data points and the colours of series.

use image::Rgb;

/// Index of black in the palette, for bounds and reference lines.
pub const BLACK: usize = 6;

/// The colour-blind-safe palette of Okabe and Ito. The palette omits yellow, which is too pale on white.
const PALETTE: [[u8; 3]; 7] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [230, 159, 0], [204, 121, 167], [86, 180, 233], [0, 0, 0]];

/// SVG outlines of the markers. The markers are disc, square, triangle up, diamond, triangle down, ring,
/// cross and plus. The radius is about 1. The outlines are scaled so that all markers appear equally large.
const OUTLINES: [&str; 8] = [
    "M1 0A1 1 0 1 1-1 0A1 1 0 1 1 1 0Z",
    "M-.88-.88H.88V.88H-.88Z",
    "M0-1.24L1.07 .62H-1.07Z",
    "M0-1.24L1.24 0L0 1.24L-1.24 0Z",
    "M0 1.24L1.07-.62H-1.07Z",
    "M1.09 0A1.09 1.09 0 1 1-1.09 0A1.09 1.09 0 1 1 1.09 0ZM.61 0A.61 .61 0 1 0-.61 0A.61 .61 0 1 0 .61 0Z",
    "M0-.37L.63-1L1-.63L.37 0L1 .63L.63 1L0 .37L-.63 1L-1 .63L-.37 0L-1-.63L-.63-1Z",
    "M-.26-1.15H.26V-.26H1.15V.26H.26V1.15H-.26V.26H-1.15V-.26H-.26Z",
];

/// Number of distinct combinations of colour and marker.
pub const DISTINCT: usize = PALETTE.len() * OUTLINES.len();

/// Returns the palette colour for an index. Colours repeat for large indices.
pub fn palette(index: usize) -> Rgb<u8> {
    Rgb(PALETTE[index % PALETTE.len()])
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Marker(usize);

impl Marker {
    /// Returns the marker for an index. The numbers of markers and of colours have no common factor. A
    /// combination of marker and colour therefore repeats after [`DISTINCT`] indices, and not earlier.
    pub fn of(index: usize) -> Self {
        Self(index % OUTLINES.len())
    }

    /// Returns the outer edge of [`Marker::path`] as SVG path data. The white outline follows this edge.
    pub fn rim(self) -> &'static str {
        self.path().split_inclusive('Z').next().unwrap_or_default()
    }

    /// Returns the outline of the marker as SVG path data, for a radius of 1.
    pub fn path(self) -> &'static str {
        OUTLINES[self.0]
    }
}
