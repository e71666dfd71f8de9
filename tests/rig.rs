//! Tests interrupted sessions of the simulated rig. The tests kill or disturb runs and then resume the same
//! runs. The resulting stores are byte-identical to the store of an undisturbed run.
//!
//! `SUNSTONE_KILLS=200` sets the number of kills (CI: 24). `SUNSTONE_DAMAGE=10000` sets the number of damaged
//! runs (CI: 400). `-- --nocapture` prints the table of faults.

#[path = "rig/damage.rs"]
mod damage;

use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use sunstone::rig::session::image::Run;
use sunstone::rig::session::mueller::RunOptions;
use sunstone::store::zarr::frames::FrameStore;

const RIG: &str = "name = \"test\"
[stages.polarizer_1]
[stages.retarder_2]
backlash_deg = 0.1
[stages.retarder_3]
[stages.polarizer_4]
[projector]
size = [8, 6]
[camera]
size = [12, 10]
[geometry]
camera = { matrix = [[12, 0, 5.5], [0, 12, 4.5], [0, 0, 1]], distortion = [-0.1, 0.02, 0, 0] }
projector = { matrix = [[8, 0, 3.5], [0, 8, 2.5], [0, 0, 1]] }
rodrigues = [0, 0.05, 0]
translation = [0.2, 0.01, 0]
[laser]
nm = 550
[galvo]
[counter]
[bench]
sample = \"air\"
brightness = 0.3
wavelength_nm = 550
seed = 5
";

const CAMERA: &str = "
rig = \"rig.toml\"
scheme = { kind = \"quad\", captures = 6 }
[camera]
exposures_ms = [10, 40]
masks = [\"dark\", \"full\", { name = \"epipolar\", stripes = 3 }]
[limits]
saturated_share = 0.9
";

const SCAN: &str = "
rig = \"rig.toml\"
scheme = { kind = \"quad\", captures = 4 }
[scan]
points = [5, 4]
fov_x_deg = 10
dwell_ms = 2
bins = 64
bin_ps = 25
[limits]
laser_power = 0.9
";

/// Returns a plan of the same scan, recorded as time tags instead of histograms.
fn tagged() -> String {
    SCAN.replace("bin_ps = 25\n", "bin_ps = 25\ntime_tags = true\n")
}

/// A folder with the files of a rig, its plans and its faults.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new(faults: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("writes");
        write("camera.toml", CAMERA);
        write("scan.toml", SCAN);
        write("tags.toml", &tagged());
        write("rig.toml", &format!("{RIG}{faults}"));
        write("sound.toml", RIG);
        Self(folder)
    }

    fn write(&self, name: &str, text: impl AsRef<str>) {
        std::fs::write(self.path(name), text.as_ref()).expect("writes");
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, plan: &str, store: &str, rest: &[&str]) -> Command {
        let mut command = program();
        command.args(["rig", "run"]).arg(self.path(plan)).arg("-o").arg(self.path(store)).args(rest);
        command.stdin(Stdio::null());
        command
    }

    fn run(&self, plan: &str, store: &str, rest: &[&str]) -> Output {
        self.command(plan, store, rest).output().expect("runs")
    }

    /// Returns the content of a finished store, without the journal, which differs between runs.
    fn content(&self, store: &str) -> Vec<(PathBuf, Vec<u8>)> {
        let root = self.path(store);
        let verified = program().arg("verify").arg(&root).output().expect("runs");
        assert!(verified.status.success(), "{}", text(&verified));
        let mut files = vec![];
        let mut folders = vec![root.clone()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).expect("lists") {
                let path = entry.expect("an entry").path();
                let name = path.file_name().expect("a name").to_string_lossy().into_owned();
                if path.is_dir() {
                    folders.push(path);
                } else if name != ".session.jsonl" {
                    let bytes = std::fs::read(&path).expect("reads");
                    files.push((path.strip_prefix(&root).expect("inside").to_owned(), bytes));
                }
            }
        }
        files.sort();
        files
    }
}

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_sunstone"))
}

