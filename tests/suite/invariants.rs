//! Tests that the slices of one render agree, and that every Mueller matrix is realizable.
//!
//! The same samples fill all slices of a render, so sums over the slices' axes agree up to rounding.

use crate::harness::{mirror_room, read, rendered, scene};
use glam::DVec2;
use std::path::Path;
use std::sync::LazyLock;
use sunstone::Scene;
use sunstone::polarimetry::decompose::cloude::{Matrix, eigenvalues};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind;
use sunstone::tensor::field::Field;

/// Number of camera pixels along an image edge, and number of projector pixels along an image edge.
const N: usize = 32;

/// Tolerance relative to M00 for f32 sums of thousands of bins.
const AGREE: f64 = 1e-5;

const SLICES: &str = r#"
[[slices]]
name = "sum"
[[slices]]
name = "mueller"
polarization = "mueller"
[[slices]]
name = "flight"
time = { start_ps = 12000, bin_ps = 150, bins = 60 }
[[slices]]
name = "flight_mueller"
camera = { block = [6, 10, 16, 12] }
time = { start_ps = 12000, bin_ps = 300, bins = 30 }
polarization = "mueller"
[[slices]]
name = "epipolar"
projector = { epipolar = { half_width_px = 1.5 } }
polarization = "mueller"
[[slices]]
name = "epipolar_u"
projector = { epipolar = { half_width_px = 1.5, along = "u" } }
[[slices]]
name = "epipolar_v"
projector = { epipolar = { half_width_px = 1.5, along = "v" } }
polarization = "mueller"
[[slices]]
name = "nonepipolar"
projector = { nonepipolar = { half_width_px = 1.5 } }
polarization = "mueller"
[[slices]]
name = "all"
projector = "all"
[[slices]]
name = "all_mueller"
camera = { block = [10, 12, 9, 7] }
projector = "all"
polarization = "mueller"
[[slices]]
name = "boxes"
projector = { binned = [4, 7] }
[[slices]]
name = "projector_rows"
projector = { rows = [3, 17, 30] }
[[slices]]
name = "projector_columns"
projector = { columns = [0, 20] }
[[slices]]
name = "projector_block"
projector = { block = [5, 9, 20, 11] }
[[slices]]
name = "bounces"
bounces = true
polarization = "mueller"
[[slices]]
name = "split"
split_first_bounce = true
polarization = "mueller"
[[slices]]
name = "everything"
projector = { binned = 16 }
time = { start_ps = 12000, bin_ps = 1500, bins = 6 }
bounces = true
split_first_bounce = true
[[slices]]
name = "all_split"
projector = "all"
split_first_bounce = true
[[slices]]
name = "coaxial"
projector = "coaxial"
split_first_bounce = true
[[slices]]
name = "rows"
camera = { rows = [1, 16, 31] }
polarization = "mueller"
[[slices]]
name = "columns"
camera = { columns = [0, 9, 21] }
polarization = "mueller"
[[slices]]
name = "block"
camera = { block = [7, 3, 18, 22] }
polarization = "mueller"
[[slices]]
name = "coarse"
camera = { binned = 4 }
polarization = "mueller"
[[slices]]
name = "ones"
projector = { mask = "FOLDER/ones.png" }
[[slices]]
name = "mask"
projector = { mask = "FOLDER/mask.png" }
polarization = "mueller"
[[slices]]
name = "complement"
projector = { mask = "FOLDER/complement.png" }
polarization = "mueller"
"#;

struct Render {
    _folder: tempfile::TempDir,
    store: TensorStore,
}

/// Returns the drive of a projector pixel, from 0 to 255. Some pixels are dark, and some have full
/// brightness.
fn drive(u: u32, v: u32) -> u8 {
    [0, 255, 51, 200, 127, 9][((u * 7 + v * 5) % 6) as usize]
}

fn save(folder: &Path, name: &str, f: impl Fn(u32, u32) -> u8) {
    let size = N as u32;
    let image = image::GrayImage::from_fn(size, size, |u, v| image::Luma([f(u, v)]));
    image.save(folder.join(name)).expect("a mask");
}

