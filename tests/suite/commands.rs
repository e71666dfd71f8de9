//! Tests the commands render, info, probe, figure, export, merge and schema on a small scene.

use crate::harness::{self, refusals};
use std::path::Path;
use std::process::Stdio;
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::axes::AxisKind;
use sunstone::tensor::field::Field;

const SCENE: &str = r#"
wavelengths_nm = [450, 550, 660]
[render]
spp = 8
tile = 8
[camera]
resolution = [16, 12]
fov_x_deg = 40
pose.look_at = { origin = [0, 0, 2], target = [0, 0, 0] }
[projector]
resolution = [8, 6]
fov_x_deg = 50
irradiance = 5
pose.look_at = { origin = [0.4, 0, 2], target = [0, 0, 0] }
[materials]
wall.diffuse.albedo = [0.5, 0.6, 0.7]
gold.rough_conductor = { n = [1.38, 0.42, 0.14], k = [1.92, 2.47, 3.70], alpha = 0.3 }
[[objects]]
shape.rectangle = {}
material = "wall"
[[objects]]
shape.sphere = { center = [0, 0, 0.4], radius = 0.3 }
material = "gold"
[[slices]]
name = "image"
polarization = "mueller"
[[slices]]
name = "xt"
camera = { rows = [6] }
projector = { binned = 2 }
time = { start_ps = 8000, bin_ps = 100, bins = 64 }
polarization = "mueller"
[[figures]]
name = "photo"
view.photo = { slice = "image" }
[[figures]]
name = "grid"
view.mueller = { slice = "image" }
"#;

/// Runs a command that must succeed, and returns its output.
pub fn run(dir: &Path, arguments: &[&str]) -> String {
    harness::stdout(&harness::run(dir, arguments, 0))
}

/// Runs a command that must refuse its input. Returns the error message.
pub fn refused(dir: &Path, arguments: &[&str]) -> String {
    harness::stderr(&harness::run(dir, arguments, 2))
}

pub fn rendered() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("room")).unwrap();
    std::fs::write(dir.path().join("room/scene.toml"), SCENE).unwrap();
    let out = run(dir.path(), &["render", "room/scene.toml"]);
    assert!(out.contains("out/room.zarr") && out.contains("photo.png"), "{out}");
    dir
}

