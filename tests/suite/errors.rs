//! Tests that each invalid input gives exit code 2, a message with location and fix, and no output.

use crate::harness::{Case, edit, fault, files, mirror_room, refusals, run, shipped, stderr};

/// A valid scene. Each test makes one item of the scene invalid.
const SCENE: &str = r#"name = "box"
wavelengths_nm = [450, 550, 660]

[render]
spp = 1
tile = 8
max_depth = 3

[camera]
resolution = [16, 16]
fov_x_deg = 50
pose.look_at = { origin = [0, 1, 3], target = [0, 1, 0] }

[projector]
resolution = [12, 8]
fov_x_deg = 40
irradiance = 10
pose.look_at = { origin = [0.2, 1, 3], target = [0, 1, 0] }

[materials]
white.diffuse.albedo = [0.7, 0.7, 0.7]
gold.rough_conductor = { n = 0.4, k = 2.4, alpha = 0.2 }
glass.dielectric = { ior = 1.5 }

[[objects]]
name = "wall"
shape.rectangle = { corner = [-1, 0, -1], u = [2, 0, 0], v = [0, 2, 0] }
material = "white"

[[objects]]
name = "ball"
shape.sphere = { center = [0, 1, 0], radius = 0.3 }
material = "gold"
transform = { translate = [0, 0, 0] }

[[slices]]
name = "photo"
camera = { binned = 2 }

[[slices]]
name = "rows"
camera = { rows = [3] }
projector = { epipolar = { half_width_px = 1 } }
time = { start_ps = 0, bin_ps = 100, bins = 10 }

[[figures]]
name = "picture"
view.photo = { slice = "photo" }
"#;

