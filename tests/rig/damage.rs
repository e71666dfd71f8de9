//! Tests damaged runs with correct checksums. The program must read each run, or refuse the run with a
//! message.

use super::*;

/// A deterministic pseudorandom number sequence.
struct Draw(u64);

impl Draw {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n.max(1)
    }
}

/// Returns all paths of a document.
fn places(value: &Value, here: String, out: &mut Vec<String>) {
    out.push(here.clone());
    match value {
        Value::Object(map) => map.iter().for_each(|(k, v)| {
            places(v, format!("{here}/{}", k.replace('~', "~0").replace('/', "~1")), out);
        }),
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, v)| places(v, format!("{here}/{i}"), out));
        }
        _ => {}
    }
}

/// Returns a copy of a document with one path changed.
fn damaged_document(bytes: &[u8], draw: &mut Draw) -> Vec<u8> {
    let mut document: Value = serde_json::from_slice(bytes).expect("a description");
    let mut all = vec![];
    places(&document, String::new(), &mut all);
    let place = document.pointer_mut(&all[draw.below(all.len())]).expect("a place");
    let values = [
        json!(null),
        json!(true),
        json!(""),
        json!("full"),
        json!([]),
        json!({}),
        json!(0),
        json!(-1),
        json!(1),
        json!(3),
        json!(0.5),
        json!(1e300),
        json!(u64::MAX),
        json!(1_u64 << 40),
        json!([1, 1, 1, 1]),
    ];
    match place {
        Value::Array(list) if draw.below(2) == 0 => match list.pop() {
            Some(last) if draw.below(2) == 0 => list.extend([last.clone(), last]),
            _ => {}
        },
        Value::Number(n) if draw.below(2) == 0 => {
            let by = draw.below(4);
            *place = match (n.as_i64(), n.as_f64()) {
                (Some(n), _) => json!([n / 2, n.saturating_mul(2), -n, n.saturating_mul(1_000_000)][by]),
                (None, n) => json!(n.expect("a number") * [0.5, 2.0, -1.0, 1e6][by]),
            };
        }
        Value::String(s) if s.len() > 8 && draw.below(2) == 0 => {
            // Deletes or changes one byte of the scheme's text.
            let at = draw.below(s.len());
            if s.is_char_boundary(at) && s.is_char_boundary(at + 1) {
                s.replace_range(at..=at, ["", "9", "-", "x"][draw.below(4)]);
            }
        }
        _ => *place = values[draw.below(values.len())].clone(),
    }
    serde_json::to_vec(&document).expect("a document")
}

/// Damages finished runs at one position and corrects the checksums, as a different program could do. Tests
/// that the program reads each run or refuses it with a message, without a panic or a long delay.
#[test]
#[ignore = "slow: tools/check --all"]
fn damaged_runs_are_read_or_refused() {
    let wanted: usize = std::env::var("SUNSTONE_DAMAGE").map_or(400, |n| n.parse().expect("a number"));
    let bench = Bench::new("");
    let mut draw = Draw(18);
    let (mut read, mut refused) = (0, 0);
    // Takes as many captures as the matrices require.
    let more =
        |text: &str| text.replace("captures = 6", "captures = 16").replace("captures = 4", "captures = 16");
    bench.write("camera.toml", more(CAMERA));
    bench.write("scan.toml", more(SCAN));
    for plan in ["camera", "scan"] {
        let store = format!("{plan}.zarr");
        assert!(bench.run(&format!("{plan}.toml"), &store, &[]).status.success());
        let content = bench.content(&store);
        let root = bench.path(&store);
        for case in 0..wanted / 2 {
            // Selects the root in half of the cases, because most metadata are at the root but most files are
            // frames.
            let root_is = ["zarr.json", "frames/raw/zarr.json"][draw.below(2)];
            let at_root = content.iter().find(|(p, _)| draw.0 >> 63 == 0 && p == Path::new(root_is));
            let (path, bytes) = at_root.unwrap_or(&content[draw.below(content.len())]);
            if path.ends_with("manifest.txt") {
                continue;
            }
            let bad = if path.ends_with("zarr.json") {
                damaged_document(bytes, &mut draw)
            } else {
                let mut bad = bytes.clone();
                let at = draw.below(bad.len());
                bad[at] ^= 1 << draw.below(8);
                bad
            };
            std::fs::write(root.join(path), bad).expect("writes");
            let begun = Instant::now();
            let attempt = std::panic::catch_unwind(|| -> Result<(), String> {
                let sealed = FrameStore::open_for_write(&root).map_err(|e| e.to_string())?;
                sealed.finish().map_err(|e| e.to_string())?;
                drop(sealed);
                let run = Run::open(&root, None).map_err(|e| e.to_string())?;
                for mask in &run.masks {
                    run.mueller(mask, &RunOptions::default()).map_err(|e| e.to_string())?;
                }
                Ok(())
            });
            let what = format!("{plan}, case {case}, {}", path.display());
            match attempt {
                Ok(Ok(())) => read += 1,
                Ok(Err(words)) => {
                    assert!(!words.is_empty() && words.len() < 2000, "{what}: {words}");
                    if std::env::var_os("SUNSTONE_DAMAGE").is_some() {
                        println!("{what}: {words}");
                    }
                    refused += 1;
                }
                Err(panic) => panic!("{what}: it panicked: {panic:?}"),
            }
            assert!(begun.elapsed() < Duration::from_secs(20), "{what}: it took {:?}", begun.elapsed());
            for (path, bytes) in &content {
                if std::fs::read(root.join(path)).ok().as_ref() != Some(bytes) {
                    std::fs::write(root.join(path), bytes).expect("writes");
                }
            }
        }
    }
    println!("{refused} damaged runs refused, {read} read all the same");
    assert!(refused > wanted / 4 && read > wanted / 20, "{refused} {read}");
}
