//! Tests the reading and writing of schemes in TOML and CSV files. The tests include damaged input.

use super::*;
use crate::capture::scheme::Sensor;
use proptest::prelude::*;

fn toml(text: &str) -> Result<Scheme, InputError> {
    from_toml(Path::new("s.toml"), text)
}

fn fault(text: &str) -> String {
    toml(text).expect_err("a fault").to_string()
}

const FULL: &str = r#"
name = "full"
source = [1.0, 1.0, 0.0, 0.0]
sensor = { kind = "polarizer_array", extinction = [[450, 0.01], [650, 0.002]], axis_offsets_deg = [0.1, 0, 0, -0.2] }
[coaxial]
transmission = { efficiency = 0.45, diattenuation = 0.02 }
reflection = { efficiency = 0.48, retardance_deg = 12 }
galvo = { n = 0.06, k = 3.6 }
[[generator]]
name = "p"
kind = "polarizer"
angle_deg = 10
extinction = 1e-4
transmittance = 0.9
[[generator]]
kind = "retarder"
angle_deg = [0, 30.5, 61]
retardance_deg = [90, 91, 92]
retardance_error_deg = [[450, 6], [550, 0]]
order = 3
axis_offset_deg = 0.25
[[analyzer]]
kind = "retarder"
angle_deg = [0, 150, 300]
index = 1.6
"#;

#[test]
fn written_schemes_are_read_back() {
    let full = toml(FULL).expect("a scheme");
    assert_eq!((full.captures(), full.measurements(), full.motors().len()), (3, 12, 3));
    assert_eq!(full.generator()[1].name, "generator_2");
    let schemes =
        [Ok(full), Scheme::drr(36, false), Scheme::qrpr(5, true), Scheme::liquid_crystal(16, false)];
    for scheme in schemes {
        let scheme = scheme.expect("a scheme");
        let text = to_toml(&scheme).expect("TOML");
        let back = toml(&text).expect(&text);
        assert_eq!(to_toml(&back).expect("TOML"), text);
        assert_eq!(back.motors(), scheme.motors());
        let near = back.parameters().iter().zip(scheme.parameters()).all(|(a, b)| (a - b).abs() < 1e-10);
        assert!(near, "{text}");
    }
}

#[test]
fn errors_have_positions_and_fixes() {
    let head = "sensor = { kind = \"intensity\" }\n[[generator]]\n";
    let with = |rest: &str| fault(&format!("{head}{rest}"));
    assert!(with("kind = \"polariser\"\nangle_deg = 0").contains("s.toml:3:8"));
    assert!(with("kind = \"polarizer\"\nangle_deg = 0\nretardance_deg = 90").contains("s.toml:5:18"));
    assert!(with("kind = \"polarizer\"\nangle_deg = 0\nextinction = 2").contains("from 0 to 1"));
    assert!(
        with("kind = \"retarder\"\nangle_deg = 0\nextinction = 0.1").contains("applies only to polarizers")
    );
    assert!(with("kind = \"retarder\"\nangle_deg = 0\nindex = 0.5").contains("`index` is 0.5"));
    assert!(with("kind = \"polarizer\"\nangle_deg = [nan]").contains("capture 1"));
    assert!(with("kind = \"polarizer\"\nangle_deg = []").contains("no captures"));
    assert!(fault("sensor = { kind = \"intensity\", extinction = 0.1 }").contains("has no polarizers"));
    assert!(
        fault("source = [1, 1, 1, 0]\nsensor = { kind = \"intensity\" }")
            .contains("not a physical Stokes vector")
    );
    assert!(load(Path::new("/nowhere/s.toml")).expect_err("no file").to_string().contains("sunstone scheme"));
}

/// Verifies that the scheme of a calibration file is read. If the file has no scheme, the error names the
/// missing field.
#[test]
fn calibration_files_contain_schemes() {
    let others = "[polarimetric]\nnames = []\n[camera]\nresolution = [4, 3]\n[projector]\nx = 1\n[quality]\n[covariance]\n[radiometric]\n\
                  [temporal]\n[detector.cmos]\nread_noise_e = 3\n";
    assert_eq!(toml(&format!("{FULL}{others}")).expect("a scheme"), toml(FULL).expect("a scheme"));
    let answer = fault(others);
    assert!(answer.contains("missing key `sensor`") && answer.contains("rig calibrate"), "{answer}");
    assert!(fault(&format!("{FULL}[cameras]\n")).contains("unknown key `cameras`"));
}

#[test]
fn tables_of_angles_are_read() {
    let csv = |text: &str| from_csv(Path::new("a.csv"), text);
    let four =
        csv("polarizer_1, retarder_2, retarder_3, polarizer_4\n0, 5, 25, 0\n# a comment\n10, 20, 30, 40\n");
    let four = four.expect("a scheme");
    assert_eq!((four.captures(), &four.sensor), (2, &Sensor::Intensity));
    let degrees: Vec<f64> = four.parameters().iter().map(|p| p.to_degrees()).collect();
    let want = [0.0, 10.0, 5.0, 20.0, 25.0, 30.0, 0.0, 40.0];
    assert!(degrees.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12));
    let array = csv("polarizer_1,retarder_2,retarder_3,retardance_3\n0,5,25,100\n").expect("a scheme");
    assert_eq!((array.sensor.channels(), array.motors().len()), (4, 4));
    for (text, part) in [
        ("polarizer_1,retarder_2\n0,0\n", "is missing"),
        ("polarizer_1,retarder_2,retarder_3\n0,x,0\n", "a.csv:2:1: `x`"),
        ("polarizer_1,retarder_2,retarder_3\n0,1\n", "found record with 2"),
        ("polarizer_1,polarizer_1\n", "duplicate column"),
        ("angle\n", "unknown column `angle`"),
        ("polarizer_1,retarder_2,retarder_3\n", "at least one"),
    ] {
        let message = csv(text).expect_err("a fault").to_string();
        assert!(message.contains(part), "{message}");
    }
}

proptest! {
    /// Verifies that damaged files are rejected or read, and never cause a panic.
    #[test]
    fn damaged_text_never_panics(at in 0_usize..FULL.len(), with in "[ -~]{0,6}", csv in "[ -~\n,]{0,80}") {
        let mut text = FULL.to_owned();
        text.replace_range(at..(at + with.len()).min(text.len()), &with);
        let _ = toml(&text);
        let _ = from_csv(Path::new("x.csv"), &csv);
        let _ = from_csv(Path::new("x.csv"), &format!("polarizer_1,retarder_2,retarder_3\n{csv}"));
    }
}
