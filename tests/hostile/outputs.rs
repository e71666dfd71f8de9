//! Replaces every output with an input, a folder, a device, a pipe, a URL, a wrong name, or an impossible
//! path.

use super::case::{Case, Expect, Put};

/// The outputs of the commands. Each entry has:
/// - the command with `{o}` in place of the output
/// - the output's extension, `/` for a folder or `zarr` for a store
/// - the argument that names an input that the command could overwrite
#[rustfmt::skip]
pub const WRITERS: &[(&str, &str, &str)] = &[
    ("render {i} -o {o} --no-figures", "zarr", "scene.toml"),
    ("merge {i} {f}/t.zarr -o {o} --force", "zarr", "s.zarr"),
    ("denoise {i} -o {o} --force", "zarr", "s.zarr"),
    ("denoise {f}/t.zarr {i} -o {o} --force", "zarr", "s.zarr"),
    ("probe {i} mueller -o {o} --force", "zarr", "s.zarr"),
    ("probe {f}/s.zarr lit --pattern {i} -o {o}", "npy", "mask.png"),
    ("probe {f}/s.zarr lit --pattern {i} -o {o}", "csv", "mask.png"),
    ("figure {i} -o {o}", "/", "s.zarr"),
    ("figure {i} --view photo --slice mueller -o {o}", "png", "s.zarr"),
    ("figure {i} --view photo --slice mueller -o {o}", "svg", "s.zarr"),
    ("figure {i} --view photo --slice mueller -o {o}", "pdf", "s.zarr"),
    ("figure {i} --preview --renders renders -o {o}", "png", "figure.toml"),
    ("figure {i} --preview --renders renders -o {o}", "svg", "figure.toml"),
    ("layers {i} -o {o}", "npz", "scene.toml"),
    ("export {i} mueller -o {o}", "exr", "s.zarr"),
    ("export {i} --mitsuba {o}", "/", "scene.toml"),
    ("import {i} -o {o} --force", "toml", "mitsuba/scene.xml"),
    ("import {i} -o {o} --force", "toml", "calibration.yaml"),
    ("decompose {i} -o {o}", "npz", "M.npy"),
    ("decompose {f}/M.npy --errors {i} -o {o}", "npz", "E.npy"),
    ("capture {i} --scheme {f}/drr36.toml -o {o}", "npy", "M.npy"),
    ("capture {f}/M.npy --scheme {i} -o {o}", "npy", "drr36.toml"),
    ("capture {f}/M.npy --scheme {f}/drr36.toml --detector {i} --variance {o} -o out.npy", "npy", "camera.toml"),
    ("reconstruct {i} --scheme {f}/drr36.toml -o {o}", "npy", "I.npy"),
    ("reconstruct {f}/I.npy --scheme {f}/drr36.toml --variance {i} -o {o}", "npy", "V.npy"),
    ("reconstruct {i} --scheme {f}/drr36.toml -o out.npy --errors {o}", "npy", "I.npy"),
    ("trial {i} --scheme {f}/drr36.toml -o {o}", "csv", "M.npy"),
    ("trial {i} --scheme {f}/drr36.toml --figure {o}", "png", "M.npy"),
    ("trial {f}/M.npy --scheme {i} --curve {o}", "svg", "drr36.toml"),
    ("rig run {i} --rig {f}/rig.toml -o {o}", "zarr", "plan.toml"),
    ("rig flash {i} --rig {f}/lab.toml -o {o}", "/", "plan.toml"),
    ("rig calibrate {i} -o {o}", "toml", "mirror.zarr"),
    ("reconstruct {i} -o {o} --mask full", "npy", "night.zarr"),
    ("reconstruct {i} -o {o} --force", "zarr", "night.zarr"),
    ("ptu histogram {i} -o {o}", "npy", "photons.ptu"),
    ("ptu write {i} -o {o} --record timeharp-260-p-t3 --period-ps 100000", "ptu", "events.csv"),
    ("calibrate patterns --projector 6x4 -o {o}", "/", ""),
    ("scheme drr -k 16 -o {o}", "toml", ""),
    ("scheme qrpr -k 16 -o {o}", "toml", ""),
    ("scheme lc -k 16 -o {o}", "toml", ""),
    ("scheme matrix {i} -o {o}", "npy", "drr36.toml"),
    ("scheme plot {i} -o {o}", "png", "drr36.toml"),
    ("learn --template {i} --starts 1 --iterations 1 --adam-steps 1 -o {o}", "toml", "drr36.toml"),
    ("learn --template {i} --starts 1 --iterations 1 --adam-steps 1 -o out.toml --csv {o}", "csv", "drr36.toml"),
    ("learn --template {i} --starts 1 --iterations 1 --adam-steps 1 -o out.toml --angles {o}", "png", "drr36.toml"),
    ("learn -k 9 --data {f}/tables --bands 550 --folds 0 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --save-prior {o}", "toml", ""),
    ("pbrdf sheet {i} -o {o} --size 8 --spp 1", "png", "materials.toml"),
    ("pbrdf synth {i} -o {o} --resolution 3x3x3 --bands 550", "/", "materials.toml"),
    ("pbrdf plot {i} -o {o}", "png", "table.pbsdf"),
    ("pbrdf slice {i} -o {o}", "npy", "table.pbsdf"),
    ("pbrdf slice {i} -o {o}", "csv", "table.pbsdf"),
    ("pbrdf pca --data {f}/tables --bands 550 -o {o}", "png", ""),
    ("pbrdf pca --data {f}/tables --bands 550 -o out.png --npz {o}", "npz", ""),
    ("pbrdf pca --data {f}/tables --bands 550 -o out.png --prior {o}", "toml", ""),
    ("phase eval {i} -o {o}", "csv", "media.toml"),
];

