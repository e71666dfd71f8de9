//! Every picture from tensors whose content is known, and from tensors that hold nothing worth drawing.

use image::RgbImage;
use proptest::prelude::*;

use super::colour::UNDEFINED;
use super::layout::Rect;
use super::{FigureError, Panel, draw, draw_with_plot, flight, mueller, profile, save_png};
use crate::tensor::array::Tensor;
use crate::tensor::axes::{Axis, AxisKind};
use crate::tensor::view::{FlightView, MapView, MuellerView, PhotoView, ProfileView, View};

const RGB_NM: [f64; 3] = [450.0, 550.0, 660.0];

fn axis(kind: AxisKind, coords: Vec<f64>) -> Axis {
    Axis {
        kind,
        chunk: coords.len() as u64,
        coords,
    }
}

fn counted(kind: AxisKind, n: usize) -> Axis {
    axis(kind, (0..n).map(|i| i as f64).collect())
}

/// Indices of one entry, by axis.
struct At<'a>(&'a Tensor, Vec<usize>);

impl At<'_> {
    /// Index along an axis; 0 where there is none.
    fn i(&self, kind: AxisKind) -> usize {
        self.0.find(kind).map_or(0, |k| self.1[k])
    }

    fn f(&self, kind: AxisKind) -> f64 {
        self.i(kind) as f64
    }
}

fn tensor(axes: Vec<Axis>, value: impl Fn(&At) -> f64) -> Tensor {
    let mut t = Tensor::zeros("synthetic", axes);
    let shape = t.shape();
    let data = (0..t.data.len())
        .map(|mut i| {
            let mut index = vec![0; shape.len()];
            for (k, n) in shape.iter().enumerate().rev() {
                index[k] = i % n;
                i /= n;
            }
            value(&At(&t, index)) as f32
        })
        .collect();
    t.data = data;
    t
}

fn panel(mean: &Tensor) -> Panel<'_> {
    Panel {
        mean,
        std_error: None,
        overflow: None,
    }
}

fn photo_view() -> View {
    View::Photo(PhotoView {
        slice: "s".into(),
        white: None,
    })
}

fn mueller_view(normalized: bool) -> View {
    View::Mueller(MuellerView {
        slice: "s".into(),
        wavelength_nm: None,
        normalized,
        limit: None,
    })
}

fn map_view(row: usize, element: [usize; 2], wavelength_nm: Option<f64>) -> MapView {
    MapView {
        slice: "s".into(),
        wavelength_nm,
        row,
        element,
    }
}

fn flight_view(frames: usize) -> View {
    View::Flight(FlightView {
        slice: "s".into(),
        frames,
    })
}

fn profile_view(pixel: [f64; 2], element: [usize; 2]) -> View {
    View::Profile(ProfileView {
        slice: "s".into(),
        pixel,
        element,
    })
}

/// One of every kind.
fn all_views() -> Vec<View> {
    vec![
        photo_view(),
        mueller_view(true),
        mueller_view(false),
        View::SpaceSpace(map_view(0, [0, 0], None)),
        View::SpaceTime(map_view(0, [0, 0], None)),
        View::SpaceTime(map_view(0, [0, 0], Some(660.0))),
        View::SpaceSpace(map_view(0, [1, 2], None)),
        flight_view(12),
        profile_view([3.0, 2.0], [0, 0]),
        profile_view([3.0, 2.0], [1, 1]),
    ]
}

/// Colour at a place (0..1 across and down) of a rectangle.
fn colour(img: &RgbImage, r: Rect, across: f64, down: f64) -> [u8; 3] {
    let (x, y) = (across * f64::from(r.w), down * f64::from(r.h));
    img.get_pixel(r.x + x as u32, r.y + y as u32).0
}

