//! Converts patterns, frames and histograms between Python and instruments.

use super::values::{Answer, shown};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyList;
use sunstone::rig::instrument::{Failure, Fault, Histogram, Pattern, PixelFormat, RawFrame, pixels};

/// A camera frame that a Python object returned.
pub struct Picture {
    /// Number of rows and of columns.
    pub shape: [usize; 2],
    /// Digital numbers, row-major from the top.
    pub numbers: Vec<u32>,
    /// The camera's frame number, if the camera counts frames.
    pub number: Option<u64>,
    /// Time stamp of the camera's clock in nanoseconds.
    pub timestamp_ns: u64,
}

impl Picture {
    /// Reads a frame from a camera's reply. The reply is a `Frame`, or only the array.
    pub fn read(from: &Answer<'_, '_>, format: PixelFormat) -> Result<Self, String> {
        let of_frame = from.0.getattr("pixels").ok();
        let array = of_frame.as_ref().unwrap_or(from.0);
        let numbers = table::<u16>(array).or_else(|| table::<u8>(array)).or_else(|| table::<u32>(array));
        let (shape, numbers) = numbers.ok_or_else(|| {
            format!(
                "the pixels of the frame are {}; expected a NumPy array (rows, columns) of uint8 or uint16",
                kind(array)
            )
        })?;
        let most = (1_u32 << format.bits()) - 1;
        if let Some(n) = numbers.iter().find(|n| **n > most) {
            let name = format.name();
            return Err(format!(
                "a pixel has the value {n}, but the pixel format {name} holds values from 0 to {most}; return digital numbers of this \
                 format"
            ));
        }
        let (number, timestamp_ns) = match of_frame {
            Some(_) => (
                from.field("number", "the camera's frame number, or None")?,
                from.field("timestamp_ns", "an integer number of nanoseconds, 0 or more")?,
            ),
            None => (None, 0),
        };
        Ok(Self { shape, numbers, number, timestamp_ns })
    }
}

/// Reads the shape and the numbers of a two-dimensional array with elements of type `T`.
fn table<T: numpy::Element + Copy + Into<u32>>(array: &Bound<'_, PyAny>) -> Option<([usize; 2], Vec<u32>)> {
    let array: PyReadonlyArray2<'_, T> = array.extract().ok()?;
    let shape = [array.shape()[0], array.shape()[1]];
    Some((shape, array.as_array().iter().map(|n| (*n).into()).collect()))
}

/// Reads the numbers of a one-dimensional array with elements of type `T`.
fn list<T: numpy::Element + Copy + TryInto<u32>>(array: &Bound<'_, PyAny>) -> Option<Vec<u32>> {
    let array: PyReadonlyArray1<'_, T> = array.extract().ok()?;
    array.as_array().iter().map(|n| (*n).try_into().ok()).collect()
}

/// Describes an array in messages.
fn kind(array: &Bound<'_, PyAny>) -> String {
    let part = |name: &str| array.getattr(name).ok().map(|v| v.to_string());
    match (part("dtype"), part("shape")) {
        (Some(dtype), Some(shape)) => format!("{dtype} of shape {shape}"),
        _ => shown(array),
    }
}

/// Reads a field of 32-bit integers.
fn integers(from: &Answer<'_, '_>, name: &str) -> Result<Vec<u32>, String> {
    let array = from
        .0
        .getattr(name)
        .map_err(|_| format!("the attribute `{name}` is missing; expected a NumPy array of uint32"))?;
    let found = list::<u32>(&array)
        .or_else(|| list::<u16>(&array))
        .or_else(|| list::<i64>(&array))
        .or_else(|| list::<u64>(&array))
        .or_else(|| list::<i32>(&array));
    found.ok_or_else(|| {
        format!("`{name}` is {}; expected a NumPy array (bins,) of uint32 counts", kind(&array))
    })
}

/// Reads a counter's reply as a histogram. If the counter does not number its acquisitions, the histogram has
/// the number `number`.
pub fn histogram(from: &Answer<'_, '_>, number: u64) -> Result<Histogram, String> {
    let tagged = from.0.getattr("records").is_ok_and(|r| !r.is_none());
    let own: Option<u64> = from.field("number", "the counter's acquisition number, or None")?;
    Ok(Histogram {
        counts: integers(from, "counts")?,
        records: if tagged { integers(from, "records")? } else { vec![] },
        pulses: from.field("pulses", "an integer number of laser pulses, 0 or more")?,
        number: own.unwrap_or(number),
        timestamp_ns: from.field("timestamp_ns", "an integer number of nanoseconds, 0 or more")?,
    })
}

/// Converts a histogram to Python.
pub fn of_histogram<'py>(py: Python<'py>, h: &Histogram) -> PyResult<Bound<'py, PyAny>> {
    let counts = PyArray1::from_slice(py, &h.counts);
    let records = (!h.records.is_empty()).then(|| PyArray1::from_slice(py, &h.records));
    let class = py.import(super::fault::HOME)?.getattr("Histogram")?;
    class.call1((counts, h.pulses, h.number, h.timestamp_ns, records))
}

/// Converts a frame to Python. A truncated frame becomes a failure that allows a retry.
pub fn of_frame(py: Python<'_>, name: &str, frame: &RawFrame) -> PyResult<Py<PyAny>> {
    let Some(numbers) = pixels::unpack(frame) else {
        let what = format!("incomplete frame of {} bytes", frame.bytes.len());
        let failure = Failure::new(Fault::Timeout, name, what);
        return Err(super::fault::exception(py, &failure, ""));
    };
    let shape = [frame.region.height as usize, frame.region.width as usize];
    // All formats have at most 16 bits.
    let numbers: Vec<u16> = numbers.into_iter().map(|n| n as u16).collect();
    let array = PyArray1::from_vec(py, numbers).reshape(shape)?;
    let class = py.import(super::fault::HOME)?.getattr("Frame")?;
    Ok(class.call1((array, frame.number, frame.timestamp_ns))?.unbind())
}

/// Converts patterns to a list of Python arrays (rows, columns) of uint8.
pub fn of_patterns<'py>(py: Python<'py>, patterns: &[Pattern]) -> PyResult<Bound<'py, PyList>> {
    let arrays = patterns.iter().map(|p| {
        let shape = [p.height as usize, p.width as usize];
        PyArray1::from_slice(py, &p.pixels).reshape(shape)
    });
    PyList::new(py, arrays.collect::<PyResult<Vec<_>>>()?)
}

/// Reads patterns from Python.
pub fn patterns(given: &Bound<'_, PyAny>) -> Result<Vec<Pattern>, String> {
    let wanted = "expected a sequence of NumPy arrays (rows, columns) of uint8";
    let items = given.try_iter().map_err(|_| format!("{}: {wanted}", shown(given)))?;
    let mut all = vec![];
    for item in items {
        let item = item.map_err(|e| e.to_string())?;
        let array: PyReadonlyArray2<'_, u8> =
            item.extract().map_err(|_| format!("a pattern is {}; {wanted}", kind(&item)))?;
        all.push(Pattern {
            width: array.shape()[1] as u32,
            height: array.shape()[0] as u32,
            pixels: array.as_array().iter().copied().collect(),
        });
    }
    Ok(all)
}
