//! Converts between the requests and replies of instruments and the data classes of
//! `pysunstone.rig.instruments`. Fields of replies must exist, have the right type and be finite.

use super::fault::HOME;
use pyo3::conversion::FromPyObjectOwned;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::time::Duration;
use sunstone::rig::instrument::{
    CameraLimits, CameraSettings, CounterLimits, CounterSettings, GalvoLimits, Identity, LaserLimits,
    LaserState, PixelFormat, ProjectorLimits, Region, StageLimits, StageReading, Trigger,
};
use sunstone::rig::ptu::record::RecordType;

/// All pixel formats.
const FORMATS: [PixelFormat; 4] =
    [PixelFormat::Mono8, PixelFormat::Mono10p, PixelFormat::Mono12p, PixelFormat::Mono16];

/// Return value of an instrument's method, with functions to read the fields of this value.
pub struct Answer<'a, 'py>(pub &'a Bound<'py, PyAny>);

/// Formats an object for messages.
pub fn shown(object: &Bound<'_, PyAny>) -> String {
    let text = object.repr().map_or_else(|_| "an object without repr".into(), |t| t.to_string());
    // Join the lines, because the text of an array has many lines.
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match text.char_indices().nth(120) {
        Some((at, _)) => format!("{} …", &text[..at]),
        None => text,
    }
}

impl<'py> Answer<'_, 'py> {
    /// Reads a field. `wanted` describes the expected type.
    pub fn field<T: FromPyObjectOwned<'py>>(&self, name: &str, wanted: &str) -> Result<T, String> {
        let value = self
            .0
            .getattr(name)
            .map_err(|_| format!("the attribute `{name}` is missing; expected {wanted}"))?;
        value.extract().map_err(|_| format!("`{name}` is {}; expected {wanted}", shown(&value)))
    }

    /// Reads a field that is a finite number. Messages contain `units`.
    pub fn number(&self, name: &str, units: &str) -> Result<f64, String> {
        let wanted = format!("a finite number of {units}");
        let value: f64 = self.field(name, &wanted)?;
        if value.is_finite() { Ok(value) } else { Err(format!("`{name}` is {value}; expected {wanted}")) }
    }

    /// Reads a field of two numbers, which can be infinite.
    fn pair(&self, name: &str, units: &str) -> Result<[f64; 2], String> {
        let wanted = format!("two numbers of {units}");
        let pair: [f64; 2] = self.field(name, &wanted)?;
        if pair.iter().any(|v| v.is_nan()) {
            return Err(format!("`{name}` is {pair:?}; expected {wanted}"));
        }
        Ok(pair)
    }

    /// Reads a field that is a duration in seconds.
    fn seconds(&self, name: &str) -> Result<Duration, String> {
        duration(name, self.number(name, "seconds")?)
    }
}

/// Converts seconds to a duration.
pub fn duration(name: &str, seconds: f64) -> Result<Duration, String> {
    Duration::try_from_secs_f64(seconds)
        .map_err(|_| format!("`{name}` is {seconds}; expected a number of seconds, 0 or more"))
}

/// Converts a deadline. An infinite deadline becomes a very long duration.
pub fn within(seconds: f64) -> Result<Duration, String> {
    if seconds == f64::INFINITY {
        return Ok(Duration::from_secs(u64::from(u32::MAX)));
    }
    duration("within_s", seconds)
}

/// A value that is a data class in Python.
pub trait Value: Sized {
    /// Name of the Python class.
    const CLASS: &'static str;

    /// Reads the value from a return value or an argument.
    fn read(from: &Answer<'_, '_>) -> Result<Self, String>;

    /// Returns the fields in order.
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>>;

    /// Converts the value to Python.
    fn object<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import(HOME)?.getattr(Self::CLASS)?.call1(self.fields(py)?)
    }
}

/// Converts an array to a pair, because only a pair becomes a tuple in Python.
fn pair<T>([a, b]: [T; 2]) -> (T, T) {
    (a, b)
}

/// Implements [`Value`] for a data class, field by field. For each field, the macro defines how the field is
/// read from an answer, and how it is converted to Python.
macro_rules! value {
    ($class:ident, $from:ident, $own:ident, { $($field:ident: $read:expr => $object:expr,)* }) => {
        impl Value for $class {
            const CLASS: &'static str = stringify!($class);

            fn read($from: &Answer<'_, '_>) -> Result<Self, String> {
                Ok(Self { $($field: $read?,)* })
            }

            fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
                let $own = self;
                ($($object,)*).into_pyobject(py)
            }
        }
    };
}

value!(Identity, from, own, {
    maker: from.field("maker", "a text") => &own.maker,
    model: from.field("model", "a text") => &own.model,
    serial: from.field("serial", "a text") => &own.serial,
    firmware: from.field("firmware", "a text") => &own.firmware,
});

value!(StageLimits, from, own, {
    range_deg: from.pair("range_deg", "degrees") => pair(own.range_deg),
    velocity: from.number("velocity_deg_per_s", "degrees per second") => own.velocity,
    acceleration: from.number("acceleration_deg_per_s2", "degrees per second squared") => own.acceleration,
    resolution_deg: from.number("resolution_deg", "degrees") => own.resolution_deg,
});

value!(StageReading, from, own, {
    angle_deg: from.number("angle_deg", "degrees") => own.angle_deg,
    moving: from.field("moving", "True or False") => own.moving,
    homed: from.field("homed", "True or False") => own.homed,
});

