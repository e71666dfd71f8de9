//! Compares doubling with published values: Coulson's tables, Siewert's spheroids, and Chandrasekhar's
//! atmosphere. Tests invariants of doubling.
//!
//! Reference values have all printed digits of the tables.

use crate::doubling::{Slab, phase_matrix, rayleigh};
use crate::optics::{M, assert_close};
use crate::slab::{mie, spheres};
use std::f64::consts::PI;
use sunstone::transport::medium::scattered::Elements;

/// Compares I, Q and U of light that leaves the top of a Rayleigh slab with all digits of the tables of
/// Coulson, Dave & Sekera (1960). Natraj, Li & Yung (2009, ApJ 691, 1909) recomputed the tables of Coulson,
/// Dave & Sekera.
///
/// The slab has τ = 0.5 over a black ground, under a sun of flux π at cos θ0 = 0.2. The signs of Q and U are
/// those of Sunstone's frames.
#[test]
#[ignore = "slow: tools/check --all"]
fn doubling_matches_the_table_of_coulson() {
    let mu0 = 0.2;
    let slab = Slab::new(&rayleigh, [0.5, 1.0], 24, &[mu0, 0.02, 0.4, 1.0], &[0, 1, 2], 18);
    for (phi, mu, want) in [
        (0.0, 0.02, [0.441_298_02, -0.017_531_41, 0.0]),
        (0.0, 0.4, [0.168_890_20, 0.011_195_11, 0.0]),
        (0.0, 1.0, [0.053_004_96, 0.037_558_59, 0.0]),
        (60.0, 0.02, [0.300_912_08, -0.159_656_01, -0.073_655_28]),
        (60.0, 0.4, [0.127_524_50, -0.060_660_38, -0.052_938_67]),
        (60.0, 1.0, [0.053_004_96, -0.018_779_30, -0.032_526_69]),
    ] {
        let m: M = slab.reflected(mu, mu0, f64::to_radians(phi)) * PI;
        for (i, want) in want.into_iter().enumerate() {
            let got = m[(i, 0)];
            assert!((got - want).abs() < 2e-8, "{phi}°, μ = {mu}, s{i}: {got} is not {want}");
        }
        assert!(m[(3, 0)].abs() < 1e-12, "dipoles make no circular light");
    }
}

/// Returns the generalized spherical functions d^l_mn for l = 2 … 11 and n = ±2 (Hovenier, van der Mee &
/// Domke 2004, app. B).
fn wigner(m: f64, n: f64, first: f64, mu: f64) -> Vec<f64> {
    let (mut before, mut d) = (0.0, first);
    let mut out = vec![];
    for l in 2..=11 {
        out.push(d);
        let l = f64::from(l);
        let root = |l: f64| ((l * l - m * m) * (l * l - n * n)).sqrt();
        let next = ((2.0 * l + 1.0) * (l * (l + 1.0) * mu - m * n) * d - (l + 1.0) * root(l) * before)
            / (l * root(l + 1.0));
        (before, d) = (d, next);
    }
    out
}