mod gallery {
    //! Rich synthetic pictures for looking at: `cargo test --release -- --ignored gallery`, into the folder that the
    //! environment variable `FIGURE_GALLERY` names.
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
    #[ignore = "writes pictures for looking at"]
    fn gallery() {
        let folder =
            std::path::PathBuf::from(std::env::var("FIGURE_GALLERY").expect("FIGURE_GALLERY names a folder"));
        std::fs::create_dir_all(&folder).unwrap();
        let save = |name: &str, view: &View, title: &str, p: &Panel| {
            save_png(
                &draw(view, title, p).unwrap(),
                &folder.join(format!("{name}.png")),
            )
            .unwrap();
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
}

mod content {
    use super::*;
    use AxisKind::{Bounces, Component, StokesIn, StokesOut, T, U, V, Wavelength, X, Y};

    fn wave(nm: &[f64]) -> Axis {
        axis(Wavelength, nm.to_vec())
    }

    #[test]
    fn photo_shows_lowest_wavelength_blue_and_its_white_level() {
        let t = tensor(
            vec![
                counted(Y, 2),
                counted(X, 4),
                counted(V, 2),
                counted(T, 2),
                counted(StokesOut, 4),
                counted(StokesIn, 4),
                wave(&RGB_NM),
            ],
            |at| {
                // 4 entries are summed, and elements other than M00 would spoil the picture.
                let m00 = at.i(StokesOut) == 0 && at.i(StokesIn) == 0;
                let on = at.i(Y) == 1 && (at.i(X) == 3 || at.i(X) == at.i(Wavelength));
                if !m00 {
                    9.0
                } else if on {
                    0.25
                } else {
                    0.0
                }
            },
        );
        let view = View::Photo(PhotoView {
            slice: "s".into(),
            white: Some(1.0),
        });
        let (img, r) = draw_with_plot(&view, "t", &panel(&t)).unwrap();
        let row = [0.125, 0.375, 0.625, 0.875].map(|x| colour(&img, r, x, 0.75));
        assert_eq!(row, [[0, 0, 255], [0, 255, 0], [255, 0, 0], [255, 255, 255]]);
        assert_eq!(colour(&img, r, 0.5, 0.25), [0, 0, 0]);
        let half = View::Photo(PhotoView {
            slice: "s".into(),
            white: Some(2.0),
        });
        let (img, r) = draw_with_plot(&half, "t", &panel(&t)).unwrap();
        assert_eq!(colour(&img, r, 0.875, 0.75), [188, 188, 188]);
        assert!(r.w == 900 && r.h == 450 && img.get_pixel(0, 0).0 == [255; 3]);
    }

    #[test]
    fn photo_is_exposed_to_the_99th_percentile() {
        let t = tensor(vec![counted(Y, 10), counted(X, 100)], |at| {
            if at.i(Y) == 0 && at.i(X) == 0 { 1e6 } else { 2.0 }
        });
        let (img, r) = draw_with_plot(&photo_view(), "", &panel(&t)).unwrap();
        assert_eq!(colour(&img, r, 0.5, 0.5), [255, 255, 255]);
    }

    #[test]
    fn mueller_signs_have_their_colours_and_undefined_is_grey() {
        let t = tensor(
            vec![
                counted(Y, 2),
                counted(X, 2),
                counted(StokesOut, 4),
                counted(StokesIn, 4),
                wave(&[635.0]),
            ],
            |at| {
                let m00 = if at.i(Y) == 0 { 0.0 } else { 4.0 };
                match (at.i(StokesOut), at.i(StokesIn)) {
                    (0, 0) => m00,
                    (1, 1) => 0.9 * m00,
                    (2, 3) => -0.9 * m00,
                    (3, 2) => 1.0,
                    _ => 0.0,
                }
            },
        );
        let (img, r) = draw_with_plot(&mueller_view(true), "t", &panel(&t)).unwrap();
        let (w, h) = (400, 400);
        let at = |e: [usize; 2], down: f64| {
            let (dx, dy) = mueller::corner(e, w, h);
            colour(
                &img,
                Rect {
                    x: r.x + dx,
                    y: r.y + dy,
                    w: w as u32,
                    h: h as u32,
                },
                0.9,
                down,
            )
        };
        let (red, blue, zero) = (at([1, 1], 0.7), at([2, 3], 0.7), at([0, 1], 0.7));
        assert!(red[0] > 120 && red[1] < 60 && red[2] < 60, "{red:?}");
        assert!(blue[2] > 100 && blue[0] < 60, "{blue:?}");
        assert!(zero.iter().all(|c| *c > 230), "{zero:?}");
        assert_eq!(at([0, 0], 0.7), [255; 3]);
        assert_eq!(at([0, 0], 0.2), [0; 3]);
        for e in [[1, 1], [3, 2], [0, 3]] {
            assert_eq!(at(e, 0.2), UNDEFINED.0, "{e:?}");
        }
    }

    #[test]
    fn mueller_limit_wavelength_and_raw_values_are_honoured() {
        let t = tensor(
            vec![
                counted(Y, 1),
                counted(X, 1),
                counted(StokesOut, 4),
                counted(StokesIn, 4),
                wave(&RGB_NM),
            ],
            |at| [-1.0, 0.0, 1.0][at.i(Wavelength)] * 0.5,
        );
        let one = |nm: f64, limit: f32| {
            let view = View::Mueller(MuellerView {
                slice: "s".into(),
                wavelength_nm: Some(nm),
                normalized: false,
                limit: Some(limit),
            });
            let (img, r) = draw_with_plot(&view, "t", &panel(&t)).unwrap();
            colour(&img, r, 0.12, 0.12)
        };
        assert_eq!(one(660.0, 0.5), super::super::colour::signed(1.0).0);
        assert_eq!(one(400.0, 0.5), super::super::colour::signed(-1.0).0);
        assert_eq!(one(540.0, 0.5), super::super::colour::signed(0.0).0);
        assert_eq!(one(700.0, 1.0), super::super::colour::signed(0.5).0);
    }

    /// Column 3 of 8 is bright at bin 5 of 10; only camera row 7 has light.
    fn scanlines() -> Tensor {
        let bins = (0..10).map(|i| 105.0 + 10.0 * f64::from(i)).collect();
        tensor(
            vec![
                axis(Y, vec![2.0, 7.0]),
                counted(X, 8),
                axis(T, bins),
                counted(Bounces, 2),
                wave(&RGB_NM),
            ],
            |at| {
                if at.i(Y) == 1 && at.i(X) == 3 && at.i(T) == 5 && at.i(Wavelength) != 0 {
                    1.0
                } else {
                    0.0
                }
            },
        )
    }

    #[test]
    fn bright_bin_of_a_space_time_map_is_in_its_place() {
        let t = scanlines();
        let place = |r: usize, nm| {
            draw_with_plot(&View::SpaceTime(map_view(r, [0, 0], nm)), "t", &panel(&t)).unwrap()
        };
        let (img, r) = place(1, Some(550.0));
        // Time rises upward: bin 5 of 10 lies from 0.4 to 0.5 below the top.
        let bright = super::super::colour::sequential(1.0).0;
        assert_eq!(colour(&img, r, 3.5 / 8.0, 0.45), bright);
        for (x, y) in [(2.5, 0.45), (4.5, 0.45), (3.5, 0.35), (3.5, 0.55)] {
            assert_eq!(
                colour(&img, r, x / 8.0, y),
                super::super::colour::sequential(0.0).0
            );
        }
        // In colour: no 450 nm makes yellow.
        let (img, r) = place(1, None);
        assert_eq!(colour(&img, r, 3.5 / 8.0, 0.45), [255, 255, 0]);
        let (img, r) = place(0, None);
        assert_eq!(colour(&img, r, 3.5 / 8.0, 0.45), [0, 0, 0]);
    }

    #[test]
    fn space_space_takes_columns_or_else_rows_and_divides_by_m00() {
        let axes = |rows, columns| {
            vec![
                counted(X, 8),
                counted(V, rows),
                counted(U, columns),
                counted(StokesOut, 4),
                counted(StokesIn, 4),
            ]
        };
        let value = |at: &At| {
            let on = at.i(X) == at.i(U) || at.i(X) == at.i(V);
            let m = if at.i(StokesOut) == 0 { 2.0 } else { -2.0 };
            if on { m } else { 0.0 }
        };
        let bright = super::super::colour::sequential(1.0).0;
        for (rows, columns) in [(1, 8), (8, 1)] {
            let t = tensor(axes(rows, columns), value);
            let (img, r) =
                draw_with_plot(&View::SpaceSpace(map_view(0, [0, 0], None)), "t", &panel(&t)).unwrap();
            assert_eq!(
                colour(&img, r, 5.5 / 8.0, 1.0 - 5.5 / 8.0),
                bright,
                "{rows} × {columns}"
            );
            let (img, r) =
                draw_with_plot(&View::SpaceSpace(map_view(0, [1, 0], None)), "t", &panel(&t)).unwrap();
            assert_eq!(
                colour(&img, r, 5.5 / 8.0, 1.0 - 5.5 / 8.0),
                super::super::colour::signed(-1.0).0
            );
            assert_eq!(colour(&img, r, 5.5 / 8.0, 5.5 / 8.0), UNDEFINED.0);
        }
    }

    #[test]
    fn flight_frames_follow_the_light() {
        // One pixel of a row of six lights up per bin, bins 2 to 7 of 10.
        let t = tensor(
            vec![
                counted(Y, 4),
                counted(X, 6),
                counted(T, 10),
                counted(Component, 2),
                wave(&[635.0]),
            ],
            |at| {
                if at.i(X) + 2 == at.i(T) { 3.0 } else { 0.0 }
            },
        );
        let (img, r) = draw_with_plot(&flight_view(3), "t", &panel(&t)).unwrap();
        assert_eq!(
            flight::chosen_bins(&[0., 0., 1., 1., 1., 1., 1., 1., 0., 0.], 3),
            [2, 5, 7]
        );
        let white: Vec<u32> = (r.x..r.x + r.w)
            .filter(|&x| img.get_pixel(x, r.y + 40).0 == [255; 3])
            .collect();
        let black = (r.x..r.x + r.w)
            .filter(|&x| img.get_pixel(x, r.y + 40).0 == [0; 3])
            .count();
        assert!(!white.is_empty() && black > white.len());
        // The first frame has its first column lit, its second dark.
        assert_eq!(img.get_pixel(r.x + 5, r.y + 40).0, [255; 3]);
        assert_eq!(img.get_pixel(r.x + 150, r.y + 40).0, [0; 3]);
    }

    fn steps() -> (Tensor, Tensor, Tensor) {
        let bins: Vec<f64> = (0..20).map(|i| 5.0 + 10.0 * f64::from(i)).collect();
        let axes = vec![counted(Y, 2), counted(X, 4), axis(T, bins), wave(&RGB_NM)];
        let mean = tensor(axes.clone(), |at| {
            if at.i(X) == 3 && at.i(Y) == 1 {
                1.0 + at.f(Wavelength)
            } else {
                99.0
            }
        });
        let error = tensor(axes.clone(), |_| 0.1);
        let overflow = tensor(axes.into_iter().filter(|a| a.kind != T).collect(), |_| 1.0);
        (mean, error, overflow)
    }

    #[test]
    fn lines_and_bands_of_a_profile_pass_through_their_rows() {
        let (mean, error, overflow) = steps();
        let View::Profile(view) = profile_view([40.0, 0.8], [0, 0]) else {
            unreachable!()
        };
        let full = Panel {
            mean: &mean,
            std_error: Some(&error),
            overflow: Some(&overflow),
        };
        let (img, r) = draw_with_plot(&View::Profile(view.clone()), "t", &full).unwrap();
        let source = super::super::reduce::Source::new("s", &mean).unwrap();
        let errors = super::super::reduce::Source::new("s", &error).unwrap();
        let scales = profile::read(&view, source, Some(errors)).unwrap().scales();
        assert_eq!(scales.time, (0.0, 200.0));
        assert!(
            scales.value.0 == 0.0 && (3.2..3.5).contains(&scales.value.1),
            "{scales:?}"
        );
        let colours = super::super::colour::line_colours(&RGB_NM);
        for (lane, line) in colours.iter().enumerate() {
            let pixel = |value: f64| {
                let (x, y) = scales.point(50.0, value);
                img.get_pixel(r.x + x.round() as u32, r.y + y.round() as u32).0
            };
            let value = 1.0 + lane as f64;
            let near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) < 60);
            assert!(near(pixel(value), line.0), "{lane}: {:?} {line:?}", pixel(value));
            let (one, two, none) = (pixel(value + 0.07), pixel(value + 0.15), pixel(value + 0.3));
            let dark = |c: [u8; 3]| 765 - c.iter().map(|v| u32::from(*v)).sum::<u32>();
            assert!(
                dark(one) > dark(two) && dark(two) > dark(none),
                "{one:?} {two:?} {none:?}"
            );
            assert_eq!(none, [255; 3]);
        }
        // Without errors there is no band.
        let (img, r) = draw_with_plot(&View::Profile(view), "t", &panel(&mean)).unwrap();
        assert_eq!(colour(&img, r, 0.3, 0.2), [255; 3]);
    }