#[rustfmt::skip]
const CASES: &[Case] = &[
    ("syntax", "spp = 1", "spp = = 1", "spp = = 1", ""),
    ("an unclosed list", "[450, 550, 660]", "[450, 550, 660", "^[render]", "missing comma"),
    ("an unclosed string", "name = \"box\"", "name = \"box", "^\nwavelengths_nm", "string"),
    ("a key twice", "spp = 1", "spp = 1\nspp = 2", "^spp = 2", "duplicate key"),
    ("an unknown key at the top", "name = \"box\"", "nmae = \"box\"", "^nmae", "unknown key `nmae`"),
    ("an unknown table", "[render]", "[rendr]", "[rendr]", "unknown key `rendr`"),
    ("an unknown key in render", "spp = 1", "ssp = 1", "^ssp", "unknown key `ssp`"),
    ("an unknown key in the camera", "fov_x_deg = 50", "fov = 50", "^fov = 50", "unknown key `fov`"),
    ("an unknown key in the pose", "target = [0, 1, 0] }", "aim = [0, 1, 0] }", "^aim", "unknown key `aim`"),
    ("an unknown material", "white.diffuse.albedo", "white.lambert.albedo", "^lambert", "unknown name `lambert`"),
    ("an unknown key in a material", "alpha = 0.2", "roughness = 0.2", "^roughness", "unknown key `roughness`"),
    ("an unknown shape", "shape.sphere", "shape.ball", "^ball = {", "unknown name `ball`"),
    ("an unknown key in a shape", "radius = 0.3", "r = 0.3", "^r = 0.3", "unknown key `r`"),
    ("an unknown key in a slice", "projector = { epi", "projektor = { epi", "^projektor", "unknown key `projektor`"),
    ("an unknown key in time", "bin_ps = 100", "width_ps = 100", "^width_ps", "unknown key `width_ps`"),
    ("an unknown view", "view.photo", "view.foto", "^foto", "unknown name `foto`"),
    ("text for a number", "fov_x_deg = 50", "fov_x_deg = \"wide\"", "^\"wide\"", "found the text"),
    ("a negative count", "spp = 1", "spp = -1", "^-1\n", "-1"),
    ("a fraction for a count", "resolution = [16, 16]", "resolution = [16.5, 16]", "^16.5", "16.5"),
    ("two numbers for a point", "[0, 1, 3], target", "[0, 1], target", "^[0, 1], target", "length"),
    ("no camera", "[camera]", "[[emitters]]", "[[emitters]]", ""),
    ("no resolution", "resolution = [16, 16]\n", "", "[camera]", "missing key `resolution`"),
    ("no material", "material = \"gold\"\n", "", "^[[objects]]\nname = \"ball\"", "missing key `material`"),
    ("no alpha", ", alpha = 0.2", "", "^{ n = 0.4", "missing key `alpha`"),
    ("no pose of the projector", "[0.2, 1, 3], target = [0, 1, 0] }", "[0.2, 1, 3] }", "^{ origin = [0.2", "`target`"),
    ("an unknown name of a material", "material = \"gold\"", "material = \"silver\"", "^\"silver\"", "white"),
    ("a missing mesh", "shape.sphere = { center = [0, 1, 0], radius = 0.3 }", "shape.obj = { file = \"no.obj\" }", "^\"no.obj\"", "no.obj"),
    ("a mesh that is none", "shape.sphere = { center = [0, 1, 0], radius = 0.3 }", "shape.ply = { file = \"scene.toml\" }", "^\"scene.toml\"", "scene.toml"),
    ("too short a spectrum", "[0.7, 0.7, 0.7]", "[0.7, 0.7]", "^[0.7, 0.7]", "2 values for 3 wavelengths"),
    ("an albedo above 1", "[0.7, 0.7, 0.7]", "[0.7, 1.2, 0.7]", "^[0.7, 1.2, 0.7]", "albedo is 1.2"),
    ("an albedo that is no number", "[0.7, 0.7, 0.7]", "nan", "^nan", "NaN"),
    ("an alpha of 0", "alpha = 0.2", "alpha = 0", "^0 }", "alpha is 0"),
    ("an unknown distribution", "alpha = 0.2", "alpha = 0.2, distribution = \"phong\"", "^\"phong\"", "expected `ggx` or `beckmann`"),
    ("an unknown masking", "alpha = 0.2", "alpha = 0.2, masking = \"none\"", "^\"none\"", "expected `correlated` or `separable`"),
    ("a rough glass of index below 1", "dielectric = { ior = 1.5", "rough_dielectric = { alpha = 0.1, ior = 0.5", "^0.5", "ior is 0.5"),
    ("a specular factor above 1", "dielectric = { ior = 1.5", "plastic = { albedo = 0.5, alpha = 0.1, ior = 1.5, specular = 7", "^7 }", "specular is 7"),
    ("a plastic without albedo", "dielectric = { ior = 1.5", "plastic = { alpha = 0.1, ior = 1.5", "^{ alpha = 0.1", "missing key `albedo`"),
    ("an index below 1", "ior = 1.5", "ior = 0.5", "^0.5", "ior is 0.5"),
    ("a metal without k", "n = 0.4, k = 2.4,", "n = 0.4,", "gold.rough_conductor", "both n and k"),
    ("a blend of nothing", "glass.dielectric = { ior = 1.5 }", "glass.blend = { a = \"gold\", b = \"silver\", weight = 0.5 }", "^\"silver\"", "unknown material `silver`"),
    ("a material made of itself", "glass.dielectric = { ior = 1.5 }", "glass.two_sided = { front = \"glass\" }", "^\"glass\" }", "refers to itself"),
    ("materials in a circle", "glass.dielectric = { ior = 1.5 }", "a.two_sided = { front = \"b\" }\nb.two_sided = { front = \"a\" }", "^\"a\" }", "cycles"),
    ("a share above 1", "glass.dielectric = { ior = 1.5 }", "glass.blend = { a = \"gold\", b = \"white\", weight = 1.5 }", "^1.5", "weight is 1.5"),
    ("a missing normal map", "glass.dielectric = { ior = 1.5 }", "glass.normal_map = { material = \"gold\", image = \"no.png\" }", "^\"no.png\"", "no.png"),
    ("an albedo that is image and table", "[0.7, 0.7, 0.7]", "{ image = \"a.png\", nm = [450] }", "^{ image", "expected a texture"),
    ("an uneven table", "ior = 1.5", "ior = { nm = [400, 500], values = [1.5] }", "^{ nm", "has 2 entries in nm and 1 in values"),
    ("a field of view of 0", "fov_x_deg = 50", "fov_x_deg = 0", "^0\npose", "0°"),
    ("two focal lengths", "fov_x_deg = 50", "fov_x_deg = 50\nfx = 20", "[camera]", "exactly one"),
    ("a huge resolution", "resolution = [16, 16]", "resolution = [40000, 16]", "^[40000, 16]", "40000"),
    ("an unknown integrator", "spp = 1", "spp = 1\nintegrator = \"photon\"", "^\"photon\"", "one of `auto`, `path`, `caustics`, `bidirectional`"),
    ("a medium that is not there", "material = \"gold\"", "material = \"gold\"\ninterior = \"milk\"", "^\"milk\"", "unknown medium `milk`"),
    ("an aperture in focus nowhere", "fov_x_deg = 50", "fov_x_deg = 50\naperture = { radius = 0.01, focus = 0 }", "^{ radius = 0.01", "the focus distance in metres is 0"),
    ("a null material with keys", "glass.dielectric = { ior = 1.5 }", "glass.null = { ior = 1.5 }", "^ior", "unknown key `ior`"),
    ("spp of 0", "spp = 1", "spp = 0", "^0\ntile", "spp is 0"),
    ("no bounce", "max_depth = 3", "max_depth = 0", "^0\n\n[camera]", "max_depth is 0"),
    ("tiles that cut bins", "tile = 8", "tile = 7", "^7\n", "multiple of 2"),
    ("a view along up", "target = [0, 1, 0] }", "target = [0, 2, 3] }", "^pose.look_at = { origin = [0, 1, 3]", "look_at"),
    ("a pose that is not rigid", "pose.look_at = { origin = [0, 1, 3], target = [0, 1, 0] }", "pose.matrix = [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]", "pose.matrix", "rotation"),
    ("a folding lens", "fov_x_deg = 50", "fov_x_deg = 50\ndistortion = { k1 = -9 }", "^{ k1 = -9 }", "two directions to one pixel"),
    ("coincident centres", "origin = [0.2, 1, 3]", "origin = [0, 1, 3]", "[[slices]]\nname = \"rows\"", "the same centre"),
    ("a name of a slice that cannot be", "name = \"rows\"", "name = \"../rows\"", "^\"../rows\"", "../rows"),
    ("a reserved name of a slice", "name = \"rows\"", "name = \"samples\"", "^\"samples\"", "samples"),
    ("two slices of one name", "name = \"rows\"", "name = \"photo\"\n#", "^\"photo\"\n#", "duplicate slice name"),
    ("time bins of 0 ps", "bin_ps = 100", "bin_ps = 0", "^0, bins", "bin_ps is 0"),
    ("no time bins", "bins = 10", "bins = 0", "^0 }\n\n[[figures]]", "bins is 0"),
    ("a row out of range", "rows = [3]", "rows = [16]", "^{ rows = [16] }", "below 16"),
    ("rows out of order", "rows = [3]", "rows = [5, 3]", "^{ rows = [5, 3] }", "increasing"),
    ("a block out of range", "camera = { rows = [3] }", "camera = { block = [10, 10, 7, 6] }", "^{ block", "16 × 16"),
    ("bins larger than the image", "camera = { binned = 2 }", "camera = { binned = 17 }", "^{ binned = 17", "17 × 17"),
    ("a missing mask", "{ epipolar = { half_width_px = 1 } }", "{ mask = \"no.png\" }", "^{ mask", "no.png"),
    ("a coaxial slice of unlike images", "{ epipolar = { half_width_px = 1 } }", "\"coaxial\"", "^\"coaxial\"", "resolution"),
    ("a negative half width", "half_width_px = 1", "half_width_px = -1", "^{ epipolar", "half_width_px is -1"),
    ("an epipolar band along no axis", "half_width_px = 1 }", "half_width_px = 1, along = \"x\" }", "^\"x\"", "`x`"),
    ("endless time", "bins = 10 }", "bins = 1048577 }", "^1048577", "bins is 1048577"),
    ("a slice without end", "resolution = [12, 8]", "resolution = [32768, 32768]", "^{ epipolar", "4096"),
    ("a figure of an unknown slice", "slice = \"photo\"", "slice = \"foto\"", "[[figures]]", "photo, rows"),
    ("a figure of white that is none", "view.photo = { slice = \"photo\" }", "view.photo = { slice = \"photo\", white = nan }", "[[figures]]", "white"),
    ("a profile of a slice without time", "view.photo = { slice = \"photo\" }", "view.profile = { slice = \"photo\", pixel = [1, 1] }", "[[figures]]", "time"),
    ("a map of a wavelength that is none", "view.photo = { slice = \"photo\" }", "view.space_time = { slice = \"rows\", wavelength_nm = 900 }", "[[figures]]", "`rows` has no wavelength 900 nm"),
    ("a grid of a wavelength between others", "view.photo = { slice = \"photo\" }", "view.mueller = { slice = \"photo\", wavelength_nm = 600 }", "[[figures]]", "450, 550, 660 nm"),
    ("a negative radius", "radius = 0.3", "radius = -0.3", "shape.sphere", "-0.3"),
    ("a depth that shows nothing", "max_depth = 3", "max_depth = 1", "max_depth = 1", "max_depth"),
    ("two objects of one name", "name = \"ball\"", "name = \"wall\"", "[[objects]]\nname = \"wall\"\nshape.sphere", "duplicate object name"),
    ("a figure with a path for a name", "name = \"picture\"", "name = \"../picture\"", "[[figures]]", "../picture"),
    ("wavelengths out of order", "[450, 550, 660]", "[450, 660, 550]", "^[450, 660, 550]", "increasing"),
    ("no wavelengths", "[450, 550, 660]", "[]", "^[]", "1 to 4 wavelengths, got 0"),
    ("five wavelengths", "[450, 550, 660]", "[1e3, 2e3, 3e3, 4e3, 5e3]", "^[1e3", "1 to 4 wavelengths, got 5"),
    ("a wavelength in metres", "[450, 550, 660]", "[4.5e-7]", "^[4.5e-7]", "100 to 100000 nm"),
    ("a shape without size", "radius = 0.3", "radius = 0", "^shape.sphere", "zero size"),
    ("a shape without end", "radius = 0.3", "radius = 1e300", "^shape.sphere", "too large"),
    ("a flattening transform", "u = [2, 0, 0]", "u = [0, 2, 0]", "^shape.rectangle", "zero extent"),
];