/// Asserts that a command ended with exit code `code` and a message that contains `words`.
fn refused(output: &Output, code: i32, words: &str) {
    let message = text(output);
    assert!(output.status.code() == Some(code) && message.contains(words), "{words}: {message}");
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn assert_same(a: &[(PathBuf, Vec<u8>)], b: &[(PathBuf, Vec<u8>)], what: &str) {
    let names = |files: &[(PathBuf, Vec<u8>)]| files.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(a), names(b), "{what}");
    for (a, b) in a.iter().zip(b) {
        assert!(a.1 == b.1, "{what}: {} differs", a.0.display());
    }
}

/// Returns the numbers of the frames that the journal records as taken.
fn noted(store: &Path) -> Vec<u32> {
    let text = std::fs::read_to_string(store.join(".session.jsonl")).expect("a journal");
    let events = text.lines().filter_map(|l| serde_json::from_str::<serde_json::Value>(l).ok());
    let frames = events.filter(|e| e["event"] == "frame");
    frames.map(|e| e["frame"].as_u64().expect("a number") as u32).collect()
}

/// Kills a run at random times and resumes the run. Tests that the store contains each frame exactly once.
#[test]
fn killed_runs_lose_no_frames() {
    let kills: u32 = std::env::var("SUNSTONE_KILLS").map_or(24, |n| n.parse().expect("a number"));
    let bench = Bench::new("");
    let mut killed = 0;
    let mut left = [0; 3];
    let mut round = 0;
    for plan in ["camera.toml", "scan.toml", "tags.toml"] {
        let begun = Instant::now();
        assert!(bench.run(plan, "whole.zarr", &["--force"]).status.success());
        let whole_takes = begun.elapsed();
        let whole = bench.content("whole.zarr");
        let mut here = 0;
        while here < kills.div_ceil(3) {
            let store = format!("{plan}{round}.zarr");
            // Resumes the run until the run finishes.
            let mut resumed = 0;
            loop {
                round += 1;
                let known = bench.path(&store).join("zarr.json").exists();
                let rest: &[&str] = if known { &["--resume"] } else { &["--force"] };
                let mut child = bench
                    .command(plan, &store, rest)
                    .stdout(Stdio::null())
                    .stderr(Stdio::null())
                    .spawn()
                    .expect("starts");
                // Spaces the times of the kills by the golden ratio within the duration of a run.
                let share = (f64::from(round) * 0.618_034).fract();
                std::thread::sleep(whole_takes.mul_f64(share * if resumed > 3 { 2.0 } else { 1.1 }));
                let _ = child.kill();
                let status = child.wait().expect("ends");
                if status.success() {
                    break;
                }
                assert_eq!(status.code(), None, "{store}: refused, not killed");
                here += 1;
                killed += 1;
                let path = bench.path(&store);
                let state = match (path.join("zarr.json").exists(), path.join("manifest.txt").exists()) {
                    (false, _) => 0,
                    (true, false) => 1,
                    (true, true) => 2,
                };
                left[state] += 1;
                if state == 1 && !path.join("frames/raw").exists() {
                    // The run had not begun before the kill, so there is nothing to resume.
                    let _ = std::fs::remove_dir_all(&path);
                }
                if state == 2 {
                    break;
                }
                resumed += 1;
            }
            assert_same(&bench.content(&store), &whole, &store);
            let mut frames = noted(&bench.path(&store));
            frames.sort_unstable();
            frames.dedup();
            assert_eq!(frames.len(), noted(&bench.path("whole.zarr")).len());
            std::fs::remove_dir_all(bench.path(&store)).expect("removes");
        }
    }
    println!("{killed} kills: nothing begun {}, unfinished {}, finished {}", left[0], left[1], left[2]);
    assert!(left[1] > 0, "no run was killed half way");
}

