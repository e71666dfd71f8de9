//! Distributions of particle radii, and quadrature over the radii.
//!
//! The distributions are number densities n(r) with ∫ n dr = 1:
//!
//! - log-normal: n(r) = exp(-ln²(r/r_g)/(2σ²))/(√(2π) σ r), with the median r_g and the standard deviation σ
//!   of ln r. The mean of r^k is ⟨r^k⟩ = r_g^k exp(k² σ²/2).
//! - gamma (Hansen 1971, J. Atmos. Sci. 28, 1400): n(r) ∝ r^{(1-3b)/b} exp(-r/(ab)). The area-weighted mean
//!   is the effective radius a, and the area-weighted relative variance is the effective variance b < 1/2.
//!
//! Smooth distributions are integrated with the trapezoidal rule in ln r. For functions that vanish at both
//! ends, the trapezoidal rule converges faster than any power of the step. The resonances of large
//! transparent spheres are narrower than any grid step and limit the accuracy. With about 60 points per unit
//! of the size parameter, the coefficients of a cloud are accurate to about 10⁻⁵. With 4 points, the
//! coefficients are accurate to about 10⁻³.

use optics::sampling::gamma::ln_gamma;
use std::f64::consts::PI;

/// Distribution of particle radii, metres.
#[derive(Clone, Debug, PartialEq)]
pub enum SizeDistribution {
    /// All particles have the same radius, metres.
    Single { radius: f64 },
    /// A log-normal distribution, given by the median in metres and the standard deviation of ln r.
    LogNormal { median: f64, sigma: f64 },
    /// The gamma distribution of Hansen.
    Gamma {
        /// Effective radius ⟨r³⟩/⟨r²⟩, metres.
        effective_radius: f64,
        /// Effective variance (dimensionless).
        effective_variance: f64,
    },
    /// A list of radii in metres with relative numbers of particles.
    List(Vec<[f64; 2]>),
}

/// Reasons why a distribution is rejected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SizeError {
    #[error("the particle radius is {0} m; expected a radius from 1e-12 m to 0.01 m")]
    Radius(f64),
    #[error("sigma is {0}; expected a standard deviation of ln r from 0.001 to 2")]
    Sigma(f64),
    #[error("the effective variance is {0}; expected 0.001 to 0.45")]
    Variance(f64),
    #[error("a weight in the list of sizes is {0}; expected a finite number of at least 0")]
    Weight(f64),
    #[error("the list of sizes has no entry with a positive weight; add an entry with a positive weight")]
    List,
}

/// Minimum and maximum number of points of a quadrature.
const POINTS: [f64; 2] = [500.0, 8000.0];

/// Maximum product of the number of points and the cube of the largest size parameter. The cost of computing
/// a phase function is nearly proportional to this product.
const WORK: f64 = 2.6e11;

/// Fraction of the integrand's maximum below which the integrand is neglected at both ends.
const NEGLIGIBLE: f64 = 1e-10;

/// Returns the error `error` if the condition `good` is false.
fn refuse_unless(good: bool, error: SizeError) -> Result<(), SizeError> {
    if good { Ok(()) } else { Err(error) }
}

impl SizeDistribution {
    /// Checks the parameters of the distribution.
    ///
    /// # Errors
    /// Returns a [`SizeError`] if a parameter is out of range.
    pub fn check(&self) -> Result<(), SizeError> {
        let radius = |r: f64| refuse_unless((1e-12..=0.01).contains(&r), SizeError::Radius(r));
        match self {
            Self::Single { radius: r } => radius(*r),
            Self::LogNormal { median, sigma } => {
                radius(*median)?;
                refuse_unless((1e-3..=2.0).contains(sigma), SizeError::Sigma(*sigma))
            }
            Self::Gamma { effective_radius, effective_variance: b } => {
                radius(*effective_radius)?;
                refuse_unless((1e-3..=0.45).contains(b), SizeError::Variance(*b))
            }
            Self::List(list) => {
                list.iter().try_for_each(|[r, _]| radius(*r))?;
                let weight = |w: f64| refuse_unless(w.is_finite() && w >= 0.0, SizeError::Weight(w));
                list.iter().try_for_each(|[_, w]| weight(*w))?;
                refuse_unless(list.iter().map(|[_, w]| w).sum::<f64>() > 0.0, SizeError::List)
            }
        }
    }

    /// Returns the mean volume of a particle, m³.
    pub(crate) fn mean_volume(&self) -> f64 {
        let cube = match self {
            Self::Single { radius } => radius.powi(3),
            Self::LogNormal { median, sigma } => median.powi(3) * (4.5 * sigma * sigma).exp(),
            // For a gamma density with shape k and scale ab, ⟨r³⟩ is k (k+1) (k+2) (ab)³.
            Self::Gamma { effective_radius: a, effective_variance: b } => {
                let k = (1.0 - 2.0 * b) / b;
                k * (k + 1.0) * (k + 2.0) * (a * b).powi(3)
            }
            Self::List(list) => {
                let sum: f64 = list.iter().map(|[_, w]| w).sum();
                list.iter().map(|[r, w]| r.powi(3) * w).sum::<f64>() / sum
            }
        };
        4.0 / 3.0 * PI * cube
    }

    /// Returns ln(r n(r)), the logarithm of the density in ln r, at the radius with logarithm `ln_r`.
    fn ln_density(&self, ln_r: f64) -> f64 {
        match self {
            Self::LogNormal { median, sigma } => {
                let t = (ln_r - median.ln()) / sigma;
                -0.5 * t * t - ((2.0 * PI).sqrt() * sigma).ln()
            }
            Self::Gamma { effective_radius: a, effective_variance: b } => {
                let k = (1.0 - 2.0 * b) / b;
                let t = ln_r - (a * b).ln();
                k * t - t.exp() - ln_gamma(k)
            }
            Self::Single { .. } | Self::List(_) => f64::NEG_INFINITY,
        }
    }

