//! Warps from the unit square to directions about +z, each with its density per solid angle.

use crate::polarization::frame::perpendiculars;
use glam::{Vec2, Vec3A};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, FRAC_PI_4};

/// Returns sin x and cos x for |x| ≤ π/4 (radians), accurate to about one unit in the last place (minimax
/// polynomials of `sinf` and `cosf` in Moshier's Cephes). The library function takes five times as long.
#[inline]
fn sin_cos_octant(x: f32) -> (f32, f32) {
    let x2 = x * x;
    let sin = x + x * x2 * (-1.666_665_5e-1 + x2 * (8.332_161e-3 - x2 * 1.951_529_6e-4));
    let cos = 1.0 - 0.5 * x2 + x2 * x2 * (4.166_664_6e-2 + x2 * (-1.388_731_6e-3 + x2 * 2.443_315_7e-5));
    (sin, cos)
}

/// Returns the sine and cosine of `turns` full turns, 0 ≤ turns ≤ 1.
#[inline]
pub fn sin_cos_turns(turns: f32) -> (f32, f32) {
    let quarters = (4.0 * turns + 0.5) as u32;
    let (s, c) = sin_cos_octant((4.0 * turns - quarters as f32) * FRAC_PI_2);
    let (s, c) = if quarters & 1 == 1 { (c, -s) } else { (s, c) };
    if quarters & 2 == 2 { (-s, -c) } else { (s, c) }
}

/// Warps the unit square uniformly to the unit disk (density 1/π) by Shirley & Chiu's concentric map (1997).
#[inline(always)]
pub fn concentric_disk(u: [f32; 2]) -> Vec2 {
    let (a, b) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    // Use conditional moves instead of branches, because a branch would be mispredicted half of the time.
    let wide = a.abs() > b.abs();
    let (r, other) = if wide { (a, b) } else { (b, a) };
    let ratio = other / if r == 0.0 { 1.0 } else { r };
    let (s, c) = sin_cos_octant(FRAC_PI_4 * ratio);
    if wide { Vec2::new(r * c, r * s) } else { Vec2::new(r * s, r * c) }
}

/// Warps the unit square to directions on the hemisphere about +z, with the density [`cosine_pdf`].
#[inline]
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3A {
    let p = concentric_disk(u);
    Vec3A::new(p.x, p.y, (1.0 - p.length_squared()).max(0.0).sqrt())
}

/// Samples directions as [`cosine_hemisphere`] does, about several unit vectors `n` (x, y, z arrays), from
/// one pair of uniform random numbers per vector. The result is bit-identical to `basis(n) *
/// cosine_hemisphere(u)`, but the compiler vectorizes the code.
#[inline(always)]
pub fn cosine_hemispheres<const N: usize>(n: &[[f32; N]; 3], u: &[[f32; N]; 2]) -> [[f32; N]; 3] {
    let x = perpendiculars(n);
    let mut out = [[0.0; N]; 3];
    for i in 0..N {
        let p = concentric_disk([u[0][i], u[1][i]]);
        let height = (1.0 - p.length_squared()).max(0.0).sqrt();
        let [nx, ny, nz] = [n[0][i], n[1][i], n[2][i]];
        // Compute the basis in the same way as `basis`.
        let [xx, xy, xz] = [x[0][i], x[1][i], x[2][i]];
        let [yx, yy, yz] = [ny * xz - nz * xy, nz * xx - nx * xz, nx * xy - ny * xx];
        out[0][i] = xx * p.x + yx * p.y + nx * height;
        out[1][i] = xy * p.x + yy * p.y + ny * height;
        out[2][i] = xz * p.x + yz * p.y + nz * height;
    }
    out
}

/// Returns the density of [`cosine_hemisphere`] per steradian: cosθ / π on the upper hemisphere, 0 below.
#[inline]
pub fn cosine_pdf(w: Vec3A) -> f32 {
    w.z.max(0.0) * FRAC_1_PI
}

/// Warps the unit square uniformly to directions on the unit sphere, with the density 1/(4π).
#[inline]
pub fn sphere(u: [f32; 2]) -> Vec3A {
    let z = 1.0 - 2.0 * u[0];
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (s, c) = sin_cos_turns(u[1]);
    Vec3A::new(r * c, r * s, z)
}

