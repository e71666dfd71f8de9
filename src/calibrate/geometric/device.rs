//! Device model of a calibration. The model has focal lengths, a principal point, a lens, and free
//! parameters. The module also computes the derivatives of projected pixels.

use super::pose::Pose;
use glam::DVec2;
use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use optics::distortion::Distortion;
use optics::distortion::fisheye::Fisheye;
use optics::distortion::opencv::Opencv;

/// Lens models, named after OpenCV's number of coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Model {
    Pinhole,
    /// Brown–Conrady lens: k1, k2, p1, p2, k3.
    #[default]
    Five,
    /// Rational lens: k4, k5 and k6 in addition to [`Self::Five`].
    Eight,
    /// Thin-prism lens: s1, s2, s3 and s4 in addition to [`Self::Eight`].
    Twelve,
    /// Fisheye lens: k1 to k4.
    Fisheye,
}

const OPENCV: [&str; 12] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"];

impl Model {
    /// Returns the names of the coefficients in OpenCV's order.
    pub fn names(self) -> &'static [&'static str] {
        match self {
            Self::Pinhole => &[],
            Self::Five => &OPENCV[..5],
            Self::Eight => &OPENCV[..8],
            Self::Twelve => &OPENCV,
            Self::Fisheye => &["k1", "k2", "k3", "k4"],
        }
    }

    /// Returns the lens with these coefficients.
    pub fn lens(self, k: &[f64]) -> Distortion {
        let at = |i: usize| k.get(i).copied().unwrap_or(0.0);
        match self {
            Self::Pinhole => Distortion::None,
            Self::Fisheye => Distortion::Fisheye(Fisheye { k: [at(0), at(1), at(2), at(3)] }),
            // `from` maps zero coefficients to `None`, but the derivatives with respect to these coefficients
            // are needed.
            Self::Five | Self::Eight | Self::Twelve => Distortion::Opencv(Opencv::from_list(k)),
        }
    }
}

/// A camera or projector that maps the point p of the plane z = 1 to the pixel focal · lens(p) + centre.
///
/// Pixel coordinates are continuous, and the first pixel covers 0 to 1. OpenCV's coordinates are
/// smaller by half a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    pub size: [u32; 2],
    /// Focal lengths along x and y in pixels.
    pub focal: Vector2<f64>,
    /// Principal point in pixels.
    pub centre: Vector2<f64>,
    pub model: Model,
    /// Coefficients in the order of [`Model::names`].
    pub coefficients: Vec<f64>,
}

/// The pixel to which a point projects, and the derivatives of the pixel's coordinates.
pub struct Seen {
    pub at: Vector2<f64>,
    /// Derivative of the pixel's coordinates with respect to the point in device coordinates.
    pub by_point: Matrix2x3<f64>,
    /// Derivatives of the pixel's coordinates with respect to fx, fy, cx, cy and the coefficients.
    pub by_parameters: Vec<Vector2<f64>>,
}

impl Device {
    /// Creates a device without distortion.
    pub fn pinhole(size: [u32; 2], focal: [f64; 2], centre: [f64; 2], model: Model) -> Self {
        Self {
            size,
            focal: focal.into(),
            centre: centre.into(),
            model,
            coefficients: vec![0.0; model.names().len()],
        }
    }

    pub fn lens(&self) -> Distortion {
        self.model.lens(&self.coefficients)
    }

    /// Returns the parameters of the device: fx, fy, cx, cy and the coefficients.
    pub fn parameters(&self) -> Vec<f64> {
        let first = [self.focal.x, self.focal.y, self.centre.x, self.centre.y];
        first.iter().chain(&self.coefficients).copied().collect()
    }

    /// Returns the names of the parameters, in the order of [`Self::parameters`].
    pub fn names(&self) -> Vec<&'static str> {
        ["fx", "fy", "cx", "cy"].iter().chain(self.model.names()).copied().collect()
    }

    /// Returns the device with the given parameters, in the order of [`Self::parameters`].
    pub fn with(&self, parameters: &[f64]) -> Self {
        Self {
            focal: Vector2::new(parameters[0], parameters[1]),
            centre: Vector2::new(parameters[2], parameters[3]),
            coefficients: parameters[4..].to_vec(),
            ..self.clone()
        }
    }

    /// Returns the pixel of a point in device coordinates, or `None` if the point is behind the device.
    pub fn project(&self, x: &Vector3<f64>) -> Option<Vector2<f64>> {
        let far = x.z > 0.0;
        far.then(|| self.pixel(self.lens().distort(DVec2::new(x.x / x.z, x.y / x.z))))
    }

    fn pixel(&self, d: DVec2) -> Vector2<f64> {
        Vector2::new(self.focal.x * d.x + self.centre.x, self.focal.y * d.y + self.centre.y)
    }

    /// Projects a point as [`Self::project`] does, and also returns all derivatives. `lens` must be the lens
    /// of the device ([`Self::lens`]).
    pub fn see(&self, lens: &Distortion, x: &Vector3<f64>) -> Option<Seen> {
        if x.z.is_nan() || x.z <= 0.0 {
            return None;
        }
        let p = DVec2::new(x.x / x.z, x.y / x.z);
        let d = lens.distort(p);
        let [[a, b], [c, e]] = lens.jacobian(p);
        let f = self.focal;
        let bend = Matrix2::new(f.x * a, f.x * b, f.y * c, f.y * e);
        let slope = Matrix2x3::new(1.0, 0.0, -p.x, 0.0, 1.0, -p.y) / x.z;
        let mut by_parameters =
            vec![Vector2::new(d.x, 0.0), Vector2::new(0.0, d.y), Vector2::x(), Vector2::y()];
        let scaled = |v: &DVec2| Vector2::new(f.x * v.x, f.y * v.y);
        let count = self.coefficients.len();
        match lens {
            Distortion::None => {}
            Distortion::Opencv(l) => by_parameters.extend(l.by_coefficients(p)[..count].iter().map(scaled)),
            Distortion::Fisheye(l) => by_parameters.extend(l.by_coefficients(p).iter().map(scaled)),
        }
        Some(Seen { at: self.pixel(d), by_point: bend * slope, by_parameters })
    }

    /// Returns the undistorted normalized coordinates of a pixel, or `None` if the lens cannot be inverted at
    /// this pixel.
    pub fn normalized(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let q = (pixel - self.centre).component_div(&self.focal);
        let p = self.lens().undistort(DVec2::new(q.x, q.y))?;
        Some(Vector2::new(p.x, p.y))
    }
}

