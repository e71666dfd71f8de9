//! Rich synthetic pictures of every kind come out at a useful size. To look at them, name a folder in the environment
//! variable `FIGURE_GALLERY` and run `cargo test --release gallery`.

use super::*;
use AxisKind::{Component, StokesIn, StokesOut, T, U, V, Wavelength, X, Y};

fn tint(lane: usize, warm: f64) -> f64 {
    [0.4 + 0.4 * (1.0 - warm), 0.6, 0.4 + 0.5 * warm][lane % 3]
}

fn ball(at: &At, w: f64, h: f64) -> Option<f64> {
    let (x, y) = ((at.f(X) - 0.45 * w) / (0.3 * h), (at.f(Y) - 0.5 * h) / (0.3 * h));
    let r = x * x + y * y;
    (r < 1.0).then(|| (1.0 - r).sqrt())
}

fn stokes() -> Vec<Axis> {
    vec![counted(StokesOut, 4), counted(StokesIn, 4)]
}

fn wave() -> Axis {
    axis(Wavelength, RGB_NM.to_vec())
}

fn pixels(w: usize, h: usize) -> Vec<Axis> {
    vec![counted(Y, h), counted(X, w)]
}

fn join(parts: Vec<Vec<Axis>>) -> Vec<Axis> {
    parts.into_iter().flatten().collect()
}

fn lit(at: &At, w: f64, h: f64) -> f64 {
    let warm = at.f(X) / w;
    let base = 0.02 * tint(at.i(Wavelength), warm) * (1.2 - at.f(Y) / h);
    ball(at, w, h).map_or(base, |n| 0.05 * n * tint(at.i(Wavelength), 0.9))
}