/// Faults of instruments. Each entry has the plan, the name of the fault, the instrument, and the time of the
/// fault. If the fault must end the session, the last field is a part of the message.
const FAULTS: &[(&str, &str, &str, u64, Option<&str>)] = &[
    ("camera.toml", "dropped_frame", "camera", 9, None),
    ("camera.toml", "timeout", "camera", 5, None),
    ("camera.toml", "short_frame", "camera", 11, None),
    ("camera.toml", "stale_frame", "camera", 12, None),
    ("camera.toml", "saturation", "camera", 7, None),
    ("camera.toml", "cable_out", "camera", 13, None),
    ("camera.toml", "cable_gone", "camera", 14, Some("connect the instrument and resume")),
    ("camera.toml", "power_cut", "camera", 15, None),
    ("camera.toml", "interlock", "camera", 16, Some("the interlock is open")),
    ("camera.toml", "clock_back", "camera", 17, None),
    ("camera.toml", "clock_forward", "camera", 18, None),
    ("camera.toml", "stall", "retarder_2", 3, None),
    ("camera.toml", "timeout", "retarder_3", 3, None),
    ("camera.toml", "cable_out", "retarder_2", 2, None),
    ("camera.toml", "power_cut", "retarder_3", 4, None),
    ("camera.toml", "cable_gone", "retarder_2", 4, Some("connect the instrument and resume")),
    ("camera.toml", "timeout", "projector", 6, None),
    ("camera.toml", "cable_out", "projector", 4, None),
    ("camera.toml", "disk_full", "disk", 8, Some("resume")),
    ("scan.toml", "disk_full", "disk", 33, Some("resume")),
    ("scan.toml", "laser_low", "galvo", 20, None),
    ("scan.toml", "dropped_frame", "counter", 9, None),
    ("scan.toml", "saturation", "counter", 10, None),
    ("scan.toml", "timeout", "galvo", 11, None),
    ("scan.toml", "cable_out", "counter", 12, None),
    ("scan.toml", "power_cut", "counter", 30, None),
    ("scan.toml", "interlock", "laser", 1, Some("the interlock is open")),
    ("scan.toml", "stall", "retarder_3", 3, None),
    ("scan.toml", "clock_back", "counter", 40, None),
    ("tags.toml", "disk_full", "disk", 33, Some("resume")),
    ("tags.toml", "dropped_frame", "counter", 9, None),
    ("tags.toml", "saturation", "counter", 10, None),
    ("tags.toml", "power_cut", "counter", 30, None),
];

/// Tests that after every fault the session recovers, or ends with one error without data loss. Tests that a
/// resumed run on an intact rig has the same bytes as an undisturbed run.
#[test]
#[ignore = "slow: tools/check --all"]
fn faults_lose_no_frames() {
    let sound = Bench::new("");
    let whole = |plan: &str| {
        let store = format!("{plan}.zarr");
        assert!(sound.run(plan, &store, &[]).status.success());
        sound.content(&store)
    };
    let whole = ["camera.toml", "scan.toml", "tags.toml"].map(|plan| (plan, whole(plan)));
    println!("{:12} {:14} {:11} {:>4}  outcome", "plan", "fault", "instrument", "at");
    for (plan, kind, instrument, at, ends) in FAULTS {
        let fault =
            format!("[[bench.faults]]\nkind = \"{kind}\"\ninstrument = \"{instrument}\"\nat = {at}\n");
        let bench = Bench::new(&fault);
        let begun = Instant::now();
        let output = bench.run(plan, "s.zarr", &[]);
        assert!(begun.elapsed() < Duration::from_secs(60), "{kind} takes too long");
        let shown = text(&output);
        let outcome = match ends {
            None => {
                assert!(output.status.success(), "{plan} {kind} of {instrument}: {shown}");
                let journal =
                    std::fs::read_to_string(bench.path("s.zarr/.session.jsonl")).expect("a journal");
                let event = ["retry", "suspend", "clock_jump"]
                    .into_iter()
                    .find(|e| journal.lines().any(|l| l.contains(&format!("\"event\":\"{e}\""))));
                // Checks that the fault occurred.
                format!(
                    "recovered: {}",
                    event.unwrap_or_else(|| panic!("{kind} of {instrument} left no trace"))
                )
            }
            Some(words) => {
                assert_eq!(output.status.code(), Some(1), "{kind} of {instrument}: {shown}");
                let last = shown.lines().find(|l| l.starts_with("error")).unwrap_or_default().to_owned();
                assert!(shown.contains(words), "{shown}");
                let again = bench.run(
                    plan,
                    "s.zarr",
                    &["--resume", "--rig", &bench.path("sound.toml").to_string_lossy()],
                );
                assert!(again.status.success(), "{kind}: {}", text(&again));
                format!("ended and resumed: {last}")
            }
        };
        let want = whole.iter().find(|(p, _)| p == plan).expect("a plan");
        assert_same(&bench.content("s.zarr"), &want.1, kind);
        println!("{plan:12} {kind:14} {instrument:11} {at:>4}  {outcome}");
    }
}

