//! Tests drawn content with known tensors.

use super::*;
use AxisKind::{Bounces, Component, StokesIn, StokesOut, T, U, V, Wavelength, X, Y};

fn wave<const N: usize>(nm: &[f64], lengths: [(AxisKind, usize); N]) -> Vec<Axis> {
    let mut all = axes(lengths);
    all.push(axis(Wavelength, nm.to_vec()));
    all
}

#[test]
fn photo_shows_lowest_wavelength_blue_and_its_white_level() {
    let t = tensor(wave(&RGB_NM, [(Y, 2), (X, 4), (V, 2), (T, 2), (StokesOut, 4), (StokesIn, 4)]), |at| {
        // Four entries are summed. If elements other than M00 were included, the image would differ.
        let m00 = at.i(StokesOut) == 0 && at.i(StokesIn) == 0;
        let on = at.i(Y) == 1 && (at.i(X) == 3 || at.i(X) == at.i(Wavelength));
        if m00 { f64::from(u8::from(on)) / 4.0 } else { 9.0 }
    });
    let (img, r) = seen(&white_view(1.0), &panel(&t));
    let row = [0.125, 0.375, 0.625, 0.875].map(|x| colour(&img, r, x, 0.75));
    assert_eq!(row, [[0, 0, 255], [0, 255, 0], [255, 0, 0], [255, 255, 255]]);
    assert_eq!(colour(&img, r, 0.5, 0.25), [0, 0, 0]);
    let (img, r) = seen(&white_view(2.0), &panel(&t));
    assert_eq!(colour(&img, r, 0.875, 0.75), [188, 188, 188]);
    assert!(r.w == 900.0 && r.h == 450.0 && img.get_pixel(0, 0).0 == [255; 3]);
}

#[test]
fn photo_is_exposed_to_the_99th_percentile() {
    let t =
        tensor(
            vec![counted(Y, 10), counted(X, 100)],
            |at| {
                if at.i(Y) == 0 && at.i(X) == 0 { 1e6 } else { 2.0 }
            },
        );
    let (img, r) = seen(&photo_view(), &panel(&t));
    assert_eq!(colour(&img, r, 0.5, 0.5), [255, 255, 255]);
}

