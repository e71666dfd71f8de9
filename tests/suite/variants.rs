//! Tests applications, and variants of scene files. Variants are rendered and distinguished, and a mixture of
//! variants is refused.

use crate::harness::{assert_same_store, read, run, stderr, stdout};
use serde_json::json;
use std::path::Path;
use sunstone::applications::truth;
use sunstone::apply::application::{Size, Truth};
use sunstone::apply::catalog;
use sunstone::render::Unwatched;
use sunstone::scene;
use sunstone::scene::syntax::Syntax;
use sunstone::scene::syntax::scene::SceneFile;
use sunstone::store::zarr::TensorStore;
use sunstone::studio::Studio;
use sunstone::tensor::field::Field;
use sunstone::transport::render::layers::{Options, layers};

const SCENE: &str = r#"
[render]
spp = 2
[camera]
resolution = [8, 8]
fov_x_deg = 30
pose.look_at = { origin = [0, 0, 3], target = [0, 0, 0], up = [0, 1, 0] }
[projector]
resolution = [8, 8]
fov_x_deg = 40
pose.look_at = { origin = [0.2, 0, 3], target = [0, 0, 0], up = [0, 1, 0] }
[materials]
wall.diffuse.albedo = 0.5
[[objects]]
name = "wall"
shape.rectangle = { corner = [-2, -2, 0], u = [4, 0, 0], v = [0, 4, 0] }
material = "wall"
[[slices]]
name = "photo"
"#;

const VARY: &str = r#"
[vary.shade]
path = "materials.wall.diffuse.albedo"
values = [0.25, 0.75, 0.5, 1.5]
"#;

fn mean(at: &Path) -> f64 {
    let store = TensorStore::open(at).expect("a store");
    let data = read(&store, "photo", Field::Mean).data;
    data.iter().map(|v| f64::from(*v)).sum::<f64>() / data.len() as f64
}

#[test]
fn variants_are_rendered_distinguished_and_not_mixed() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("plain.toml"), format!("name = \"s\"\n{SCENE}")).expect("writes");
    std::fs::write(at.join("varied.toml"), format!("name = \"s\"\n{SCENE}{VARY}")).expect("writes");
    let render = |scene: &str, more: &[&str], code| {
        run(at, &[&["render", scene, "--no-figures"], more].concat(), code)
    };
    // Without a selected variant, the scene has the same hash and the same numbers with and without `[vary]`.
    render("plain.toml", &["-o", "plain.zarr"], 0);
    render("varied.toml", &[], 0);
    let attributes = |store: &str| TensorStore::open(&at.join(store)).expect("a store").attributes();
    assert_eq!(attributes("plain.zarr")["scene_sha256"], attributes("out/s.zarr")["scene_sha256"]);
    assert!(!attributes("out/s.zarr").contains_key("variant"));
    assert_eq!(mean(&at.join("plain.zarr")), mean(&at.join("out/s.zarr")));
    // Light after a single bounce is proportional to the albedo.
    for (k, albedo) in [("0", 0.25), ("1", 0.75)] {
        render("varied.toml", &["--variant", k], 0);
        let store = format!("out/s_variant{k}.zarr");
        let ratio = mean(&at.join(&store)) / mean(&at.join("plain.zarr"));
        assert!((ratio - albedo / 0.5).abs() < 1e-5, "{ratio}");
        let expected =
            json!({"number": k.parse::<u64>().expect("a number"), "values": {"shade": albedo.to_string()}});
        assert_eq!(attributes(&store)["variant"], expected);
        assert_ne!(attributes(&store)["scene_sha256"], attributes("plain.zarr")["scene_sha256"]);
    }
    // Two renders of the same variant give the same store.
    render("varied.toml", &["--variant", "1", "-o", "again.zarr"], 0);
    assert_same_store(&at.join("again.zarr"), &at.join("out/s_variant1.zarr"));
    // A store of one variant cannot be resumed as another variant, or merged with another variant.
    let message = stderr(&render("varied.toml", &["--variant", "0", "--resume", "-o", "again.zarr"], 2));
    assert!(message.contains("differ in variant"), "{message}");
    render("varied.toml", &["--variant", "0", "--seed", "5", "-o", "other.zarr"], 0);
    let message = stderr(&run(at, &["merge", "again.zarr", "other.zarr", "-o", "both.zarr"], 2));
    assert!(message.contains("different scenes"), "{message}");
    // The program reports faults of a variant with their location in `[vary]`. There are at most four
    // variants.
    let message = stderr(&render("varied.toml", &["--variant", "3", "-o", "no.zarr"], 2));
    let line =
        format!("name = \"s\"\n{SCENE}{VARY}").lines().position(|l| l.contains("1.5")).expect("there") + 1;
    assert!(message.contains(&format!("varied.toml:{line}:")) && message.contains("1.5"), "{message}");
    let message = stderr(&render("varied.toml", &["--variant", "4", "-o", "no.zarr"], 2));
    assert!(message.contains("has 4"), "{message}");
    let message = stderr(&render("plain.toml", &["--variant", "0", "-o", "no.zarr"], 2));
    assert!(message.contains("no [vary]"), "{message}");
    assert!(!at.join("no.zarr").exists());
    let message = stdout(&run(at, &["info", "varied.toml"], 0));
    assert!(message.contains("vary shade") && message.contains("0.25, 0.75, 0.5, 1.5"), "{message}");
    let message = run(at, &["info", "out/s_variant1.zarr"], 0);
    assert!(stdout(&message).contains("\"number\":1"));
}