/// Tests that histograms of time tags are bit-identical to the histograms of a counter. Tests that `sunstone
/// ptu` computes the same histograms from the stored files.
#[test]
fn time_tags_give_the_same_histograms() {
    let bench = Bench::new("");
    assert!(bench.run("scan.toml", "counts.zarr", &[]).status.success());
    assert!(bench.run("tags.toml", "tags.zarr", &[]).status.success());
    let open = |name: &str| FrameStore::open(&bench.path(name)).expect("a store");
    let (counts, tags) = (open("counts.zarr"), open("tags.zarr"));
    let (width, rows) = (5, counts.layout().frames() / 5);
    let mut photons = 0;
    for row in 0..rows {
        let want = counts.read_chunk(row).expect("reads");
        assert_eq!(tags.read_chunk(row).expect("reads"), want, "row {row}");
        photons += want.iter().sum::<u32>();
        let file = bench.path(&format!("tags.zarr/time_tags/{row:06}.ptu"));
        let out = bench.path(&format!("row{row}.npy"));
        let words = ["ptu", "histogram", "--pixels", "5,1", "--pixel-marker", "1,2", "--channel", "0"];
        output_of(&words, &[&file, Path::new("-o"), &out]);
        let (shape, found) = counts_of(&out);
        let bins = *shape.last().expect("an axis");
        let frame = want.len() / width;
        for (x, point) in want.chunks_exact(frame).enumerate() {
            assert_eq!(&found[x * bins..x * bins + frame], point, "row {row}, point {x}");
        }
    }
    assert!(photons > 1000, "{photons} photons show nothing");
    // `verify` detects a damaged row of tags, and a missing row.
    output_of(&["verify"], &[&bench.path("tags.zarr")]);
    let file = bench.path("tags.zarr/time_tags/000003.ptu");
    let mut bytes = std::fs::read(&file).expect("reads");
    let last = bytes.len() - 6;
    bytes[last] ^= 1;
    std::fs::write(&file, bytes).expect("writes");
    let verify = |words: &str| {
        let mut command = program();
        let output = command.arg("verify").arg(bench.path("tags.zarr")).output().expect("runs");
        assert!(!output.status.success() && text(&output).contains(words), "{}", text(&output));
    };
    verify("000003.ptu");
    std::fs::remove_file(&file).expect("removes");
    verify("000003.ptu");
    // The requested number of bins exceeds the maximum of a time-tag record.
    let long = tagged().replace("bins = 64", "bins = 40000");
    bench.write("long.toml", long);
    let output = bench.run("long.toml", "long.zarr", &[]);
    refused(&output, 2, "long.toml:4:1");
    refused(&output, 2, "`bins` is 40000, but `time_tags` supports at most");
}

/// Returns the shape and the values of a stored array of unsigned 32-bit integers.
fn counts_of(path: &Path) -> (Vec<usize>, Vec<u32>) {
    let bytes = std::fs::read(path).expect("reads");
    let length = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let head = String::from_utf8_lossy(&bytes[10..length]).into_owned();
    assert!(head.contains("'<u4'"), "{head}");
    let inside = head.split_once("'shape': (").expect("a shape").1;
    let inside = inside.split_once(')').expect("its end").0;
    let shape = inside.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    let words = bytes[length..].as_chunks().0;
    (shape, words.iter().map(|b| u32::from_le_bytes(*b)).collect())
}

/// Tests that the program refuses two sessions on one path, a different plan, and a finished store. Tests
/// that each refusal has a message and changes no file.
#[test]
fn invalid_resumes_are_refused() {
    let bench = Bench::new("");
    assert!(bench.run("camera.toml", "s.zarr", &[]).status.success());
    let before = bench.content("s.zarr");
    for (rest, words) in [(&[][..], "already exists"), (&["--resume"][..], "already finished")] {
        let output = bench.run("camera.toml", "s.zarr", rest);
        refused(&output, 2, words);
    }
    let fault = "[[bench.faults]]\nkind = \"interlock\"\ninstrument = \"camera\"\nat = 20\n";
    let broken = Bench::new(fault);
    assert_eq!(broken.run("camera.toml", "s.zarr", &[]).status.code(), Some(1));
    let other = CAMERA.replace("captures = 6", "captures = 7");
    broken.write("camera.toml", other);
    let output = broken.run("camera.toml", "s.zarr", &["--resume"]);
    refused(&output, 2, "another plan");
    assert_same(&bench.content("s.zarr"), &before, "nothing touched");
}

