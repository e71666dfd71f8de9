//! Tests arrays and documents. Each document has every key. The documents are schemes, detectors, priors,
//! media, materials and calibrations. The tests replace every value with invalid values, one at a time. The
//! program must refuse the result.

use super::case::{Case, Expect, Put};
use super::scenes::spoil;
use std::collections::BTreeSet;

/// Valid replacements, with one `document: key = value` per line.
const ACCEPTED: &str = include_str!("accepted_documents.txt");

const SCHEME: &str = r#"name = "x"
sensor = { kind = "polarizer_array", extinction = 0.001, axis_offsets_deg = [0, 1, 0, -1] }
source = [1, 0, 0, 0]
[[generator]]
name = "polarizer_1"
kind = "polarizer"
angle_deg = [0, 12, 24, 36, 48, 60]
axis_offset_deg = 0.1
transmittance = 0.9
extinction = [[450, 1e-4], [650, 2e-4]]
[[generator]]
name = "retarder_2"
kind = "retarder"
angle_deg = [0, 50, 100, 150, 200, 250]
retardance_deg = [90, 91, 92, 93, 94, 95]
retardance_error_deg = [[450, 6.1], [550, 0], [660, -5.2]]
order = 1
index = 1.55
[[analyzer]]
name = "retarder_3"
kind = "retarder"
angle_deg = [0, 5, 10, 15, 20, 25]
retardance_deg = 90
"#;

const CMOS: &str = r#"demosaic = "none"
[cmos]
exposure_s = 0.5
bracket = [1, 0.1]
quantum_efficiency = [[450, 0.6], [650, 0.5]]
photons_per_unit = 1e6
read_noise_e = 2.4
dark_current_e_s = 1
full_well_e = 10700
bit_depth = 12
gain_e_per_dn = 2.6
black_level_dn = 16
binning = 1
shot_noise = true
"#;

const SPAD: &str = r#"[spad]
mode = "synchronous"
bin_ps = 1000
bins = 12
period_ps = 100000
pulses = 1000
photons_per_unit = 1e-3
detection_efficiency = 0.3
dark_counts_per_s = 100
dead_time_ps = 50000
after_pulsing = 0.01
after_pulse_time_ps = 20000
irf_fwhm_ps = 50
irf_tail = 0.1
irf_tail_ps = 200
"#;

const MATERIALS: &str = r#"wavelengths_nm = [450, 550, 660]
[materials]
white.diffuse.albedo = [0.70, 0.73, 0.74]
gold.rough_conductor = { metal = "Au", alpha = 0.2 }
"#;

const MEDIA: &str = r"wavelengths_nm = [450, 550, 660]
[media.beads.polystyrene]
diameter_nm = 100
spread = 0.02
amount.volume_fraction = 1e-4
";

const OPENCV: &str = r"image_width = 64
image_height = 48
camera_matrix = [[60, 0, 32], [0, 60, 24], [0, 0, 1]]
distortion_coefficients = [0.1, 0.01, 0.001, 0.001, 0]
rvec = [0.1, 0.2, 0.3]
tvec = [0.1, 0, 2]
";

const MATLAB: &str = r"ImageSize = [48, 64]
IntrinsicMatrix = [[60, 0, 0], [0, 60, 0], [32, 24, 1]]
RadialDistortion = [0.1, 0.01]
TangentialDistortion = [0, 0]
";

const KALIBR: &str = r#"[cam0]
camera_model = "pinhole"
distortion_model = "radtan"
distortion_coeffs = [0.1, 0.01, 0, 0]
intrinsics = [60, 60, 32, 24]
resolution = [64, 48]
"#;

