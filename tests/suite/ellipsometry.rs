//! Tests `sunstone scheme`, `learn` and `reconstruct`.

use crate::commands::run;
use crate::decompose::{save, values};
use crate::harness::refusals;
use std::path::Path;
use sunstone::polarimetry::capture::design_matrix::{DesignMatrix, a_optimal_bound};
use sunstone::polarimetry::capture::element::Ray;
use sunstone::polarimetry::capture::scheme_file::load;
use sunstone::store::numpy::NumpyArray;

/// Returns the elements of the true Mueller matrix at pixel `p`.
fn truth(p: usize) -> [f64; 16] {
    std::array::from_fn(|e| if e == 0 { 1.0 } else { ((p * 16 + e) as f64).sin() * 0.3 })
}

/// Simulates captures of pixels with a scheme in the folder, and saves the intensities in NumPy's format.
fn captured(d: &Path, scheme: &str, shape: &[usize], pixels: usize) {
    let scheme = load(&d.join(scheme)).expect("a scheme");
    let design = DesignMatrix::new(&scheme, &Ray::axial(550.0));
    let mut all = vec![0.0; scheme.measurements() * pixels];
    for p in 0..pixels {
        for (m, i) in design.intensities(&truth(p)).iter().enumerate() {
            all[m * pixels + p] = *i;
        }
    }
    save(d, "i", shape, &all);
}

fn matrices(d: &Path) -> NumpyArray {
    NumpyArray::read(&d.join("m.npy")).expect("matrices")
}

/// Reconstructs captures of an intensity sensor and of a polarizer array. Tests that the result equals the
/// original matrices, for any shape of the pixel array.
#[test]
fn captures_are_reconstructed_to_matrices() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    for (sensor, k, shape) in [
        ("intensity", "36", vec![36, 5, 7]),
        ("intensity", "25", vec![25, 35]),
        ("polarizer-array", "9", vec![9, 4, 7, 5]),
        ("intensity", "20", vec![20, 5, 1, 7]),
    ] {
        run(d, &["scheme", "drr", "-k", k, "--sensor", sensor, "-o", "s.toml"]);
        if k == "20" {
            run(d, &["scheme", "qrpr", "-k", k, "-o", "s.toml"]);
        }
        captured(d, "s.toml", &shape, 35);
        run(d, &["reconstruct", "i.npy", "--scheme", "s.toml", "-o", "m.npy", "--errors", "e.npy"]);
        let found = matrices(d);
        let pixels = if sensor == "intensity" { &shape[1..] } else { &shape[2..] };
        assert_eq!(found.shape, [pixels, &[4, 4]].concat());
        let numbers = values(&found);
        let off = numbers.chunks(16).enumerate().map(|(p, m)| {
            let t = truth(p);
            (0..16).map(|e| (m[e] - t[e]).abs()).fold(0.0, f64::max)
        });
        assert!(off.fold(0.0, f64::max) < 1e-9);
        let errors = NumpyArray::read(&d.join("e.npy")).expect("errors");
        assert_eq!(errors.shape, found.shape);
        // Without noise, the residuals are zero.
        assert!(values(&errors).iter().all(|e| *e < 1e-9));
    }
}

/// Tests that the learned scheme reaches the lower bound of the error. Tests that a seed determines the
/// scheme.
#[test]
fn learned_schemes_reach_the_bound() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    let learn = |name: &str| {
        let few = ["--starts", "4", "--iterations", "250", "--adam-steps", "0"];
        let all = [&["learn", "-k", "16", "-o", name, "--angles", "a.png"][..], &few[..]].concat();
        run(d, &all);
        std::fs::read_to_string(d.join(name)).expect("a scheme")
    };
    assert_eq!(learn("a.toml"), learn("b.toml"));
    let scheme = load(&d.join("a.toml")).expect("a scheme");
    let variance = DesignMatrix::new(&scheme, &Ray::axial(550.0)).error_variance().expect("rank 16");
    assert!((0.9999..1.02).contains(&(variance / a_optimal_bound(&scheme))), "{variance}");
    assert!(image::open(d.join("a.png")).expect("a picture").width() > 300);
    run(d, &["scheme", "show", "a.toml", "b.toml", "--wavelengths", "450,550"]);
    run(d, &["scheme", "matrix", "a.toml", "-o", "A.npy"]);
    assert_eq!(NumpyArray::read(&d.join("A.npy")).expect("a matrix").shape, [16, 16]);
    run(d, &["scheme", "plot", "a.toml", "-o", "p.png"]);
}

