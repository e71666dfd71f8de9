//! Tests with images of known ground truth. The noise of the images is stated correctly, stated wrongly, or
//! absent.

use super::average::average;
use super::guide::{Guide, GuideBuilder};
use super::likeness::{MIDDLE, WINDOW, neighbour};
use super::weights::Weights;
use super::{Size, Values};
use crate::decompose::cloude;
use tensor::axes::{Axis, AxisKind};

/// A generator of normally distributed random numbers (SplitMix64, Box–Muller).
struct Normal(u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        let r = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        r * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn axis(kind: AxisKind, n: usize) -> Axis {
    let coords = (0..n).map(|i| i as f64 + 1.0).collect();
    Axis { kind, coords, chunk: n as u64 }
}

fn mueller() -> Vec<Axis> {
    vec![axis(AxisKind::StokesOut, 4), axis(AxisKind::StokesIn, 4), axis(AxisKind::Wavelength, 1)]
}

/// Returns the Mueller matrix of a polarizer at `angle`, in radians, with transmittance `k`. The matrix is on
/// the boundary of the cone of realizable matrices.
fn polarizer(angle: f64, k: f64) -> [f64; 16] {
    let (s, c) = (2.0 * angle).sin_cos();
    [1.0, c, s, 0.0, c, c * c, c * s, 0.0, s, c * s, s * s, 0.0, 0.0, 0.0, 0.0, 0.0].map(|x| x * k / 2.0)
}

const SIZE: Size = [40, 48];

/// The true Mueller matrix of each pixel.
type Truth = fn(usize) -> [f64; 16];

/// Returns the truth of a test image. The image has a bright disc with one polarization, a gradient with
/// another polarization, and a black band.
fn truth(p: usize) -> [f64; 16] {
    let (y, x) = ((p / SIZE[1]) as f64, (p % SIZE[1]) as f64);
    if (y - 20.0).hypot(x - 24.0) < 9.0 {
        return polarizer(0.3 + 0.01 * x, 8.0);
    }
    if x > 43.0 {
        return [0.0; 16];
    }
    polarizer(1.2, 1.0 + 0.02 * y)
}

/// Returns the truth of a grey surface in uniform light.
fn wall(_: usize) -> [f64; 16] {
    polarizer(1.2, 2.0)
}

/// Returns a Mueller matrix with the brightness of `m` and a different polarization.
fn other(m: &[f64; 16]) -> [f64; 16] {
    polarizer(0.9, 2.0 * m[0])
}

/// Returns a render with the means of `n` samples per pixel, and `stated` times the standard errors of the
/// means. Each sample is the truth times a non-negative number, and is therefore realizable.
fn rendered_of(truth: Truth, seed: u64, n: usize, stated: f64) -> Values {
    let mut random = Normal(seed);
    let (mut mean, mut error) = (vec![], vec![]);
    for p in 0..SIZE[0] * SIZE[1] {
        let m = truth(p);
        let other = other(&m);
        let (mut sum, mut square) = ([0.0; 16], [0.0; 16]);
        for _ in 0..n {
            let [a, b] = [(); 2].map(|()| -(1.0 - random.uniform()).ln());
            for c in 0..16 {
                let value = 0.7 * a * m[c] + 0.3 * b * other[c];
                sum[c] += value;
                square[c] += value * value;
            }
        }
        let n = n as f64;
        for c in 0..16 {
            let variance = (square[c] / n - (sum[c] / n).powi(2)).max(0.0);
            mean.push((sum[c] / n) as f32);
            error.push((stated * (variance / (n - 1.0)).sqrt()) as f32);
        }
    }
    Values { size: SIZE, channels: 16, mean, error }
}

fn rendered(seed: u64, n: usize, stated: f64) -> Values {
    rendered_of(truth, seed, n, stated)
}

/// Returns the expected value of the samples of pixel `p`.
fn expected(truth: Truth, p: usize) -> [f64; 16] {
    let m = truth(p);
    let other = other(&m);
    std::array::from_fn(|c| 0.7 * m[c] + 0.3 * other[c])
}

fn weights_of(renders: &[Values], axes: &[Axis]) -> Weights {
    let shape: Vec<u64> = axes.iter().map(Axis::len).collect();
    let start = vec![0; shape.len()];
    let builder = |v: &Values| {
        let mut b = GuideBuilder::new(v.size, axes);
        b.add(&start, &shape, &v.mean, &v.error);
        b
    };
    let share = 1.0 / renders.len() as f32;
    Weights::new(&Guide::new(renders.iter().map(builder).collect(), vec![share; renders.len()]))
}

fn denoised(renders: &[Values], axes: &[Axis]) -> Values {
    average(&weights_of(renders, axes), renders)
}

/// Returns two numbers. The first number is the root mean square of (estimate - truth) / stated error. The
/// second number is the RMS error after denoising divided by the RMS error before denoising.
fn judged(truth: Truth, renders: &[Values]) -> [f64; 2] {
    let out = denoised(renders, &mueller());
    let [mut z, mut n, mut after, mut before] = [0.0; 4];
    for p in 0..SIZE[0] * SIZE[1] {
        for (c, want) in expected(truth, p).into_iter().enumerate() {
            let i = p * 16 + c;
            let off = f64::from(out.mean[i]) - want;
            let raw = renders.iter().map(|r| f64::from(r.mean[i])).sum::<f64>() / renders.len() as f64;
            after += off * off;
            before += (raw - want).powi(2);
            if out.error[i] > 0.0 {
                z += (off / f64::from(out.error[i])).powi(2);
                n += 1.0;
            }
        }
    }
    [(z / n).sqrt(), (after / before).sqrt()]
}

/// Verifies that correctly stated errors pass the statistical test, for an image with edges and gradients and
/// for a uniform image. Errors that are misstated by a factor of two (variances by a factor of four) must
/// fail the statistical test.
#[test]
fn errors_of_denoised_images_match_actual_errors() {
    for (name, seeds) in [("one", &[1_u64][..]), ("two", &[2, 3])] {
        let of = |truth: Truth, stated: f64| {
            let all: Vec<Values> = seeds.iter().map(|s| rendered_of(truth, *s, 64, stated)).collect();
            judged(truth, &all)
        };
        let [z, left] = of(truth, 1.0);
        let [even, gone] = of(wall, 1.0);
        let [low, high] = [of(truth, 0.5)[0], of(wall, 2.0)[0]];
        println!("{name}: z {z:.3}, of a wall {even:.3}; errors {left:.3} and {gone:.3} of the render's");
        println!("{name}: stated half z {low:.3}, double {high:.3}");
        assert!((0.7..1.4).contains(&z) && (0.7..1.4).contains(&even), "{name}: z is {z}, {even}");
        assert!(
            left < 1.0 / 3.0_f64.sqrt() && gone < 0.1_f64.sqrt(),
            "{name}: {left}, {gone} of the error is left"
        );
        assert!(low > 1.4, "{name}: errors half as large go unnoticed: {low}");
        assert!(high < 0.7, "{name}: errors twice as large go unnoticed: {high}");
    }
}

#[test]
fn matrices_stay_realizable() {
    let renders = [rendered(4, 4, 1.0), rendered(5, 4, 1.0)];
    for renders in [&renders[..1], &renders] {
        let out = denoised(renders, &mueller());
        let least = |v: &Values| {
            v.mean.as_chunks::<16>().0.iter().fold(0.0_f64, |least, m| {
                let matrix: cloude::Matrix =
                    [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| f64::from(m[4 * i + j])));
                let values = cloude::eigenvalues(&matrix).expect("finite");
                least.min(values[3] / f64::from(m[0]).max(1e-12))
            })
        };
        let (before, after) = (least(&renders[0]), least(&out));
        println!("least eigenvalue over m00: {before:e} before, {after:e} after");
        assert!(after > -1e-6 && before > -1e-6);
        // As a deliberate error, one element has a separate weight. The mean is then not realizable.
        let mut broken = out.clone();
        broken.mean.iter_mut().skip(1).step_by(16).for_each(|m| *m *= 1.1);
        assert!(least(&broken) < -1e-3);
    }
}