#[test]
fn a_chain_of_commands() {
    let dir = rendered();
    let d = dir.path();
    for figure in ["photo", "grid"] {
        let path = d.join(format!("out/room.figures/{figure}.png"));
        assert!(image::open(path).unwrap().width() > 100);
    }
    let info = run(d, &["info", "out/room.zarr"]);
    assert!(info.contains("samples_per_pixel  8") && info.contains("overflow"), "{info}");

    // For a scene, `info` prints the content. `info` prints no warnings, although a mirror is in the
    // projector's light.
    let about = run(d, &["info", "room/scene.toml"]);
    assert!(about.contains("integrator         path") && about.contains("1 quadrics"), "{about}");
    assert!(!about.contains("warning"), "{about}");
    let mirror = SCENE.replace("gold.rough_conductor", "gold.conductor").replace(", alpha = 0.3 }", " }");
    std::fs::write(d.join("mirror.toml"), &mirror).unwrap();
    let about = run(d, &["info", "mirror.toml"]);
    assert!(about.contains("integrator         caustics (") && !about.contains("warning"), "{about}");
    let plain = mirror.replace("[render]", "[render]\nintegrator = \"path\"");
    std::fs::write(d.join("plain.toml"), plain).unwrap();
    let about = run(d, &["info", "plain.toml"]);
    assert!(about.contains("warning: ") && about.contains("remove `integrator`"), "{about}");
    let both = mirror.replace("[render]", "[render]\nintegrator = \"bidirectional\"");
    std::fs::write(d.join("both.toml"), both).unwrap();
    let about = run(d, &["info", "both.toml"]);
    assert!(!about.contains("warning"), "{about}");
    let walks = mirror.replace("[render]", "[render]\nintegrator = \"bidirectional\"\nmanifold = false");
    std::fs::write(d.join("walks.toml"), walks).unwrap();
    let about = run(d, &["info", "walks.toml"]);
    assert!(about.contains("is not found") && about.contains("manifold = true"), "{about}");

    // The printed T_p is the sum over the image.
    let printed =
        run(d, &["probe", "out/room.zarr", "image", "--preset", "polarimetric", "-k", "wavelength=550"]);
    let m00: f64 = printed
        .lines()
        .find_map(|l| l.strip_prefix("0,0,"))
        .and_then(|l| l.split(',').next()?.parse().ok())
        .expect("M00 is printed");
    let store = TensorStore::open(&d.join("out/room.zarr")).unwrap();
    let mean = store.slice("image").unwrap().read_all(Field::Mean).unwrap();
    let sum = mean
        .select(AxisKind::Wavelength, 1)
        .select(AxisKind::StokesIn, 0)
        .select(AxisKind::StokesOut, 0)
        .sum(AxisKind::X)
        .sum(AxisKind::Y);
    assert!((m00 / f64::from(sum.data[0]) - 1.0).abs() < 1e-5);

    // A pattern of ones gives the image of full drive. Half drive gives half of the image of full drive.
    for drive in [255_u8, 128] {
        let file = d.join("pattern.png");
        image::GrayImage::from_pixel(8, 6, image::Luma([drive])).save(&file).unwrap();
        let line = "probe out/room.zarr xt --pattern pattern.png --sum v,u -o lit.zarr --force";
        run(d, &line.split(' ').collect::<Vec<_>>());
        let lit = TensorStore::open(&d.join("lit.zarr")).unwrap();
        let name = lit.slice_names()[0].clone();
        let lit = lit.slice(&name).unwrap().read_all(Field::Mean).unwrap();
        let all = store.slice("xt").unwrap().read_all(Field::Mean).unwrap();
        let (a, b): (f64, f64) =
            (lit.data.iter().map(|v| f64::from(*v)).sum(), all.data.iter().map(|v| f64::from(*v)).sum());
        assert!((a / b - f64::from(drive) / 255.0).abs() < 1e-4, "{a} {b}");
    }
    let csv = run(
        d,
        &["probe", "out/room.zarr", "xt", "-k", "x=8", "-k", "wavelength=550", "--sum", "v,u", "--csv", "-"],
    );
    assert!(csv.starts_with("y,t,stokes_out,stokes_in,mean,std_error") || csv.starts_with("t,"), "{csv}");
    run(d, &["probe", "out/room.zarr", "image", "--stokes", "horizontal", "-o", "h.npy"]);
    assert!(d.join("h.npy").exists());

    run(d, &["export", "out/room.zarr", "image", "--mueller", "-o", "room.exr"]);
    assert!(std::fs::metadata(d.join("room.exr")).unwrap().len() > 1000);
    run(
        d,
        &["figure", "out/room.zarr", "--view", "profile", "--slice", "xt", "--pixel", "8,6", "-o", "p.png"],
    );
    assert!(d.join("p.png").exists());
    // The file extension, or the option for the scene's figures, determines the format.
    let view = ["figure", "out/room.zarr", "--view", "profile", "--slice", "xt", "--pixel", "8,6", "-o"];
    for (name, head) in [("p.svg", "<svg "), ("p.pdf", "%PDF-")] {
        run(d, &[&view[..], &[name]].concat());
        let bytes = std::fs::read(d.join(name)).unwrap();
        assert!(bytes.starts_with(head.as_bytes()), "{name}");
    }
    let drawn = run(d, &["figure", "out/room.zarr", "photo", "--format", "svg", "-o", "drawn"]);
    assert!(drawn.contains("photo.svg") && d.join("drawn/photo.svg").exists(), "{drawn}");
    for name in ["p.jpg", "p.gif"] {
        let message = refused(d, &[&view[..], &[name]].concat());
        assert!(message.contains(".png, .svg or .pdf") && !d.join(name).exists(), "{message}");
    }

    run(d, &["render", "room/scene.toml", "--seed", "1", "-o", "b.zarr", "--no-figures"]);
    run(d, &["merge", "out/room.zarr", "b.zarr", "-o", "ab.zarr"]);
    let info = run(d, &["info", "ab.zarr"]);
    assert!(info.contains("[0,1]") && info.contains("samples_per_pixel  16"), "{info}");
}

