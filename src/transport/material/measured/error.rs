//! Errors of `.pbsdf` files.

/// Reasons why a table is refused. The message gives the fix after a semicolon; the caller prepends the path.
#[derive(Debug, thiserror::Error)]
pub enum PbsdfError {
    /// The file cannot be opened or mapped.
    #[error("cannot be read: {0}; correct the path, or make it a readable file")]
    Read(std::io::Error),
    /// The first bytes are not those of a tensor file.
    #[error(
        "is not a tensor file (it does not begin with `tensor_file`); give a .pbsdf file of the KAIST set"
    )]
    Magic,
    /// Unknown version of the container.
    #[error("is a tensor file of version {0}.{1}; only version 1.0 is known, so write it again as that")]
    Version(u8, u8),
    /// The file ends inside its header.
    #[error("ends inside its header; fetch it again, it is cut short or damaged")]
    Header,
    /// A required field is missing.
    #[error("has no field `{0}`; a table has phi_d, theta_d, theta_h, wvls and M")]
    Missing(&'static str),
    /// A field occurs more than once.
    #[error("has the field `{0}` twice; write it again with one of them")]
    Twice(&'static str),
    /// The element type differs from that of the format.
    #[error("holds `{field}` as elements of type {found}; write it again as {want}")]
    Type {
        field: &'static str,
        /// Name of the type code in the file.
        found: String,
        /// The required type.
        want: &'static str,
    },
    /// The shape of a field does not fit the format or the axes.
    #[error("holds `{field}` in shape {found}; it must be {want}")]
    Shape {
        field: &'static str,
        /// Its shape in the file.
        found: String,
        /// The shape required by the format and the other fields.
        want: String,
    },
    /// The data of a field extend past the end of the file.
    #[error(
        "is too short: `{field}` should fill bytes {start}..{end}, the file has {size}; fetch it again, it is \
         cut short"
    )]
    Truncated {
        field: &'static str,
        /// First byte of its data.
        start: u64,
        /// Byte after its data.
        end: u128,
        /// Size of the file.
        size: usize,
    },
    /// An axis without entries, as in downsampled files.
    #[error("has an empty axis `{0}`; set even_axes = true to take evenly spaced angles")]
    EmptyAxis(&'static str),
    /// An axis with fewer than two entries.
    #[error("has {1} entries on axis `{0}`; two or more are needed to interpolate")]
    ShortAxis(&'static str, usize),
    /// The number of materials to tabulate does not match the number of bands.
    #[error("cannot be written: {sources} sets of four bands for {bands} bands; give one set for every four")]
    Sources {
        /// Bands to write.
        bands: usize,
        /// Given sets of materials.
        sources: usize,
    },
    /// There is no wavelength.
    #[error("lists no wavelengths; `wvls` needs one entry or more")]
    NoWavelengths,
    /// An axis value that is not finite, or outside the range of its angle (radians).
    #[error("has the value {value} on axis `{axis}`; angles are radians in {low:.4}..{high:.4}")]
    Angle {
        axis: &'static str,
        value: f32,
        /// Minimum angle.
        low: f32,
        /// Maximum angle.
        high: f32,
    },
    /// Axis values that do not ascend strictly.
    #[error("has {before} followed by {after} on axis `{axis}`; its values must rise strictly")]
    Order {
        axis: &'static str,
        /// One value.
        before: f64,
        /// The next value.
        after: f64,
    },
    /// phi_d omits half of the circle or more.
    #[error("has phi_d from {0} to {1} alone; the axis must go all the way round, from -π to π")]
    HalfCircle(f32, f32),
    /// All entries are holes.
    #[error("holds no valid entry (M00 is NaN everywhere); fetch it again, or take the inpainted variant")]
    Empty,
    /// The table to write is too large for the address space.
    #[error("would hold more elements than can be counted; use shorter axes")]
    TooLarge,
    /// The file cannot be written.
    #[error("cannot be written: {0}; check the folder and the space on it")]
    Write(std::io::Error),
}
