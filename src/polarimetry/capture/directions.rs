//! Directions in which light passes the elements of a rig, per pixel. Light passes through a camera's
//! pinhole, or travels in the direction of a galvo scanner.

use super::element::Ray;
use super::simulate::Layout;

/// Viewing directions of the pixels of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Directions {
    /// All light is parallel to the optical axis, as with a telecentric lens.
    Axial,
    /// Light passes through a pinhole on the axis.
    Pinhole {
        /// Half of the image's width and height at unit distance, which are tangents of the angles to the
        /// image's edges in x and y.
        half: [f64; 2],
    },
}

impl Directions {
    /// Returns a pinhole with square pixels and a horizontal field of view of `fov_x` radians (below π).
    pub fn pinhole(fov_x: f64, width: usize, height: usize) -> Self {
        let half = (fov_x / 2.0).tan();
        Self::Pinhole { half: [half, half * height as f64 / width.max(1) as f64] }
    }

    /// Returns the ray through the centre of a pixel in an image of `size` columns and rows. Azimuths are
    /// measured from the frame's x axis, which points to the right of the image. Azimuths increase
    /// counter-clockwise when looking toward the source. Rows are numbered from the top.
    pub fn ray(&self, x: usize, y: usize, size: [usize; 2], nm: f64) -> Ray {
        let Self::Pinhole { half } = self else {
            return Ray::axial(nm);
        };
        let place = |i: usize, n: usize| (2.0 * i as f64 + 1.0) / n.max(1) as f64 - 1.0;
        let (tx, ty) = (half[0] * place(x, size[0]), -half[1] * place(y, size[1]));
        Ray { nm, incidence: tx.hypot(ty).atan(), azimuth: ty.atan2(tx) }
    }

    /// Returns the rays of all pixels of a layout. The rays are sorted by row (from the top), column and
    /// wavelength. If all rays are axial, returns one ray per wavelength.
    pub fn rays(&self, layout: Layout, wavelengths_nm: &[f64]) -> Vec<Ray> {
        if *self == Self::Axial {
            return wavelengths_nm.iter().copied().map(Ray::axial).collect();
        }
        let size = [layout.width, layout.height];
        let places = (0..layout.height).flat_map(|y| (0..layout.width).map(move |x| (x, y)));
        places.flat_map(|(x, y)| wavelengths_nm.iter().map(move |nm| self.ray(x, y, size, *nm))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_of_pinhole_corners_have_known_directions() {
        let view = Directions::pinhole(90_f64.to_radians(), 4, 2);
        let ray = view.ray(3, 0, [4, 2], 550.0);
        // The centre of the upper right pixel is at (0.75, 0.25) at distance one.
        assert!((ray.incidence.tan() - 0.75_f64.hypot(0.25)).abs() < 1e-12);
        assert!((ray.azimuth - 0.25_f64.atan2(0.75)).abs() < 1e-12);
        let [x, y] = ray.direction();
        assert!(x > 0.0 && y > 0.0);
        assert_eq!(Directions::Axial.ray(3, 0, [4, 2], 550.0), Ray::axial(550.0));
    }
}