/// A simulated rig with every key, and plans with every key.
pub const RIG: &str = r#"name = "x"
wavelength_nm = 550
[stages.polarizer_1]
driver = "simulated"
approach_deg = 0.5
backlash_deg = 0.1
velocity = 25
acceleration = 25
resolution_deg = 0.001
[stages.retarder_2]
[stages.retarder_3]
[stages.polarizer_4]
[projector]
driver = "simulated"
size = [6, 4]
bits = 1
patterns = 64
shortest_ms = 0.3
leds = ["green"]
[camera]
driver = "simulated"
size = [8, 6]
step = [1, 1]
row_time_us = 10
[galvo]
range_deg = [20, 20]
settle_us = 300
[laser]
nm = 550
rate_hz = [1e5, 8e7]
[counter]
bins = 4096
finest_ps = 25
[detector.cmos]
photons_per_unit = 1e6
[detector.spad]
photons_per_unit = 2
[geometry]
camera = { matrix = [[8, 0, 3.5], [0, 8, 2.5], [0, 0, 1]], distortion = [-0.1, 0.02, 0, 0] }
projector = { matrix = [[6, 0, 2.5], [0, 6, 1.5], [0, 0, 1]] }
rodrigues = [0, 0.05, 0]
translation = [0.2, 0.01, 0]
[bench]
sample = [[0.3, 0, 0, 0], [0, 0.3, 0, 0], [0, 0, 0.2, 0], [0, 0, 0, 0.2]]
brightness = 0.9
wavelength_nm = 550
camera_fov_deg = 20
projector_fov_deg = 20
seed = 5
real_time = false
[[bench.faults]]
kind = "timeout"
instrument = "camera"
at = 100000
"#;

pub const PLAN: &str = r#"name = "x"
rig = "rig.toml"
[scheme]
kind = "drr"
captures = 16
array = false
[camera]
exposures_ms = [2, 8]
gain_db = 1
format = "Mono12p"
masks = ["dark", "full", { name = "epipolar", stripes = 2, outside = false }]
[limits]
retries = 2
backoff_s = 0.1
deadline_s = 5
suspend_s = 60
laser_power = 0.9
saturated_share = 0.9
"#;

pub const SCAN: &str = r#"name = "x"
rig = "rig.toml"
scheme = { kind = "drr", captures = 16 }
[scan]
points = [3, 2]
fov_x_deg = 10
dwell_ms = 2
bins = 32
bin_ps = 25
offset_ps = 0
rate_hz = 1e7
"#;

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Toml,
    Json,
}

/// The name, text, file name, format and command of each document.
#[rustfmt::skip]
const DOCUMENTS: &[(&str, &str, &str, Format, &str)] = &[
    ("scheme", SCHEME, "x.toml", Format::Toml, "scheme show x.toml"),
    ("cmos", CMOS, "x.toml", Format::Toml, "capture {f}/M.npy --scheme {f}/drr9.toml --detector x.toml -o out.npy"),
    ("spad", SPAD, "x.toml", Format::Toml, "capture {f}/s.zarr timed --scheme {f}/drr9.toml --detector x.toml -o out.npy"),
    ("materials", MATERIALS, "x.toml", Format::Toml, "pbrdf eval x.toml --name white --in 40,0 --out 20,120"),
    ("media", MEDIA, "x.toml", Format::Toml, "phase eval x.toml --angles 3 -o out.csv"),
    ("opencv", OPENCV, "x.json", Format::Json, "import x.json -o out.toml"),
    ("matlab", MATLAB, "x.json", Format::Json, "import x.json -o out.toml"),
    ("rig", RIG, "x.toml", Format::Toml, "rig run {f}/plan.toml --rig x.toml -o out.zarr"),
    ("plan", PLAN, "x.toml", Format::Toml, "rig run x.toml --rig {f}/rig.toml -o out.zarr"),
    ("scan", SCAN, "x.toml", Format::Toml, "rig run x.toml --rig {f}/rig.toml -o out.zarr"),
    ("kalibr", KALIBR, "x.json", Format::Json, "import x.json -o out.toml"),
];

/// Returns a `.npy` file that consists of `header` and `bytes` bytes of data.
fn npy(header: &str, bytes: usize) -> Vec<u8> {
    let header = format!("{header}\n");
    let mut all = b"\x93NUMPY\x01\x00".to_vec();
    all.extend((header.len() as u16).to_le_bytes());
    all.extend(header.as_bytes());
    all.extend(std::iter::repeat_n(0x3f, bytes));
    all
}

