//! Tests a capture scheme on custom matrices: noisy capture, reconstruction, and comparison with the true
//! matrices.
//!
//! `cargo run --release --example capture_chain`

use sunstone::polarimetry::capture::design_matrix::{DesignMatrix, a_optimal_bound};
use sunstone::polarimetry::capture::simulate::{Layout, Noise, simulate};
use sunstone::polarimetry::reconstruct::pixels::{Options, Reconstruction};
use sunstone::{Ray, Scheme};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The truth is 64 x 64 pixels of a partial depolarizer whose diattenuation increases from left to right.
    let layout = Layout { height: 64, width: 64, times: 1, lanes: 1 };
    let truth: Vec<f64> = (0..layout.pixels())
        .flat_map(|p| {
            let d = 0.5 * (p % layout.width) as f64 / layout.width as f64;
            let c = (1.0 - d * d).sqrt() * 0.8;
            [1.0, d, 0.0, 0.0, d, 1.0, 0.0, 0.0, 0.0, 0.0, c, 0.0, 0.0, 0.0, 0.0, c]
        })
        .collect();

    let rays = [Ray::axial(550.0)];
    let sigma = 5e-4;
    for captures in [25, 36] {
        let scheme = Scheme::drr(captures, false)?;
        let noise = Noise::Gaussian { sigma };
        let captured = simulate(&truth, layout, &scheme, &rays, &noise, 1)?;

        let reconstruction = Reconstruction::<f32>::new(&scheme, &rays, Options::default())?;
        let mut found = vec![0.0_f32; truth.len()];
        reconstruction.apply(&captured.intensities, None, &mut found, None);

        let off = |(a, b): (&f32, &f64)| (f64::from(*a) - b).powi(2);
        let square: f64 = found.iter().zip(&truth).map(off).sum();
        let predicted = DesignMatrix::new(&scheme, &rays[0]).error_variance()?;
        println!(
            "{captures} captures: rms error {:.3e}, predicted {:.3e}, lower bound {:.3e}",
            (square / truth.len() as f64).sqrt(),
            sigma * (predicted / 16.0).sqrt(),
            sigma * (a_optimal_bound(&scheme) / 16.0).sqrt()
        );
    }
    Ok(())
}