static RENDER: LazyLock<Render> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    save(folder.path(), "ones.png", |_, _| 255);
    save(folder.path(), "mask.png", drive);
    save(folder.path(), "complement.png", |u, v| 255 - drive(u, v));
    let slices = SLICES.replace("FOLDER", &folder.path().display().to_string());
    let size = N as u32;
    let store = rendered(&scene(&mirror_room(size, size, 64, 16, &slices)), folder.path().join("out.zarr"));
    Render { _folder: folder, store }
});

fn mean(slice: &str) -> Tensor {
    read(&RENDER.store, slice, Field::Mean)
}

fn error(slice: &str) -> Tensor {
    read(&RENDER.store, slice, Field::StdError)
}

/// Returns the M00 of the matrix that contains value `i`.
fn m00(t: &Tensor, i: usize) -> f64 {
    let w = t.extent(AxisKind::Wavelength);
    let stride = t.extent(AxisKind::StokesOut) * t.extent(AxisKind::StokesIn) * w;
    f64::from(t.data[i / stride * stride + i % w])
}

/// Asserts that `got` equals `want` to within [`AGREE`] times M00 of `want`. At least `least` values must be
/// nonzero.
fn assert_agree(what: &str, got: &Tensor, want: &Tensor, least: usize) {
    assert_eq!(got.shape(), want.shape(), "{what}");
    let mut worst = 0.0_f64;
    for (i, (g, w)) in got.data.iter().zip(&want.data).enumerate() {
        assert!(g.is_finite() && w.is_finite(), "{what}: {g} against {w}");
        let (difference, scale) = (f64::from(g - w).abs(), m00(want, i));
        assert!(difference <= AGREE * scale, "{what}: value {i} is {g}, not {w}");
        worst = worst.max(if scale > 0.0 { difference / scale } else { 0.0 });
    }
    let lit = want.data.iter().filter(|w| **w != 0.0).count();
    assert!(lit >= least, "{what}: only {lit} values are not zero");
    println!("{what}: {lit} values, worst relative difference {worst:.1e}");
}

fn plus(a: &Tensor, b: &Tensor) -> Tensor {
    assert_eq!(a.shape(), b.shape());
    let mut out = a.clone();
    out.data.iter_mut().zip(&b.data).for_each(|(o, b)| *o += b);
    out
}

/// Returns the camera pixels of the given rows and columns.
fn pixels(t: &Tensor, rows: &[usize], columns: &[usize]) -> Tensor {
    let [h, w] = [t.shape()[0], t.shape()[1]];
    let inner = t.data.len() / (h * w);
    let mut out = t.clone();
    out.axes[0].coords = rows.iter().map(|y| *y as f64).collect();
    out.axes[1].coords = columns.iter().map(|x| *x as f64).collect();
    out.data.clear();
    for (y, x) in rows.iter().flat_map(|y| columns.iter().map(move |x| (y, x))) {
        out.data.extend(&t.data[(y * w + x) * inner..(y * w + x + 1) * inner]);
    }
    out
}

/// Returns the means of `f(value)` over boxes of `n` × `n` camera pixels.
fn boxes(t: &Tensor, n: usize, f: impl Fn(f64) -> f64) -> Tensor {
    let [h, w] = [t.shape()[0], t.shape()[1]];
    let inner = t.data.len() / (h * w);
    let mut sums = vec![0.0; t.data.len() / (n * n)];
    for (i, v) in t.data.iter().enumerate() {
        let (y, x, k) = (i / inner / w, i / inner % w, i % inner);
        sums[(y / n * (w / n) + x / n) * inner + k] += f(f64::from(*v));
    }
    let mut out = t.clone();
    out.axes[0].coords.truncate(h / n);
    out.axes[1].coords.truncate(w / n);
    out.data = sums.iter().map(|s| (s / (n * n) as f64) as f32).collect();
    out
}

fn all(n: usize) -> Vec<usize> {
    (0..n).collect()
}

