//! Tests that the import uses, mentions in a note, or refuses every item of a Mitsuba scene. The test adds an
//! unknown item to every kind of element.

use super::imported;

/// A scene with every kind of element.
const WHOLE: &str = r#"<scene version="3.0.0">
<integrator type="aov"><string name="aovs" value="d:depth"/><integrator type="volpath"><integer name="max_depth" value="5"/></integrator></integrator>
<sensor type="thinlens"><float name="fov" value="40"/><float name="aperture_radius" value="0.01"/><float name="focus_distance" value="4"/>
<transform name="to_world"><lookat origin="0, 0, 9" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="8"/><rfilter type="gaussian"/></film>
<sampler type="independent"><integer name="sample_count" value="4"/></sampler></sensor>
<bsdf type="twosided" id="wall"><bsdf type="diffuse"><texture type="checkerboard" name="reflectance"><rgb name="color0" value="0.1"/></texture></bsdf></bsdf>
<bsdf type="twosided" id="pair"><bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf><bsdf type="plastic"></bsdf></bsdf>
<bsdf type="blendbsdf" id="mixed"><float name="weight" value="0.3"/><bsdf type="diffuse"></bsdf><bsdf type="conductor"><string name="material" value="Au"/></bsdf></bsdf>
<bsdf type="mask" id="part"><float name="opacity" value="0.3"/><bsdf type="roughplastic"></bsdf></bsdf>
<bsdf type="dielectric" id="glass"><float name="int_ior" value="1.5"/></bsdf>
<bsdf type="roughdielectric" id="frosted"></bsdf>
<bsdf type="thindielectric" id="pane"></bsdf>
<bsdf type="principled" id="disney"></bsdf>
<bsdf type="null" id="nothing"></bsdf>
<bsdf type="polarizer" id="sheet"></bsdf>
<bsdf type="retarder" id="plate"></bsdf>
<medium type="homogeneous" id="fog"><volume type="constvolume" name="sigma_t"><float name="value" value="0.5"/></volume><phase type="hg"><float name="g" value="0.4"/></phase></medium>
<shape type="sphere"><point name="center" x="2" y="0" z="0"/><ref id="glass"/><ref name="interior" id="fog"/></shape>
<shape type="rectangle"><transform name="to_world"><translate z="-3"/></transform><ref id="wall"/></shape>
<shape type="cylinder"><ref id="pair"/></shape>
<shape type="disk"><transform name="to_world"><translate z="-2"/></transform><bsdf type="diffuse"><spectrum type="uniform" name="reflectance"><float name="value" value="0.3"/></spectrum></bsdf></shape>
<shape type="cube"><transform name="to_world"><translate x="-4"/></transform><emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>
<shape type="obj"><string name="filename" value="tent.obj"/><transform name="to_world"><translate y="3"/></transform><ref id="mixed"/></shape>
<shape type="bsplinecurve"><string name="filename" value="curve.txt"/></shape>
<shape type="linearcurve"><string name="filename" value="curve.txt"/></shape>
<shape type="sdfgrid"><string name="filename" value="plane.vol"/></shape>
<shape type="merge"><shape type="sphere"><point name="center" x="9" y="0" z="0"/></shape></shape>
<shape type="shapegroup" id="group"><shape type="sphere"><point name="center" x="0" y="9" z="0"/></shape></shape>
<shape type="instance"><ref id="group"/></shape>
<emitter type="point"><point name="position" x="0" y="3" z="5"/><spectrum name="intensity" type="d65"></spectrum></emitter>
<emitter type="spot"></emitter>
<emitter type="directional"></emitter>
<emitter type="constant"></emitter>
<emitter type="projector"></emitter>
</scene>
"#;

/// Returns a folder with the files to which the scene refers.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("tent.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    std::fs::write(folder.path().join("curve.txt"), "9 0 9 1\n9 1 9 1\n9 2 9 1\n9 3 9 1\n").unwrap();
    let mut plane = b"VOL\x03".to_vec();
    [1_i32, 2, 2, 2, 1].iter().for_each(|v| plane.extend(v.to_le_bytes()));
    [0.0_f32; 6].iter().for_each(|v| plane.extend(v.to_le_bytes()));
    [[-1.0_f32; 4], [1.0; 4]].concat().iter().for_each(|v| plane.extend(v.to_le_bytes()));
    std::fs::write(folder.path().join("plane.vol"), plane).unwrap();
    folder
}