#[test]
fn errors_of_broken_scenes_have_position_and_fix() {
    let folder = tempfile::tempdir().expect("a folder");
    let faults: Vec<String> = CASES
        .iter()
        .filter_map(|case| fault(folder.path(), "scene.toml", SCENE, case, &["render", "scene.toml"]))
        .collect();
    assert!(faults.is_empty(), "{} of {}:\n{}", faults.len(), CASES.len(), faults.join("\n"));
    assert!(CASES.len() >= 60);
}

#[test]
fn the_unmodified_scene_is_valid() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("box.toml"), SCENE).expect("a scene");
    run(folder.path(), &["render", "box.toml"], 0);
    assert!(folder.path().join("out/box.zarr/zarr.json").exists());
}

#[test]
fn a_scene_needs_a_light() {
    let folder = tempfile::tempdir().expect("a folder");
    let (before, rest) = SCENE.split_once("[projector]").expect("a projector");
    let text = format!("{before}{}", &rest[rest.find("[materials]").expect("materials")..]);
    let text = edit(&text, "projector = { epipolar = { half_width_px = 1 } }\n", "");
    std::fs::write(folder.path().join("dark.toml"), &text).expect("a scene");
    let shown = stderr(&run(folder.path(), &["render", "dark.toml"], 2));
    assert!(shown.starts_with("error: dark.toml:9:") && shown.contains("no light"), "{shown}");
}

