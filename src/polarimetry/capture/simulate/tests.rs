//! Tests simulated captures against the design matrix. Also tests the noise of the captures against the
//! stated standard deviation.

use super::*;
use crate::capture::detector::testing::Moments;

/// Returns matrices that differ between pixels, with T00 equal to `scale`. No intensity is close to zero.
fn matrices(layout: Layout, scale: f64) -> Vec<f64> {
    let of = |i: usize| match i % 16 {
        0 => scale,
        _ => scale * 0.1 * (i as f64 * 0.37).sin(),
    };
    (0..layout.pixels() * 16).map(of).collect()
}

const SMALL: Layout = Layout { height: 4, width: 6, times: 2, lanes: 3 };

fn rays() -> Vec<Ray> {
    [450.0, 550.0, 660.0].map(Ray::axial).to_vec()
}

fn drr(captures: usize, array: bool) -> Scheme {
    Scheme::drr(captures, array).expect("a scheme")
}

fn camera(photons_per_unit: f64) -> Noise {
    Noise::Cmos { camera: Cmos { photons_per_unit, ..Cmos::default() }, demosaic: None }
}

/// Returns a camera without noise except the quantization of 1e7 electrons to 24 bits.
fn still(demosaic: Option<Method>, binning: u32) -> Noise {
    Noise::Cmos {
        camera: Cmos {
            shot_noise: false,
            read_noise_e: 0.0,
            dark_current_e_s: 0.0,
            full_well_e: 1e7,
            bit_depth: 24,
            photons_per_unit: 5e8,
            binning,
            ..Cmos::default()
        },
        demosaic,
    }
}

#[test]
fn without_noise_intensities_are_the_design_matrix() {
    let scheme = drr(9, true);
    let m = matrices(SMALL, 2.0);
    let got = simulate(&m, SMALL, &scheme, &rays(), &Noise::None, 0).expect("fits");
    assert_eq!((got.layout, got.saturated, &got.variances), (SMALL, 0, &None));
    let pixels = SMALL.pixels();
    for (p, matrix) in m.chunks_exact(16).enumerate() {
        let design = DesignMatrix::new(&scheme, &rays()[p % 3]);
        let want = design.intensities(&std::array::from_fn(|e| matrix[e]));
        for k in 0..36 {
            assert!((f64::from(got.intensities[k * pixels + p]) - want[k]).abs() < 1e-6);
        }
    }
}

#[test]
fn normal_noise_has_its_mean_and_variance() {
    let layout = Layout { height: 40, width: 50, ..SMALL };
    let m = matrices(layout, 1.0);
    let (scheme, sigma) = (drr(10, false), 0.03);
    let clean = simulate(&m, layout, &scheme, &rays(), &Noise::None, 5).expect("fits");
    let noisy = simulate(&m, layout, &scheme, &rays(), &Noise::Gaussian { sigma }, 5).expect("fits");
    let pairs = noisy.intensities.iter().zip(&clean.intensities);
    let seen = Moments::of(pairs.map(|(a, b)| f64::from(*a) - f64::from(*b)));
    seen.assert_mean(0.0, sigma * sigma);
    seen.assert_variance(sigma * sigma, 0.0);
    let other = simulate(&m, layout, &scheme, &rays(), &Noise::Gaussian { sigma }, 6).expect("fits");
    assert_ne!(noisy.intensities, other.intensities);
}

/// Verifies that a camera's stated variances agree with the scatter of readings over many seeds, with and
/// without a mosaic.
#[test]
fn camera_variances_match_the_scatter() {
    let m = matrices(SMALL, 1.0);
    for (demosaic, array) in [(None, false), (Some(Method::Bilinear), true), (Some(Method::Superpixel), true)]
    {
        let with = |noise: Noise| match noise {
            Noise::Cmos { camera, .. } => Noise::Cmos { camera, demosaic },
            other => other,
        };
        let scheme = drr(4, array);
        let shoot = |noise: &Noise, seed| simulate(&m, SMALL, &scheme, &rays(), noise, seed).expect("fits");
        let clean = shoot(&with(still(None, 1)), 0);
        let (mut off, mut stated, mut n) = (vec![], 0.0, 0.0);
        for seed in 0..60 {
            let seen = shoot(&with(camera(1e6)), seed);
            let variances = seen.variances.expect("a camera's");
            for ((a, b), v) in seen.intensities.iter().zip(&clean.intensities).zip(&variances) {
                // The difference is divided by the stated standard deviation, so bright and dark pixels have
                // equal weight.
                off.push(f64::from(*a - *b) / f64::from(*v).sqrt());
                stated += f64::from(*v);
                n += 1.0;
            }
        }
        assert!(stated / n > 0.0);
        let seen = Moments::of(off.into_iter());
        // Neighbours in a bilinear image share pixels. At least a quarter of the values are independent.
        let independent = if demosaic == Some(Method::Bilinear) { 4.0 } else { 1.0 };
        let of = Moments { n: seen.n / independent, ..seen };
        // The variance is computed from the reading, so the quotient has a relative error of about 1/(2
        // √electrons).
        assert!(of.mean.abs() < 5.0 / of.n.sqrt() + 0.02, "{}", of.mean);
        of.assert_variance(1.0, 0.0);
    }
}

#[test]
fn threads_do_not_matter() {
    let m = matrices(SMALL, 1.0);
    let diode = Noise::Spad(Spad { bins: 2, bin_ps: 1000.0, period_ps: 20_000.0, ..Spad::default() });
    for noise in [Noise::Gaussian { sigma: 0.1 }, camera(1e5), still(Some(Method::Bilinear), 1), diode] {
        let of = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| simulate(&m, SMALL, &drr(8, true), &rays(), &noise, 3).expect("fits"))
        };
        let bits = |c: &Captured| c.intensities.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        let (one, four) = (of(1), of(4));
        assert_eq!((bits(&one), one.saturated), (bits(&four), four.saturated));
    }
}

