//! Tests the server of `sunstone view`: numbers, access, and stores that change while they are open.

use crate::harness::{folder, run, stderr, sunstone};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;
use store::probe::{Pattern, Probe, Selection, parse_axes, parse_stokes};
use store::zarr::TensorStore;
use tensor::array::Tensor;

/// A scene with slices that resolve polarization, time and projector pixels.
const SCENE: &str = r#"name = "wall"
render = { spp = 4, max_depth = 3, tile = 8 }
camera = { resolution = [20, 12], fov_x_deg = 50, pose.look_at = { origin = [0, 0, 3], target = [0, 0, 0] } }
projector = { resolution = [8, 6], fov_x_deg = 60, pose.look_at = { origin = [0.4, 0, 3], target = [0, 0, 0] } }
materials.gold.rough_conductor = { metal = "gold", alpha = 0.4 }
[[objects]]
name = "plane"
shape.rectangle = { corner = [-2, -2, 0], u = [4, 0, 0], v = [0, 4, 0] }
material = "gold"
[[slices]]
name = "polarimetric"
polarization = "mueller"
[[slices]]
name = "all"
projector = "all"
polarization = "mueller"
time = { start_ps = 20000, bin_ps = 400, bins = 6 }
"#;

/// A running `sunstone view`, which stops when the value is dropped.
struct Viewer {
    process: Child,
    port: u16,
    token: String,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The status and the body of an answer.
type Answer = (u16, Vec<u8>);

impl Viewer {
    fn start(at: &Path, stores: &[&str]) -> Self {
        let mut command = sunstone(at, &["view", "--no-open"]);
        command.args(stores).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut process = command.spawn().expect("starts");
        let mut line = String::new();
        BufReader::new(process.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
        let (address, token) = line.trim().split_once("/?token=").expect("a URL with a token");
        let port = address.rsplit_once(':').expect("a port").1.parse().expect("a number");
        Self { process, port, token: token.to_owned() }
    }

    /// Sends bytes and returns the answer.
    fn send(&self, bytes: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("connects");
        stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a limit");
        // The server may refuse a request before it is complete.
        let _ = stream.write_all(bytes);
        let mut answer = vec![];
        let _ = stream.read_to_end(&mut answer);
        parsed(&answer)
    }

    /// Sends a request with headers in addition to `connection`.
    fn request(&self, line: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let mut text = format!("{line} HTTP/1.1\r\nconnection: close\r\n");
        for (name, value) in headers {
            text += &format!("{name}: {value}\r\n");
        }
        if !body.is_empty() {
            text += &format!("content-length: {}\r\n", body.len());
        }
        self.send(&[text.as_bytes(), b"\r\n", body].concat())
    }

    fn host(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    /// Sends a request of the page.
    fn own(&self, line: &str, body: &[u8]) -> Answer {
        self.request(line, &[("host", &self.host()), ("x-sunstone-token", &self.token)], body)
    }

    fn json(&self, path: &str) -> Value {
        let (status, body) = self.own(&format!("GET {path}"), b"");
        assert_eq!(status, 200, "{path}: {}", String::from_utf8_lossy(&body));
        serde_json::from_slice(&body).expect("JSON")
    }

    /// Sends a query, and returns the header and the arrays of the answer.
    fn arrays(&self, path: &str, query: &Value) -> (Value, Vec<f32>) {
        let (status, body) = self.own(&format!("POST {path}"), query.to_string().as_bytes());
        assert_eq!(status, 200, "{query}: {}", String::from_utf8_lossy(&body));
        let length = u32::from_le_bytes(body[..4].try_into().unwrap()) as usize;
        let values = body[4 + length..].chunks_exact(4);
        let values = values.map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        (serde_json::from_slice(&body[4..4 + length]).expect("JSON"), values)
    }

    fn refusal(&self, path: &str, query: &Value) -> (u16, String) {
        let (status, body) = self.own(&format!("POST {path}"), query.to_string().as_bytes());
        let error: Value = serde_json::from_slice(&body).expect("JSON");
        (status, error["error"].as_str().expect("a message").to_owned())
    }

    /// Returns a finished image.
    fn image(&self, query: &Value) -> (Value, Vec<f32>) {
        loop {
            let (header, values) = self.arrays("/api/image", query);
            if header["done"] == 1.0 {
                return (header, values);
            }
        }
    }
}

/// Parses an answer, whose body may be chunked.
fn parsed(answer: &[u8]) -> Answer {
    let Some(end) = answer.windows(4).position(|w| w == b"\r\n\r\n") else {
        return (0, vec![]);
    };
    let head = String::from_utf8_lossy(&answer[..end]).to_lowercase();
    let status = head.split(' ').nth(1).and_then(|w| w.parse().ok()).unwrap_or(0);
    let mut rest = &answer[end + 4..];
    if !head.contains("transfer-encoding: chunked") {
        return (status, rest.to_vec());
    }
    let mut body = vec![];
    while let Some(line) = rest.windows(2).position(|w| w == b"\r\n") {
        let size = usize::from_str_radix(&String::from_utf8_lossy(&rest[..line]), 16).expect("a size");
        body.extend(&rest[line + 2..line + 2 + size]);
        rest = &rest[line + 4 + size..];
        if size == 0 {
            break;
        }
    }
    (status, body)
}

/// Renders the scene into `wall.zarr`.
fn rendered(at: &Path) -> PathBuf {
    std::fs::write(at.join("scene.toml"), SCENE).expect("writes");
    run(at, &["render", "scene.toml", "-o", "wall.zarr", "--no-figures"], 0);
    at.join("wall.zarr")
}

fn lengths(header: &Value) -> Vec<usize> {
    let axes = header["axes"].as_array().expect("axes");
    axes.iter().map(|a| a["coords"].as_array().expect("coordinates").len()).collect()
}

/// Returns the values and then the errors of a probe.
fn both(mean: Tensor, errors: Tensor) -> Vec<f32> {
    [mean.data, errors.data].concat()
}

#[test]
fn probes_and_images_have_the_numbers_of_the_command() {
    let folder = folder();
    let store = TensorStore::open(&rendered(folder.path())).expect("opens");
    let slice = store.slice("all").expect("a slice");
    let viewer = Viewer::start(folder.path(), &["wall.zarr"]);

    let description = viewer.json("/api/describe");
    let shown = &description["stores"][0];
    assert_eq!(shown["finished"], true);
    assert_eq!(shown["attributes"]["projector"]["resolution"], json!([8, 6]));
    assert_eq!(shown["slices"][1]["name"], "all");
    assert!(shown["attributes"].get("scene").is_none());

    let mut values = vec![1.0; 48];
    values[20] = 0.0;
    values[21] = 0.5;
    let words = json!({
        "store": 0, "slice": "all", "select": ["t=20000:22000"], "stokes": "plus45", "pulse": "gaussian:300",
        "sum": ["t", "x"], "pattern": {"width": 8, "height": 6, "values": values},
    });
    let probe = Probe {
        select: vec!["t=20000:22000".parse::<Selection>().unwrap()],
        stokes: Some(parse_stokes("plus45").unwrap()),
        pulse: Some("gaussian:300".parse().unwrap()),
        sum: parse_axes("t,x").unwrap(),
        pattern: Some(Pattern { width: 8, height: 6, values }),
    };
    let expected = probe.run(&slice).expect("a probe");
    let (header, found) = viewer.arrays("/api/probe", &words);
    assert_eq!(found, both(expected.mean, expected.std_error));
    assert!(header["notes"].to_string().contains("shifted out of the stored time bins"), "{header}");
    assert!(found.iter().any(|v| *v > 0.0));

    // The same as an image, whose tiles are smaller than the slice.
    let mut image = words.clone();
    image["limit"] = json!(1 << 20);
    image["errors"] = json!(true);
    let expected = Probe { sum: parse_axes("t,v,u").unwrap(), ..probe.clone() }.run(&slice).expect("a probe");
    let (header, found) = viewer.image(&image);
    assert_eq!(lengths(&header), [12, 20, 4, 3]);
    assert_eq!(found, both(expected.mean.clone(), expected.std_error));

    // Contracted with weights, in a region, and averaged over blocks of 4 x 4 entries.
    image["output"] = json!([0.5, 0.5, 0.0, 0.0]);
    image["region"] = json!([1, 10, 2, 20]);
    image["limit"] = json!(3 * 5 * 3);
    let (header, found) = viewer.image(&image);
    assert_eq!((lengths(&header), &header["bin"]), (vec![3, 5, 3], &json!(4)));
    let at = |y: usize, x: usize, stokes: usize| {
        f64::from(expected.mean.data[((y * 20 + x) * 4 + stokes) * 3 + 1])
    };
    let entries = (5..9).flat_map(|y| (6..10).map(move |x| (y, x)));
    let mean = entries.map(|(y, x)| 0.5 * (at(y, x, 0) + at(y, x, 1))).sum::<f64>() / 16.0;
    let value = f64::from(found[(5 + 1) * 3 + 1]);
    assert!(mean != 0.0 && (value - mean).abs() < 1e-6 * mean.abs(), "{value} {mean}");
}

#[test]
fn requests_without_access_are_refused() {
    let folder = folder();
    rendered(folder.path());
    let viewer = Viewer::start(folder.path(), &["wall.zarr"]);
    let (host, token) = (viewer.host(), viewer.token.as_str());
    let get = |line: &str, headers: &[(&str, &str)]| viewer.request(line, headers, b"").0;
    let own = [("host", host.as_str()), ("x-sunstone-token", token)];
    assert_eq!(get("GET /api/describe", &own), 200);
    assert_eq!(get("GET /", &own[..1]), 200);
    for (name, expected, line, headers) in [
        ("no token", 403, "GET /api/describe", vec![own[0]]),
        ("wrong token", 403, "GET /api/describe", vec![own[0], ("x-sunstone-token", "0123")]),
        ("token in the query only", 403, &format!("GET /api/describe?token={token}"), vec![own[0]]),
        ("no host", 400, "GET /api/describe", vec![own[1]]),
        ("foreign host", 421, "GET /api/describe", vec![("host", "evil.example"), own[1]]),
        ("foreign host, page", 421, "GET /", vec![("host", "evil.example")]),
        ("other port", 421, "GET /api/describe", vec![("host", "127.0.0.1:1"), own[1]]),
        ("foreign origin", 403, "GET /api/describe", vec![own[0], own[1], ("origin", "http://evil.example")]),
        ("origin null", 403, "GET /api/describe", vec![own[0], own[1], ("origin", "null")]),
        ("path above", 404, "GET /../../../etc/passwd", own.to_vec()),
        ("escaped path", 404, "GET /%2e%2e/%2e%2e/etc/passwd", own.to_vec()),
        ("path of a store", 404, "GET /wall.zarr/zarr.json", own.to_vec()),
        ("unknown request", 404, "GET /api/files", own.to_vec()),
        ("method", 405, "PUT /api/describe", own.to_vec()),
        ("store by path", 400, "GET /api/progress?store=/etc", own.to_vec()),
        ("no such store", 400, "GET /api/progress?store=7", own.to_vec()),
        ("frames of a render", 400, "GET /api/frame?store=0&index=0", own.to_vec()),
    ] {
        assert_eq!(get(line, &headers), expected, "{name}");
    }
    let query = |change: &dyn Fn(&mut Value)| {
        let mut query = json!({"store": 0, "slice": "polarimetric", "limit": 1000});
        change(&mut query);
        viewer.refusal("/api/image", &query)
    };
    for (name, part, change) in [
        (
            "slice",
            "has no slice `../etc`",
            &(|q: &mut Value| q["slice"] = json!("../etc")) as &dyn Fn(&mut Value),
        ),
        ("region", "is not inside 12 x 20", &|q| q["region"] = json!([0, 13, 0, 20])),
        ("empty region", "is not inside", &|q| q["region"] = json!([3, 3, 0, 20])),
        ("limit", "more than the limit of 1", &|q| q["limit"] = json!(1)),
        ("two contractions", "already contract the axis `stokes_out`", &|q| {
            q["select"] = json!(["stokes_out=1:2"]);
            q["output"] = json!([0.5, 0.5, 0, 0]);
        }),
        ("word", "unknown axis `z`", &|q| q["select"] = json!(["z=1"])),
        ("camera pixel", "selects camera pixels by its region", &|q| q["select"] = json!(["y=1"])),
        ("type", "the request is not valid", &|q| q["limit"] = json!("all")),
        ("pattern", "has 1 values", &|q| q["pattern"] = json!({"width": 2, "height": 2, "values": [1]})),
    ] {
        let (status, message) = query(change);
        assert!(status == 400 && message.contains(part), "{name}: {status} {message}");
    }
    let trial = |captures: u64| {
        json!({"store": 0, "slice": "polarimetric", "detector": {"sigma": 0.01},
               "scheme": {"name": "drr", "captures": captures, "array": false}})
    };
    assert_eq!(viewer.arrays("/api/trial", &trial(36)).0["rank"], 16);
    // The user is typing: a scheme that cannot be used is no error of the page.
    let (status, message) = viewer.refusal("/api/trial", &trial(10_000_000));
    assert!(status == 200 && message.contains("at most 4096 are simulated"), "{status} {message}");
    // Requests that are too large, endless or no HTTP.
    let large = vec![b'1'; (32 << 20) + 1];
    assert_eq!(viewer.own("POST /api/probe", &large).0, 413);
    let claimed = format!(
        "POST /api/probe HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\ncontent-length: 99999999999\r\n\r\n"
    );
    assert_eq!(viewer.send(claimed.as_bytes()).0, 403, "refused before the body is read");
    let header = format!("GET / HTTP/1.1\r\nhost: {host}\r\nx: {}\r\n\r\n", "x".repeat(1 << 20));
    assert_ne!(viewer.send(header.as_bytes()).0, 200);
    assert_ne!(viewer.send(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n").0, 200);
    assert_eq!(get("GET /api/describe", &own), 200, "the server still answers");
}

#[test]
fn many_requests_at_once_are_answered() {
    let folder = folder();
    rendered(folder.path());
    let viewer = Viewer::start(folder.path(), &["wall.zarr"]);
    let query = json!({"store": 0, "slice": "polarimetric", "select": ["y=3", "x=4"]});
    let expected = viewer.arrays("/api/probe", &query).1;
    std::thread::scope(|scope| {
        for _ in 0..100 {
            scope.spawn(|| {
                for _ in 0..10 {
                    assert_eq!(viewer.arrays("/api/probe", &query).1, expected);
                }
            });
        }
    });
}

#[test]
fn a_render_in_progress_is_shown_as_it_grows() {
    let folder = folder();
    let at = folder.path();
    // Enough samples that the render is interrupted after some tiles.
    std::fs::write(at.join("scene.toml"), SCENE.replace("spp = 4", "spp = 3000")).expect("writes");
    let words = ["render", "scene.toml", "-o", "wall.zarr", "--no-figures", "--threads", "1"];
    let mut render =
        sunstone(at, &words).stderr(Stdio::null()).stdout(Stdio::null()).spawn().expect("starts");
    while !at.join("wall.zarr/.sunstone-progress").is_file() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let viewer = Viewer::start(at, &["wall.zarr"]);
    let tiles = |progress: &Value| progress["tilesDone"].as_u64().expect("a number");
    while tiles(&viewer.json("/api/progress?store=0")) == 0 {
        assert!(render.try_wait().expect("runs").is_none(), "the render is too short for this test");
    }
    render.kill().expect("stops");
    render.wait().expect("stops");
    let progress = viewer.json("/api/progress?store=0");
    assert_eq!((&progress["finished"], &progress["tiles"]), (&json!(false), &json!(6)), "{progress}");
    let query = json!({"store": 0, "slice": "polarimetric", "limit": 1 << 20});
    let known = |values: &[f32]| values.iter().filter(|v| v.is_finite()).count();
    let (_, part) = viewer.image(&query);
    assert!(known(&part) > 0 && known(&part) < part.len(), "{} of {}", known(&part), part.len());
    run(at, &[&words[..], &["--resume"]].concat(), 0);
    assert_eq!(viewer.json("/api/progress?store=0")["finished"], true);
    let (_, whole) = viewer.image(&query);
    assert_eq!(known(&whole), whole.len());
    assert!(part.iter().zip(&whole).all(|(a, b)| a.is_nan() || a == b));
}

#[test]
fn damaged_and_removed_stores_are_reported() {
    let folder = folder();
    let at = folder.path();
    let store = rendered(at);
    let viewer = Viewer::start(at, &["wall.zarr"]);
    let query = json!({"store": 0, "slice": "polarimetric", "limit": 1 << 20});
    let chunk = store.join("polarimetric/mean/c.0.0.0.0.0");
    let whole = std::fs::read(&chunk).expect("a chunk");
    std::fs::write(&chunk, &whole[..whole.len() / 2]).expect("writes");
    let (status, message) = viewer.refusal("/api/image", &query);
    assert!(status >= 400 && message.contains("polarimetric"), "{status} {message}");
    std::fs::write(&chunk, &whole).expect("writes");
    assert_eq!(viewer.image(&query).1.len(), 12 * 20 * 48);
    std::fs::remove_dir_all(&store).expect("removes");
    let other = json!({"store": 0, "slice": "all", "limit": 1 << 20});
    let (status, message) = viewer.refusal("/api/image", &other);
    assert!(status >= 400 && message.contains("wall.zarr"), "{status} {message}");
}

#[test]
fn a_replaced_store_is_opened_again() {
    let folder = folder();
    let at = folder.path();
    rendered(at);
    let viewer = Viewer::start(at, &["wall.zarr"]);
    let query = json!({"store": 0, "slice": "polarimetric", "limit": 1 << 20});
    let before = viewer.image(&query).1;
    run(at, &["render", "scene.toml", "-o", "wall.zarr", "--no-figures", "--force", "--seed", "7"], 0);
    let after = viewer.image(&query).1;
    assert!(before.len() == after.len() && before != after);
}

#[test]
fn an_export_is_complete_or_absent() {
    let folder = folder();
    let at = folder.path();
    let store = rendered(at);
    run(at, &["view", "wall.zarr", "--export", "site"], 0);
    let read = |path: &str| std::fs::read_to_string(at.join(path)).expect("a file");
    let description: Value = serde_json::from_str(&read("site/data/describe.json")).expect("JSON");
    assert_eq!(description["isStatic"], true);
    assert_eq!(description["stores"][0]["folder"], "0");
    assert_eq!(description["stores"][0]["path"], "wall.zarr");
    assert!(read("site/index.html").contains("app.js"));
    run(at, &["verify", "site/data/0"], 0);
    let [a, b] = [store, at.join("site/data/0")].map(|path| {
        let slice = TensorStore::open(&path).expect("opens").slice("all").expect("a slice");
        let result = Probe::default().run(&slice).expect("a probe");
        both(result.mean, result.std_error)
    });
    assert_eq!(a, b);

    let refused = |words: &[&str], part: &str| {
        let message = stderr(&run(at, &[&["view"], words].concat(), 2));
        assert!(message.contains(part), "{message}");
    };
    refused(&["wall.zarr", "--export", "site"], "exists; use --force");
    run(at, &["view", "wall.zarr", "--export", "site", "--force"], 0);
    std::fs::create_dir(at.join("mine")).expect("a folder");
    refused(&["wall.zarr", "--export", "mine", "--force"], "is not an export");
    refused(&["wall.zarr", "--export", "wall.zarr", "--force"], "wall.zarr");
    refused(&["wall.zarr", "--export", "wall.zarr/site"], "wall.zarr");
    refused(&["missing.zarr", "--export", "new"], "does not exist");
    // An export that contains an input is not replaced.
    refused(&["site/data/0", "--export", "site", "--force"], "site/data/0");
    assert!(at.join("site/data/0/zarr.json").is_file());
    // Of a store with shards, only its own intact files are copied.
    std::fs::write(at.join("site/data/0/notes.txt"), "private").expect("writes");
    refused(&["site/data/0", "--export", "new"], "notes.txt");
    assert!(!at.join("new").exists());
    std::fs::remove_file(at.join("site/data/0/notes.txt")).expect("removes");
    run(at, &["view", "site/data/0", "--export", "second"], 0);
    refused(&["missing.zarr"], "does not exist");
    refused(&["mine"], "mine");
    assert!(!at.join("new").exists());
}
