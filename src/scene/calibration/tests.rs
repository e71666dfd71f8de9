//! Tests the readers with one camera in each program's format, and with invalid files.

use super::document::Document;
use super::*;
use glam::{DMat3, DQuat, DVec3};
use proptest::prelude::*;
use std::io::Write;

/// OpenCV's matrix of the camera that all test files describe.
const MATRIX: [[f64; 3]; 3] = [[600.0, 0.0, 319.5], [0.0, 610.0, 239.25], [0.0, 0.0, 1.0]];
const LENS: [f64; 5] = [-0.1, 0.02, 0.001, -0.002, 0.003];
const RVEC: [f64; 3] = [0.1, -0.2, 0.3];
const T: [f64; 3] = [0.5, -0.25, 2.0];

fn rotation() -> [[f64; 3]; 3] {
    let r = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_array(RVEC)));
    r.transpose().to_cols_array_2d()
}

fn transposed(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    DMat3::from_cols_array_2d(&m).transpose().to_cols_array_2d()
}

fn read(name: &str, bytes: impl Into<Vec<u8>>, options: &Options) -> Result<Calibration, InputError> {
    from_document(&Document::parse(Path::new(name), bytes.into())?, options)
}

/// Returns the renderer's device for a calibration.
fn built(c: &Calibration) -> transport::device::pinhole::Pinhole {
    let ctx = Context::new(Path::new("a"), "", &Located::nowhere(vec![550.0])).unwrap();
    pinhole(&ctx, &c.device, 0..0).unwrap()
}

fn same(name: &str, text: &str, options: &Options) -> Calibration {
    let c = read(name, text, options).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let p = built(&c);
    assert_eq!(p.resolution, [640, 480], "{text}");
    assert!((p.focal - glam::DVec2::new(600.0, 610.0)).length() < 1e-12, "{text}");
    assert!((p.principal - glam::DVec2::new(320.0, 239.75)).length() < 1e-12, "{text}");
    let k = c.device.opencv.as_ref().map(|k| k.to_vec());
    assert_eq!(k.as_deref(), Some(&LENS[..]), "{text}");
    let r = DMat3::from_cols_array_2d(&rotation()).transpose();
    let origin = -(r.transpose() * DVec3::from_array(T));
    assert!((p.origin.as_dvec3() - origin).length() < 1e-6, "{text} {}", p.origin);
    assert!((p.axes.z_axis.as_dvec3() - r.row(2)).length() < 1e-6, "{text}");
    assert!((p.axes.x_axis.as_dvec3() - r.row(0)).length() < 1e-6, "{text}");
    c
}

#[test]
fn opencv_yaml_and_json_are_read() {
    let flat = |m: [[f64; 3]; 3]| format!("{:?}", m.concat());
    let matrix = |data: &str, rows: usize, columns: usize| {
        format!("!!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {data}\n")
    };
    for head in ["%YAML:1.0\n---\n", "%YAML 1.2\n---\n", ""] {
        let text = format!(
            "{head}calibration_time: \"Mon 23\"\nimage_width: 640\nimage_height: 480\nflags: 0\n\
             camera_matrix: {}distortion_coefficients: {}R: {}T: {}",
            matrix(&flat(MATRIX), 3, 3),
            matrix(&format!("{LENS:?}"), 1, 5),
            matrix(&flat(rotation()), 3, 3),
            matrix("[ .5, -2.5e-01,\n       2. ]", 3, 1),
        );
        same("a.yaml", &text, &Options::default());
    }
    let json = serde_json::json!({
        "image_width": 640, "image_height": 480,
        "cameraMatrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": MATRIX.concat()},
        "distCoeffs": {"type_id": "opencv-matrix", "rows": 5, "cols": 1, "dt": "d", "data": LENS},
        "rvec": RVEC, "tvec": [[T[0]], [T[1]], [T[2]]],
    });
    same("a.json", &json.to_string(), &Options::default());
    let plain = serde_json::json!({"camera": {"K": MATRIX, "dist": [LENS], "rvecs": [RVEC], "tvecs": [T], "image_size": [640, 480]}});
    same("a.json", &plain.to_string(), &Options::default());
}

