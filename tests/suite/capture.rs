//! Tests `sunstone capture` and `sunstone trial`. The tests capture stores and arrays, reconstruct the
//! captures, and compare the results.

use crate::commands::{rendered, run};
use crate::decompose::{save, values};
use crate::harness::refusals;
use std::path::Path;
use sunstone::store::numpy::NumpyArray;
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::axes::AxisKind;
use sunstone::tensor::field::Field;

fn read(path: &Path) -> (Vec<usize>, Vec<f64>) {
    let array = NumpyArray::read(path).expect("an array");
    (array.shape.clone(), values(&array))
}

/// Returns the Mueller matrices of 6 x 8 pixels and 3 wavelengths.
fn matrices(folder: &Path) -> Vec<f64> {
    let of = |i: usize| match i % 16 {
        0 => 2.0,
        _ => 0.3 * (i as f64 * 0.61).sin(),
    };
    let all: Vec<f64> = (0..6 * 8 * 3 * 16).map(of).collect();
    save(folder, "M", &[6, 8, 3, 4, 4], &all);
    all
}

/// Runs a command, given as one line.
fn sunstone(folder: &Path, line: &str) -> String {
    run(folder, &line.split_whitespace().collect::<Vec<_>>())
}

fn schemes(folder: &Path) {
    sunstone(folder, "scheme drr -k 36 -o drr36.toml");
    sunstone(folder, "scheme qrpr -k 12 --sensor polarizer-array -o array12.toml");
    sunstone(folder, "scheme drr -k 10 -o drr10.toml");
    // The retardances of the scheme's plates are exact at 550 nm and at no other wavelength.
    let text = std::fs::read_to_string(folder.join("drr36.toml")).expect("a scheme");
    let text = text.replace(
        "retardance_deg = 90.0",
        "retardance_deg = 90.0\nretardance_error_deg = [[450, 10], [550, 0], [660, -8]]",
    );
    std::fs::write(folder.join("plates.toml"), text).expect("space");
}

fn worst(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn captures_are_reconstructed() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    let truth = matrices(d);
    schemes(d);
    for (scheme, shape) in [("plates", &[36, 6, 8, 3][..]), ("array12", &[12, 4, 6, 8, 3])] {
        let message =
            sunstone(d, &format!("capture M.npy --scheme {scheme}.toml --wavelengths 450,550,660 -o I.npy"));
        assert!(message.contains("rank 16") && message.contains("saturated  0.000 %"), "{message}");
        assert_eq!(read(&d.join("I.npy")).0, shape);
        sunstone(
            d,
            &format!("reconstruct I.npy --scheme {scheme}.toml --wavelengths 450,550,660 -o back.npy"),
        );
        let (shape, back) = read(&d.join("back.npy"));
        assert_eq!(shape, [6, 8, 3, 4, 4]);
        assert!(worst(&truth, &back) < 1e-5, "{scheme}: {}", worst(&truth, &back));
    }
    // The camera reports variances, and some pixels saturate.
    let camera = "[cmos]\nphotons_per_unit = 1.2e6\n";
    std::fs::write(d.join("camera.toml"), camera).expect("space");
    sunstone(
        d,
        "capture M.npy --scheme drr36.toml --wavelengths 450,550,660 --detector camera.toml -o I.npy --variance V.npy",
    );
    let ((shape, seen), (_, variances)) = (read(&d.join("I.npy")), read(&d.join("V.npy")));
    assert_eq!(shape, [36, 6, 8, 3]);
    assert!(seen.iter().zip(&variances).all(|(i, v)| i.is_finite() == v.is_finite() && *v > 0.0));
    sunstone(
        d,
        "reconstruct I.npy --scheme drr36.toml --wavelengths 450,550,660 --variance V.npy -o back.npy",
    );
    let (_, back) = read(&d.join("back.npy"));
    let off = back.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / truth.len() as f64;
    assert!(off.sqrt() > 1e-4 && off.sqrt() < 0.2, "{}", off.sqrt());
    // Superpixels halve the width and height of the image.
    std::fs::write(d.join("mosaic.toml"), format!("demosaic = \"superpixel\"\n{camera}")).expect("space");
    sunstone(
        d,
        "capture M.npy --scheme array12.toml --wavelengths 450,550,660 --detector mosaic.toml -o I.npy",
    );
    assert_eq!(read(&d.join("I.npy")).0, [12, 4, 3, 4, 3]);
}