#[test]
fn weights_are_nonnegative_and_sum_to_one() {
    let renders = [rendered(6, 8, 1.0), rendered(7, 8, 1.0)];
    let weights = weights_of(&renders, &mueller());
    for of in &weights.of {
        for window in of.chunks(WINDOW) {
            let sum: f64 = window.iter().map(|w| f64::from(*w)).sum();
            assert!(window.iter().all(|w| *w >= 0.0) && (sum - 1.0).abs() < 1e-5, "{sum}");
        }
    }
}

/// Verifies that a contribution of a hundred times the light in a single render causes no bright spot. The
/// removal of the contribution increases the stated errors. With a single render, the contribution remains,
/// because nothing distinguishes the contribution from a highlight.
#[test]
fn an_outlier_is_removed_and_stated_in_the_error() {
    let (plain, other) = (rendered_of(wall, 31, 16, 1.0), rendered_of(wall, 32, 16, 1.0));
    let spot = 20 * SIZE[1] + 24;
    let mut met = plain.clone();
    let m = wall(spot);
    for (c, element) in m.iter().enumerate() {
        met.mean[spot * 16 + c] += 100.0 * *element as f32;
        met.error[spot * 16 + c] += 100.0 * element.abs() as f32;
    }
    let renders = [met.clone(), other.clone()];
    let weights = weights_of(&renders, &mueller());
    let (without, with) = (denoised(&[plain, other], &mueller()), average(&weights, &renders));
    // The weight of the outlier for a pixel, and the neighbour for which this weight is greatest.
    let weight_for = |p: usize| {
        let o = (0..WINDOW).find(|o| neighbour(p, *o, SIZE) == Some(spot));
        weights.of[0][p * WINDOW + o.expect("within reach")]
    };
    let near = (0..WINDOW).filter(|o| *o != MIDDLE).filter_map(|o| neighbour(spot, o, SIZE));
    let beside = near.max_by(|a, b| weight_for(*a).total_cmp(&weight_for(*b))).expect("some");
    for p in [spot, beside] {
        let weight = weight_for(p);
        let m00 = p * 16;
        let off = f64::from(with.mean[m00] - without.mean[m00]).abs();
        assert!(off < 0.02 * expected(wall, p)[0], "{p}: {off}");
        let left = 0.5 * f64::from(weight) * 100.0 * m[0];
        let more =
            (f64::from(with.error[m00]).powi(2) - f64::from(without.error[m00]).powi(2)).max(0.0).sqrt();
        println!("pixel {p}: off by {off:.4}, left out {left:.4}, stated {more:.4} more");
        assert!(left > 0.1 * m[0] && (more / left - 1.0).abs() < 0.1, "{p}: {more} of {left}");
    }
    let alone = denoised(&[met], &mueller());
    assert!(f64::from(alone.mean[spot * 16]) > 1.5 * expected(wall, spot)[0]);
}

