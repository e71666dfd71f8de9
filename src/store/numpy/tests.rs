//! Tests the reader with files written by NumPy and with damaged files.

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

/// Verifies that a saved transpose, whose first index varies fastest in the file, is read correctly.
#[test]
fn column_major_arrays_are_read_by_their_indices() {
    let value = |i: usize, j: usize, k: usize| (100 * i + 10 * j + k) as f64;
    let mut header = "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3, 4), }".to_owned();
    header.push_str(&" ".repeat(127 - 10 - header.len()));
    header.push('\n');
    let mut all = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    all.extend_from_slice(header.as_bytes());
    for (k, j, i) in (0..4).flat_map(|k| (0..3).flat_map(move |j| (0..2).map(move |i| (k, j, i)))) {
        all.extend_from_slice(&value(i, j, k).to_le_bytes());
    }
    let rows = (0..2).flat_map(|i| (0..3).flat_map(move |j| (0..4).map(move |k| value(i, j, k))));
    let array = NumpyArray::read(file(&all).path()).expect("an array");
    assert_eq!(array.shape, [2, 3, 4]);
    assert_eq!(array.values, Values::Double(rows.collect()));
    all.truncate(all.len() - 1);
    assert!(NumpyArray::read(file(&all).path()).is_err());
}

#[test]
fn written_arrays_are_read_back() {
    let single = NumpyArray { shape: vec![0, 4], values: Values::Single(vec![]) };
    for array in [example(), single] {
        assert_eq!(NumpyArray::read(file(&bytes(&array)).path()).expect("an array"), array);
    }
}

/// Verifies that number types other than `f32` are read, and that the error for an unsupported type contains
/// a fix.
#[test]
fn number_types_are_converted_or_refused() {
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
    assert_eq!(is(of("|u1", "False", &[1, 2, 3, 255])), Values::Single(vec![1.0, 2.0, 3.0, 255.0]));
    assert_eq!(
        is(of("<u2", "False", &[1, 0, 0, 1, 3, 0, 255, 255])),
        Values::Single(vec![1.0, 256.0, 3.0, 65535.0])
    );
    let big: Vec<u8> = [1.5_f32, -2.0, 0.0, 4.0].iter().flat_map(|v| v.to_be_bytes()).collect();
    assert_eq!(is(of(">f4", "False", &big)), Values::Single(vec![1.5, -2.0, 0.0, 4.0]));
    let message = |got: Result<NumpyArray, NumpyError>| got.expect_err("an error").to_string();
    assert!(message(of("<c8", "False", &[0; 32])).contains("real numbers"));
    // The elements are stored column by column.
    let columns: Vec<u8> = [1.0_f32, 3.0, 2.0, 4.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    assert_eq!(is(of("<f4", "True", &columns)), Values::Single(vec![1.0, 2.0, 3.0, 4.0]));
    assert!(message(of("<f4", "False", &[0; 15])).contains("ends before"));
    assert!(message(NumpyArray::read(file(b"PK").path())).contains("numpy.save"));
}

#[test]
fn archives_hold_arrays() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("all.npz");
    write_npz(&path, &[("a".to_owned(), example()), ("b".to_owned(), example())]).expect("space");
    let mut zip = zip::ZipArchive::new(std::fs::File::open(&path).expect("a file")).expect("an archive");
    for name in ["a.npy", "b.npy"] {
        let mut got = vec![];
        zip.by_name(name).expect("an array").read_to_end(&mut got).expect("bytes");
        assert_eq!(got, bytes(&example()));
    }
}

proptest! {
    /// Verifies that damaged files are refused or read without a panic, and without allocating the size that
    /// a damaged header states.
    #[test]
    fn damaged_files_never_panic(cut in 0_usize..200, at in 0_usize..128, value in any::<u8>()) {
        let mut all = bytes(&example());
        all.truncate(cut);
        if let Some(byte) = all.get_mut(at) {
            *byte = value;
        }
        let _ = NumpyArray::read(file(&all).path());
    }
}