#[test]
fn two_devices_in_one_file_are_read() {
    let json = serde_json::json!({
        "cam_K": [[500, 0, 300], [0, 500, 200], [0, 0, 1]], "cam_kc": [0, 0, 0, 0, 0],
        "proj_K": MATRIX, "proj_kc": LENS, "R": rotation(), "T": T,
    });
    let options = |camera: &str| Options {
        camera: Some(camera.into()),
        resolution: Some([640, 480]),
        ..Options::default()
    };
    same("a.json", &json.to_string(), &options("proj"));
    let first = read("a.json", json.to_string(), &options("cam")).unwrap();
    assert_eq!(built(&first).origin, glam::Vec3A::ZERO);
    let stereo = serde_json::json!({"K1": [[500, 0, 300], [0, 500, 200], [0, 0, 1]], "D1": [0, 0, 0, 0], "K2": MATRIX, "D2": LENS,
                                    "R": rotation(), "T": T});
    same("a.json", &stereo.to_string(), &options("2"));
    let unit = Options { metres_per_unit: Some(0.001), ..options("2") };
    let small = read("a.json", stereo.to_string(), &unit).unwrap();
    assert!(
        (built(&small).origin.length()
            - 0.001 * built(&same("a.json", &stereo.to_string(), &options("2"))).origin.length())
        .abs()
            < 1e-9
    );
}

#[test]
fn numpy_archives_are_read() {
    let matrix: Vec<f64> = MATRIX.concat();
    let column_major: Vec<f64> = transposed(MATRIX).concat();
    for (order, values) in [("False", &matrix), ("True", &column_major)] {
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(vec![]));
        let mut put = |name: &str, shape: &str, order: &str, values: &[f64], method| {
            let options = zip::write::SimpleFileOptions::default().compression_method(method);
            archive.start_file(name, options).unwrap();
            let header = format!("{{'descr': '<f8', 'fortran_order': {order}, 'shape': {shape}, }}");
            let header = format!("{header:<117}\n");
            archive.write_all(b"\x93NUMPY\x01\x00").unwrap();
            archive.write_all(&(header.len() as u16).to_le_bytes()).unwrap();
            archive.write_all(header.as_bytes()).unwrap();
            archive.write_all(&values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()).unwrap();
        };
        use zip::CompressionMethod as M;
        put("mtx.npy", "(3, 3)", order, values, M::Stored);
        put("dist.npy", "(1, 5)", "False", &LENS, M::Deflated);
        let [other, tvec] = [[9.0; 3], T];
        put("rvecs.npy", "(2, 3, 1)", "False", &[other, RVEC].concat(), M::Stored);
        put("tvecs.npy", "(2, 3, 1)", "False", &[other, tvec].concat(), M::Deflated);
        let bytes = archive.finish().unwrap().into_inner();
        let options = Options { view: Some(1), resolution: Some([640, 480]), ..Options::default() };
        let c = read("a.npz", bytes.clone(), &options).unwrap();
        let again = serde_json::json!({"K": MATRIX, "D": LENS, "rvec": RVEC, "tvec": T});
        assert_eq!(c.device, same("a.json", &again.to_string(), &options_of(&options)).device);
        let all = Options { view: None, ..options };
        let c = read("a.npz", bytes, &all).unwrap();
        assert!(c.notes.iter().any(|n| n.contains("--view 0 to 1")), "{:?}", c.notes);
    }
}

/// Returns options that select the first view.
fn options_of(options: &Options) -> Options {
    Options { view: Some(0), ..options.clone() }
}

#[test]
fn matlab_counts_from_one_and_has_row_vectors() {
    let [[fx, _, cx], [_, fy, cy], _] = MATRIX;
    let one = [[fx, 0.0, cx + 1.0], [0.0, fy, cy + 1.0], [0.0, 0.0, 1.0]];
    let rest = serde_json::json!({"RadialDistortion": [LENS[0], LENS[1], LENS[4]], "TangentialDistortion": [LENS[2], LENS[3]],
                                  "ImageSize": [480, 640], "Skew": 0});
    let with = |more: serde_json::Value| {
        let mut all = rest.clone();
        let table = all.as_object_mut().unwrap();
        table.extend(more.as_object().unwrap().clone());
        all
    };
    let millimetres = T.map(|x| x * 1000.0);
    let intrinsics =
        with(serde_json::json!({"FocalLength": [fx, fy], "PrincipalPoint": [cx + 1.0, cy + 1.0]}));
    let views = serde_json::json!({"Intrinsics": intrinsics, "WorldUnits": "millimeters", "PatternExtrinsics": [
        {"Dimensionality": 3, "R": rotation(), "Translation": millimetres}]});
    same("a.json", &views.to_string(), &Options::default());
    // Rotations of two views, of shape 3 × 3 × 2, as jsonencode writes them.
    let r = transposed(rotation());
    let stacked = r.map(|row| row.map(|x| [7.0, x]));
    let old = with(
        serde_json::json!({"IntrinsicMatrix": transposed(one), "WorldUnits": "mm", "RotationMatrices": stacked,
                                      "TranslationVectors": [[1, 2, 3], millimetres]}),
    );
    let second = Options { view: Some(1), ..Options::default() };
    same("a.json", &serde_json::json!({ "cameraParams": old }).to_string(), &second);
    let extrinsics = with(serde_json::json!({"K": one, "RotationMatrix": r, "TranslationVector": T}));
    same("a.json", &extrinsics.to_string(), &Options::default());
}

