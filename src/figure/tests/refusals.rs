//! Tests that invalid views are rejected with a message that contains a fix.

use super::*;
use AxisKind::{StokesIn, StokesOut, T, U, Wavelength, X, Y};

fn message(view: &View, t: &Tensor) -> String {
    draw(view, "t", &panel(t)).expect_err("was drawn").to_string()
}

#[test]
fn missing_axes_are_named_with_their_fix() {
    let still = tensor(axes([(Y, 2), (X, 2), (Wavelength, 3)]), |_| 1.0);
    let time = "slice `s` has no time axis; draw a slice that is defined with `time = {";
    for view in [View::SpaceTime(map_view(0, [0, 0], None)), flight_view(3), profile_view([0.0; 2], [0, 0])] {
        assert!(message(&view, &still).starts_with(time), "{view:?}: {}", message(&view, &still));
    }
    let m = message(&View::SpaceSpace(map_view(0, [0, 0], None)), &still);
    assert!(m.contains("no projector column axis") && m.contains("projector = \"all\""), "{m}");
    for view in [mueller_view(true), View::SpaceSpace(map_view(0, [2, 0], None))] {
        let t = tensor(axes([(Y, 2), (X, 2), (U, 3)]), |_| 1.0);
        let m = message(&view, &t);
        assert!(m.contains("no Stokes axis") && m.contains("polarization = \"mueller\""), "{m}");
    }
    let scalar = tensor(vec![], |_| 1.0);
    assert!(message(&photo_view(), &scalar).contains("no camera row axis"));
}

#[test]
fn times_outside_the_bins_are_refused() {
    let of = |kinds: Vec<Axis>, ps| {
        let View::Mueller(view) = mueller_view(true) else { unreachable!("mueller_view returns a grid") };
        message(&View::Mueller(MuellerView { time_ps: Some(ps), ..view }), &tensor(kinds, |_| 1.0))
    };
    let timed = || axes([(Y, 2), (X, 2), (T, 3), (StokesOut, 4), (StokesIn, 4)]);
    for ps in [-0.6, 2.6, f64::NAN] {
        assert!(of(timed(), ps).contains("within the time bins of the slice"), "{ps}");
    }
    let still = axes([(Y, 2), (X, 2), (StokesOut, 4), (StokesIn, 4)]);
    assert!(of(still, 1.0).contains("no time axis"));
}

#[test]
fn wavelengths_that_the_slice_does_not_have_are_refused() {
    let stokes = [(Y, 2), (X, 2), (U, 2), (T, 2), (StokesOut, 4), (StokesIn, 4)];
    let t = tensor([axes(stokes), vec![axis(Wavelength, RGB_NM.to_vec())]].concat(), |_| 1.0);
    let grid = |nm| {
        View::Mueller(MuellerView {
            slice: "s".into(),
            wavelength_nm: Some(nm),
            time_ps: None,
            normalized: true,
            limit: None,
            scale: SignedScale::Linear,
            mask_sigmas: None,
        })
    };
    for nm in [600.0, 549.4, 660.6, 900.0] {
        for view in [
            grid(nm),
            View::SpaceSpace(map_view(0, [0, 0], Some(nm))),
            View::SpaceTime(map_view(0, [1, 2], Some(nm))),
        ] {
            let want = format!(
                "slice `s` has no wavelength {nm} nm; use a wavelength of the slice: 450, 550, 660 nm"
            );
            assert_eq!(message(&view, &t), want);
        }
    }
    assert!(message(&grid(f64::NAN), &t).contains("NaN nm"));
    assert!(draw(&grid(549.5), "t", &panel(&t)).is_ok());
    // A slice without a wavelength axis applies to all wavelengths.
    assert!(draw(&grid(600.0), "t", &panel(&tensor(axes(stokes), |_| 1.0))).is_ok());
}

#[test]
fn options_out_of_range_are_named() {
    let t = tensor(axes([(Y, 2), (X, 2), (T, 3), (StokesOut, 4), (StokesIn, 4)]), |_| 1.0);
    let m = message(&View::SpaceTime(map_view(2, [0, 0], None)), &t);
    assert!(m.contains("2 camera rows") && m.contains("use 0 to 1"), "{m}");
    assert!(message(&View::SpaceTime(map_view(0, [0, 4], None)), &t).contains("index 4"));
    assert!(message(&flight_view(0), &t).contains("`frames`"));
    assert!(message(&profile_view([f64::NAN, 0.0], [0, 0]), &t).contains("`pixel`"));
    for white in [0.0, -1.0, f32::NAN] {
        assert!(message(&white_view(white), &t).contains("`white`"));
    }
    let limit = View::Mueller(MuellerView {
        slice: "s".into(),
        wavelength_nm: None,
        time_ps: None,
        normalized: true,
        limit: Some(0.0),
        scale: SignedScale::Linear,
        mask_sigmas: None,
    });
    assert!(message(&limit, &t).contains("`limit`"));
    let View::Mueller(grid) = mueller_view(true) else { unreachable!() };
    let masked = |n| View::Mueller(MuellerView { mask_sigmas: Some(n), ..grid.clone() });
    assert_eq!(
        message(&masked(2.0), &t),
        "slice `s` has no standard errors, which the mask requires; draw the view without a mask"
    );
    for n in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(message(&masked(n), &t).contains("`mask_sigmas`"));
    }
}