value!(ProjectorLimits, from, own, {
    size: from.field("size", "columns and rows in pixels") => pair(own.size),
    patterns: from.field("patterns", "the number of patterns in memory") => own.patterns,
    bits: from.field("bits", "1 to 8") => own.bits,
    shortest: from.seconds("shortest_s") => own.shortest.as_secs_f64(),
});

value!(Region, from, own, {
    x: from.field("x", "a column") => own.x,
    y: from.field("y", "a row") => own.y,
    width: from.field("width", "columns") => own.width,
    height: from.field("height", "rows") => own.height,
});

value!(GalvoLimits, from, own, {
    range_deg: from.pair("range_deg", "degrees, in x and y") => pair(own.range_deg),
    resolution_deg: from.number("resolution_deg", "degrees") => own.resolution_deg,
    settle: from.seconds("settle_s") => own.settle.as_secs_f64(),
});

value!(LaserLimits, from, own, {
    nm: from.number("wavelength_nm", "nanometres") => own.nm,
    rate_hz: from.pair("rate_hz", "hertz") => pair(own.rate_hz),
});

value!(LaserState, from, own, {
    emitting: from.field("emitting", "True or False") => own.emitting,
    rate_hz: from.number("rate_hz", "hertz") => own.rate_hz,
    power: from.number("power", "a fraction of nominal power, 1 in normal operation") => own.power,
});

value!(CounterSettings, from, own, {
    bins: from.field("bins", "the number of bins") => own.bins,
    bin_ps: from.field("bin_ps", "a number of picoseconds") => own.bin_ps,
    dwell: from.seconds("dwell_s") => own.dwell.as_secs_f64(),
    offset_ps: from.field("offset_ps", "a number of picoseconds") => own.offset_ps,
    tags: from.field("tags", "True or False") => own.tags,
});

/// Returns the pixel format with the given GenICam name.
fn format(name: &str) -> Result<PixelFormat, String> {
    let known = FORMATS.into_iter().find(|f| f.name() == name);
    known.ok_or_else(|| format!("unknown pixel format `{name}`; supported: Mono8, Mono10p, Mono12p, Mono16"))
}

impl Value for CameraLimits {
    const CLASS: &'static str = "CameraLimits";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        let [shortest, longest] = from.pair("exposure_s", "seconds")?;
        let formats: Vec<String> = from.field("formats", "names of formats, such as (\"Mono12p\",)")?;
        Ok(Self {
            size: from.field("size", "columns and rows in pixels")?,
            step: from.field("step", "columns and rows in pixels")?,
            exposure: [duration("exposure_s", shortest)?, duration("exposure_s", longest)?],
            gain_db: from.pair("gain_db", "decibels")?,
            formats: formats.iter().map(|f| format(f)).collect::<Result<_, _>>()?,
            row_time: from.seconds("row_time_s")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let exposure = pair(self.exposure.map(|e| e.as_secs_f64()));
        let formats = PyTuple::new(py, self.formats.iter().map(|f| f.name()))?;
        let row = self.row_time.as_secs_f64();
        (pair(self.size), pair(self.step), exposure, pair(self.gain_db), formats, row).into_pyobject(py)
    }
}

impl Value for CameraSettings {
    const CLASS: &'static str = "CameraSettings";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        let region =
            from.0.getattr("region").map_err(|_| "the attribute `region` is missing; expected a Region")?;
        let name: String = from.field("format", "the name of a format")?;
        let trigger: String = from.field("trigger", "\"software\" or \"line\"")?;
        Ok(Self {
            region: Region::read(&Answer(&region))?,
            exposure: from.seconds("exposure_s")?,
            // The range of the gain is checked with the limits of the camera.
            gain_db: from.field("gain_db", "a number of decibels")?,
            format: format(&name)?,
            trigger: match trigger.as_str() {
                "software" => Trigger::Software,
                "line" => Trigger::Line,
                other => {
                    return Err(format!("`trigger` is {other:?}; expected \"software\" or \"line\""));
                }
            },
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let trigger = match self.trigger {
            Trigger::Software => "software",
            Trigger::Line => "line",
        };
        let exposure = self.exposure.as_secs_f64();
        (self.region.object(py)?, exposure, self.gain_db, self.format.name(), trigger).into_pyobject(py)
    }
}

impl Value for CounterLimits {
    const CLASS: &'static str = "CounterLimits";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        let tags: Option<String> = from.field("tags", "the name of a record type, or None")?;
        let record = |name: String| {
            let all = RecordType::ALL;
            let known: Vec<&str> = all.iter().map(|r| r.name()).collect();
            let found = all.into_iter().find(|r| r.name() == name);
            found.ok_or_else(|| format!("`tags` is {name:?}; expected None, or one of {}", known.join(", ")))
        };
        Ok(Self {
            bins: from.field("bins", "the number of bins of a histogram")?,
            finest_ps: from.number("finest_ps", "picoseconds")?,
            longest: from.seconds("longest_s")?,
            full: from.field("full", "the largest count of a bin")?,
            tags: tags.map(record).transpose()?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let tags = self.tags.map(RecordType::name);
        (self.bins, self.finest_ps, self.longest.as_secs_f64(), self.full, tags).into_pyobject(py)
    }
}
