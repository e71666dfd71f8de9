//! The one place where metres become picoseconds.

/// Speed of light in vacuum, metres per second (exact, SI).
pub const LIGHT_SPEED_M_PER_S: f64 = 299_792_458.0;

/// Metres of optical path that light covers in one picosecond.
pub const METRES_PER_PS: f64 = LIGHT_SPEED_M_PER_S * 1e-12;

/// Travel time in picoseconds of an optical path length (Σ n·d) in metres.
#[inline]
#[must_use]
pub fn picoseconds(optical_path_m: f64) -> f64 {
    optical_path_m / METRES_PER_PS
}

#[cfg(test)]
mod tests {
    #[test]
    fn one_metre_takes_3335_ps() {
        assert!((super::picoseconds(1.0) - 3_335.640_951_98).abs() < 1e-6);
    }
}