#[test]
fn kalibr_chains_are_read() {
    let four = |r: [[f64; 3]; 3], t: [f64; 3]| {
        let rows: Vec<String> =
            (0..3).map(|i| format!("  - [{}, {}, {}, {}]", r[i][0], r[i][1], r[i][2], t[i])).collect();
        format!("{}\n  - [0.0, 0.0, 0.0, 1.0]\n", rows.join("\n"))
    };
    let camera = |transform: &str| {
        format!(
            "  camera_model: pinhole\n  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002]\n  distortion_model: radtan\n  \
             intrinsics: [600.0, 610.0, 319.5, 239.25]\n  resolution: [640, 480]\n  rostopic: /a/image_raw\n{transform}"
        )
    };
    let turn = DMat3::from_rotation_y(0.4);
    let (r, t) = (DMat3::from_cols_array_2d(&rotation()).transpose(), DVec3::from_array(T));
    // The last link of the chain is the total transform without the first link.
    let step = DVec3::new(0.1, 0.0, 0.0);
    let last = r * turn.transpose();
    let rows = |m: DMat3| m.transpose().to_cols_array_2d();
    let text = format!(
        "cam0:\n  cam_overlaps: [1]\n{}cam1:\n{}cam2:\n{}",
        camera(""),
        camera(&format!("  T_cn_cnm1:\n{}", four(rows(turn), step.to_array()))),
        camera(&format!("  T_cn_cnm1:\n{}", four(rows(last), (t - last * step).to_array())))
    );
    let options = Options { camera: Some("cam2".into()), ..Options::default() };
    let c = read("a.yaml", text.clone(), &options).unwrap();
    let want = serde_json::json!({"K": MATRIX, "dist": &LENS[..4], "R": rotation(), "T": T, "resolution": [640, 480]});
    let want = built(&read("a.json", want.to_string(), &Options::default()).unwrap());
    let got = built(&c);
    assert!(
        (got.origin - want.origin).length() < 1e-6 && (got.axes.z_axis - want.axes.z_axis).length() < 1e-6
    );
    assert_eq!((got.principal, got.distortion), (want.principal, want.distortion));
    let e = read("a.yaml", text.clone(), &Options::default()).unwrap_err();
    assert!(e.help.unwrap().contains("cam0, cam1, cam2"));
    let equi = text.replace("radtan", "equidistant").replace("0.001, -0.002]", "0.0, 0.0]");
    let c = read("a.yaml", equi, &options).unwrap();
    assert_eq!(c.device.fisheye.as_deref(), Some(&[-0.1, 0.02, 0.0, 0.0]));
    let e = read("a.yaml", text.replace("pinhole", "omni"), &options).unwrap_err();
    assert!(e.to_string().contains("omni") && e.line_column().is_some(), "{e}");
}

#[test]
fn ros_has_no_pose() {
    let text = "image_width: 640\nimage_height: 480\ncamera_name: a\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
                data: [600, 0, 319.5, 0, 610, 239.25, 0, 0, 1]\ndistortion_model: plumb_bob\n\
                distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.02, 0.001, -0.002, 0.003]\n\
                rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n\
                projection_matrix:\n  rows: 3\n  cols: 4\n  data: [600, 0, 319.5, 0, 0, 610, 239.25, 0, 0, 0, 1, 0]\n";
    let c = read("a.yaml", text, &Options::default()).unwrap();
    assert_eq!(c.device.opencv.as_ref().map(|k| k.to_vec()), Some(LENS.to_vec()));
    assert_eq!(built(&c).origin, glam::Vec3A::ZERO);
    let message = serde_json::json!({"width": 640, "height": 480, "distortion_model": "plumb_bob", "d": LENS, "k": MATRIX.concat(),
        "r": [1, 0, 0, 0, 1, 0, 0, 0, 1], "p": [600, 0, 319.5, 0, 0, 610, 239.25, 0, 0, 0, 1, 0]});
    let c = read("a.json", message.to_string(), &Options::default()).unwrap();
    assert!(c.notes.iter().any(|n| n.contains("rectifies")), "{:?}", c.notes);
}

