//! Fits devices to corners. The steps are the initial estimate, bundle adjustment, the estimation of noise
//! and covariances, and notes on poorly determined parameters.

use super::bundle::{Corner, State, Weights, minimize};
use super::covariance::{Covariance, Root, polish};
use super::device::{Device, Free, Model, count};
use super::fault::Fault;
use super::pose::Pose;
use super::{open, zhang};
use nalgebra::{DMatrix, Matrix3, Matrix6, Vector2, Vector3};

/// Fit settings of one device.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub model: Model,
    pub free: Free,
    /// Initial device, with the values of fixed parameters. If `None`, the device is estimated from the
    /// views.
    pub start: Option<Device>,
}

impl Setup {
    /// Creates a setup with all parameters free.
    pub fn new(size: [u32; 2], model: Model) -> Self {
        Self { size, model, free: Free::default(), start: None }
    }
}

/// A calibration with its covariances.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The camera, and the projector if there is one.
    pub devices: Vec<Device>,
    /// Pose from camera to projector, or the identity without a projector.
    pub relative: Pose,
    /// Poses from board to camera, one per view.
    pub poses: Vec<Pose>,
    /// Covariance of all device parameters in the order of [`Device::parameters`], camera first. The entries
    /// of fixed parameters are 0. With a projector, the six parameters of a change of `relative` come last
    /// ([`Pose::changed`]).
    pub covariance: DMatrix<f64>,
    /// Covariance of the change of each view's pose.
    pub pose_covariances: Vec<Matrix6<f64>>,
    /// For each device, the standard deviation of a measured coordinate in pixels.
    pub sigma: Vec<f64>,
    /// For each device, the root mean square distance between measured and fitted points in pixels, as OpenCV
    /// computes it.
    pub rms: Vec<f64>,
    /// View and corner indices, from 0, of the corners that the robust fit excluded.
    pub outliers: Vec<(usize, usize)>,
    /// Descriptions of poorly determined parameters, one sentence for each parameter.
    pub notes: Vec<String>,
}

/// Outlier threshold of the robust fit in standard deviations. The residual of one in 25,000 valid
/// corners exceeds this threshold.
const OUTLIER: f64 = 4.5;
/// Threshold of Huber's loss in standard deviations.
const HUBER: f64 = 1.5;
/// RMS of the residual distances, in pixels, below which no other initial estimate is tried.
const GOOD: f64 = 1.0;
/// The iteration stops if a step reduces the cost by less than this fraction, for an initial estimate
/// (`ROUGH`) or a fit (`FINE`). The cost function of rational lenses has flat valleys, in which many steps
/// with small gains barely change the projection.
const ROUGH: f64 = 1e-7;
const FINE: f64 = 1e-10;
/// Maximum RMS of the residual distances in a valid fit, relative to the image width.
const HOPELESS: f64 = 0.02;

/// Fits a camera to the corners of each view. With a second setup, also fits a projector and the pose from
/// camera to projector.
///
/// If `robust` is true, outliers are detected by a fit with Huber's loss and excluded.
///
/// # Errors
/// Returns [`Fault`] if the views do not determine the parameters, or if no parameters fit the corners.
pub fn fit(setups: &[Setup], views: &[Vec<Corner>], robust: bool) -> Result<Fit, Fault> {
    check(setups, views)?;
    let start = begin(setups, views, robust)?;
    let measured: usize = views.iter().flatten().map(|c| if c.projector.is_some() { 4 } else { 2 }).sum();
    let unknown = start.shared() + 6 * views.len();
    if measured <= unknown {
        return Err(Fault::TooFew { measured, unknown });
    }
    let mut w = even(setups.len(), views);
    let mut state = start;
    if robust {
        state = find_outliers(state, views, &mut w)?;
    }
    // Estimate the noise of each device from the residuals, to weight its measurements.
    let rounds = if setups.len() > 1 { 2 } else { 1 };
    for round in 1..=rounds {
        (state, _) = minimize(&state, views, &w, 200, FINE).ok_or_else(|| no_fit(&state, views, &w))?;
        if round == rounds {
            state = polish(state, views, &w);
        }
        let rms = rms(&state, views, &w);
        let hopeless =
            rms.iter().zip(setups).any(|(r, s)| r.is_nan() || *r > HOPELESS * f64::from(s.size[0]));
        if hopeless {
            return Err(no_fit(&state, views, &w));
        }
        let root = Root::of(&state, views, &w).ok_or_else(|| no_fit(&state, views, &w))?;
        open::refuse_undetermined(&state, &root)?;
        let inverse = root.invert().ok_or_else(open::singular)?;
        noise(&state, views, &mut w, &inverse);
    }
    let root = Root::of(&state, views, &w).ok_or_else(|| no_fit(&state, views, &w))?;
    let inverse = root.invert().ok_or_else(open::singular)?;
    finish(state, views, &w, inverse)
}

