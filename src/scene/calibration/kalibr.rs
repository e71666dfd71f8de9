//! Reads Kalibr's camera chains. They contain `cam0`, `cam1`, …, each with `intrinsics: [fu, fv, pu, pv]`.

use super::document::Document;
use super::found::{Found, Lens, Options};
use super::names::Node;
use super::opencv;
use base::locate::InputError;
use glam::DMat4;
use syntax::device::ExtrinsicsFile;

/// Returns the names and the values of the cameras of a camera chain, in order.
fn cameras(document: &Document) -> Vec<(String, Node<'_>)> {
    let root = Node::root(document);
    let number = |name: &str| name.strip_prefix("cam")?.parse::<u32>().ok();
    let mut found: Vec<(u32, String, Node)> = root
        .table()
        .filter_map(|(k, _)| Some((number(k)?, k.clone(), root.get(k)?)))
        .filter(|(.., node)| node.get("intrinsics").is_some())
        .collect();
    found.sort_by_key(|(n, ..)| *n);
    found.into_iter().map(|(_, k, node)| (k, node)).collect()
}

/// Returns whether a document is a camera chain.
pub(super) fn is(document: &Document) -> bool {
    !cameras(document).is_empty()
}

/// Reads a camera of a chain. The world frame is the frame of the first camera or of the IMU.
pub(super) fn read(document: &Document, options: &Options) -> Result<Found, InputError> {
    let cameras = cameras(document);
    let names: Vec<&str> = cameras.iter().map(|(k, _)| k.as_str()).collect();
    let choose = format!("choose one of the cameras with --camera: {}", names.join(", "));
    let root = Node::root(document);
    let at = match &options.camera {
        None if cameras.len() == 1 => 0,
        None => return Err(root.error("the file has several cameras", &choose)),
        Some(name) => names
            .iter()
            .position(|n| n == name)
            .ok_or_else(|| root.error(&format!("unknown camera `{name}`"), &choose))?,
    };
    let camera = &cameras[at].1;
    for key in ["camera_model", "distortion_model"] {
        if let Some(node) = camera.get(key).filter(|n| n.text().is_none_or(str::is_empty)) {
            return Err(node.error(
                &format!("`{key}` is not a name"),
                "use a name that Kalibr writes: pinhole, radtan, equidistant",
            ));
        }
    }
    let text = |key: &str| camera.get(key).and_then(|n| n.text().map(|t| (n.clone(), t)));
    if let Some((node, model)) = text("camera_model").filter(|(_, m)| *m != "pinhole") {
        return Err(node.error(
            &format!("unsupported camera model `{model}`"),
            "calibrate with a pinhole model: pinhole-radtan or pinhole-equi",
        ));
    }
    let Some(intrinsics) = camera.get("intrinsics") else {
        return Err(camera.error("`intrinsics` is missing", "give [fu, fv, pu, pv]"));
    };
    let [fu, fv, pu, pv] = intrinsics.vector::<4>()?;
    let mut notes = vec![
        "Pixel centres are interpreted as in OpenCV, because Kalibr uses OpenCV's corner detection."
            .to_owned(),
    ];
    let lens = match (text("distortion_model"), camera.get("distortion_coeffs")) {
        (Some((_, "none")), _) | (_, None) => Lens::None,
        (model, Some(node)) => opencv::lens(&node, model.map(|m| m.1), options.fisheye, &mut notes)?,
    };
    let size = camera.get("resolution").map(|n| n.size()).transpose()?;
    let pose = if options.imu {
        let Some(node) = camera.get("T_cam_imu") else {
            return Err(camera
                .error("`T_cam_imu` is missing", "omit --imu to use the first camera's frame as the world"));
        };
        notes.push("The world is the IMU's frame (T_cam_imu).".into());
        transform(&node)?
    } else {
        notes.push(format!("The world is the frame of {}.", names[0]));
        let mut whole = DMat4::IDENTITY;
        for (_, next) in &cameras[1..=at] {
            let Some(node) = next.get("T_cn_cnm1") else {
                return Err(next.error(
                    "`T_cn_cnm1` is missing",
                    "use the calibration of a camera chain, or pass --imu",
                ));
            };
            whole = transform(&node)? * whole;
        }
        whole
    };
    let rows = pose.transpose().to_cols_array_2d();
    Ok(Found {
        matrix: [[fu, 0.0, pu], [0.0, fv, pv], [0.0, 0.0, 1.0]],
        lens,
        size,
        pose: Some(ExtrinsicsFile {
            rotation: Some(std::array::from_fn(|i| std::array::from_fn(|j| rows[i][j]))),
            t: Some([rows[0][3], rows[1][3], rows[2][3]]),
            ..ExtrinsicsFile::default()
        }),
        // Kalibr's targets are in metres.
        unit: Some(1.0),
        notes,
    })
}

fn transform(node: &Node) -> Result<DMat4, InputError> {
    let rows = node.matrix::<4>()?;
    if rows[3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(node.error("not a rigid transform", "give a matrix with the last row 0, 0, 0, 1"));
    }
    Ok(DMat4::from_cols_array_2d(&rows).transpose())
}
