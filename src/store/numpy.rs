//! Reads and writes NumPy arrays.

mod bytes;

use base::npy::{Element, Header, NumpyNumber, write_header};
use base::{positioned, whole_file};
use bytes::{Bytes, row_major};
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tensor::number::Number;
use thiserror::Error;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Values of an array in row-major order (the index of the last axis varies fastest).
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    Single(Vec<f32>),
    Double(Vec<f64>),
}

impl Values {
    /// Returns NumPy's name of the dtype.
    pub fn dtype(&self) -> &'static str {
        match self {
            Self::Single(_) => "float32",
            Self::Double(_) => "float64",
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct NumpyArray {
    pub shape: Vec<usize>,
    pub values: Values,
}

#[derive(Debug, Error)]
pub enum NumpyError {
    /// The file cannot be read, or is not a NumPy array.
    #[error("{}: cannot read the array: {cause}; pass a .npy file written by numpy.save", path.display())]
    Read { path: PathBuf, cause: io::Error },
    /// The elements are not real numbers, or are 8-byte integers.
    #[error("{}: the elements are {found}; save the array as real numbers: numpy.save(file, array.astype('float32'))", path.display())]
    Elements { path: PathBuf, found: String },
    /// The elements are in column-major order, and there is not enough memory to reorder them.
    #[error("{}: the elements are in column-major order, and memory is insufficient to reorder them; save numpy.ascontiguousarray(array)", path.display())]
    Order { path: PathBuf },
    /// The file is shorter than the header states.
    #[error("{}: the file ends before the end of the array of shape {shape:?}; save the array again", path.display())]
    Short { path: PathBuf, shape: Vec<usize> },
}

/// An open `.npy` file of real numbers that is read in parts.
///
/// 8-byte floats and 4-byte integers are read as `f64`, and all other numbers as `f32`. 8-byte integers are
/// refused, because `f64` cannot represent them exactly. Arrays in column-major order, such as a saved
/// transpose, are kept in memory.
#[derive(Debug)]
pub struct NumpyReader {
    path: PathBuf,
    bytes: Bytes,
    /// Length of every axis. The index of the last axis varies fastest.
    pub shape: Vec<usize>,
    element: Element,
    big_endian: bool,
    /// Byte offset of the first element in the file.
    start: u64,
}

impl NumpyReader {
    /// Opens a `.npy` file and checks its header and size.
    ///
    /// # Errors
    /// Returns an error if the file is not a `.npy` file of real numbers, or is truncated.
    pub fn open(path: &Path) -> Result<Self, NumpyError> {
        let failed = |cause| NumpyError::Read { path: path.to_owned(), cause };
        let file = base::input::open(path).map_err(failed)?;
        let bytes = file.metadata().map_err(failed)?.len();
        // Elements are read at arbitrary positions, and a buffered reader would read more bytes than needed.
        let mut buffered = BufReader::new(file);
        let header = Header::read(&mut buffered).map_err(failed)?;
        let start = buffered.stream_position().map_err(failed)?;
        let mut file = buffered.into_inner();
        // `f64` cannot represent all 8-byte integers exactly.
        let exact =
            |(element, _): &(Element, bool)| !matches!(element, Element::Unsigned(8) | Element::Signed(8));
        let Some((element, big_endian)) = header.element().filter(exact) else {
            let found = header.kind.map_or("records".to_owned(), |kind| format!("of type '{kind}'"));
            return Err(NumpyError::Elements { path: path.to_owned(), found });
        };
        let shape = header.shape;
        // Check the size before allocating, because the header of a damaged file may claim any length.
        let count = shape.iter().try_fold(1_u64, |n, len| n.checked_mul(*len as u64));
        let length = count
            .and_then(|n| n.checked_mul(element.size() as u64))
            .filter(|all| all.checked_add(start).is_some_and(|end| end <= bytes))
            .ok_or_else(|| NumpyError::Short { path: path.to_owned(), shape: shape.clone() })?;
        let column_major = header.column_major && shape.iter().filter(|n| **n > 1).count() > 1;
        let (bytes, start) = if column_major && length > 0 {
            let order = || NumpyError::Order { path: path.to_owned() };
            let mut all = vec![];
            let room = usize::try_from(length).map_err(|_| order())?;
            all.try_reserve_exact(room).map_err(|_| order())?;
            file.seek(SeekFrom::Start(start)).map_err(failed)?;
            Read::by_ref(&mut file).take(length).read_to_end(&mut all).map_err(failed)?;
            if all.len() < room {
                return Err(NumpyError::Short { path: path.to_owned(), shape });
            }
            let ordered = row_major(&all, &shape, element.size()).ok_or_else(order)?;
            (Bytes::Memory(ordered), 0)
        } else {
            (Bytes::File(file), start)
        };
        Ok(Self { path: path.to_owned(), bytes, shape, element, big_endian, start })
    }

    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns whether the elements must be read as `f64`.
    pub fn is_double(&self) -> bool {
        matches!(self.element, Element::Float8 | Element::Unsigned(4) | Element::Signed(4))
    }

    /// Reads `out.len()` elements, beginning with element `first`. Several threads may call this function
    /// concurrently.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, or is too short.
    pub fn read<T: Number>(&self, first: usize, out: &mut [T]) -> Result<(), NumpyError> {
        self.try_read(first, out).map_err(|cause| {
            if cause.kind() == io::ErrorKind::UnexpectedEof {
                NumpyError::Short { path: self.path.clone(), shape: self.shape.clone() }
            } else {
                NumpyError::Read { path: self.path.clone(), cause }
            }
        })
    }

    fn try_read<T: Number>(&self, first: usize, out: &mut [T]) -> io::Result<()> {
        let size = self.element.size();
        let at = self.start + first as u64 * size as u64;
        let native = self.big_endian == cfg!(target_endian = "big");
        let same = match self.element {
            Element::Float4 => size_of::<T>() == 4,
            Element::Float8 => size_of::<T>() == 8,
            _ => false,
        };
        if native && same {
            return self.bytes.read_at(at, bytemuck::cast_slice_mut(out));
        }
        let mut buffer = vec![0_u8; size * out.len().min(1 << 14)];
        for (i, part) in out.chunks_mut(1 << 14).enumerate() {
            let bytes = &mut buffer[..part.len() * size];
            self.bytes.read_at(at + ((i * size) << 14) as u64, bytes)?;
            for (value, bytes) in part.iter_mut().zip(bytes.chunks_exact(size)) {
                *value = T::new(self.element.number(bytes, self.big_endian));
            }
        }
        Ok(())
    }
}

impl NumpyArray {
    /// Reads a `.npy` file of real numbers. Floats of 4 or 8 bytes are unchanged. Integers of up to 2 bytes
    /// become `f32`, and 4-byte integers become `f64`.
    ///
    /// # Errors
    /// Returns an error if the file is not a `.npy` file of real numbers, or is truncated.
    pub fn read(path: &Path) -> Result<Self, NumpyError> {
        let reader = NumpyReader::open(path)?;
        let count = reader.len();
        let values = if reader.is_double() {
            let mut out = vec![0.0_f64; count];
            reader.read(0, &mut out)?;
            Values::Double(out)
        } else {
            let mut out = vec![0.0_f32; count];
            reader.read(0, &mut out)?;
            Values::Single(out)
        };
        Ok(Self { shape: reader.shape, values })
    }

    fn write(&self, writer: &mut impl Write) -> io::Result<()> {
        match &self.values {
            Values::Single(values) => write(writer, &self.shape, values.iter().copied()),
            Values::Double(values) => write(writer, &self.shape, values.iter().copied()),
        }
    }
}

/// Writes values in `.npy` format, row-major.
///
/// # Errors
/// Returns an error if the writer fails, or the number of values does not match the shape.
pub fn write<T: NumpyNumber + bytemuck::Pod>(
    writer: impl Write,
    shape: &[usize],
    values: impl IntoIterator<Item = T>,
) -> io::Result<()> {
    // The iterator yields elements one by one, so the output is buffered.
    let mut buffered = BufWriter::with_capacity(1 << 20, writer);
    begin::<T>(&mut buffered, shape)?;
    let mut count = 0;
    for value in values {
        buffered.write_all(bytemuck::bytes_of(&value))?;
        count += 1;
    }
    if count != shape.iter().product::<usize>() {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            format!("{count} values do not fill the shape {shape:?}"),
        ));
    }
    // Dropping the buffer would ignore write errors.
    buffered.flush()
}