    #[test]
    fn same_input_same_bytes() {
        let t = tensor(
            vec![
                counted(Y, 3),
                counted(X, 5),
                counted(U, 4),
                counted(T, 6),
                counted(StokesOut, 4),
                counted(StokesIn, 4),
                wave(&RGB_NM),
            ],
            |at| {
                (at.f(X) + 1.0)
                    * (at.f(T) + 0.5)
                    * if at.i(StokesOut) == at.i(StokesIn) {
                        1.0
                    } else {
                        -0.3
                    }
            },
        );
        let folder = tempfile::tempdir().unwrap();
        let bytes = |view: &View, name: &str| {
            let path = folder.path().join(name);
            save_png(&draw(view, "title", &panel(&t)).unwrap(), &path).unwrap();
            std::fs::read(path).unwrap()
        };
        for view in all_views() {
            assert_eq!(bytes(&view, "a.png"), bytes(&view, "b.png"), "{view:?}");
        }
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            2,
            "temporary files are left"
        );
        let img = draw(&photo_view(), "", &panel(&t)).unwrap();
        assert!(matches!(
            save_png(&img, &folder.path().join("no/a.png")),
            Err(FigureError::Write { .. })
        ));
    }
}

mod refusals {
    use super::*;
    use AxisKind::{StokesIn, StokesOut, T, U, Wavelength, X, Y};