#[test]
fn an_edge_keeps_its_contrast() {
    let renders = [rendered(8, 64, 1.0), rendered(9, 64, 1.0)];
    for renders in [&renders[..1], &renders] {
        let out = denoised(renders, &mueller());
        let (mut kept, mut whole) = (0.0, 0.0);
        for p in 0..SIZE[0] * SIZE[1] - 1 {
            let step = expected(truth, p + 1)[0] - expected(truth, p)[0];
            if (p + 1) % SIZE[1] != 0 && step.abs() > 1.0 {
                let [a, b] = [p, p + 1].map(|p| f64::from(out.mean[p * 16]));
                kept += (b - a) * step;
                whole += step * step;
            }
        }
        println!("{:.4} of the step is kept", kept / whole);
        assert!((kept / whole - 1.0).abs() < 0.02, "{}", kept / whole);
    }
}

#[test]
fn pixels_without_error_are_unchanged_bit_for_bit() {
    let mut still = rendered(10, 4, 0.0);
    still.mean[5] = -0.0;
    still.mean[7] = 1e-40;
    let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let out = denoised(std::slice::from_ref(&still), &mueller());
    assert_eq!(bits(&out.mean), bits(&still.mean));
    assert_eq!(bits(&out.error), bits(&still.error));
    let two = denoised(&[still.clone(), still.clone()], &mueller());
    assert_eq!(two.mean.iter().map(|x| x + 0.0).collect::<Vec<_>>(), still.mean);
    // Next to pixels with errors, a pixel without error does not change.
    let mut mixed = rendered(11, 4, 1.0);
    mixed.error[16 * 500..16 * 501].fill(0.0);
    let out = denoised(std::slice::from_ref(&mixed), &mueller());
    assert_eq!(bits(&out.mean[16 * 500..16 * 501]), bits(&mixed.mean[16 * 500..16 * 501]));
    assert_ne!(bits(&out.mean[16 * 501..16 * 502]), bits(&mixed.mean[16 * 501..16 * 502]));
}

