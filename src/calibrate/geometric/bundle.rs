//! Bundle adjustment (Triggs et al. 2000) by Levenberg–Marquardt over all parameters. The Schur complement
//! eliminates the poses of the views.
//!
//! The projector coordinate q of a corner is measured with the camera. An error δ of the measured corner c
//! causes the error Jδ of q. J is the local derivative of projector pixels with respect to camera pixels.
//! With predicted coordinates ĉ and q̂, the projector residual is therefore q + J(ĉ - c) - q̂. The error of c
//! cancels in this residual, so the residuals of camera and projector are independent.

use super::device::{Device, Seen};
use super::pose::Pose;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Matrix6, MatrixXx6, SMatrix, Vector2, Vector3, Vector6};

/// A corner of the board in one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Position on the board, in metres.
    pub board: Vector3<f64>,
    /// Position in the camera image, in continuous pixels.
    pub camera: Vector2<f64>,
    /// The projector pixel that illuminates the corner, and its derivative with respect to the camera
    /// pixel (0 if both pixels are measured independently).
    pub projector: Option<(Vector2<f64>, Matrix2<f64>)>,
}

/// Index of the free parameter on which a device parameter depends, and the factor of proportionality.
pub type Tie = Option<(usize, f64)>;

/// All estimated parameters.
#[derive(Clone, Debug)]
pub struct State {
    /// The camera, and the projector if there is one.
    pub devices: Vec<Device>,
    /// The free parameter on which each device parameter depends. Indices count the free parameters of
    /// all devices.
    pub ties: Vec<Vec<Tie>>,
    /// Number of free device parameters. With two devices, the six parameters of `relative` come after them.
    pub free: usize,
    /// Pose from camera to projector.
    pub relative: Pose,
    /// Poses from board to camera, one per view.
    pub poses: Vec<Pose>,
}

#[derive(Clone, Debug)]
pub struct Weights {
    /// For each device, the standard deviation of a measured coordinate in pixels. A device with an infinite
    /// value is ignored.
    pub sigma: Vec<f64>,
    /// Huber's threshold in standard deviations of a coordinate. If the threshold is infinite, the loss is
    /// half the squared residual.
    pub huber: f64,
    /// For each view and corner, whether the corner is excluded from the fit.
    pub out: Vec<Vec<bool>>,
}

/// The normal equations of the least-squares problem, linearized at a state.
#[derive(Clone, Debug)]
pub struct Normal {
    pub(super) shared: DMatrix<f64>,
    pub(super) mixed: Vec<MatrixXx6<f64>>,
    pub(super) own: Vec<Matrix6<f64>>,
    shared_right: DVector<f64>,
    own_right: Vec<Vector6<f64>>,
}

type Residual = (Vector2<f64>, Option<Vector2<f64>>);

impl State {
    /// Returns the number of shared free parameters.
    pub fn shared(&self) -> usize {
        self.free + if self.devices.len() > 1 { 6 } else { 0 }
    }

    /// Returns measured minus predicted pixels of a corner for both devices, or `None` if the corner is
    /// behind a device.
    pub fn residual(&self, view: usize, corner: &Corner) -> Option<Residual> {
        let x = self.poses[view].apply(corner.board);
        let seen = self.devices[0].project(&x)?;
        let thrown = match (&corner.projector, self.devices.get(1)) {
            (Some((q, j)), Some(projector)) => {
                let at = projector.project(&self.relative.apply(x))?;
                Some(q + j * (seen - corner.camera) - at)
            }
            _ => None,
        };
        Some((corner.camera - seen, thrown))
    }

    /// Returns the state after adding a solution of the normal equations to its parameters.
    pub fn changed(&self, shared: &DVector<f64>, own: &[Vector6<f64>]) -> Self {
        let mut next = self.clone();
        for (device, ties) in next.devices.iter_mut().zip(&self.ties) {
            let moved: Vec<f64> = device
                .parameters()
                .iter()
                .zip(ties)
                .map(|(p, tie)| p + tie.map_or(0.0, |(i, by)| by * shared[i]))
                .collect();
            *device = device.with(&moved);
        }
        if self.devices.len() > 1 {
            next.relative = self.relative.changed(std::array::from_fn(|i| shared[self.free + i]));
        }
        for (pose, by) in next.poses.iter_mut().zip(own) {
            *pose = pose.changed((*by).into());
        }
        next
    }