/// Tests that every scene of an application meets the requirements of the application, for every used
/// variant.
#[test]
#[ignore = "slow: tools/check --all"]
fn scenes_of_applications_have_their_variants() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenes");
    for application in catalog::all() {
        let plan = &application.plan;
        let path = root.join(plan.scene);
        let text = scene::read(&path).expect("a scene file");
        let mut hashes = std::collections::BTreeSet::new();
        for number in plan.train.iter().chain(&plan.test) {
            let variant = scene::variant_from_text(&path, &text, Some(*number)).expect("a variant");
            assert!(
                hashes.insert(variant.sha256.clone()),
                "variant {number} of {} is another's twin",
                plan.scene
            );
            let of_truth = plan.truth.iter().filter_map(|t| match t {
                Truth::Slice { slice, .. } => Some(slice),
                _ => None,
            });
            for name in plan.slices.iter().chain(of_truth) {
                assert!(variant.slices.iter().any(|s| s.name == *name), "{name}");
            }
        }
    }
}

#[test]
#[ignore = "slow: tools/check --all"]
fn applications_are_listed_run_resumed_and_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let listed = stdout(&run(at, &["apply", "list"], 0));
    for application in catalog::all() {
        assert!(listed.contains(application.name), "{listed}");
    }
    assert!(stderr(&run(at, &["apply", "alchemy"], 2)).contains("metamerism"));
    assert!(stderr(&run(at, &["apply", "metamerism", "--preview"], 2)).contains("--scenes"));
    assert!(stderr(&run(at, &["apply", "metamerism", "--seeds", "0"], 2)).contains("--seeds"));
    for (given, part) in [
        (["--train", "1-", ""], "1-"),
        (["--test", "5-3", ""], "5-3"),
        (["--test", "1-9/0", ""], "1-9/0"),
        (["--train", "0-99999999", ""], "10000 variants"),
        (["--spp", "0", ""], "--spp"),
        (["--train", "0-7", "--test=7"], "variant 7 is for training and for testing"),
    ] {
        let words = given.into_iter().filter(|w| !w.is_empty());
        let message =
            stderr(&run(at, &["apply", "metamerism"].into_iter().chain(words).collect::<Vec<_>>(), 2));
        assert!(message.contains(part), "{message}");
    }
    let unknown = stderr(&run(at, &["apply", "metamerism", "--reference", "colour"], 2));
    assert!(unknown.contains("unknown method `colour`") && unknown.contains("RGB"), "{unknown}");
    let scenes = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenes");
    let scenes = scenes.to_str().expect("UTF-8");
    let arguments = ["apply", "metamerism", "--preview", "--seeds", "1", "--scenes", scenes];
    let first = stdout(&run(at, &arguments, 0));
    assert!(first.contains("(20 new renders)"), "{first}");
    let report = at.join("out/apply/metamerism_preview");
    for name in ["table.csv", "scores.csv", "report.json", "score_rgb.png"] {
        assert!(report.join(name).is_file(), "{name}");
    }
    // The bound exceeds the scores of all methods. Colour provides little information, because the fruits are
    // metamers.
    let table = std::fs::read_to_string(report.join("table.csv")).expect("a table");
    let area = |method: &str| -> f64 {
        let line = table.lines().find(|l| l.contains(&format!("\"{method}\""))).expect("a row");
        line.split(',')
            .nth(if method.contains(',') { 5 } else { 4 })
            .and_then(|v| v.parse().ok())
            .expect("a number")
    };
    assert!(area("all epipolar elements") > 0.98 && area("RGB") < 0.7, "{table}");
    assert!(area("-(2,2) epipolar") > area("RGB"), "{table}");
    // A repeated run renders nothing and gives the same result.
    let again = stdout(&run(at, &arguments, 0));
    assert_eq!(again.replace("(0 new renders", "(20 new renders"), first);
    // The command repeats a deleted render, with the same numbers.
    let renders = at.join("out/apply/renders");
    let one = std::fs::read_dir(&renders).expect("renders").next().expect("one").expect("one").path();
    std::fs::remove_dir_all(one).expect("removes");
    let third = stdout(&run(at, &arguments, 0));
    assert_eq!(third.replace("(1 new renders", "(20 new renders"), first);
    // With another reference, the same difference has the opposite sign.
    let difference = |method: &str| -> f64 {
        let table = std::fs::read_to_string(report.join("table.csv")).expect("a table");
        let line = table.lines().find(|l| l.contains(&format!("\"{method}\""))).expect("a row");
        let mut columns = line.split(',').skip(method.matches(',').count());
        columns.nth(8).and_then(|v| v.parse().ok()).expect("a number")
    };
    let before = difference("RGB");
    run(at, &[&arguments[..], &["--reference", "RGB"]].concat(), 0);
    assert!(before > 0.1 && difference("-(2,2) epipolar") == -before, "{before}");
    // Other variants are rendered, and are in the table.
    let others = [&arguments[..], &["--train", "0-6/2", "--test", "1000,1001", "-o", "others"]].concat();
    assert!(stdout(&run(at, &others, 0)).contains("4 training variants, 2 test variants"));
    let scores = std::fs::read_to_string(at.join("others/scores.csv")).expect("scores");
    assert!(scores.contains("1000") && scores.contains("1001"), "{scores}");
    figures_keep_the_fit(at, scenes);
}