#[test]
fn mueller_signs_have_their_colours_and_undefined_is_grey() {
    let t = tensor(wave(&[635.0], [(Y, 2), (X, 2), (StokesOut, 4), (StokesIn, 4)]), |at| {
        let m00 = if at.i(Y) == 0 { 0.0 } else { 4.0 };
        match (at.i(StokesOut), at.i(StokesIn)) {
            (0, 0) => m00,
            (1, 1) => 0.9 * m00,
            (2, 3) => -0.9 * m00,
            (3, 2) => 1.0,
            _ => 0.0,
        }
    });
    let (img, r) = seen(&mueller_view(true), &panel(&t));
    let grid = mueller::panels((400.0, 400.0), 8.0);
    let at = |[out, inn]: [usize; 2], down: f64| {
        let place = r.within(grid.corner(4 * out + inn), grid.size);
        colour(&img, place, 0.9, down)
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
    let t = tensor(wave(&RGB_NM, [(Y, 1), (X, 1), (StokesOut, 4), (StokesIn, 4)]), |at| {
        [-1.0, 0.0, 1.0][at.i(Wavelength)] * 0.5
    });
    let one = |nm: f64, limit: f32| {
        let view = View::Mueller(MuellerView {
            slice: "s".into(),
            wavelength_nm: Some(nm),
            time_ps: None,
            normalized: false,
            limit: Some(limit),
            scale: SignedScale::Linear,
            mask_sigmas: None,
        });
        let (img, r) = seen(&view, &panel(&t));
        colour(&img, r, 0.12, 0.12)
    };
    assert_eq!(one(660.0, 0.5), crate::colour::signed(1.0).0);
    assert_eq!(one(449.5, 0.5), crate::colour::signed(-1.0).0);
    assert_eq!(one(550.4, 0.5), crate::colour::signed(0.0).0);
    assert_eq!(one(660.5, 1.0), crate::colour::signed(0.5).0);
}

/// Tests that a grid shows one time bin if the view sets a time, and otherwise the sum of all bins.
#[test]
fn mueller_grids_show_one_time_bin() {
    let t = tensor(axes([(Y, 1), (X, 1), (T, 3), (StokesOut, 4), (StokesIn, 4)]), |at| at.f(T) * 0.1);
    let at = |time_ps: Option<f64>| {
        let View::Mueller(view) = mueller_view(false) else { unreachable!("mueller_view returns a grid") };
        let view = View::Mueller(MuellerView { limit: Some(1.0), time_ps, ..view });
        let (img, r) = seen(&view, &panel(&t));
        colour(&img, r, 0.12, 0.12)
    };
    let signed = |v: f32| crate::colour::signed(v).0;
    assert_eq!([None, Some(2.0), Some(1.4)].map(at), [0.3, 0.2, 0.1].map(signed));
}

/// Tests that an arctan scale shows small values, and that a mask greys the elements below it. The standard
/// error of the left pixel is small. That of the right pixel is large.
#[test]
fn arctan_scale_and_mask_are_honoured() {
    let t = tensor(axes([(Y, 1), (X, 2), (StokesOut, 4), (StokesIn, 4)]), |at| {
        if at.i(StokesOut) == at.i(StokesIn) { 2.0 } else { 0.1 }
    });
    let error = tensor(axes([(Y, 1), (X, 2), (StokesOut, 4), (StokesIn, 4)]), |at| [0.01, 0.06][at.i(X)]);
    let full = Panel { std_error: Some(&error), ..panel(&t) };
    let view = |scale, mask_sigmas| MuellerView {
        slice: "s".into(),
        wavelength_nm: None,
        time_ps: None,
        normalized: true,
        limit: None,
        scale,
        mask_sigmas,
    };
    let at = |view: MuellerView, panel: &Panel, across: f64| {
        let (img, r) = seen(&View::Mueller(view), panel);
        // Element M01.
        colour(&img, r, 0.25 + 0.25 * across, 0.2)
    };
    let signed = |v: f32| crate::colour::signed(v).0;
    let (linear, arctan) = (SignedScale::Linear, SignedScale::Arctan);
    for across in [0.4, 0.9] {
        assert_eq!(at(view(linear, None), &full, across), signed(0.05));
        assert_eq!(at(view(arctan, None), &full, across), signed(0.4_f32.atan() / 8_f32.atan()));
    }
    assert_eq!(at(view(linear, Some(2.0)), &full, 0.4), signed(0.05));
    assert_eq!(at(view(linear, Some(2.0)), &full, 0.9), UNDEFINED.0);
    assert_eq!(at(view(linear, Some(1.5)), &full, 0.9), signed(0.05));
    assert_eq!(at(view(linear, Some(11.0)), &full, 0.4), UNDEFINED.0);
    let text = draw(&View::Mueller(view(arctan, Some(2.0))), "t", &full).unwrap().svg();
    assert!(text.contains("arctan scale"), "{text}");
    let words = "undefined (M00 is not positive), or magnitude below 2 standard errors.";
    assert!(text.contains(words), "{text}");
    let raw = MuellerView { normalized: false, ..view(linear, Some(2.0)) };
    assert!(draw(&View::Mueller(raw), "t", &full).unwrap().svg().contains("Grey: magnitude below 2"));
    let plain = draw(&View::Mueller(view(linear, None)), "t", &full).unwrap().svg();
    assert!(!plain.contains("arctan") && !plain.contains("standard errors"), "{plain}");
}

/// Tests that maps of elements have the arctan scale.
#[test]
fn maps_have_an_arctan_scale() {
    let t = tensor(axes([(Y, 1), (X, 2), (U, 2), (StokesOut, 4), (StokesIn, 4)]), |at| {
        if at.i(StokesOut) + at.i(StokesIn) == 0 { 2.0 } else { 0.1 }
    });
    let at = |scale| {
        let view = MapView { scale, ..map_view(0, [2, 2], None) };
        let (img, r) = seen(&View::SpaceSpace(view), &panel(&t));
        colour(&img, r, 0.5, 0.5)
    };
    assert_eq!(at(SignedScale::Linear), crate::colour::signed(0.05).0);
    assert_eq!(at(SignedScale::Arctan), crate::colour::signed(0.4_f32.atan() / 8_f32.atan()).0);
    let view = MapView { scale: SignedScale::Arctan, ..map_view(0, [2, 2], None) };
    let text = draw(&View::SpaceSpace(view), "t", &panel(&t)).unwrap().svg();
    assert!(text.contains("M22 / M00, arctan scale"), "{text}");
}

/// Tests that the average of many pixels has a smaller standard error than one pixel.
#[test]
fn averaged_pixels_are_masked_by_the_error_of_the_average() {
    let t = tensor(axes([(Y, 1), (X, 1760), (StokesOut, 4), (StokesIn, 4)]), |_| 1.0);
    let error = tensor(axes([(Y, 1), (X, 1760), (StokesOut, 4), (StokesIn, 4)]), |_| 0.8);
    let full = Panel { std_error: Some(&error), ..panel(&t) };
    let colour_with = |mask| {
        let View::Mueller(view) = mueller_view(true) else { unreachable!() };
        let (img, r) = seen(&View::Mueller(MuellerView { mask_sigmas: Some(mask), ..view }), &full);
        colour(&img, r, 0.4, 0.2)
    };
    // Four pixels are averaged, so the standard error is 0.4.
    assert_eq!(colour_with(2.4), crate::colour::signed(1.0).0);
    assert_eq!(colour_with(2.6), UNDEFINED.0);
}

/// Returns a tensor in which no camera row except row 7 has light. In this row, projector column 3 of 8 is
/// bright in time bin 5 of 10.
fn scanlines() -> Tensor {
    let bins = (0..10).map(|i| 105.0 + 10.0 * f64::from(i)).collect();
    tensor(
        vec![
            axis(Y, vec![2.0, 7.0]),
            counted(X, 8),
            axis(T, bins),
            counted(Bounces, 2),
            axis(Wavelength, RGB_NM.to_vec()),
        ],
        |at| {
            if at.i(Y) == 1 && at.i(X) == 3 && at.i(T) == 5 && at.i(Wavelength) != 0 { 1.0 } else { 0.0 }
        },
    )
}

#[test]
fn bright_bin_of_a_space_time_map_is_at_its_position() {
    let t = scanlines();
    let place = |r: usize, nm| seen(&View::SpaceTime(map_view(r, [0, 0], nm)), &panel(&t));
    let (img, r) = place(1, Some(550.0));
    // Time runs upward, so bin 5 of 10 is from 0.4 to 0.5 below the top.
    let bright = crate::colour::sequential(1.0).0;
    assert_eq!(colour(&img, r, 3.5 / 8.0, 0.45), bright);
    for (x, y) in [(2.5, 0.45), (4.5, 0.45), (3.5, 0.35), (3.5, 0.55)] {
        assert_eq!(colour(&img, r, x / 8.0, y), crate::colour::sequential(0.0).0);
    }
    // Without light at 450 nm, the colour is yellow.
    let (img, r) = place(1, None);
    assert_eq!(colour(&img, r, 3.5 / 8.0, 0.45), [255, 255, 0]);
    let (img, r) = place(0, None);
    assert_eq!(colour(&img, r, 3.5 / 8.0, 0.45), [0, 0, 0]);
}

#[test]
fn space_space_takes_columns_or_else_rows_and_divides_by_m00() {
    let axes = |rows, columns| axes([(X, 8), (V, rows), (U, columns), (StokesOut, 4), (StokesIn, 4)]);
    let value = |at: &At| {
        let on = at.i(X) == at.i(U) || at.i(X) == at.i(V);
        let m = if at.i(StokesOut) == 0 { 2.0 } else { -2.0 };
        if on { m } else { 0.0 }
    };
    let bright = crate::colour::sequential(1.0).0;
    for (rows, columns) in [(1, 8), (8, 1)] {
        let t = tensor(axes(rows, columns), value);
        let (img, r) = seen(&View::SpaceSpace(map_view(0, [0, 0], None)), &panel(&t));
        assert_eq!(colour(&img, r, 5.5 / 8.0, 1.0 - 5.5 / 8.0), bright, "{rows} × {columns}");
        let (img, r) = seen(&View::SpaceSpace(map_view(0, [1, 0], None)), &panel(&t));
        assert_eq!(colour(&img, r, 5.5 / 8.0, 1.0 - 5.5 / 8.0), crate::colour::signed(-1.0).0);
        assert_eq!(colour(&img, r, 5.5 / 8.0, 5.5 / 8.0), UNDEFINED.0);
    }
}

#[test]
fn flight_frames_follow_the_light() {
    // One pixel per bin is lit in a row of six, in bins 2 to 7 of 10.
    let t = tensor(wave(&[635.0], [(Y, 4), (X, 6), (T, 10), (Component, 2)]), |at| {
        if at.i(X) + 2 == at.i(T) { 3.0 } else { 0.0 }
    });
    // The three frames show bins 2, 5 and 7, whose lit columns are at x = 0, 3 and 5 of 6.
    let sheet = draw(&flight_view(3), "t", &panel(&t)).unwrap();
    let (img, places) = (sheet.pixels().unwrap(), images(&sheet));
    for (place, lit) in places.iter().zip([0, 3, 5]) {
        for x in 0..6 {
            let want = if x == lit { [255; 3] } else { [0; 3] };
            assert_eq!(colour(&img, *place, (f64::from(x) + 0.5) / 6.0, 0.5), want);
        }
    }
    assert_eq!(places.len(), 3);
    // The animation has the same frames, on pages of one size.
    let View::Flight(view) = flight_view(3) else { unreachable!() };
    let frames = animate(&view, "t", &panel(&t)).unwrap();
    for (frame, column) in frames.iter().zip([0.0, 3.0, 5.0]) {
        let img = frame.pixels().unwrap();
        let at = |x: f64| colour(&img, frame.data, (x + 0.5) / 6.0, 0.5);
        assert_eq!((at(column), at(4.0)), ([255; 3], [0; 3]));
        assert_eq!((frame.width(), frame.data), (frames[0].width(), frames[0].data));
    }
    assert_eq!(frames.len(), 3);
}

fn steps() -> (Tensor, Tensor, Tensor) {
    let bins: Vec<f64> = (0..20).map(|i| 5.0 + 10.0 * f64::from(i)).collect();
    let axes = vec![counted(Y, 2), counted(X, 4), axis(T, bins), axis(Wavelength, RGB_NM.to_vec())];
    let mean =
        tensor(axes.clone(), |at| if at.i(X) == 3 && at.i(Y) == 1 { 1.0 + at.f(Wavelength) } else { 99.0 });
    let error = tensor(axes.clone(), |_| 0.1);
    let overflow = tensor(axes.into_iter().filter(|a| a.kind != T).collect(), |_| 1.0);
    (mean, error, overflow)
}

#[test]
fn lines_and_bands_of_a_profile_pass_through_their_rows() {
    let (mean, error, overflow) = steps();
    let View::Profile(view) = profile_view([3.4, 0.8], [0, 0]) else { unreachable!() };
    let full = Panel { mean: &mean, std_error: Some(&error), overflow: Some(&overflow) };
    let (drawing, scales) = profile::draw(&view, "t", &full).unwrap();
    let img = drawing.pixels().unwrap();
    let (corner, end) = (scales.point((0.0, 0.0)), scales.point((200.0, 0.0)));
    let r = drawing.data;
    assert_eq!((corner, end), (Some((r.x, r.y + r.h)), Some((r.x + r.w, r.y + r.h))));
    let top = scales.point((0.0, 3.35)).unwrap().1;
    assert!((r.y - 40.0..r.y + 40.0).contains(&top), "{top}");
    let colours = crate::colour::line_colours(&RGB_NM);
    for (lane, line) in colours.iter().enumerate() {
        let pixel = |value: f64| {
            let (x, y) = scales.point((47.0, value)).unwrap();
            img.get_pixel(x as u32, y as u32).0
        };
        let value = 1.0 + lane as f64;
        let near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) < 60);
        assert!(near(pixel(value), line.0), "{lane}: {:?} {line:?}", pixel(value));
        let (one, two, none) = (pixel(value + 0.07), pixel(value + 0.15), pixel(value + 0.3));
        let dark = |c: [u8; 3]| 765 - c.iter().map(|v| u32::from(*v)).sum::<u32>();
        assert!(dark(one) > dark(two) && dark(two) > dark(none), "{one:?} {two:?} {none:?}");
        assert_eq!(none, [255; 3]);
    }
    // Without standard errors, there is no band.
    let (img, r) = seen(&View::Profile(view), &panel(&mean));
    assert_eq!(colour(&img, r, 0.32, 0.2), [255; 3]);
}
