//! Every option of every command, in turn something that it should not be.

use crate::case::{Case, Expect};

/// Values that no option takes for what they are, and those that some do.
const VALUES: [&str; 14] = [
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e308",
    "1e-308",
    "text",
    "",
    ",",
    "18446744073709551616",
    "1,2,3,4,5,6",
    "١",
    "0x10",
];

/// Commands with `{v}` for an option's value, and the values of [`VALUES`] that are right after all.
#[rustfmt::skip]
const OPTIONS: &[(&str, &[&str])] = &[
    ("render {f}/scene.toml -o out.zarr --spp {v}", &[]),
    ("render {f}/scene.toml -o out.zarr --seed {v}", &["0"]),
    ("render {f}/scene.toml -o out.zarr --threads {v}", &[]),
    ("render {f}/scene.toml -o out.zarr --slices {v}", &[]),
    ("figure {f}/s.zarr {v} -o out", &[]),
    ("figure {f}/s.zarr --view {v} --slice mueller -o out.png", &[]),
    ("figure {f}/s.zarr --view photo --slice {v} -o out.png", &[]),
    ("figure {f}/s.zarr --view mueller --slice mueller --wavelength {v} -o out.png", &[]),
    ("figure {f}/s.zarr --view space-time --slice flight --wavelength {v} -o out.png", &[]),
    ("figure {f}/s.zarr --view space-time --slice flight --element {v} -o out.png", &[]),
    ("figure {f}/s.zarr --view space-time --slice flight --row {v} -o out.png", &["0"]),
    ("figure {f}/s.zarr --view profile --slice flight --pixel {v},1 -o out.png", &["0", "1e-308"]),
    ("figure {f}/s.zarr --view flight --slice flight --frames {v} -o out.png", &[]),
    ("figure {f}/s.zarr --view mueller --slice mueller --limit {v} -o out.png", &["18446744073709551616"]),
    ("figure {f}/s.zarr --view photo --slice mueller --limit {v} -o out.png", &["18446744073709551616"]),
    ("figure {f}/s.zarr --format {v} -o out", &[]),
    ("probe {f}/s.zarr {v} -o out.npy", &[]),
    ("probe {f}/s.zarr mueller -k {v} -o out.npy", &[]),
    ("probe {f}/s.zarr mueller -k x={v} -o out.npy", &["0", "1e-308"]),
    ("probe {f}/s.zarr mueller -k y={v}:2 -o out.npy", &["", "0", "1e-308", "-1"]),
    ("probe {f}/s.zarr mueller -k wavelength={v} -o out.npy", &[]),
    ("probe {f}/s.zarr mueller -k stokes_in={v} -o out.npy", &["0", "1e-308"]),
    ("probe {f}/s.zarr flight -k t={v} -o out.npy", &[]),
    ("probe {f}/s.zarr mueller --sum {v} -o out.npy", &[""]),
    ("probe {f}/s.zarr mueller --preset {v} -o out.npy", &[]),
    ("probe {f}/s.zarr mueller --stokes {v} -o out.npy", &[]),
    ("probe {f}/s.zarr mueller --stokes 1,{v},0,0 -o out.npy", &["-1", "0", "1e-308"]),
    ("probe {f}/s.zarr mueller --stokes {v},0,0,0 -o out.npy", &["18446744073709551616"]),
    ("probe {f}/s.zarr flight --pulse {v} -o out.npy", &[]),
    ("probe {f}/s.zarr flight --pulse gaussian:{v} -o out.npy", &["0", "1e-308"]),
    ("probe {f}/s.zarr flight --pulse samples:{v} -o out.npy", &["1e308", "1e-308", "18446744073709551616", "1,2,3,4,5,6"]),
    ("probe {f}/s.zarr mueller --csv {v}", &[]),
    ("export {f}/s.zarr mueller -o out.exr --expand {v}", &[""]),
    ("export {f}/s.zarr mueller -o out.exr -k {v}", &[]),
    ("export {f}/scene.toml --mitsuba out --wavelength {v}", &[]),
    ("decompose {f}/M.npy -o out.npz --only {v}", &[]),
    ("decompose {f}/s.zarr mueller -o out.npz -k wavelength={v}", &[]),
    ("capture {f}/M.npy --scheme {f}/drr36.toml -o out.npy --wavelengths {v}", &[]),
    ("capture {f}/M.npy --scheme {f}/drr36.toml -o out.npy --noise {v}", &["0", "18446744073709551616"]),
    ("capture {f}/M.npy --scheme {f}/drr36.toml -o out.npy --relative-noise {v}", &["0", "18446744073709551616"]),
    ("capture {f}/M.npy --scheme {f}/drr36.toml -o out.npy --seed {v}", &["0"]),
    ("reconstruct {f}/I.npy --scheme {f}/drr36.toml -o out.npy --wavelengths {v}", &[]),
    ("reconstruct {f}/I.npy --scheme {f}/drr36.toml -o out.npy --noise {v}", &[]),
    ("reconstruct {f}/I.npy --scheme {f}/drr36.toml -o out.npy --saturation {v}", &["1e308", "1e-308", "18446744073709551616"]),
    ("rig run {f}/plan.toml -o out.zarr --sample {v}", &[]),
    ("rig run {f}/plan.toml -o out.zarr --rig {v}", &[]),
    ("rig status {f}/night.zarr --events {v}", &["0"]),
    ("rig calibrate {f}/mirror.zarr -o out.toml --free {v}", &[]),
    ("reconstruct {f}/night.zarr -o out.zarr --mask {v}", &[]),
    ("reconstruct {f}/night.zarr -o out.zarr --view {v}", &["1e-308"]),
    ("reconstruct {f}/night.zarr -o out.zarr --noise {v}", &[]),
    ("reconstruct {f}/night.zarr -o out.zarr --saturation {v}", &[]),
    ("ptu records {f}/photons.ptu --first {v}", &["0"]),
    ("ptu histogram {f}/photons.ptu -o out.npy --bin-ps {v}", &[]),
    ("ptu histogram {f}/photons.ptu -o out.npy --bins {v}", &[]),
    ("ptu histogram {f}/photons.ptu -o out.npy --channel {v}", &["0", "1,2,3,4,5,6"]),
    ("ptu histogram {f}/photons.ptu -o out.npy --pixels {v},2 --pixel-marker 1", &[]),
    ("ptu histogram {f}/photons.ptu -o out.npy --pixels 2,2 --pixel-marker {v}", &[]),
    ("ptu histogram {f}/photons.ptu -o out.npy --pixels 2,2 --pixel-marker 1 --frame-marker {v}", &[]),
    ("ptu write {f}/events.csv -o out.ptu --record {v} --period-ps 100000", &[]),
    ("ptu write {f}/events.csv -o out.ptu --record timeharp-260-p-t3 --period-ps {v}", &[]),
    ("ptu write {f}/events.csv -o out.ptu --record timeharp-260-p-t3 --period-ps 100000 --resolution-ps {v}", &[]),
    ("calibrate counter {f}/scan.zarr -o out.toml --distance {v}", &[]),
    ("calibrate patterns --projector {v} -o out", &[]),
    ("calibrate patterns --projector 6x4 --shifts {v} -o out", &["0"]),
    ("calibrate patterns --projector 6x4 --shifts 4 --period {v} -o out", &[]),
    ("calibrate board {f}/image.png --columns {v} --rows 3 --square 25mm -o out.toml", &[]),
    ("calibrate board {f}/image.png --columns 4 --rows {v} --square 25mm -o out.toml", &[]),
    ("calibrate board {f}/image.png --columns 4 --rows 3 --square {v} -o out.toml", &[]),
    ("calibrate board {f}/image.png --columns 4 --rows 3 --square 25mm --lens {v} -o out.toml", &[]),
    ("calibrate projector {f}/tables --columns 4 --rows 3 --square 25mm --projector {v} -o out.toml", &[]),
    ("calibrate projector {f}/tables --columns 4 --rows 3 --square 25mm --projector 6x4 --reach {v} -o out.toml", &[]),
    ("trial {f}/M.npy --scheme {f}/drr36.toml --noise {v}", &["0", "18446744073709551616"]),
    ("trial {f}/M.npy --scheme {f}/drr36.toml --noise 0.01 --repeat {v}", &[]),
    ("trial {f}/M.npy --scheme {f}/drr36.toml --noise 0.01 --wavelengths {v}", &[]),
    ("scheme drr -k {v} -o out.toml", &[]),
    ("scheme qrpr -k 9 --sensor {v} -o out.toml", &[]),
    ("scheme lc -k {v} -o out.toml", &[]),
    ("scheme show {f}/drr36.toml --wavelengths {v}", &[]),
    ("scheme matrix {f}/drr36.toml -o out.npy --wavelength {v}", &[]),
    ("scheme matrix {f}/drr36.toml -o out.npy --incidence {v}", &["0", "1e-308"]),
    ("scheme matrix {f}/drr36.toml -o out.npy --azimuth {v}", &["0", "-1", "1e-308"]),
    ("learn -k {v} --starts 1 --iterations 1 --adam-steps 1 -o out.toml", &[]),
    ("learn -k 16 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --sensor {v}", &[]),
    ("learn -k 16 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --estimator {v}", &[]),
    ("learn -k 16 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --noise {v}", &[]),
    ("learn -k 16 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --angle-error {v} --data {f}/tables --folds 0", &["0", "1e-308"]),
    ("learn -k 16 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --wavelengths {v}", &[]),
    ("learn -k 9 --data {f}/tables --starts 1 --iterations 1 --adam-steps 1 -o out.toml --folds {v}", &["0"]),
    ("learn -k 9 --data {f}/tables --folds 0 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --bands {v}", &[]),
    ("learn -k 9 --starts 1 --iterations 1 --adam-steps 1 -o out.toml --resolution {v}", &[]),
    ("learn -k 16 --starts {v} --iterations 1 --adam-steps 1 -o out.toml", &["0"]),
    ("learn -k 16 --starts 1 --iterations {v} --adam-steps 1 -o out.toml", &["0"]),
    ("learn -k 16 --starts 1 --iterations 1 --adam-steps {v} -o out.toml", &["0"]),
    ("pbrdf eval {f}/materials.toml --in {v} --out 20,0", &[]),
    ("pbrdf eval {f}/materials.toml --in 40,0 --out {v},0", &["0", "-1", "1e-308"]),
    ("pbrdf eval {f}/materials.toml --in 40,0 --out 20,0 --uv {v},0", &["0", "-1", "1e-308"]),
    ("pbrdf eval {f}/materials.toml --in 40,0 --out 20,0 --name {v}", &[]),
    ("pbrdf sheet {f}/materials.toml -o out.png --size {v} --spp 1", &[]),
    ("pbrdf sheet {f}/materials.toml -o out.png --size 8 --spp {v}", &[]),
    ("pbrdf sheet {f}/materials.toml -o out.png --size 8 --spp 1 --wavelength {v}", &[]),
    ("pbrdf sheet {f}/materials.toml -o out.png --size 8 --spp 1 --columns {v}", &[]),
    ("pbrdf synth {f}/materials.toml -o out --resolution {v}", &[]),
    ("pbrdf synth {f}/materials.toml -o out --resolution 3x3x3 --bands {v}", &[]),
    ("pbrdf synth {f}/materials.toml -o out --resolution 3x3x3 --name {v}", &[]),
    ("pbrdf plot {f}/table.pbsdf -o out.png --phi-d {v}", &["0", "-1", "1e-308"]),
    ("pbrdf slice {f}/table.pbsdf -o out.npy --phi-d {v}", &["0", "-1", "1e-308"]),
    ("pbrdf slice {f}/table.pbsdf -o out.npy --theta-d {v}", &["0", "-1", "1e-308"]),
    ("pbrdf slice {f}/table.pbsdf -o out.npy --theta-h {v}", &["0", "-1", "1e-308"]),
    ("pbrdf slice {f}/table.pbsdf -o out.npy --wavelength {v}", &[]),
    ("pbrdf pca --data {f}/tables -o out.png -c {v} --bands 550", &[]),
    ("pbrdf pca --data {f}/tables -o out.png -n {v} --bands 550", &[]),
    ("pbrdf pca --data {f}/tables -o out.png --map {v} --bands 550", &[]),
    ("pbrdf pca --data {f}/tables -o out.png --bands {v}", &[]),
    ("phase eval {f}/media.toml --wavelengths {v}", &[]),
    ("phase eval {f}/media.toml --angles {v}", &["1,2,3,4,5,6", "1e-308"]),
    ("phase eval {f}/media.toml --name {v}", &[]),
    ("import {f}/calibration.yaml --view {v}", &[]),
    ("import {f}/calibration.yaml --camera {v}", &[]),
    ("import {f}/calibration.yaml --as {v}", &[]),
    ("import {f}/calibration.yaml --resolution {v}", &[]),
    ("import {f}/calibration.yaml --resolution {v}x48", &[]),
    ("import {f}/calibration.yaml --metres-per-unit {v}", &[]),
    ("import {f}/mitsuba/scene.xml -o out.toml -D {v}", &[]),
    ("import {f}/mitsuba/scene.xml -o out.toml -D wavelengths_nm={v}", &[]),
];

