//! Measures renders of the mirror room at 64×64 pixels and 16 spp, with all slices and with the conventional
//! slice alone.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use sunstone::render::{Target, Unwatched, render};
use sunstone_benches::shipped;

fn whole(c: &mut Criterion) {
    let text = std::fs::read_to_string(shipped("mirror_room"))
        .expect("cannot read the shipped scene")
        .replace("resolution = [256, 256]", "resolution = [64, 64]")
        .replace("rows = [150]", "rows = [37]")
        .replace("binned = [1, 256]", "binned = [1, 64]")
        .replace("spp = 128", "spp = 16");
    let mut scene =
        sunstone::scene::from_text(&shipped("mirror_room"), &text).expect("the small scene is valid");
    let dir = tempfile::tempdir().expect("cannot create a temporary folder");
    let target = Target { path: dir.path().join("bench.zarr"), resume: false, replace: true };
    let mut group = c.benchmark_group("render");
    group.sample_size(10).throughput(Throughput::Elements(64 * 64 * 16));
    group.bench_function("all slices", |b| {
        b.iter(|| render(&scene, &target, &Unwatched).is_ok());
    });
    scene.change_slices(|all| all.retain(|s| s.name == "conventional"));
    group.bench_function("conventional alone", |b| {
        b.iter(|| render(&scene, &target, &Unwatched).is_ok());
    });
    group.finish();
}

criterion_group!(benches, whole);
criterion_main!(benches);
