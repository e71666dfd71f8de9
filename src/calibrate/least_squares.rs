//! Nonlinear least squares that reports undetermined parameters.
//!
//! The fit is Gauss–Newton with Levenberg–Marquardt damping, on residuals divided by their standard
//! deviations. Along a direction in parameter space that affects no residual, the parameters keep their
//! initial values. The fit reports each of these directions. The singular values of the Jacobian with
//! normalized columns determine the undetermined directions.

use nalgebra::{DMatrix, DVector};

/// Singular value, relative to the largest one, below which a direction in parameter space is undetermined.
const NOTHING: f64 = 1e-6;
/// The report names a parameter if the undetermined direction has at least this component along the
/// parameter.
const NAMED: f64 = 0.1;
const STEPS: usize = 100;

/// The reason why a fit fails.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FitError {
    #[error(
        "{residuals} measurements cannot determine {parameters} parameters; capture more samples, or more settings of the elements"
    )]
    TooFew { residuals: usize, parameters: usize },
    #[error("a measurement or a prediction is not a finite number; exclude saturated and dark regions")]
    NotFinite,
    #[error(
        "the fit does not converge; improve the initial values, and check that every sample has the correct label"
    )]
    Unsettled,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    pub values: DVector<f64>,
    /// Covariance of the parameters. The covariance is zero along undetermined directions.
    pub covariance: DMatrix<f64>,
    /// Chi-squared, which is the sum of squared residuals, each divided by its variance.
    pub chi_squared: f64,
    /// Number of measurements minus number of determined parameters.
    pub freedom: usize,
    /// Undetermined directions, as unit vectors in the space of parameters scaled by their sensitivity.
    pub undetermined: Vec<DVector<f64>>,
}

impl Fit {
    /// Returns the standard deviation of a parameter, or `None` if the parameter is part of an
    /// undetermined direction.
    pub fn sigma(&self, i: usize) -> Option<f64> {
        let message = self.undetermined.iter().all(|d| d[i].abs() < NAMED);
        message.then(|| self.covariance[(i, i)].max(0.0).sqrt())
    }

    /// Describes the undetermined directions by the parameters' names.
    pub fn describe_undetermined(&self, names: &[String]) -> Vec<String> {
        let words = |d: &DVector<f64>| {
            let parts: Vec<&str> = (0..d.len())
                .filter(|i| d[*i].abs() >= NAMED)
                .map(|i| names.get(i).map_or("?", String::as_str))
                .collect();
            match parts[..] {
                [one] => format!("{one}: no sample depends on this parameter, so the initial value is kept"),
                _ => format!(
                    "{}: the samples determine these parameters only together; undetermined combinations keep their initial values",
                    parts.join(", ")
                ),
            }
        };
        self.undetermined.iter().map(words).collect()
    }
}

fn cost(r: &DVector<f64>) -> f64 {
    r.norm_squared()
}

/// Fits parameters from `start`.
///
/// `residuals` maps parameters to measured minus predicted values, divided by their standard deviations.
/// `steps` holds the steps for central differences, about a hundredth of the largest expected error of
/// each parameter.
///
/// # Errors
/// Returns [`FitError`] if residuals are too few or not finite, or if the iteration does not converge.
pub fn fit(start: &[f64], steps: &[f64], residuals: &dyn Fn(&[f64]) -> Vec<f64>) -> Result<Fit, FitError> {
    let n = start.len();
    let mut x = DVector::from_column_slice(start);
    let of = |x: &DVector<f64>| DVector::from_vec(residuals(x.as_slice()));
    let mut r = of(&x);
    if r.len() < n {
        return Err(FitError::TooFew { residuals: r.len(), parameters: n });
    }
    let jacobian = |x: &DVector<f64>| {
        let columns: Vec<DVector<f64>> = (0..n)
            .map(|i| {
                let moved = |by: f64| {
                    let mut y = x.clone();
                    y[i] += by;
                    of(&y)
                };
                // The derivative of the prediction has the opposite sign of the residuals' derivative.
                (moved(-steps[i]) - moved(steps[i])) / (2.0 * steps[i])
            })
            .collect();
        DMatrix::from_columns(&columns)
    };
    let mut damping = 1e-3;
    let mut settled = false;
    for _ in 0..STEPS {
        if !cost(&r).is_finite() {
            return Err(FitError::NotFinite);
        }
        let message = Reported::of(&jacobian(&x))?;
        let mut better = false;
        while damping < 1e12 {
            let step = message.step(&r, damping);
            let next = &x + &step;
            let after = of(&next);
            if cost(&after) <= cost(&r) * (1.0 + 1e-14) {
                let gain = cost(&r) - cost(&after);
                let small = (0..n).all(|i| step[i].abs() < 1e-7 * steps[i]);
                (x, r) = (next, after);
                damping = (damping / 10.0).max(1e-15);
                better = true;
                settled = small || gain < 1e-10 * (1.0 + cost(&r));
                break;
            }
            damping *= 10.0;
        }
        if settled || !better {
            settled = true;
            break;
        }
    }
    if !settled {
        return Err(FitError::Unsettled);
    }
    let message = Reported::of(&jacobian(&x))?;
    Ok(Fit {
        covariance: message.covariance(),
        chi_squared: cost(&r),
        freedom: r.len() - message.rank,
        undetermined: message.undetermined(),
        values: x,
    })
}