/// Returns a folder with the valid scene `s.toml`.
fn folder_with_a_scene() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = mirror_room(8, 8, 1, 8, "[[slices]]\nname = \"a\"\n");
    std::fs::write(folder.path().join("s.toml"), scene).expect("a scene");
    folder
}

#[test]
fn outputs_are_not_overwritten_by_mistake() {
    let folder = folder_with_a_scene();
    let at = folder.path();
    let first =
        |arguments: &[&str], code| stderr(&run(at, arguments, code)).lines().next().unwrap_or("").to_owned();
    run(at, &["render", "s.toml", "-o", "a.zarr"], 0);
    let before = files(&at.join("a.zarr"));
    let message = first(&["render", "s.toml", "-o", "a.zarr", "--seed", "9"], 2);
    assert!(message.starts_with("error: ") && message.contains("a.zarr"), "{message}");
    assert!(files(&at.join("a.zarr")) == before, "the store is as it was");
    run(at, &["render", "s.toml", "-o", "a.zarr", "--seed", "9", "--force"], 0);
    assert!(files(&at.join("a.zarr")) != before);

    // The program never replaces a folder that is not a store, and does not accept a file as a folder.
    std::fs::create_dir(at.join("photos")).expect("a folder");
    std::fs::write(at.join("photos/cat.jpg"), "cat").expect("a file");
    first(&["render", "s.toml", "-o", "photos", "--force"], 2);
    assert_eq!(std::fs::read(at.join("photos/cat.jpg")).expect("the cat"), b"cat");
    assert!(first(&["render", "s.toml", "-o", "s.toml/out.zarr"], 2).contains("s.toml/out.zarr"));
}