    /// Returns the sum of Huber's losses, or half the sum of squares if the threshold is infinite. The
    /// cost is infinite if a corner is behind a device.
    pub fn cost(&self, views: &[Vec<Corner>], w: &Weights) -> f64 {
        let mut sum = 0.0;
        for (v, corners) in views.iter().enumerate() {
            for (corner, _) in corners.iter().zip(&w.out[v]).filter(|(_, out)| !**out) {
                let Some((a, b)) = self.residual(v, corner) else {
                    return f64::INFINITY;
                };
                sum += huber(a.norm() / w.sigma[0], w.huber).0;
                if let Some(b) = b {
                    sum += huber(b.norm() / w.sigma[1], w.huber).0;
                }
            }
        }
        if sum.is_nan() { f64::INFINITY } else { sum }
    }

    /// Returns the Jacobian and the residuals of a view, divided by their standard deviations, and the cost.
    ///
    /// The columns are the shared parameters, then the six pose parameters of the view. Returns `None` if a
    /// corner is behind a device.
    pub fn rows(
        &self,
        v: usize,
        corners: &[Corner],
        w: &Weights,
    ) -> Option<(DMatrix<f64>, DVector<f64>, f64)> {
        let n = self.shared();
        let lenses: Vec<_> = self.devices.iter().map(Device::lens).collect();
        let pose = &self.poses[v];
        let rows: usize = corners.iter().map(|c| if c.projector.is_some() { 4 } else { 2 }).sum();
        let mut jacobian = DMatrix::zeros(rows, n + 6);
        let mut residual = DVector::zeros(rows);
        let (mut row, mut sum) = (0, 0.0);
        for (corner, _) in corners.iter().zip(&w.out[v]).filter(|(_, out)| !**out) {
            let x = pose.apply(corner.board);
            let turned = pose.rotation * corner.board;
            let camera = self.devices[0].see(&lenses[0], &x)?;
            let off = corner.camera - camera.at;
            let (cost, weight) = huber(off.norm() / w.sigma[0], w.huber);
            sum += cost;
            let scale = weight.sqrt() / w.sigma[0];
            let by_pose = camera.by_point * moves(&turned);
            self.fill(&mut jacobian, row, 0, &camera, &Matrix2::identity(), scale);
            jacobian.fixed_view_mut::<2, 6>(row, n).copy_from(&(by_pose * scale));
            residual.fixed_rows_mut::<2>(row).copy_from(&(off * scale));
            row += 2;
            let (Some((q, j)), Some(projector)) = (&corner.projector, self.devices.get(1)) else {
                continue;
            };
            let far = self.relative.rotation * x;
            let thrown = projector.see(&lenses[1], &(far + self.relative.translation))?;
            // The predicted projector residual depends on both devices.
            let off = q - j * off - thrown.at;
            let (cost, weight) = huber(off.norm() / w.sigma[1], w.huber);
            sum += cost;
            let scale = weight.sqrt() / w.sigma[1];
            self.fill(&mut jacobian, row, 0, &camera, &-j, scale);
            self.fill(&mut jacobian, row, 1, &thrown, &Matrix2::identity(), scale);
            let by_relative = thrown.by_point * moves(&far) * scale;
            jacobian.fixed_view_mut::<2, 6>(row, self.free).copy_from(&by_relative);
            let turn = thrown.by_point * self.relative.rotation;
            let own = (turn * moves(&turned) - j * by_pose) * scale;
            jacobian.fixed_view_mut::<2, 6>(row, n).copy_from(&own);
            residual.fixed_rows_mut::<2>(row).copy_from(&(off * scale));
            row += 2;
        }
        Some((jacobian, residual, sum))
    }

    /// Returns the normal equations, or `None` if a corner is behind a device.
    pub fn linearized(&self, views: &[Vec<Corner>], w: &Weights) -> Option<Normal> {
        let n = self.shared();
        let mut normal = Normal {
            shared: DMatrix::zeros(n, n),
            mixed: vec![],
            own: vec![],
            shared_right: DVector::zeros(n),
            own_right: vec![],
        };
        for (v, corners) in views.iter().enumerate() {
            let (jacobian, residual, _) = self.rows(v, corners, w)?;
            let squared = jacobian.tr_mul(&jacobian);
            let right = jacobian.tr_mul(&residual);
            normal.shared += squared.view((0, 0), (n, n));
            normal.mixed.push(squared.fixed_columns::<6>(n).rows(0, n).into_owned());
            normal.own.push(squared.fixed_view::<6, 6>(n, n).into_owned());
            normal.shared_right += right.rows(0, n);
            normal.own_right.push(right.fixed_rows::<6>(n).into_owned());
        }
        Some(normal)
    }

