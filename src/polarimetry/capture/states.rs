//! States that a generator creates and an analyzer detects. The module also computes the derivatives of the
//! states with respect to every setting.
//!
//! The generator state is the Stokes vector g = E_n … E_1 p that illuminates the scene. The analyzer state is
//! the row vector a by which the returning Stokes vector is multiplied. The intensity of a capture of T is
//! therefore a·T·g. Derivatives are propagated element by element. With v = E v', the derivative is ∂v = E
//! ∂v' for settings of earlier elements, and (∂E) v' for settings of E.

use super::element::{Jet, Quantity, Ray, Set, Stokes, diattenuator, rotator};
use super::scheme::{ARRAY_DEG, Scheme, Sensor, Side};
use nalgebra::Matrix4;

/// A state, with its derivatives with respect to the motors on the same side of the scene.
#[derive(Clone, Debug)]
pub struct StateJet {
    pub value: Stokes,
    /// First derivatives. Each derivative is stored with the motor's index in [`Scheme::motors`].
    pub first: Vec<(usize, Stokes)>,
    /// Second derivatives. Each derivative is stored with the indices of two motors in ascending order.
    pub second: Vec<(usize, usize, Stokes)>,
}

impl StateJet {
    fn constant(value: Stokes) -> Self {
        Self { value, first: vec![], second: vec![] }
    }

    /// Applies a constant element.
    fn through(&mut self, m: &Matrix4<f64>) {
        self.value = m * self.value;
        for (_, v) in &mut self.first {
            *v = m * *v;
        }
        for (.., v) in &mut self.second {
            *v = m * *v;
        }
    }

    /// Applies an element. `motors` lists the index and quantity of each motor of the element.
    fn pass(&mut self, jet: &Jet, motors: &[(usize, Quantity)], orders: usize) {
        let before = self.value;
        let firsts = self.first.clone();
        self.through(&jet.value);
        if orders == 0 {
            return;
        }
        let index = |q: Quantity| match q {
            Quantity::Angle => 0,
            Quantity::Retardance => 1,
        };
        for (n, (motor, quantity)) in motors.iter().enumerate() {
            let by = &jet.first[index(*quantity)];
            if orders > 1 {
                for (earlier, v) in &firsts {
                    self.second.push((*earlier, *motor, by * v));
                }
                for (other, also) in &motors[..=n] {
                    let both = &jet.second[index(*quantity) + index(*also)];
                    self.second.push((*other, *motor, both * before));
                }
            }
            self.first.push((*motor, by * before));
        }
    }
}

/// Returns the indices and quantities of an element's motors.
fn motors_of(scheme: &Scheme, side: Side, element: usize) -> Vec<(usize, Quantity)> {
    let motors = scheme.motors().into_iter().enumerate();
    motors.filter(|(_, m)| m.side == side && m.element == element).map(|(i, m)| (i, m.quantity)).collect()
}

/// Returns the ray at the elements. In a coaxial rig, the elements are before the mirrors, where the ray is
/// on the axis.
fn at_elements(scheme: &Scheme, ray: &Ray) -> Ray {
    if scheme.coaxial.is_some() { Ray::axial(ray.nm) } else { *ray }
}

/// Returns the Stokes vector that illuminates the scene for the given generator settings. This function and
/// [`detecting`] are the only forward model of captures.
pub fn illuminating(scheme: &Scheme, generator: &[Set], ray: &Ray) -> Stokes {
    let elements_ray = &at_elements(scheme, ray);
    let pairs = scheme.generator().iter().zip(generator);
    let state = pairs.fold(Stokes::from(scheme.source), |s, (e, set)| e.matrix(*set, elements_ray) * s);
    let coaxial = scheme.coaxial.as_ref();
    coaxial.map_or(state, |c| c.outward(ray) * state)
}

