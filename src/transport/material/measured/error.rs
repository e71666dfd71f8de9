//! What can be wrong with a `.pbsdf` file.

/// Why a table was refused, and the fix, after one semicolon. The caller puts the path in front.
#[derive(Debug, thiserror::Error)]
pub enum PbsdfError {
    /// The file cannot be opened or mapped.
    #[error("cannot be read: {0}; correct the path, or make it a readable file")]
    Read(std::io::Error),
    /// The first bytes are not a tensor file's.
    #[error(
        "is not a tensor file (it does not begin with `tensor_file`); give a .pbsdf file of the KAIST set"
    )]
    Magic,
    /// A version of the container that nobody has described.
    #[error("is a tensor file of version {0}.{1}; only version 1.0 is known, so write it again as that")]
    Version(u8, u8),
    /// The file ends inside its header.
    #[error("ends inside its header; fetch it again, it is cut short or damaged")]
    Header,
    /// A field that a table needs is not there.
    #[error("has no field `{0}`; a table has phi_d, theta_d, theta_h, wvls and M")]
    Missing(&'static str),
    /// A field is there more than once.
    #[error("has the field `{0}` twice; write it again with one of them")]
    Twice(&'static str),
    /// Elements of another type than the format's.
    #[error("holds `{field}` as elements of type {found}; write it again as {want}")]
    Type {
        /// Name of the field.
        field: &'static str,
        /// Its type code in the file, in words.
        found: String,
        /// The type it must have.
        want: &'static str,
    },
    /// The shape of a field does not fit the format or the axes.
    #[error("holds `{field}` in shape {found}; it must be {want}")]
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
        "is too short: `{field}` should fill bytes {start}..{end}, the file has {size}; fetch it again, it is \
         cut short"
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
    #[error("has an empty axis `{0}`; set even_axes = true to take evenly spaced angles")]
    EmptyAxis(&'static str),
    /// An axis of one entry.
    #[error("has {1} entries on axis `{0}`; two or more are needed to interpolate")]
    ShortAxis(&'static str, usize),
    /// Materials to tabulate that do not cover the bands.
    #[error("cannot be written: {sources} sets of four bands for {bands} bands; give one set for every four")]
    Sources {
        /// Bands to write.
        bands: usize,
        /// Sets of materials given.
        sources: usize,
    },
    /// No wavelength at all.
    #[error("lists no wavelengths; `wvls` needs one entry or more")]
    NoWavelengths,
    /// An axis value that is not finite, or outside the range of its angle (radians).
    #[error("has the value {value} on axis `{axis}`; angles are radians in {low:.4}..{high:.4}")]
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
    #[error("has {before} followed by {after} on axis `{axis}`; its values must rise strictly")]
    Order {
        /// Name of the axis.
        axis: &'static str,
        /// One value.
        before: f64,
        /// The next one.
        after: f64,
    },
    /// phi_d leaves out half of the circle or more.
    #[error("has phi_d from {0} to {1} alone; the axis must go all the way round, from -π to π")]
    HalfCircle(f32, f32),
    /// Nothing but holes.
    #[error("holds no valid entry (M00 is NaN everywhere); fetch it again, or take the inpainted variant")]
    Empty,
    /// A table that no machine can hold, asked of the writer.
    #[error("would hold more elements than can be counted; use shorter axes")]
    TooLarge,
    /// The file cannot be written.
    #[error("cannot be written: {0}; check the folder and the space on it")]
    Write(std::io::Error),
}