/// Tests that captures of a slice have the wavelengths and time bins of the slice. Tests that a photon
/// counter counts in the time bins of the slice.
#[test]
fn slices_are_captured_along_their_axes() {
    let folder = rendered();
    let d = folder.path();
    schemes(d);
    sunstone(d, "capture out/room.zarr image --scheme plates.toml -o I.npy");
    assert_eq!(read(&d.join("I.npy")).0, [36, 12, 16, 3]);
    sunstone(d, "reconstruct I.npy --scheme plates.toml --wavelengths 450,550,660 -o back.npy");
    let (_, back) = read(&d.join("back.npy"));
    let store = TensorStore::open(&d.join("out/room.zarr")).expect("a store");
    let mean = store.slice("image").expect("a slice").read_all(Field::Mean).expect("values");
    let most = mean.data.iter().fold(0.0, |m: f32, v| m.max(v.abs()));
    for (y, x, w, i, j) in [(6, 8, 0, 0, 0), (6, 8, 2, 1, 1), (3, 5, 1, 3, 2), (9, 11, 2, 2, 0)] {
        let axes = [AxisKind::Y, AxisKind::X, AxisKind::Wavelength, AxisKind::StokesOut, AxisKind::StokesIn];
        let want = mean.at(&axes.into_iter().zip([y, x, w, i, j]).collect::<Vec<_>>());
        let found = back[(((y * 16 + x) * 3 + w) * 4 + i) * 4 + j];
        assert!((found - f64::from(want)).abs() < 1e-5 * f64::from(most), "{found} {want}");
    }
    // With a single selected wavelength, the command does not need `--wavelengths`.
    sunstone(d, "capture out/room.zarr image -k wavelength=450 --scheme plates.toml -o I.npy");
    assert_eq!(read(&d.join("I.npy")).0, [36, 12, 16]);
    sunstone(d, "reconstruct I.npy --scheme plates.toml --wavelengths 450 -o one.npy");
    let (_, one) = read(&d.join("one.npy"));
    let first: Vec<f64> = back.chunks(48).flat_map(|m| m[..16].to_vec()).collect();
    assert!(worst(&one, &first) < 1e-5 * f64::from(most));

    std::fs::write(d.join("spad.toml"), "[spad]\nphotons_per_unit = 0.01\nperiod_ps = 10000\nbin_ps = 100\n")
        .expect("space");
    sunstone(
        d,
        "capture out/room.zarr xt -k v=3 -k u=4 -k x=6:9 --scheme drr10.toml --detector spad.toml -o counts.npy",
    );
    let (shape, counts) = read(&d.join("counts.npy"));
    assert_eq!(shape, [10, 1, 4, 64, 3]);
    assert!(counts.iter().all(|v| v.is_finite()));
}

