//! Implements `calibration = "FILE"` of a camera or projector, which reads resolution, lens and pose from a
//! calibration file.

use super::context::Context;
use super::devices::{pinhole, pinhole_of};
use base::calibration_file;
use base::locate::{InputError, Located};
use serde::Deserialize;
use std::ops::Range;
use syntax::device::{PinholeFile, ProjectorFile};
use syntax::scene::SceneFile;

const FIX: &str = "give a file written by `sunstone calibrate board` or `sunstone calibrate projector`; paths are relative to the scene file";

/// Camera and projector tables of a calibration file.
#[derive(Deserialize)]
struct Document {
    camera: Option<Located<PinholeFile>>,
    projector: Option<Located<ProjectorFile>>,
}

/// Replaces devices that name a calibration file with the devices in that file.
///
/// The scene hash covers the values taken from the file, not the file's bytes.
///
/// # Errors
/// Returns [`InputError`] at the key if the calibration file cannot be read, lacks the device or conflicts
/// with other keys. If the calibration file is invalid, the error is located in the calibration file.
pub(crate) fn expand(ctx: &Context, file: SceneFile) -> Result<SceneFile, InputError> {
    let mut out = file;
    if out.camera.calibration.is_some() {
        let span = out.camera.span();
        let device = camera(ctx, &out.camera)?;
        out.camera = Located::at(span, device);
    }
    if let Some(place) = &out.projector
        && let Some(key) = &place.calibration
    {
        let whole = projector(ctx, place, key)?;
        out.projector = Some(Located::at(place.span(), whole));
    }
    Ok(out)
}

fn camera(ctx: &Context, given: &PinholeFile) -> Result<PinholeFile, InputError> {
    let Some(key) = &given.calibration else {
        return Ok(given.clone());
    };
    let (document, within) = read(ctx, key)?;
    let Some(found) = document.camera else {
        return Err(ctx.error(key.span(), format!("{} has no [camera] table", **key), FIX));
    };
    let nested = found.calibration.as_ref().map(Located::span);
    sound(&within, &found, found.span(), nested)?;
    overlaid(ctx, key, &found, given)
}

fn projector(
    ctx: &Context,
    given: &ProjectorFile,
    key: &Located<String>,
) -> Result<ProjectorFile, InputError> {
    if given.coaxial {
        return Err(ctx.error(
            key.span(),
            "a coaxial projector cannot have `calibration`: the camera defines the pose, the resolution and the lens",
            "remove `calibration` from [projector], and set it in [camera]",
        ));
    }
    let (document, within) = read(ctx, key)?;
    let Some(found) = document.projector else {
        return Err(ctx.error(
            key.span(),
            format!("{} has no [projector] table", **key),
            "calibrate the projector together with the camera: sunstone calibrate projector",
        ));
    };
    let nested = found.calibration.as_ref().map(Located::span);
    let device = pinhole_of(&found);
    sound(&within, &device, found.span(), nested)?;
    let device = overlaid(ctx, key, &device, &pinhole_of(given))?;
    Ok(ProjectorFile { irradiance: given.irradiance.clone(), ..ProjectorFile::new(device) })
}

/// Returns the tables of a calibration file and the context for errors in the calibration file.
fn read(ctx: &Context, key: &Located<String>) -> Result<(Document, Context), InputError> {
    let unreadable = |e: &dyn std::fmt::Display| {
        ctx.error(key.span(), format!("cannot read {}: {e}", ctx.path(key).display()), FIX)
    };
    let bytes = ctx.peek(key, u64::MAX).map_err(|e| unreadable(&e))?;
    let text = String::from_utf8(bytes).map_err(|e| unreadable(&e))?;
    let path = ctx.path(key);
    let document = calibration_file::parse(&path, &text, FIX)?;
    let wavelengths = Located::nowhere(ctx.listed.nm().to_vec());
    Ok((document, Context::new(&path, &text, &wavelengths)?))
}

/// Checks the device of a calibration file. The error of an invalid device is located in the calibration
/// file.
fn sound(
    within: &Context,
    device: &PinholeFile,
    span: Range<usize>,
    nested: Option<Range<usize>>,
) -> Result<(), InputError> {
    if let Some(at) = nested {
        return Err(within.error(
            at,
            "a calibration file cannot refer to another calibration",
            "set the path of that other file in the scene",
        ));
    }
    pinhole(within, device, span).map(|_| ())
}

/// Returns the calibrated device after replacing pose and aperture with those of the scene.
fn overlaid(
    ctx: &Context,
    key: &Located<String>,
    found: &PinholeFile,
    given: &PinholeFile,
) -> Result<PinholeFile, InputError> {
    let lens = PinholeFile {
        calibration: None,
        resolution: Located::default(),
        aperture: None,
        pose: Located::default(),
        ..given.clone()
    };
    if lens != PinholeFile::default() {
        return Err(ctx.error(
            key.span(),
            "the lens is given both by `calibration` and by another key",
            "with `calibration`, set only pose, aperture and (for a projector) irradiance, and remove all other keys",
        ));
    }
    let (size, own) = (*found.resolution, *given.resolution);
    if own != [0, 0] && own != size {
        return Err(ctx.error(
            key.span(),
            format!(
                "`resolution` is {} × {} pixels, but the calibration has {} × {} pixels",
                own[0], own[1], size[0], size[1]
            ),
            "remove `resolution`, or calibrate with images of this size",
        ));
    }
    // The values of the calibration have been checked, so no later error refers to their locations.
    Ok(PinholeFile {
        calibration: None,
        orthographic_width: None,
        aperture: given.aperture.clone().or_else(|| found.aperture.clone()),
        pose: if given.has_pose() { given.pose.clone() } else { found.pose.clone() },
        ..found.clone()
    })
}

