//! Computes the Lu–Chipman decomposition of custom, noisy Mueller matrices of a quarter-wave plate in front
//! of a depolarizer.
//!
//! `cargo run --release --example decompose_array`

use sunstone::polarimetry::decompose::cloude::{is_realizable, nearest};
use sunstone::polarimetry::decompose::lu_chipman::{DOUBLE, decompose};
use sunstone::polarimetry::decompose::properties::Properties;

fn main() {
    // The input is twelve noisy copies of a Mueller matrix, row by row. The matrix is that of a quarter-wave
    // plate with its fast axis at 30 degrees in front of a depolarizer of factor 0.5.
    let (c, s) = (60.0_f64.to_radians().cos(), 60.0_f64.to_radians().sin());
    let plate = [[1.0, 0.0, 0.0, 0.0], [0.0, c * c, c * s, -s], [0.0, c * s, s * s, c], [0.0, s, -c, 0.0]];
    println!("retardance deg  axis deg  depolarization  realizable");
    for k in 0..12 {
        let mut m = plate;
        for (i, row) in m.iter_mut().enumerate() {
            for (j, e) in row.iter_mut().enumerate() {
                let noise = ((k * 16 + i * 4 + j) as f64 * 12.9898).sin() * 0.01;
                *e = *e * if i + j == 0 { 1.0 } else { 0.5 } + noise;
            }
        }
        let realizable = is_realizable(&m, 1e-9);
        let Some(m) = (if realizable { Some(m) } else { nearest(&m) }) else {
            continue;
        };
        let Some(parts) = decompose(&m, DOUBLE) else {
            continue;
        };
        let p = Properties::of(&m, &parts);
        let axis = 0.5 * p.axis[1].atan2(p.axis[0]).to_degrees();
        println!("{:14.2}  {axis:8.2}  {:14.4}  {realizable}", p.retardance.to_degrees(), p.depolarization);
    }
}