/// Commands that read an array `x.npy` of matrices or intensities.
const OF_ARRAYS: &[&str] = &[
    "decompose x.npy -o out.npz",
    "decompose {f}/M.npy --errors x.npy -o out.npz",
    "capture x.npy --scheme {f}/drr36.toml -o out.npy",
    "reconstruct x.npy --scheme {f}/drr36.toml -o out.npy",
    "reconstruct {f}/I.npy --scheme {f}/drr36.toml --variance x.npy -o out.npy",
    "trial x.npy --scheme {f}/drr36.toml -o out.csv",
];

/// The name, header and number of data bytes of each invalid array.
#[rustfmt::skip]
const ARRAYS: &[(&str, &str, usize)] = &[
    ("of no shape", "{'descr': '<f4', 'fortran_order': False, 'shape': (), }", 4),
    ("of one axis", "{'descr': '<f4', 'fortran_order': False, 'shape': (16,), }", 64),
    ("of 4 x 3", "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 4, 3), }", 96),
    ("of complex numbers", "{'descr': '<c8', 'fortran_order': False, 'shape': (2, 4, 4), }", 256),
    ("of texts", "{'descr': '<U4', 'fortran_order': False, 'shape': (2, 4, 4), }", 512),
    ("of objects", "{'descr': '|O', 'fortran_order': False, 'shape': (2, 4, 4), }", 512),
    ("of records", "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (2, 4, 4), }", 128),
    ("of 8-byte integers", "{'descr': '<i8', 'fortran_order': False, 'shape': (2, 4, 4), }", 256),
    ("of truths", "{'descr': '|b1', 'fortran_order': False, 'shape': (2, 4, 4), }", 32),
    ("of more than there is", "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000, 4, 4), }", 128),
    ("of more than fits", "{'descr': '<f4', 'fortran_order': False, 'shape': (18446744073709551615, 4, 4), }", 128),
    ("of a product that wraps", "{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296, 4, 4), }", 128),
    ("column-major of more than there is", "{'descr': '<f4', 'fortran_order': True, 'shape': (1000000, 4, 4), }", 128),
    ("column-major of many axes", "{'descr': '<f4', 'fortran_order': True, 'shape': (2, 2, 2, 2, 2, 2, 3), }", 768),
    ("of a negative shape", "{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 4, 4), }", 128),
    ("without a shape", "{'descr': '<f4', 'fortran_order': False}", 128),
    ("of another language", "{'descr': __import__('os'), 'shape': (1, 4, 4), }", 64),
    ("nested deep", "((((((((((((((((((((((((((((((((((((((((((((((((((((((((((((", 0),
];

pub fn cases() -> Vec<Case> {
    let accepted: BTreeSet<&str> = ACCEPTED.lines().filter(|l| !l.starts_with('#')).collect();
    let expected = |case: Case| {
        let right = accepted.contains(case.name.as_str());
        if right { case.expect(Expect::Accepted) } else { case }
    };
    let mut cases = vec![];
    for (name, text, file, format, command) in DOCUMENTS {
        let whole: toml::Table = text.parse().expect("TOML");
        let put = |value: &toml::Value| match format {
            Format::Toml => Put::Text(toml::to_string(value).expect("TOML")),
            Format::Json => Put::Text(serde_json::to_string(value).expect("JSON")),
        };
        let whole = toml::Value::Table(whole);
        let right = Case::new(format!("{name}: as it is"), command).put(*file, put(&whole));
        cases.push(right.expect(Expect::Accepted));
        for (key, value) in spoil(&whole) {
            cases.push(expected(Case::new(format!("{name}: {key}"), command).put(*file, put(&value))));
        }
    }
    for command in OF_ARRAYS {
        for (what, header, bytes) in ARRAYS {
            let case = Case::new(format!("{command}: {what}"), command);
            cases.push(expected(case.put("x.npy", Put::Bytes(npy(header, *bytes)))));
        }
    }
    cases
}