/// Tests that the error in each row of the table equals the closed form for the given noise. Tests that more
/// captures give smaller errors, with and without a camera model.
#[test]
fn trials_match_closed_forms() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    matrices(d);
    schemes(d);
    let printed = sunstone(
        d,
        "trial M.npy --wavelengths 450,550,660 --scheme drr36.toml --scheme array12.toml --scheme drr10.toml \
         --relative-noise 0.001 --repeat 8 -o t.csv --figure maps.png --curve curve.png",
    );
    assert!(printed.contains("minimum norm") && printed.contains("t.csv"), "{printed}");
    for picture in ["maps.png", "curve.png"] {
        assert!(image::open(d.join(picture)).expect("a picture").width() > 300);
    }
    let text = std::fs::read_to_string(d.join("t.csv")).expect("a table");
    let rows: Vec<Vec<&str>> = text.lines().skip(1).map(|l| l.split(',').collect()).collect();
    assert_eq!(rows.len(), 3);
    let number = |r: usize, c: usize| rows[r][c].parse::<f64>().unwrap_or(f64::NAN);
    for (r, row) in rows.iter().enumerate().take(2) {
        assert_eq!((row[2], row[4]), ("16", "least squares"));
        let (predicted, rmse, error) = (number(r, 5), number(r, 6), number(r, 7));
        // The standard error of 8 trials is itself uncertain. Each mean square covers 18,432 numbers.
        assert!((rmse / predicted - 1.0).abs() < 0.06, "{rmse} {predicted}");
        assert!(error < 0.03 * rmse && number(r, 9) == 0.0);
    }
    // The variance is 196 σ² for dual rotating retarders with 36 captures.
    assert!((number(0, 5) - 1e-3 * (196.0_f64 / 16.0).sqrt()).abs() < 1e-5);
    assert_eq!((rows[2][2], rows[2][5]), ("10", ""));
    assert!(number(2, 6) > 5.0 * number(0, 6));
    std::fs::write(d.join("camera.toml"), "[cmos]\nphotons_per_unit = 8e5\n").expect("space");
    let camera = "trial M.npy --scheme drr36.toml --detector camera.toml -o t.csv";
    sunstone(d, camera);
    let text = std::fs::read_to_string(d.join("t.csv")).expect("a table");
    let rmse: f64 = text.lines().nth(1).and_then(|l| l.split(',').nth(6)?.parse().ok()).expect("a number");
    assert!(rmse > 1e-3 && rmse < 0.2, "{rmse}");
}

#[test]
fn invalid_inputs_are_refused() {
    let folder = rendered();
    let d = folder.path();
    matrices(d);
    schemes(d);
    save(d, "flat", &[2, 16], &[0.0; 32]);
    save(d, "dark", &[2, 4, 4], &[0.0; 32]);
    save(d, "empty", &[36, 0, 5], &[]);
    std::fs::write(d.join("camera.toml"), "[cmos]\nexposure = 1\n").expect("space");
    std::fs::write(d.join("spad.toml"), "[spad]\n").expect("space");
    std::fs::write(d.join("bins.toml"), "[spad]\nbins = 63\n").expect("space");
    let cases = [
        ("capture flat.npy --scheme drr36.toml -o I.npy", "(..., 4, 4)"),
        ("capture M.npy --scheme none.toml -o I.npy", "sunstone scheme drr"),
        ("capture M.npy --scheme drr36.toml -o I.csv", ".npy"),
        ("capture out/room.zarr --scheme drr36.toml -o I.npy", "name the slice"),
        ("capture out/room.zarr image --wavelengths 550 --scheme drr36.toml -o I.npy", "-k wavelength=550"),
        ("capture M.npy --wavelengths 450,550 --scheme drr36.toml -o I.npy", "2 wavelengths"),
        ("capture M.npy --noise -1 --scheme drr36.toml -o I.npy", "'-1'"),
        ("capture M.npy --noise=-1 --scheme drr36.toml -o I.npy", "expected 0 or a number"),
        (
            "capture M.npy --noise 1 --detector camera.toml --scheme drr36.toml -o I.npy",
            "cannot be used with",
        ),
        ("capture M.npy --detector camera.toml --scheme drr36.toml -o I.npy", "camera.toml:2:1"),
        ("capture M.npy --detector spad.toml --scheme drr36.toml -o I.npy", "time bins"),
        ("capture out/room.zarr image --detector spad.toml --scheme drr36.toml -o I.npy", "time bins"),
        (
            "capture out/room.zarr xt -k v=0 -k u=0 --detector bins.toml --scheme drr36.toml -o I.npy",
            "64 bins of 100 ps",
        ),
        ("capture M.npy --noise 1 --scheme drr36.toml -o I.npy --variance V.npy", "--detector"),
        ("reconstruct empty.npy --scheme drr36.toml -o M2.npy", "contains no pixel"),
        ("trial dark.npy --scheme drr36.toml", "not positive"),
        ("trial M.npy --scheme drr36.toml --repeat 0", "1..=10000"),
        ("trial M.npy --scheme drr36.toml --prior none.toml", "pbrdf pca"),
    ];
    refusals(d, &cases);
}
