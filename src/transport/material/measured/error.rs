//! What can be wrong with a `.pbsdf` file.

/// Why a table was refused, and the fix, after one semicolon. The caller puts the path in front.
#[derive(Debug, thiserror::Error)]
pub enum PbsdfError {
    /// The file cannot be opened or mapped.
    #[error("cannot read the file: {0}; check that the path is correct and the file is readable")]
    Read(std::io::Error),
    /// The first bytes are not a tensor file's.
    #[error(
        "not a tensor file (it does not start with `tensor_file`); give a .pbsdf file in the KAIST format"
    )]
    Magic,
    /// A version of the container that nobody has described.
    #[error("expected tensor file version 1.0, got {0}.{1}; convert the file to version 1.0")]
    Version(u8, u8),
    /// The file ends inside its header.
    #[error("the header is truncated or damaged; download the file again")]
    Header,
    /// A field that a table needs is not there.
    #[error("missing field `{0}`; a table requires phi_d, theta_d, theta_h, wvls and M")]
    Missing(&'static str),
    /// A field is there more than once.
    #[error("duplicate field `{0}`; write the file with one field of this name")]
    Twice(&'static str),
    /// Elements of another type than the format's.
    #[error("field `{field}` has elements of type {found}; write the field as {want}")]
    Type {
        /// Name of the field.
        field: &'static str,
        /// Its type code in the file, in words.
        found: String,
        /// The type it must have.
        want: &'static str,
    },
    /// The shape of a field does not fit the format or the axes.
    #[error("field `{field}` has shape {found}; expected shape {want}")]
    Shape {
        /// Name of the field.
        field: &'static str,
        /// Its shape in the file.
        found: String,
        /// What the format and the other fields ask for.
        want: String,
    },
    /// The data of a field go past the end of the file.
    #[error(
        "the file is truncated: `{field}` occupies bytes {start}..{end}, but the file has {size} bytes; download the \
         file again"
    )]
    Truncated {
        /// Name of the field.
        field: &'static str,
        /// First byte of its data.
        start: u64,
        /// Byte after its data.
        end: u128,
        /// Size of the file.
        size: usize,
    },
    /// An axis without entries, as downsampled files have.
    #[error("axis `{0}` is empty; set even_axes = true to use evenly spaced angles")]
    EmptyAxis(&'static str),
    /// An axis of one entry.
    #[error("axis `{0}` has {1} entries; at least two are required for interpolation")]
    ShortAxis(&'static str, usize),
    /// Materials to tabulate that do not cover the bands.
    #[error("{sources} sets of four bands for {bands} bands; give one set for every four bands")]
    Sources {
        /// Bands to write.
        bands: usize,
        /// Sets of materials given.
        sources: usize,
    },
    /// No wavelength at all.
    #[error("the file has no wavelengths; `wvls` requires at least one entry")]
    NoWavelengths,
    /// An axis value that is not finite, or outside the range of its angle (radians).
    #[error("value {value} on axis `{axis}` is out of range; expected radians in {low:.4}..{high:.4}")]
    Angle {
        /// Name of the axis.
        axis: &'static str,
        /// The value.
        value: f32,
        /// Least angle.
        low: f32,
        /// Greatest angle.
        high: f32,
    },
    /// An axis whose values fall or repeat.
    #[error("{before} followed by {after} on axis `{axis}`; values must be strictly increasing")]
    Order {
        /// Name of the axis.
        axis: &'static str,
        /// One value.
        before: f64,
        /// The next one.
        after: f64,
    },
    /// phi_d leaves out half of the circle or more.
    #[error("phi_d covers only {0} to {1}; the axis must cover the full circle from -π to π")]
    HalfCircle(f32, f32),
    /// Nothing but holes.
    #[error("no valid entry (M00 is NaN everywhere); download the file again, or use the inpainted variant")]
    Empty,
    /// A table that no machine can hold, asked of the writer.
    #[error("the table has too many elements; use shorter axes")]
    TooLarge,
    /// The file cannot be written.
    #[error("cannot write the file: {0}; check that the folder exists and that its disk is not full")]
    Write(std::io::Error),
}
