//! Reads files written with OpenCV (`cv::FileStorage`, JSON, numpy.savez) and ROS, by their common key names.

use super::document::Document;
use super::found::{Found, Lens, Options};
use super::names::Node;
use base::locate::InputError;
use syntax::device::ExtrinsicsFile;

const MATRIX: [&str; 9] = [
    "camera_matrix",
    "K",
    "mtx",
    "M",
    "intrinsic_matrix",
    "intrinsics_matrix",
    "intrinsic",
    "cam_mtx",
    "camera_mtx",
];
const LENS: [&str; 9] = [
    "distortion_coefficients",
    "dist_coeffs",
    "dist_coefs",
    "distortion_coeffs",
    "dist",
    "D",
    "kc",
    "distortion",
    "cam_dist",
];
const ROTATION: [&str; 3] = ["R", "rotation_matrix", "rot"];
const ROTATION_VECTOR: [&str; 4] = ["rvec", "rvecs", "rotation_vector", "rotation_vectors"];
const TRANSLATION: [&str; 6] =
    ["T", "tvec", "tvecs", "translation", "translation_vector", "translation_vectors"];

pub(super) fn read(document: &Document, options: &Options) -> Result<Found, InputError> {
    let root = Node::root(document);
    let camera = choose(&root, options)?;
    let mut notes = vec![];
    let named = |names: &[&str]| camera.any(names);
    let matrix = matrix(&camera)?;
    let ros = named(&["projection_matrix", "P"]).is_some();
    let model = named(&["distortion_model"]).and_then(|m| m.text().map(str::to_ascii_lowercase));
    let lens = match named(&LENS) {
        None => Lens::None,
        Some(node) => lens(&node, model.as_deref(), fisheye(&camera, options), &mut notes)?,
    };
    if matches!(lens, Lens::None) {
        notes.push("The file has no lens distortion.".into());
    }
    let size =
        match (named(&["image_size", "img_size", "resolution", "size"]), named(&["image_width", "width"])) {
            (Some(both), _) => Some(both.size()?),
            (None, Some(w)) => match named(&["image_height", "height"]) {
                Some(h) => Some(w.pixels(w.number()?, h.number()?)?),
                None => None,
            },
            _ => None,
        };
    let pose = if ros {
        if named(&ROTATION).is_some() || named(&["rectification_matrix"]).is_some() {
            notes.push("R of a ROS camera_info rectifies images and is not a pose, so R was ignored.".into());
        }
        None
    } else {
        pose(&camera, options, &mut notes)?
    };
    Ok(Found { matrix, lens, size, pose, unit: None, notes })
}

/// The part of a document that describes a camera: the root, the root's only camera table or the selected
/// table. An affix is a prefix or a suffix of the key names, such as `proj_` in `proj_K` or `2` in `K2`.
struct Camera<'a> {
    node: Node<'a>,
    affix: Option<String>,
}

impl<'a> Camera<'a> {
    fn any(&self, names: &[&str]) -> Option<Node<'a>> {
        let Some(affix) = &self.affix else {
            return self.node.any(names);
        };
        let with: Vec<String> =
            names.iter().flat_map(|n| [format!("{affix}{n}"), format!("{n}{affix}")]).collect();
        let with: Vec<&str> = with.iter().map(String::as_str).collect();
        self.node.any(&with)
    }
}

fn choose<'a>(root: &Node<'a>, options: &Options) -> Result<Camera<'a>, InputError> {
    let whole = |node: Node<'a>| Camera { node, affix: None };
    let is_camera = |node: &Node| node.any(&MATRIX).is_some() || node.any(&["fx"]).is_some();
    let tables = || {
        let keys = root.table().filter(|(_, v)| v.is_object()).map(|(k, _)| k);
        keys.filter_map(|k| root.get(k)).filter(is_camera)
    };
    if let Some(name) = &options.camera {
        if let Some(node) = root.get(name).filter(is_camera) {
            return Ok(whole(node));
        }
        let camera = Camera { node: root.clone(), affix: Some(name.clone()) };
        // Names without letters and digits would match any key.
        let says = name.chars().any(|c| c.is_ascii_alphanumeric());
        if says && camera.any(&MATRIX).is_some() {
            return Ok(camera);
        }
        return Err(root.error(
            &format!("unknown camera `{name}`"),
            "give the name of a table, or the prefix or suffix of K and D, such as --camera cam0, --camera 2 or --camera proj",
        ));
    }
    if is_camera(root) {
        return Ok(whole(root.clone()));
    }
    let found: Vec<Node> = tables().collect();
    match &found[..] {
        [one] => Ok(whole(one.clone())),
        [] => Err(root.error(
            "the camera matrix is missing",
            "name the matrix camera_matrix, cameraMatrix, K or mtx, or select a prefix or suffix with --camera (2 for K2, proj for proj_K)",
        )),
        several => {
            let names: Vec<&str> = several.iter().filter_map(|n| n.keys.last()).map(String::as_str).collect();
            Err(root.error(
                "the file has several cameras",
                &format!("choose one of the cameras with --camera: {}", names.join(", ")),
            ))
        }
    }
}