/// Calls that are wrong in ways of their own.
#[rustfmt::skip]
const ODD: &[&str] = &[
    "", "no-such-command", "render", "render --spp", "merge {f}/s.zarr -o out.zarr", "merge {f}/s.zarr {f}/s.zarr -o out.zarr",
    "denoise -o out.zarr", "denoise {f}/s.zarr", "denoise {f}/s.zarr {f}/s.zarr -o out.zarr", "denoise {f}/s.zarr {f}/empty -o out.zarr",
    "probe {f}/s.zarr", "probe {f}/s.zarr mueller -k wavelength=900", "probe {f}/s.zarr mueller -k wavelength=400:430",
    "figure {f}/s.zarr --view mueller --slice mueller --wavelength 900 -o out.png",
    "pbrdf sheet {f}/materials.toml -o out.png --size 8 --spp 1 --wavelength 900",
    "pbrdf slice {f}/table.pbsdf -o out.npy --wavelength 900",
    "pbrdf slice {f}/table.pbsdf -o out.npy --theta-h 100",
    "pbrdf slice {f}/table.pbsdf -o out.npy --theta-d=-10",
    "pbrdf slice {f}/table.pbsdf -o out.npy --phi-d 720",
    "decompose {f}/M.npy --errors {f}/negative_errors.npy -o out.npz",
    "reconstruct {f}/I.npy --scheme {f}/drr36.toml --variance {f}/negative.npy -o out.npy",
    "probe {f}/s.zarr mueller --csv a.csv", "probe {f}/s.zarr mueller --csv - -o out.npy",
    "probe {f}/s.zarr mueller --stokes 1,1,1,1 -o out.npy", "probe {f}/s.zarr mueller --stokes 0,0,0,0 -o out.npy",
    "probe {f}/s.zarr mueller --stokes=-1,0,0,0 -o out.npy",
    "render {f}/scene.toml -o out.zarr --resume --force", "render {f}/scene.toml -o out.zarr --threads 100000",
    "verify {f}", "info {f}", "info {f}/empty", "verify {f}/empty", "merge {f}/s.zarr {f}/empty -o out.zarr",
    "capture {f}/s.zarr mueller --scheme {f}/drr36.toml --wavelengths 550 -o out.npy",
    "reconstruct {f}/I.npy --scheme {f}/drr9.toml -o out.npy",
    "reconstruct {f}/M.npy --scheme {f}/drr36.toml -o out.npy",
    "reconstruct {f}/I.npy --scheme {f}/drr36.toml --prior {f}/prior.toml -o out.npy",
    "learn -k 0 -o out.toml", "learn -k 257 -o out.toml", "learn -k 9,10 --angles a.png -o out",
    "learn -k 9 --data {f}/empty -o out.toml", "pbrdf pca --data {f}/empty -o out.png",
    "learn -k 9 --data {f}/tables --folds 2 --starts 1 -o out.toml",
    "learn -k 9 --data {f}/tables --folds 1 --starts 1 -o out.toml",
];

pub fn cases() -> Vec<Case> {
    let mut cases = vec![];
    for (line, right) in OPTIONS {
        for value in VALUES {
            let mut case = Case::new(format!("{line}: {value:?}"), line);
            // Behind a sign, a value would be taken for an option of its own.
            let joined = value.starts_with('-');
            let mut arguments: Vec<String> = vec![];
            for word in &case.arguments {
                let filled = word.replace("{v}", value);
                match arguments.last_mut() {
                    Some(last) if joined && word.starts_with("{v}") && last.starts_with("--") => {
                        *last = format!("{last}={filled}");
                    }
                    _ => arguments.push(filled),
                }
            }
            case.arguments = arguments;
            cases.push(if right.contains(&value) {
                case.expect(Expect::Accepted)
            } else {
                case
            });
        }
    }
    cases.extend(ODD.iter().map(|line| Case::new(format!("odd: {line}"), line)));
    cases
}
