//! Tests that no input text makes the program panic, hang or request excessive memory. Tests that every valid
//! scene renders to finite values.

mod harness;
#[path = "fuzz/pbsdf.rs"]
mod pbsdf;

use harness::{folder, mirror_room, rendered, scene_files};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fmt::Debug;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use sunstone::InputError;
use sunstone::figure_file::Source;
use sunstone::tensor::field::Field;
use sunstone::transport::scene::Scene;

/// Allocator that records the largest requested allocation of each thread and of all threads.
struct Watched;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    static LARGEST_OF_THREAD: Cell<usize> = const { Cell::new(0) };
}

unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // The thread-local cells no longer exist while a thread is ending.
        let _ = LARGEST_OF_THREAD.try_with(|l| l.set(l.get().max(layout.size())));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watched = Watched;

/// Lock that serializes the tests of this file, so that measured memory and time belong to one test.
static ONE_BY_ONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ONE_BY_ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Largest allowed allocation in bytes. The limit allows an epipolar table of 2^24 pixels. The capacity of
/// the table doubles as the table grows.
const MEMORY: usize = 1 << 30;

/// Time limit for all mutations together. A slow machine tests fewer mutations.
const BUDGET: Duration = Duration::from_secs(30);

/// Time limit for one text.
const PATIENCE: Duration = Duration::from_secs(20);

const SLICES: &str = r#"
[[slices]]
name = "conventional"
[[slices]]
name = "epipolar"
camera = { binned = [2, 1] }
projector = { epipolar = { half_width_px = 1.5 } }
polarization = "mueller"
[[slices]]
name = "rows"
camera = { rows = [1, 4] }
projector = { binned = [1, 8] }
time = { start_ps = 8000, bin_ps = 250, bins = 64 }
[[slices]]
name = "rest"
camera = { block = [1, 2, 3, 4] }
projector = "coaxial"
bounces = true
split_first_bounce = true
[[figures]]
name = "photo"
view.photo = { slice = "conventional" }
"#;

/// Returns the text of the mirror room with `slices`, 8 × 8 pixels, a lens and a lamp. The text omits the
/// meshes, because the tests would read the mesh files thousands of times.
fn room() -> String {
    let whole = mirror_room(8, 8, 1, 8, SLICES);
    let mut parts: Vec<&str> = whole.split("[[objects]]").collect();
    parts.retain(|p| !p.contains("file = "));
    let mut text = parts.join("[[objects]]");
    text = text.replace("fov_x_deg = 50", "fov_x_deg = 50\ndistortion = { k1 = -0.1, k2 = 0.02 }");
    text.push_str("[[emitters]]\npoint = { position = [0, 1.5, 1], intensity = 2 }\n");
    text.push_str(
        "[[objects]]\nmaterial = \"glass\"\nshape.cube = { min = [0.3, 0.01, 0], max = [0.6, 0.4, 0.3] }\n",
    );
    text.push_str("[[objects]]\nmaterial = \"gold\"\nshape.cylinder = { p0 = [0, 0, 0], p1 = [0, 0.5, 0], radius = 0.1, caps = true }\n");
    text.push_str("transform = { scale = [1, 2, 1], rotate_deg = [0, 20, 5], translate = [-0.3, 0, 0.2] }\n");
    text
}

/// A scene file with every feature of the syntax.
const EVERYTHING: &str = include_str!("fuzz/everything.toml");

/// Folder with the files to which the scene refers.
static FILES: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let made = folder();
    scene_files(made.path(), &[("image.png", 2), ("mask.png", 8)]);
    let put = |name: &str, bytes: &[u8]| std::fs::write(made.path().join(name), bytes).expect("a file");
    let words = [1_i32, 2, 1, 1, 1].map(i32::to_le_bytes);
    let numbers = [0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0, 0.5, 2.0].map(f32::to_le_bytes);
    put("smoke.vol", &[b"VOL\x03", words.as_flattened(), numbers.as_flattened()].concat());
    put(
        "lamp.ies",
        b"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 3 2 1 2 0 0 0\n1 1 9\n0 30 90\n0 90\n100 80 20\n100 40 0\n",
    );
    put("places.txt", b"1 0 0 0.2  0 1 0 1.2  0 0 1 -0.7\n0,-1,0,0.5, 1,0,0,1.2, 0,0,0.5,-0.7\n");
    made
});