#[test]
fn bad_arguments_are_refused_before_anything_is_written() {
    let folder = folder_with_a_scene();
    let at = folder.path();
    std::fs::write(at.join("none.toml"), mirror_room(8, 8, 1, 8, "")).expect("a scene");
    std::fs::write(at.join("bytes.toml"), [0xff, 0xfe, 0x00]).expect("a scene");
    refusals(
        at,
        &[
            ("render missing.toml", "missing.toml"),
            ("render .", "."),
            ("render bytes.toml", "bytes.toml"),
            ("render none.toml", "slices"),
            ("render s.toml --spp 0", "--spp"),
            ("render s.toml --spp -3", "-3"),
            ("render s.toml --spp many", "many"),
            ("render s.toml --threads 0", "--threads"),
            ("render s.toml --slices b", "`b`"),
            ("render s.toml --resume --force", "--force"),
            ("render", "SCENE"),
            ("rendr s.toml", "render"),
            ("info missing.zarr", "missing.zarr"),
            ("info bytes.toml", "bytes.toml"),
            ("figure missing.zarr", "missing.zarr"),
            ("ptu info .", "."),
            ("ptu records missing.ptu", "missing.ptu"),
        ],
    );
    assert_eq!(std::fs::read_dir(at).expect("a folder").count(), 3);
}

#[test]
fn the_schema_is_json_and_lists_all_keys() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = run(folder.path(), &["schema"], 0);
    let schema: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    let mut known: Vec<&String> = schema["properties"].as_object().expect("properties").keys().collect();
    known.sort();
    let scene: toml::Table = shipped().parse().expect("TOML");
    for key in scene.keys() {
        assert!(known.contains(&key), "the schema lacks `{key}`");
    }
    // serde lists all accepted keys if it finds an unknown key.
    std::fs::write(folder.path().join("s.toml"), edit(SCENE, "name = \"box\"", "zzz = 1")).expect("a scene");
    let shown = stderr(&run(folder.path(), &["render", "s.toml"], 2));
    let expected = shown.split("expected one of").nth(1).expect("a list").lines().next().expect("a line");
    let mut accepted: Vec<String> = expected.split('`').skip(1).step_by(2).map(str::to_owned).collect();
    accepted.sort();
    assert!(accepted.len() >= 10);
    assert_eq!(known.into_iter().cloned().collect::<Vec<_>>(), accepted);
    assert_eq!(schema["additionalProperties"], false);
    assert_eq!(schema["required"], serde_json::json!(["camera"]));
}