/// Returns the rows with which the channels weight light from the scene, for the given analyzer settings.
pub fn detecting(scheme: &Scheme, analyzer: &[Set], ray: &Ray) -> impl Iterator<Item = Stokes> + use<> {
    let elements_ray = &at_elements(scheme, ray);
    let mut through = Matrix4::identity();
    for (e, set) in scheme.analyzer().iter().zip(analyzer).rev() {
        through *= e.matrix(*set, elements_ray);
    }
    if let Some(coaxial) = &scheme.coaxial {
        through *= coaxial.inward(ray);
    }
    let transposed = through.transpose();
    sensor_rows(&scheme.sensor, ray.nm).into_iter().map(move |row| transposed * row)
}

/// Returns the Stokes vector that illuminates the scene in capture `k`, with derivatives up to `orders` (0, 1
/// or 2).
pub fn generated(scheme: &Scheme, k: usize, ray: &Ray, orders: usize) -> StateJet {
    let mut state = StateJet::constant(Stokes::from(scheme.source));
    let elements_ray = &at_elements(scheme, ray);
    for (i, e) in scheme.generator().iter().enumerate() {
        let motors = if orders > 0 { motors_of(scheme, Side::Generator, i) } else { vec![] };
        state.pass(&e.jet(k, elements_ray), &motors, orders);
    }
    if let Some(coaxial) = &scheme.coaxial {
        state.through(&coaxial.outward(ray));
    }
    state
}

/// Returns the rows with which a sensor weights an incident Stokes vector. There is one row, or four rows for
/// a polarizer array.
fn sensor_rows(sensor: &Sensor, nm: f64) -> Vec<Stokes> {
    match sensor {
        Sensor::Intensity => vec![Stokes::new(1.0, 0.0, 0.0, 0.0)],
        Sensor::PolarizerArray { extinction, axis_offsets } => ARRAY_DEG
            .iter()
            .zip(axis_offsets)
            .map(|(degrees, offset)| {
                let polarizer = diattenuator(1.0, extinction.at(nm));
                (polarizer * rotator(degrees.to_radians() + offset)).row(0).transpose()
            })
            .collect(),
    }
}

/// Returns the smallest set of rows with the same span and the same normal matrix as `rows`. If the noise is
/// equal in all channels, this set contains the same information as `rows`.
fn sufficient(rows: &[Stokes]) -> Vec<Stokes> {
    if rows.len() == 1 {
        return rows.to_vec();
    }
    let normal: Matrix4<f64> = rows.iter().map(|r| r * r.transpose()).sum();
    let eigen = normal.symmetric_eigen();
    let most = eigen.eigenvalues.amax();
    let used = eigen.eigenvalues.iter().enumerate();
    used.filter(|(_, v)| **v > 1e-12 * most).map(|(i, v)| eigen.eigenvectors.column(i) * v.sqrt()).collect()
}

/// Returns the rows a with which the channels weight light from the scene in capture `k`. There is one row
/// per channel, with derivatives up to `orders`. `few` omits redundant channels (see
/// [`crate::reconstruct::loss`]).
pub fn analyzed(scheme: &Scheme, k: usize, ray: &Ray, orders: usize, few: bool) -> Vec<StateJet> {
    let mut rows = sensor_rows(&scheme.sensor, ray.nm);
    if few {
        rows = sufficient(&rows);
    }
    let elements_ray = &at_elements(scheme, ray);
    let elements: Vec<(Jet, Vec<(usize, Quantity)>)> = scheme
        .analyzer()
        .iter()
        .enumerate()
        .rev()
        .map(|(i, e)| {
            let motors = if orders > 0 { motors_of(scheme, Side::Analyzer, i) } else { vec![] };
            (transposed(&e.jet(k, elements_ray)), motors)
        })
        .collect();
    let shared = scheme.coaxial.as_ref().map(|c| c.inward(ray).transpose());
    rows.into_iter()
        .map(|row| {
            let mut state = StateJet::constant(row);
            for (jet, motors) in &elements {
                state.pass(jet, motors, orders);
            }
            if let Some(m) = &shared {
                state.through(m);
            }
            state
        })
        .collect()
}