/// Builds a scene from text, and asserts that time and memory stay within the limits.
fn build(text: &str) -> Option<Scene> {
    within_bounds(text, sunstone::scene::from_text)
}

/// Parses a text with a reader, and asserts that time and memory stay within the limits. The result is a
/// scene, or a message with a fix and a location in the text.
fn within_bounds(text: &str, reader: impl FnOnce(&Path, &str) -> Result<Scene, InputError>) -> Option<Scene> {
    let place = FILES.path().join("fuzz.toml");
    LARGEST.store(0, Ordering::Relaxed);
    let begun = Instant::now();
    let scene = reader(&place, text);
    assert!(begun.elapsed() < PATIENCE, "it took {:?}", begun.elapsed());
    let largest = LARGEST.load(Ordering::Relaxed);
    assert!(largest <= MEMORY, "it asked for {largest} bytes at once");
    match scene {
        Ok(scene) => Some(scene),
        Err(e) => {
            assert!(!e.message.is_empty() && e.to_string().contains("fix: "), "{e}");
            if let Some(span) = &e.span {
                assert!(span.start <= span.end && span.end <= text.len(), "{span:?} of {}", text.len());
                assert!(e.line_column().is_some(), "the place {span:?} is inside a character");
            }
            None
        }
    }
}

/// Renders a scene if it is small, and returns whether the scene was rendered.
fn render_if_small(mut scene: Scene) -> bool {
    let small = |r: [u32; 2], n: u32| r[0] <= n && r[1] <= n;
    let bins = |s: &sunstone::tensor::slice::Slice| match s.time {
        sunstone::tensor::slice::TimeSelect::Bins { bins, .. } => bins,
        sunstone::tensor::slice::TimeSelect::Sum => 1,
    };
    if !small(scene.camera.resolution, 16)
        || scene.projector.as_ref().is_some_and(|p| !small(p.pinhole.resolution, 64))
        || scene.slices.is_empty()
        || scene.slices.iter().any(|s| bins(s) > 1000)
        || scene.settings.max_depth > 64
    {
        return false;
    }
    scene.change_settings(|s| s.spp = 1);
    let folder = folder();
    let store = rendered(&scene, folder.path().join("out.zarr"));
    for name in store.slice_names() {
        let slice = store.slice(name).expect("a slice");
        for field in [Field::Mean, Field::Overflow].into_iter().filter(|f| slice.has(*f)) {
            let t = slice.read_all(field).expect("values");
            assert!(t.data.iter().all(|v| v.is_finite()), "{name} has a value that is not finite");
        }
    }
    true
}

