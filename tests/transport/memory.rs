//! Tests the memory of a mesh from its file to its acceleration tree. A mesh uses at most 200 bytes per
//! triangle at any time, and little more for a thousand instances.

use crate::optics::{Device, head};
use glam::DVec3;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fmt::Write;
use std::path::Path;
use sunstone::scene::from_text;

/// An allocator that counts the memory of each thread.
struct Counted;

thread_local! {
    /// Number of bytes that this thread holds, and the maximum of this number.
    static HELD: Cell<[isize; 2]> = const { Cell::new([0; 2]) };
}

fn count(bytes: isize) {
    // The thread-local cells no longer exist while a thread is ending.
    let _ = HELD.try_with(|held| {
        let [now, most] = held.get();
        held.set([now + bytes, most.max(now + bytes)]);
    });
}

// SAFETY: all calls are forwarded to the system's allocator, and the counters do not allocate.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as isize - layout.size() as isize);
        unsafe { System.realloc(at, layout, size) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

/// Returns the maximum number of bytes that are allocated at the same time during `make`. `make` runs on one
/// thread, so that all allocations are counted.
fn most<T: Send>(make: impl FnOnce() -> T + Send) -> f64 {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.expect("a thread").install(|| {
        let [before, _] = HELD.get();
        HELD.set([before; 2]);
        drop(make());
        (HELD.get()[1] - before) as f64
    })
}

const ROWS: u32 = 300;
const TRIANGLES: f64 = (2 * (ROWS - 1) * (ROWS - 1)) as f64;

/// Writes a wavy square without normals or texture coordinates.
fn wavy(file: &Path) {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {TRIANGLES}\nproperty list uchar uint vertex_indices\nend_header\n",
        ROWS * ROWS
    )
    .into_bytes();
    for i in 0..ROWS * ROWS {
        let [x, y] = [i % ROWS, i / ROWS].map(|k| k as f32 / ROWS as f32 - 0.5);
        for v in [x, y, 0.1 * (20.0 * x).sin() * (31.0 * y).cos()] {
            bytes.extend(v.to_le_bytes());
        }
    }
    for i in (0..ROWS - 1).flat_map(|y| (0..ROWS - 1).map(move |x| y * ROWS + x)) {
        for corners in [[i, i + 1, i + ROWS + 1], [i, i + ROWS + 1, i + ROWS]] {
            bytes.push(3);
            bytes.extend(corners.iter().flat_map(|c| c.to_le_bytes()));
        }
    }
    std::fs::write(file, bytes).expect("a file");
}

#[test]
fn a_mesh_takes_200_bytes_a_triangle_at_most() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("scene.toml");
    wavy(&folder.path().join("wavy.ply"));
    let camera = Device::look_at([0.0, 0.0, 4.0], DVec3::ZERO, [4, 4], 30.0);
    let text = |objects: &str| {
        let rest = "[materials]\nm.diffuse.albedo = 0.5\n[[emitters]]\npoint = { position = [0, 0, 4], intensity = 1 }\n\
            [[slices]]\nname = \"m\"\n";
        head(4, 3, 2) + &camera.keys("camera") + rest + objects
    };
    let load = |text: &str| from_text(&file, text).unwrap_or_else(|e| panic!("{e}"));
    let one = text("[[objects]]\nshape.ply.file = \"wavy.ply\"\nmaterial = \"m\"\n");
    let bytes = most(|| load(&one)) / TRIANGLES;
    let kept = load(&one).geometry.bytes() as f64 / TRIANGLES;
    assert!(kept < bytes && bytes < 200.0, "{kept} {bytes}");
    // Negative control: a second table of all triangles, as in an earlier version, exceeds the limit.
    let doubled = most(|| (vec![0_u8; 88 * TRIANGLES as usize], load(&one))) / TRIANGLES;
    assert!(doubled > 200.0, "{doubled}");
    let mut many = text("[[groups.g.objects]]\nshape.ply.file = \"wavy.ply\"\nmaterial = \"m\"\n");
    for i in 0..1000 {
        write!(many, "[[instances]]\ngroup = \"g\"\ntransform.translate = [{i}, 0, 0]\n").expect("a text");
    }
    let of_many = load(&many).geometry.bytes() as f64 / TRIANGLES;
    assert!(of_many < 1.02 * kept, "{of_many} {kept}");
}