fn check(setups: &[Setup], views: &[Vec<Corner>]) -> Result<(), Fault> {
    if views.is_empty() || setups.is_empty() {
        return Err(Fault::NoViews);
    }
    for (v, corners) in views.iter().enumerate() {
        let bounded = |p: &Vector2<f64>| p.iter().all(|x| x.abs() < 1e6);
        let finite = corners.iter().all(|c| {
            let thrown = c.projector.is_none_or(|(q, j)| bounded(&q) && j.iter().all(|x| x.abs() < 1e6));
            bounded(&c.camera) && thrown && c.board.iter().all(|x| x.abs() < 1e6)
        });
        if !finite {
            return Err(Fault::NotFinite { view: v + 1 });
        }
    }
    Ok(())
}

fn no_fit(state: &State, views: &[Vec<Corner>], w: &Weights) -> Fault {
    let rms = rms(state, views, w);
    Fault::NoFit { rms: rms.into_iter().fold(0.0, f64::max) }
}

/// Fits each device independently, then computes their relative pose.
fn begin(setups: &[Setup], views: &[Vec<Corner>], robust: bool) -> Result<State, Fault> {
    let camera = alone(&setups[0], views, robust)?;
    let Some(setup) = setups.get(1) else {
        return Ok(camera);
    };
    let thrown: Vec<Vec<Corner>> = views
        .iter()
        .map(|corners| {
            let of = |c: &Corner| c.projector.map(|(q, _)| Corner { camera: q, projector: None, ..*c });
            corners.iter().filter_map(of).collect()
        })
        .collect();
    let lit: Vec<usize> = (0..views.len()).filter(|v| thrown[*v].len() >= 4).collect();
    if lit.is_empty() {
        return Err(Fault::NoViews);
    }
    let few: Vec<_> = lit.iter().map(|v| thrown[*v].clone()).collect();
    let projector = alone(setup, &few, robust)?;
    let each: Vec<Pose> =
        lit.iter().zip(&projector.poses).map(|(v, p)| p.after(&camera.poses[*v].inverse())).collect();
    let (mut devices, mut ties) = (camera.devices, camera.ties);
    devices.extend(projector.devices);
    let behind = |tie: &Option<(usize, f64)>| tie.map(|(i, by)| (i + camera.free, by));
    ties.push(projector.ties[0].iter().map(behind).collect());
    Ok(State {
        devices,
        ties,
        free: camera.free + projector.free,
        relative: mean(&each),
        poses: camera.poses,
    })
}

/// Returns the mean of rigid motions. The rotation of the mean is the projection of the mean matrix onto
/// rotations.
fn mean(all: &[Pose]) -> Pose {
    let n = all.len() as f64;
    let sum: Matrix3<f64> = all.iter().map(|p| p.rotation).sum();
    let svd = sum.svd(true, true);
    let rotation = match (svd.u, svd.v_t) {
        (Some(u), Some(v)) if (u * v).determinant() > 0.0 => u * v,
        _ => all[0].rotation,
    };
    Pose { rotation, translation: all.iter().map(|p| p.translation).sum::<Vector3<f64>>() / n }
}

