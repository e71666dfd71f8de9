//! NumPy's files: arrays of numbers that other programs bring and take.

use super::store::write_file_with;
use npyz::{DType, Endianness, NpyFile, NpyHeader, Order, TypeChar, WriterBuilder};
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Values of an array, row-major (the last axis is fastest).
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    Single(Vec<f32>),
    Double(Vec<f64>),
}

/// An array with its shape.
#[derive(Clone, Debug, PartialEq)]
pub struct NumpyArray {
    pub shape: Vec<usize>,
    pub values: Values,
}

/// Why an array could not be read.
#[derive(Debug, Error)]
pub enum NumpyError {
    #[error("{}: {cause}; give a .npy file as numpy.save writes it", path.display())]
    Read { path: PathBuf, cause: io::Error },
    #[error("{}: its elements are {found}; save real numbers: numpy.save(file, array.astype('float32'))", path.display())]
    Elements { path: PathBuf, found: String },
    #[error("{}: its elements are in column-major order; save numpy.ascontiguousarray(array)", path.display())]
    Order { path: PathBuf },
    #[error("{}: it ends before the array of shape {shape:?} does; save it anew", path.display())]
    Short { path: PathBuf, shape: Vec<usize> },
}

impl NumpyArray {
    /// Reads a `.npy` file of real numbers: floats of 4 or 8 bytes as they are, integers of up to 2 bytes as `f32`, larger ones as
    /// `f64`.
    ///
    /// # Errors
    /// If it is no such file, or cut short.
    pub fn read(path: &Path) -> Result<Self, NumpyError> {
        let failed = |cause| NumpyError::Read {
            path: path.to_owned(),
            cause,
        };
        let file = File::open(path).map_err(failed)?;
        let bytes = file.metadata().map_err(failed)?.len();
        let mut reader = BufReader::with_capacity(1 << 20, file);
        let header = NpyHeader::from_reader(&mut reader).map_err(failed)?;
        let shape: Vec<usize> = header.shape().iter().map(|n| *n as usize).collect();
        let elements = |found: String| NumpyError::Elements {
            path: path.to_owned(),
            found,
        };
        let DType::Plain(kind) = header.dtype() else {
            return Err(elements("records".to_owned()));
        };
        if header.order() == Order::Fortran && shape.iter().filter(|n| **n > 1).count() > 1 {
            return Err(NumpyError::Order {
                path: path.to_owned(),
            });
        }
        let short = || NumpyError::Short {
            path: path.to_owned(),
            shape: shape.clone(),
        };
        // Before anything is allocated for a length that a damaged file claims.
        let size = kind.size_field();
        let count = shape.iter().try_fold(1_u64, |n, len| n.checked_mul(*len as u64));
        let count = count
            .filter(|n| n.checked_mul(size).is_some_and(|all| all <= bytes))
            .ok_or_else(short)? as usize;
        let native = kind.endianness() == Endianness::of_machine();
        let read = |e: io::Error| {
            if e.kind() == io::ErrorKind::UnexpectedEof {
                short()
            } else {
                failed(e)
            }
        };
        macro_rules! converted {
            ($from:ty, $to:ty) => {{
                let file = NpyFile::with_header(header.clone(), &mut reader);
                let data = file.data::<$from>().map_err(|e| elements(e.to_string()))?;
                let mut out: Vec<$to> = Vec::with_capacity(count);
                for value in data {
                    out.push(<$to>::from(value.map_err(read)?));
                }
                out
            }};
        }
        let values = match (kind.type_char(), size) {
            (TypeChar::Float, 4) if native => {
                let mut out = vec![0.0_f32; count];
                reader
                    .read_exact(bytemuck::cast_slice_mut(&mut out))
                    .map_err(read)?;
                Values::Single(out)
            }
            (TypeChar::Float, 8) if native => {
                let mut out = vec![0.0_f64; count];
                reader
                    .read_exact(bytemuck::cast_slice_mut(&mut out))
                    .map_err(read)?;
                Values::Double(out)
            }
            (TypeChar::Float, 4) => Values::Single(converted!(f32, f32)),
            (TypeChar::Float, 8) => Values::Double(converted!(f64, f64)),
            (TypeChar::Uint, 1) => Values::Single(converted!(u8, f32)),
            (TypeChar::Uint, 2) => Values::Single(converted!(u16, f32)),
            (TypeChar::Int, 1) => Values::Single(converted!(i8, f32)),
            (TypeChar::Int, 2) => Values::Single(converted!(i16, f32)),
            (TypeChar::Uint, 4) => Values::Double(converted!(u32, f64)),
            (TypeChar::Int, 4) => Values::Double(converted!(i32, f64)),
            _ => return Err(elements(format!("of type '{kind}'"))),
        };
        Ok(Self { shape, values })
    }

    /// Writes `.npy`'s bytes.
    fn write(&self, writer: &mut impl Write) -> io::Result<()> {
        match &self.values {
            Values::Single(values) => write(writer, &self.shape, values.iter().copied()),
            Values::Double(values) => write(writer, &self.shape, values.iter().copied()),
        }
    }
}

