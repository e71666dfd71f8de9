//! Converts metres to picoseconds. No other module converts between these units.

/// Speed of light in vacuum, in metres per second (exact, SI).
pub const LIGHT_SPEED_M_PER_S: f64 = 299_792_458.0;

/// Optical path length that light travels in one picosecond, in metres.
pub const METRES_PER_PS: f64 = LIGHT_SPEED_M_PER_S * 1e-12;

/// Converts an optical path length (Σ n·d) in metres to a travel time in picoseconds.
#[inline]
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