/// Fits one device from each initial estimate, first without lens distortion. Returns the first good fit, or
/// the best fit if none is good.
fn alone(setup: &Setup, views: &[Vec<Corner>], robust: bool) -> Result<State, Fault> {
    let pairs: Vec<_> = views.iter().map(|v| v.iter().map(|c| (c.board.xy(), c.camera)).unzip()).collect();
    let hs = zhang::homographies(&pairs).map_err(|view| Fault::Collinear { view: view + 1 })?;
    let apart: Vec<Vec<Corner>> =
        views.iter().map(|v| v.iter().map(|c| Corner { projector: None, ..*c }).collect()).collect();
    let starts = match &setup.start {
        Some(device) => vec![device.clone()],
        None => zhang::beginnings(setup.size, setup.model, &hs),
    };
    let mut w = even(1, views);
    if robust {
        w.huber = HUBER;
    }
    let mut best: Option<(State, f64)> = None;
    for device in starts {
        let device = hold(device, setup);
        let poses: Option<Vec<Pose>> = hs.iter().map(|h| zhang::pose(&device, h)).collect();
        let Some(poses) = poses else { continue };
        let first = Free { lens: false, centre: false, ..setup.free };
        let mut state =
            State { ties: vec![vec![]], devices: vec![device], free: 0, relative: Pose::default(), poses };
        let mut cost = f64::INFINITY;
        // To avoid poles of rational lenses, the parameters are freed in three stages: pinhole parameters,
        // dominant lens terms, and all parameters.
        let all = setup.free.ties(&state.devices[0]);
        let most = setup.free.ties_of(&state.devices[0], |name| {
            !name.starts_with(['k', 's']) || matches!(name, "k1" | "k2" | "k3")
        });
        for ties in [first.ties(&state.devices[0]), most, all] {
            state.free = count(&ties);
            state.ties = vec![ties];
            if let Some((next, at)) = minimize(&state, &apart, &w, 100, ROUGH) {
                (state, cost) = (next, at);
            }
        }
        let good = cost < 0.5 * GOOD * GOOD * views.iter().map(Vec::len).sum::<usize>() as f64;
        if best.as_ref().is_none_or(|(_, b)| cost < *b) {
            best = Some((state, cost));
        }
        if good {
            break;
        }
    }
    match best {
        Some((state, cost)) if cost.is_finite() => Ok(state),
        _ => Err(Fault::NoFit { rms: f64::INFINITY }),
    }
}

/// Sets fy/fx to 1 and the principal point to the image centre, unless they are free or an initial device is
/// given.
fn hold(mut device: Device, setup: &Setup) -> Device {
    if setup.start.is_some() {
        return device;
    }
    if !setup.free.aspect {
        device.focal = Vector2::repeat((device.focal.x + device.focal.y) / 2.0);
    }
    if !setup.free.centre {
        device.centre = Vector2::from(setup.size.map(|n| f64::from(n) / 2.0));
    }
    device
}

/// Returns weights that are equal for all measurements.
fn even(devices: usize, views: &[Vec<Corner>]) -> Weights {
    Weights {
        sigma: vec![1.0; devices],
        huber: f64::INFINITY,
        out: views.iter().map(|v| vec![false; v.len()]).collect(),
    }
}

/// Fits the state with Huber's loss, which is scaled by the median residual, and marks the outliers.
fn find_outliers(mut state: State, views: &[Vec<Corner>], w: &mut Weights) -> Result<State, Fault> {
    for _ in 0..3 {
        for device in 0..w.sigma.len() {
            let mut all: Vec<f64> = distances(&state, views, device).into_iter().map(|(_, d)| d).collect();
            all.sort_by(f64::total_cmp);
            // The median of a normally distributed distance in the plane is 1.1774 standard deviations of
            // a coordinate.
            let middle = all.get(all.len() / 2).copied().unwrap_or(1.0);
            w.sigma[device] = (middle / 1.1774).max(1e-9);
        }
        w.huber = HUBER;
        (state, _) = minimize(&state, views, w, 100, ROUGH).ok_or_else(|| no_fit(&state, views, w))?;
    }
    for device in 0..w.sigma.len() {
        for ((v, c), d) in distances(&state, views, device) {
            w.out[v][c] |= d > OUTLIER * w.sigma[device];
        }
    }
    w.huber = f64::INFINITY;
    for (v, out) in w.out.iter().enumerate() {
        if out.iter().filter(|o| !**o).count() < 4 {
            return Err(Fault::Collinear { view: v + 1 });
        }
    }
    Ok(state)
}

