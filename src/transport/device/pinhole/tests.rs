//! Tests of the conversions between pixels and directions.

use super::*;
use crate::device::distortion::fisheye::Fisheye;
use crate::device::distortion::opencv::Opencv;
use crate::device::distortion::tilt::Tilt;
use optics::sampling::stream::Stream;
use optics::sampling::warp;
use proptest::prelude::*;

/// Returns one device for each distortion model.
fn devices() -> [Pinhole; 4] {
    let rational = Opencv {
        k1: 0.4,
        k2: -0.2,
        k3: 0.02,
        k4: 0.6,
        k5: -0.1,
        k6: 0.05,
        p1: 0.002,
        p2: -0.001,
        ..Opencv::default()
    };
    let tilted =
        Opencv { s1: 0.01, s2: -0.004, s3: -0.008, s4: 0.006, tilt: Tilt::new(0.08, -0.11), ..rational };
    let fisheye = Fisheye { k: [-0.03, 0.01, -0.004, 0.0007] };
    let wide = Pinhole {
        // The lens has a field of view of 140° over the image diagonal.
        focal: DVec2::splat(165.0),
        ..with(Distortion::Fisheye(fisheye))
    };
    let wide =
        Pinhole::new(wide.resolution, wide.focal, wide.principal, wide.distortion, wide.origin, wide.axes);
    [device(), with(rational), with(tilted), wide.unwrap()]
}

proptest! {
    #[test]
    fn projection_inverts_direction_for_every_lens(x in 0.5..319.5, y in 0.5..239.5, far in 0.1..50.0_f32) {
        let q = DVec2::new(x, y);
        for p in devices() {
            let (back, depth) = p.project(p.origin + p.direction(q) * far).unwrap();
            prop_assert!((back - q).length() < 2e-3 / f64::from(far.min(1.0)), "{:?}: {q} {back}", p.distortion);
            prop_assert!(depth.z > 0.0);
        }
    }
}

fn device() -> Pinhole {
    let d = Opencv { k1: -0.28, k2: 0.07, k3: 0.01, p1: 0.002, p2: -0.001, ..Opencv::default() };
    with(d)
}

fn with(d: impl Into<Distortion>) -> Pinhole {
    let d = d.into();
    let axes = Mat3A::from_cols(Vec3A::X, -Vec3A::Y, -Vec3A::Z);
    let (f, c) = (DVec2::new(300.0, 310.0), DVec2::new(161.0, 118.0));
    Pinhole::new([320, 240], f, c, d, Vec3A::new(0.1, 0.2, 0.3), axes).unwrap()
}

#[test]
fn projection_inverts_direction() {
    let p = device();
    for (x, y) in [(0.5, 0.5), (160.0, 120.0), (319.5, 3.0), (10.0, 239.0)] {
        let q = DVec2::new(x, y);
        let (back, depth) = p.project(p.origin + p.direction(q) * 3.0).unwrap();
        assert!((back - q).length() < 1e-3, "{q} {back}");
        assert!(depth.z > 0.0);
    }
}

#[test]
fn batched_rays_equal_single_ones() {
    let mut stream = Stream::new(2, 0, 0);
    let bent = device();
    let (r, f, c) = (bent.resolution, bent.focal, bent.principal);
    let straight = Pinhole::new(r, f, c, Distortion::default(), bent.origin, bent.axes).unwrap();
    let mut seen = 0;
    for p in [bent, straight] {
        for _ in 0..1000 {
            let mut draw = || stream.uniform2().map(|u| f64::from(u) * 240.0);
            let at: [[f64; 2]; 16] = std::array::from_fn(|_| draw());
            let dirs = p.directions(&[0, 1].map(|k| at.map(|a| a[k])));
            let mut points = many::zero::<16>();
            for (i, at) in at.into_iter().enumerate() {
                assert_eq!(many::get(&dirs, i), p.direction(DVec2::from_array(at)));
                let anywhere = warp::sphere(stream.uniform2()) + Vec3A::new(0.0, 0.0, -1.0);
                many::set(&mut points, i, anywhere);
            }
            let (pixels, local) = p.pixels(&points);
            for (i, got) in pixels.into_iter().enumerate() {
                let want = p.project(many::get(&points, i));
                let pixel = want.map_or(OUTSIDE, |(at, _)| at.y as u32 * r[0] + at.x as u32);
                assert_eq!(got, pixel);
                if let Some((_, l)) = want {
                    seen += 1;
                    assert_eq!(many::get(&local, i), l);
                }
            }
        }
    }
    assert!(seen > 5000, "{seen}");
}

