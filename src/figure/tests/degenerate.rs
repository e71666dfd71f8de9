//! Tests degenerate tensors. Drawing must never panic, and drawings must have a positive size.

use proptest::prelude::*;

use super::*;

/// Generates the lengths of all ten axes. A length is 1 to 4, and sometimes 0. Some axes are absent.
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
    fn arbitrary_tensors_never_panic(
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
            if let Ok(d) = draw(&view, "a title", &p) {
                let (w, h) = (d.width(), d.height());
                prop_assert!((300..=2300).contains(&w) && h <= 2300, "{w} × {h}");
                prop_assert!(numbers(&d.svg()), "{view:?}: {}", d.svg());
                // Rasterizing is slow. Therefore no figures except those with strokes at extreme coordinates
                // are rasterized.
                prop_assert!(!matches!(view, View::Profile(_)) || d.pixels().is_ok());
            }
        }
    }
}

#[test]
fn empty_and_damaged_tensors_are_errors() {
    for view in all_views() {
        let empty = Tensor::zeros("t", vec![counted(AxisKind::Y, 0)]);
        assert!(matches!(draw(&view, "", &panel(&empty)), Err(FigureError::Empty { .. })));
        let mut short = Tensor::zeros("t", vec![counted(AxisKind::Y, 2), counted(AxisKind::X, 3)]);
        short.data.pop();
        let twice = Tensor::zeros("t", vec![counted(AxisKind::Y, 2), counted(AxisKind::Y, 2)]);
        assert!(matches!(draw(&view, "", &panel(&twice)), Err(FigureError::Damaged { .. })));
        assert!(matches!(draw(&view, "", &panel(&short)), Err(FigureError::Damaged { .. })));
    }
}

#[test]
#[ignore = "slow: tools/check --all"]
fn wide_and_tiny_images_get_a_useful_size() {
    for (w, h) in [(1, 1), (2000, 1), (2000, 1500), (1, 700), (3001, 2)] {
        let t = tensor(axes([(AxisKind::Y, h), (AxisKind::X, w), (AxisKind::T, 1)]), |_| 1.0);
        for view in [photo_view(), flight_view(4), View::SpaceTime(map_view(0, [0, 0], None))] {
            let (img, r) = seen(&view, &panel(&t));
            assert!(
                (400..=2000).contains(&img.width().max(img.height())),
                "{w} × {h}: {:?}",
                img.dimensions()
            );
            assert!(r.w >= 24.0 && r.h >= 24.0, "{w} × {h}: {r:?}");
        }
    }
}

#[test]
fn zero_light_is_black_and_missing_values_are_grey() {
    for (value, want) in
        [(0.0, [0, 0, 0]), (f64::NAN, UNDEFINED.0), (f64::INFINITY, UNDEFINED.0), (-1.0, [0, 0, 0])]
    {
        let t = tensor(axes([(AxisKind::Y, 3), (AxisKind::X, 3), (AxisKind::T, 2)]), |_| value);
        let (img, r) = seen(&photo_view(), &panel(&t));
        assert_eq!(colour(&img, r, 0.5, 0.5), want, "{value}");
    }
}
