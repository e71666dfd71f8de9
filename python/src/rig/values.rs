//! Requests to instruments and their replies, as the data classes of `pysunstone.rig.instruments`. Replies
//! are checked: fields exist, have the right type and are finite.

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

/// Return value of a method, with its fields.
pub struct Answer<'a, 'py>(pub &'a Bound<'py, PyAny>);

/// Formats an object for messages.
pub fn shown(object: &Bound<'_, PyAny>) -> String {
    let text = object.repr().map_or_else(|_| "an object without repr".into(), |t| t.to_string());
    // The text of an array has many lines.
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match text.char_indices().nth(120) {
        Some((at, _)) => format!("{} …", &text[..at]),
        None => text,
    }
}

impl<'py> Answer<'_, 'py> {
    /// Reads a field; `wanted` describes the expected type.
    pub fn field<T: FromPyObjectOwned<'py>>(&self, name: &str, wanted: &str) -> Result<T, String> {
        let value = self.0.getattr(name).map_err(|_| format!("it has no `{name}`; expected {wanted}"))?;
        value.extract().map_err(|_| format!("`{name}` is {}; expected {wanted}", shown(&value)))
    }

    /// Reads a finite number.
    pub fn number(&self, name: &str, units: &str) -> Result<f64, String> {
        let wanted = format!("a finite number of {units}");
        let value: f64 = self.field(name, &wanted)?;
        if value.is_finite() { Ok(value) } else { Err(format!("`{name}` is {value}; expected {wanted}")) }
    }

    /// Reads two numbers, finite or infinite.
    fn pair(&self, name: &str, units: &str) -> Result<[f64; 2], String> {
        let wanted = format!("two numbers of {units}");
        let pair: [f64; 2] = self.field(name, &wanted)?;
        if pair.iter().any(|v| v.is_nan()) {
            return Err(format!("`{name}` is {pair:?}; expected {wanted}"));
        }
        Ok(pair)
    }

    /// Reads a duration.
    fn seconds(&self, name: &str) -> Result<Duration, String> {
        duration(name, self.number(name, "seconds")?)
    }
}

/// Converts seconds to a duration.
pub fn duration(name: &str, seconds: f64) -> Result<Duration, String> {
    Duration::try_from_secs_f64(seconds)
        .map_err(|_| format!("`{name}` is {seconds}; expected seconds, 0 or more"))
}

/// Converts a deadline; infinity is replaced by a very long time.
pub fn within(seconds: f64) -> Result<Duration, String> {
    if seconds == f64::INFINITY {
        return Ok(Duration::from_secs(u64::from(u32::MAX)));
    }
    duration("within_s", seconds)
}

/// A Python data class.
pub trait Value: Sized {
    /// Name of the class.
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

impl Value for Identity {
    const CLASS: &'static str = "Identity";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self {
            maker: from.field("maker", "a text")?,
            model: from.field("model", "a text")?,
            serial: from.field("serial", "a text")?,
            firmware: from.field("firmware", "a text")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (&self.maker, &self.model, &self.serial, &self.firmware).into_pyobject(py)
    }
}

impl Value for StageLimits {
    const CLASS: &'static str = "StageLimits";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self {
            range_deg: from.pair("range_deg", "degrees")?,
            velocity: from.number("velocity_deg_per_s", "degrees per second")?,
            acceleration: from.number("acceleration_deg_per_s2", "degrees per second squared")?,
            resolution_deg: from.number("resolution_deg", "degrees")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let [least, most] = self.range_deg;
        ((least, most), self.velocity, self.acceleration, self.resolution_deg).into_pyobject(py)
    }
}

impl Value for StageReading {
    const CLASS: &'static str = "StageReading";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self {
            angle_deg: from.number("angle_deg", "degrees")?,
            moving: from.field("moving", "True or False")?,
            homed: from.field("homed", "True or False")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (self.angle_deg, self.moving, self.homed).into_pyobject(py)
    }
}

impl Value for ProjectorLimits {
    const CLASS: &'static str = "ProjectorLimits";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self {
            size: from.field("size", "columns and rows in pixels")?,
            patterns: from.field("patterns", "the number of patterns in memory")?,
            bits: from.field("bits", "1 to 8")?,
            shortest: from.seconds("shortest_s")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let [width, height] = self.size;
        ((width, height), self.patterns, self.bits, self.shortest.as_secs_f64()).into_pyobject(py)
    }
}

/// Returns the pixel format with a GenICam name.
fn format(name: &str) -> Result<PixelFormat, String> {
    let known = FORMATS.into_iter().find(|f| f.name() == name);
    known.ok_or_else(|| format!("unknown format `{name}`; supported: Mono8, Mono10p, Mono12p, Mono16"))
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
        let pair = |[a, b]: [u32; 2]| (a, b);
        let [shortest, longest] = self.exposure.map(|e| e.as_secs_f64());
        let [least, most] = self.gain_db;
        let formats = PyTuple::new(py, self.formats.iter().map(|f| f.name()))?;
        let row = self.row_time.as_secs_f64();
        (pair(self.size), pair(self.step), (shortest, longest), (least, most), formats, row).into_pyobject(py)
    }
}

impl Value for Region {
    const CLASS: &'static str = "Region";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self {
            x: from.field("x", "a column")?,
            y: from.field("y", "a row")?,
            width: from.field("width", "columns")?,
            height: from.field("height", "rows")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (self.x, self.y, self.width, self.height).into_pyobject(py)
    }
}

impl Value for CameraSettings {
    const CLASS: &'static str = "CameraSettings";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        let region = from.0.getattr("region").map_err(|_| "it has no `region`")?;
        let name: String = from.field("format", "the name of a format")?;
        let trigger: String = from.field("trigger", "\"software\" or \"line\"")?;
        Ok(Self {
            region: Region::read(&Answer(&region))?,
            exposure: from.seconds("exposure_s")?,
            // The limits check the range of the gain.
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

impl Value for GalvoLimits {
    const CLASS: &'static str = "GalvoLimits";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self {
            range_deg: from.pair("range_deg", "degrees, in x and y")?,
            resolution_deg: from.number("resolution_deg", "degrees")?,
            settle: from.seconds("settle_s")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let [x, y] = self.range_deg;
        ((x, y), self.resolution_deg, self.settle.as_secs_f64()).into_pyobject(py)
    }
}

impl Value for LaserLimits {
    const CLASS: &'static str = "LaserLimits";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self { nm: from.number("wavelength_nm", "nanometres")?, rate_hz: from.pair("rate_hz", "hertz")? })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let [least, most] = self.rate_hz;
        (self.nm, (least, most)).into_pyobject(py)
    }
}

impl Value for LaserState {
    const CLASS: &'static str = "LaserState";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self {
            emitting: from.field("emitting", "True or False")?,
            rate_hz: from.number("rate_hz", "hertz")?,
            power: from.number("power", "a fraction of nominal power, 1 in normal operation")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (self.emitting, self.rate_hz, self.power).into_pyobject(py)
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

impl Value for CounterSettings {
    const CLASS: &'static str = "CounterSettings";

    fn read(from: &Answer<'_, '_>) -> Result<Self, String> {
        Ok(Self {
            bins: from.field("bins", "the number of bins")?,
            bin_ps: from.field("bin_ps", "a number of picoseconds")?,
            dwell: from.seconds("dwell_s")?,
            offset_ps: from.field("offset_ps", "a number of picoseconds")?,
            tags: from.field("tags", "True or False")?,
        })
    }

    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (self.bins, self.bin_ps, self.dwell.as_secs_f64(), self.offset_ps, self.tags).into_pyobject(py)
    }
}
