//! Chooses figures of a slice by the axes of the slice.

use crate::spec::{
    Figure, FlightView, MapView, MuellerView, PhotoView, ProfileView, SignedScale, View, twelve,
};
use tensor::axes::{Axis, AxisKind};

/// Minimum ratio of columns to rows of a slice that is drawn as scanlines instead of as an image.
const SCANLINE: usize = 8;
/// Maximum number of rows of a slice that is drawn as scanlines.
const FEW_ROWS: usize = 8;
/// Number of standard errors below which elements of a default Mueller grid are grey.
const SIGMAS: f32 = 2.0;

/// Returns the default figures of a slice. The name of a figure is the slice's name with the suffix `_photo`,
/// `_mueller`, `_flight`, `_xt`, `_ss` or `_profile`. The list is empty if no view can show the slice.
///
/// `has_errors` is whether the slice has standard errors. `pixel` is the camera pixel [x, y] of the time
/// profile.
pub fn figures(slice: &str, axes: &[Axis], has_errors: bool, pixel: [f64; 2]) -> Vec<Figure> {
    let len = |kind| axes.iter().find(|a| a.kind == kind).map_or(0, |a| a.coords.len());
    let [x, y, t] = [AxisKind::X, AxisKind::Y, AxisKind::T].map(len);
    let projector = len(AxisKind::U).max(len(AxisKind::V));
    let name = || slice.to_owned();
    // The row in the middle.
    let map = || MapView {
        slice: name(),
        wavelength_nm: None,
        row: y.saturating_sub(1) / 2,
        element: [0, 0],
        scale: SignedScale::Linear,
    };
    let is_scanline = x > 0 && y <= FEW_ROWS && SCANLINE * y <= x && (t > 0 || projector > 1);
    let mut views = vec![];
    if x > 0 && y > 0 && !is_scanline {
        views.push(("photo", View::Photo(PhotoView { slice: name(), white: None })));
        if len(AxisKind::StokesOut) == 4 && len(AxisKind::StokesIn) == 4 {
            let view = MuellerView {
                slice: name(),
                wavelength_nm: None,
                time_ps: None,
                normalized: true,
                limit: None,
                scale: SignedScale::Arctan,
                mask_sigmas: has_errors.then_some(SIGMAS),
            };
            views.push(("mueller", View::Mueller(view)));
        }
        if t > 1 {
            views.push(("flight", View::Flight(FlightView { slice: name(), frames: twelve() })));
        }
    }
    if is_scanline && t > 0 {
        views.push(("xt", View::SpaceTime(map())));
    }
    if x > 0 && projector > 1 {
        views.push(("ss", View::SpaceSpace(map())));
    }
    if x > 0 && y > 0 && t > 0 {
        let view = ProfileView { slice: name(), pixel, element: [0, 0] };
        views.push(("profile", View::Profile(view)));
    }
    views.into_iter().map(|(suffix, view)| Figure { name: format!("{slice}_{suffix}"), view }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use AxisKind::{Bounces, StokesIn, StokesOut, T, U, V, Wavelength, X, Y};

    fn names(lengths: &[(AxisKind, usize)]) -> Vec<String> {
        let axis = |&(kind, n): &(AxisKind, usize)| Axis {
            kind,
            coords: (0..n).map(|i| i as f64).collect(),
            chunk: 1,
        };
        let axes: Vec<Axis> = lengths.iter().map(axis).collect();
        figures("s", &axes, true, [0.0; 2]).into_iter().map(|mut f| f.name.split_off(2)).collect()
    }

    #[test]
    fn axes_select_the_figures() {
        let grid = [(StokesOut, 4), (StokesIn, 4), (Wavelength, 3)];
        let with = |more: &[(AxisKind, usize)]| names(&[more, &grid[..]].concat());
        assert_eq!(with(&[(Y, 12), (X, 16)]), ["photo", "mueller"]);
        assert_eq!(with(&[(Y, 12), (X, 16), (T, 8)]), ["photo", "mueller", "flight", "profile"]);
        assert_eq!(with(&[(Y, 1), (X, 64), (T, 8)]), ["xt", "profile"]);
        assert_eq!(with(&[(Y, 2), (X, 64), (V, 1), (U, 9)]), ["ss"]);
        assert_eq!(with(&[(Y, 1), (X, 1), (T, 8)]), ["photo", "mueller", "flight", "profile"]);
        assert_eq!(with(&[(Y, 1), (X, 64)]), ["photo", "mueller"]);
        assert_eq!(names(&[(Y, 12), (X, 16), (Bounces, 3)]), ["photo"]);
        assert_eq!(names(&[(Y, 4), (X, 4), (V, 3), (U, 3)]), ["photo", "ss"]);
        assert!(names(&[(T, 8)]).is_empty());
    }

    /// Tests that maps show the middle row, and that a slice without standard errors has no mask.
    #[test]
    fn options_follow_the_slice() {
        let axes = [(Y, 5), (X, 64), (T, 3)].map(|(kind, n)| Axis { kind, coords: vec![0.0; n], chunk: 1 });
        let [Figure { view: View::SpaceTime(map), .. }, _] = &figures("s", &axes, false, [0.0; 2])[..] else {
            panic!("a map and a profile")
        };
        assert_eq!(map.row, 2);
        let axes = [(Y, 5), (X, 6), (StokesOut, 4), (StokesIn, 4)].map(|(kind, n)| Axis {
            kind,
            coords: vec![0.0; n],
            chunk: 1,
        });
        for (has_errors, mask) in [(false, None), (true, Some(2.0))] {
            let all = figures("s", &axes, has_errors, [0.0; 2]);
            let Some(View::Mueller(grid)) = all.get(1).map(|f| &f.view) else { panic!("a grid") };
            assert_eq!((grid.scale, grid.mask_sigmas), (SignedScale::Arctan, mask));
        }
    }
}
