//! Patterns of structured light. The patterns are white, black, Gray codes of columns and rows with their
//! inverses, and optional phase-shifted waves.

use std::f64::consts::TAU;

/// A coordinate axis of the projector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The column coordinate u.
    Column,
    /// The row coordinate v.
    Row,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// A pattern with all pixels on.
    White,
    /// A pattern with all pixels off.
    Black,
    /// A bit of an axis' Gray code (0 is the lowest), and whether the pattern is inverted.
    Bit(Axis, u32, bool),
    /// A cosine along an axis, and the index of its phase shift.
    Wave(Axis, u32),
}

/// The pattern sequence of a projector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sequence {
    /// Width and height of the projector in pixels.
    pub size: [u32; 2],
    /// Number of phase shifts of the waves, 3 to 64, or 0 for a sequence without waves.
    pub shifts: u32,
    /// Period of the waves in pixels.
    pub period: u32,
}

impl Sequence {
    /// Creates a sequence of Gray codes without waves.
    ///
    /// # Errors
    /// Returns a message if the width or the height is 0 or above 32,768.
    pub fn gray(size: [u32; 2]) -> Result<Self, String> {
        Self::with_waves(size, 0, 16)
    }

    /// Creates a sequence of Gray codes and of waves, which determine subpixel coordinates.
    ///
    /// # Errors
    /// Returns a message if the size, the number of shifts or the period (4 to 1024) is out of range.
    pub fn with_waves(size: [u32; 2], shifts: u32, period: u32) -> Result<Self, String> {
        if !size.iter().all(|n| (1..=32768).contains(n)) {
            return Err(format!(
                "invalid projector size {} × {} pixels; expected 1 to 32768 pixels in each direction",
                size[0], size[1]
            ));
        }
        if shifts != 0 && !(3..=64).contains(&shifts) {
            return Err(format!(
                "the number of shifts is {shifts}: expected 3 to 64, or 0 for Gray codes only"
            ));
        }
        if !(4..=1024).contains(&period) {
            return Err(format!("the period of the waves is {period} pixels: expected 4 to 1024 pixels"));
        }
        Ok(Self { size, shifts, period })
    }

    /// Returns the number of Gray code bits of an axis.
    pub fn bits(&self, axis: Axis) -> u32 {
        let n = self.length(axis);
        u32::BITS - (n - 1).leading_zeros()
    }

    fn length(&self, axis: Axis) -> u32 {
        match axis {
            Axis::Column => self.size[0],
            Axis::Row => self.size[1],
        }
    }

    /// Returns all patterns in order. The images for decoding must have the same order.
    pub fn patterns(&self) -> Vec<Pattern> {
        let mut all = vec![Pattern::White, Pattern::Black];
        for axis in [Axis::Column, Axis::Row] {
            for bit in (0..self.bits(axis)).rev() {
                all.extend([Pattern::Bit(axis, bit, false), Pattern::Bit(axis, bit, true)]);
            }
            all.extend((0..self.shifts).map(|s| Pattern::Wave(axis, s)));
        }
        all
    }

    /// Returns the drive of a projector pixel, from 0 (off) to 1 (on).
    pub fn drive(&self, pattern: Pattern, u: u32, v: u32) -> f64 {
        let along = |axis| if axis == Axis::Column { u } else { v };
        match pattern {
            Pattern::White => 1.0,
            Pattern::Black => 0.0,
            Pattern::Bit(axis, bit, inverted) => {
                let x = along(axis);
                let on = ((x ^ (x >> 1)) >> bit) & 1 == 1;
                f64::from(u8::from(on != inverted))
            }
            Pattern::Wave(axis, shift) => {
                let phase = (f64::from(along(axis)) + 0.5) / f64::from(self.period)
                    - f64::from(shift) / f64::from(self.shifts);
                0.5 + 0.5 * (TAU * phase).cos()
            }
        }
    }

    /// Returns the pixel values of a pattern as bytes, row by row.
    pub fn bytes(&self, pattern: Pattern) -> Vec<u8> {
        let [w, h] = self.size;
        let rows = (0..h).flat_map(|v| (0..w).map(move |u| (u, v)));
        rows.map(|(u, v)| (255.0 * self.drive(pattern, u, v)).round() as u8).collect()
    }
}