/// Tests that the program reports a missing or invalid laser table with the location in the rig file.
#[test]
fn a_laser_without_a_table_is_refused() {
    let bench = Bench::new("");
    let rig = RIG.replace("[laser]\nnm = 550", "[laser]\ndriver = \"scpi\"\nnm = 550");
    bench.write("rig.toml", rig);
    let output = bench.run("scan.toml", "s.zarr", &[]);
    refused(&output, 2, "requires the key `table`");
    assert!(!bench.path("s.zarr").exists());
}

/// Tests that mirrors on an analog output card take the same frames as a simulated scanner. The card has 16
/// bits over ±10 V, at 0.8 V per degree. Tests that the session recovers from faults of the card.
#[test]
fn an_analog_galvo_takes_the_same_frames() {
    let sound = Bench::new("");
    assert!(sound.run("scan.toml", "s.zarr", &[]).status.success());
    let want = sound.content("s.zarr");
    let smooth = "driver = \"analog\"\nvolts_per_degree = 0.8\nspeed_deg_per_s = 20000\n";
    for fault in ["", "stall", "timeout", "cable_out", "power_cut"] {
        let mut rig = RIG.replace("[galvo]\n", &format!("[galvo]\n{smooth}"));
        if !fault.is_empty() {
            rig += &format!("[[bench.faults]]\nkind = \"{fault}\"\ninstrument = \"galvo\"\nat = 11\n");
        }
        let bench = Bench::new("");
        bench.write("rig.toml", rig);
        let output = bench.run("scan.toml", "s.zarr", &[]);
        assert!(output.status.success(), "{fault}: {}", text(&output));
        assert_same(&bench.content("s.zarr"), &want, fault);
        let journal = std::fs::read_to_string(bench.path("s.zarr/.session.jsonl")).expect("a journal");
        assert_eq!(journal.contains("\"event\":\"retry\""), !fault.is_empty(), "{fault}");
    }
    // A card with four bits sets coarser mirror angles, so the frames differ.
    let coarse = RIG.replace("[galvo]\n", &format!("[galvo]\n{smooth}card = {{ bits = 4 }}\n"));
    let bench = Bench::new("");
    bench.write("rig.toml", coarse);
    assert!(bench.run("scan.toml", "s.zarr", &[]).status.success());
    assert!(bench.content("s.zarr") != want, "pointing is of no matter");
    let checked = |rig: &str| {
        let bench = Bench::new("");
        bench.write("rig.toml", rig);
        let mut command = program();
        command.args(["rig", "check", "--move"]).arg(bench.path("scan.toml"));
        command.output().expect("runs")
    };
    let output = checked(&RIG.replace("[galvo]\n", &format!("[galvo]\n{smooth}")));
    assert!(output.status.success(), "{}", text(&output));
    for (galvo, words) in [
        ("driver = \"analog\"\nvolts_per_degree = 2", "reduce the range"),
        ("driver = \"analog\"\ncard = { bits = 0 }", "`card.bits` is 0, outside the supported range"),
        ("channels = [0, 1]", "applies only to driver"),
    ] {
        let output = checked(&RIG.replace("[galvo]\n", &format!("[galvo]\n{galvo}\n")));
        refused(&output, 2, words);
    }
}

/// Tests that, before the first capture, the program reports a missing counter library, and settings that no
/// board supports.
#[test]
fn a_counter_without_its_library_is_refused() {
    let bench = Bench::new("");
    for (counter, code, words) in [
        ("driver = \"vendor\"\nlibrary = \"absent/lib.so\"", 1, "TH260Lib package"),
        ("driver = \"vendor\"\nth260 = { sync_divider = 3 }", 2, "`sync_divider` must be 1, 2, 4 or 8"),
        ("library = \"lib.so\"", 2, "apply only to driver"),
    ] {
        let rig = RIG.replace("[counter]\n", &format!("[counter]\n{counter}\n"));
        bench.write("rig.toml", rig);
        let output = bench.run("scan.toml", "s.zarr", &[]);
        refused(&output, code, words);
        assert!(!bench.path("s.zarr").exists());
    }
}