    fn message(view: &View, t: &Tensor) -> String {
        draw(view, "t", &panel(t)).expect_err("was drawn").to_string()
    }

    #[test]
    fn missing_axes_are_named_with_their_mend() {
        let still = tensor(vec![counted(Y, 2), counted(X, 2), counted(Wavelength, 3)], |_| {
            1.0
        });
        let time = "slice `s` has no time axis; draw a slice with `time = {";
        for view in [
            View::SpaceTime(map_view(0, [0, 0], None)),
            flight_view(3),
            profile_view([0.0; 2], [0, 0]),
        ] {
            assert!(
                message(&view, &still).starts_with(time),
                "{view:?}: {}",
                message(&view, &still)
            );
        }
        let m = message(&View::SpaceSpace(map_view(0, [0, 0], None)), &still);
        assert!(
            m.contains("no projector column axis") && m.contains("projector = \"all\""),
            "{m}"
        );
        for view in [mueller_view(true), View::SpaceSpace(map_view(0, [2, 0], None))] {
            let t = tensor(vec![counted(Y, 2), counted(X, 2), counted(U, 3)], |_| 1.0);
            let m = message(&view, &t);
            assert!(
                m.contains("no Stokes axis") && m.contains("polarization = \"mueller\""),
                "{m}"
            );
        }
        let scalar = tensor(vec![], |_| 1.0);
        assert!(message(&photo_view(), &scalar).contains("no camera row axis"));
    }