fn matrix(camera: &Camera) -> Result<[[f64; 3]; 3], InputError> {
    if let Some(node) = camera.any(&MATRIX) {
        return checked(&node, node.matrix::<3>()?);
    }
    let number = |names: &[&str]| match camera.any(names) {
        Some(node) => node.number(),
        None => Err(camera.node.error(&format!("{} is missing", names[0]), "give fx, fy, cx and cy")),
    };
    let (fx, cx) = (number(&["fx"])?, number(&["cx", "ppx"])?);
    let (fy, cy) = (number(&["fy"])?, number(&["cy", "ppy"])?);
    Ok([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
}

/// Checks that a camera matrix has OpenCV's form: not transposed, and without skew.
pub(super) fn checked(node: &Node, m: [[f64; 3]; 3]) -> Result<[[f64; 3]; 3], InputError> {
    if m[2] != [0.0, 0.0, 1.0] || m[1][0] != 0.0 {
        return Err(node.error(
            &format!("expected a camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {m:?}"),
            "for a transposed matrix of MATLAB, use the key IntrinsicMatrix, which also converts MATLAB's pixel coordinates",
        ));
    }
    if m[0][1] != 0.0 {
        let message = format!("a camera matrix with a skew of {} is not supported", m[0][1]);
        return Err(node.error(&message, "calibrate without skew"));
    }
    Ok(m)
}

fn fisheye(camera: &Camera, options: &Options) -> bool {
    let flag = camera.node.any(&["fisheye_model", "fisheye"]);
    let set = flag.is_some_and(|f| f.value.as_bool().unwrap_or_else(|| f.number().is_ok_and(|n| n != 0.0)));
    options.fisheye || set
}

/// Returns the lens distortion in the model that `model` names, or in the model that `fisheye` selects.
pub(super) fn lens(
    node: &Node,
    model: Option<&str>,
    fisheye: bool,
    notes: &mut Vec<String>,
) -> Result<Lens, InputError> {
    let k = node.array()?.values;
    let is_fisheye = match model {
        Some("fisheye" | "equidistant" | "kannala_brandt" | "kannala_brandt4") => true,
        Some("plumb_bob" | "rational_polynomial" | "radtan" | "opencv" | "brown_conrady") => false,
        Some("none" | "") | None => fisheye,
        Some(other) => {
            return Err(node.error(
                &format!("unsupported distortion model `{other}`"),
                "use plumb_bob, radtan, rational_polynomial, equidistant or fisheye",
            ));
        }
    };
    if is_fisheye {
        let count = k.len();
        return match k.try_into() {
            Ok(k) => Ok(Lens::Fisheye(k)),
            Err(_) => Err(node.error(
                &format!("a fisheye model requires 4 coefficients, but the file has {count} coefficients"),
                "calibrate with cv2.fisheye, or omit --fisheye",
            )),
        };
    }
    match k.len() {
        0 => Ok(Lens::None),
        4 | 5 | 8 | 12 | 14 => {
            if k.len() == 4 && model.is_none() {
                notes.push("The four coefficients are interpreted as k1, k2, p1, p2; for k1 to k4 of a fisheye model, pass --fisheye.".into());
            }
            Ok(Lens::Opencv(k))
        }
        n => Err(node.error(
            &format!("unsupported number of coefficients: {n}"),
            "give 4, 5, 8, 12 or 14 coefficients in OpenCV's order: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tau_x, tau_y]]]]",
        )),
    }
}

fn pose(
    camera: &Camera,
    options: &Options,
    notes: &mut Vec<String>,
) -> Result<Option<ExtrinsicsFile>, InputError> {
    let first = matches!(camera.affix.as_deref(), Some("1" | "cam" | "cam_" | "left" | "l" | "0"));
    let own = |names: &[&str]| {
        let shared = || (camera.affix.is_some() && !first).then(|| camera.node.any(names)).flatten();
        camera.any(names).or_else(shared)
    };
    let rotation = own(&ROTATION).or_else(|| own(&ROTATION_VECTOR));
    let (Some(rotation), Some(translation)) = (rotation, own(&TRANSLATION)) else {
        if first && camera.node.any(&TRANSLATION).is_some() {
            notes.push("R and T belong to the other device; the world is the frame of this device.".into());
        }
        return Ok(None);
    };
    let t = translation.array()?;
    if t.values.len() == 16 {
        return Err(translation.error(
            "the direction of a 4 × 4 pose is ambiguous (world to camera, or camera to world)",
            "give R and t of the map x_camera = R x_world + t",
        ));
    }
    let views = t.values.len() / 3;
    let count = if options.view.is_none() { views.max(1) } else { views };
    let Some(view) = options.view_of(count, &translation, notes)? else {
        return Ok(None);
    };
    // For several views, the first axis of each array is the view.
    let part = |node: &Node, size: usize| -> Result<Vec<f64>, InputError> {
        let all = node.array()?.values;
        let one = all.chunks_exact(size).nth(view).map(<[f64]>::to_vec);
        match one {
            Some(one) if all.len() == views.max(1) * size => Ok(one),
            _ => Err(node.error(
                &format!(
                    "expected {} numbers for the poses of {views} views, got {} numbers",
                    views.max(1) * size,
                    all.len()
                ),
                "give a rotation and a translation for each view",
            )),
        }
    };
    let is_matrix = rotation.array()?.values.len() == 9 * views.max(1);
    let mut pose = ExtrinsicsFile::default();
    let three = |v: &[f64]| [v[0], v[1], v[2]];
    let tvec = three(&part(&translation, 3)?);
    if is_matrix {
        let r = part(&rotation, 9)?;
        pose.rotation = Some([three(&r), three(&r[3..]), three(&r[6..])]);
        pose.t = Some(tvec);
    } else {
        pose.rvec = Some(three(&part(&rotation, 3)?));
        pose.tvec = Some(tvec);
    }
    Ok(Some(pose))
}
