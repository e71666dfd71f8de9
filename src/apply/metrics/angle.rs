//! Computes angles between directions. The error of a normal is its angle to the true normal.

/// Returns the angle between two directions in degrees, computed as atan2(|a × b|, a · b). The atan2 formula
/// is also accurate near 0 and 180°. The result for zero vectors is NaN.
pub fn angle_deg(a: &[f64], b: &[f64]) -> f64 {
    let cross = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
    let sine = (cross(1, 2).powi(2) + cross(2, 0).powi(2) + cross(0, 1).powi(2)).sqrt();
    let cosine: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    if sine == 0.0 && cosine == 0.0 {
        return f64::NAN;
    }
    sine.atan2(cosine).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::angle_deg;

    #[test]
    fn angles_of_known_rotations() {
        for turned in [0.0, 1e-7, 1.0, 4.0, 90.0, 179.999] {
            let t = f64::to_radians(turned);
            let found = angle_deg(&[t.sin(), 0.0, t.cos()], &[0.0, 0.0, 2.0]);
            approx::assert_relative_eq!(found, turned, epsilon = 1e-12, max_relative = 1e-9);
        }
        assert!(angle_deg(&[0.0; 3], &[0.0, 0.0, 1.0]).is_nan());
    }
}