#[test]
fn errors_name_their_position() {
    let good = "K: [[600, 0, 320], [0, 600, 240], [0, 0, 1]]\nD: [0.1, 0, 0, 0, 0]\nsize: [640, 480]\nR: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\nt: [0, 0, 1]\n";
    assert!(read("a.yaml", good, &Options::default()).is_ok());
    let cases = [
        (
            "[[600, 0, 320], [0, 600, 240], [0, 0, 1]]",
            "[[600, 0, 0], [0, 600, 0], [320, 240, 1]]",
            "1:1",
            "MATLAB",
        ),
        ("[600, 0, 320]", "[600, 2, 320]", "1:1", "skew"),
        ("[0.1, 0, 0, 0, 0]", "[0.1, 0, 0]", "2:1", "coefficients: 3"),
        ("[0.1, 0, 0, 0, 0]", "[0.1, .nan, 0, 0]", "2:1", "expected an array"),
        ("[640, 480]", "[640.5, 480]", "3:1", "640.5"),
        ("size: [640, 480]", "", "", "--resolution"),
        ("[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "", "reflection"),
        ("[0.1, 0, 0, 0, 0]", "[-9.1, 0, 0, 0, 0]", "", "two directions to one pixel"),
        ("D: [0.1", "D: [&a 0.1, *a", "2:13", "alias"),
        ("D:", "K:", "", "duplicate key"),
        ("K:", "k_nothing:", "", "camera matrix is missing"),
        ("t: [0, 0, 1]", "t: [0, 0, 1, 0, 0, 1]", "4:1", "poses of 2 views"),
    ];
    for (from, to, place, expected) in cases {
        assert!(good.contains(from));
        let options = Options { view: expected.contains("poses").then_some(0), ..Options::default() };
        let e = read("a.yaml", good.replacen(from, to, 1), &options).expect_err(expected);
        let e = e.to_string();
        assert!(
            e.contains(expected)
                && e.starts_with(&format!("a.yaml{}{place}", if place.is_empty() { "" } else { ":" })),
            "{e}"
        );
    }
    for (name, bytes) in [
        ("a.json", &b"{"[..]),
        ("a.npz", b"PK"),
        ("a.yaml", b"a: [1\n"),
        ("a.yaml", b"\xff"),
        ("a.yaml", b""),
    ] {
        assert!(read(name, bytes, &Options::default()).is_err(), "{name}");
    }
}

#[test]
fn printed_calibrations_are_tables_of_a_scene() {
    let json = serde_json::json!({"K": MATRIX, "D": LENS, "R": rotation(), "t": T, "resolution": [640, 480]});
    let c = read("a.json", json.to_string(), &Options::default()).unwrap();
    let scene: syntax::scene::SceneFile = toml::from_str(&c.to_toml(false).unwrap()).unwrap();
    assert_eq!(*scene.camera, c.device);
    let both = c.to_toml(false).unwrap() + &c.to_toml(true).unwrap();
    let scene: syntax::scene::SceneFile = toml::from_str(&both).unwrap();
    assert_eq!(*scene.projector.unwrap(), ProjectorFile::from(c.device));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..Default::default() })]

    /// Tests that mutated files are read or refused without a panic.
    #[test]
    fn mutated_files_do_not_panic(which in 0..4_usize, changes in prop::collection::vec((0.0..1.0_f64, any::<u8>(), 0..4_u8), 1..6)) {
        let json = serde_json::json!({"K": MATRIX, "D": LENS, "rvecs": [RVEC, RVEC], "tvecs": [T, T], "resolution": [640, 480]}).to_string();
        let matlab = serde_json::json!({"FocalLength": [600, 600], "PrincipalPoint": [320, 240], "ImageSize": [480, 640],
            "RadialDistortion": [0.1, 0], "RotationMatrices": [[[1, 1], [0, 0], [0, 0]], [[0, 0], [1, 1], [0, 0]], [[0, 0], [0, 0], [1, 1]]],
            "TranslationVectors": [[0, 0, 1], [0, 0, 2]]}).to_string();
        let kalibr = "cam0:\n  intrinsics: [600, 600, 320, 240]\n  resolution: [640, 480]\n  distortion_model: radtan\n  distortion_coeffs: [0.1, 0, 0, 0]\n\
                      cam1:\n  intrinsics: [600, 600, 320, 240]\n  resolution: [640, 480]\n  T_cn_cnm1:\n  - [1, 0, 0, 1]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n";
        let opencv = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
                      data: [ 600., 0., 320., 0., 600., 240., 0., 0., 1. ]\n";
        let (name, text) = [("a.json", json.as_str()), ("a.json", &matlab), ("a.yaml", kalibr), ("a.yaml", opencv)][which];
        let mut bytes = text.as_bytes().to_vec();
        for (place, byte, how) in changes {
            let at = (place * bytes.len() as f64) as usize;
            match how {
                0 if at < bytes.len() => bytes[at] = byte,
                1 if at < bytes.len() => { bytes.remove(at); }
                2 => bytes.insert(at.min(bytes.len()), b"[]{}:,-&*!%\n 0129.e\"'#|>"[usize::from(byte) % 24]),
                _ => bytes.truncate(at.max(1)),
            }
        }
        let options = Options { view: Some(1), camera: name.ends_with("yaml").then(|| "cam1".into()), ..Options::default() };
        for options in [&options, &Options::default()] {
            if let Ok(c) = read(name, bytes.clone(), options) {
                prop_assert!(c.to_toml(false).is_ok());
            }
        }
    }
}