#[cfg(test)]
mod tests {
    use crate::from_text;
    use proptest::prelude::*;
    use std::path::Path;
    use transport::scene::Scene;

    const CAMERA: &str = "resolution = [8, 6]\nopencv_matrix = [[9.5, 0, 3.25], [0, 9.25, 2.5], [0, 0, 1]]\nopencv = [-0.1, 0.02, 0, 0, 0]\n\
                          pose.extrinsics = { R = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], t = [0, 0, 0] }\n";
    const PROJECTOR: &str = "resolution = [6, 4]\nopencv_matrix = [[7, 0, 2.5], [0, 7, 1.5], [0, 0, 1]]\n\
                             pose.extrinsics = { R = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], t = [0.1, 0.2, 0.3] }\n";
    const REST: &str = "[quality]\nviews = 3\n[covariance]\nrows = []\n[detector.cmos]\nread_noise_e = 2\n[sensor]\nkind = \"intensity\"\n";
    const BY_KEY: &str = "[camera]\ncalibration = \"sub/c.toml\"\n[projector]\nirradiance = 2.0\ncalibration = \"sub/c.toml\"\n";

    fn document() -> String {
        format!("[camera]\n{CAMERA}[projector]\n{PROJECTOR}{REST}")
    }

    fn scene(text: &str, calibration: &str) -> Result<Scene, String> {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(folder.path().join("sub")).expect("a folder");
        std::fs::write(folder.path().join("sub/c.toml"), calibration).expect("writes");
        from_text(&folder.path().join("s.toml"), text).map_err(|e| e.to_string())
    }

    /// A scene that refers to a calibration file has the same hash as a scene that contains the same tables.
    #[test]
    fn referenced_tables_equal_copied_tables() {
        let copied = format!("[camera]\n{CAMERA}[projector]\nirradiance = 2.0\n{PROJECTOR}");
        let named = scene(BY_KEY, &document()).expect("a scene");
        let same = scene(&copied, "").expect("a scene");
        assert_eq!(named.sha256, same.sha256);
        let principal = |s: &Scene| s.projector.as_ref().map(|p| p.pinhole.principal);
        assert_eq!(named.camera.focal, same.camera.focal);
        assert_eq!(principal(&named), principal(&same));
        // A change of another table in the file does not change the hash, but a change of the camera does.
        let other = document().replace("views = 3", "views = 4");
        assert_eq!(scene(BY_KEY, &other).expect("a scene").sha256, same.sha256);
        let other = document().replace("9.25", "9.26");
        assert_ne!(scene(BY_KEY, &other).expect("a scene").sha256, same.sha256);
        // A pose in the scene overrides the pose of the calibration.
        let placed = BY_KEY
            .replace("[projector]", "pose.look_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n[projector]");
        assert_eq!(scene(&placed, &document()).expect("a scene").camera.origin.z, 5.0);
    }

    #[test]
    fn errors_name_file_and_position() {
        let same = ["", ""];
        let [camera, projector] = [format!("[camera]\n{CAMERA}"), format!("[projector]\n{PROJECTOR}")];
        let in_camera = |line: &str| format!("{line}\n[projector]");
        for (in_scene, in_file, words) in [
            (same, ["[camera]", "[photo]"], "c.toml:1:2: unknown key `photo`"),
            (same, [&camera, ""], "s.toml:2:15: sub/c.toml has no [camera]"),
            (same, [&projector, ""], "s.toml:5:15: sub/c.toml has no [projector]"),
            (
                same,
                ["[0, 9.25", "[1, 9.25"],
                "c.toml:3:17: opencv_matrix is [[9.5, 0.0, 3.25], [1.0, 9.25, 2.5], [0.0, 0.0, 1.0]], which is not a camera matrix",
            ),
            (
                same,
                ["resolution = [8, 6]", "calibration = \"d.toml\""],
                "c.toml:2:15: a calibration file cannot refer",
            ),
            (["c.toml", "d.toml"], same, "s.toml:2:15: cannot read"),
            (
                ["[projector]", &in_camera("fov_x_deg = 40")],
                same,
                "s.toml:2:15: the lens is given both by `calibration`",
            ),
            (
                ["[projector]", &in_camera("resolution = [8, 7]")],
                same,
                "s.toml:2:15: `resolution` is 8 × 7 pixels",
            ),
            (["irradiance", "coaxial = true\nirradiance"], same, "s.toml:6:15: a coaxial projector"),
            ([BY_KEY, "[camera]\nfov_x_deg = 4\n"], same, "s.toml:1:1: missing key `resolution`"),
        ] {
            let edited = |text: &str, [from, to]: [&str; 2]| text.replace(from, to);
            let message =
                scene(&edited(BY_KEY, in_scene), &edited(&document(), in_file)).err().expect("a fault");
            assert!(message.contains(words) && message.contains("fix:"), "{words}: {message}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn damaged_text_never_panics(text in "[ -~\n]{0,40}", at in 0_usize..400) {
            let mut whole = document();
            whole.insert_str(at.min(whole.len()), &text);
            let _ = scene(BY_KEY, &whole);
        }

        /// Tests that names that are not calibration files do not panic.
        #[test]
        fn arbitrary_names_never_panic(name in "[a-z./ *]{0,12}") {
            let _ = crate::from_text(Path::new("/nowhere/s.toml"), &format!("[camera]\ncalibration = \"{name}\"\n"));
        }
    }
}
