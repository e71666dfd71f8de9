//! Polarizers and retarders of a rig as Mueller matrices in f64. The matrices include imperfections. Learning
//! uses the derivatives of the matrices with respect to angles and retardances.
//!
//! Signs are those of [`optics::polarization::elements`]. Angles are counter-clockwise from the frame's x
//! axis when looking toward the source. Light along the slow axis lags. An element at angle θ is R(-θ) M
//! R(θ). With R(θ) = exp(2θG), the derivative with respect to θ is 2(M'G - GM'), where M' = R(-θ) M R(θ).

use super::spectral_value::SpectralValue;
use nalgebra::{Matrix4, Vector4};

pub type Mueller = Matrix4<f64>;
pub type Stokes = Vector4<f64>;

#[derive(Clone, Debug, PartialEq)]
pub enum ElementKind {
    /// A linear polarizer. The angle of the polarizer is the angle of the light that the polarizer transmits.
    Polarizer {
        /// Ratio of the least to the greatest transmittance for linearly polarized light.
        extinction: SpectralValue,
    },
    /// A linear retarder. The angle of the retarder is the angle of the fast axis.
    Retarder {
        /// Nominal retardance in radians, which is π/2 for a quarter-wave plate.
        retardance: Setting,
        /// Deviation from the nominal retardance in radians, as a function of wavelength.
        error: SpectralValue,
        /// Number of additional whole waves. For an oblique ray, the retardance of these whole waves also
        /// changes.
        order: u32,
        /// Mean refractive index, for oblique rays.
        index: f64,
    },
}

/// The value of a setting. A setting has one number for all captures, or one number per capture. Angles and
/// retardances are in radians.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    Fixed(f64),
    /// One value per capture.
    Each(Vec<f64>),
}

impl Setting {
    /// Returns the value in capture `k`.
    ///
    /// # Panics
    /// Panics if `k` is out of range. [`super::scheme::Scheme`] ensures that every capture has a value.
    pub fn at(&self, k: usize) -> f64 {
        match self {
            Self::Fixed(value) => *value,
            Self::Each(values) => values[k],
        }
    }
}

/// The settings of an element in one capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Set {
    /// Angle reading of the stage in radians.
    pub angle: f64,
    /// Nominal retardance in radians. Polarizers ignore this value.
    pub retardance: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// Name of the element, for example `retarder_2`.
    pub name: String,
    pub kind: ElementKind,
    /// Angle reading of the stage.
    pub angle: Setting,
    /// Angle of the axis in radians when the stage reads zero.
    pub axis_offset: f64,
    /// Transmittance. The transmittance of a polarizer is the transmittance for light that is polarized along
    /// the polarizer's axis.
    pub transmittance: SpectralValue,
}

/// Direction and wavelength of light that passes the elements of a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Wavelength in nanometres.
    pub nm: f64,
    /// Angle to the optical axis in air, in radians.
    pub incidence: f64,
    /// Azimuth of the plane of incidence from the frame's x axis, in radians.
    pub azimuth: f64,
}

impl Ray {
    /// Returns the ray's angles from the optical axis in x and y, in radians. A galvo points in this
    /// direction.
    pub fn direction(&self) -> [f64; 2] {
        let (s, c) = self.azimuth.sin_cos();
        [c, s].map(|part| (self.incidence.tan() * part).atan())
    }

    /// Returns the ray along the optical axis.
    pub fn axial(nm: f64) -> Self {
        Self { nm, incidence: 0.0, azimuth: 0.0 }
    }
}

/// Returns the generator G of rotations: R(θ) = exp(2θG).
fn generator() -> Mueller {
    let mut g = Mueller::zeros();
    g[(1, 2)] = 1.0;
    g[(2, 1)] = -1.0;
    g
}

/// Returns the matrix R(θ), which expresses Stokes vectors in a basis rotated by θ.
pub fn rotator(theta: f64) -> Mueller {
    let (s, c) = (2.0 * theta).sin_cos();
    let mut r = Mueller::identity();
    (r[(1, 1)], r[(1, 2)], r[(2, 1)], r[(2, 2)]) = (c, s, -s, c);
    r
}

