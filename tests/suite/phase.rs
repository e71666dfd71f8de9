//! Tests `sunstone phase`, and tests that invalid files of media are refused.

use crate::harness::{Case, fault, refusals, run};

/// A valid file of media. Each test makes one item of the file invalid.
const MEDIA: &str = r#"wavelengths_nm = [450, 550, 660]

[media.air.homogeneous]
scattering = [3e-5, 1e-5, 6e-6]
phase.rayleigh = { depolarization = 0.028 }

[media.haze.homogeneous]
scattering = 0.1
absorption = 0.01
index = 1.0003
phase.henyey_greenstein = { g = [0.8, 0.7, 0.6], linear = 0.2 }

[media.beads.polystyrene]
diameter_nm = 500
amount.volume_fraction = 0.01

[media.drink.milk]
fat_percent = 0.1
concentration = 0.5

[media.dust.particles]
host = 1.0
kinds = [
    { index = 1.5, k = 0.01, sizes.log_normal = { median_nm = 100, sigma = 0.2 }, amount.per_m3 = 1e12 },
    { index = "Au", sizes.list = { radius_nm = [20, 30], weight = [1, 2] }, amount.mass = { grams_per_litre = 0.001, density = 19300 } },
]

[media.cloud.homogeneous]
scattering = 0.02
phase.mie.kinds = [{ index = "water", sizes.gamma = { effective_radius_nm = 900, effective_variance = 0.1 }, amount.per_m3 = 1e9 }]

[media.stone.marble]
[media.hand.skin]
g = 0.7
"#;

#[rustfmt::skip]
const CASES: &[Case] = &[
    ("an unknown kind", "media.drink.milk", "media.drink.beer", "media.drink.beer", "unknown name `beer`"),
    ("an unknown key", "scattering = 0.1", "scatering = 0.1", "scatering", "unknown key `scatering`"),
    ("an unknown phase", "phase.rayleigh = { depolarization = 0.028 }", "phase.rayley = {}", "rayley", "unknown name `rayley`"),
    ("a negative coefficient", "scattering = 0.1", "scattering = -0.1", "-0.1", "scattering is -0.1"),
    ("two values for three wavelengths", "[0.8, 0.7, 0.6]", "[0.8, 0.7]", "[0.8, 0.7]", "2 values for 3 wavelengths"),
    ("a mean cosine of 1", "[0.8, 0.7, 0.6]", "1", "1, linear", "g is 1"),
    ("more polarization than can be", "linear = 0.2", "linear = 0.6", "0.6 }", "linear is 0.6"),
    ("more depolarization than needles", "0.028", "0.6", "0.6 }", "depolarization is 0.6"),
    ("an index below 1", "index = 1.0003", "index = 0.9", "0.9\n", "index is 0.9"),
    ("a host of metal", "host = 1.0", "host = \"Au\"", "\"Au\"\nkinds", "transparent"),
    ("an unknown substance", "index = \"Au\"", "index = \"Ag2\"", "\"Ag2\"", "`Ag2`"),
    ("no size", "median_nm = 100", "median_nm = 0", "sizes.log_normal", "radius is 0"),
    ("a wide distribution", "sigma = 0.2", "sigma = 3", "sizes.log_normal", "sigma is 3"),
    ("too large a variance", "effective_variance = 0.1", "effective_variance = 0.5", "sizes.gamma", "variance is 0.5"),
    ("an uneven list", "weight = [1, 2]", "weight = [1]", "sizes.list", "2 radii and 1 weights"),
    ("more than all", "volume_fraction = 0.01", "volume_fraction = 1.5", "amount.volume_fraction", "got 1.5"),
    ("a boulder", "diameter_nm = 500", "diameter_nm = 5e6", "5e6", "diameter_nm is 5000000"),
    ("a particle that is too large", "effective_radius_nm = 900", "effective_radius_nm = 400000", "{ index = \"water\"", "size parameter"),
    ("a second kind that is too large", "radius_nm = [20, 30]", "radius_nm = [20, 900000]", "{ index = \"Au\"", "size parameter"),
    ("no particles", "phase.mie.kinds = [{ index = \"water\", sizes.gamma = { effective_radius_nm = 900, effective_variance = 0.1 }, amount.per_m3 = 1e9 }]", "phase.mie.kinds = []", "[]", "particle kinds is empty"),
    ("cream beyond butter", "fat_percent = 0.1", "fat_percent = 80", "80", "fat_percent is 80"),
    ("milk in the infrared", "wavelengths_nm = [450, 550, 660]", "wavelengths_nm = [450, 550, 900]", "[media.drink.milk]", "milk_fat cover only 380 to 770 nm"),
    ("wavelengths out of order", "[450, 550, 660]", "[450, 660, 550]", "[450, 660, 550]", "increasing"),
];