    #[test]
    fn options_out_of_range_are_named() {
        let t = tensor(
            vec![
                counted(Y, 2),
                counted(X, 2),
                counted(T, 3),
                counted(StokesOut, 4),
                counted(StokesIn, 4),
            ],
            |_| 1.0,
        );
        let m = message(&View::SpaceTime(map_view(2, [0, 0], None)), &t);
        assert!(m.contains("2 camera rows") && m.contains("choose 0 to 1"), "{m}");
        assert!(message(&View::SpaceTime(map_view(0, [0, 4], None)), &t).contains("index 4"));
        assert!(message(&flight_view(0), &t).contains("`frames`"));
        assert!(message(&profile_view([f64::NAN, 0.0], [0, 0]), &t).contains("`pixel`"));
        for white in [0.0, -1.0, f32::NAN] {
            let view = View::Photo(PhotoView {
                slice: "s".into(),
                white: Some(white),
            });
            assert!(message(&view, &t).contains("`white`"));
        }
        let limit = View::Mueller(MuellerView {
            slice: "s".into(),
            wavelength_nm: None,
            normalized: true,
            limit: Some(0.0),
        });
        assert!(message(&limit, &t).contains("`limit`"));
    }
}

mod degenerate {
    use super::*;

    /// All ten axes, some absent, with lengths 1 to 4 (0 now and then).
    fn shapes() -> impl Strategy<Value = Vec<usize>> {
        let one = prop_oneof![8 => 1_usize..4, 1 => Just(0_usize), 1 => Just(4_usize)];
        proptest::collection::vec(one, 10)
    }