/// The device parameters that the fit may change. All other parameters keep their initial values.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // each is an independent option
pub struct Free {
    pub focal: bool,
    /// Whether the two focal lengths are fitted independently. If false, fy/fx keeps its initial value, by
    /// default 1.
    pub aspect: bool,
    /// Whether the principal point is fitted. If false, the principal point keeps its initial value, by
    /// default the image centre.
    pub centre: bool,
    /// Whether p1 and p2 are fitted. If false, p1 and p2 are 0.
    pub tangential: bool,
    /// Whether k3 is fitted. If false, k3 is 0.
    pub k3: bool,
    /// Whether any lens coefficients are fitted.
    pub lens: bool,
}

impl Default for Free {
    fn default() -> Self {
        Self { focal: true, aspect: true, centre: true, tangential: true, k3: true, lens: true }
    }
}

impl Free {
    /// Returns, for each of [`Device::parameters`], the index and factor of the free parameter on which the
    /// parameter depends.
    pub fn ties(&self, device: &Device) -> Vec<Option<(usize, f64)>> {
        self.ties_of(device, |_| true)
    }

    /// Returns the ties as [`Self::ties`] does, for the parameters whose names are selected.
    pub(super) fn ties_of(
        &self,
        device: &Device,
        chosen: impl Fn(&str) -> bool,
    ) -> Vec<Option<(usize, f64)>> {
        let mut next = 0;
        let mut own = |free: bool| {
            free.then(|| {
                next += 1;
                (next - 1, 1.0)
            })
        };
        let names = device.names();
        let fisheye = device.model == Model::Fisheye;
        let mut ties: Vec<Option<(usize, f64)>> = vec![];
        for name in names {
            let tie = match name {
                name if !chosen(name) => None,
                "fx" => own(self.focal),
                "fy" if self.aspect => own(self.focal),
                "fy" => ties[0].map(|(i, _)| (i, device.focal.y / device.focal.x)),
                "cx" | "cy" => own(self.centre),
                "p1" | "p2" => own(self.lens && self.tangential),
                "k3" if !fisheye => own(self.lens && self.k3),
                _ => own(self.lens),
            };
            ties.push(tie);
        }
        ties
    }
}

/// Returns the number of free parameters that occur in `ties`.
pub fn count(ties: &[Option<(usize, f64)>]) -> usize {
    ties.iter().flatten().map(|(i, _)| i + 1).max().unwrap_or(0)
}

/// Returns the pixels of a board's points for a pose, or `None` if a point is behind the device.
pub fn project_all(device: &Device, pose: &Pose, points: &[Vector3<f64>]) -> Option<Vec<Vector2<f64>>> {
    points.iter().map(|x| device.project(&pose.apply(*x))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_match_finite_differences() {
        for model in [Model::Pinhole, Model::Five, Model::Eight, Model::Twelve, Model::Fisheye] {
            let mut d = Device::pinhole([640, 480], [700.0, 690.0], [320.0, 241.0], model);
            for (i, c) in d.coefficients.iter_mut().enumerate() {
                *c = 0.05 / (1.0 + i as f64) * if i % 2 == 0 { 1.0 } else { -1.0 };
            }
            let x = Vector3::new(0.3, -0.2, 0.9);
            let seen = d.see(&d.lens(), &x).expect("before it");
            assert_eq!(Some(seen.at), d.project(&x));
            let h = 1e-6;
            for i in 0..3 {
                let mut e = Vector3::zeros();
                e[i] = h;
                let want = (d.project(&(x + e)).unwrap() - d.project(&(x - e)).unwrap()) / (2.0 * h);
                assert!((seen.by_point.column(i) - want).norm() < 1e-5, "{model:?}");
            }
            for i in 0..seen.by_parameters.len() {
                let at = |sign: f64| {
                    let mut p = d.parameters();
                    p[i] += sign * h;
                    d.with(&p).project(&x).unwrap()
                };
                let want = (at(1.0) - at(-1.0)) / (2.0 * h);
                assert!((seen.by_parameters[i] - want).norm() < 1e-5, "{model:?} {i}");
            }
            let back = d.normalized(seen.at).expect("one-to-one");
            assert!((back - x.xy() / x.z).norm() < 1e-9);
        }
    }
}