#[test]
fn time_bins_and_overflow_add_up_to_steady_state() {
    for (name, want) in
        [("flight", mean("sum")), ("flight_mueller", pixels(&mean("mueller"), &all(22)[10..], &all(22)[6..]))]
    {
        let outside = read(&RENDER.store, name, Field::Overflow);
        let lit = outside.data.iter().filter(|v| **v > 0.0).count();
        assert!(lit > 500, "{name}: the overflow holds {lit} values");
        assert_agree(name, &plus(&mean(name).sum(AxisKind::T), &outside), &want, 2000);
    }
    let summed = mean("everything").sum(AxisKind::T);
    let outside = read(&RENDER.store, "everything", Field::Overflow);
    let kinds = [AxisKind::V, AxisKind::U, AxisKind::Bounces, AxisKind::Component];
    let both = kinds.into_iter().fold(plus(&summed, &outside), |t, k| t.sum(k));
    assert_agree("time, boxes of s', bounces and components", &both, &mean("sum"), 2000);
}

#[test]
fn projector_pixels_add_up_to_the_full_drive() {
    let (all_on, sum) = (mean("all"), mean("sum"));
    assert_agree("all s'", &all_on.sum(AxisKind::V).sum(AxisKind::U), &sum, 2000);
    assert_agree("boxes of s'", &mean("boxes").sum(AxisKind::V).sum(AxisKind::U), &sum, 2000);
    let block = pixels(&mean("mueller"), &all(19)[12..], &all(19)[10..]);
    assert_agree("all s', Mueller", &mean("all_mueller").sum(AxisKind::V).sum(AxisKind::U), &block, 500);
    assert_agree(
        "the two epipolar parts",
        &plus(&mean("epipolar"), &mean("nonepipolar")),
        &mean("mueller"),
        9000,
    );
    let lit = |t: &Tensor| t.data.iter().step_by(48).filter(|v| **v > 0.0).count();
    assert!(lit(&mean("epipolar")) > 500 && lit(&mean("nonepipolar")) > 500, "both parts have light");
}

#[test]
fn projector_parts_equal_parts_of_the_full_slice() {
    let of = |name: &str, rows: &[usize], columns: &[usize]| {
        let (part, part_error) = (mean(name), error(name));
        for (got, whole) in [(part, mean("all")), (part_error, error("all"))] {
            let mut want = got.clone();
            want.data.clear();
            for pixel in whole.data.chunks_exact(N * N * 3) {
                for (v, u) in rows.iter().flat_map(|v| columns.iter().map(move |u| (v, u))) {
                    want.data.extend(&pixel[(v * N + u) * 3..(v * N + u) * 3 + 3]);
                }
            }
            assert!(got.data == want.data, "{name} is not the same part of `all`");
            assert!(got.data.iter().filter(|v| **v > 0.0).count() > 500, "{name} is dark");
        }
    };
    of("projector_rows", &[3, 17, 30], &all(N));
    of("projector_columns", &all(N), &[0, 20]);
    of("projector_block", &all(20)[9..], &all(25)[5..]);
}

