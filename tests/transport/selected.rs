//! Tests slices that keep few projector pixels s' per camera pixel. The renderer uses additional paths for
//! slices with few s'. The additional paths give the same light as random paths, with far smaller standard
//! errors.

use crate::support::{mirror_room, scene_of};
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind::{self, Bounces, StokesIn, StokesOut, T, U, V, Wavelength, X, Y};
use sunstone::tensor::field::Field;
use sunstone::tensor::memory::Arrays;
use sunstone::transport::render::schedule::{Share, Unwatched, render};
use sunstone::transport::scene::Integrator;

/// Number of camera pixels per row, and number of projector pixels per row.
const SIZE: usize = 16;
const SPP: u32 = 512;

/// A slice that resolves all projector pixels s'. All values of the slice come from random paths.
const ALL: &str = r#"
[[slices]]
name = "matrices"
projector = "all"
polarization = "mueller"
bounces = true
[[slices]]
name = "flight"
projector = "all"
time = { start_ps = 12000, bin_ps = 1500, bins = 8 }
"#;

/// Slices with few projector pixels s'.
const FEW: &str = r#"
[[slices]]
name = "coaxial"
projector = "coaxial"
polarization = "mueller"
bounces = true
[[slices]]
name = "block"
projector = { block = [6, 7, 2, 2] }
time = { start_ps = 12000, bin_ps = 1500, bins = 8 }
[[slices]]
name = "strip"
projector = { block = [9, 4, 1, 4] }
polarization = "mueller"
bounces = true
"#;

/// A slice with a band about the epipolar line of each camera pixel. The slice resolves s' and uses random
/// paths.
const ALONG: &str = r#"
[[slices]]
name = "along"
projector = { epipolar = { half_width_px = 0.5, along = "u" } }
bounces = true
"#;
const BAND: &str = r#"
[[slices]]
name = "band"
projector = { epipolar = { half_width_px = 0.5 } }
bounces = true
"#;

/// Number of projector pixels per row for which a band is a small fraction of the projector.
const WIDE: u32 = 256;

fn room(slices: &str, seed: u64, spp: u32) -> Arrays {
    room_of(SIZE as u32, slices, seed, spp)
}

/// Renders the room with a projector of `projector` pixels per row.
fn room_of(projector: u32, slices: &str, seed: u64, spp: u32) -> Arrays {
    let mut scene = scene_of(&mirror_room(SIZE as u32, projector, spp, 8, slices));
    scene.set_integrator(Integrator::Path);
    scene.change_settings(|s| (s.seed, s.replicates) = (seed, spp));
    let mut arrays = Arrays::default();
    let summary =
        render(&scene, &[], Share::default(), &mut arrays, &Unwatched).expect("arrays take everything");
    assert_eq!(summary.discarded, 0);
    arrays
}

/// Returns the means and standard errors of a slice.
fn of(arrays: &Arrays, slice: &str) -> [Tensor; 2] {
    [Field::Mean, Field::StdError].map(|f| arrays.get(slice, f).expect("the field"))
}

/// Indices along some axes.
type Index = Vec<(AxisKind, usize)>;

/// Returns the s' that a slice keeps for camera pixel (x, y). Each entry has the column and row of s', and
/// the index along the slice's own axes.
fn kept(slice: &str, [x, y]: [usize; 2]) -> Vec<([usize; 2], Index)> {
    match slice {
        "coaxial" => vec![([x, y], vec![])],
        "block" => (0..4).map(|i| ([6 + i % 2, 7 + i / 2], vec![(V, i / 2), (U, i % 2)])).collect(),
        // The caller has already summed over the resolved axes.
        "band" => vec![([0, 0], vec![])],
        _ => (0..4).map(|v| ([9, 4 + v], vec![(V, v), (U, 0)])).collect(),
    }
}

/// Largest relative standard error of an intensity from random paths. A larger value is due to few hits, for
/// which errors are unreliable.
const KNOWN: f64 = 0.15;

/// Smallest standard error of an element, relative to that of the intensity.
const LEAST_ERROR: f64 = 0.1;

/// Minimum number of compared elements.
const LEAST: u32 = 6;