/// Transposes a jet. Rows propagate from the last element to the first through the transposed matrices.
fn transposed(jet: &Jet) -> Jet {
    Jet {
        value: jet.value.transpose(),
        first: jet.first.map(|m| m.transpose()),
        second: jet.second.map(|m| m.transpose()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that states that are computed with derivatives equal states that are computed without
    /// derivatives.
    #[test]
    fn states_equal_those_of_the_scheme() {
        for scheme in [Scheme::qrpr(3, true), Scheme::liquid_crystal(3, false)] {
            let scheme = scheme.expect("a scheme");
            let ray = Ray { nm: 450.0, incidence: 0.2, azimuth: 1.0 };
            for k in 0..3 {
                let [generator, analyzer] = scheme.sets(k);
                assert_eq!(illuminating(&scheme, &generator, &ray), generated(&scheme, k, &ray, 0).value);
                let rows: Vec<_> = detecting(&scheme, &analyzer, &ray).collect();
                let jets = analyzed(&scheme, k, &ray, 0, false);
                assert_eq!(rows.len(), jets.len());
                for (row, jet) in rows.iter().zip(&jets) {
                    assert!((row - jet.value).amax() < 1e-15);
                }
            }
        }
    }

    /// Verifies that first and second derivatives of the two states agree with central differences. The test
    /// covers rotating and liquid-crystal schemes.
    #[test]
    fn derivatives_match_finite_differences() {
        let schemes = [Scheme::qrpr(2, false), Scheme::qrpr(2, true), Scheme::liquid_crystal(2, false)];
        let (k, h) = (1, 1e-5);
        let ray = Ray::axial(550.0);
        for scheme in schemes {
            let scheme = scheme.expect("a scheme");
            let at = scheme.parameters();
            let moved = |motor: usize, by: f64| {
                let mut p = at.clone();
                p[motor * 2 + k] += by;
                scheme.with_parameters(&p)
            };
            type Of = fn(&Scheme, usize, &Ray) -> Vec<StateJet>;
            let sides: [Of; 2] =
                [|s, k, ray| vec![generated(s, k, ray, 2)], |s, k, ray| analyzed(s, k, ray, 2, false)];
            let mut checked = 0;
            for of in sides {
                for (c, state) in of(&scheme, k, &ray).iter().enumerate() {
                    for (motor, exact) in &state.first {
                        let (plus, minus) = (of(&moved(*motor, h), k, &ray), of(&moved(*motor, -h), k, &ray));
                        let found = (plus[c].value - minus[c].value) / (2.0 * h);
                        assert!((found - exact).amax() < 1e-8);
                        for (a, b, second) in &state.second {
                            let Some((_, other)) = [(*a, *b), (*b, *a)].into_iter().find(|(m, _)| m == motor)
                            else {
                                continue;
                            };
                            let of_other = |s: &StateJet| {
                                s.first.iter().find(|(m, _)| *m == other).expect("a motor of this side").1
                            };
                            let found = (of_other(&plus[c]) - of_other(&minus[c])) / (2.0 * h);
                            assert!((found - second).amax() < 1e-8, "{a} {b}");
                            checked += 1;
                        }
                    }
                }
            }
            assert!(checked >= 6);
        }
    }

    #[test]
    fn reduced_rows_have_the_same_normal_matrix() {
        let scheme = Scheme::qrpr(3, true).expect("a scheme");
        let normal = |few: bool| -> Matrix4<f64> {
            let rows = analyzed(&scheme, 2, &Ray::axial(450.0), 0, few);
            assert_eq!(rows.len(), if few { 3 } else { 4 });
            rows.iter().map(|r| r.value * r.value.transpose()).sum()
        };
        assert!((normal(true) - normal(false)).amax() < 1e-12);
    }
}