/// Tests that a method is fitted again if a render changed or the stored fit is damaged, and is not fitted
/// again otherwise.
fn figures_keep_the_fit(at: &Path, scenes: &str) {
    let panel = "view.apply = { name = \"metamerism\", picture = \"score\", variant = 8, method = \"RGB\" }";
    let figure =
        format!("columns = 1\n[[panels]]\n{panel}\ncaption = \"{{mean area under the curve:.9}}\"\n");
    std::fs::write(at.join("f.toml"), figure).expect("writes");
    let fit = at.join("out/apply/renders/metamerism_48px_16spp_1seeds.fit");
    let draw = || {
        run(at, &["figure", "f.toml", "--preview", "--scenes", scenes, "-o", "f.svg"], 0);
        let picture = std::fs::read(at.join("f.svg")).expect("a picture");
        let written = std::fs::metadata(&fit).and_then(|m| m.modified()).expect("a fit");
        (picture, written, std::fs::read(&fit).expect("a fit"))
    };
    let first = draw();
    assert_eq!(draw(), first);
    // The command recomputes a damaged fit.
    let mut damaged = first.2.clone();
    let last = damaged.len() - 1;
    damaged[last] ^= 1;
    std::fs::write(&fit, &damaged).expect("writes");
    let fixed = draw();
    assert_eq!((&fixed.0, &fixed.2), (&first.0, &first.2));
    // A second render of the same light has a different render time. The key of the fit therefore differs,
    // but the numbers are the same.
    let renders = std::fs::read_dir(at.join("out/apply/renders")).expect("renders");
    let mut stores = renders.map(|e| e.expect("one").path());
    let drawn = stores.find(|p| p.to_string_lossy().contains("_variant8_")).expect("the drawn variant");
    std::fs::remove_dir_all(drawn).expect("removes");
    let anew = draw();
    assert_eq!(anew.0, first.0);
    assert_ne!(anew.2, first.2);
}