    /// Returns pairs of a radius in metres and a fraction of the number of particles. `wave_number` is k = 2π
    /// n_host/λ in 1/m. The fractions add up to 1, except for insignificantly small particles.
    ///
    /// The range ends where the integrand of the cross section is below 10⁻¹⁰ of its maximum. Below x = 1,
    /// the cross section is bounded by x³, relative to the cross section at x = 1. Above x = 1, the exponent
    /// of the cross section decreases from 6 to 2, and the code uses the larger bound.
    pub fn quadrature(&self, wave_number: f64) -> Vec<[f64; 2]> {
        let (centre, width) = match self {
            Self::Single { radius } => return vec![[*radius, 1.0]],
            Self::List(list) => {
                let sum: f64 = list.iter().map(|[_, w]| w).sum();
                let some = list.iter().filter(|[_, w]| *w > 0.0);
                return some.map(|[r, w]| [*r, w / sum]).collect();
            }
            Self::LogNormal { median, sigma } => (median.ln(), *sigma),
            Self::Gamma { effective_radius: a, effective_variance: b } => (a.ln(), b.sqrt()),
        };
        // Find the ends of the range by a coarse scan.
        let (first, last) = (centre - 12.0 * width - 2.0, centre + (12.0 + 6.0 * width) * width);
        let steps = 4000;
        let at = |i: usize| first + (last - first) * i as f64 / steps as f64;
        let ends = |weight: &dyn Fn(f64) -> f64| {
            let values: Vec<f64> = (0..=steps)
                .map(|i| self.ln_density(at(i)) + weight((wave_number * at(i).exp()).max(1e-300)))
                .collect();
            let floor = values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(*v)) + NEGLIGIBLE.ln();
            let low = values.iter().position(|v| *v > floor).unwrap_or(0);
            let high = values.iter().rposition(|v| *v > floor).unwrap_or(steps);
            (at(low), at(high))
        };
        let (low, _) = ends(&|x| 3.0 * x.ln() - (1.0 + x).ln());
        let (_, high) = ends(&|x| 6.0 * x.ln() - (1.0 + (x / 2.0).powi(4)).ln());
        let range = wave_number * (high.exp() - low.exp());
        // The Mie series of large spheres are long. For size parameters above about 300, use fewer points to
        // avoid a computation of several minutes.
        let most = (WORK / (wave_number * high.exp()).powi(3)).max(24.0);
        let count = (64.0 * range).clamp(POINTS[0], POINTS[1]).min(most) as usize;
        let step = (high - low) / count as f64;
        let point = |i: usize| {
            let u = low + step * i as f64;
            [u.exp(), step * self.ln_density(u).exp()]
        };
        (0..=count).map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(points: &[[f64; 2]], k: i32) -> f64 {
        points.iter().map(|[r, w]| w * r.powi(k)).sum()
    }

    #[test]
    fn quadratures_have_the_moments_of_their_densities() {
        let (median, sigma) = (3e-7, 0.5);
        let points = SizeDistribution::LogNormal { median, sigma }.quadrature(1.8e7);
        for k in 2..=4 {
            let want = median.powi(k) * (0.5 * f64::from(k * k) * sigma * sigma).exp();
            assert!((moment(&points, k) / want - 1.0).abs() < 1e-8, "⟨r^{k}⟩");
        }
        let (a, b) = (1e-6, 0.1);
        let gamma = SizeDistribution::Gamma { effective_radius: a, effective_variance: b };
        let points = gamma.quadrature(1.8e7);
        let area = moment(&points, 2);
        let mean = moment(&points, 3) / area;
        assert!((mean / a - 1.0).abs() < 1e-8, "effective radius {mean}");
        let variance = (moment(&points, 4) / area - mean * mean) / (mean * mean);
        assert!((variance / b - 1.0).abs() < 1e-7, "effective variance {variance}");
        assert!((moment(&points, 0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn mean_volumes_match_the_quadratures() {
        for sizes in [
            SizeDistribution::Single { radius: 2e-7 },
            SizeDistribution::LogNormal { median: 1e-7, sigma: 0.3 },
            SizeDistribution::Gamma { effective_radius: 5e-7, effective_variance: 0.2 },
            SizeDistribution::List(vec![[1e-7, 3.0], [2e-7, 1.0]]),
        ] {
            let points = sizes.quadrature(1.5e7);
            let got = 4.0 / 3.0 * PI * moment(&points, 3);
            let want = sizes.mean_volume();
            assert!((got / want - 1.0).abs() < 1e-7, "{sizes:?}: {got} {want}");
        }
    }

    #[test]
    fn invalid_distributions_are_refused() {
        let bad = [
            SizeDistribution::Single { radius: 0.0 },
            SizeDistribution::Single { radius: f64::NAN },
            SizeDistribution::LogNormal { median: 1e-7, sigma: 0.0 },
            SizeDistribution::Gamma { effective_radius: 1e-7, effective_variance: 0.5 },
            SizeDistribution::List(vec![]),
            SizeDistribution::List(vec![[1e-7, -1.0]]),
            SizeDistribution::List(vec![[1e-7, 0.0]]),
        ];
        for sizes in bad {
            assert!(sizes.check().is_err(), "{sizes:?}");
        }
    }
}