/// Items that no element accepts.
const ITEMS: [&str; 14] = [
    "<float name=\"zz\" value=\"1\"/>",
    "<integer name=\"zz\" value=\"1\"/>",
    "<boolean name=\"zz\" value=\"true\"/>",
    "<string name=\"zz\" value=\"a\"/>",
    "<rgb name=\"zz\" value=\"1\"/>",
    "<point name=\"zz\" x=\"1\" y=\"1\" z=\"1\"/>",
    "<transform name=\"zz\"></transform>",
    "<spectrum name=\"zz\" value=\"1\"/>",
    "<texture name=\"zz\" type=\"checkerboard\"/>",
    "<volume name=\"zz\" type=\"constvolume\"/>",
    "<phase type=\"isotropic\"/>",
    "<rfilter type=\"tent\"/>",
    "<film type=\"hdrfilm\"/>",
    "<ref name=\"zz\" id=\"nothing\"/>",
];

#[test]
fn unknown_items_are_noted_or_refused_everywhere() {
    let folder = folder();
    let whole = imported(folder.path(), WHOLE).unwrap();
    let tags = [
        "<scene",
        "<integrator",
        "<sensor",
        "<film",
        "<rfilter",
        "<sampler",
        "<bsdf",
        "<texture",
        "<spectrum type",
        "<spectrum name=\"intensity\" type",
        "<medium",
        "<volume",
        "<phase",
        "<shape",
        "<emitter",
    ];
    let (mut tried, mut silent) = (0, vec![]);
    for tag in tags {
        for (at, _) in WHOLE.match_indices(&format!("{tag} ")) {
            let end = at + WHOLE[at..].find('>').unwrap();
            for item in ITEMS {
                // Opens a self-closing element.
                let kind = &tag[1..];
                let text = match WHOLE[..end].strip_suffix('/') {
                    Some(start) => format!("{start}>{item}</{kind}{}", &WHOLE[end..]),
                    None => format!("{}>{item}{}", &WHOLE[..end], &WHOLE[end + 1..]),
                };
                tried += 1;
                match imported(folder.path(), &text) {
                    Ok(import) if import.toml == whole.toml && import.notes == whole.notes => {
                        silent.push((WHOLE[at..end].to_owned(), item));
                    }
                    _ => {}
                }
            }
        }
    }
    assert!(silent.is_empty(), "{silent:#?}");
    assert!(tried > 500, "{tried}");
}

/// Tests each known item that affects Mitsuba's image. The item must change the scene, produce a note, or be
/// refused.
#[test]
fn known_items_are_never_ignored_silently() {
    let folder = folder();
    let whole = imported(folder.path(), WHOLE).unwrap();
    for (element, item) in [
        ("<integrator type=\"volpath\">", "<boolean name=\"hide_emitters\" value=\"true\"/>"),
        ("<integrator type=\"volpath\">", "<integer name=\"rr_depth\" value=\"9\"/>"),
        ("<sensor type=\"thinlens\">", "<float name=\"principal_point_offset_x\" value=\"0.1\"/>"),
        ("<film type=\"hdrfilm\">", "<integer name=\"crop_width\" value=\"5\"/>"),
        ("<emitter type=\"spot\">", "<float name=\"sampling_weight\" value=\"0\"/>"),
        ("<emitter type=\"spot\">", "<float name=\"cutoff_angle\" value=\"9\"/>"),
        ("<emitter type=\"spot\">", "<texture type=\"checkerboard\" name=\"texture\"/>"),
        ("<emitter type=\"directional\">", "<vector name=\"direction\" x=\"1\" y=\"0\" z=\"0\"/>"),
        ("<emitter type=\"projector\">", "<float name=\"scale\" value=\"3\"/>"),
        ("<emitter type=\"point\">", "<transform name=\"to_world\"/>"),
        ("<shape type=\"obj\">", "<boolean name=\"face_normals\" value=\"true\"/>"),
        ("<shape type=\"obj\">", "<boolean name=\"flip_normals\" value=\"true\"/>"),
        ("<shape type=\"cylinder\">", "<boolean name=\"flip_normals\" value=\"true\"/>"),
        ("<shape type=\"cube\">", "<boolean name=\"flip_normals\" value=\"true\"/>"),
        ("<shape type=\"sphere\">", "<boolean name=\"flip_normals\" value=\"true\"/>"),
        ("<shape type=\"rectangle\">", "<ref name=\"exterior\" id=\"fog\"/>"),
        ("<medium type=\"homogeneous\" id=\"fog\">", "<float name=\"scale\" value=\"3\"/>"),
        ("<medium type=\"homogeneous\" id=\"fog\">", "<boolean name=\"sample_emitters\" value=\"false\"/>"),
        (
            "<spectrum type=\"uniform\" name=\"reflectance\">",
            "<float name=\"wavelength_min\" value=\"600\"/>",
        ),
    ] {
        let text = WHOLE.replacen(element, &format!("{element}{item}"), 1);
        assert_ne!(text, WHOLE, "{element}");
        if let Ok(import) = imported(folder.path(), &text) {
            assert!(import.toml != whole.toml || import.notes != whole.notes, "{element} {item}");
        }
    }
}