/// Returns a linear diattenuator at 0° with power transmittance `most` along x and `least` along y.
pub fn diattenuator(most: f64, least: f64) -> Mueller {
    let (mean, half, cross) = ((most + least) / 2.0, (most - least) / 2.0, (most * least).max(0.0).sqrt());
    let mut m = Mueller::from_diagonal(&Stokes::new(mean, mean, cross, cross));
    (m[(0, 1)], m[(1, 0)]) = (half, half);
    m
}

/// Returns a linear retarder with its fast axis at 0°.
pub fn retarder(delta: f64) -> Mueller {
    let (s, c) = delta.sin_cos();
    let mut m = Mueller::from_diagonal(&Stokes::new(1.0, 1.0, c, c));
    (m[(2, 3)], m[(3, 2)]) = (s, -s);
    m
}

/// The Mueller matrix of an element at a setting. The derivatives are with respect to angle θ and retardance
/// δ.
#[derive(Clone, Copy, Debug)]
pub struct Jet {
    /// The Mueller matrix M.
    pub value: Mueller,
    /// First derivatives dM/dθ and dM/dδ.
    pub first: [Mueller; 2],
    /// Second derivatives d²M/dθ², d²M/dθdδ and d²M/dδ².
    pub second: [Mueller; 3],
}

/// A property of an element that can change between captures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Angle of the stage in radians.
    Angle,
    /// Retardance of a liquid crystal in radians.
    Retardance,
}

impl Element {
    pub fn polarizer(name: &str, angle: Setting) -> Self {
        Self::ideal(name, angle, ElementKind::Polarizer { extinction: SpectralValue::Same(0.0) })
    }

    pub fn retarder(name: &str, angle: Setting, retardance: Setting) -> Self {
        let kind =
            ElementKind::Retarder { retardance, error: SpectralValue::Same(0.0), order: 0, index: 1.55 };
        Self::ideal(name, angle, kind)
    }

    fn ideal(name: &str, angle: Setting, kind: ElementKind) -> Self {
        Self { name: name.to_owned(), kind, angle, axis_offset: 0.0, transmittance: SpectralValue::Same(1.0) }
    }

    pub fn set_at(&self, k: usize) -> Set {
        let retardance = match &self.kind {
            ElementKind::Retarder { retardance, .. } => retardance.at(k),
            ElementKind::Polarizer { .. } => 0.0,
        };
        Set { angle: self.angle.at(k), retardance }
    }

    /// Returns the retardance at a setting for a ray in radians. The result is 0 for a polarizer.
    ///
    /// The plate is weakly birefringent with index n, and its slow axis is in its plane. Let α be the angle
    /// of a ray in air, and β the angle between the plane of incidence and the slow axis. The retardance is
    /// (δ + 2πm)(1 - s² cos² β)/√(1 - s²), s = sin α/n. This retardance is the difference between the k_z of
    /// the extraordinary wave and of the ordinary wave (Yeh & Gu, "Optics of Liquid Crystal Displays", 2010,
    /// sec. 3.2). The formula is of first order in the birefringence.
    pub fn retardance(&self, set: Set, ray: &Ray) -> f64 {
        let ElementKind::Retarder { error, .. } = &self.kind else {
            return 0.0;
        };
        let (scale, waves) = self.oblique(set, ray);
        scale * (set.retardance + error.at(ray.nm) + waves) - waves
    }

    /// Returns the factor by which an oblique ray changes the total retardance. Also returns the retardance
    /// of the whole waves in radians.
    fn oblique(&self, set: Set, ray: &Ray) -> (f64, f64) {
        let ElementKind::Retarder { order, index, .. } = &self.kind else {
            return (1.0, 0.0);
        };
        let waves = f64::from(*order) * std::f64::consts::TAU;
        let s2 = (ray.incidence.sin() / index).powi(2);
        let slow = set.angle + self.axis_offset + std::f64::consts::FRAC_PI_2;
        let along = (ray.azimuth - slow).cos().powi(2);
        ((1.0 - s2 * along) / (1.0 - s2).sqrt(), waves)
    }