#[test]
fn saturated_intensities_are_nan() {
    let m = matrices(SMALL, 1.0);
    let got = simulate(&m, SMALL, &drr(5, false), &rays(), &camera(1e8), 0).expect("fits");
    assert_eq!(got.saturated, got.intensities.len());
    assert!(got.intensities.iter().all(|v| v.is_nan()));
    assert!(got.variances.is_some_and(|v| v.iter().all(|v| v.is_infinite())));
}

/// Verifies that binning halves width and height. Each reading equals the intensity for the mean matrix of
/// the binned pixels.
#[test]
fn binning_is_the_mean_of_the_matrices() {
    let odd = Layout { height: 5, width: 7, ..SMALL };
    let m = matrices(odd, 1.0);
    let scheme = drr(16, false);
    let got = simulate(&m, odd, &scheme, &rays(), &still(None, 2), 0).expect("fits");
    assert_eq!((got.layout.height, got.layout.width), (2, 3));
    let mean = averaged(&m, odd, got.layout);
    let want = simulate(&mean, got.layout, &scheme, &rays(), &Noise::None, 0).expect("fits");
    let worst = got.intensities.iter().zip(&want.intensities).map(|(a, b)| (a - b).abs());
    assert!(worst.fold(0.0, f32::max) < 2e-6);
}

/// Verifies that demosaicking by superpixels recovers images that are constant within each superpixel.
/// Bilinear demosaicking recovers constant images.
#[test]
fn mosaics_of_uniform_images_are_recovered() {
    let half = Layout { height: 2, width: 3, ..SMALL };
    let small = matrices(half, 1.0);
    let inner = SMALL.times * SMALL.lanes * 16;
    let spread = |of: &dyn Fn(usize, usize) -> usize| -> Vec<f64> {
        let places = (0..SMALL.height * SMALL.width).map(|i| of(i / SMALL.width, i % SMALL.width));
        places.flat_map(|p| small[p * inner..(p + 1) * inner].to_vec()).collect()
    };
    let blocks = spread(&|y, x| y / 2 * 3 + x / 2);
    let even = spread(&|_, _| 0);
    for (m, method) in [(&blocks, Method::Superpixel), (&even, Method::Bilinear)] {
        let scheme = drr(8, true);
        let got = simulate(m, SMALL, &scheme, &rays(), &still(Some(method), 1), 0).expect("fits");
        assert_eq!(got.layout, if method == Method::Superpixel { half } else { SMALL });
        let truth = averaged(m, SMALL, got.layout);
        let want = simulate(&truth, got.layout, &scheme, &rays(), &Noise::None, 0).expect("fits");
        let worst = got.intensities.iter().zip(&want.intensities).map(|(a, b)| (a - b).abs());
        assert!(worst.fold(0.0, f32::max) < 4e-6, "{method:?}");
    }
}

#[test]
fn mean_counts_of_a_diode_equal_the_intensities() {
    let layout = Layout { height: 1, width: 3, times: 40, lanes: 1 };
    let m = matrices(layout, 1.0);
    let diode = |bins| {
        Noise::Spad(Spad {
            bins,
            bin_ps: 100.0,
            period_ps: 10_000.0,
            photons_per_unit: 1e-3,
            pulses: 100_000_000,
            irf_fwhm_ps: 0.0,
            irf_tail: 0.0,
            ..Spad::default()
        })
    };
    let (scheme, rays) = (drr(6, false), &rays()[1..2]);
    let clean = simulate(&m, layout, &scheme, rays, &Noise::None, 0).expect("fits");
    let seen = simulate(&m, layout, &scheme, rays, &diode(40), 0).expect("fits");
    assert_eq!((seen.saturated, seen.variances), (0, None));
    for (a, b) in seen.intensities.iter().zip(&clean.intensities) {
        // 0.3 x 1e-3 x 1e8 = 30 000 counts per unit of intensity.
        let sigma = (b / 30_000.0).sqrt();
        assert!((a - b).abs() < 6.0 * sigma, "{a} {b}");
    }
    let wrong = simulate(&m, layout, &scheme, rays, &diode(39), 0).expect_err("bins");
    assert!(wrong.to_string().contains("bins"), "{wrong}");
}

#[test]
fn inconsistent_inputs_are_refused() {
    let m = matrices(SMALL, 1.0);
    let shoot = |m: &[f64], rays: &[Ray], noise: &Noise| simulate(m, SMALL, &drr(8, true), rays, noise, 0);
    assert!(shoot(&m[1..], &rays(), &Noise::None).is_err());
    assert!(shoot(&m, &rays()[1..], &Noise::None).is_err());
    assert!(shoot(&m, &rays(), &Noise::Gaussian { sigma: -1.0 }).is_err());
    assert!(shoot(&m, &rays(), &Noise::Gaussian { sigma: f64::NAN }).is_err());
    assert!(shoot(&m, &rays(), &still(Some(Method::Bilinear), 2)).is_err());
    let mut bad = m;
    bad[3] = f64::NAN;
    assert!(shoot(&bad, &rays(), &camera(1.0)).is_err());
    let none = Layout { lanes: 0, ..SMALL };
    let empty = simulate(&[], none, &drr(8, true), &[], &Noise::None, 0).expect("nothing to do");
    assert!(empty.intensities.is_empty());
}