/// Writes values as `.npy`'s bytes, row-major.
///
/// # Errors
/// If the writer refuses, or there are not as many values as the shape says.
pub fn write<T: npyz::AutoSerialize>(
    writer: impl Write,
    shape: &[usize],
    values: impl IntoIterator<Item = T>,
) -> io::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|n| *n as u64).collect();
    // Elements are written one by one.
    let mut buffered = BufWriter::with_capacity(1 << 20, writer);
    let options = npyz::WriteOptions::<T>::new().default_dtype().shape(&shape);
    let mut npy = options.writer(&mut buffered).begin_nd()?;
    npy.extend(values)?;
    npy.finish()?;
    // A buffer that is dropped keeps a full disk to itself.
    buffered.flush()
}

/// Writes named arrays as an uncompressed `.npz`, as numpy.savez does; the file appears whole or not at all.
///
/// # Errors
/// If the file system refuses.
pub fn write_npz(path: &Path, arrays: &[(String, NumpyArray)]) -> io::Result<()> {
    write_file_with(path, |file| {
        let mut zip = ZipWriter::new(file);
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(true);
        for (name, array) in arrays {
            zip.start_file(format!("{name}.npy"), options)?;
            array.write(&mut zip)?;
        }
        zip.finish()?.flush()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(bytes: &[u8]) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        file.write_all(bytes).expect("space");
        file
    }

    fn bytes(array: &NumpyArray) -> Vec<u8> {
        let mut out = vec![];
        array.write(&mut out).expect("memory");
        out
    }

    fn example() -> NumpyArray {
        NumpyArray {
            shape: vec![2, 3],
            values: Values::Double(vec![1.0, -2.5, 1e300, 0.0, f64::MIN_POSITIVE, 7.0]),
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let single = NumpyArray {
            shape: vec![0, 4],
            values: Values::Single(vec![]),
        };
        for array in [example(), single] {
            assert_eq!(
                NumpyArray::read(file(&bytes(&array)).path()).expect("an array"),
                array
            );
        }
    }

    /// Other kinds of numbers are taken, and those that are none refused with a mend.
    #[test]
    fn kinds_of_numbers() {
        let of = |kind: &str, order: &str, data: &[u8]| {
            let mut head = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': (2, 2), }}");
            head.push_str(&" ".repeat(118 - head.len() - 1));
            head.push('\n');
            let mut all = b"\x93NUMPY\x01\x00".to_vec();
            all.extend((head.len() as u16).to_le_bytes());
            all.extend(head.bytes());
            all.extend(data);
            NumpyArray::read(file(&all).path())
        };
        let is = |got: Result<NumpyArray, NumpyError>| got.expect("an array").values;
        assert_eq!(
            is(of("|u1", "False", &[1, 2, 3, 255])),
            Values::Single(vec![1.0, 2.0, 3.0, 255.0])
        );
        assert_eq!(
            is(of("<u2", "False", &[1, 0, 0, 1, 3, 0, 255, 255])),
            Values::Single(vec![1.0, 256.0, 3.0, 65535.0])
        );
        let big: Vec<u8> = [1.5_f32, -2.0, 0.0, 4.0]
            .iter()
            .flat_map(|v| v.to_be_bytes())
            .collect();
        assert_eq!(
            is(of(">f4", "False", &big)),
            Values::Single(vec![1.5, -2.0, 0.0, 4.0])
        );
        let message = |got: Result<NumpyArray, NumpyError>| got.expect_err("an error").to_string();
        assert!(message(of("<c8", "False", &[0; 32])).contains("real numbers"));
        assert!(message(of("<f4", "True", &[0; 16])).contains("ascontiguousarray"));
        assert!(message(of("<f4", "False", &[0; 15])).contains("ends before"));
        assert!(message(NumpyArray::read(file(b"PK").path())).contains("numpy.save"));
    }

    /// An archive holds the arrays under their names.
    #[test]
    fn archives_hold_arrays() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("all.npz");
        write_npz(&path, &[("a".to_owned(), example()), ("b".to_owned(), example())]).expect("space");
        let mut zip = zip::ZipArchive::new(File::open(&path).expect("a file")).expect("an archive");
        for name in ["a.npy", "b.npy"] {
            let mut got = vec![];
            zip.by_name(name)
                .expect("an array")
                .read_to_end(&mut got)
                .expect("bytes");
            assert_eq!(got, bytes(&example()));
        }
    }

    proptest! {
        /// Damaged files are refused or read, never a panic nor memory for what they only claim.
        #[test]
        fn damage_is_survived(cut in 0_usize..200, at in 0_usize..128, value in any::<u8>()) {
            let mut all = bytes(&example());
            all.truncate(cut);
            if let Some(byte) = all.get_mut(at) {
                *byte = value;
            }
            let _ = NumpyArray::read(file(&all).path());
        }
    }
}