#[test]
fn a_constant_image_is_unchanged_and_its_error_decreases() {
    let size = [30, 30];
    let values = Values { size, channels: 2, mean: vec![3.0; 1800], error: vec![0.1; 1800] };
    let out = denoised(&[values], &[axis(AxisKind::Wavelength, 2)]);
    assert!(out.mean.iter().all(|m| (m - 3.0).abs() < 1e-5));
    let middle = f64::from(out.error[2 * (15 * 30 + 15)]);
    assert!((middle / (0.1 / (WINDOW as f64).sqrt()) - 1.0).abs() < 0.01, "{middle}");
}

/// Verifies that non-finite values do not spread to other pixels. Empty channels stay empty.
#[test]
fn lost_pixels_do_not_spread() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut lost = rendered(12, 8, 1.0);
        lost.mean[16 * 300 + 3] = bad;
        lost.error[16 * 700] = bad;
        let out = denoised(std::slice::from_ref(&lost), &mueller());
        let bits = |v: &Values, p: usize| {
            v.mean[16 * p..16 * p + 16].iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        };
        for p in 0..SIZE[0] * SIZE[1] {
            let all = out.mean[16 * p..][..16].iter().chain(&out.error[16 * p..][..16]);
            assert!([300, 700].contains(&p) || all.copied().all(f32::is_finite), "{bad} at {p}");
            assert_eq!(out.mean[16 * p + 15], 0.0);
        }
        assert_eq!(bits(&out, 300), bits(&lost, 300));
        assert_eq!(bits(&out, 700), bits(&lost, 700));
    }
}

#[test]
fn images_of_any_size_and_brightness_are_denoised() {
    for size in [[1, 1], [1, 7], [7, 1], [2, 2], [0, 3]] {
        let n = size[0] * size[1];
        let mut random = Normal(13);
        let mean: Vec<f32> = (0..n).map(|_| 1.0 + 0.1 * random.next() as f32).collect();
        let values = Values { size, channels: 1, error: vec![0.1; n], mean: mean.clone() };
        let out = denoised(&[values], &[axis(AxisKind::Wavelength, 1)]);
        assert!(out.mean.iter().zip(&out.error).all(|(m, e)| m.is_finite() && *e > 0.0));
        if n == 1 {
            assert_eq!(out.mean, mean);
            assert!((out.error[0] - 0.1).abs() < 1e-6);
        }
    }
    // Scaling the image by an extreme power of two does not change the mantissas of the results.
    let plain = rendered(14, 8, 1.0);
    let scaled = |k: f32| Values {
        mean: plain.mean.iter().map(|x| x * k).collect(),
        error: plain.error.iter().map(|x| x * k).collect(),
        ..plain.clone()
    };
    let want = denoised(std::slice::from_ref(&plain), &mueller());
    for power in [-90, 100] {
        let k = 2.0_f32.powi(power);
        let got = denoised(&[scaled(k)], &mueller());
        assert!(got.mean.iter().zip(&want.mean).all(|(a, b)| *a == b * k), "2^{power}");
        assert!(got.error.iter().zip(&want.error).all(|(a, b)| *a == b * k), "2^{power}");
    }
}

