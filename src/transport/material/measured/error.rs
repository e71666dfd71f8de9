//! Errors of `.pbsdf` files.

/// Reasons why a table is refused. The message gives the fix after a semicolon; the caller prepends the path.
#[derive(Debug, thiserror::Error)]
pub enum PbsdfError {
    #[error("cannot be read: {0}; correct the path, or make it a readable file")]
    Read(std::io::Error),
    #[error(
        "is not a tensor file (it does not begin with `tensor_file`); give a .pbsdf file of the KAIST set"
    )]
    Magic,
    #[error("is a tensor file of version {0}.{1}; only version 1.0 is known, so write it again as that")]
    Version(u8, u8),
    #[error("ends inside its header; fetch it again, it is cut short or damaged")]
    Header,
    #[error("has no field `{0}`; a table has phi_d, theta_d, theta_h, wvls and M")]
    Missing(&'static str),
    #[error("has the field `{0}` twice; write it again with one of them")]
    Twice(&'static str),
    #[error("holds `{field}` as elements of type {found}; write it again as {want}")]
    Type {
        field: &'static str,
        found: String,
        want: &'static str,
    },
    #[error("holds `{field}` in shape {found}; it must be {want}")]
    Shape {
        field: &'static str,
        found: String,
        want: String,
    },
    #[error(
        "is too short: `{field}` should fill bytes {start}..{end}, the file has {size}; fetch it again, it is \
         cut short"
    )]
    Truncated {
        field: &'static str,
        start: u64,
        end: u128,
        size: usize,
    },
    #[error("has an empty axis `{0}`; set even_axes = true to take evenly spaced angles")]
    EmptyAxis(&'static str),
    #[error("has {1} entries on axis `{0}`; two or more are needed to interpolate")]
    ShortAxis(&'static str, usize),
    #[error("cannot be written: {sources} sets of four bands for {bands} bands; give one set for every four")]
    Sources { bands: usize, sources: usize },
    #[error("lists no wavelengths; `wvls` needs one entry or more")]
    NoWavelengths,
    /// An axis value that is not finite, or outside the range of its angle (radians).
    #[error("has the value {value} on axis `{axis}`; angles are radians in {low:.4}..{high:.4}")]
    Angle {
        axis: &'static str,
        value: f32,
        low: f32,
        high: f32,
    },
    #[error("has {before} followed by {after} on axis `{axis}`; its values must rise strictly")]
    Order {
        axis: &'static str,
        before: f64,
        after: f64,
    },
    #[error("has phi_d from {0} to {1} alone; the axis must go all the way round, from -π to π")]
    HalfCircle(f32, f32),
    #[error("holds no valid entry (M00 is NaN everywhere); fetch it again, or take the inpainted variant")]
    Empty,
    /// The table to write is too large for the address space.
    #[error("would hold more elements than can be counted; use shorter axes")]
    TooLarge,
    #[error("cannot be written: {0}; check the folder and the space on it")]
    Write(std::io::Error),
}