    fn values() -> impl Strategy<Value = f32> {
        prop_oneof![
            4 => -1.0_f32..1.0,
            1 => Just(0.0),
            1 => Just(f32::NAN),
            1 => Just(f32::INFINITY),
            1 => Just(f32::MAX),
            1 => Just(-f32::MAX),
            1 => Just(f32::MIN_POSITIVE),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn no_tensor_panics(
            shape in shapes(),
            absent in 0_u32..1024,
            pool in proptest::collection::vec(values(), 1..40),
            step in prop_oneof![Just(0.0), Just(1.0), Just(-2.5), Just(f64::NAN), Just(1e300)],
        ) {
            let axes: Vec<Axis> = AxisKind::ALL
                .into_iter()
                .zip(&shape)
                .enumerate()
                .filter(|(i, _)| absent & (1 << i) == 0 || *i < 2)
                .map(|(_, (kind, &n))| {
                    let n = if matches!(kind, AxisKind::StokesOut | AxisKind::StokesIn) { 4.min(n * 2) } else { n };
                    axis(kind, (0..n).map(|i| 3.0 + step * i as f64).collect())
                })
                .collect();
            let mut t = Tensor::zeros("t", axes);
            t.data.iter_mut().enumerate().for_each(|(i, v)| *v = pool[i % pool.len()]);
            let p = Panel { mean: &t, std_error: Some(&t), overflow: Some(&t) };
            for view in all_views() {
                if let Ok(img) = draw(&view, "a title", &p) {
                    prop_assert!((300..=2300).contains(&img.width()) && img.height() <= 2300, "{:?}", img.dimensions());
                }
            }
        }
    }

    #[test]
    fn empty_and_damaged_tensors_are_errors() {
        for view in all_views() {
            let empty = Tensor::zeros("t", vec![counted(AxisKind::Y, 0), counted(AxisKind::X, 3)]);
            assert!(matches!(
                draw(&view, "", &panel(&empty)),
                Err(FigureError::Empty { .. })
            ));
            let mut short = Tensor::zeros("t", vec![counted(AxisKind::Y, 2), counted(AxisKind::X, 3)]);
            short.data.pop();
            assert!(matches!(
                draw(&view, "", &panel(&short)),
                Err(FigureError::Damaged { .. })
            ));
        }
    }

    #[test]
    fn wide_and_tiny_pictures_come_to_a_useful_size() {
        for (w, h) in [(1, 1), (2000, 1), (2000, 1500), (1, 700), (3001, 2)] {
            let t = tensor(
                vec![
                    counted(AxisKind::Y, h),
                    counted(AxisKind::X, w),
                    counted(AxisKind::T, 1),
                ],
                |_| 1.0,
            );
            for view in [
                photo_view(),
                flight_view(4),
                View::SpaceTime(map_view(0, [0, 0], None)),
            ] {
                let (img, r) = draw_with_plot(&view, "wide and tiny", &panel(&t)).unwrap();
                assert!(
                    (400..=2000).contains(&img.width().max(img.height())),
                    "{w} × {h}: {:?}",
                    img.dimensions()
                );
                assert!(r.w >= 24 && r.h >= 24, "{w} × {h}: {r:?}");
            }
        }
    }

    #[test]
    fn zero_light_is_black_and_missing_values_are_grey() {
        let axes = || {
            vec![
                counted(AxisKind::Y, 3),
                counted(AxisKind::X, 3),
                counted(AxisKind::T, 2),
            ]
        };
        for (value, want) in [
            (0.0, [0, 0, 0]),
            (f64::NAN, UNDEFINED.0),
            (f64::INFINITY, UNDEFINED.0),
            (-1.0, [0, 0, 0]),
        ] {
            let t = tensor(axes(), |_| value);
            let (img, r) = draw_with_plot(&photo_view(), "", &panel(&t)).unwrap();
            assert_eq!(colour(&img, r, 0.5, 0.5), want, "{value}");
        }
    }
}
