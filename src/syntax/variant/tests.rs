//! Tests of the values of variants, and of the locations of errors.

use super::*;

const SCENE: &str = r#"
camera = { resolution = [4, 4], fov_x_deg = 30 }
[materials]
wall.diffuse.albedo = 0.5
glass.dielectric = { ior = 1.5 }
[media.milk.milk]
concentration = 0.001
[[objects]]
name = "the doll"
shape.sphere = { center = [0, 0, 0], radius = 1 }
material = "wall"
transform = { translate = [1, 2, 3] }
[[objects]]
shape.sphere = { center = [9, 0, 0], radius = 1 }
material = "glass"
"#;

fn with(vary: &str) -> String {
    format!("{SCENE}{vary}\n")
}

fn read(vary: &str, number: u64) -> Result<Variant, InputError> {
    super::read(Path::new("scene.toml"), &with(vary), number)
}

/// Returns the part of the file to which an error message refers.
fn place(e: &InputError) -> &str {
    e.span.clone().and_then(|s| e.text.get(s)).unwrap_or("")
}

fn translate(file: &SceneFile, object: usize) -> [f64; 3] {
    let text = toml::Value::try_from(&*file.objects[object]).expect("a value");
    let list = text["transform"]["translate"].as_array().expect("a list");
    std::array::from_fn(|i| list[i].as_float().expect("a number"))
}

fn albedo(file: &SceneFile) -> toml::Value {
    let text = toml::Value::try_from(&*file.materials["wall"]).expect("a value");
    text["diffuse"]["albedo"].clone()
}

#[test]
fn values_are_set_at_their_paths() {
    let vary = r#"
[vary.shade]
path = "materials.wall.diffuse.albedo"
values = [0.1, [0.2, 0.3, 0.4]]
[vary.where]
path = 'objects."the doll".transform.translate'
values = [[4, 5, 6], [7, 8, 9]]
[vary.of]
path = "objects.1.material"
values = ["wall", "glass"]
"#;
    let first = read(vary, 0).expect("a variant");
    assert_eq!(translate(&first.file, 0), [4.0, 5.0, 6.0]);
    assert_eq!(albedo(&first.file), 0.1.into());
    assert_eq!(first.file.objects[1].material.as_str(), "wall");
    let second = read(vary, 1).expect("a variant");
    assert_eq!(translate(&second.file, 0), [7.0, 8.0, 9.0]);
    assert_eq!(albedo(&second.file), vec![0.2, 0.3, 0.4].into());
    assert_eq!(second.values["of"], "glass".into());
    // Values that are not varied are unchanged.
    assert_eq!(first.file.media, second.file.media);
    let e = read(vary, 2).expect_err("two variants");
    assert!(e.message.contains("has 2"), "{e}");
}

#[test]
fn list_entries_last_the_given_number_of_variants() {
    let vary = r#"
[vary.a]
path = "materials.wall.diffuse.albedo"
values = [0.1, 0.2]
[vary.b]
path = "materials.glass.dielectric.ior"
values = [1.1, 1.2, 1.3]
every = 2
"#;
    let got: Vec<_> = (0..6).map(|k| read(vary, k).expect("a variant").values).collect();
    let list = |name: &str| got.iter().map(|v| v[name].as_float().expect("a number")).collect::<Vec<_>>();
    assert_eq!(list("a"), [0.1, 0.2, 0.1, 0.2, 0.1, 0.2]);
    assert_eq!(list("b"), [1.1, 1.1, 1.2, 1.2, 1.3, 1.3]);
    assert!(read(vary, 6).is_err());
}

#[test]
fn draws_are_uniform_reproducible_and_independent() {
    let range = |more: &str| {
        format!(
            "{more}[vary.x]\npath = ['objects.\"the doll\".transform.translate.0', 'objects.1.shape.sphere.center.1']\n\
             range = {{ min = -1, max = 3 }}\n"
        )
    };
    let alone = range("");
    let beside = range("[vary.a]\npath = \"media.milk.milk.concentration\"\nrange = { min = 0, max = 1 }\n");
    let draws: Vec<f64> = (0..4000)
        .map(|k| read(&alone, k).expect("a variant").values["x"].as_float().expect("a number"))
        .collect();
    for k in [0, 7, 3999] {
        let other = read(&beside, k).expect("a variant");
        assert_eq!(
            other.values["x"].as_float(),
            Some(draws[k as usize]),
            "a parameter more changes no other"
        );
        let written = read(&alone, k).expect("a variant").file;
        assert_eq!(translate(&written, 0), [draws[k as usize], 2.0, 3.0]);
    }
    assert!(draws.iter().all(|x| (-1.0..=3.0).contains(x)));
    // Kolmogorov–Smirnov test: the probability of D √n > 2.8 is 2 exp(-2 · 2.8²) = 3e-7.
    let mut sorted = draws.clone();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len() as f64;
    let d = sorted.iter().enumerate().map(|(i, x)| ((x + 1.0) / 4.0 - (i as f64 + 0.5) / n).abs());
    assert!(d.fold(0.0, f64::max) * n.sqrt() < 2.8);
    // Regression test: the stream must not change.
    assert_eq!(draws[..3], PINNED);
}

/// The first three values drawn for the parameter `x`. An independent implementation in another language
/// gives the same values.
const PINNED: [f64; 3] = [1.9336119120850315, 2.5320505006663043, -0.620638408815303];