/// Verifies that the pixel density per solid angle integrates to the number of pixels. The integral is the
/// mean over uniform directions in a cone around the image.
#[test]
fn densities_count_the_pixels() {
    for (p, cone) in devices().into_iter().zip([0.75, 0.75, 0.7, 0.3]) {
        count(&p, cone);
    }
}

fn count(p: &Pinhole, cone: f32) {
    let n = 400_000;
    let mut stream = Stream::new(9, 0, 0);
    let (mut sum, mut square) = (0.0, 0.0);
    for _ in 0..n {
        let [u, v] = stream.uniform2();
        let (cos, turn) = (1.0 - u * (1.0 - cone), std::f32::consts::TAU * v);
        let sin = (1.0 - cos * cos).sqrt();
        let local = Vec3A::new(sin * turn.cos(), sin * turn.sin(), cos);
        let x = match p.project(p.origin + p.axes * local) {
            Some(_) => f64::from(p.pixels_per_steradian(p.axes * local * 2.0)),
            None => 0.0,
        };
        sum += x;
        square += x * x;
    }
    let solid_angle = std::f64::consts::TAU * (1.0 - f64::from(cone));
    let (mean, n) = (sum / f64::from(n), f64::from(n));
    let error = ((square / n - mean * mean) / n).sqrt() * solid_angle;
    let pixels = mean * solid_angle;
    assert!((pixels - 320.0 * 240.0).abs() < 5.0 * error, "{pixels} ± {error}");
    assert!(error < 250.0, "{error}");
}

/// Verifies that a pixel sees the same point in the plane of focus through all points of the lens.
#[test]
fn the_plane_in_focus_is_sharp() {
    let mut stream = Stream::new(3, 0, 0);
    let mut p = device();
    p.lens = Lens { radius: 0.05, focus: 2.0 };
    let pixel = DVec2::new(40.0, 200.0);
    let central = p.direction(pixel);
    let target = p.origin + central * (2.0 / central.dot(p.axes.z_axis));
    for _ in 0..200 {
        let seen = p.through_lens(stream.uniform2());
        assert!((seen.origin - p.origin).length() < 0.0501);
        assert!((seen.origin - p.origin).dot(p.axes.z_axis).abs() < 1e-6);
        let d = seen.direction(pixel);
        let hit = seen.origin + d * (2.0 / d.dot(p.axes.z_axis));
        assert!((hit - target).length() < 1e-5);
        let (back, _) = seen.project(seen.origin + d * 5.0).unwrap();
        assert!((back - pixel).length() < 1e-2);
    }
    let edge = p.through_lens([1.0, 0.25]);
    assert!((edge.origin - p.origin).length() > 0.0499);
}

#[test]
fn points_folded_into_the_image_are_not_visible() {
    // Barrel distortion maps a distant off-axis point into the image. Such a point must not be visible.
    let p = device();
    assert!(p.project(p.origin + Vec3A::new(30.0, 0.0, -10.0)).is_none());
    assert!(p.project(p.origin + Vec3A::Z).is_none(), "behind");
    let made = |lens: Distortion, f: f64| {
        let (f, c) = (DVec2::splat(f), DVec2::new(160., 120.));
        Pinhole::new([320, 240], f, c, lens, p.origin, p.axes)
    };
    let folds = |lens: Opencv, f: f64| {
        let refused = made(lens.into(), f).expect_err("it folds");
        assert!(refused.contains("two directions to one pixel"), "{refused}");
    };
    let strong = Opencv { k1: -2.0, ..Opencv::default() };
    folds(strong, 100.0);
    // The distorted radius increases again beyond the fold, so that each image radius has an inverse.
    let wave = Opencv { k1: -1.0, k2: 0.3, ..Opencv::default() };
    folds(wave, 180.0);
    assert!(made(wave.into(), 800.0).is_ok(), "where it does not fold yet");
    // The rational model has a pole at r = 0.632. Points beyond the pole are not visible.
    let pole = Opencv { k4: -2.5, ..Opencv::default() };
    let seen = made(pole.into(), 100.0).unwrap();
    assert!((0.5..0.632).contains(&seen.field()[1].x), "{:?}", seen.field());
    assert!(seen.project(p.origin + Vec3A::new(1.0, 0.0, -1.0)).is_none());
    let fisheye = Distortion::Fisheye(Fisheye::default());
    assert!(made(fisheye, 140.0).is_ok());
    let refused = made(fisheye, 120.0).expect_err("200 pixels of 120 are 95°");
    assert!(refused.contains("90°"), "{refused}");
}
