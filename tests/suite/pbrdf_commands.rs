//! Tests that `sunstone pbrdf` evaluates materials, and writes, inspects, slices and draws tables.

use crate::decompose::arrays;
use crate::harness::{files, refusals, run, stderr};
use serde_json::Value;
use std::path::Path;
use sunstone::store::numpy::{NumpyArray, Values};

const MATERIALS: &str = r#"
wavelengths_nm = [450, 550, 650]
[materials]
gold.conductor = { n = 0.4242, k = 2.4721 }
rough.rough_conductor = { metal = "Au", alpha = 0.4 }
glass.dielectric = { ior = [1.52, 1.51, 1.5] }
white.diffuse.albedo = { nm = [400, 500, 700], values = [0.2, 0.6, 0.8] }
"#;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("m.toml"), MATERIALS).expect("a file");
    folder
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    let out = run(folder, arguments, 0);
    serde_json::from_slice(&out.stdout).expect("JSON")
}

fn element(v: &Value, lane: usize, i: usize, j: usize) -> f64 {
    v["mueller"][lane][i][j].as_f64().expect("a number")
}

#[test]
fn handbook_values_are_printed() {
    let folder = folder();
    let eval = |arguments: &str| {
        let mut all = vec!["pbrdf", "eval", "m.toml"];
        all.extend(arguments.split_whitespace());
        json(folder.path(), &all)
    };
    // Tests gold at 60° against the fixed numbers of the conventions.
    let gold = eval("--name gold --in 60,20 --mirror");
    for (i, j, want) in
        [(0, 0, 0.792_257), (0, 1, 0.102_981), (2, 2, -0.406_951), (3, 2, 0.671_906), (0, 3, 0.0)]
    {
        assert!((element(&gold, 1, i, j) - want).abs() < 2e-6, "[{i}][{j}]");
    }
    assert_eq!(gold["out"]["phi_deg"], 200.0);
    assert_eq!(gold["kind"], "mirror");
    // The power transmitted into glass at 45° is 1 minus Fresnel's reflectance for index 1.5. Each wavelength
    // has a separate angle of refraction.
    let glass = eval("--name glass --in 45,0 --refract");
    assert!((element(&glass, 2, 0, 0) - (1.0 - 0.050_239_9)).abs() < 2e-6);
    let theta = |lane: usize| glass["out"][lane]["theta_deg"].as_f64().expect("an angle");
    for (lane, n) in [(0, 1.52), (1, 1.51), (2, 1.5_f64)] {
        let want = 180.0 - (45.0_f64.to_radians().sin() / n).asin().to_degrees();
        assert!((theta(lane) - want).abs() < 1e-4);
    }
    // In the opposite direction, the transmitted power is the same. Beyond the critical angle, no power is
    // transmitted.
    let back = 180.0 - theta(2);
    let out = eval(&format!("--name glass --in {},0 --refract", 180.0 - back));
    assert!((element(&out, 2, 0, 0) - (1.0 - 0.050_239_9)).abs() < 2e-6);
    let total = eval("--name glass --in 130,0 --refract");
    assert!(total["out"][0].is_null() && element(&total, 0, 0, 0) == 0.0);
    // A Lambertian material has the value ρ/π, from the table of albedos, and the density cos/π.
    let white = eval("--name white --in 60,10 --out 20,100");
    for (lane, albedo) in [(0, 0.4), (1, 0.65), (2, 0.75)] {
        assert!((element(&white, lane, 0, 0) - albedo / std::f64::consts::PI).abs() < 1e-6);
    }
    let pdf = white["pdf"].as_f64().expect("a density");
    assert!((pdf - 0.5 / std::f64::consts::PI).abs() < 1e-6);
    // Many directions in one call give the same results as separate calls.
    std::fs::write(folder.path().join("d.csv"), "60, 10, 20, 100\n\n0,0,30,0\n").expect("a file");
    let many = eval("--name white --directions d.csv");
    assert_eq!(many.as_array().map(Vec::len), Some(2));
    assert_eq!(many[0], white);
}

