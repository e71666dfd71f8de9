//! Tests the reconstruction of whole images. The topics are wavelengths, saturation, errors, projection and
//! priors.

use super::*;
use crate::decompose::cloude::is_realizable;
use optics::sampling::stream::Stream;
use proptest::prelude::*;
use rand_distr::{Distribution, StandardNormal};

fn t(p: usize) -> [f64; 16] {
    std::array::from_fn(|e| if e == 0 { 1.0 } else { ((p * 16 + e) as f64).sin() * 0.2 })
}

/// Returns the intensities of pixels that cycle through the wavelengths.
fn captured(scheme: &Scheme, rays: &[Ray], pixels: usize, sigma: f64) -> Vec<f64> {
    let designs: Vec<DesignMatrix> = rays.iter().map(|r| DesignMatrix::new(scheme, r)).collect();
    let count = scheme.measurements();
    let mut out = vec![0.0; count * pixels];
    for p in 0..pixels {
        let clean = designs[p % rays.len()].intensities(&t(p));
        let mut stream = Stream::new(1, p as u32, 0);
        for m in 0..count {
            let z: f64 = StandardNormal.sample(&mut stream);
            out[m * pixels + p] = clean[m] + sigma * z;
        }
    }
    out
}

fn rays() -> Vec<Ray> {
    [450.0, 550.0, 660.0].map(Ray::axial).to_vec()
}

fn chromatic(captures: usize) -> Scheme {
    let text = crate::capture::scheme_file::to_toml(&Scheme::qrpr(captures, false).expect("a scheme"));
    let text = text.expect("TOML").replace(
        "retardance_deg = 90.0",
        "retardance_deg = 90.0\nretardance_error_deg = [[450, 12], [550, 0], [660, -10]]",
    );
    crate::capture::scheme_file::from_toml(std::path::Path::new("c.toml"), &text).expect("a scheme")
}

fn worst(out: &[f64]) -> f64 {
    let off = |(p, m): (usize, &[f64])| (0..16).map(move |e| (m[e] - t(p)[e]).abs()).fold(0.0, f64::max);
    out.chunks(16).enumerate().map(off).fold(0.0, f64::max)
}

#[test]
fn every_wavelength_has_its_own_optics() {
    let (scheme, rays) = (chromatic(20), rays());
    let clean = captured(&scheme, &rays, 300, 0.0);
    let mut out = vec![0.0; 300 * 16];
    let all = Reconstruction::new(&scheme, &rays, Options::default()).expect("rank 16");
    let tally = all.apply(&clean, None, &mut out, None);
    assert_eq!((tally.pixels, tally.partial, tally.lost), (300, 0, 0));
    assert!(worst(&out) < 1e-10);
    let wrong = Reconstruction::new(&scheme, &rays[1..2], Options::default()).expect("rank 16");
    wrong.apply(&clean, None, &mut out, None);
    assert!(worst(&out) > 1e-2);
}

/// Verifies that saturated and missing measurements do not affect other pixels. A pixel with too few
/// measurements is not determined, but the neighbours of the pixel are determined.
#[test]
fn saturated_values_are_excluded_per_pixel() {
    let (scheme, rays) = (Scheme::drr(36, false).expect("a scheme"), rays()[..1].to_vec());
    let mut seen = captured(&scheme, &rays, 100, 0.0);
    let limit = 0.33;
    let mut clipped = 0;
    for (i, v) in seen.iter_mut().enumerate() {
        if i % 100 == 7 || (i % 100 == 9 && i > 300) {
            *v = f64::NAN;
        }
        if *v > limit {
            *v = limit;
            clipped += 1;
        }
    }
    assert!(clipped > 20);
    let options = Options { saturation: Some(limit), ..Options::default() };
    let mut out = vec![0.0; 1600];
    let tally =
        Reconstruction::new(&scheme, &rays, options).expect("rank 16").apply(&seen, None, &mut out, None);
    assert_eq!(tally.lost, 2);
    assert!(tally.partial > 5, "{tally:?}");
    for (p, m) in out.chunks(16).enumerate() {
        assert_eq!(m.iter().any(|v| v.is_nan()), p == 7 || p == 9);
    }
    out.drain(7 * 16..8 * 16);
    let good =
        out.chunks(16).enumerate().map(|(i, m)| (if i < 7 { i } else { i + 1 }, m)).filter(|(p, _)| *p != 9);
    for (p, m) in good {
        assert!((0..16).all(|e| (m[e] - t(p)[e]).abs() < 1e-6), "{p}");
    }
}

/// Verifies that stated errors equal the actual errors. The test covers errors from σ, from a map of
/// variances and from residuals.
#[test]
fn errors_of_matrices_match_actual_errors() {
    let (scheme, rays, pixels, sigma) = (chromatic(24), rays(), 6000, 1e-3);
    let seen = captured(&scheme, &rays, pixels, sigma);
    let variances = vec![sigma * sigma; seen.len()];
    for (noise, variances) in [(Some(sigma), None), (None, None), (None, Some(variances.as_slice()))] {
        let options = Options { noise, ..Options::default() };
        let (mut out, mut errors) = (vec![0.0; pixels * 16], vec![0.0; pixels * 16]);
        let r = Reconstruction::new(&scheme, &rays, options).expect("rank 16");
        r.apply(&seen, variances, &mut out, Some(&mut errors));
        let (mut off, mut stated) = ([0.0; 16], [0.0; 16]);
        for i in 0..pixels * 16 {
            off[i % 16] += (out[i] - t(i / 16)[i % 16]).powi(2);
            stated[i % 16] += errors[i].powi(2);
        }
        for e in 0..16 {
            // The mean of 6000 squares of normal numbers has a relative error of √(2/6000). The estimate σ̂²
            // from 8 redundant measurements adds √(2/8/6000).
            let ratio: f64 = off[e] / stated[e];
            assert!((ratio - 1.0).abs() < 5.0 * (2.25_f64 / 6000.0).sqrt(), "{noise:?} {e}: {ratio}");
        }
    }
}