/// Returns the distance, in the projector image, of the centre of projector pixel (u, v) from the epipolar
/// line of camera pixel (x, y). The epipolar line is the projection of the camera pixel's ray. Two points of
/// the ray determine the line.
fn from_the_line(scene: &Scene, [x, y]: [usize; 2], [u, v]: [usize; 2]) -> f64 {
    let projector = &scene.projector.as_ref().expect("a projector").pinhole;
    let d = scene.camera.direction(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
    let on_plane = |t: f32| {
        let p = (scene.camera.origin + t * d - projector.origin).as_dvec3();
        let axes = projector.axes;
        let local = [axes.x_axis, axes.y_axis, axes.z_axis].map(|a| p.dot(a.as_dvec3()));
        let at = DVec2::new(local[0], local[1]) / local[2];
        at * projector.focal + projector.principal
    };
    let (a, b) = (on_plane(2.0), on_plane(5.0));
    (b - a).normalize().perp_dot(DVec2::new(u as f64 + 0.5, v as f64 + 0.5) - a).abs()
}

/// Tests that the slices of an epipolar band contain exactly the projector pixels that a direct computation
/// finds.
#[test]
fn an_epipolar_band_is_resolved_along_its_line() {
    let scene = scene(&mirror_room(N as u32, N as u32, 64, 16, ""));
    let (all_on, by_u, by_v) = (mean("all"), mean("epipolar_u"), mean("epipolar_v"));
    assert_eq!(by_u.shape(), [N, N, N, 3]);
    assert_eq!(by_v.shape(), [N, N, N, 4, 4, 3]);
    let (mut want_u, mut want_v) = (by_u.clone(), by_v.select(AxisKind::StokesOut, 0));
    want_v = want_v.select(AxisKind::StokesIn, 0);
    let got_v = want_v.clone();
    want_u.data.fill(0.0);
    want_v.data.fill(0.0);
    let (mut inside, mut nearest) = (0, f64::INFINITY);
    for (pixel, light) in all_on.data.chunks_exact(N * N * 3).enumerate() {
        for (s, values) in light.chunks_exact(3).enumerate() {
            let distance = from_the_line(&scene, [pixel % N, pixel / N], [s % N, s / N]);
            nearest = nearest.min((distance - 1.5).abs());
            if distance > 1.5 {
                continue;
            }
            inside += 1;
            for (lane, value) in values.iter().enumerate() {
                want_u.data[(pixel * N + s % N) * 3 + lane] += value;
                want_v.data[(pixel * N + s / N) * 3 + lane] += value;
            }
        }
    }
    // Computed distances are accurate to about 1e-5 pixels, so no distance may be closer to the edge of the
    // band.
    assert!(nearest > 1e-5, "{nearest}");
    assert!(inside > 50_000, "{inside} pairs");
    assert_agree("along u", &by_u, &want_u, 2000);
    assert_agree("along v", &got_v, &want_v, 2000);
    let whole = mean("epipolar");
    assert_agree("along v, summed", &by_v.sum(AxisKind::V), &whole, 9000);
}

/// Tests that direct coaxial light is the diagonal of the full slice. A statistical test compares indirect
/// light, because coaxial slices use separate paths for indirect light (`tests/transport/selected.rs`).
#[test]
fn direct_coaxial_light_is_the_diagonal_of_the_full_slice() {
    for (got, whole) in [(mean("coaxial"), mean("all_split")), (error("coaxial"), error("all_split"))] {
        let got = got.select(AxisKind::Component, 0);
        let mut want = got.clone();
        want.data.clear();
        // For each s', the full slice has direct and indirect light, at three wavelengths each.
        for (pixel, values) in whole.data.chunks_exact(N * N * 6).enumerate() {
            want.data.extend(&values[pixel * 6..pixel * 6 + 3]);
        }
        assert_agree("coaxial", &got, &want, 100);
    }
}

#[test]
fn masks_are_linear() {
    assert_agree("a mask of ones", &mean("ones"), &mean("sum"), 2000);
    assert_agree("errors of a mask of ones", &error("ones"), &error("sum"), 2000);
    assert_agree("mask and complement", &plus(&mean("mask"), &mean("complement")), &mean("mueller"), 9000);
    let all_on = mean("all");
    let mut want = mean("ones");
    for (out, pixel) in want.data.chunks_exact_mut(3).zip(all_on.data.chunks_exact(N * N * 3)) {
        let weight = |s: usize| f64::from(drive((s % N) as u32, (s / N) as u32)) / 255.0;
        for (k, o) in out.iter_mut().enumerate() {
            *o = (0..N * N).map(|s| f64::from(pixel[s * 3 + k]) * weight(s)).sum::<f64>() as f32;
        }
    }
    let got = mean("mask").select(AxisKind::StokesOut, 0).select(AxisKind::StokesIn, 0);
    assert_agree("a mask is T times the drive", &got, &want, 2000);
}

#[test]
fn bounces_and_components_add_up() {
    let whole = mean("mueller");
    assert_agree("bounces", &mean("bounces").sum(AxisKind::Bounces), &whole, 9000);
    assert_agree("direct and indirect", &mean("split").sum(AxisKind::Component), &whole, 9000);
    let direct = mean("split").select(AxisKind::Component, 0);
    assert_agree("one bounce is direct", &mean("bounces").select(AxisKind::Bounces, 1), &direct, 2000);
    assert!(
        mean("bounces").select(AxisKind::Bounces, 0).data.iter().all(|v| *v == 0.0),
        "no emitter is seen"
    );
}

#[test]
fn camera_parts_equal_pixels_of_the_full_image() {
    for (of, whole) in [(mean as fn(&str) -> Tensor, mean("mueller")), (error, error("mueller"))] {
        assert!(of("rows").data == pixels(&whole, &[1, 16, 31], &all(N)).data, "rows");
        assert!(of("columns").data == pixels(&whole, &all(N), &[0, 9, 21]).data, "columns");
        assert!(of("block").data == pixels(&whole, &all(25)[3..], &all(25)[7..]).data, "block");
    }
    let coarse = boxes(&mean("mueller"), 4, |v| v);
    assert_agree("camera boxes", &mean("coarse"), &coarse, 500);
    // Pixels are independent. The variance of the mean over pixels is therefore the mean of the pixels'
    // variances, divided by the number of pixels.
    let mut want = boxes(&error("mueller"), 4, |e| e * e / 16.0);
    want.data.iter_mut().for_each(|v| *v = v.sqrt());
    let got = error("coarse");
    for (g, w) in got.data.iter().zip(&want.data) {
        assert!((g - w).abs() <= 1e-5 * w, "errors of camera boxes: {g} is not {w}");
    }
    assert!(want.data.iter().filter(|v| **v > 0.0).count() > 500);
}

#[test]
fn intensity_is_the_first_mueller_element() {
    for (of, what) in [(mean as fn(&str) -> Tensor, "mean"), (error, "standard error")] {
        let m = of("mueller").select(AxisKind::StokesOut, 0).select(AxisKind::StokesIn, 0);
        assert_agree(what, &of("sum"), &m, 2000);
    }
}

#[test]
fn a_finished_render_has_no_discarded_samples() {
    let attributes = RENDER.store.attributes();
    assert_eq!(attributes["status"], "complete");
    assert_eq!(attributes["discarded_samples"], 0);
    let samples = RENDER.store.read_samples([0, 0], [N as u64, N as u64]).expect("samples");
    assert!(samples.iter().all(|n| *n == 64));
}

/// Tests that every stored Mueller matrix is realizable. A stored matrix is a mean of the realizable matrices
/// of paths, so only f32 rounding can make an eigenvalue of Cloude's H negative.
///
/// The test also checks the looser statistical bound. Errors e_ij of the elements change H by E = ¼ Σ e_ij
/// σ_i ⊗ σ_j*. By Weyl's inequality, eigenvalues change by at most ‖E‖₂ ≤ ‖E‖_F = ½ √Σ e_ij², because the
/// products of Pauli matrices are orthogonal with norm 2. Therefore, five standard errors of an eigenvalue
/// are at most 2.5 √Σ std_error².
#[test]
fn every_mueller_matrix_is_realizable() {
    let mut checked = 0;
    for name in RENDER.store.slice_names() {
        let t = mean(name);
        if t.find(AxisKind::StokesOut).is_none() {
            continue;
        }
        let errors = error(name);
        let w = t.extent(AxisKind::Wavelength);
        let (mut matrices, mut worst) = (0, 0.0_f64);
        for (values, e) in t.data.chunks_exact(16 * w).zip(errors.data.chunks_exact(16 * w)) {
            for lane in 0..w {
                let at = |i: usize, j: usize| f64::from(values[(4 * i + j) * w + lane]);
                let scale = at(0, 0);
                if scale == 0.0 {
                    assert!(
                        (0..16).all(|k| values[k * w + lane] == 0.0),
                        "{name}: polarization without light"
                    );
                    continue;
                }
                let m: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| at(i, j) / scale));
                let least = eigenvalues(&m).expect("finite elements")[3];
                let variance: f64 = (0..16).map(|k| f64::from(e[k * w + lane]).powi(2)).sum();
                assert!(least >= -2.5 * variance.sqrt() / scale - 1e-5, "{name}: {m:?} has {least}");
                assert!(least >= -1e-5, "{name}: {m:?} has eigenvalue {least}");
                worst = worst.min(least);
                matrices += 1;
            }
        }
        println!("{name}: {matrices} matrices, least eigenvalue / M00 {worst:.1e}");
        assert!(matrices > 150, "{name} has {matrices} matrices with light");
        checked += 1;
    }
    assert_eq!(checked, 14);
}