#[test]
fn gallery() {
    let temporary = tempfile::tempdir().unwrap();
    let folder =
        std::env::var("FIGURE_GALLERY").map_or(temporary.path().to_owned(), std::path::PathBuf::from);
    std::fs::create_dir_all(&folder).unwrap();
    let save = |name: &str, view: &View, title: &str, p: &Panel| {
        let picture = draw(view, title, p).unwrap();
        let (w, h) = (picture.width(), picture.height());
        assert!(
            (300..=2400).contains(&w) && (200..=2400).contains(&h),
            "{name}: {w} × {h}"
        );
        for format in ["png", "svg", "pdf"] {
            super::save(&picture, &folder.join(format!("{name}.{format}"))).unwrap();
        }
    };
    let t = tensor(
        join(vec![pixels(320, 240), vec![counted(Component, 2), wave()]]),
        |at| lit(at, 320.0, 240.0) * if at.i(Component) == 0 { 0.8 } else { 0.2 },
    );
    save(
        "photo",
        &photo_view(),
        "Cornell box with a gold sphere",
        &panel(&t),
    );

    let t = tensor(join(vec![pixels(160, 120), stokes(), vec![wave()]]), |at| {
        let m00 = lit(at, 160.0, 120.0);
        let a = (at.f(Y) - 60.0).atan2(at.f(X) - 72.0);
        let d = match (at.i(StokesOut), at.i(StokesIn)) {
            (0, 0) => 1.0,
            (0, 1) | (1, 0) => 0.4 * (2.0 * a).cos(),
            (0, 2) | (2, 0) => 0.4 * (2.0 * a).sin(),
            (1, 1) => 0.8,
            (2, 2) => -0.7,
            (3, 3) => -0.55,
            (2, 3) => 0.3 * (2.0 * a).cos(),
            (3, 2) => -0.3 * (2.0 * a).cos(),
            _ => 0.02 * (17.0 * a).sin(),
        };
        if at.i(Y) < 12 { 0.0 } else { m00 * d }
    });
    save(
        "mueller",
        &mueller_view(true),
        "Gold sphere, normalized Mueller matrix",
        &panel(&t),
    );
    save(
        "mueller_raw",
        &mueller_view(false),
        "Gold sphere, Mueller matrix",
        &panel(&t),
    );

    let t = tensor(
        join(vec![
            vec![axis(Y, vec![60.0]), counted(X, 160)],
            vec![counted(V, 4), counted(U, 128)],
            stokes(),
            vec![wave()],
        ]),
        |at| {
            let d = at.f(U) - 0.8 * at.f(X);
            let m = (-d * d / 4.0).exp() + 0.004 * (-(at.f(U) - 100.0).powi(2) / 900.0).exp();
            let s = if at.i(StokesOut) == at.i(StokesIn) {
                1.0
            } else {
                0.0
            };
            let s = if at.i(StokesOut) == 2 {
                -s * (d / 30.0).cos()
            } else {
                s
            };
            3e-4 * m * s * tint(at.i(Wavelength), at.f(X) / 160.0)
        },
    );
    save(
        "s-s",
        &View::SpaceSpace(map_view(0, [0, 0], None)),
        "Epipolar plane, M00",
        &panel(&t),
    );
    save(
        "s-s_550",
        &View::SpaceSpace(map_view(0, [0, 0], Some(550.0))),
        "Epipolar plane, M00",
        &panel(&t),
    );
    save(
        "s-s_22",
        &View::SpaceSpace(map_view(0, [2, 2], None)),
        "Epipolar plane, M22",
        &panel(&t),
    );

    let bins: Vec<f64> = (0..256).map(|i| 1012.5 + 25.0 * i as f64).collect();
    let pulse = |t: f64, centre: f64, width: f64| (-((t - centre) / width).powi(2)).exp();
    let line = |at: &At| {
        let t = 1012.5 + 25.0 * at.f(T);
        let c = 2400.0 + 0.02 * (at.f(X) - 80.0).powi(2);
        let m = pulse(t, c, 40.0)
            + if t > c {
                0.03 * (-(t - c) / 900.0).exp()
            } else {
                0.0
            };
        m * tint(at.i(Wavelength), at.f(X) / 160.0)
    };
    let t = tensor(
        join(vec![
            vec![axis(Y, vec![10.0, 60.0]), counted(X, 160), axis(T, bins.clone())],
            stokes(),
            vec![wave()],
        ]),
        |at| {
            let s = [1.0, 0.6, -0.5, -0.3][at.i(StokesOut)];
            if at.i(StokesOut) == at.i(StokesIn) {
                s * line(at) * 0.02
            } else {
                0.1 * s * line(at) * 0.02
            }
        },
    );
    save(
        "x-t",
        &View::SpaceTime(map_view(1, [0, 0], None)),
        "Scanline in time",
        &panel(&t),
    );
    save(
        "x-t_450",
        &View::SpaceTime(map_view(1, [0, 0], Some(450.0))),
        "Scanline in time",
        &panel(&t),
    );
    save(
        "x-t_33",
        &View::SpaceTime(map_view(1, [3, 3], None)),
        "Scanline in time, M33",
        &panel(&t),
    );
    let error = tensor(t.axes.clone(), |at| 0.0012 * (0.2 + line(at)).sqrt());
    let overflow = tensor(t.axes.iter().filter(|a| a.kind != T).cloned().collect(), |_| {
        3.1e-3
    });
    let full = Panel {
        mean: &t,
        std_error: Some(&error),
        overflow: Some(&overflow),
    };
    save(
        "profile",
        &profile_view([80.0, 60.0], [0, 0]),
        "Diffuse wall, direct peak and tail",
        &full,
    );
    save(
        "profile_22",
        &profile_view([80.0, 60.0], [2, 2]),
        "Diffuse wall, M22",
        &full,
    );

    let t = tensor(
        join(vec![pixels(80, 60), vec![axis(T, bins[..96].to_vec()), wave()]]),
        |at| {
            let r = (at.f(X) - 30.0).hypot(at.f(Y) - 40.0);
            0.01 * pulse(at.f(T), 10.0 + r, 2.5) * lit(at, 80.0, 60.0) * 50.0
        },
    );
    save("flight", &flight_view(12), "A pulse crosses the box", &panel(&t));
    save(
        "flight_30",
        &flight_view(30),
        "A pulse crosses the box",
        &panel(&t),
    );
    let mut one = t.clone();
    one.axes[3].coords = vec![635.0, 700.0, 800.0];
    save(
        "profile_plain",
        &profile_view([30.0, 20.0], [0, 0]),
        "Without errors",
        &panel(&one),
    );
    let t = tensor(pixels(2000, 3), |at| at.f(X) * (1.0 + at.f(Y)));
    save(
        "photo_strip",
        &photo_view(),
        "A strip of a very wide camera with a title that is far too long to be set in one line of any page whatsoever, however it is cut",
        &panel(&t),
    );
    let t = tensor(vec![axis(Y, vec![7.0]), axis(X, vec![9.0])], |_| 1.0);
    save("photo_one", &photo_view(), "One pixel", &panel(&t));
}