/// Returns the residual distance of a device in pixels, for each view and corner.
fn distances(state: &State, views: &[Vec<Corner>], device: usize) -> Vec<((usize, usize), f64)> {
    let mut all = vec![];
    for (v, corners) in views.iter().enumerate() {
        for (c, corner) in corners.iter().enumerate() {
            let residual = state.residual(v, corner);
            let off = residual.and_then(|(a, b)| if device == 0 { Some(a) } else { b });
            all.extend(off.map(|off| ((v, c), off.norm())));
        }
    }
    all
}

/// Returns the sum of squares and the number of points of a device, excluding outliers.
fn squares(state: &State, views: &[Vec<Corner>], w: &Weights, device: usize) -> (f64, usize) {
    let all = distances(state, views, device);
    let kept = all.iter().filter(|((v, c), _)| !w.out[*v][*c]);
    kept.fold((0.0, 0), |(sum, n), (_, d)| (sum + d * d, n + 1))
}

fn rms(state: &State, views: &[Vec<Corner>], w: &Weights) -> Vec<f64> {
    let of = |d| {
        let (sum, n) = squares(state, views, w, d);
        (sum / n.max(1) as f64).sqrt()
    };
    (0..state.devices.len()).map(of).collect()
}

/// Estimates the noise of each device from its residuals and the number of parameters that its measurements
/// account for (Helmert's variance components).
fn noise(state: &State, views: &[Vec<Corner>], w: &mut Weights, inverse: &Covariance) {
    let mut sigma = w.sigma.clone();
    for (device, sigma) in sigma.iter_mut().enumerate() {
        let mut only = w.clone();
        for (other, s) in only.sigma.iter_mut().enumerate() {
            if other != device {
                *s = f64::INFINITY;
            }
        }
        let Some(part) = state.linearized(views, &only) else {
            continue;
        };
        let (sum, n) = squares(state, views, w, device);
        let left = 2.0 * n as f64 - inverse.taken(&part);
        // For exact points the noise is zero. A lower bound keeps the weights finite.
        *sigma = (sum / left.max(1.0)).sqrt().max(1e-9);
    }
    w.sigma = sigma;
}

/// Creates the result of a fit from its state. Expands the free parameters to all parameters and adds notes.
fn finish(state: State, views: &[Vec<Corner>], w: &Weights, inverse: Covariance) -> Result<Fit, Fault> {
    let rms = rms(&state, views, w);
    let total: usize = state.ties.iter().map(Vec::len).sum();
    let relative = if state.devices.len() > 1 { 6 } else { 0 };
    let mut spread = DMatrix::zeros(total + relative, state.shared());
    for (row, tie) in state.ties.iter().flatten().enumerate() {
        if let Some((i, by)) = tie {
            spread[(row, *i)] = *by;
        }
    }
    for i in 0..relative {
        spread[(total + i, state.free + i)] = 1.0;
    }
    let covariance = &spread * &inverse.shared * spread.transpose();
    open::refuse_uncertain(&state, &covariance)?;
    let outliers = w.out.iter().enumerate();
    let outliers =
        outliers.flat_map(|(v, out)| (0..out.len()).filter(|c| out[*c]).map(move |c| (v, c))).collect();
    Ok(Fit {
        notes: open::notes(&state, &covariance),
        devices: state.devices,
        relative: state.relative,
        poses: state.poses,
        covariance,
        pose_covariances: inverse.own,
        sigma: w.sigma.clone(),
        rms,
        outliers,
    })
}

impl Fit {
    /// Returns the standard errors of a device's parameters, in the order of [`Device::parameters`].
    pub fn errors(&self, device: usize) -> Vec<f64> {
        let first: usize = self.devices[..device].iter().map(|d| d.parameters().len()).sum();
        let n = self.devices[device].parameters().len();
        (first..first + n).map(|i| self.covariance[(i, i)].sqrt()).collect()
    }

    /// Returns the standard errors of the change of `relative`, which are three angles in radians and three
    /// lengths in metres. Returns `None` without a projector.
    pub fn relative_errors(&self) -> Option<[f64; 6]> {
        let n = self.covariance.nrows();
        (self.devices.len() > 1)
            .then(|| std::array::from_fn(|i| self.covariance[(n - 6 + i, n - 6 + i)].sqrt()))
    }
}