/// Tests that six captures with a polarizer array give an accurate estimate with a prior for the same
/// materials.
#[test]
fn learned_priors_are_used_in_reconstruction() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    let few = ["--starts", "2", "--iterations", "60", "--adam-steps", "50", "--resolution", "5x7x9"];
    let what = ["learn", "-k", "4", "--sensor", "polarizer-array", "--estimator", "prior", "-o", "s.toml"];
    run(d, &[&what[..], &few[..], &["--save-prior", "prior.toml", "--folds", "5"]].concat());
    // The captured material is an ideal depolarizer at two brightnesses. The materials of the prior include
    // an ideal depolarizer.
    let scheme = load(&d.join("s.toml")).expect("a scheme");
    let design = DesignMatrix::new(&scheme, &Ray::axial(550.0));
    let mut seen = vec![0.0; 16 * 2];
    for (p, bright) in [1.0, 30.0].into_iter().enumerate() {
        let mut t = [0.0; 16];
        t[0] = bright;
        let i = design.intensities(&t);
        (0..16).for_each(|m| seen[m * 2 + p] = i[m]);
    }
    save(d, "i", &[4, 4, 2], &seen);
    let base = ["reconstruct", "i.npy", "--scheme", "s.toml", "-o", "m.npy", "--prior", "prior.toml"];
    run(d, &[&base[..], &["--noise", "5e-4", "--realizable"]].concat());
    for (m, bright) in values(&matrices(d)).chunks(16).zip([1.0, 30.0]) {
        assert!((m[0] / bright - 1.0).abs() < 0.02, "{m:?}");
        assert!(m[1..].iter().all(|v| v.abs() < 0.05 * bright), "{m:?}");
    }
}

/// Tests that each invalid request gives a message with a fix and exit code 2, and writes nothing.
#[test]
fn wrong_requests_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    run(d, &["scheme", "drr", "-k", "10", "-o", "few.toml"]);
    run(d, &["scheme", "drr", "-k", "36", "-o", "s.toml"]);
    save(d, "i", &[10, 3], &[0.1; 30]);
    save(d, "j", &[36, 2], &[0.1; 72]);
    std::fs::write(d.join("bad.toml"), "sensor = { kind = \"eye\" }\n").expect("space");
    std::fs::write(d.join("p.toml"), "second_moment = [[1.0]]\n").expect("space");
    let cases = [
        ("reconstruct i.npy --scheme few.toml -o m.npy", "rank 10 of 16"),
        ("reconstruct i.npy --scheme s.toml -o m.npy", "(36, ...)"),
        ("reconstruct j.npy --scheme s.toml -o m.txt", ".npy"),
        ("reconstruct j.npy --scheme s.toml -o m.npy --wavelengths 450,550,660", "--wavelengths"),
        ("reconstruct j.npy --scheme bad.toml -o m.npy", "bad.toml:1:19"),
        ("reconstruct j.npy --scheme none.toml -o m.npy", "sunstone scheme drr"),
        ("reconstruct j.npy --scheme s.toml -o m.npy --prior p.toml", "--noise"),
        ("reconstruct j.npy --scheme s.toml -o m.npy --noise 0", "--noise"),
        ("reconstruct j.npy --scheme s.toml -o m.npy --variance i.npy", "--variance"),
        ("reconstruct j.npy --scheme s.toml -o m.npy --prior p.toml --noise 1", "p.toml:1:17"),
        ("scheme drr -k 0 -o x.toml", "no captures"),
        ("scheme drr -k 3 -o x.txt", ".toml"),
        ("learn -k 300 -o x.toml", "1 to 256"),
        ("learn -k 16 --noise 0 -o x.toml", "--noise"),
        ("learn --template none.toml -o x.toml", "none.toml"),
        ("learn -k 4 --estimator prior --data . -o x.toml", ".pbsdf"),
    ];
    refusals(d, &cases);
}