/// Tests that `figure` draws default figures of a store whose scene lists no figures, and that `render` draws
/// none.
#[test]
fn a_store_without_listed_figures_has_default_figures() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let plain = &SCENE[..SCENE.find("[[figures]]").unwrap()];
    std::fs::write(d.join("scene.toml"), plain).unwrap();
    let rendered = harness::run(d, &["render", "scene.toml", "-o", "s.zarr"], 0);
    assert!(!d.join("s.figures").exists() && !harness::stderr(&rendered).contains("default figures"));
    let note = "note: the scene lists no figures; these are default figures";
    let drawn = harness::run(d, &["figure", "s.zarr"], 0);
    assert!(harness::stderr(&drawn).lines().any(|l| l == note));
    let names = ["image_photo", "image_mueller", "xt_xt", "xt_ss", "xt_profile"];
    let paths: Vec<String> = harness::stdout(&drawn).lines().map(str::to_owned).collect();
    assert_eq!(paths.len(), names.len(), "{paths:?}");
    for (path, name) in paths.iter().zip(names) {
        assert!(path.ends_with(&format!("s.figures/{name}.png")), "{path}");
        assert!(image::open(d.join(path)).unwrap().width() > 100);
    }
    let one = harness::run(d, &["figure", "s.zarr", "xt_profile", "--format", "svg", "-o", "one"], 0);
    assert!(!harness::stderr(&one).contains("default figures"));
    assert_eq!(std::fs::read_dir(d.join("one")).unwrap().count(), 1);
    let message = refused(d, &["figure", "s.zarr", "photo"]);
    let known = "unknown figure `photo`; the scene lists no figures, and the default figures are: image_photo, image_mueller, xt_xt, xt_ss, xt_profile; use one";
    assert!(message.contains(known), "{message}");

    // The default grid has an arctan scale and a mask.
    run(d, &["figure", "s.zarr", "image_mueller", "--format", "svg", "-o", "grid"]);
    let grid = std::fs::read_to_string(d.join("grid/image_mueller.svg")).unwrap();
    assert!(grid.contains("arctan scale") && grid.contains("below 2 standard errors"), "{grid}");
    let view = ["figure", "s.zarr", "--view", "mueller", "--slice", "image", "-o", "g.svg"];
    run(d, &view);
    let plain = std::fs::read_to_string(d.join("g.svg")).unwrap();
    assert!(!plain.contains("arctan") && !plain.contains("standard errors"));
    run(d, &[&view[..], &["--scale", "arctan", "--mask", "2"]].concat());
    assert!(std::fs::read_to_string(d.join("g.svg")).unwrap().contains("arctan scale"));
    let message = refused(d, &[&view[..], &["--mask", "0"]].concat());
    assert!(message.contains("`mask_sigmas` is 0; the value must be a positive number"), "{message}");

    // A slice without camera rows is named in a note.
    run(d, &["probe", "s.zarr", "xt", "--sum", "y,x,v,u", "-o", "sum.zarr"]);
    let message = refused(d, &["figure", "sum.zarr"]);
    assert!(
        message.contains("note: slice `xt") && message.contains("no slice has a default figure"),
        "{message}"
    );
}

#[test]
fn a_sharded_store_gives_the_same_output() {
    let dir = rendered();
    let d = dir.path();
    run(d, &["shard", "out/room.zarr", "-o", "shards.zarr"]);
    run(d, &["verify", "shards.zarr"]);
    assert!(run(d, &["info", "shards.zarr"]).contains("sharded"));
    let probe = |store: &str| run(d, &["probe", store, "xt", "-k", "x=3", "--csv", "-"]);
    assert_eq!(probe("shards.zarr"), probe("out/room.zarr"));
    let again = refused(d, &["shard", "shards.zarr", "-o", "twice.zarr"]);
    assert!(again.contains("already sharded"), "{again}");
    let onto = refused(d, &["shard", "out/room.zarr", "-o", "out/room.zarr"]);
    assert!(onto.contains("both an input"), "{onto}");
}

#[test]
fn bad_input_is_refused_with_a_fix() {
    let dir = rendered();
    refusals(
        dir.path(),
        &[
            ("probe out/room.zarr none", "none"),
            ("probe out/room.zarr image -k q=1", "axis"),
            ("probe out/room.zarr image --pulse gaussian:50", "time"),
            (
                "figure out/room.zarr nonesuch",
                "photo, grid; the default figures are: image_photo, image_mueller, xt_xt",
            ),
            ("figure out/room.zarr --view flight --slice image", "time"),
            (
                "figure out/room.zarr --view mueller --slice image --wavelength 600 -o x.png",
                "slice `image` has no wavelength 600 nm; use a wavelength of the slice: 450, 550, 660 nm",
            ),
            ("export out/room.zarr none -o x.exr", "none"),
            ("merge out/room.zarr out/room.zarr -o m.zarr", "seed"),
            ("render room/scene.toml --slices none -o n.zarr", "image, xt"),
            ("info room", "room"),
        ],
    );
}

#[test]
fn selected_slices_equal_those_of_a_full_render() {
    let dir = rendered();
    let d = dir.path();
    run(d, &["render", "room/scene.toml", "--slices", "image", "-o", "one.zarr"]);
    let one = TensorStore::open(&d.join("one.zarr")).unwrap();
    assert_eq!(one.slice_names(), ["image"]);
    let all = TensorStore::open(&d.join("out/room.zarr")).unwrap();
    let read = |s: &TensorStore| s.slice("image").unwrap().read_all(Field::Mean).unwrap().data;
    assert_eq!(read(&one), read(&all));
}

#[test]
fn a_closed_stdout_does_not_stop_the_render() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("scene.toml"), SCENE).unwrap();
    let mut command = harness::sunstone(dir.path(), &["render", "scene.toml", "-o", "room.zarr"]);
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
    for figure in ["photo", "grid"] {
        assert!(dir.path().join(format!("room.figures/{figure}.png")).exists(), "{figure}");
    }
}
