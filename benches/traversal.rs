//! Measures BVH traversal in the mirror room: primary rays, diffuse bounce rays and shadow rays.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec2, Vec3A};
use std::hint::black_box;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::sampling::warp;
use sunstone::transport::geometry::ray::Ray;
use sunstone_benches::shipped;

fn traversal(c: &mut Criterion) {
    let scene = sunstone::scene::load(&shipped("mirror_room")).expect("cannot load the shipped scene");
    let mut stream = Stream::new(0, 0, 0);
    let mut primary = Vec::new();
    let mut bounce = Vec::new();
    for _ in 0..4096 {
        let [x, y] = stream.uniform2().map(|u| f64::from(u) * 256.0);
        let ray = Ray { origin: scene.camera.origin, dir: scene.camera.direction(DVec2::new(x, y)) };
        primary.push(ray);
        if let Some(hit) = scene.geometry.intersect(&ray, f32::INFINITY) {
            let s = scene.geometry.surface(&ray, &hit);
            let n = if s.ng.dot(ray.dir) > 0.0 { -s.ng } else { s.ng };
            let dir = (n + warp::sphere(stream.uniform2())).normalize_or(n);
            bounce.push(Ray { origin: scene.geometry.leave(&s, dir), dir });
        }
    }
    let mut group = c.benchmark_group("traversal");
    for (name, rays) in [("primary", &primary), ("diffuse bounce", &bounce)] {
        group.throughput(Throughput::Elements(rays.len() as u64));
        group.bench_function(name, |b| {
            b.iter(|| {
                rays.iter()
                    .filter_map(|r| scene.geometry.intersect(black_box(r), f32::INFINITY))
                    .map(|h| h.t)
                    .sum::<f32>()
            });
        });
    }
    let target = Vec3A::new(0.3, 1.08, 1.75);
    group.throughput(Throughput::Elements(bounce.len() as u64));
    group.bench_function("shadow", |b| {
        b.iter(|| {
            bounce
                .iter()
                .filter(|r| {
                    let v = target - r.origin;
                    let ray = Ray { origin: r.origin, dir: v.normalize() };
                    scene.geometry.occluded(black_box(&ray), v.length() * 0.999)
                })
                .count()
        });
    });
    group.finish();
}

criterion_group!(benches, traversal);
criterion_main!(benches);
