//! Finds the nearest hits of rays from one file on a mesh from another file. `validation/rays.py` runs the
//! program and times Embree on the same input.
//!
//!     rays MESH.ply RAYS.f32 HITS.f32 [--alternate]
//!
//! With `--alternate`, the traversals of the rays alternate, as for all rays of a render except the first rays
//! from the camera.
//!
//! RAYS.f32 holds six little-endian f32 values per ray: the origin, then the unit direction. Each line on
//! standard input is a number of threads. For each line, the program prints the time in seconds to find the
//! nearest hits of all rays.
//!
//! At the end of the input, the program writes the last hits to HITS.f32. Each hit has four f32 values:
//! - the distance, which is infinite for a miss
//! - the barycentric coordinate of the second vertex
//! - the barycentric coordinate of the third vertex
//! - 0 in place of the primitive index, which has no meaning outside Sunstone's tree

use glam::Vec3A;
use rayon::prelude::*;
use std::io::{BufRead, Write};
use std::path::Path;
use std::time::Instant;
use sunstone::scene::import;
use sunstone::transport::geometry::builder::GeometryBuilder;
use sunstone::transport::geometry::bvh::Geometry;
use sunstone::transport::geometry::ray::{Hit, Ray};

/// Number of rays that a render traces together.
const BATCH: usize = 16;

type Failure = Box<dyn std::error::Error>;

fn rays(path: &str) -> Result<Vec<Ray>, Failure> {
    let bytes = std::fs::read(path)?;
    let (rays, _) = bytes.as_chunks::<24>();
    let ray = |bytes: &[u8; 24]| {
        let (words, _) = bytes.as_chunks::<4>();
        let [ox, oy, oz, dx, dy, dz] = std::array::from_fn(|i| f32::from_le_bytes(words[i]));
        Ray { origin: Vec3A::new(ox, oy, oz), dir: Vec3A::new(dx, dy, dz) }
    };
    Ok(rays.iter().map(ray).collect())
}

fn trace(geometry: &Geometry, rays: &[Ray], hits: &mut [Option<Hit>], alternate: bool) {
    if !alternate {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = geometry.intersect(ray, f32::INFINITY);
        }
        return;
    }
    for (rays, hits) in rays.chunks(BATCH).zip(hits.chunks_mut(BATCH)) {
        let rays: Vec<&Ray> = rays.iter().collect();
        geometry.intersect_each(&rays, hits);
    }
}

fn run(mesh: &str, from: &str, into: &str, alternate: bool) -> Result<(), Failure> {
    let mut builder = GeometryBuilder::default();
    for part in import::load(Path::new(mesh))? {
        builder.mesh(&part.mesh, 0);
    }
    let begun = Instant::now();
    let geometry = builder.build();
    let rays = rays(from)?;
    eprintln!("tree of {} triangles built in {:.2} s", geometry.counts().0, begun.elapsed().as_secs_f64());
    let mut hits = vec![None; rays.len()];
    for line in std::io::stdin().lock().lines() {
        let threads: usize = line?.trim().parse()?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let begun = Instant::now();
        if threads == 1 {
            trace(&geometry, &rays, &mut hits, alternate);
        } else {
            let parts = rays.par_chunks(4096).zip(hits.par_chunks_mut(4096));
            pool.install(|| parts.for_each(|(rays, hits)| trace(&geometry, rays, hits, alternate)));
        }
        println!("{}", begun.elapsed().as_secs_f64());
        std::io::stdout().flush()?;
    }
    let words =
        hits.iter().flat_map(|hit| hit.map_or([f32::INFINITY, 0.0, 0.0, 0.0], |h| [h.t, h.u, h.v, 0.0]));
    std::fs::write(into, words.flat_map(f32::to_le_bytes).collect::<Vec<u8>>())?;
    Ok(())
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let (alternate, [mesh, from, into]) = (match &arguments[..] {
        [files @ .., last] if last == "--alternate" => (true, files),
        files => (false, files),
    }) else {
        println!(
            "usage: rays MESH.ply RAYS.f32 HITS.f32 [--alternate] (validation/rays.py runs this program)"
        );
        return;
    };
    if let Err(e) = run(mesh, from, into, alternate) {
        eprintln!("rays: {e}");
        std::process::exit(1);
    }
}
