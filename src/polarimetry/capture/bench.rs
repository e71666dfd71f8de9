//! Simulates a bench. The module computes one frame on a sensor for the current settings of all elements.
//!
//! The forward model is the factored form of [`super::design_matrix::rows`]. The generator state illuminates
//! the scene, and the analyzer rows weight the returning light. The bench takes the settings of the elements
//! instead of a capture number, because laboratory stages stop at positions that differ from the plan.

use super::design_matrix::ELEMENTS;
use super::detector::polarizer_array::polarizer;
use super::directions::Directions;
use super::element::{Ray, Set, Stokes};
use super::scheme::Scheme;
use super::states::{detecting, illuminating};
use rayon::prelude::*;

/// The actual optics with imperfections, and the directions of light through the optics.
#[derive(Clone, Debug, PartialEq)]
pub struct Bench {
    /// The polarizing elements on the generator path and the analyzer path. The settings that the scheme
    /// contains for each capture are ignored.
    pub optics: Scheme,
    /// Wavelength in nanometres.
    pub nm: f64,
    /// Directions of camera pixels through the analyzer.
    pub camera: Directions,
    /// Directions of projector pixels through the generator.
    pub projector: Directions,
}

/// The light that the scene returns toward each camera pixel under one projected pattern.
#[derive(Clone, Copy, Debug)]
pub enum Light<'a> {
    /// Mueller matrices of the scene under a pattern: 16 elements per pixel, row-major. [`Bench`] applies the
    /// illumination to these matrices.
    Mueller(&'a [f32]),
    /// Stokes vectors of the returning light per pixel. The illumination ([`Bench::lighting`]) is already
    /// applied.
    Stokes(&'a [[f64; 4]]),
}

impl Light<'_> {
    fn at(&self, pixel: usize, lighting: &Stokes) -> Stokes {
        match self {
            Self::Mueller(m) => times(&m[pixel * ELEMENTS..][..ELEMENTS], lighting),
            Self::Stokes(s) => Stokes::from(s[pixel]),
        }
    }
}

/// Multiplies a row-major f32 matrix by a Stokes vector.
pub fn times(m: &[f32], s: &Stokes) -> Stokes {
    Stokes::from_fn(|i, _| (0..4).map(|j| f64::from(m[4 * i + j]) * s[j]).sum())
}

impl Bench {
    /// Returns the Stokes vector of the light from the pixel at `(u, v)` of a projector of `size` columns and
    /// rows.
    pub fn lighting(&self, generator: &[Set], [u, v]: [usize; 2], size: [usize; 2]) -> Stokes {
        let ray = self.projector.ray(u, v, size, self.nm);
        illuminating(&self.optics, generator, &ray)
    }

    /// Returns the intensities on a camera of `size` columns and rows, in the units of `light`. There is one
    /// number per pixel of the region `[x, y, width, height]`. For a polarizer array, the result is the raw
    /// mosaic.
    ///
    /// # Panics
    /// Panics if the region exceeds the camera, or if `light` has too few pixels.
    pub fn image(
        &self,
        light: Light<'_>,
        sets: &[Vec<Set>; 2],
        size: [usize; 2],
        [x0, y0, width, height]: [usize; 4],
    ) -> Vec<f64> {
        let axial = self.camera == Directions::Axial;
        let lighting = self.lighting(&sets[0], [0, 0], [1, 1]);
        let on_axis: Vec<Stokes> = detecting(&self.optics, &sets[1], &Ray::axial(self.nm)).collect();
        let channels = self.optics.sensor.channels();
        let mut out = vec![0.0; width * height];
        out.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, out)| {
            let y = y0 + row;
            for (column, out) in out.iter_mut().enumerate() {
                let x = x0 + column;
                let channel = if channels == 4 { polarizer(x, y) } else { 0 };
                let weights = if axial {
                    on_axis[channel]
                } else {
                    let ray = self.camera.ray(x, y, size, self.nm);
                    let mut all = detecting(&self.optics, &sets[1], &ray);
                    all.nth(channel).unwrap_or_default()
                };
                *out = weights.dot(&light.at(y * size[0] + x, &lighting));
            }
        });
        out
    }

    /// Returns the radiance per time bin for one ray of a coaxial rig. `histogram` holds the 16 Mueller
    /// elements of each bin.
    pub fn histogram(&self, histogram: &[f32], sets: &[Vec<Set>; 2], ray: &Ray) -> Vec<f64> {
        let lighting = illuminating(&self.optics, &sets[0], ray);
        let weights = detecting(&self.optics, &sets[1], ray).next().unwrap_or_default();
        histogram.chunks_exact(ELEMENTS).map(|m| weights.dot(&times(m, &lighting))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::simulate::{Layout, Noise, simulate};
    use super::*;

    /// Verifies that frames of the bench equal frames of [`simulate`], for rays along the axis and for rays
    /// through a pinhole.
    #[test]
    fn frames_equal_the_simulated_batch() {
        let layout = Layout { height: 4, width: 6, times: 1, lanes: 1 };
        let matrices: Vec<f32> = (0..layout.pixels() * 16)
            .map(|i| if i % 16 == 0 { 1.0 } else { ((i * 31) % 17) as f32 / 50.0 })
            .collect();
        let double: Vec<f64> = matrices.iter().copied().map(f64::from).collect();
        for array in [false, true] {
            let scheme = Scheme::qrpr(3, array).expect("a scheme");
            for view in [Directions::Axial, Directions::pinhole(0.8, 6, 4)] {
                let rays = view.rays(layout, &[550.0]);
                let seen = simulate(&double, layout, &scheme, &rays, &Noise::None, 0).expect("captures");
                let bench =
                    Bench { optics: scheme.clone(), nm: 550.0, camera: view, projector: Directions::Axial };
                for k in 0..3 {
                    let sets = scheme.sets(k);
                    // [`simulate`] uses the ray of the camera pixel for the generator and for the analyzer.
                    let lit: Vec<[f64; 4]> = (0..24)
                        .map(|i| {
                            let ray = view.ray(i % 6, i / 6, [6, 4], 550.0);
                            times(&matrices[i * 16..][..16], &illuminating(&scheme, &sets[0], &ray)).into()
                        })
                        .collect();
                    let image = bench.image(Light::Stokes(&lit), &sets, [6, 4], [0, 0, 6, 4]);
                    for (i, value) in image.iter().enumerate() {
                        let m = if array { 4 * k + polarizer(i % 6, i / 6) } else { k };
                        let want = f64::from(seen.intensities[m * 24 + i]);
                        assert!((value - want).abs() < 1e-6, "{value} {want}");
                    }
                    let part = bench.image(Light::Stokes(&lit), &sets, [6, 4], [2, 1, 3, 2]);
                    assert_eq!(part[3..6], image[2 * 6 + 2..2 * 6 + 5]);
                    if view == Directions::Axial {
                        let same = bench.image(Light::Mueller(&matrices), &sets, [6, 4], [0, 0, 6, 4]);
                        assert_eq!(same, image);
                    }
                }
            }
        }
    }
}
