//! Tests figure files. Faults are reported with their location, equal figure files give byte-identical
//! images, and existing renders are used again.

use crate::harness::{edit, fault, files, run, stderr, sunstone};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use sunstone::figure_file::{FigureFileError, Settings, Source, prepare};
use sunstone::render::{Summary, Unwatched, Watch};
use sunstone::studio::StudioError;

const SCENE: &str = r#"name = "ball"
camera = { resolution = [32, 32], fov_x_deg = 40, pose.look_at = { origin = [0, 0, 3], target = [0, 0, 0], up = [0, 1, 0] } }
projector = { resolution = [32, 32], fov_x_deg = 40, irradiance = [1, 1, 1], pose.look_at = { origin = [1, 0, 3], target = [0, 0, 0], up = [0, 1, 0] } }
materials.gold.rough_conductor = { metal = "Au", alpha = 0.2 }
objects = [{ name = "ball", shape.sphere = { center = [0, 0, 0], radius = 0.8 }, material = "gold" }]
slices = [{ name = "photo" }, { name = "mueller", polarization = "mueller" }, { name = "row", camera = { rows = [16] }, time = { start_ps = 15000, bin_ps = 100, bins = 80 } }]
"#;

const FIGURE: &str = r#"title = "a ball"
width = "single"
columns = 3
[scenes.ball]
file = "SCENE"
preview = { pixels = 16, spp = 4 }
full = { pixels = 32, spp = 8 }
[[panels]]
scene = "ball"
view.photo = { slice = "photo" }
caption = "Photo of {pixels} pixels"
insets = [{ crop = [0.25, 0.25, 0.25, 0.25], magnify = 2 }]
arrows = [{ from = [0, 0], to = [0.5, 0.5], colour = "sky" }]
circles = [{ at = [0.5, 0.5], radius = 0.25 }]
scale_bar = { length_mm = 500 }
[[panels]]
scene = "ball"
view.element = { slice = "mueller", element = "-(3,3)" }
[[panels]]
scene = "ball"
view.space_time = { slice = "row" }
aspect = 0.8
[[panels]]
scene = "ball"
view.layer = { layer = "depth" }
[[panels]]
scene = "ball"
view.decomposition = { slice = "mueller", quantity = "retardance" }
caption = "{{retardance}}"
"#;

/// Returns a folder with a scene, and the text of a figure that shows the scene.
fn sound() -> (tempfile::TempDir, String) {
    let scenes = tempfile::tempdir().expect("a folder");
    let path = scenes.path().join("scene.toml");
    std::fs::write(&path, SCENE).expect("a scene");
    let text = edit(FIGURE, "SCENE", path.to_str().expect("UTF-8"));
    (scenes, text)
}