/// Writes the header of an array. After the header, [`append`] writes the elements in row-major order.
///
/// # Errors
/// Returns an error if the writer fails.
pub fn begin<T: NumpyNumber>(writer: &mut impl Write, shape: &[usize]) -> io::Result<()> {
    write_header(writer, T::TYPE, shape)
}

/// Appends elements to an array that [`begin`] has started.
///
/// # Errors
/// Returns an error if the writer fails.
pub fn append<T: bytemuck::Pod>(writer: &mut impl Write, values: &[T]) -> io::Result<()> {
    writer.write_all(bytemuck::cast_slice(values))
}

/// Writes elements, beginning with element `first`, into an array whose elements begin at byte `start` of the
/// file. Several threads may call this function concurrently.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn write_at<T: bytemuck::Pod>(file: &File, start: u64, first: usize, values: &[T]) -> io::Result<()> {
    let at = start + first as u64 * size_of::<T>() as u64;
    positioned::write_all_at(file, bytemuck::cast_slice(values), at)
}

/// Writes an array as `.npy`, atomically.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn save<T: NumpyNumber + bytemuck::Pod>(path: &Path, shape: &[usize], values: &[T]) -> io::Result<()> {
    whole_file::write_with(path, |file| {
        begin::<T>(file, shape)?;
        append(file, values)
    })
}

/// Writes named arrays as an uncompressed `.npz` file, as numpy.savez does, atomically.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn write_npz(path: &Path, arrays: &[(String, NumpyArray)]) -> io::Result<()> {
    whole_file::write_with(path, |file| {
        let mut zip = ZipWriter::new(file);
        let options =
            SimpleFileOptions::default().compression_method(CompressionMethod::Stored).large_file(true);
        for (name, array) in arrays {
            zip.start_file(format!("{name}.npy"), options)?;
            array.write(&mut zip)?;
        }
        zip.finish()?.flush()
    })
}

#[cfg(test)]
mod tests;
