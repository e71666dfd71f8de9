//! Reads MATLAB's cameraParameters and cameraIntrinsics as written by `jsonencode`. The reader also accepts a
//! struct with the properties of either class.
//!
//! MATLAB counts pixels from 1, so MATLAB's principal point equals OpenCV's principal point plus 1. MATLAB's
//! older matrices are for row vectors: IntrinsicMatrix is [fx 0 0; s fy 0; cx cy 1] and
//! x_camera = x_world·R + t. The newer `K`, and R of rigidtform3d in PatternExtrinsics, are for column
//! vectors.

use super::document::Document;
use super::found::{Found, Lens, Options};
use super::names::Node;
use super::opencv;
use base::locate::InputError;
use syntax::device::ExtrinsicsFile;

const NAMES: [&str; 4] = ["FocalLength", "PrincipalPoint", "IntrinsicMatrix", "RadialDistortion"];

/// Returns the table with MATLAB's property names: the root, or the only table of the root that has these
/// names.
pub(super) fn find(document: &Document) -> Option<Node<'_>> {
    let is = |node: &Node| NAMES.iter().any(|n| node.get(n).is_some()) || node.get("Intrinsics").is_some();
    let root = Node::root(document);
    if is(&root) {
        return Some(root);
    }
    let mut inside = root.table().filter_map(|(k, _)| root.get(k)).filter(is);
    let first = inside.next()?;
    inside.next().is_none().then_some(first)
}

pub(super) fn read(_: &Document, camera: &Node, options: &Options) -> Result<Found, InputError> {
    let inner = camera.get("Intrinsics");
    let get = |key: &str| camera.get(key).or_else(|| inner.as_ref()?.get(key));
    let mut notes =
        vec!["MATLAB's pixel coordinates start at 1; 1 was subtracted from the principal point.".to_owned()];
    if let Some(skew) = get("Skew")
        && skew.number()? != 0.0
    {
        let message = format!("a skew of {} is not supported", skew.number()?);
        return Err(skew.error(&message, "calibrate without skew (EstimateSkew = false)"));
    }
    let matrix = if let (Some(f), Some(c)) = (get("FocalLength"), get("PrincipalPoint")) {
        let [cx, cy] = c.vector::<2>()?;
        let [fx, fy] = match f.array()?.values[..] {
            [one] => [one; 2],
            _ => f.vector::<2>()?,
        };
        [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    } else if let Some(node) = get("K") {
        opencv::checked(&node, node.matrix::<3>()?)?
    } else if let Some(node) = get("IntrinsicMatrix") {
        let m = node.matrix::<3>()?;
        let transposed = std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]));
        opencv::checked(&node, transposed)?
    } else {
        return Err(camera.error(
            "expected FocalLength and PrincipalPoint, or IntrinsicMatrix",
            "write jsonencode(cameraParams.Intrinsics), or a struct with these properties",
        ));
    };
    let [[fx, _, cx], [_, fy, cy], _] = matrix;
    let radial = get("RadialDistortion").map(|n| n.array()).transpose()?;
    let tangential = get("TangentialDistortion").map(|n| n.vector::<2>()).transpose()?;
    let [p1, p2] = tangential.unwrap_or_default();
    let lens = match radial.as_ref().map(|r| &r.values[..]) {
        None if tangential.is_none() => Lens::None,
        None => Lens::Opencv(vec![0.0, 0.0, p1, p2]),
        Some([k1, k2]) => Lens::Opencv(vec![*k1, *k2, p1, p2]),
        Some([k1, k2, k3]) => Lens::Opencv(vec![*k1, *k2, p1, p2, *k3]),
        Some(other) => {
            return Err(camera.error(
                &format!(
                    "RadialDistortion has {} coefficients, but 2 or 3 coefficients are expected",
                    other.len()
                ),
                "copy the coefficients from MATLAB",
            ));
        }
    };
    let size = match get("ImageSize") {
        Some(node) if node.value.as_array().is_none_or(|a| !a.is_empty()) => {
            // MATLAB's order is rows, columns.
            let [h, w] = node.vector::<2>()?;
            Some(node.pixels(w, h)?)
        }
        _ => None,
    };
    let unit = get("WorldUnits").and_then(|n| match n.text()? {
        "millimeters" | "mm" => Some(1e-3),
        "centimeters" | "cm" => Some(1e-2),
        "meters" | "m" => Some(1.0),
        "inches" | "in" => Some(0.0254),
        _ => None,
    });
    Ok(Found {
        matrix: [[fx, 0.0, cx - 1.0], [0.0, fy, cy - 1.0], [0.0, 0.0, 1.0]],
        lens,
        size,
        pose: pose(camera, options, &mut notes)?,
        unit,
        notes,
    })
}

fn pose(
    camera: &Node,
    options: &Options,
    notes: &mut Vec<String>,
) -> Result<Option<ExtrinsicsFile>, InputError> {
    let either = |a: &str, b: &str| camera.get(a).or_else(|| camera.get(b));
    let found = |rotation: [[f64; 3]; 3], t: [f64; 3]| {
        Some(ExtrinsicsFile { rotation: Some(rotation), t: Some(t), ..ExtrinsicsFile::default() })
    };
    let transposed = |m: [[f64; 3]; 3]| std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]));
    if let (Some(r), Some(t)) =
        (either("RotationMatrix", "rotationMatrix"), either("TranslationVector", "translationVector"))
    {
        notes.push("The rotation matrix was transposed (MATLAB uses row vectors).".into());
        return Ok(found(transposed(r.matrix::<3>()?), t.vector::<3>()?));
    }
    // MATLAB writes a single view as a table, and several views as a list of tables.
    let views = camera.get("PatternExtrinsics");
    let count = match (&views, camera.get("TranslationVectors")) {
        (Some(list), _) => list.value.as_array().map_or(1, Vec::len),
        (None, Some(t)) => t.array()?.values.len() / 3,
        (None, None) => 0,
    };
    let Some(view) = options.view_of(count, camera, notes)? else {
        return Ok(None);
    };
    if let Some(views) = views {
        let one = views.item(view).unwrap_or_else(|| views.clone());
        let (Some(r), Some(t)) = (one.get("R"), one.get("Translation")) else {
            let missing = if one.get("R").is_none() { "R" } else { "Translation" };
            return Err(one.error(
                &format!("view {view} has no {missing}"),
                "write the rigidtform3d objects with jsonencode",
            ));
        };
        return Ok(found(r.matrix::<3>()?, t.vector::<3>()?));
    }
    let (Some(r), Some(t)) = (camera.get("RotationMatrices"), camera.get("TranslationVectors")) else {
        return Err(camera.error("TranslationVectors is given without RotationMatrices", "give both"));
    };
    let (rotations, translations) = (r.array()?, t.array()?.values);
    // The shape is 3 × 3 × views, but MATLAB omits a last axis of length 1.
    if rotations.values.len() != 9 * count || rotations.shape.get(..2) != Some(&[3, 3]) {
        return Err(r.error(
            &format!(
                "the rotations must have the shape 3 × 3 × {count}, but the shape is {:?}",
                rotations.shape
            ),
            "give one rotation per view",
        ));
    }
    let m = std::array::from_fn(|i| std::array::from_fn(|j| rotations.values[(3 * i + j) * count + view]));
    notes.push("The rotation matrices were transposed (MATLAB uses row vectors).".into());
    let at = |k: usize| translations[3 * view + k];
    Ok(found(transposed(m), [at(0), at(1), at(2)]))
}