    /// Returns the Mueller matrix in the frame of the element's axes.
    fn unturned(&self, set: Set, ray: &Ray) -> Mueller {
        let t = self.transmittance.at(ray.nm);
        match &self.kind {
            ElementKind::Polarizer { extinction } => diattenuator(t, t * extinction.at(ray.nm)),
            ElementKind::Retarder { .. } => retarder(self.retardance(set, ray)) * t,
        }
    }

    /// Returns the Mueller matrix at the actual settings, which may differ from the settings of the scheme.
    pub fn matrix(&self, set: Set, ray: &Ray) -> Mueller {
        let theta = set.angle + self.axis_offset;
        rotator(-theta) * self.unturned(set, ray) * rotator(theta)
    }

    /// Returns the Mueller matrix in a capture, with its derivatives. When an oblique plate rotates, its
    /// retardance changes. The derivatives with respect to angle neglect this change, which is of second
    /// order in the angle of incidence.
    pub fn jet(&self, k: usize, ray: &Ray) -> Jet {
        let set = self.set_at(k);
        let theta = set.angle + self.axis_offset;
        let (mut by_delta, mut by_delta2) = (Mueller::zeros(), Mueller::zeros());
        if let ElementKind::Retarder { .. } = &self.kind {
            let (scale, _) = self.oblique(set, ray);
            let quarter = retarder(self.retardance(set, ray) + std::f64::consts::FRAC_PI_2);
            // The derivative d/dδ shifts sine and cosine by a quarter period. For elements without δ, the
            // derivative is zero.
            by_delta = quarter * (self.transmittance.at(ray.nm) * scale);
            by_delta2 = self.unturned(set, ray) * (-scale * scale);
            for d in [&mut by_delta, &mut by_delta2] {
                (d[(0, 0)], d[(1, 1)]) = (0.0, 0.0);
            }
        }
        let g = generator();
        let turn = |m: Mueller| rotator(-theta) * m * rotator(theta);
        let by_theta = |m: &Mueller| (m * g - g * m) * 2.0;
        let (value, delta1, delta2) = (self.matrix(set, ray), turn(by_delta), turn(by_delta2));
        let theta1 = by_theta(&value);
        Jet { value, first: [theta1, delta1], second: [by_theta(&theta1), by_theta(&delta1), delta2] }
    }

    /// Returns the quantities of the element that change between captures.
    pub fn driven(&self) -> impl Iterator<Item = Quantity> {
        let angle = matches!(self.angle, Setting::Each(_)).then_some(Quantity::Angle);
        let each = matches!(self.kind, ElementKind::Retarder { retardance: Setting::Each(_), .. });
        angle.into_iter().chain(each.then_some(Quantity::Retardance))
    }

    /// Returns the setting of a quantity, or `None` for the retardance of a polarizer.
    pub fn setting(&self, quantity: Quantity) -> Option<&Setting> {
        match (quantity, &self.kind) {
            (Quantity::Angle, _) => Some(&self.angle),
            (Quantity::Retardance, ElementKind::Retarder { retardance, .. }) => Some(retardance),
            (Quantity::Retardance, ElementKind::Polarizer { .. }) => None,
        }
    }