#[test]
fn errors_name_their_position() {
    let (_scenes, text) = sound();
    #[rustfmt::skip]
    let cases = [
        ("no such view", "view.photo", "view.foto", "foto", "photo"),
        ("no such slice", "photo = { slice = \"photo\"", "photo = { slice = \"foto\"", "foto", "use one of: photo, mueller, row"),
        ("a slice without matrices", "element = { slice = \"mueller\"", "element = { slice = \"photo\"", "element = {", "polarization = \"mueller\""),
        ("a slice without time", "space_time = { slice = \"row\"", "space_time = { slice = \"photo\"", "space_time = {", "travel time"),
        ("no such element", "-(3,3)", "-(3,4)", "-(3,4)", "not an element"),
        ("no such wavelength", "element = \"-(3,3)\"", "element = \"-(3,3)\", wavelength_nm = 2000", "element = {", "`mueller` has no wavelength 2000 nm"),
        ("no such wavelength to decompose", "\"retardance\"", "\"retardance\", wavelength_nm = 2000", "decomposition = {", "`mueller` has no wavelength 2000 nm"),
        ("no such scene", "scene = \"ball\"\nview.photo", "scene = \"bell\"\nview.photo", "\"bell\"", "ball"),
        ("no such file", "scene.toml", "nothing.toml", "nothing.toml", "does not exist"),
        ("no such value", "{pixels}", "{pixel}", "caption = \"Photo", "pixels"),
        ("an open brace", "{pixels}", "{pixels", "caption = \"Photo", "{ without }"),
        ("no such colour", "\"sky\"", "\"mud\"", "arrows", "orange"),
        ("an arrow to nowhere", "to = [0.5, 0.5]", "to = [0, 0]", "arrows", "the arrow has no length"),
        ("a circle outside", "at = [0.5, 0.5]", "at = [0.5, 1.5]", "circles", "the centre of the circle is outside"),
        ("a circle without size", "radius = 0.25", "radius = 0", "circles", "the radius of the circle is 0"),
        ("a time of a slice without time", "view.element = { slice = \"mueller\", element = \"-(3,3)\"", "view.mueller = { slice = \"mueller\", time_ps = 15000", "mueller = {", "travel time"),
        ("a crop outside", "[0.25, 0.25, 0.25, 0.25]", "[0.9, 0.25, 0.25, 0.25]", "insets", "within the image"),
        ("an inset too large", "magnify = 2", "magnify = 9", "insets", "fit into the image"),
        ("no such layer", "layer = \"depth\"", "layer = \"deep\"", "deep", "depth"),
        ("a quantity that is none", "\"retardance\"", "\"retard\"", "retard", "retardance"),
        ("a width that is none", "\"single\"", "\"narrow\"", "\"narrow\"", "84 mm"),
        ("no columns", "columns = 3", "columns = 0", "columns = 0", "1 to 16"),
        ("no samples", "spp = 4", "spp = 0", "spp = 0", "1 to"),
        ("a scale bar too long", "length_mm = 500", "length_mm = 5e9", "scale_bar", "shorter"),
        ("a scale bar too short", "length_mm = 500", "length_mm = 1e-300", "scale_bar", "longer"),
        ("more headings than columns", "columns = 3", "columns = 3\ncolumn_headings = [\"a\", \"b\", \"c\", \"d\"]", "3\ncolumn_headings", "at most one"),
        ("light of one sign on a signed scale", "element = \"-(3,3)\"", "element = \"-(3,3)\", scale = \"arctan\"", "element = {", "no signed scale"),
        ("a map of M00 on a signed scale", "slice = \"row\"", "slice = \"row\", scale = \"arctan\"", "space_time = {", "no signed scale"),
        ("light that is not light", "view.element = { slice = \"mueller\", element = \"-(3,3)\"", "view.polarization = { slice = \"mueller\", quantity = \"dolp\", stokes = [1, 1, 1, 0]", "polarization = {", "unpolarized light"),
        ("polarization of an intensity", "view.element = { slice = \"mueller\", element = \"-(3,3)\"", "view.poincare = { slice = \"photo\"", "poincare = {", "polarization = \"mueller\""),
        ("a panel's crop outside", "scale_bar = { length_mm = 500 }", "crop = [0, 0.5, 1, 0.6]", "[0, 0.5, 1, 0.6]", "within the image"),
        ("a crop of a map", "aspect = 0.8", "crop = [0, 0, 0.5, 0.5]", "[0, 0, 0.5, 0.5]", "cannot be cropped"),
        ("an animation of many panels", "columns = 3", "animation = true\ncolumns = 3", "columns = 3", "one panel"),
        ("no such application", "view.layer = { layer = \"depth\" }", "view.apply = { name = \"alchemy\", picture = \"gold\", method = \"x\" }", "view.apply", "metamerism"),
    ];
    let mut found = vec![];
    for case in &cases {
        let mut text = text.clone();
        if case.0 == "no such application" {
            text = edit(&text, "scene = \"ball\"\nview.layer", "view.layer");
        }
        let folder = tempfile::tempdir().expect("a folder");
        let arguments = ["figure", "f.toml", "--preview", "-o", "out.png"];
        // The command checks depths and caption values after rendering, so renders may remain after a fault.
        let elsewhere = tempfile::tempdir().expect("a folder");
        let renders = elsewhere.path().join("renders");
        let renders = ["--renders", renders.to_str().expect("UTF-8")];
        let all = [&arguments[..], &renders[..]].concat();
        found.extend(fault(folder.path(), "f.toml", &text, case, &all));
    }
    assert!(found.is_empty(), "{} faults:\n{}", found.len(), found.join("\n"));
}