/// Returns the scattering matrix of randomly oriented oblate spheroids, which is problem IIA of Siewert
/// (2000, JQSRT 64, 227). The function uses Siewert's expansion coefficients (α1, β1, α2, α3, α4, β2 for l =
/// 0 … 11).
fn spheroids(mu: f64) -> Elements<f64> {
    const A1: [f64; 12] = [
        1.0, 2.104_031, 2.095_158, 1.414_939, 0.703_593, 0.235_001, 0.064_039, 0.012_837, 0.002_010,
        0.000_246, 0.000_024, 0.000_002,
    ];
    const A4: [f64; 12] = [
        0.915_207, 2.095_727, 2.008_624, 1.436_545, 0.706_244, 0.238_475, 0.056_448, 0.009_703, 0.001_267,
        0.000_130, 0.000_011, 0.000_001,
    ];
    const A2: [f64; 10] = [
        3.726_079, 2.202_868, 1.190_694, 0.391_203, 0.105_556, 0.020_484, 0.003_097, 0.000_366, 0.000_035,
        0.000_003,
    ];
    const A3: [f64; 10] = [
        3.615_946, 2.240_516, 1.139_473, 0.365_605, 0.082_779, 0.013_649, 0.001_721, 0.000_172, 0.000_014,
        0.000_001,
    ];
    const B1: [f64; 10] = [
        -0.116_688, -0.209_370, -0.227_137, -0.144_524, -0.052_640, -0.012_400, -0.002_093, -0.000_267,
        -0.000_027, -0.000_002,
    ];
    const B2: [f64; 10] = [
        0.065_456, 0.221_658, 0.097_752, 0.052_458, 0.009_239, 0.001_411, 0.000_133, 0.000_011, 0.000_001,
        0.0,
    ];
    let mut legendre = [1.0, mu, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    for l in 2..12 {
        let n = l as f64;
        legendre[l] = ((2.0 * n - 1.0) * mu * legendre[l - 1] - (n - 1.0) * legendre[l - 2]) / n;
    }
    let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / (4.0 * PI);
    let both = |sign: f64| A2.iter().zip(A3).map(|(a, b)| a + sign * b).collect::<Vec<_>>();
    let plus = sum(&both(1.0), &wigner(2.0, 2.0, 0.25 * (1.0 + mu).powi(2), mu));
    let minus = sum(&both(-1.0), &wigner(2.0, -2.0, 0.25 * (1.0 - mu).powi(2), mu));
    let d02 = wigner(0.0, 2.0, 6.0_f64.sqrt() / 4.0 * (1.0 - mu * mu), mu);
    Elements {
        s11: sum(&A1, &legendre),
        s12: sum(&B1, &d02),
        s22: 0.5 * (plus + minus),
        s33: 0.5 * (plus - minus),
        s34: sum(&B2, &d02),
        s44: sum(&A4, &legendre),
    }
}

/// Compares I, Q and U of light that leaves the top of a slab of [`spheroids`] with Siewert's tables. The
/// slab has τ = 1 and ϖ = 0.973527, under a sun of flux π at cos θ0 = 0.6. All six distinct elements of the
/// matrix contribute.
#[test]
#[ignore = "slow: tools/check --all"]
fn doubling_matches_the_tables_of_siewert() {
    let mu0 = 0.6;
    let orders: Vec<usize> = (0..=11).collect();
    let slab = Slab::new(&spheroids, [1.0, 0.973_527], 14, &[mu0, 1.0, 0.5, 0.2], &orders, 16);
    for (phi, mu, want) in [
        (0.0, 1.0, [0.050_687_3, -0.002_623_88, 0.0]),
        (0.0, 0.5, [0.339_136, -0.028_224_2, 0.0]),
        (0.0, 0.2, [0.751_295, -0.063_856_1, 0.0]),
        (180.0, 0.5, [0.068_410_6, 0.001_962_15, 0.0]),
        (180.0, 0.2, [0.080_152_3, 0.002_437_40, 0.0]),
        (90.0, 1.0, [0.050_687_3, 0.002_623_88, 0.0]),
        (90.0, 0.5, [0.124_626, 0.005_121_23, 0.008_041_40]),
        (90.0, 0.2, [0.169_216, 0.006_962_60, 0.009_122_19]),
    ] {
        let m: M = slab.reflected(mu, mu0, f64::to_radians(phi)) * PI;
        for (i, want) in want.into_iter().enumerate() {
            let got = m[(i, 0)];
            // The tolerance includes half a unit of the last printed digit, and the rounding of the
            // coefficients.
            let tolerance = 1e-6 * f64::abs(want) + if i == 0 { 6e-7 } else { 6e-8 };
            assert!((got - want).abs() < tolerance, "{phi}°, μ = {mu}, s{i}: {got} is not {want}");
        }
    }
}

/// Tests light that leaves a thick Rayleigh slab at the bottom. The distribution must equal that of
/// Chandrasekhar's atmosphere with a constant net flux (Radiative Transfer, 1950, table XXIV). The table
/// lists intensities in the meridian plane and perpendicular to this plane.
#[test]
fn thick_slabs_match_the_atmosphere_of_chandrasekhar() {
    let table = [
        (0.1, [0.242_47, 0.281_50]),
        (0.2, [0.290_57, 0.323_81]),
        (0.4, [0.380_10, 0.403_88]),
        (0.6, [0.466_24, 0.481_65]),
        (0.8, [0.550_87, 0.558_44]),
        (1.0, [0.634_69, 0.634_69]),
    ];
    let mus = table.map(|row| row.0);
    let interest = [&mus[..], &[0.5]].concat();
    let slab = Slab::new(&rayleigh, [64.0, 1.0], 16, &interest, &[0], 22);
    let of = |mu: f64| {
        let m = slab.transmitted(mu, 0.5, 0.0);
        [m[(0, 0)] - m[(1, 0)], m[(0, 0)] + m[(1, 0)]]
    };
    let unit = table[5].1[0] / of(1.0)[0];
    for (mu, want) in table {
        for (got, want) in of(mu).into_iter().zip(want) {
            assert!((got * unit - want).abs() < 2e-5, "μ = {mu}: {} is not {want}", got * unit);
        }
    }
}

/// Compares doubling with the closed form of single scattering. Tests the reciprocity and energy conservation
/// of multiple scattering.
#[test]
fn doubling_keeps_its_invariants() {
    let (mu, mu0, phi) = (0.7, 0.3, 1.1);
    let orders: Vec<usize> = (0..=11).collect();
    let tau = 1e-5;
    let thin = Slab::new(&spheroids, [tau, 0.8], 8, &[mu, mu0], &orders, 4);
    for (got, up) in [(thin.reflected(mu, mu0, phi), 1.0), (thin.transmitted(mu, mu0, phi), -1.0)] {
        let want = phase_matrix(&spheroids, [up * mu, phi], [-mu0, 0.0]) * (0.8 * tau / mu);
        // Second scattering contributes about 10 τ times the light of single scattering.
        assert_close(&got, &want, 2e-4, "single scattering");
    }
    let slab = Slab::new(&spheroids, [3.0, 1.0], 14, &[mu, mu0], &[0, 1, 2], 18);
    let d = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
    let back = d * slab.reflected(mu0, mu, -phi).transpose() * d * (mu0 / mu);
    assert_close(&slab.reflected(mu, mu0, phi), &back, 1e-6, "reciprocity of reflection");
    let back = d * slab.transmitted(mu0, mu, -phi).transpose() * d * (mu0 / mu);
    // The matrix X changes the frames, because the slab is seen from below.
    let x = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, -1.0));
    assert_close(&slab.transmitted(mu, mu0, phi), &(x * back * x), 1e-6, "reciprocity of transmission");
    let [up, down] = slab.shares(mu0);
    assert!((up + down - 1.0).abs() < 2e-6, "{up} + {down}");
}

/// Tests the light that a slab of polystyrene spheres in vacuum reflects at normal incidence. The slab has
/// optical depth 4.
///
/// The reference is Evans & Stephens' adding-doubling (Ramella-Roman, Prahl & Jacques 2005, "Three Monte
/// Carlo programs of polarized light transport into scattering media: part I", table of reflectances; 632.8
/// nm, index 1.59).
#[test]
fn reflectance_of_spheres_matches_ramella_roman() {
    for (diameter_nm, want) in [(1000.0, 0.447_99), (2000.0, 0.293_01)] {
        let ensemble = spheres(1.0, diameter_nm);
        let slab = Slab::new(&mie(&ensemble), [4.0, 1.0], 16, &[1.0], &[0], 22);
        let [up, down] = slab.shares(1.0);
        println!("{diameter_nm} nm: {up:.5}, published {want}");
        assert!((up - want).abs() < 1e-5, "{diameter_nm} nm: {up} is not {want}");
        assert!((up + down - 1.0).abs() < 1e-6, "{up} and {down}");
    }
}