/// Verifies that projected matrices are realizable, and that the projection does not change realizable
/// matrices.
#[test]
fn projections_are_realizable() {
    let (scheme, rays, pixels) = (Scheme::drr(36, false).expect("a scheme"), rays()[..1].to_vec(), 200);
    let seen = captured(&scheme, &rays, pixels, 0.05);
    let (mut plain, mut projected) = (vec![0.0; pixels * 16], vec![0.0; pixels * 16]);
    for (realizable, out) in [(false, &mut plain), (true, &mut projected)] {
        let options = Options { realizable, ..Options::default() };
        Reconstruction::new(&scheme, &rays, options).expect("rank 16").apply(&seen, None, out, None);
    }
    let of = |m: &[f64]| std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j]));
    let before = plain.chunks(16).filter(|m| is_realizable(&of(m), 1e-9)).count();
    assert!(before < pixels / 2, "{before}");
    assert!(projected.chunks(16).all(|m| is_realizable(&of(m), 1e-9)));
}

/// Verifies that, with few captures, reconstruction fails without a prior and succeeds with a prior at any
/// brightness.
#[test]
fn priors_allow_few_captures() {
    let (scheme, rays, pixels) = (Scheme::qrpr(8, false).expect("a scheme"), rays()[..1].to_vec(), 400);
    let plain = Reconstruction::<f64>::new(&scheme, &rays, Options::default());
    assert!(plain.err().expect("rank 8").to_string().contains("--prior"));
    // The matrices are linear combinations of three terms.
    let truth = |p: usize| -> [f64; 16] {
        let (a, b) = ((p as f64).sin(), (p as f64 * 0.3).cos());
        let s = 10.0_f64.powi(p as i32 % 5);
        let mut t = [0.0; 16];
        (t[0], t[5], t[10], t[15], t[1], t[4]) =
            (s, s * 0.5 * a, s * 0.5 * a, s * 0.4 * a, s * 0.3 * b, s * 0.3 * b);
        t
    };
    let mut s = Moment::zeros();
    for p in 0..pixels {
        let t = nalgebra::SVector::<f64, 16>::from(truth(p)) / truth(p)[0];
        s += t * t.transpose() / pixels as f64;
    }
    let design = DesignMatrix::new(&scheme, &rays[0]);
    let mut seen = vec![0.0; 8 * pixels];
    for p in 0..pixels {
        let clean = design.intensities(&truth(p));
        (0..8).for_each(|m| seen[m * pixels + p] = clean[m]);
    }
    // One measurement of one pixel is missing, so the pixel is solved individually.
    seen[3 * pixels + 11] = f64::NAN;
    let options = Options { prior: Some(s), noise: Some(1e-6), ..Options::default() };
    let mut out = vec![0.0; pixels * 16];
    let r = Reconstruction::new(&scheme, &rays, options).expect("a prior");
    let tally = r.apply(&seen, None, &mut out, None);
    assert_eq!((tally.partial, tally.lost), (1, 0));
    for (p, m) in out.chunks(16).enumerate() {
        let t = truth(p);
        assert!((0..16).all(|e| (m[e] - t[e]).abs() < 1e-3 * t[0]), "{p}: {m:?}");
    }
}

proptest! {
    /// Verifies that realizable matrices of any kind, captured without noise, are recovered from any built-in
    /// scheme of full rank. The projection does not change these matrices.
    #[test]
    fn realizable_matrices_are_recovered(
        raw in prop::array::uniform16(-1.0_f64..1.0),
        bright in -6_i32..6,
        kind in 0_usize..4,
        realizable in any::<bool>(),
    ) {
        let mut m: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| raw[4 * i + j]));
        m[0][0] = 1.0;
        let m = nearest(&m).expect("finite numbers");
        prop_assert!(is_realizable(&m, 1e-9));
        let t: [f64; 16] = std::array::from_fn(|e| m[e / 4][e % 4] * 10.0_f64.powi(bright));
        let scheme = match kind {
            0 => Scheme::drr(36, false),
            1 => Scheme::qrpr(24, false),
            2 => Scheme::qrpr(9, true),
            _ => Scheme::liquid_crystal(24, false),
        };
        let scheme = scheme.expect("a scheme");
        let ray = Ray::axial(550.0);
        let seen = DesignMatrix::new(&scheme, &ray).intensities(&t);
        let options = Options { realizable, ..Options::default() };
        let mut out = [0.0; 16];
        Reconstruction::new(&scheme, &[ray], options)
            .expect("rank 16")
            .apply(seen.as_slice(), None, &mut out, None);
        for e in 0..16 {
            prop_assert!((out[e] - t[e]).abs() < 1e-8 * t[0], "{} {e}: found {}, expected {}", scheme.name, out[e], t[e]);
        }
    }
}