/// Samples a normal visible from the unit direction `wo` (wo.z > 0) under the isotropic GGX distribution of
/// roughness `alpha`, by spherical caps (Dupuy & Benyoub 2023). The density is
/// [`super::microfacet::Microfacet::visible_pdf`].
#[inline]
pub fn ggx_visible_normal(wo: Vec3A, alpha: f32, u: [f32; 2]) -> Vec3A {
    let w = Vec3A::new(alpha * wo.x, alpha * wo.y, wo.z).normalize();
    let z = (1.0 - u[1]) * (1.0 + w.z) - w.z;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (s, c) = sin_cos_turns(u[0]);
    let h = Vec3A::new(r * c, r * s, z) + w;
    Vec3A::new(alpha * h.x, alpha * h.y, h.z.max(0.0)).normalize()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sampling::stream::Stream;
    use std::f32::consts::{PI, TAU};

    #[test]
    fn sines_match_the_standard_library() {
        for i in 0..=100_000 {
            let x = i as f32 / 100_000.0;
            let (s, c) = sin_cos_turns(x);
            let (s64, c64) = (std::f64::consts::TAU * f64::from(x)).sin_cos();
            assert!((f64::from(s) - s64).abs() < 1.5e-7 && (f64::from(c) - c64).abs() < 1.5e-7, "{x}");
        }
    }

    /// Tests 2^18 samples of a sampler against its density by Pearson's chi² on a 20 × 40 grid in (cosθ, φ).
    pub fn chi2(sample: impl Fn([f32; 2]) -> Vec3A, pdf: impl Fn(Vec3A) -> f32) {
        const N: usize = 1 << 18;
        const ROWS: usize = 20;
        const COLUMNS: usize = 40;
        let mut observed = vec![0.0_f64; ROWS * COLUMNS];
        let mut stream = Stream::new(3, 0, 0);
        for _ in 0..N {
            let w = sample(stream.uniform2());
            assert!((w.length() - 1.0).abs() < 1e-4);
            let row = (((w.z + 1.0) / 2.0 * ROWS as f32) as usize).min(ROWS - 1);
            let phi = (w.y.atan2(w.x) / TAU).rem_euclid(1.0);
            let column = ((phi * COLUMNS as f32) as usize).min(COLUMNS - 1);
            observed[row * COLUMNS + column] += 1.0;
        }
        // Compute expected counts by a 24 × 24 midpoint rule per cell (dω = dcosθ dφ).
        const SUB: usize = 24;
        let (mut chi, mut dof, mut pooled_o, mut pooled_e, mut total) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for row in 0..ROWS {
            for column in 0..COLUMNS {
                let mut e = 0.0_f64;
                for i in 0..SUB {
                    for j in 0..SUB {
                        let z = -1.0 + 2.0 * (row as f32 + (i as f32 + 0.5) / SUB as f32) / ROWS as f32;
                        let phi = TAU * (column as f32 + (j as f32 + 0.5) / SUB as f32) / COLUMNS as f32;
                        let r = (1.0 - z * z).sqrt();
                        e += f64::from(pdf(Vec3A::new(r * phi.cos(), r * phi.sin(), z)));
                    }
                }
                let cell = f64::from(2.0 * TAU) / (ROWS * COLUMNS * SUB * SUB) as f64;
                e *= cell * N as f64;
                total += e;
                let o = observed[row * COLUMNS + column];
                if e < 10.0 {
                    pooled_o += o;
                    pooled_e += e;
                } else {
                    chi += (o - e).powi(2) / e;
                    dof += 1.0;
                }
            }
        }
        if pooled_e > 5.0 {
            chi += (pooled_o - pooled_e).powi(2) / pooled_e;
            dof += 1.0;
        } else {
            assert!(pooled_o <= pooled_e + 5.0 * pooled_e.sqrt() + 10.0, "samples where the density is zero");
        }
        assert!((total / N as f64 - 1.0).abs() < 0.01, "density integrates to {}", total / N as f64);
        // By the Wilson–Hilferty transformation, (χ²/k)^(1/3) is nearly normal.
        let z = ((chi / dof).cbrt() - (1.0 - 2.0 / (9.0 * dof))) / (2.0 / (9.0 * dof)).sqrt();
        assert!(z < 5.0, "chi² = {chi} on {dof} degrees of freedom, z = {z}");
    }

    #[test]
    fn chi2_sphere() {
        chi2(sphere, |_| 1.0 / (4.0 * PI));
    }

    #[test]
    fn chi2_cosine_hemisphere() {
        chi2(cosine_hemisphere, cosine_pdf);
    }

    #[test]
    fn batched_hemisphere_samples_equal_single_ones() {
        use crate::polarization::frame::basis;
        let mut stream = Stream::new(8, 0, 0);
        for _ in 0..1000 {
            let n: [Vec3A; 16] = std::array::from_fn(|_| sphere(stream.uniform2()));
            let u: [[f32; 2]; 16] = std::array::from_fn(|_| stream.uniform2());
            let several =
                cosine_hemispheres(&[0, 1, 2].map(|k| n.map(|v| v[k])), &[0, 1].map(|k| u.map(|v| v[k])));
            for i in 0..16 {
                let alone = basis(n[i]) * cosine_hemisphere(u[i]);
                assert_eq!(several.map(|v| v[i].to_bits()), alone.to_array().map(f32::to_bits));
            }
        }
    }

    #[test]
    fn concentric_disk_covers_the_disk() {
        let mut stream = Stream::new(1, 2, 3);
        let (n, mut inside, mut x2) = (100_000, 0.0, 0.0);
        for _ in 0..n {
            let p = concentric_disk(stream.uniform2());
            assert!(p.length() <= 1.0 + 1e-6);
            inside += f64::from(u8::from(p.length() < 0.5));
            x2 += f64::from(p.x * p.x);
        }
        let m = f64::from(n);
        assert!((inside / m - 0.25).abs() < 5.0 * (0.25 * 0.75 / m).sqrt());
        assert!((x2 / m - 0.25).abs() < 5.0 * (1.0 / 16.0 / m).sqrt());
    }
}
