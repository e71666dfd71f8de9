//! A projector that shows patterns from its memory: a DMD, or a light source that is on or off.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// Patterns of a projector: one byte a pixel, rows from the top, 255 is full light.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Pixels, row-major.
    pub pixels: Vec<u8>,
}

/// What a projector can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectorLimits {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Patterns that its memory holds.
    pub patterns: usize,
    /// Bits a pixel: 1 where a pixel is on or off.
    pub bits: u8,
    /// Shortest time a pattern can stand.
    pub shortest: Duration,
}

/// A pattern projector.
pub trait PatternProjector: Instrument {
    /// What it can do.
    fn limits(&self) -> ProjectorLimits;

    /// Loads patterns into its memory, numbered from 0; those loaded before are forgotten.
    ///
    /// # Errors
    /// [`Failure`]: limit (too many, wrong size, grey on a binary one), timeout, disconnected.
    fn load(&mut self, patterns: &[Pattern], within: Duration) -> Result<(), Failure>;

    /// Shows a loaded pattern until another is asked for, and returns when its light stands.
    ///
    /// # Errors
    /// [`Failure`]: limit (no such pattern), timeout, disconnected, refused.
    fn show(&mut self, pattern: usize, within: Duration) -> Result<(), Failure>;

    /// No light.
    ///
    /// # Errors
    /// [`Failure`] after `within` at the latest.
    fn dark(&mut self, within: Duration) -> Result<(), Failure>;
}
