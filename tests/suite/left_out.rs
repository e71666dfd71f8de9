//! Tests that commands print the number of items that they omit. If no items remain, commands exit with code
//! 2 and write nothing.

use crate::commands::refused;
use crate::decompose::save;
use crate::harness::{run, stderr, stdout};
use std::path::Path;
use sunstone::base::npy::Header;
use sunstone::rig::ptu::record::RecordType;
use sunstone::rig::ptu::tag::{Tag, Value};
use sunstone::rig::ptu::writer::{self, Description};
use sunstone::store::numpy::{NumpyArray, Values};

/// A record to write. A record is a photon (time, dtime, channel) or a marker (time, bits).
enum Put {
    Photon(u64, u16, u8),
    Marker(u64, u8),
}
use Put::{Marker, Photon};

fn ptu(path: &Path, record: RecordType, resolution_s: f64, tags: Vec<Tag>, all: &[Put]) {
    let description =
        Description { record, resolution_s, global_resolution_s: 1e-7, sync_rate: 10_000_000, tags };
    writer::write(path, &description, |w| {
        for put in all {
            match *put {
                Photon(time, dtime, channel) => w.photon(time, dtime, channel)?,
                Marker(time, bits) => w.marker(time, bits)?,
            }
        }
        Ok(())
    })
    .expect("writes");
}

fn counts(path: &Path) -> (Vec<usize>, Vec<u32>) {
    let bytes = std::fs::read(path).expect("a file");
    let mut elements = &bytes[..];
    let header = Header::read(&mut elements).expect("an array");
    assert_eq!(header.kind.as_deref(), Some("<u4"));
    let counts = header.numbers(elements).expect("counts").into_iter().map(|n| n as u32).collect();
    (header.shape, counts)
}

/// Tests that photons at the end of the laser period, and after its end, are counted. With a resolution of 97
/// ps and a period of 100 ns, the period ends inside bin 1030.
#[test]
fn photons_at_the_end_of_a_period_and_beyond_it_are_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    let record = RecordType::TimeHarp260PT3;
    let three = [Photon(1, 5, 0), Photon(2, 1030, 0), Photon(3, 1040, 0)];
    ptu(&d.join("f.ptu"), record, 97e-12, vec![], &three);
    let out = run(d, &["ptu", "histogram", "f.ptu", "-o", "h.npy"], 0);
    let (shape, all) = counts(&d.join("h.npy"));
    assert_eq!((shape, all.iter().sum::<u32>()), (vec![1, 1041], 3));
    assert!(stderr(&out).contains("later than one laser period (1031 bins)"), "{}", stderr(&out));
    let out = run(d, &["ptu", "histogram", "f.ptu", "-o", "h.npy", "--bins", "1031"], 0);
    assert_eq!(counts(&d.join("h.npy")).1.iter().sum::<u32>(), 2);
    let message = stderr(&out);
    assert!(
        message.contains("2 of 3 photons are counted; not counted: 1 after the last bin (up to 100.880 ns"),
        "{message}"
    );
}

#[test]
fn backward_lines_are_reversed() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    let tag = |name: &str, value| Tag::new(name, value);
    let header = |back: bool| {
        vec![
            tag("ImgHdr_Dimensions", Value::Int(3)),
            tag("ImgHdr_LineStart", Value::Int(1)),
            tag("ImgHdr_LineStop", Value::Int(2)),
            tag("ImgHdr_TimePerPixel", Value::Float(0.01)),
            tag("ImgHdr_PixX", Value::Int(3)),
            tag("ImgHdr_PixY", Value::Int(4)),
            tag("ImgHdr_BiDirect", Value::Bool(back)),
        ]
    };
    let mut all = vec![];
    for y in 0..4 {
        all.extend([Marker(1000 * y, 1), Photon(1000 * y + 50, 0, 0), Marker(1000 * y + 300, 2)]);
    }
    for (back, columns) in [(false, [0, 0, 0, 0]), (true, [0, 2, 0, 2])] {
        ptu(&d.join("f.ptu"), RecordType::GenericT3, 1e-9, header(back), &all);
        let words = ["ptu", "histogram", "f.ptu", "-o", "h.npy", "--pixels", "3,4", "--bins", "1"];
        run(d, &words, 0);
        let image = counts(&d.join("h.npy")).1;
        for (y, column) in columns.into_iter().enumerate() {
            let want = std::array::from_fn(|x| u32::from(x == column));
            assert_eq!(image[3 * y..3 * y + 3], want as [u32; 3], "row {y}, backwards {back}");
        }
    }
    // The command refuses an image size that differs from the size in the header, because the pixels would
    // differ.
    let message = refused(d, &["ptu", "histogram", "f.ptu", "-o", "other.npy", "--pixels", "4,3"]);
    assert!(message.contains("describes 3 columns and 4 rows") && !d.join("other.npy").exists(), "{message}");
}

/// Tests that missing markers, missing sync pulses, missing photons and wrong channels each give a separate
/// message.
#[test]
fn files_without_countable_photons_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    let photons = || vec![Photon(1, 5, 0), Photon(2, 6, 0)];
    let cases: [(RecordType, Vec<Put>, &[&str], &str); 5] = [
        (
            RecordType::GenericT3,
            photons(),
            &["--pixels", "2,2", "--pixel-marker", "3"],
            "marker 3, which begins each pixel, does not occur",
        ),
        (RecordType::GenericT2, photons(), &[], "there are no sync pulses"),
        (RecordType::GenericT3, vec![], &["--channel", "0"], "contains no photons"),
        (RecordType::GenericT3, photons(), &["--channel", "5"], "2 in other channels"),
        (RecordType::GenericT3, photons(), &["--bins", "5"], "2 after the last bin"),
    ];
    for (record, all, more, why) in cases {
        ptu(&d.join("f.ptu"), record, 1e-9, vec![], &all);
        let message = refused(d, &[&["ptu", "histogram", "f.ptu", "-o", "h.npy"], more].concat());
        assert!(message.contains(why) && message.contains("f.ptu"), "{why}: {message}");
        assert!(!d.join("h.npy").exists(), "{why}");
    }
}

