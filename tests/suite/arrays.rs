//! Tests that renders into memory contain the same numbers as renders into stores.

use crate::harness::{mirror_room, rendered, scene};
use sunstone::render::Unwatched;
use sunstone::tensor::field::Field;
use sunstone::tensor::memory::Arrays;
use sunstone::transport::render::schedule::{self, Share};

/// Slices for these tests. The slices have:
/// - tiles that do not divide the image
/// - binned cameras with a smaller last bin
/// - light outside the time bins
/// - matrices
/// - listed rows
const SLICES: &str = r#"
[[slices]]
name = "mueller"
polarization = "mueller"
bounces = true
[[slices]]
name = "flight"
time = { start_ps = 12000, bin_ps = 500, bins = 6 }
split_first_bounce = true
[[slices]]
name = "coarse"
camera = { binned = 4 }
projector = { binned = [4, 8] }
time = { start_ps = 14000, bin_ps = 2000, bins = 2 }
[[slices]]
name = "rows"
camera = { rows = [3, 11] }
projector = { columns = [1, 5] }
"#;

#[test]
fn arrays_and_stores_agree_in_every_field() {
    let scene = scene(&mirror_room(18, 16, 3, 8, SLICES));
    let folder = tempfile::tempdir().expect("a folder");
    let store = rendered(&scene, folder.path().join("out.zarr"));
    let mut arrays = Arrays::default();
    let summary =
        schedule::render(&scene, &[], Share::default(), &mut arrays, &Unwatched).expect("memory takes all");
    assert!(summary.complete);
    assert_eq!(arrays.names(), store.slice_names());
    assert_eq!(arrays.samples(), store.read_samples([0, 0], [18, 18]).expect("samples"));
    let mut fields = 0;
    for name in store.slice_names() {
        let slice = store.slice(name).expect("a slice");
        for field in Field::ALL {
            let array = arrays.get(name, field);
            assert_eq!(array.is_some(), slice.has(field), "{name} {field:?}");
            let Some(array) = array else { continue };
            let stored = slice.read_all(field).expect("values");
            assert!(stored.data.iter().any(|v| *v != 0.0), "{name} {field:?} is empty");
            assert_eq!(array, stored, "{name} {field:?}");
            fields += 1;
        }
    }
    assert_eq!(fields, 4 * 3 + 2 * 2);
}

/// Tests that the total of a pixel, and its standard error, do not depend on the axes that a slice resolves.
#[test]
fn errors_of_totals_do_not_depend_on_the_resolved_axes() {
    let slices = r#"
[[slices]]
name = "photo"
[[slices]]
name = "mueller"
polarization = "mueller"
bounces = true
[[slices]]
name = "flight"
time = { start_ps = 12000, bin_ps = 500, bins = 6 }
split_first_bounce = true
[[slices]]
name = "ss"
projector = "all"
[[slices]]
name = "coarse"
camera = { binned = 3 }
"#;
    let scene = scene(&mirror_room(18, 16, 6, 9, slices));
    let mut arrays = Arrays::default();
    schedule::render(&scene, &[], Share::default(), &mut arrays, &Unwatched).expect("memory takes all");
    let get = |slice, field| arrays.get(slice, field).expect("the field").data;
    let errors = get("photo", Field::TotalStdError);
    assert!(errors.iter().filter(|e| **e > 0.0).count() > 200);
    for slice in ["mueller", "flight", "ss"] {
        for (a, b) in errors.iter().zip(get(slice, Field::TotalStdError)) {
            assert!((a - b).abs() <= 1e-5 * a, "{slice}: {b}, not {a}");
        }
    }
    // The standard error of a mean over wavelengths is at most the mean of the standard errors of the
    // wavelengths.
    for (total, each) in errors.iter().zip(get("photo", Field::StdError).chunks_exact(3)) {
        let bound = each.iter().sum::<f32>() / 3.0;
        assert!(*total <= 1.00001 * bound && *total >= 0.3 * bound, "{total}, {each:?}");
    }
    // Errors of different pixels are independent, and a bin has 9 pixels.
    let coarse = get("coarse", Field::TotalStdError);
    for (i, binned) in coarse.iter().enumerate() {
        let box_of = (0..9).map(|k| (i / 6 * 3 + k / 3) * 18 + i % 6 * 3 + k % 3);
        let want = box_of.map(|k| f64::from(errors[k]).powi(2)).sum::<f64>().sqrt() / 9.0;
        assert!((f64::from(*binned) - want).abs() <= 1e-5 * want, "{binned}, not {want}");
    }
}