    /// Adds to the Jacobian the derivatives with respect to a device's parameters, multiplied by a matrix.
    fn fill(
        &self,
        out: &mut DMatrix<f64>,
        row: usize,
        device: usize,
        seen: &Seen,
        by: &Matrix2<f64>,
        scale: f64,
    ) {
        for (tie, d) in self.ties[device].iter().zip(&seen.by_parameters) {
            if let Some((i, factor)) = tie {
                let d = by * d * (factor * scale);
                out[(row, *i)] += d.x;
                out[(row + 1, *i)] += d.y;
            }
        }
    }
}

/// Returns the derivative of R x + t with respect to a change of the pose. `turned` is R x.
fn moves(turned: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
    let mut m = SMatrix::<f64, 3, 6>::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&-turned.cross_matrix());
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
    m
}

/// Returns Huber's loss for a distance, and the weight of the squared distance.
fn huber(r: f64, bound: f64) -> (f64, f64) {
    if r <= bound || r.is_nan() { (0.5 * r * r, 1.0) } else { (bound * (r - 0.5 * bound), bound / r) }
}

impl Normal {
    /// Returns the Levenberg–Marquardt step, or the Gauss–Newton step if `damping` is 0.
    fn step(&self, damping: f64) -> Option<(DVector<f64>, Vec<Vector6<f64>>)> {
        let damped = |d: f64| d + damping * d.max(1e-30);
        let mut schur = self.shared.clone();
        for i in 0..schur.nrows() {
            schur[(i, i)] = damped(schur[(i, i)]);
        }
        let mut right = self.shared_right.clone();
        let mut inverses = vec![];
        for ((own, mixed), own_right) in self.own.iter().zip(&self.mixed).zip(&self.own_right) {
            let mut own = *own;
            for i in 0..6 {
                own[(i, i)] = damped(own[(i, i)]);
            }
            let inverse = own.cholesky()?.inverse();
            let folded = mixed * inverse;
            schur -= &folded * mixed.transpose();
            right -= &folded * own_right;
            inverses.push(inverse);
        }
        // Parameters differ by orders of magnitude, so the matrix is scaled to unit diagonal.
        let scale = schur.diagonal().map(|d| if d > 0.0 { d.sqrt().recip() } else { 1.0 });
        let d = DMatrix::from_diagonal(&scale);
        let solved = (&d * schur * &d).cholesky()?.solve(&right.component_mul(&scale));
        let shared = solved.component_mul(&scale);
        let own = inverses
            .iter()
            .zip(&self.mixed)
            .zip(&self.own_right)
            .map(|((inverse, mixed), right)| inverse * (right - mixed.tr_mul(&shared)))
            .collect();
        shared.iter().all(|x| x.is_finite()).then_some((shared, own))
    }
}

/// Minimizes the cost. Stops after `most` steps, or if a step reduces the cost by less than the fraction
/// `least`.
///
/// Returns `None` if a corner is behind a device at the start.
pub fn minimize(
    start: &State,
    views: &[Vec<Corner>],
    w: &Weights,
    most: usize,
    least: f64,
) -> Option<(State, f64)> {
    let mut state = start.clone();
    let mut cost = state.cost(views, w);
    if !cost.is_finite() {
        return None;
    }
    let mut damping = 1e-3;
    for _ in 0..most {
        let normal = state.linearized(views, w)?;
        let before = cost;
        loop {
            if let Some((shared, own)) = normal.step(damping) {
                let next = state.changed(&shared, &own);
                let now = next.cost(views, w);
                if now <= cost {
                    damping = (damping * 0.1).max(1e-15);
                    (state, cost) = (next, now);
                    break;
                }
            }
            damping *= 10.0;
            if damping > 1e8 {
                return Some((state, cost));
            }
        }
        if before - cost < least * before || cost < 1e-22 {
            break;
        }
    }
    Some((state, cost))
}
