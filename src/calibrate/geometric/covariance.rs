//! Covariances of all parameters from the triangular factor (QR) of the Jacobian. Normal equations would lose
//! half of the digits, but rational lenses need all digits.

use super::bundle::{Corner, Normal, State, Weights};
use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, MatrixXx6, Vector6};

/// Square root of the information matrix, with the poses of the views eliminated.
pub struct Root {
    /// The factor R, for which RᵀR is the Fisher information of the shared parameters for unknown poses.
    shared: DMatrix<f64>,
    /// Norms of the Jacobian's columns.
    lengths: DVector<f64>,
    /// For each view, the factor of the view's pose, the coupling to the shared parameters, and the
    /// transformed residuals.
    own: Vec<(Matrix6<f64>, Matrix6xX<f64>, Vector6<f64>)>,
    /// Transformed residuals that belong to the shared parameters.
    right: DVector<f64>,
}

pub struct Covariance {
    pub shared: DMatrix<f64>,
    pub own: Vec<Matrix6<f64>>,
    /// Covariance between the shared parameters and each pose.
    pub mixed: Vec<MatrixXx6<f64>>,
}

impl Root {
    /// Computes the factor for a state. Returns `None` if a corner is behind a device or a number is not
    /// finite.
    pub fn of(state: &State, views: &[Vec<Corner>], w: &Weights) -> Option<Self> {
        let n = state.shared();
        // The last column contains the residuals.
        let mut all = DMatrix::zeros(0, n + 1);
        let mut squares = DVector::zeros(n);
        let mut own = vec![];
        for (v, corners) in views.iter().enumerate() {
            let (jacobian, residual, _) = state.rows(v, corners, w)?;
            if !jacobian.iter().all(|x| x.is_finite()) {
                return None;
            }
            let rows = jacobian.nrows();
            // The columns of the pose are first. Zero rows pad views that have fewer measurements than
            // parameters.
            let mut ordered = DMatrix::zeros(rows.max(n + 7), n + 7);
            ordered.view_mut((0, 0), (rows, 6)).copy_from(&jacobian.columns(n, 6));
            ordered.view_mut((0, 6), (rows, n)).copy_from(&jacobian.columns(0, n));
            ordered.view_mut((0, n + 6), (rows, 1)).copy_from(&residual);
            for i in 0..n {
                squares[i] += jacobian.column(i).norm_squared();
            }
            let r = ordered.qr().r();
            own.push((
                r.fixed_view::<6, 6>(0, 0).into_owned(),
                r.fixed_rows::<6>(0).columns(6, n).into_owned(),
                r.fixed_view::<6, 1>(0, n + 6).into_owned(),
            ));
            let old = all.nrows();
            let mut stacked = DMatrix::zeros(old + n + 1, n + 1);
            stacked.rows_mut(0, old).copy_from(&all);
            stacked.rows_mut(old, n + 1).copy_from(&r.view((6, 6), (n + 1, n + 1)));
            all = stacked.qr().r();
        }
        Some(Self {
            shared: all.view((0, 0), (n, n)).into_owned(),
            lengths: squares.map(f64::sqrt),
            own,
            right: all.view((0, n), (n, 1)).column(0).into_owned(),
        })
    }

    /// Returns the Gauss–Newton step of shared parameters and poses, or `None` if the system is singular.
    fn step(&self) -> Option<(DVector<f64>, Vec<Vector6<f64>>)> {
        let shared = self.shared.solve_upper_triangular(&self.right)?;
        let of = |(r, beside, right): &(Matrix6<f64>, Matrix6xX<f64>, Vector6<f64>)| {
            r.solve_upper_triangular(&(right - beside * &shared))
        };
        let own: Option<Vec<_>> = self.own.iter().map(of).collect();
        let finite = shared.iter().all(|x| x.is_finite());
        Some((shared.clone(), own?)).filter(|_| finite)
    }

    /// Finds the combination of shared parameters that the measurements determine worst. Returns how well it
    /// is determined, from 0 (not at all) to about 1, and the coefficients of this combination.
    ///
    /// The result is the smallest singular value of the root with its singular vector. Each column of the
    /// root is divided by the square root of the information that known poses would give.
    pub fn least_known(&self) -> Option<(f64, DVector<f64>)> {
        let scale = self.lengths.map(|d| if d > 0.0 { d.recip() } else { 0.0 });
        let svd = (&self.shared * DMatrix::from_diagonal(&scale)).try_svd(false, true, 1e-16, 10_000)?;
        let least = svd.singular_values.imin();
        Some((svd.singular_values[least], svd.v_t?.row(least).transpose()))
    }

    /// Returns the covariances, or `None` if the information matrix is singular.
    pub fn invert(&self) -> Option<Covariance> {
        let n = self.shared.ncols();
        let back = self.shared.solve_upper_triangular(&DMatrix::identity(n, n))?;
        let shared = &back * back.transpose();
        let (mut own, mut mixed) = (vec![], vec![]);
        for (r, beside, _) in &self.own {
            let inverse = r.solve_upper_triangular(&Matrix6::identity())?;
            let path = inverse * beside;
            let root = &path * &back;
            own.push(inverse * inverse.transpose() + &root * root.transpose());
            mixed.push(-(&shared * path.transpose()));
        }
        let finite = shared.iter().all(|x| x.is_finite());
        finite.then_some(Covariance { shared, own, mixed })
    }
}

impl Covariance {
    /// Returns tr(C N), which is the effective number of parameters that a subset of the measurements
    /// determines. N is the matrix of the subset's normal equations.
    pub fn taken(&self, part: &Normal) -> f64 {
        let mut sum = self.shared.component_mul(&part.shared).sum();
        for v in 0..part.own.len() {
            sum += self.own[v].component_mul(&part.own[v]).sum();
            sum += 2.0 * self.mixed[v].component_mul(&part.mixed[v]).sum();
        }
        sum
    }
}

/// Refines the Levenberg–Marquardt result by a few Gauss–Newton steps, which recover digits that the
/// normal equations lose. The iteration ends when a step no longer reduces the cost.
pub fn polish(mut state: State, views: &[Vec<Corner>], w: &Weights) -> State {
    let mut cost = state.cost(views, w);
    for _ in 0..10 {
        let step = Root::of(&state, views, w).and_then(|r| r.step());
        let Some((shared, own)) = step else { break };
        let next = state.changed(&shared, &own);
        let now = next.cost(views, w);
        if now.is_nan() || now >= cost {
            break;
        }
        let done = cost - now < 1e-12 * cost;
        (state, cost) = (next, now);
        if done {
            break;
        }
    }
    state
}