/// Tests that the light of each variant is rendered once if seeds affect only a detector.
///
/// The errors in the resulting table equal two closed forms. The first closed form is 0.5e-3 √(440/15/16),
/// for fifteen learned captures with a polarizer array. The second closed form is 0.5e-3 √(196/16), for 36
/// captures of dual rotating retarders.
#[test]
#[ignore = "slow: tools/check --all"]
fn ellipsometry_renders_only_light_and_errors_match_closed_forms() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let scenes = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenes");
    let scenes = scenes.to_str().expect("UTF-8");
    let arguments = ["apply", "ellipsometry", "--preview", "--seeds", "1", "--scenes", scenes];
    let message = stdout(&run(at, &arguments, 0));
    assert!(message.contains("(20 new renders)"), "{message}");
    let table =
        std::fs::read_to_string(at.join("out/apply/ellipsometry_preview/table.csv")).expect("a table");
    let mean = |metric: &str, method: &str| -> f64 {
        let start = format!("\"{metric}\",\"1e-3 of the mean M00\",\"{method}\",\"");
        let line = table.lines().find_map(|l| l.strip_prefix(&start)).expect("a row");
        let rest = line.split_once("\",").expect("a source").1;
        rest.split(',').next().and_then(|v| v.parse().ok()).expect("a number")
    };
    // Ten variants of 48 x 36 x 3 matrices give a relative spread of at most 1e-3. Few directions have most
    // of the error.
    let near = |found: f64, variance: f64| (found / (0.5 * (variance / 16.0).sqrt()) - 1.0).abs() < 5e-3;
    assert!(near(mean("error, 15 captures", "L-QRPR-P"), 440.0 / 15.0), "{table}");
    assert!(near(mean("error, 36 captures", "DRR"), 196.0), "{table}");
}

