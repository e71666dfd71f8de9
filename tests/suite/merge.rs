//! Tests that merged stores of two seeds equal the result of all samples together.

use crate::harness::{mirror_room, read, refusals, run, stderr};
use std::path::Path;
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::field::Field;

const SPP: f64 = 64.0;
/// Number of independent groups of samples.
const GROUPS: f64 = 32.0;

const SLICES: &str = r#"
[[slices]]
name = "mueller"
polarization = "mueller"
[[slices]]
name = "flight"
time = { start_ps = 12000, bin_ps = 500, bins = 20 }
[[slices]]
name = "coarse"
camera = { binned = 4 }
"#;

fn render(at: &Path, scene: &str, seed: &str, store: &str) {
    run(at, &["render", scene, "--seed", seed, "--no-figures", "-o", store], 0);
}

#[test]
fn two_seeds_pool_exactly() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(32, 32, SPP as u32, 16, SLICES)).expect("a scene");
    render(at, "scene.toml", "1", "a.zarr");
    render(at, "scene.toml", "2", "b.zarr");
    run(at, &["merge", "a.zarr", "b.zarr", "-o", "ab.zarr"], 0);
    let [a, b, ab] =
        ["a.zarr", "b.zarr", "ab.zarr"].map(|p| TensorStore::open(&at.join(p)).expect("a store"));
    assert_eq!(ab.attributes()["samples_per_pixel"], 2.0 * SPP);
    assert_eq!(ab.attributes()["replicates_per_pixel"], 2.0 * GROUPS);
    assert_eq!(ab.attributes()["seeds"], serde_json::json!([1, 2]));
    assert!(ab.read_samples([0, 0], [32, 32]).expect("samples").iter().all(|n| f64::from(*n) == 2.0 * SPP));
    let parts = [
        ("mueller", Field::Mean, Field::StdError),
        ("flight", Field::Mean, Field::StdError),
        ("flight", Field::Overflow, Field::OverflowStdError),
        ("coarse", Field::Mean, Field::StdError),
    ];
    for (slice, mean, error) in parts {
        let get = |s: &TensorStore, f| read(s, slice, f).data;
        let (ma, mb, m) = (get(&a, mean), get(&b, mean), get(&ab, mean));
        let (ea, eb, e) = (get(&a, error), get(&b, error), get(&ab, error));
        let mut gains = Vec::new();
        for i in 0..m.len() {
            let [ma, mb, ea, eb] = [ma[i], mb[i], ea[i], eb[i]].map(f64::from);
            let want = (ma + mb) / 2.0;
            assert!(
                (f64::from(m[i]) - want).abs() <= 1e-5 * ma.abs().max(mb.abs()),
                "{slice}: {} not {want}",
                m[i]
            );
            // Σ(x - m)² over all groups is the sum of two parts. The first part is each half's squared
            // deviations from the mean of the half. The second part is the squared deviations of the halves'
            // means from the common mean.
            let squares = (ea * ea + eb * eb) * GROUPS * (GROUPS - 1.0)
                + GROUPS * ((ma - want).powi(2) + (mb - want).powi(2));
            let want = match slice {
                "coarse" => (ea * ea + eb * eb).sqrt() / 2.0,
                _ => (squares / (2.0 * GROUPS * (2.0 * GROUPS - 1.0))).sqrt(),
            };
            assert!((f64::from(e[i]) - want).abs() <= 1e-5 * want, "{slice}: error {} not {want}", e[i]);
            if ea > 0.0 && eb > 0.0 {
                gains.push((ea * ea + eb * eb).sqrt() / std::f64::consts::SQRT_2 / f64::from(e[i]));
            }
        }
        gains.sort_by(f64::total_cmp);
        let median = gains[gains.len() / 2];
        println!("{slice} {mean:?}: {} elements, error falls by {median:.4}", gains.len());
        assert!(gains.len() > 100);
        assert!(
            (median / std::f64::consts::SQRT_2 - 1.0).abs() < 0.02,
            "{slice}: the error falls by {median}, not √2"
        );
    }
}

#[test]
#[ignore = "slow: tools/check --all"]
fn incompatible_stores_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let text = mirror_room(8, 8, 2, 8, SLICES);
    std::fs::write(at.join("one.toml"), &text).expect("a scene");
    std::fs::write(at.join("two.toml"), text.replace("alpha = 0.18", "alpha = 0.2")).expect("a scene");
    render(at, "one.toml", "1", "a.zarr");
    render(at, "one.toml", "2", "b.zarr");
    render(at, "two.toml", "3", "c.zarr");
    run(at, &["render", "one.toml", "--seed", "4", "--slices", "coarse", "-o", "d.zarr"], 0);
    run(at, &["merge", "a.zarr", "b.zarr", "-o", "ab.zarr"], 0);
    refusals(
        at,
        &[
            ("merge a.zarr a.zarr -o out.zarr", "seed 1"),
            ("merge a.zarr c.zarr -o out.zarr", "different scenes"),
            ("merge a.zarr d.zarr -o out.zarr", "differ in slice"),
            ("merge a.zarr missing.zarr -o out.zarr", "does not exist"),
            ("merge a.zarr -o out.zarr", "at least two"),
            // A merged store records the seeds of its inputs.
            ("merge ab.zarr b.zarr -o out.zarr", "seed 2"),
            ("merge a.zarr b.zarr -o ab.zarr", "ab.zarr"),
        ],
    );
}

/// Tests that renders of different integrators cannot be merged, and that a render cannot be resumed with
/// another integrator.
#[test]
fn different_integrators_are_not_mixed() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(16, 16, 8, 16, SLICES)).expect("a scene");
    render(at, "scene.toml", "1", "a.zarr");
    let path = ["render", "scene.toml", "--no-figures", "--integrator", "path"];
    run(at, &[&path[..], &["--seed", "2", "-o", "b.zarr"]].concat(), 0);
    let message = stderr(&run(at, &["merge", "a.zarr", "b.zarr", "-o", "ab.zarr"], 2));
    assert!(message.contains("different integrators"), "{message}");
    assert!(!at.join("ab.zarr").exists());
    let again = [&path[..], &["--seed", "1", "-o", "a.zarr", "--resume"]].concat();
    let message = stderr(&run(at, &again, 2));
    assert!(message.contains("integrator"), "{message}");
    let message = stderr(&run(at, &["render", "scene.toml", "--integrator", "photon"], 2));
    assert!(message.contains("auto, path, caustics, bidirectional"), "{message}");
}
