//! First and second moments of examples, which are the sufficient statistics of linear least squares. The
//! size of the moments does not depend on the number of examples.

use nalgebra::{DMatrix, DMatrixView, DVector};

/// Sums over examples (x, y), with a vector of features x and a target y.
#[derive(Clone, Debug, PartialEq)]
pub struct Moments {
    /// Number n of examples.
    pub count: f64,
    /// Σ x.
    pub x: DVector<f64>,
    /// Σ y.
    pub y: f64,
    /// Σ x xᵀ.
    pub xx: DMatrix<f64>,
    /// Σ x y.
    pub xy: DVector<f64>,
    /// Σ y².
    pub yy: f64,
    /// Σ of the squared standard errors of x.
    pub noise: DVector<f64>,
}

/// A linear model: y ≈ weights · x + offset.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    pub weights: DVector<f64>,
    pub offset: f64,
}

impl Linear {
    /// Returns the estimate of y for a feature vector.
    pub fn of(&self, features: &[f64]) -> f64 {
        self.offset + features.iter().zip(self.weights.iter()).map(|(x, w)| x * w).sum::<f64>()
    }
}

impl Moments {
    /// Returns the moments of an empty set of examples.
    pub fn none(features: usize) -> Self {
        Self {
            count: 0.0,
            x: DVector::zeros(features),
            y: 0.0,
            xx: DMatrix::zeros(features, features),
            xy: DVector::zeros(features),
            yy: 0.0,
            noise: DVector::zeros(features),
        }
    }

    /// Returns the moments of examples. `x` and `errors` hold the features and their standard errors, example
    /// by example. `y` holds the targets.
    pub fn of(features: usize, x: &[f64], errors: &[f64], y: &[f64]) -> Self {
        let all = DMatrix::from_column_slice(features, y.len(), x);
        let target = DVector::from_column_slice(y);
        let mut noise = DVector::zeros(features);
        for one in errors.chunks_exact(features.max(1)) {
            noise.iter_mut().zip(one).for_each(|(n, e)| *n += e * e);
        }
        Self {
            count: y.len() as f64,
            x: all.column_sum(),
            y: target.sum(),
            xx: &all * all.transpose(),
            xy: &all * &target,
            yy: target.norm_squared(),
            noise,
        }
    }

    /// Returns the moments of the same examples for each of several targets. The sums over features are computed
    /// once.
    pub fn of_each(features: usize, x: &[f64], targets: impl IntoIterator<Item = Vec<f64>>) -> Vec<Self> {
        let examples = x.len() / features.max(1);
        let none = Self::of(features, x, &[], &vec![0.0; examples]);
        targets.into_iter().map(|y| none.with_target(x, &y)).collect()
    }

    /// Returns the moments of the same examples `x` with other targets `y`.
    fn with_target(&self, x: &[f64], y: &[f64]) -> Self {
        let target = DVector::from_column_slice(y);
        let xy = DMatrixView::from_slice(x, self.x.len(), y.len()) * &target;
        Self { y: target.sum(), xy, yy: target.norm_squared(), ..self.clone() }
    }

    /// Adds the moments of other examples.
    pub fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.x += &other.x;
        self.y += other.y;
        self.xx += &other.xx;
        self.xy += &other.xy;
        self.yy += other.yy;
        self.noise += &other.noise;
    }

    /// Returns the sum of all `parts` except the part with index `left_out`.
    pub fn without<'a>(parts: impl IntoIterator<Item = &'a Self>, left_out: usize) -> Self {
        let kept = parts.into_iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, part)| part);
        let sum = kept.fold(None, |sum: Option<Self>, part| match sum {
            Some(mut sum) => {
                sum.add(part);
                Some(sum)
            }
            None => Some(part.clone()),
        });
        sum.unwrap_or_else(|| Self::none(0))
    }

    pub fn sum<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Self {
        Self::without(parts, usize::MAX)
    }

    /// Returns the moments of examples with the features Pᵀ x.
    pub fn projected(&self, p: &DMatrix<f64>) -> Self {
        Self {
            count: self.count,
            x: p.tr_mul(&self.x),
            y: self.y,
            xx: p.tr_mul(&(&self.xx * p)),
            xy: p.tr_mul(&self.xy),
            yy: self.yy,
            noise: p.map(|w| w * w).tr_mul(&self.noise),
        }
    }

    /// Returns the mean squared difference between y and its estimate.
    pub fn loss(&self, fit: &Linear) -> f64 {
        let (w, b) = (&fit.weights, fit.offset);
        let sum = w.dot(&(&self.xx * w)) + self.count * b * b + self.yy + 2.0 * b * w.dot(&self.x)
            - 2.0 * w.dot(&self.xy)
            - 2.0 * b * self.y;
        let mean = sum / self.count;
        // Rounding errors may cause a negative value. NaN is kept.
        if mean < 0.0 { 0.0 } else { mean }
    }

    /// Returns the means and covariances for a fit with a free offset. The result contains the covariances of
    /// the features, and the covariances of the features with y.
    pub fn centred(&self) -> Centred {
        let n = self.count;
        let mean = &self.x / n;
        let y = self.y / n;
        Centred {
            xx: &self.xx / n - &mean * mean.transpose(),
            xy: &self.xy / n - &mean * y,
            noise: &self.noise / n,
            mean,
            y,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Centred {
    /// Covariances of the features.
    pub xx: DMatrix<f64>,
    /// Covariances of the features with y.
    pub xy: DVector<f64>,
    /// Mean squared standard errors of the features.
    pub noise: DVector<f64>,
    pub mean: DVector<f64>,
    pub y: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loss_equals_that_of_the_examples() {
        let x = [1.0, 2.0, -1.0, 0.5, 3.0, 1.0, 0.0, -2.0];
        let y = [1.0, 0.0, 2.0, -1.0];
        let moments = Moments::of(2, &x, &[0.1; 8], &y);
        let fit = Linear { weights: DVector::from_row_slice(&[0.3, -0.7]), offset: 0.2 };
        let direct = x.chunks_exact(2).zip(y).map(|(x, y)| (fit.of(x) - y).powi(2)).sum::<f64>() / 4.0;
        approx::assert_relative_eq!(moments.loss(&fit), direct, epsilon = 1e-12);
        approx::assert_relative_eq!(moments.noise[1], 0.04, epsilon = 1e-12);
        // The sum of parts equals the whole, with and without the exclusion of a part.
        let parts: Vec<Moments> =
            (0..4).map(|i| Moments::of(2, &x[2 * i..2 * i + 2], &[0.1; 2], &y[i..=i])).collect();
        approx::assert_relative_eq!(Moments::sum(&parts).xx, moments.xx, epsilon = 1e-12);
        let three = Moments::of(2, &x[2..], &[0.1; 6], &y[1..]);
        approx::assert_relative_eq!(Moments::without(&parts, 0).xy, three.xy, epsilon = 1e-12);
        // A projection has the moments of the projected examples.
        let w = DMatrix::from_column_slice(2, 1, &[2.0, -1.0]);
        let line: Vec<f64> = x.chunks_exact(2).map(|x| 2.0 * x[0] - x[1]).collect();
        let direct = Moments::of(1, &line, &[0.0; 4], &y);
        approx::assert_relative_eq!(moments.projected(&w).xx, direct.xx, epsilon = 1e-12);
        approx::assert_relative_eq!(moments.projected(&w).xy, direct.xy, epsilon = 1e-12);
    }
}