/// Tests that the command reports unknown methods and variants of an application, and scales without limits, before
/// any render.
#[test]
fn applications_are_checked_before_they_are_run() {
    let scenes = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenes");
    let figure = "columns = 1\n[[panels]]\nview.apply = { name = \"metamerism\", picture = \"score\", variant = 8, method = \"RGB\" }\n";
    let scenes = ["--scenes", scenes.to_str().expect("UTF-8")];
    for (from, to, expected) in [
        ("\"RGB\"", "\"CMYK\"", "epipolar RGB"),
        ("variant = 8", "variant = 3", "use one of: 8, 9"),
        ("variant = 8", "variant = 8, scale = \"log\"", "both above 0"),
        ("variant = 8", "variant = 8, scale = \"log\", limits = [0, 1]", "both above 0"),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let arguments = [&["figure", "f.toml", "--preview", "-o", "out.png"], &scenes[..]].concat();
        let case = (expected, from, to, "view.apply", expected);
        assert_eq!(fault(folder.path(), "f.toml", figure, &case, &arguments), None);
    }
}

/// Tests that the command reports faults of curves before any render.
#[test]
fn curves_are_checked_before_they_are_run() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let scenes = root.join("scenes");
    let chain = root.join("rigs/chains/sweep.toml");
    let figure = format!(
        "columns = 1\n[[panels]]\nview.curves = {{ name = \"metamerism\", chain = \"{}\", sweep = \"photons=10,100\", methods = [\"RGB\"], \
         metric = \"area under the curve\", limits = [0, 1] }}\n",
        chain.display()
    );
    let scenes = ["--scenes", scenes.to_str().expect("UTF-8")];
    for (from, to, expected) in [
        ("\"metamerism\"", "\"alchemy\"", "use one of: analysis"),
        ("\"metamerism\"", "\"ellipsometry\"", "captures its own input"),
        ("[\"RGB\"]", "[\"CMYK\"]", "use some of: -(2,2) epipolar"),
        ("\"area under the curve\"", "\"area\"", "use one of: area under the curve"),
        ("[0, 1]", "[1, 0]", "is not a valid range"),
        ("sweep.toml", "swept.toml", "cannot read the chain"),
        ("photons=10,100", "photos", "photons, extinction"),
        ("photons=10,100", "photons=-1", "is not a valid value of"),
        ("sweep = \"photons=10,100\"", "captures = \"0-3\"", "within 1-64"),
        ("sweep = \"photons=10,100\"", "captures = \"1-3\", difference = true", "remove `difference`"),
        ("sweep = \"photons=10,100\", ", "", "exactly one of `sweep` and `captures`"),
        (
            "sweep = \"photons=10,100\"",
            "sweep = \"photons\", captures = \"1-3\"",
            "exactly one of `sweep` and `captures`",
        ),
        ("limits = [0, 1]", "belief = \"exact\"", "use one of: nominal"),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let arguments = [&["figure", "f.toml", "--preview", "-o", "out.png"], &scenes[..]].concat();
        let case = (expected, from, to, "view.curves", expected);
        assert_eq!(fault(folder.path(), "f.toml", &figure, &case, &arguments), None);
    }
}

#[test]
fn the_same_files_give_the_same_bytes_and_one_render() {
    let (scenes, text) = sound();
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("f.toml"), &text).expect("a figure");
    let make = |out: &str, renders: &str| {
        let out = run(folder.path(), &["figure", "f.toml", "--preview", "-o", out, "--renders", renders], 0);
        String::from_utf8_lossy(&out.stdout).into_owned()
    };
    assert!(make("a.png", "r").contains("(1 new renders)"));
    assert!(make("b.png", "r").contains("(0 new renders)"));
    assert!(make("c.png", "other").contains("(1 new renders)"));
    let read = |name: &str| std::fs::read(folder.path().join(name)).expect("a picture");
    assert_eq!(read("a.png"), read("b.png"));
    assert_eq!(read("a.png"), read("c.png"));
    for format in ["svg", "pdf"] {
        make(&format!("a.{format}"), "r");
        make(&format!("b.{format}"), "r");
        assert_eq!(read(&format!("a.{format}")), read(&format!("b.{format}")), "{format}");
    }
    // The command renders a changed scene again, and the figure differs.
    let scene = scenes.path().join("scene.toml");
    std::fs::write(&scene, edit(SCENE, "radius = 0.8", "radius = 0.7")).expect("a scene");
    assert!(make("d.png", "r").contains("(1 new renders)"));
    assert_ne!(read("a.png"), read("d.png"));
    // Draws all figures of a folder in full size.
    run(folder.path(), &["figure", "--all", ".", "--renders", "r", "-o", "all"], 0);
    assert!(read("all/f.png").len() > 1000);
}