/// Compares, for each element, the sums over the image. If direct light is separate, the sums exclude direct
/// light. `factor` multiplies the second render. Returns the largest difference in standard errors, and the
/// mean ratio of the variances of the intensity.
fn compare(all: [&Tensor; 2], few: [&Tensor; 2], slice: &str, factor: f64) -> [f64; 2] {
    let rest: Vec<AxisKind> = [T, Bounces, StokesOut, StokesIn, Wavelength].into();
    let lengths: Vec<usize> = rest.iter().map(|k| few[0].extent(*k)).collect();
    let (mut worst, mut ratio, mut count, mut elements) = (0.0_f64, 0.0, 0.0, 0);
    let (mut known, mut of_intensity) = (vec![], vec![0.0; lengths[4]]);
    for number in 0..lengths.iter().product::<usize>() {
        let mut index = vec![];
        let mut left = number;
        for (kind, length) in rest.iter().zip(&lengths).rev() {
            index.push((*kind, left % length));
            left /= length;
        }
        let direct = index.iter().any(|(kind, i)| *kind == Bounces && *i < 2) && lengths[1] > 1;
        let (mut sums, mut squares) = ([0.0; 2], [0.0; 2]);
        for (x, y) in (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE)) {
            for ([u, v], own) in kept(slice, [x, y]) {
                let place = |more: &[(AxisKind, usize)]| {
                    let pixel = [(Y, y), (X, x)];
                    pixel.iter().chain(more).chain(&index).copied().collect::<Index>()
                };
                let places = [place(&[(V, v), (U, u)]), place(&own)];
                for (k, tensors) in [all, few].into_iter().enumerate() {
                    sums[k] += f64::from(tensors[0].at(&places[k]));
                    squares[k] += f64::from(tensors[1].at(&places[k])).powi(2);
                }
            }
        }
        // The function compares a matrix if its intensities, which come first, are reliable at all
        // wavelengths.
        let first = index.iter().all(|(kind, i)| !matches!(kind, StokesOut | StokesIn) || *i == 0);
        let matrix = number / (lengths[2] * lengths[3] * lengths[4]);
        if first {
            known.resize(matrix + 1, true);
            known[matrix] &= squares[0].sqrt() < KNOWN * sums[0];
        }
        if !known[matrix] || direct {
            continue;
        }
        elements += 1;
        // The random error of elements to which almost no path contributes is zero, so a minimum error is
        // used.
        let wavelength = number % lengths[4];
        let mut error = (squares[0] + squares[1]).sqrt();
        if first {
            of_intensity[wavelength] = error;
        }
        error = error.max(LEAST_ERROR * of_intensity[wavelength]);
        worst = worst.max((sums[0] - factor * sums[1]).abs() / error);
        if first && squares[1] > 0.0 {
            ratio += squares[0] / squares[1];
            count += 1.0;
        }
    }
    assert!(elements >= LEAST, "{slice}: {elements} elements are known");
    [worst, ratio / count]
}

/// Compares random and additional paths with 512 samples for each of 256 pixels. The negative control counts
/// paths twice.
#[test]
#[ignore = "slow: tools/check --all"]
fn drawn_projector_pixels_agree_with_the_full_slice() {
    let (by_chance, drawn) = (room(ALL, 1, SPP), room(FEW, 2, SPP));
    for (slice, truth, least) in
        [("coaxial", "matrices", 1.5), ("block", "flight", 1.2), ("strip", "matrices", 1.2)]
    {
        let (all, few) = (of(&by_chance, truth), of(&drawn, slice));
        let (all, few) = ([&all[0], &all[1]], [&few[0], &few[1]]);
        let [worst, ratio] = compare(all, few, slice, 1.0);
        let [planted, _] = compare(all, few, slice, 2.0);
        assert!(worst < 5.0, "{slice}: {worst} standard errors");
        assert!(planted > 5.0, "{slice}: paths that count twice are not found");
        assert!(ratio > least, "{slice}: variances fall by {ratio} alone");
    }
}

/// Compares random and additional paths for bands about epipolar lines.
#[test]
fn drawn_bands_agree_with_the_full_slice() {
    let (by_chance, drawn) = (room_of(WIDE, ALONG, 1, SPP), room_of(WIDE, BAND, 2, SPP));
    let [mean, mut error] = of(&by_chance, "along");
    // No path of a sample is in two columns with the same number of bounces, so the variances (nearly) add.
    error.data.iter_mut().for_each(|e| *e *= *e);
    let mut error = error.sum(U);
    error.data.iter_mut().for_each(|e| *e = e.sqrt());
    let (all, few) = ([mean.sum(U), error], of(&drawn, "band"));
    let (all, few) = ([&all[0], &all[1]], [&few[0], &few[1]]);
    let [worst, ratio] = compare(all, few, "band", 1.0);
    let [planted, _] = compare(all, few, "band", 2.0);
    assert!(worst < 5.0, "{worst} standard errors");
    assert!(planted > 5.0, "paths that count twice are not found");
    assert!(ratio > 1.2, "variances fall by {ratio} alone");
}

/// Tests that a slice with few projector pixels s' does not change the remaining slices of the render.
#[test]
#[ignore = "slow: tools/check --all"]
fn other_slices_keep_their_bits() {
    let others = "[[slices]]\nname = \"photo\"\npolarization = \"mueller\"\n".to_owned() + ALL;
    let (alone, beside) = (room(&others, 3, 2), room(&(FEW.to_owned() + &others), 3, 2));
    for slice in ["photo", "matrices", "flight"] {
        assert_eq!(of(&alone, slice), of(&beside, slice), "{slice}");
    }
    let others = "[[slices]]\nname = \"photo\"\npolarization = \"mueller\"\n".to_owned() + ALONG;
    let (alone, beside) = (room_of(WIDE, &others, 3, 2), room_of(WIDE, &(BAND.to_owned() + &others), 3, 2));
    for slice in ["photo", "along"] {
        assert_eq!(of(&alone, slice), of(&beside, slice), "{slice}");
    }
}