/// Tests coverage, object numbers and texture coordinates against closed forms. The scene is a wall behind a
/// pane of glass, with a sphere between pane and wall.
#[test]
fn truth_maps_see_through_glass() {
    let text = r#"
[camera]
resolution = [64, 64]
fov_x_deg = 40
pose.look_at = { origin = [0, 0, 2], target = [0, 0, 0], up = [0, 1, 0] }
[projector]
resolution = [8, 8]
fov_x_deg = 40
pose.look_at = { origin = [0.2, 0, 2], target = [0, 0, 0], up = [0, 1, 0] }
[materials]
wall.diffuse.albedo = 0.5
ball.diffuse.albedo = 0.1
glass.dielectric = { ior = 1.5 }
[[objects]]
shape.rectangle = { corner = [-1, -1, 0], u = [2, 0, 0], v = [0, 2, 0] }
material = "wall"
[[objects]]
shape.cube = { min = [-2, -2, 0.7], max = [2, 2, 1] }
material = "glass"
[[objects]]
shape.sphere = { center = [0, 0, 1.5], radius = 0.05 }
material = "ball"
"#;
    let path = Path::new("scene.toml");
    let file = SceneFile::read(path, text).expect("a scene file");
    let mut built = scene::from_file(path, text, &file).expect("a scene");
    built.keep_texture_coordinates();
    let object = truth::object(&built);
    assert_eq!((object.at(32, 32)[0], object.at(2, 60)[0]), (2.0, 0.0));
    // The sphere fills a cone whose half angle has the sine 0.05 / 0.5, which is a disk of radius f
    // tan(asin(0.1)) pixels. Each pixel has nine rays.
    let focal = 32.0 / 20.0_f64.to_radians().tan();
    let area = std::f64::consts::PI * (focal * 0.1_f64.asin().tan()).powi(2);
    let ball: f64 = truth::material(&built, &["ball"]).data.iter().sum();
    assert!((ball / area - 1.0).abs() < 0.02, "{ball} {area}");
    let wall = truth::material(&built, &["wall", "ball"]);
    assert!(wall.data.iter().all(|v| *v == 1.0), "all rays end at one of the two");
    // A ray at angle θ has the angle θ' with sin θ' = sin θ / 1.5 in the pane. The ray meets the wall 0.3
    // (tan θ - tan θ') nearer to the axis.
    let texture = truth::texture(&built);
    for x in [4, 50, 63] {
        let across = (x as f64 + 0.5 - 32.0) / focal;
        let down = (20.0 + 0.5 - 32.0) / focal;
        let slope = across.hypot(down);
        let within = (slope.atan().sin() / 1.5).asin().tan();
        let reach = (1.7 * slope + 0.3 * within) / slope;
        let expected = [0.5 + 0.5 * across * reach, 0.5 - 0.5 * down * reach];
        for (found, expected) in texture.at(x, 20).iter().zip(expected) {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
    }
    // In the layers, the sphere's nearest point is 0.45 m away, at the position computed from the
    // calibration.
    let set = layers(&built, Options { side: 4, through: true });
    let depth = truth::layer(&set, "depth").expect("a layer");
    assert!((depth.at(32, 32)[0] - 0.45).abs() < 1e-3, "{}", depth.at(32, 32)[0]);
    let at = truth::layer(&set, "position").expect("a layer");
    let seen: [f64; 3] = at.at(32, 32).try_into().expect("a position");
    let camera = truth::rig(&built).expect("a rig").camera;
    let pixel = camera.project(seen.into()).expect("in front");
    assert!(pixel.iter().all(|p| (p - 32.5).abs() < 0.01), "{pixel:?}");
    assert!(truth::layer(&set, "colour").is_none());
}

/// A corner of two walls. The interreflected light is noisy with few samples. The variants are nearly equal.
const CORNER: &str = r#"
name = "corner"
camera = { resolution = [32, 32], fov_x_deg = 30, pose.look_at = { origin = [0, 1, 3], target = [0, 0, 0], up = [0, 1, 0] } }
projector = { resolution = [32, 32], fov_x_deg = 40, pose.look_at = { origin = [0.3, 1, 3], target = [0, 0, 0], up = [0, 1, 0] } }
materials.wall.diffuse.albedo = 0.7
materials.floor.diffuse.albedo = 0.8
objects = [
    { name = "wall", shape.rectangle = { corner = [-2, -0.5, -0.5], u = [4, 0, 0], v = [0, 4, 0] }, material = "wall" },
    { name = "floor", shape.rectangle = { corner = [-2, -0.5, 3], u = [4, 0, 0], v = [0, 0, -4] }, material = "floor" },
]
slices = [{ name = "photo" }]
vary.shade = { path = "materials.wall.diffuse.albedo", values = [0.7, 0.701] }
"#;

/// Tests that the noise of two variants is independent, so that training data and test data have different
/// noise. With a single seed for all variants, the noise would be equal.
#[test]
fn variants_of_one_seed_have_independent_noise() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, renders) = (folder.path().join("corner.toml"), folder.path().join("renders"));
    std::fs::write(&path, CORNER).expect("a scene");
    let mut studio = Studio::open(&path, &renders, &Unwatched).expect("a studio");
    let variants = [0, 1].map(|number| studio.variant(Some(number)).expect("a variant"));
    let mut noise = |variant: usize, number: Option<u64>| -> Vec<f64> {
        let size = Size { pixels: 32, spp: 4 };
        let [a, b] = [1, 2].map(|seed| {
            let store = studio.render(number, &variants[variant], seed, size, &["photo"]).expect("a render");
            read(&store, "photo", Field::Mean).data
        });
        a.iter().zip(&b).map(|(a, b)| f64::from(a - b)).collect()
    };
    let correlation = |a: &[f64], b: &[f64]| -> f64 {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
    };
    let own = [noise(0, Some(0)), noise(1, Some(1))];
    let shared = [noise(0, None), noise(1, None)];
    assert!(correlation(&shared[0], &shared[1]) > 0.9);
    // The standard deviation of a sum of independent products follows from the products themselves.
    let products: Vec<f64> = own[0].iter().zip(&own[1]).map(|(a, b)| a * b).collect();
    let sum = products.iter().sum::<f64>();
    let deviation = products.iter().map(|p| p * p).sum::<f64>().sqrt();
    assert!(sum.abs() < 5.0 * deviation, "{sum} of {deviation}");
    // The renders have noise.
    assert!(deviation > 0.0);
}