/// Verifies that the denoiser separates two walls of equal brightness whose depths differ by one bin. The
/// denoiser separates the walls by their arrival times.
#[test]
fn surfaces_of_different_depth_are_separated() {
    let (size, bins) = ([16, 24], 80);
    let axes = [axis(AxisKind::T, bins), axis(AxisKind::Wavelength, 1)];
    let mut random = Normal(15);
    let n = size[0] * size[1];
    let mut values = Values { size, channels: bins, mean: vec![0.0; n * bins], error: vec![0.0; n * bins] };
    for p in 0..n {
        let at = p * bins + if p % size[1] < 12 { 40 } else { 41 };
        values.mean[at] = 1.0 + 0.1 * random.next() as f32;
        values.error[at] = 0.1;
    }
    let weights = weights_of(std::slice::from_ref(&values), &axes);
    let out = average(&weights, &[values]);
    for p in 0..n {
        let (near, far) = if p % size[1] < 12 { (40, 41) } else { (41, 40) };
        assert_eq!(out.mean[p * bins + far], 0.0, "{p}");
        assert!((out.mean[p * bins + near] - 1.0).abs() < 0.2);
    }
    // The sums over time alone do not separate the walls.
    let sums = Values { channels: 1, ..out.clone() };
    let sums =
        Values { mean: out.mean.chunks(bins).map(|m| m.iter().sum()).collect(), error: vec![0.1; n], ..sums };
    let mixed = weights_of(&[sums], &[axis(AxisKind::Wavelength, 1)]);
    let edge = (8 * size[1] + 11) * WINDOW;
    assert!(mixed.of[0][edge + MIDDLE + 1] > 0.0 && weights.of[0][edge + MIDDLE + 1] == 0.0);
}

/// Verifies that pixels that are dark at random do not stay black. A tenth of the samples carry light. With
/// 16 samples per pixel, a sixth of the pixels have no light and a standard error of zero. The mean of the
/// surface over 1,920 pixels does not change by more than five standard errors.
#[test]
fn randomly_dark_pixels_do_not_stay_black() {
    let (n, rare) = (16, 0.1);
    let render = |seed: u64| {
        let mut random = Normal(seed);
        let (mut mean, mut error) = (vec![], vec![]);
        for p in 0..SIZE[0] * SIZE[1] {
            let met = (0..n).filter(|_| random.uniform() < rare).count() as f64;
            let part = met / f64::from(n);
            let deviation = (part * (1.0 - part) / f64::from(n - 1)).sqrt();
            for m in wall(p) {
                mean.push((m * part / rare) as f32);
                error.push((m.abs() * deviation / rare) as f32);
            }
        }
        Values { size: SIZE, channels: 16, mean, error }
    };
    let light = |v: &Values| v.mean.chunks(16).map(|m| f64::from(m[0])).sum::<f64>();
    let dark = |v: &Values| v.mean.chunks(16).filter(|m| m[0] == 0.0).count();
    for renders in [vec![render(31)], vec![render(32), render(33)]] {
        let out = denoised(&renders, &mueller());
        let before = renders.iter().map(dark).min().expect("a render");
        assert!(before > 250 && dark(&out) == 0, "{before} were dark, {} are", dark(&out));
        let pixels = (SIZE[0] * SIZE[1] * renders.len() * n as usize) as f64;
        let bound = 5.0 * ((1.0 - rare) / rare / pixels).sqrt();
        let kept = light(&out) / (SIZE[0] * SIZE[1]) as f64 / wall(0)[0];
        println!("{before} dark pixels, {kept:.4} of the light, bound {bound:.4}");
        assert!((kept - 1.0).abs() < bound, "{kept}");
    }
}

/// Verifies that a single path in a dark image adds no light to other pixels.
#[test]
fn a_single_path_in_the_dark_does_not_spread() {
    let n = SIZE[0] * SIZE[1];
    let (at, mut values) = (20 * SIZE[1] + 24, rendered_of(|_| [0.0; 16], 41, 4, 1.0));
    for c in 0..16 {
        values.mean[16 * at + c] = wall(at)[c] as f32;
        values.error[16 * at + c] = values.mean[16 * at + c].abs();
    }
    let dark = rendered_of(|_| [0.0; 16], 42, 4, 1.0);
    for renders in [vec![values.clone()], vec![values.clone(), dark]] {
        let out = denoised(&renders, &mueller());
        let lit: Vec<usize> = (0..n).filter(|p| out.mean[16 * p] != 0.0).collect();
        assert_eq!(lit, [at]);
    }
}