#[test]
fn tables_are_made_and_read() {
    let folder = folder();
    let at = folder.path();
    let ok = |arguments: &[&str]| {
        let out = run(at, arguments, 0);
        String::from_utf8(out.stdout).expect("text")
    };
    let resolution = ["--resolution", "19x10x19"];
    ok(&[&["pbrdf", "synth", "m.toml", "-o", "t"], &resolution[..]].concat());
    // The command omits mirrors and glass, because they cannot be tabulated.
    let made: Vec<_> = files(&at.join("t")).into_keys().collect();
    assert_eq!(made, ["materials.toml", "rough.pbsdf", "white.pbsdf"].map(std::path::PathBuf::from));
    let info = ok(&["pbrdf", "info", "t/white.pbsdf"]);
    assert!(info.contains("phi_d      19 entries, -180.0° to 180.0°"), "{info}");
    assert!(info.contains("450, 500, 550, 600, 650"), "{info}");
    // The white material is constant and unpolarized. At 550 nm, the value of the white material is 0.65/π.
    let band = info.lines().find(|l| l.trim_start().starts_with("550")).expect("a band");
    let numbers: Vec<f64> = band.split_whitespace().filter_map(|w| w.parse().ok()).collect();
    let want = 0.65 / std::f64::consts::PI;
    assert!((numbers[2] - want).abs() < 1e-4 && (numbers[3] - want).abs() < 1e-4, "{band}");
    assert_eq!(numbers[4], 0.0);
    // Writes a slice of the table in each of two formats.
    let cut = ["pbrdf", "slice", "t/rough.pbsdf", "--phi-d", "100", "--theta-d", "40", "-w", "550", "-o"];
    ok(&[&cut[..], &["cut.csv"]].concat());
    ok(&[&cut[..], &["cut.npy"]].concat());
    let csv = std::fs::read_to_string(at.join("cut.csv")).expect("a table");
    let mut lines = csv.lines();
    assert!(
        lines
            .next()
            .expect("a head")
            .ends_with("wavelength_nm,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23,m30,m31,m32,m33")
    );
    let row: Vec<f64> =
        lines.next().expect("a row").split(',').map(|n| n.parse().expect("a number")).collect();
    assert_eq!(row[..4], [100.0, 40.0, 0.0, 550.0]);
    let cut = NumpyArray::read(&at.join("cut.npy")).expect("an array");
    assert_eq!(cut.shape, [19, 4, 4]);
    let Values::Single(values) = cut.values else { panic!("the array has double precision") };
    assert!((f64::from(values[0]) - row[4]).abs() < 1e-6 * row[4]);
    // At θh = 0, the directions of light and view are mirror images about the normal. The material of the
    // table gives the same value.
    let source = json(at, &["pbrdf", "eval", "m.toml", "--name", "rough", "--in", "40,0", "--out", "40,180"]);
    assert!((element(&source, 1, 0, 0) - row[4]).abs() < 1e-4 * row[4]);
    // A wavelength of 660 nm is outside the table. The command uses the last band of the table, and reports
    // once that the table does not include 660 nm.
    std::fs::write(at.join("red.toml"), "[materials]\nm.measured.file = 't/white.pbsdf'\n").expect("a file");
    let red = run(at, &["pbrdf", "eval", "red.toml", "--in", "30,0", "--out", "10,90"], 0);
    assert_eq!(stderr(&red).matches("660 nm uses the band at 650 nm").count(), 1, "{}", stderr(&red));
    let red: Value = serde_json::from_slice(&red.stdout).expect("JSON");
    assert!((element(&red, 2, 0, 0) - 0.75 / std::f64::consts::PI).abs() < 1e-5);
    // Draws images, and renders the tables as materials.
    ok(&["pbrdf", "plot", "t/rough.pbsdf", "-o", "p/plot.png"]);
    ok(&["pbrdf", "sheet", "t/materials.toml", "-o", "p/sheet.png", "--size", "8", "--spp", "1"]);
    for picture in ["p/plot.png", "p/sheet.png"] {
        let image = image::open(at.join(picture)).expect("a picture");
        assert!(image.width() > 200);
    }
}