/// Tests that the caption of a black image reports that no value is positive, instead of a white value.
#[test]
fn captions_state_that_no_value_is_positive() {
    let (_scenes, text) = sound();
    let folder = tempfile::tempdir().expect("a folder");
    let draw = |element: &str| {
        let named = format!("element = \"{element}\" }}\ncaption = \"White {{white:.3}}\"");
        let text = edit(&text, "element = \"-(3,3)\" }", &named);
        std::fs::write(folder.path().join("f.toml"), text).expect("a figure");
        run(folder.path(), &["figure", "f.toml", "--preview", "--renders", "r", "-o", "f.svg"], 0);
        std::fs::read_to_string(folder.path().join("f.svg")).expect("a picture")
    };
    // The SVG breaks lines between words.
    let states_it = |svg: &str| svg.contains("White –") && svg.contains("values)");
    assert!(states_it(&draw("-(0,0)")));
    assert!(!states_it(&draw("(0,0)")));
}

#[test]
fn inputs_are_not_overwritten() {
    let (scenes, text) = sound();
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("f.svg"), "kept").expect("a file");
    let text = edit(&text, "title = \"a ball\"\n", "");
    std::fs::write(folder.path().join("f.toml"), &text).expect("a figure");
    let scene = scenes.path().join("scene.toml");
    for out in ["f.toml", scene.to_str().expect("UTF-8"), "out.txt", "."] {
        let before = files(folder.path());
        let printed = stderr(&run(folder.path(), &["figure", "f.toml", "--preview", "-o", out], 2));
        assert!(printed.starts_with("error: "), "{out}: {printed}");
        assert_eq!(files(folder.path()), before, "{out}");
    }
    assert_eq!(std::fs::read_to_string(&scene).expect("the scene"), SCENE);
    // The command refuses options for figure files if the input is a store, and vice versa.
    run(folder.path(), &["figure", "store.zarr", "--preview"], 2);
    run(folder.path(), &["figure", "f.toml", "--view", "photo", "--slice", "photo"], 2);
    let out = sunstone(folder.path(), &["figure"]).output().expect("runs");
    assert_eq!(out.status.code(), Some(2));
}

/// Returns a folder with a figure file `f.toml` whose scene is denoised, and the folder of the scene.
fn denoised() -> (tempfile::TempDir, tempfile::TempDir) {
    let (scenes, text) = sound();
    let folder = tempfile::tempdir().expect("a folder");
    let text = edit(
        &text,
        "preview = { pixels = 16, spp = 4 }",
        "denoise = true\npreview = { pixels = 16, spp = 8 }",
    );
    std::fs::write(folder.path().join("f.toml"), text).expect("a figure");
    (scenes, folder)
}

/// Returns the stores of a folder of renders: the denoised store last.
fn stores(renders: &Path) -> Vec<std::path::PathBuf> {
    let mut all: Vec<_> = std::fs::read_dir(renders).expect("renders").flatten().map(|e| e.path()).collect();
    all.sort_by_key(|path| (path.display().to_string().contains("denoised"), path.clone()));
    all
}

/// Tests that a denoised figure shows the store that `sunstone denoise` writes from two renders with half of
/// the samples each, that the figure is marked, and that another run reuses all stores.
#[test]
fn scenes_are_denoised_from_two_renders() {
    let (_scenes, folder) = denoised();
    let at = folder.path();
    let draw = |out: &str| {
        let out = run(at, &["figure", "f.toml", "--preview", "--renders", "r", "-o", out], 0);
        String::from_utf8_lossy(&out.stdout).into_owned()
    };
    assert!(draw("a.svg").contains("(2 new renders)"));
    assert!(draw("b.svg").contains("(0 new renders)"));
    let read = |name: &str| std::fs::read(at.join(name)).expect("a picture");
    assert!(read("a.svg") == read("b.svg"));
    let svg = String::from_utf8_lossy(&read("a.svg")).into_owned();
    // Panel (d) shows a layer of ground truth.
    assert!(svg.contains("Denoised: (a)–(c), (e)."), "{svg}");
    let all = stores(&at.join("r"));
    let [first, second, made] = &all[..] else { panic!("{all:?}") };
    assert!(first.display().to_string().contains("seed1_16x16_4spp"), "{all:?}");
    assert!(second.display().to_string().contains("seed2_16x16_4spp"), "{all:?}");
    let name = |path: &Path| path.file_name().expect("a name").to_str().expect("UTF-8").to_owned();
    let [a, b] = [first, second].map(|p| format!("r/{}", name(p)));
    run(at, &["denoise", &a, &b, "-o", "by_hand.zarr"], 0);
    crate::harness::assert_same_store(made, &at.join("by_hand.zarr"));
    // A figure of the same scene without denoising has no note.
    let text = edit(&std::fs::read_to_string(at.join("f.toml")).expect("a figure"), "denoise = true\n", "");
    std::fs::write(at.join("f.toml"), text).expect("a figure");
    draw("c.svg");
    assert!(!String::from_utf8_lossy(&read("c.svg")).contains("Denoised"));
}