/// Tests that the error for a camera that this build does not support names the Cargo feature to enable.
#[cfg(not(feature = "usb3_vision"))]
#[test]
fn a_camera_without_support_in_this_build_is_refused() {
    let bench = Bench::new("");
    let rig = RIG.replace("[camera]\n", "[camera]\ndriver = \"genicam\"\nserial = \"F-0001\"\n");
    bench.write("rig.toml", rig);
    let output = bench.run("camera.toml", "s.zarr", &[]);
    refused(&output, 1, "--features usb3_vision");
    assert!(!bench.path("s.zarr").exists());
}

/// Runs a command of the program, which must succeed, and returns its output.
fn output_of(words: &[&str], paths: &[&Path]) -> String {
    let mut command = program();
    command.args(words).args(paths);
    let output = command.output().expect("runs");
    assert!(output.status.success(), "{words:?}: {}", text(&output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Returns a value and its standard error from the line of a message that begins with `name`.
fn stated(message: &str, name: &str) -> [f64; 2] {
    let line = message.lines().find(|l| l.starts_with(name)).unwrap_or_else(|| panic!("{name}: {message}"));
    let words: Vec<f64> = line[name.len()..].split([' ', ',']).filter_map(|w| w.parse().ok()).collect();
    [words[0], words.get(1).copied().unwrap_or(f64::NAN)]
}

/// Scans a plane with a simulated counter. Tests that the scan gives the counter's response and time zero
/// within 5 sigma. Tests that the result is valid in rig files.
#[test]
fn a_scanned_plane_calibrates_the_counter() {
    let bench = Bench::new("");
    // The distance makes the light return in the middle of a bin.
    let metres = 266.5 * 25.0 * 299_792_458e-12 / 2.0;
    let scene = format!(
        "wavelengths_nm = [550]\n[camera]\nresolution = [4, 4]\nfov_x_deg = 1\n\
         pose.look_at = {{ origin = [0, 0, 0], target = [0, 0, -1], up = [0, 1, 0] }}\n\
         [projector]\ncoaxial = true\nirradiance = [1]\n[materials]\nwhite.diffuse.albedo = [0.8]\n\
         [[objects]]\nmaterial = \"white\"\nshape.rectangle = {{ corner = [-1, -1, {z}], u = [2, 0, 0], v = [0, 2, 0] }}\n\
         [[slices]]\nname = \"spatial\"\n",
        z = -metres
    );
    bench.write("plane.toml", scene);
    let sample = "sample = \"air\"\nbrightness = 0.3\n";
    let spad = "mode = \"synchronous\"\nphotons_per_unit = 2\ndark_counts_per_s = 2000\n";
    let detectors = format!(
        "[detector.spad]\n{spad}[bench.spad]\n{spad}irf_fwhm_ps = 61\nirf_tail = 0.3\nirf_tail_ps = 150\n"
    );
    let rig = RIG.replace(sample, "scene = \"plane.toml\"\nspp = 16\n") + &detectors;
    bench.write("rig.toml", &rig);
    let plan = SCAN.replace("points = [5, 4]", "points = [4, 4]").replace("fov_x_deg = 10", "fov_x_deg = 1");
    let plan = plan.replace("bins = 64", "bins = 400").replace("dwell_ms = 2", "dwell_ms = 20");
    bench.write("plan.toml", plan);
    let mut run = bench.command("plan.toml", "plane.zarr", &[]);
    let output = run.current_dir(bench.0.path()).output().expect("runs");
    assert!(output.status.success(), "{}", text(&output));
    let (store, out) = (bench.path("plane.zarr"), bench.path("counter.toml"));
    let distance = format!("--distance={metres}");
    let message = output_of(&["calibrate", "counter", &distance], &[&store, Path::new("-o"), &out]);
    println!("{message}");
    for (name, truth) in [("width (FWHM)", 61.0), ("tail fraction", 0.3), ("tail time constant", 150.0)] {
        let [value, sigma] = stated(&message.replace(" ps", "").replace('±', ""), name);
        assert!((value - truth).abs() < 5.0 * sigma && sigma < 0.1 * truth, "{name}: {value} ± {sigma}");
    }
    let found: toml::Table = std::fs::read_to_string(&out).expect("reads").parse().expect("TOML");
    let temporal: sunstone::rig::calibrate::temporal::zero::Temporal =
        found["temporal"].clone().try_into().expect("what the library writes");
    let z2: f64 = (0..16).map(|p| (temporal.zero_ps.at(p) / temporal.sigma_ps.at(p)).powi(2)).sum();
    // The tolerance of the sum over 16 squares is five standard deviations.
    assert!(z2 < 16.0 + 5.0 * 32.0_f64.sqrt(), "{z2}");
    // For a plane that is 3 mm nearer, time zeros are 20 ps late, and the test must detect this error.
    let wrong = format!("--distance={}", metres - 3e-3);
    let message =
        output_of(&["calibrate", "counter", &wrong], &[&store, Path::new("-o"), &bench.path("wrong.toml")]);
    let late = stated(&message.replace(" ps", ""), "time zero")[0];
    assert!((late - 20.01).abs() < 1.0, "{late}");
    bench.write("rig.toml", format!("calibration = [\"counter.toml\"]\n{rig}"));
    let mut again = bench.command("plan.toml", "again.zarr", &[]);
    assert!(again.current_dir(bench.0.path()).output().expect("runs").status.success());
    for (arguments, words) in [
        (
            vec!["calibrate", "counter", "--distance=1,2"],
            "got 2 values for 1 runs; pass one distance per run",
        ),
        (vec!["calibrate", "sensor"], "the run is a scan"),
    ] {
        let mut command = program();
        let output =
            command.args(&arguments).arg(&store).arg("-o").arg(bench.path("x.toml")).output().expect("runs");
        refused(&output, 2, words);
    }
}

/// Tests that dark and lit frames of a simulated camera give the gain, read noise, black level and dark
/// current of the camera.
#[test]
fn still_frames_calibrate_the_sensor() {
    let bench = Bench::new("");
    let elements = |kinds: &[(&str, &str)]| -> String {
        let one = |(side, name): &(&str, &str)| {
            let kind = name.split('_').next().expect("a kind");
            format!("[[{side}]]\nname = \"{name}\"\nkind = \"{kind}\"\nangle_deg = {:?}\n", [0.0; 32])
        };
        kinds.iter().map(one).collect()
    };
    let scheme = "name = \"still\"\nsensor = { kind = \"intensity\" }\n".to_owned()
        + &elements(&[
            ("generator", "polarizer_1"),
            ("generator", "retarder_2"),
            ("analyzer", "retarder_3"),
            ("analyzer", "polarizer_4"),
        ]);
    bench.write("still.toml", scheme);
    let levels = "[0.5, 1, 2, 3, 4, 6, 8, 10, 12, 14, 16, 18, 20, 24, 28, 40]";
    let plan = CAMERA
        .replace("scheme = { kind = \"quad\", captures = 6 }", "scheme = \"still.toml\"")
        .replace("[10, 40]", levels)
        .replace(", { name = \"epipolar\", stripes = 3 }", "")
        .replace("saturated_share = 0.9", "saturated_share = 1.0");
    bench.write("plan.toml", plan);
    let truth = "quantum_efficiency = 0.6\nphotons_per_unit = 6e6\nread_noise_e = 4.5\ndark_current_e_s = 300\nfull_well_e = 12000\n\
                 gain_e_per_dn = 3.2\nblack_level_dn = 40\n";
    let detectors = format!("[detector.cmos]\nphotons_per_unit = 6e6\n[bench.cmos]\n{truth}");
    bench.write("rig.toml", format!("{RIG}{detectors}"));
    let output = bench.run("plan.toml", "still.zarr", &[]);
    assert!(output.status.success(), "{}", text(&output));
    let out = bench.path("sensor.toml");
    let message = output_of(&["calibrate", "sensor"], &[&bench.path("still.zarr"), Path::new("-o"), &out]);
    println!("{message}");
    let plain = message
        .replace(['±'], "")
        .replace(" e/DN", "")
        .replace(" e/s", "")
        .replace(" DN", "")
        .replace(" e", "");
    for (name, truth) in [("gain", 3.2), ("read noise", 4.5)] {
        let [value, sigma] = stated(&plain, name);
        assert!((value - truth).abs() < 5.0 * sigma && sigma < 0.1 * truth, "{name}: {value} ± {sigma}");
    }
    // The standard errors are 0.006 DN for the mean black level and 8 e/s for the dark current, with 120
    // pixels, 32 frames and 16 exposures each.
    assert!((stated(&plain, "black level")[0] - 40.0).abs() < 0.05, "{message}");
    assert!((stated(&plain, "dark current")[0] - 300.0).abs() < 40.0, "{message}");
    let rig = format!("calibration = [\"sensor.toml\"]\n{RIG}{detectors}");
    bench.write("rig.toml", rig);
    assert!(bench.run("plan.toml", "again.zarr", &[]).status.success());
    let store = Run::open(&bench.path("again.zarr"), None).expect("a run");
    let believed = &store.attributes()["detector"]["cmos"];
    let gain = believed["gain_e_per_dn"].as_f64().expect("a number");
    assert!((gain - 3.2).abs() < 0.1, "{believed}");
    one_file_for_all(&bench, &out);
}

/// Adds the calibration of the polarizing elements to the file with the calibration of the sensor. Tests that
/// all readers of calibrations accept the combined file.
fn one_file_for_all(bench: &Bench, file: &Path) {
    let sensor = std::fs::read_to_string(file).expect("reads");
    let plan = CAMERA
        .replace("captures = 6", "captures = 25")
        .replace(", { name = \"epipolar\", stripes = 3 }", "")
        .replace("[10, 40]", "[10]");
    bench.write("full.toml", plan);
    for sample in ["air", "mirror"] {
        let store = format!("{sample}.zarr");
        assert!(bench.run("full.toml", &store, &["--sample", sample]).status.success());
    }
    let (air, mirror) = (bench.path("air.zarr"), bench.path("mirror.zarr"));
    output_of(&["rig", "calibrate"], &[&air, &mirror, Path::new("-o"), file]);
    let text = std::fs::read_to_string(file).expect("reads");
    let (all, before): (toml::Table, toml::Table) =
        (text.parse().expect("TOML"), sensor.parse().expect("TOML"));
    assert_eq!(all["radiometric"], before["radiometric"]);
    assert_eq!(all["detector"], before["detector"]);
    assert!(all["polarimetric"]["sigma"].as_array().is_some_and(|s| s.len() == 8));
    // Uses the calibration in schemes. All readings of a run without a sample are saturated.
    output_of(&["reconstruct", "--scheme"], &[file, &air, Path::new("-o"), &bench.path("m.zarr")]);
    // The scene of a reconstruction lists no figures.
    let figures = bench.path("m.figures");
    output_of(&["figure"], &[&bench.path("m.zarr"), Path::new("-o"), &figures]);
    assert!(std::fs::read_dir(figures).expect("figures").count() >= 2);
    let ones = bench.path("ones.npy");
    let unit: Vec<f32> = (0..16).map(|i| f32::from(u8::from(i % 5 == 0))).collect();
    sunstone::store::numpy::save(&ones, &[1, 1, 4, 4], &unit).expect("writes");
    let example = ["capture", "--scheme", "SCHEME", "--detector", "SCHEME"];
    let words: Vec<&str> =
        example.iter().map(|w| if *w == "SCHEME" { file.to_str().expect("a name") } else { *w }).collect();
    output_of(&words, &[&ones, Path::new("-o"), &bench.path("i.npy")]);
    // Uses the calibration in plans and rigs. A rig accepts a single name or a list of names.
    let plan = CAMERA.replace("{ kind = \"quad\", captures = 6 }", "\"sensor.toml\"");
    bench.write("again.toml", plan);
    bench.write("rig.toml", format!("calibration = \"sensor.toml\"\n{RIG}"));
    assert!(bench.run("again.toml", "calibrated.zarr", &[]).status.success());
    let store = Run::open(&bench.path("calibrated.zarr"), None).expect("a run");
    let gain = store.attributes()["detector"]["cmos"]["gain_e_per_dn"].as_f64();
    assert_eq!(gain, before["detector"]["cmos"]["gain_e_per_dn"].as_float());
    // The commands must not change a file that is not a calibration.
    let other = std::fs::read_to_string(bench.path("rig.toml")).expect("reads");
    let mut command = program();
    command.args(["rig", "calibrate"]).arg(&air).arg("-o").arg(bench.path("rig.toml"));
    let output = command.output().expect("runs");
    refused(&output, 2, "unknown key `bench`");
    refused(&output, 2, "another file name");
    assert_eq!(std::fs::read_to_string(bench.path("rig.toml")).expect("reads"), other);
}