#[test]
fn errors_name_their_position() {
    let path = "path = \"materials.wall.diffuse.albedo\"";
    let listed = |values: &str| format!("[vary.p]\n{path}\nvalues = {values}");
    let ranged = |path: &str, range: &str| format!("[vary.p]\npath = \"{path}\"\nrange = {range}");
    let at = |path: &str| format!("[vary.p]\npath = '{path}'\nvalues = [1]");
    let cases: Vec<(String, &str, &str)> = vec![
        (at("materials.wal.diffuse.albedo"), "known keys: glass, wall", "'materials.wal.diffuse.albedo'"),
        (at("materials.wall.diffuse.albedo.0"), "which has no keys", "'materials.wall.diffuse.albedo.0'"),
        (at("objects.doll.material"), "known keys: the doll", "'objects.doll.material'"),
        (at("nothing"), "known keys: camera", "'nothing'"),
        (at("vary.p.path"), "affects the rendered scene", "'vary.p.path'"),
        (at("a = 1 #"), "separated by dots", "'a = 1 #'"),
        (at(""), "separated by dots", "''"),
        (listed("[]"), "at least one value", "[]"),
        (listed("[0.1, nan]"), "remove nan and inf", "[0.1, nan]"),
        (listed("[[0.1, inf]]"), "remove nan and inf", "[[0.1, inf]]"),
        // Errors for values of the wrong type, and for values that are too large, are located in `[vary]`.
        (listed("[\"white\"]"), "", "\"white\""),
        (listed("[1.5]"), "", ""),
        (
            ranged("materials.wall.diffuse.albedo", "{ min = 1, max = 0 }"),
            "min <= max",
            "{ min = 1, max = 0 }",
        ),
        (
            ranged("materials.wall.diffuse.albedo", "{ min = nan, max = 0 }"),
            "finite",
            "{ min = nan, max = 0 }",
        ),
        (
            ranged("materials.wall.diffuse.albedo", "{ min = [1], max = [2] }"),
            "the same shape",
            "{ min = [1], max = [2] }",
        ),
        (ranged("objects.0.material", "{ min = 1, max = 2 }"), "`values`", "{ min = 1, max = 2 }"),
        (ranged("objects.0.material", "{ min = \"a\", max = 2 }"), "`values`", "{ min = \"a\", max = 2 }"),
        (format!("[vary.p]\n{path}"), "values = [..]", ""),
        (format!("[vary.p]\n{path}\nvalues = [1]\nevery = 0"), "at least 1", "0"),
        (format!("[vary.p]\n{path}\nvalues = [1]\nmost = 0"), "listed names", "most"),
        ("[vary.p]\npath = []\nvalues = [1]".into(), "path of the value", "[]"),
        (
            format!(
                "[vary.p]\n{path}\nvalues = [0, 1]\n[vary.q]\npath = \"media.milk.milk.concentration\"\nvalues = [0, 0.1, 0.2]"
            ),
            "equal length",
            "[0, 1]",
        ),
        (
            format!("[vary.p]\n{path}\nvalues = [0]\n[vary.q]\npath = \"materials.wall\"\nvalues = [0]"),
            "remove one of the two paths",
            "\"materials.wall\"",
        ),
    ];
    for (vary, fix, at) in cases {
        // Albedos above 1 are refused only when the scene is built.
        let Err(e) = read(&vary, 0) else {
            assert!(vary.contains("1.5"), "{vary}");
            continue;
        };
        assert!(e.help.as_deref().unwrap_or("").contains(fix), "{e}\n{vary}");
        assert!(at.is_empty() || place(&e) == at, "`{}` instead of `{at}`: {e}", place(&e));
        assert!(e.line_column().is_some_and(|(line, _)| line > SCENE.lines().count()), "{e}");
    }
    let e = super::read(Path::new("s"), SCENE, 0).expect_err("no variants");
    assert!(e.message.contains("no [vary]"), "{e}");
}

mod any_text {
    use super::super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..Default::default() })]

        /// Tests that the parser of paths returns the original keys for any keys that TOML has quoted.
        #[test]
        fn paths_are_read_as_toml_writes_them(all in prop::collection::vec(any::<String>(), 1..5)) {
            let written: Vec<String> = all.iter().map(|k| toml::Value::String(k.clone()).to_string()).collect();
            // Only single-line basic and literal strings are valid keys.
            prop_assume!(written.iter().all(|k| !k.starts_with("\"\"\"") && !k.starts_with("'''")));
            prop_assert_eq!(keys(&written.join(".")), Some(all));
        }

        /// Tests that no text makes the parser of paths or of `[vary]` panic.
        #[test]
        fn arbitrary_paths_never_panic(path in any::<String>(), values in any::<String>(), number in any::<u64>()) {
            let path = toml::Value::String(path).to_string();
            let text = format!("{}[vary.p]\npath = {path}\nvalues = [{values}]\n", super::SCENE);
            if let Err(e) = super::super::read(Path::new("s"), &text, number) {
                prop_assert!(e.help.is_some());
            }
        }

        /// Tests that each number of a list appears in `every` consecutive variants.
        #[test]
        fn each_listed_number_is_used_in_consecutive_variants(list in prop::collection::vec(0.0..1.0_f64, 1..8), every in 1..5_u64, turn in 0..1000_u64) {
            let text = format!(
                "{}[vary.p]\npath = \"media.milk.milk.concentration\"\nvalues = {list:?}\nevery = {every}\n\
                 [vary.q]\npath = \"objects.1.shape.sphere.radius\"\nrange = {{ min = 1, max = 2 }}\n",
                super::SCENE
            );
            let variant = super::super::read(Path::new("s"), &text, turn).expect("endless");
            let media = toml::Value::try_from(&*variant.file.media["milk"]).expect("a value");
            let expected = list[(turn / every) as usize % list.len()];
            prop_assert_eq!(media["milk"]["concentration"].as_float(), Some(expected));
        }
    }
}