/// Tests that a run that was killed while it rendered or denoised resumes, and that the figure then equals that
/// of an undisturbed run.
#[test]
fn killed_figures_resume() {
    let (_scenes, folder) = denoised();
    let at = folder.path();
    let text = std::fs::read_to_string(at.join("f.toml")).expect("a figure");
    std::fs::write(at.join("f.toml"), edit(&text, "pixels = 16, spp = 8", "pixels = 96, spp = 32"))
        .expect("a figure");
    let draw = |renders, out| ["figure", "f.toml", "--preview", "--renders", renders, "-o", out];
    let begun = std::time::Instant::now();
    run(at, &draw("whole", "whole.svg"), 0);
    let took = begun.elapsed();
    let mut stopped = 0;
    for share in [0.2, 0.4, 0.6, 0.75, 0.9] {
        let mut child = sunstone(at, &draw("cut", "cut.svg"))
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .expect("the program");
        std::thread::sleep(took.mul_f64(share));
        stopped += u32::from(child.try_wait().expect("a state").is_none());
        // The process may have ended already.
        let _ = child.kill();
        child.wait().expect("its end");
    }
    assert!(stopped > 0, "no run was killed within {took:?}");
    run(at, &draw("cut", "cut.svg"), 0);
    let read = |name: &str| std::fs::read(at.join(name)).expect("a picture");
    assert!(read("cut.svg") == read("whole.svg"));
}

/// Tests that a file with a fault and a file whose render fails do not stop the other files, and that the end
/// of the run lists the failures.
#[test]
fn other_figures_are_drawn_if_one_fails() {
    let (_scenes, text) = sound();
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::create_dir(at.join("figures")).expect("a folder");
    let write =
        |name: &str, text: &str| std::fs::write(at.join("figures").join(name), text).expect("a figure");
    write("a_bad.toml", &edit(&text, "slice = \"photo\"", "slice = \"foto\""));
    write("b_bad.toml", &edit(&text, "{pixels}", "{pixel}"));
    write("c_good.toml", &text);
    let all = ["figure", "--all", "figures", "--preview", "--renders", "r", "-o", "out"];
    let printed = stderr(&run(at, &all, 2));
    assert!(printed.contains("2 of 3 figures failed: figures/a_bad.toml, figures/b_bad.toml;"), "{printed}");
    assert!(printed.contains("no slice `foto`") && printed.contains("a value `pixel`"), "{printed}");
    let table = |name: &str| printed.lines().any(|l| l.ends_with(name));
    assert!(
        table("wall s  processor s") && table("figures/c_good.toml") && table("all figures"),
        "{printed}"
    );
    let mut drawn: Vec<_> = std::fs::read_dir(at.join("out")).expect("a folder").flatten().collect();
    assert_eq!(drawn.pop().map(|e| e.file_name()), Some("c_good.png".into()));
    assert!(drawn.is_empty());
}

/// Tests that a figure file of light in flight gives an animation, and only an animation.
#[test]
fn light_in_flight_is_animated() {
    let (scenes, _) = sound();
    let scene = scenes.path().join("scene.toml");
    let slices =
        "{ name = \"flight\", time = { start_ps = 15000, bin_ps = 500, bins = 20 } }, { name = \"photo\" }";
    std::fs::write(&scene, edit(SCENE, "{ name = \"photo\" }", slices)).expect("a scene");
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let text = format!(
        "width = \"30 mm\"\ncolumns = 1\nletters = false\nanimation = true\n[scenes.ball]\nfile = \"{}\"\n\
         preview = {{ pixels = 16, spp = 4 }}\nfull = {{ pixels = 16, spp = 4 }}\n[[panels]]\nscene = \"ball\"\n\
         view.flight = {{ slice = \"flight\", frames = 4 }}\n",
        scene.display()
    );
    std::fs::write(at.join("f.toml"), text).expect("a figure");
    run(at, &["figure", "--all", ".", "--renders", "r", "-o", "out"], 0);
    run(at, &["figure", "f.toml", "--renders", "r", "-o", "b.apng"], 0);
    let bytes = std::fs::read(at.join("out/f.apng")).expect("an animation");
    assert!(bytes == std::fs::read(at.join("b.apng")).expect("an animation"));
    let frames = bytes.windows(4).filter(|w| *w == b"fcTL").count();
    assert!((2..=4).contains(&frames), "{frames} frames");
    let printed = stderr(&run(at, &["figure", "f.toml", "--renders", "r", "-o", "b.png"], 2));
    assert!(printed.contains(".apng"), "{printed}");
}