#[test]
fn errors_of_broken_files_have_position_and_fix() {
    let folder = tempfile::tempdir().expect("a folder");
    let message = |case: &Case| {
        let from = case.1;
        // The last heading before the fault names the faulty medium.
        let above = &MEDIA[..MEDIA.find(from).expect("the passage")];
        let name =
            above.rfind("[media.").map_or("drink", |at| MEDIA[at + 7..].split('.').next().expect("a name"));
        let name = if from.starts_with("media.") { "drink" } else { name };
        let arguments = ["phase", "eval", "m.toml", "--name", name, "-o", "out.csv"];
        fault(folder.path(), "m.toml", MEDIA, case, &arguments)
    };
    let faults: Vec<String> = CASES.iter().filter_map(message).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn bad_arguments_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("m.toml"), MEDIA).expect("a file");
    std::fs::write(folder.path().join("none.toml"), "[media]\n").expect("a file");
    refusals(
        folder.path(),
        &[
            ("phase eval missing.toml", "missing.toml"),
            ("phase eval m.toml", "choose one of them with --name"),
            ("phase eval m.toml --name beer", "no medium `beer`"),
            ("phase eval none.toml", "no medium"),
            ("phase eval m.toml --name air --angles 1", "got 1"),
            ("phase eval m.toml --name air --angles 0,200", "`200`: expected an angle"),
            ("phase eval m.toml --name air --wavelengths 5", "range 100 to 100000 nm"),
            ("phase eval m.toml --name drink --wavelengths 900", "380 to 770 nm"),
        ],
    );
}

/// Returns the numbers in the comment lines and the numbers in the rows.
fn numbers(text: &str) -> [Vec<Vec<f64>>; 2] {
    let parse = |l: &str| -> Vec<f64> { l.split(',').map(|n| n.trim().parse().expect("a number")).collect() };
    let head = text.lines().filter_map(|l| l.strip_prefix("# ")).skip(1);
    let rows = text.lines().filter(|l| l.starts_with(|c: char| c.is_ascii_digit()));
    [head.map(parse).collect(), rows.map(parse).collect()]
}

#[test]
fn matrices_are_printed_as_csv() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("m.toml"), MEDIA).expect("a file");
    let eval = |arguments: &str| {
        let mut all = vec!["phase", "eval", "m.toml", "--name"];
        all.extend(arguments.split_whitespace());
        let out = run(folder.path(), &all, 0);
        String::from_utf8(out.stdout).expect("text")
    };
    let text = eval("air --angles 0,90,180");
    assert!(text.contains("\nangle_deg,wavelength_nm,S11,S12,S22,S33,S34,S44\n"), "{text}");
    let [head, rows] = numbers(&text);
    assert_eq!((head.len(), rows.len()), (3, 9));
    assert_eq!(head[1][..4], [550.0, 1.0, 1e-5, 0.0]);
    // In the forward direction, the value is 3Δ/8π + (1 - Δ)/4π with Δ = 0.972/1.014. At 90°, the ratio of
    // parallel to perpendicular light is 0.028.
    let delta = 0.972 / 1.014;
    let pi = std::f64::consts::PI;
    assert!((rows[0][2] - (0.375 * delta / pi + 0.25 * (1.0 - delta) / pi)).abs() < 1e-7);
    let [s11, s12] = [rows[1][2], rows[1][3]];
    assert!(((s11 - s12) / (s11 + s12) - 0.028).abs() < 1e-6 && s12 > 0.0);
    // The program interpolates lists. Any number and order of wavelengths is valid.
    let [head, rows] = numbers(&eval("haze --wavelengths 605,450,500,550,660 --angles 3"));
    assert_eq!((head.len(), rows.len()), (5, 15));
    assert_eq!(head[0][..2], [605.0, 1.0003]);
    assert!((head[0][4] - 0.65).abs() < 1e-12);
    assert_eq!(rows.iter().take(3).map(|r| r[0]).collect::<Vec<_>>(), [0.0, 90.0, 180.0]);
    // The command prints coefficients of particles with the cross sections of the particles. Coefficients of
    // `phase.mie` are printed as given.
    let [head, _] = numbers(&eval("dust --angles 2"));
    assert!(head.iter().all(|h| h[2] > 0.0 && h[3] > 0.0 && h[5] > 0.0 && h[6] > 0.0));
    let [head, rows] = numbers(&eval("cloud --angles 1801"));
    assert!(head.iter().all(|h| h[2] == 0.02 && h[3] == 0.0 && h[4] > 0.7), "{head:?}");
    let sum: f64 =
        rows[..1801].iter().map(|r| r[2] * r[0].to_radians().sin() * 2.0 * pi * (0.1_f64).to_radians()).sum();
    assert!((sum - 1.0).abs() < 1e-3, "{sum}");
    for name in ["beads", "drink", "stone", "hand"] {
        assert_eq!(numbers(&eval(&format!("{name} --angles 2")))[1].len(), 6);
    }
    // The command writes the same content to a file as to standard output.
    let message = eval("air --angles 5 -o air.csv");
    assert_eq!(message.trim(), "air.csv");
    let written = std::fs::read_to_string(folder.path().join("air.csv")).expect("a file");
    assert_eq!(written.trim_end(), eval("air --angles 5").trim_end());
}