/// Commands with two outputs at the same path.
#[rustfmt::skip]
const TWICE: &[&str] = &[
    "reconstruct {f}/I.npy --scheme {f}/drr36.toml -o out.npy --errors ./out.npy",
    "reconstruct {f}/I.npy --scheme {f}/drr36.toml -o out.npy --errors new/../out.npy",
    "capture {f}/M.npy --scheme {f}/drr36.toml --detector {f}/camera.toml -o out.npy --variance out.npy",
    "trial {f}/M.npy --scheme {f}/drr36.toml --figure out.png --curve ./out.png",
    "pbrdf pca --data {f}/tables --bands 550 -o out.png --prior a.toml --npz ../at/out.png",
    "learn -k 9 --data {f}/tables --bands 550 --folds 0 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --save-prior ./out.toml",
];

/// Extensions that few or no commands write.
const EXTENSIONS: [&str; 8] = ["tif", "jpg", "h5", "hdr", "gif", "npy", "csv", "toml"];

pub fn named(extension: &str) -> String {
    match extension {
        "/" => "out".into(),
        e => format!("o.{e}"),
    }
}

pub fn cases() -> Vec<Case> {
    let mut cases = vec![];
    for (line, extension, input) in WRITERS {
        let name = input.rsplit('/').next().unwrap_or_default();
        let make = |what: &str, output: &str| {
            let name_of_case = format!("{line}: .{extension} is {what}");
            let mut case = Case::new(name_of_case, &line.replace("{i}", name));
            // An empty name is not a word of a command line, so the output is inserted after the line is
            // split.
            case.arguments.iter_mut().for_each(|a| *a = a.replace("{o}", output));
            if input.is_empty() { case } else { case.put(name, Put::Copy(input)) }
        };
        let out = named(extension);
        let store = *extension == "zarr";
        let folder = *extension == "/" || store;
        cases.push(make("new", &out).expect(Expect::Accepted));
        cases.push(make("in a new folder", &format!("a/b/{out}")).expect(Expect::Accepted));
        let writes_below_addresses = ["render ", "merge "].iter().any(|l| line.starts_with(l));
        let (address, page) = if writes_below_addresses && !cfg!(feature = "object-stores") {
            let fix = "--features object-stores";
            (make("an address", &format!("s3://bucket/{out}")).says(fix), fix)
        } else if writes_below_addresses {
            // The commands `render` and `merge` write to URLs, but not to URLs with the scheme `nowhere`.
            (make("an address", &format!("nowhere://bucket/{out}")).says("s3://"), "read only")
        } else {
            (make("an address", &format!("s3://bucket/{out}")).says("address"), "address")
        };
        cases.push(address);
        cases.push(make("a web page", &format!("https://example.org/{out}")).says(page));
        cases.push(make("empty", ""));
        cases.push(make("a dash", "-"));
        cases.push(make("/dev/full", "/dev/full"));
        cases.push(make("a link to /dev/full", &out).put(out.clone(), Put::Link("/dev/full")));
        cases.push(make("a pipe", &out).put(out.clone(), Put::Fifo));
        cases.push(make("below a file", &format!("f/{out}")).put("f", Put::Text("x".into())));
        let mut nowhere = make("in /proc", &format!("/proc/{out}")).expect(Expect::Failed);
        // Outputs that the program wrote before the failure are valid.
        nowhere.may_leave = &["out.", "renders"];
        cases.push(nowhere);
        if folder {
            cases.push(make("a file", &out).put(out.clone(), Put::Text("precious".into())));
        } else {
            cases.push(make("a folder", &out).put(out.clone(), Put::Folder));
        }
        if !line.contains("t.zarr") {
            let case = make("in another store", &format!("t.zarr/{out}"));
            cases.push(case.put("t.zarr", Put::Copy("t.zarr")));
        }
        if store {
            cases.push(
                make("a folder of something", &out).put(format!("{out}/f"), Put::Text("precious".into())),
            );
        }
        // The file name determines the format.
        let by_name = line.starts_with("probe") || line.starts_with("pbrdf slice");
        let known = |e: &str| e == *extension || by_name && ["npy", "csv"].contains(&e);
        for other in EXTENSIONS.iter().filter(|e| !known(e)) {
            cases.push(make(&format!("named .{other}"), &format!("o.{other}")));
        }
        if !input.is_empty() {
            cases.push(make("an input", name));
            cases.push(make("an input by way of the folder", &format!("../at/{name}")));
            cases.push(make("a link to an input", &out).put(out.clone(), Put::Link(name)));
        }
    }
    for line in TWICE {
        cases.push(Case::new(*line, line));
    }
    let own = |name: &str, line: &str| Case::new(format!("{name}: {line}"), line);
    for (name, line) in [
        ("in a store", "figure s.zarr -o s.zarr"),
        ("in a store", "figure s.zarr -o s.zarr/new"),
        ("in a store", "probe s.zarr mueller -o s.zarr/a.npy"),
        ("in a store", "export s.zarr mueller -o s.zarr/a.exr"),
        ("in a store", "capture s.zarr mueller --scheme {f}/drr36.toml -o s.zarr/I.npy"),
        ("a store", "figure {f}/figure.toml --preview --renders renders -o s.zarr/a.png"),
        ("there", "render {f}/scene.toml -o s.zarr --no-figures"),
    ] {
        cases.push(own(name, line).put("s.zarr", Put::Copy("s.zarr")));
    }
    cases.push(
        own("around the scene", "render s.zarr/scene.toml -o s.zarr --force --no-figures")
            .put("s.zarr", Put::Copy("s.zarr"))
            .put("s.zarr/scene.toml", Put::Copy("scene.toml")),
    );
    cases.push(
        own("its scenes", "figure {f}/figure.toml --preview --scenes scenes --renders scenes -o a.png")
            .put("scenes", Put::Folder),
    );
    // The command reports all faults before the first render.
    let apply = "apply metamerism --preview --seeds 1 --scenes scenes";
    for (renders, output) in [
        ("renders", "scenes"),
        ("renders", "scenes/fruits"),
        ("renders", "./scenes/../scenes"),
        ("renders", "link"),
        ("renders", "s.zarr"),
        ("renders", "s.zarr/out"),
        ("renders", "renders"),
        ("renders", "table.csv"),
        ("renders", "-"),
        ("renders", "s3://bucket/out"),
        ("renders", "/dev/full"),
        ("renders", "file/out"),
        ("scenes", "out"),
        ("s.zarr", "out"),
        ("file", "out"),
        ("https://example.org/renders", "out"),
    ] {
        let line = format!("{apply} --renders {renders} -o {output}");
        let case = own("of an application", &line)
            .put("scenes", Put::Copy("scenes"))
            .put("link", Put::Link("scenes"))
            .put("s.zarr", Put::Copy("s.zarr"))
            .put("file", Put::Text("precious".into()));
        cases.push(case);
    }
    cases.push(
        own("its own", "pbrdf synth t/materials.toml -o t --resolution 3x3x3")
            .put("t/materials.toml", Put::Copy("materials.toml")),
    );
    cases
}