/// An observer that stops a render after a given number of tiles.
struct Impatient(AtomicUsize);

impl Watch for Impatient {
    fn tile_done(&self, _: &Summary) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= 1
    }
}

#[test]
fn an_interrupted_render_resumes() {
    let (_scenes, text) = sound();
    let folder = tempfile::tempdir().expect("a folder");
    // The image has more than one tile.
    let text = edit(&text, "pixels = 16, spp = 4", "pixels = 128, spp = 4");
    let source = Source::of_text(&folder.path().join("f.toml"), &text).expect("a figure");
    let settings = |renders: &str| Settings {
        renders: folder.path().join(renders),
        scenes: None,
        preview: true,
        program: None,
    };
    let (cut, whole) = (settings("cut"), settings("whole"));
    let impatient = Impatient(AtomicUsize::new(0));
    let stopped = prepare(&source, &cut, &impatient).expect("sound").draw();
    assert!(matches!(stopped, Err(FigureFileError::Studio(StudioError::Interrupted))), "{stopped:?}");
    let draw = |settings: &Settings| {
        let made = prepare(&source, settings, &Unwatched).expect("sound").draw();
        made.expect("a figure")
    };
    let (resumed, straight) = (draw(&cut), draw(&whole));
    assert_eq!((resumed.rendered, straight.rendered), (1, 1));
    assert_eq!(resumed.pages, straight.pages);
    assert_eq!(draw(&cut).rendered, 0);
}

/// Tests that processes with a common folder of renders give equal results, while another process checks
/// whether renders are finished. Tests that the program reports a path that has the name of a render but is
/// not a render, with a fix.
#[test]
#[ignore = "slow: tools/check --all"]
fn renders_are_shared_and_damage_is_reported() {
    let (_scenes, text) = sound();
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("figure.toml"), &text).expect("a figure file");
    let fixed = ["figure", "figure.toml", "--preview", "--renders", "r", "-o"];
    for _ in 0..2 {
        let outputs = ["a.svg", "b.svg", "c.svg"];
        let running = outputs.map(|out| {
            let mut command = sunstone(at, &[&fixed[..], &[out]].concat());
            command.spawn().expect("the program")
        });
        for mut child in running {
            assert!(child.wait().expect("an end").success());
        }
        let [a, b, c] = outputs.map(|out| std::fs::read(at.join(out)).expect("a picture"));
        assert!(a == b && a == c);
    }
    let render = std::fs::read_dir(at.join("r")).expect("renders").next();
    let render = render.expect("one").expect("an entry").path();
    let message = |what: &str| {
        let printed = stderr(&run(at, &[&fixed[..], &["d.svg"]].concat(), 2));
        let name = render.file_name().expect("a name").to_str().expect("UTF-8");
        assert!(printed.contains("or delete") && printed.contains(name), "{what}: {printed}");
        assert!(!at.join("d.svg").exists(), "{what}");
    };
    std::fs::write(render.join("zarr.json"), "{").expect("damage");
    message("cut short");
    std::fs::remove_file(render.join("zarr.json")).expect("damage");
    message("lost");
    std::fs::remove_dir_all(&render).expect("damage");
    std::fs::create_dir(&render).expect("a folder");
    message("an empty folder");
    std::fs::remove_dir(&render).expect("damage");
    std::fs::write(&render, "x").expect("a file");
    message("a file");
    std::fs::remove_file(&render).expect("removes");
    run(at, &[&fixed[..], &["d.svg"]].concat(), 0);
    assert!(
        std::fs::read(at.join("d.svg")).expect("a picture")
            == std::fs::read(at.join("a.svg")).expect("a picture")
    );
}