    /// Returns a mutable reference to the setting of a quantity, or `None` for the retardance of a polarizer.
    pub fn setting_mut(&mut self, quantity: Quantity) -> Option<&mut Setting> {
        match (quantity, &mut self.kind) {
            (Quantity::Angle, _) => Some(&mut self.angle),
            (Quantity::Retardance, ElementKind::Retarder { retardance, .. }) => Some(retardance),
            (Quantity::Retardance, ElementKind::Polarizer { .. }) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::polarization::elements;
    use optics::polarization::mueller::Mueller as Lanes;

    fn near(a: &Mueller, b: &Lanes) -> bool {
        let b = b.lane(0);
        (0..4).all(|i| (0..4).all(|j| (a[(i, j)] - f64::from(b[i][j])).abs() < 1e-6))
    }

    /// Verifies that the signs of the Mueller matrices agree with those of the renderer's elements.
    #[test]
    fn signs_match_the_renderer() {
        let ray = Ray::axial(550.0);
        for step in 0..24 {
            let theta = f64::from(step) * 0.3;
            let p = Element::polarizer("p", Setting::Fixed(theta)).jet(0, &ray);
            assert!(near(&p.value, &elements::polarizer(theta as f32)));
            let delta = f64::from(step) * 0.2;
            let r = Element::retarder("r", Setting::Fixed(theta), Setting::Fixed(delta)).jet(0, &ray);
            assert!(near(&r.value, &elements::retarder(theta as f32, delta as f32)));
        }
    }

    /// Verifies that the derivatives of the Mueller matrices agree with central differences.
    #[test]
    fn derivatives_match_finite_differences() {
        let ray = Ray { nm: 550.0, incidence: 0.0, azimuth: 0.4 };
        let of = |theta: f64, delta: f64| {
            let mut e = Element::retarder("r", Setting::Fixed(theta), Setting::Fixed(delta));
            e.axis_offset = 0.1;
            e.transmittance = SpectralValue::Same(0.9);
            e.jet(0, &ray)
        };
        let (h, at) = (1e-5, (0.7, 1.1));
        let jet = of(at.0, at.1);
        let differ = |plus: Jet, minus: Jet, f: fn(&Jet) -> Mueller| (f(&plus) - f(&minus)) / (2.0 * h);
        let (t_plus, t_minus) = (of(at.0 + h, at.1), of(at.0 - h, at.1));
        let (d_plus, d_minus) = (of(at.0, at.1 + h), of(at.0, at.1 - h));
        let pairs = [
            (differ(t_plus, t_minus, |j| j.value), jet.first[0]),
            (differ(d_plus, d_minus, |j| j.value), jet.first[1]),
            (differ(t_plus, t_minus, |j| j.first[0]), jet.second[0]),
            (differ(d_plus, d_minus, |j| j.first[0]), jet.second[1]),
            (differ(t_plus, t_minus, |j| j.first[1]), jet.second[1]),
            (differ(d_plus, d_minus, |j| j.first[1]), jet.second[2]),
        ];
        for (i, (found, exact)) in pairs.iter().enumerate() {
            assert!((found - exact).amax() < 1e-7, "{i}: {found} is not {exact}");
        }
    }

    /// Verifies the retardance of oblique rays. In the plane of the fast axis, obliquity lengthens the path
    /// and has no other effect. In the plane of the slow axis, obliquity also lowers the extraordinary index.
    /// The reference is computed from the k_z of the two waves in a plate with indices 1.5499 and 1.5501.
    #[test]
    fn oblique_retardance_matches_wave_optics() {
        let (no, ne, alpha) = (1.5499_f64, 1.5501_f64, 0.3_f64);
        let exact = |beta: f64| {
            let s = alpha.sin();
            let along = ne * ne * (1.0 - (s * beta.cos() / no).powi(2));
            let extraordinary = (along - (s * beta.sin()).powi(2)).sqrt();
            (extraordinary - (no * no - s * s).sqrt()) / (ne - no)
        };
        for (beta, azimuth) in [(0.0, 90.0_f64), (std::f64::consts::FRAC_PI_2, 0.0)] {
            let ray = Ray { nm: 550.0, incidence: alpha, azimuth: azimuth.to_radians() };
            let e = Element::retarder("r", Setting::Fixed(0.0), Setting::Fixed(1.0));
            let found = e.retardance(e.set_at(0), &ray);
            assert!((found - exact(beta)).abs() < 1e-4, "{found} {}", exact(beta));
        }
    }

    #[test]
    fn a_leaky_polarizer_has_the_stated_transmittances() {
        let mut p = Element::polarizer("p", Setting::Fixed(0.0));
        p.kind = ElementKind::Polarizer { extinction: SpectralValue::Same(0.01) };
        p.transmittance = SpectralValue::Same(0.8);
        let m = p.jet(0, &Ray::axial(550.0)).value;
        let through = |s1: f64| (m * Stokes::new(1.0, s1, 0.0, 0.0))[0];
        assert!((through(1.0) - 0.8).abs() < 1e-12);
        assert!((through(-1.0) - 0.008).abs() < 1e-12);
    }
}
