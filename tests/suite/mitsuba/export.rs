//! Tests that the export refuses features that Mitsuba lacks, and names these features. Tests that the export
//! does not change non-empty folders.

use super::{ALL, exported, folder};
use sunstone::scene::mitsuba::export::Export;

/// Replacements of a passage of [`ALL`], each with words that the error message must contain.
const INEXPRESSIBLE: &[(&str, &str, &str)] = &[
    ("cx = 13.5", "cx = 13.5\nfx = 30\nfy = 31", "non-square pixels of the camera"),
    ("cx = 13.5", "cx = 13.5\ndistortion.k1 = 0.01", "distortion of the camera"),
    ("irradiance = 2.5", "irradiance = 2.5\ncx = 3", "off-centre principal point"),
    (
        "albedo = 0.3",
        "albedo = 0.3\nx.crystal = { name = \"quartz\", axis = [0, 0, 1] }",
        "a crystal (material `x`)",
    ),
    (
        "albedo = 0.3",
        "albedo = 0.3\nx.coated_conductor = { metal = \"Ag\", films = [] }",
        "thin films on a conductor",
    ),
    (
        "albedo = 0.3",
        "albedo = 0.3\nx.partial_depolarizer = { material = \"grey\", fraction = 0.5 }",
        "a partial depolarizer",
    ),
    ("tilt = \"cosine\"", "tilt = \"plate\"", "dependence of the retardance"),
    ("tilt = \"cosine\"", "tilt = \"constant\"", "dependence of the retardance"),
    ("angle_deg = -20", "axis = [1, 0, 0]", "an axis in world space (material `retarder`)"),
    ("angle_deg = 33", "axis = [1, 0, 0]", "an axis in world space (material `polarizer`)"),
    ("angle_deg = 33", "extinction = 0.01", "a polarizer with extinction"),
    ("specular = 0.7", "interreflection = true", "interreflection"),
    ("specular = 0.7", "single_scatter = { albedo = 0.1, alpha = 0.5 }", "single scattering"),
    ("image = \"normals.png\"", "image = \"normals.png\", strength = 2", "the strength of a normal map"),
    ("front = \"rough\", back", "front = \"glass\", back", "one side of this material (material `glass`)"),
    ("material = \"plastic\"\n[[", "material = \"polarizer\"\n[[", "a disk with an anisotropic material"),
    (
        "{ radius = 0.4 }",
        "{ radius = 0.4 }\ntransform = { scale = [1, 2, 1] }\nname = \"egg\"",
        "an ellipsoid",
    ),
    (
        "material = \"spotted\"",
        "material = \"spotted\"\ntransform = { scale = [1, 2, 1], rotate_deg = [0, 0, 50] }",
        "elliptic or oblique",
    ),
    (
        "wavelengths_nm = [550]",
        "wavelengths_nm = [450, 550]",
        "wavelength-dependent refractive index (material `frosted`)",
    ),
    ("irradiance = 2.5", "irradiance = [1, 2]", "a non-square projector"),
];

#[test]
fn features_missing_in_mitsuba_are_refused_by_name() {
    let folder = folder();
    let mut wrong = vec![];
    for (from, to, message) in INEXPRESSIBLE {
        let mut text = ALL.replacen(from, to, 1);
        assert_ne!(text, ALL, "{from}");
        if to.starts_with("albedo") {
            text = text.replacen("material = \"worn\"", "material = \"x\"", 1);
        }
        if to.contains("egg") {
            text = text.replacen(
                "\ntransform = { scale = 1.1, rotate_deg = [10, 20, 30], translate = [-1, 0, 0] }",
                "",
                1,
            );
        }
        if to.contains("[1, 2]") {
            text = text.replacen("wavelengths_nm = [550]", "wavelengths_nm = [450, 550]", 1).replacen(
                "\"N-BK7\"",
                "1.5",
                1,
            );
        }
        if to.contains("fx = 30") {
            text = text.replacen("fov_x_deg = 42\n", "", 1);
        }
        match exported(folder.path(), &text) {
            Err(e) if e.message.contains(message) && e.line_column().is_some() && e.help.is_some() => {}
            other => wrong.push((*message, other.map(|_| ()).map_err(|e| e.to_string()))),
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn colours_of_images_need_one_wavelength() {
    let folder = folder();
    image::RgbImage::from_fn(4, 3, |x, _| image::Rgb([50 * x as u8, 20, 90]))
        .save(folder.path().join("tiles.png"))
        .unwrap();
    let text =
        ALL.replace("wavelengths_nm = [550]", "wavelengths_nm = [450, 660]").replace("\"N-BK7\"", "1.5");
    let e = exported(folder.path(), &text).unwrap_err();
    assert!(e.message.contains("image of colours"), "{e}");
    let path = folder.path().join("scene.toml");
    Export::from_text(&path, &text, Some(660.0)).unwrap();
}

#[test]
fn model_differences_are_noted() {
    let folder = folder();
    let text = ALL.replace("masking = \"separable\"", "masking = \"correlated\"");
    let notes = exported(folder.path(), &text).unwrap().notes.join("\n");
    for word in [
        "`frosted`: Mitsuba's roughdielectric",
        "`rough`: Mitsuba uses separable masking",
        "retarder",
        "twosided",
        "`bumpy`",
    ] {
        assert!(notes.contains(word), "{word}: {notes}");
    }
    let notes = exported(folder.path(), ALL).unwrap().notes.join("\n");
    assert!(!notes.contains("masking"), "{notes}");
}

#[test]
fn existing_files_are_replaced_only_on_request() {
    let folder = folder();
    let export = exported(folder.path(), ALL).unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    export.write(&out, false).unwrap();
    assert!(out.join("table.pbsdf").exists());
    std::fs::write(out.join("mine.txt"), "mine").unwrap();
    std::fs::write(out.join("scene.xml"), "old").unwrap();
    assert!(export.write(&out, false).is_err());
    assert_eq!(std::fs::read_to_string(out.join("scene.xml")).unwrap(), "old");
    export.write(&out, true).unwrap();
    assert_eq!(std::fs::read_to_string(out.join("scene.xml")).unwrap(), export.xml);
    assert_eq!(std::fs::read_to_string(out.join("mine.txt")).unwrap(), "mine");
    // If the export cannot copy a file, it writes no files.
    std::fs::remove_file(folder.path().join("table.pbsdf")).unwrap();
    let fresh = folder.path().join("fresh");
    assert!(export.write(&fresh, false).is_err());
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(!left.iter().any(|n| n.to_string_lossy().starts_with('.') || n == "fresh"), "{left:?}");
}