/// One change to a text. A position is a fraction of the number of numbers, lines, words or characters.
#[derive(Clone, Debug)]
enum Change {
    /// Replaces a number with a text.
    Number(f64, &'static str),
    /// Replaces a line or a word with another line or word.
    Line(f64, f64),
    Word(f64, f64),
    /// Replaces several characters with one character, or deletes several characters.
    Cut(f64, usize, Option<char>),
}

const NUMBERS: [&str; 20] = [
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "-0.0",
    "1e308",
    "-1e308",
    "1e-308",
    "1e20",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "32768",
    "3",
    "0.5",
    "[]",
    "\"x\"",
    "true",
    "1e-9",
];

fn change() -> impl Strategy<Value = Change> {
    let share = || 0.0..1.0_f64;
    prop_oneof![
        8 => (share(), prop::sample::select(&NUMBERS[..])).prop_map(|(a, n)| Change::Number(a, n)),
        3 => (share(), share()).prop_map(|(a, b)| Change::Line(a, b)),
        2 => (share(), share()).prop_map(|(a, b)| Change::Word(a, b)),
        2 => (share(), 0..8_usize, any::<Option<char>>()).prop_map(|(a, n, c)| Change::Cut(a, n, c)),
    ]
}

/// Returns the byte ranges of the longest runs of characters that satisfy `inside`. The first character of
/// each run satisfies `first`.
fn runs(text: &str, inside: impl Fn(char) -> bool, first: impl Fn(char) -> bool) -> Vec<Range<usize>> {
    let mut start = 0;
    let mut out = vec![];
    for part in text.split_inclusive(|c| !inside(c)) {
        let run = part.trim_end_matches(|c| !inside(c));
        if run.starts_with(&first) {
            out.push(start..start + run.len());
        }
        start += part.len();
    }
    out
}

fn pick<T: Clone>(all: &[T], share: f64) -> Option<T> {
    all.get((all.len() as f64 * share) as usize).cloned()
}

fn apply(text: &str, change: &Change) -> String {
    let ranges = match change {
        Change::Number(..) => runs(
            text,
            |c| c.is_ascii_alphanumeric() || "_.-+".contains(c),
            |c| c.is_ascii_digit() || c == '-' || c == '+',
        ),
        Change::Line(..) => runs(text, |c| c != '\n', |_| true),
        Change::Word(..) => {
            runs(text, |c| c.is_ascii_alphanumeric() || c == '_', |c| c.is_ascii_alphabetic())
        }
        Change::Cut(_, n, _) => {
            let at: Vec<usize> = text.char_indices().map(|(i, _)| i).chain([text.len()]).collect();
            at.iter().zip(at.iter().skip(*n)).map(|(a, b)| *a..*b).collect()
        }
    };
    let (Change::Number(at, _) | Change::Line(at, _) | Change::Word(at, _) | Change::Cut(at, ..)) = change;
    let Some(from) = pick(&ranges, *at) else {
        return text.to_owned();
    };
    let to = match change {
        Change::Number(_, number) => (*number).to_owned(),
        Change::Cut(_, _, new) => new.map_or(String::new(), String::from),
        Change::Line(_, other) | Change::Word(_, other) => {
            pick(&ranges, *other).filter(|r| r.start > 0).map_or(String::new(), |r| text[r].to_owned())
        }
    };
    [&text[..from.start], &to, &text[from.end..]].concat()
}

/// Tests a property of random inputs.
fn fuzz<T: Debug>(cases: u32, inputs: impl Strategy<Value = T>, test: impl Fn(T)) {
    let config = Config { cases, failure_persistence: None, max_shrink_iters: 200, ..Config::default() };
    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    let tested = TestRunner::new_with_rng(config, rng).run(&inputs, |input| {
        test(input);
        Ok(())
    });
    tested.unwrap_or_else(|e| panic!("{e}"));
}

/// Tests a property of damaged texts, within the time limit [`BUDGET`].
fn damage(cases: u32, text: &str, test: impl Fn(&str, u64)) {
    let begun = Instant::now();
    fuzz(cases, (prop::collection::vec(change(), 1..4), any::<u64>()), |(changes, number)| {
        if begun.elapsed() < BUDGET {
            test(&changes.iter().fold(text.to_owned(), |text, change| apply(&text, change)), number);
        }
    });
}

#[test]
fn arbitrary_text_is_an_error_or_a_scene() {
    let _alone = alone();
    let texts = prop_oneof![
        any::<Vec<u8>>().prop_map(|b| String::from_utf8_lossy(&b).into_owned()),
        any::<String>(),
        "([a-z_]{1,8}|\\[{1,2}[a-z.]{0,9}\\]{1,2}|=|\\n| |[0-9.e-]{1,6}|\"|'|\\{|\\}|,){0,60}",
    ];
    fuzz(1500, texts, |text| drop(build(&text)));
}

#[test]
#[ignore = "slow: tools/check --all"]
fn mutated_scenes_render_finite_values_or_give_an_error() {
    let _alone = alone();
    assert!(render_if_small(build(EVERYTHING).expect("everything is right")));
    // Milk takes three times as long as all other media, because its droplets have hundreds of sizes. Media
    // with spheres of many sizes around a hundred wavelengths take up to a minute.
    let slow = ["milk.milk", "beads.polystyrene", "grains.particles"];
    let lines = EVERYTHING.lines().filter(|line| !slow.iter().any(|s| line.starts_with(s)));
    let base: String =
        lines.map(|line| line.replace("interior = \"grains\"", "interior = \"plain\"") + "\n").collect();
    let (built, drawn, refused) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
    damage(300, &base, |text, _| {
        let count = match build(text).map(render_if_small) {
            None => &refused,
            Some(true) => &drawn,
            Some(false) => &built,
        };
        count.fetch_add(1, Ordering::Relaxed);
    });
    println!("{drawn:?} rendered, {built:?} too large to render, {refused:?} refused");
    let count = |n: AtomicUsize| n.into_inner();
    assert!(count(drawn) > 30 && count(refused) > 30, "the mutations are too tame or too wild");
}

/// A table `[vary]` with every kind of parameter.
const VARY: &str = r#"
[vary.colour]
path = "materials.white.diffuse.albedo"
values = [0.2, [0.1, 0.2, 0.3], { nm = [400, 700], values = [0, 0.5] }]
[vary.paint]
path = 'objects.ball.material'
values = ["white", "gold"]
every = 3
[vary.place]
path = 'objects."ball".transform.translate'
range = { min = [-0.1, 0, -0.1], max = [0.1, 0.2, 0] }
[vary.size]
path = "objects.ball.transform.scale"
range = { min = 0.5, max = 1 }
every = 2
[vary.height]
path = "camera.pose.look_at.origin.1"
range = { min = 0.9, max = 1.1 }
"#;

/// Tests that, after any mutation of `[vary]`, every variant is a scene or gives one message with a location.
/// Tests that the same variant number gives the same variant every time.
#[test]
#[ignore = "slow: tools/check --all"]
fn mutated_templates_vary_or_give_an_error() {
    let _alone = alone();
    let ball = "[[objects]]\nname = \"ball\"\nmaterial = \"white\"\nshape.sphere = { center = [0, 0.3, 0], radius = 0.1 }\n\
                transform = { scale = 1, translate = [0, 0, 0] }\n";
    let room = room() + ball;
    let variant = |text: &str, number: u64| {
        within_bounds(text, |path, text| sunstone::scene::variant_from_text(path, text, Some(number)))
    };
    for number in [0, 5, u64::MAX] {
        let scene = variant(&(room.clone() + VARY), number).expect("the template is right");
        assert!(scene.variant.as_ref().is_some_and(|v| v.number == number && v.values.len() == 5));
    }
    let (built, refused) = (AtomicUsize::new(0), AtomicUsize::new(0));
    damage(900, VARY, |text, number| {
        let text = room.clone() + text;
        let [a, b] = [0; 2].map(|_| variant(&text, number).map(|scene| scene.variant.clone()));
        assert_eq!(a, b, "two of one number");
        if a.is_some() { &built } else { &refused }.fetch_add(1, Ordering::Relaxed);
    });
    println!("{built:?} built, {refused:?} refused");
    assert!(built.into_inner() > 100 && refused.into_inner() > 100, "the mutations are too tame or too wild");
}

/// A figure file with every feature of the syntax.
const FIGURE: &str = include_str!("fuzz/figure.toml");

#[test]
#[ignore = "slow: tools/check --all"]
fn mutated_figure_files_are_read_or_give_an_error() {
    let _alone = alone();
    let read = |text: &str| Source::of_text(Path::new("figure.toml"), text);
    read(FIGURE).expect("everything is right");
    damage(3000, FIGURE, |text, _| {
        if let Err(e) = read(text) {
            assert!(!e.message.is_empty() && e.help.is_some());
        }
    });
}

/// Tests combinations of sizes. Each size is valid on its own. The program must not request more memory than
/// the machine has.
#[test]
fn huge_sizes_are_bounded_or_refused() {
    let _alone = alone();
    let base = room();
    let slice = |s: &str| format!("[[slices]]\nname = \"huge\"\n{s}\n");
    let sized = |camera: u32, projector: u32, more: &str| {
        let size = |text: &str, n: u32, fov: u32| {
            let [from, to] = [8, n].map(|n| format!("resolution = [{n}, {n}]\nfov_x_deg = {fov}"));
            harness::edit(text, &from, &to)
        };
        let text = size(&size(&base, camera, 50), projector, 58);
        let text = text.replace("projector = \"coaxial\"", "projector = \"sum\"");
        text + more
    };
    let everything = "projector = \"all\"\npolarization = \"mueller\"\ntime = { bin_ps = 1, bins = 1048576 }";
    let message = |text: &str| {
        assert!(build(text).is_none(), "it was built");
        sunstone::scene::from_text(Path::new("fuzz.toml"), text)
            .err()
            .map_or(String::new(), |e| e.to_string())
    };
    assert!(message(&sized(8, 32768, "")).contains("4096"), "an epipolar table of 2^30 pixels");
    assert!(message(&sized(8, 64, &slice(everything))).contains("elements"));
    let deep = sized(512, 8, &slice("polarization = \"mueller\"\nbounces = true\nsplit_first_bounce = true"))
        .replace("tile = 8", "tile = 512")
        .replace("max_depth = 12", "max_depth = 1024");
    assert!(message(&deep).contains("in one tile"), "{}", message(&deep));
    let plain = sized(32768, 8, "");
    assert!(build(&plain).is_some(), "a large image alone is no fault");
    assert!(LARGEST.load(Ordering::Relaxed) < 1 << 27);
}

/// Replaces the metadata values and coordinates of a store, one at a time. Tests that commands that read
/// stores give a result or an error message.
#[test]
fn commands_survive_edited_stores() {
    use serde_json::{Value, json};
    fn pointers(value: &Value, at: &str, out: &mut Vec<String>) {
        let children: Vec<(String, &Value)> = match value {
            Value::Object(map) => map.iter().map(|(k, v)| (k.clone(), v)).collect(),
            Value::Array(list) => list.iter().enumerate().map(|(i, v)| (i.to_string(), v)).collect(),
            _ => vec![],
        };
        for (key, child) in children.iter().filter(|(k, _)| k != "consolidated_metadata") {
            let path = format!("{at}/{key}");
            pointers(child, &path, out);
            out.push(path);
        }
    }
    let _alone = alone();
    let folder = folder();
    let at = folder.path();
    let slice = "[[slices]]\nname = \"s\"\npolarization = \"mueller\"\ntime = { start_ps = 12000, bin_ps = 2000, bins = 3 }\n";
    rendered(&harness::scene(&mirror_room(4, 8, 1, 4, slice)), at.join("s.zarr"));
    let values =
        [json!(null), json!(-1), json!(u64::MAX), json!("x"), json!([]), json!(1e300), json!(0), json!({})];
    let commands: [&[&str]; 4] = [
        &["info", "s.zarr"],
        &["decompose", "s.zarr", "s", "-o", "out.npz"],
        &["probe", "s.zarr", "s", "--sum", "y,x"],
        &["export", "s.zarr", "s", "-o", "out.exr"],
    ];
    let (mut edits, mut refused) = (0, 0);
    for file in ["zarr.json", "s/zarr.json", "s/mean/zarr.json", "s/y/zarr.json", "samples/zarr.json"] {
        let path = at.join("s.zarr").join(file);
        let whole = std::fs::read(&path).expect("a description");
        let json: Value = serde_json::from_slice(&whole).expect("JSON");
        let mut places = Vec::new();
        pointers(&json, "", &mut places);
        for place in places {
            let mut edited = json.clone();
            let Some(value) = edited.pointer_mut(&place) else {
                continue;
            };
            *value = values[edits % values.len()].clone();
            std::fs::write(&path, edited.to_string()).expect("an edit");
            let command = commands[edits / values.len() % commands.len()];
            let out = harness::sunstone(at, command).output().expect("the program runs");
            let message = harness::stderr(&out);
            match out.status.code() {
                Some(0) => {}
                Some(2) if message.starts_with("error: ") => refused += 1,
                code => panic!("{file}{place}: {command:?} ended with {code:?}\n{message}"),
            }
            edits += 1;
        }
        std::fs::write(&path, whole).expect("as it was");
    }
    println!("{edits} edits, {refused} refused");
    assert!(edits > 100 && refused > 20, "{edits} edits, {refused} refused");
}
