//! Errors of `.pbsdf` files.

/// Reasons why a table is rejected. Messages end with the fix. The caller prepends the path.
#[derive(Debug, thiserror::Error)]
pub enum PbsdfError {
    #[error("cannot read the file: {0}; check that the path is correct and the file is readable")]
    Read(std::io::Error),
    #[error(
        "the file is not a tensor file, because it does not begin with `tensor_file`; provide a .pbsdf file in the KAIST format"
    )]
    Magic,
    #[error("the tensor file has version {0}.{1}, expected 1.0; convert the file to version 1.0")]
    Version(u8, u8),
    #[error("the header is truncated or damaged; download the file again")]
    Header,
    #[error("missing field `{0}`; write a table with phi_d, theta_d, theta_h, wvls and M")]
    Missing(&'static str),
    #[error("duplicate field `{0}`; write the file with one field of this name")]
    Twice(&'static str),
    #[error("field `{field}` has elements of type {found}; write the field as {want}")]
    Type { field: &'static str, found: String, want: &'static str },
    #[error("field `{field}` has shape {found}, expected {want}; correct the shape")]
    Shape { field: &'static str, found: String, want: String },
    #[error(
        "the file is truncated: `{field}` occupies bytes {start}..{end}, but the file has {size} bytes; download the \
         file again"
    )]
    Truncated { field: &'static str, start: u64, end: u128, size: usize },
    #[error("axis `{0}` is empty; set even_axes = true to use evenly spaced angles")]
    EmptyAxis(&'static str),
    #[error("axis `{0}` has {1} entries; provide at least two for interpolation")]
    ShortAxis(&'static str, usize),
    #[error("found {sources} sources for {bands} wavelengths; provide one source for every four wavelengths")]
    Sources { bands: usize, sources: usize },
    #[error("field `wvls` has no entries; add at least one wavelength")]
    NoWavelengths,
    /// An axis value that is not finite or is outside the range of its angle (radians).
    #[error("value {value} on axis `{axis}` is outside the range; expected radians in {low:.4}..{high:.4}")]
    Angle { axis: &'static str, value: f32, low: f32, high: f32 },
    #[error(
        "the values {before} and {after} on axis `{axis}` do not increase; values must be strictly increasing"
    )]
    Order { axis: &'static str, before: f64, after: f64 },
    #[error("phi_d covers only {0} to {1}; provide angles over the full circle from -π to π")]
    HalfCircle(f32, f32),
    #[error(
        "the table has no valid entry, because M00 is NaN everywhere; download the file again, or use the inpainted variant"
    )]
    Empty,
    /// The table to write is too large for the address space.
    #[error("the table has too many elements; use shorter axes")]
    TooLarge,
    #[error("cannot write the file: {0}; check that the folder exists and that the disk is not full")]
    Write(std::io::Error),
}