/// Writes an array of two diagonal matrices. The diagonal of the second matrix contains `bad`.
fn matrices(folder: &Path, name: &str, bad: [f64; 2]) {
    let of =
        |bad: f64| (0..16).map(move |e| if bad.is_nan() { bad } else { f64::from(u8::from(e % 5 == 0)) });
    let all: Vec<f64> = bad.into_iter().flat_map(of).collect();
    save(folder, name, &[2, 4, 4], &all);
}

#[test]
fn arrays_without_valid_values_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    run(d, &["scheme", "drr", "-k", "36", "-o", "drr36.toml"], 0);
    matrices(d, "one", [1.0, f64::NAN]);
    matrices(d, "none", [f64::NAN; 2]);
    let capture = |name: &'static str| ["capture", name, "--scheme", "drr36.toml", "-o", "I.npy"];
    let message = refused(d, &capture("none.npy"));
    assert!(message.contains("no matrix gives a finite intensity") && !d.join("I.npy").exists(), "{message}");
    let message = stderr(&run(d, &capture("one.npy"), 0));
    assert!(message.contains("36 of 72 intensities"), "{message}");
    // The captures of the second pixel are unknown. With saturation at 1e-9, the command excludes the
    // captures of the first pixel.
    let back = ["reconstruct", "I.npy", "--scheme", "drr36.toml", "-o", "M.npy"];
    let message = stderr(&run(d, &back, 0));
    assert!(message.contains("1 of 2 pixels are NaN"), "{message}");
    std::fs::remove_file(d.join("M.npy")).expect("a file");
    let message = refused(d, &[&back[..], &["--saturation", "1e-9", "--errors", "E.npy"]].concat());
    assert!(message.contains("the captures determine none of the 2 pixels"), "{message}");
    assert!(!d.join("M.npy").exists() && !d.join("E.npy").exists());
    let decompose = |name: &'static str| ["decompose", name, "-o", "props.npz"];
    let message = refused(d, &decompose("none.npy"));
    assert!(message.contains("none of the 2 matrices") && !d.join("props.npz").exists(), "{message}");
    let message = stderr(&run(d, &decompose("one.npy"), 0));
    assert!(message.contains("1 of 2 matrices"), "{message}");
    // An existing file keeps its content.
    let before = std::fs::read(d.join("I.npy")).expect("a file");
    refused(d, &capture("none.npy"));
    assert_eq!(std::fs::read(d.join("I.npy")).expect("a file"), before);
    match NumpyArray::read(&d.join("I.npy")).expect("an array").values {
        Values::Single(v) => assert_eq!(v.iter().filter(|v| v.is_finite()).count(), 36),
        Values::Double(_) => panic!("captures are of single precision"),
    }
}

/// Tests that large lengths require a unit. A number without a unit is in metres, but a board of many metres
/// is probably a mistake.
#[test]
fn large_lengths_need_a_unit() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    let board = |square: &'static str| {
        let size = ["--columns", "9", "--rows", "6", "--square", square, "-o", "c.toml"];
        [&["calibrate", "board", "missing.png"], &size[..]].concat()
    };
    for (square, why) in [
        ("25", "write 25mm or 25m"),
        ("0.51", "write 0.51mm or 0.51m"),
        ("0.3", "the board would be 3.0 m long; write 0.3mm or 0.3m"),
    ] {
        let message = refused(d, &board(square));
        assert!(message.contains(why), "{square}: {message}");
    }
    // The command accepts a length with a unit, or a small length. If the length is accepted, the only error
    // is the missing image.
    for square in ["25m", "25mm", "0.3m", "0.2", "0.025"] {
        let message = refused(d, &board(square));
        assert!(message.contains("missing.png"), "{square}: {message}");
    }
    let words = ["calibrate", "counter", "run.zarr", "--distance", "1500", "-o", "c.toml"];
    let message = refused(d, &words);
    assert!(message.contains("--distance 1500") && message.contains("write 1500mm or 1500m"), "{message}");
    let message = refused(d, &["calibrate", "counter", "run.zarr", "--distance", "1500mm", "-o", "c.toml"]);
    assert!(message.contains("run.zarr"), "{message}");
    // The calibration has no unit, and a baseline of 120.5.
    let calibration = r#"{"K": [[500, 0, 300], [0, 500, 200], [0, 0, 1]], "D": [0, 0, 0, 0],
        "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": [120.5, 0, 0]}"#;
    std::fs::write(d.join("k.json"), calibration).expect("space");
    let import = ["import", "k.json", "--resolution", "640x480"];
    let message = refused(d, &import);
    assert!(message.contains("120.5") && message.contains("--metres-per-unit"), "{message}");
    for unit in ["0.001", "mm", "1mm"] {
        let out = run(d, &[&import[..], &["--metres-per-unit", unit]].concat(), 0);
        assert!(stdout(&out).contains("0.1205"), "{unit}");
    }
}