/// The singular values and vectors of a scaled Jacobian.
struct Reported {
    scale: DVector<f64>,
    u: DMatrix<f64>,
    s: DVector<f64>,
    v: DMatrix<f64>,
    rank: usize,
}

impl Reported {
    fn of(j: &DMatrix<f64>) -> Result<Self, FitError> {
        if j.iter().any(|v| !v.is_finite()) {
            return Err(FitError::NotFinite);
        }
        let n = j.ncols();
        let longest = (0..n).map(|i| j.column(i).norm()).fold(0.0, f64::max);
        // A zero column remains zero.
        let scale = DVector::from_fn(n, |i, _| {
            let norm = j.column(i).norm();
            if norm > 1e-12 * longest { norm } else { f64::INFINITY }
        });
        let scaled = DMatrix::from_fn(j.nrows(), n, |i, k| j[(i, k)] / scale[k]);
        // The eigenvectors of JᵀJ are used because J has many rows but few columns.
        let eigen = (scaled.transpose() * &scaled).symmetric_eigen();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let s = DVector::from_fn(n, |i, _| eigen.eigenvalues[order[i]].max(0.0).sqrt());
        let v = DMatrix::from_fn(n, n, |i, k| eigen.eigenvectors[(i, order[k])]);
        let most = s.iter().copied().fold(0.0, f64::max);
        let rank = s.iter().filter(|s| **s > NOTHING * most && **s > 0.0).count();
        let u = DMatrix::from_fn(j.nrows(), rank, |i, k| (scaled.row(i) * v.column(k))[0] / s[k]);
        Ok(Self { scale, u, s, v, rank })
    }

    /// Returns the right singular vector `k` in the unscaled parameters.
    fn direction(&self, k: usize) -> DVector<f64> {
        DVector::from_fn(self.scale.len(), |i, _| self.v[(i, k)] / self.scale[i])
    }

    fn step(&self, r: &DVector<f64>, damping: f64) -> DVector<f64> {
        let mut out = DVector::zeros(self.scale.len());
        for k in 0..self.rank {
            let along = self.u.column(k).dot(r) * self.s[k] / (self.s[k].powi(2) + damping);
            out += self.direction(k) * along;
        }
        out
    }

    fn covariance(&self) -> DMatrix<f64> {
        let n = self.scale.len();
        let mut out = DMatrix::zeros(n, n);
        for k in 0..self.rank {
            let d = self.direction(k) / self.s[k];
            out += &d * d.transpose();
        }
        out
    }

    fn undetermined(&self) -> Vec<DVector<f64>> {
        (self.rank..self.scale.len()).map(|k| self.v.column(k).into_owned()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fit of a exp(-b t) + c to exact data yields exact parameters from a distant start.
    #[test]
    fn exact_data_give_exact_parameters() {
        let t: Vec<f64> = (0..20).map(|i| f64::from(i) * 0.2).collect();
        let model = |p: &[f64], t: f64| p[0] * (-p[1] * t).exp() + p[2];
        let truth = [2.0, 1.3, 0.5];
        let residuals =
            |p: &[f64]| -> Vec<f64> { t.iter().map(|t| (model(&truth, *t) - model(p, *t)) / 0.01).collect() };
        let found = fit(&[1.0, 0.5, 0.0], &[0.01; 3], &residuals).expect("a fit");
        for (a, b) in found.values.iter().zip(truth) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
        assert!(found.undetermined.is_empty() && found.freedom == 17);
    }

    #[test]
    fn undetermined_parameters_are_named_and_unchanged() {
        let t: Vec<f64> = (0..9).map(f64::from).collect();
        // The residuals depend only on a + b, and not on d.
        let residuals =
            |p: &[f64]| -> Vec<f64> { t.iter().map(|t| 3.0 * t + 1.0 - (p[0] + p[1]) * t - p[2]).collect() };
        let found = fit(&[1.0, 1.0, 0.0, 7.0], &[0.01; 4], &residuals).expect("a fit");
        assert!((found.values[0] - 1.5).abs() < 1e-6 && (found.values[1] - 1.5).abs() < 1e-6);
        assert_eq!(found.values[3], 7.0);
        assert_eq!(found.undetermined.len(), 2);
        let names = ["a", "b", "c", "d"].map(String::from);
        let words = found.describe_undetermined(&names).join("; ");
        assert!(
            words.contains("a, b: the samples determine these parameters only together")
                && words.contains("d: no sample"),
            "{words}"
        );
        assert_eq!(found.sigma(0), None);
        assert!(found.sigma(2).is_some());
        assert!(matches!(fit(&[0.0; 3], &[0.1; 3], &|_| vec![1.0]), Err(FitError::TooFew { .. })));
        assert_eq!(fit(&[0.0], &[0.1], &|_| vec![f64::NAN; 3]), Err(FitError::NotFinite));
    }
}