/// Tests the principal components of tables and of the built-in stand-ins for measured materials. Variance
/// fractions decrease and sum to 1, and the arrays equal the numbers in the image.
#[test]
fn principal_components_are_found() {
    let folder = folder();
    let at = folder.path();
    let pca = |arguments: &str| {
        let mut all = vec!["pbrdf", "pca"];
        all.extend(arguments.split_whitespace());
        String::from_utf8(run(at, &all, 0).stdout).expect("text")
    };
    let synth = ["pbrdf", "synth", "m.toml", "-o", "t", "--resolution", "9x10x19"];
    run(at, &synth, 0);
    for (arguments, materials) in [
        ("--data t -o p/c.png --npz c.npz --prior p/prior.toml", 2),
        ("--data t -o p/plain.png --map none -n 16 --bands 550 --npz c.npz", 2),
        ("-o p/s.png --resolution 5x4x7 -n 3 --npz c.npz", 25),
    ] {
        let text = pca(arguments);
        assert!(text.contains(&format!("of {materials} materials")), "{text}");
        let rows: Vec<Vec<f64>> = text
            .lines()
            .skip(2)
            .take(16)
            .map(|l| l.split_whitespace().filter_map(|w| w.parse().ok()).collect())
            .collect();
        assert!(rows.windows(2).all(|w| w[0][1] >= w[1][1]), "{text}");
        assert!((rows[15][3] - 100.0).abs() < 2e-3, "{text}");
        let saved = arrays(&at.join("c.npz"));
        let double = |name: &str| match &saved[name].values {
            Values::Double(values) => values.clone(),
            Values::Single(_) => panic!("{name} has single precision"),
        };
        let (spectrum, share) = (double("spectrum"), double("share"));
        assert!(
            (spectrum[0] / rows[0][1] - 1.0).abs() < 1e-3 && (share.iter().sum::<f64>() - 1.0).abs() < 1e-12
        );
        let vectors = double("vectors");
        assert_eq!(saved["vectors"].shape, [16, 4, 4]);
        let dot =
            |k: usize, l: usize| (0..16).map(|i| vectors[16 * k + i] * vectors[16 * l + i]).sum::<f64>();
        assert!((dot(0, 0) - 1.0).abs() < 1e-12 && dot(0, 1).abs() < 1e-12);
        let m00 = double("mean")[0];
        let want = if arguments.contains("none") { 1.0 } else { 8.0_f64.atan() };
        assert!((m00 - want).abs() < 1e-12, "{m00}");
    }
    for picture in ["p/c.png", "p/plain.png", "p/s.png"] {
        assert!(image::open(at.join(picture)).expect("a picture").width() > 400);
    }
}

/// Tests that each invalid request is refused with a message that contains a given word, and writes nothing.
#[test]
fn wrong_requests_are_refused() {
    let folder = folder();
    let at = folder.path();
    std::fs::write(at.join("bad.csv"), "1,2,3,4\n5,6\n").expect("a file");
    std::fs::write(at.join("not.pbsdf"), "nothing").expect("a file");
    let cases = [
        ("pbrdf eval m.toml --in 0,0 --mirror", "--name"),
        ("pbrdf eval m.toml --name silver --in 0,0 --mirror", "available: glass"),
        ("pbrdf eval none.toml --in 0,0 --mirror", "none.toml"),
        ("pbrdf eval m.toml --name gold --in 0 --mirror", "two numbers"),
        ("pbrdf eval m.toml --name gold --in 0,x --mirror", "`x`: expected an angle"),
        ("pbrdf eval m.toml --name gold --in 0,0", "--refract"),
        ("pbrdf eval m.toml --name white --in 0,0 --mirror", "no specular reflection"),
        ("pbrdf eval m.toml --name gold --in 0,0 --refract", "no specular transmission"),
        ("pbrdf eval m.toml --name white --directions bad.csv", "bad.csv:2"),
        ("pbrdf synth m.toml -o t --name gold", "purely specular"),
        ("pbrdf synth m.toml -o t --name silver", "known materials: glass"),
        ("pbrdf synth m.toml -o t --resolution 3x3", "361x91x91"),
        ("pbrdf synth m.toml -o t --bands 550,450", "increasing"),
        ("pbrdf info not.pbsdf", "tensor file"),
        ("pbrdf plot none.pbsdf", "none.pbsdf"),
        ("pbrdf slice not.pbsdf -o x.npy", "tensor file"),
        ("pbrdf pca --data none", "cannot list"),
        ("pbrdf pca --data .", "not.pbsdf: the file is not a tensor file"),
        ("pbrdf pca --resolution 3x3", "361x91x91"),
        ("pbrdf pca --data . --resolution 3x3x3", "cannot be used with"),
        ("pbrdf pca --bands 550,450", "increasing"),
        ("pbrdf pca -c 0", "expected a number from 1e-6"),
        ("pbrdf pca --npz x.npy", ".npz"),
        ("pbrdf pca -n 17", "17"),
    ];
    refusals(at, &cases);
}
