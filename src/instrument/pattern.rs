//! A projector that displays patterns from its memory: a DMD, or a light source that is on or off.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// A pattern of `width` × `height` pixels: one byte per pixel, rows from the top, 255 for full intensity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    pub width: u32,
    pub height: u32,
    /// Pixels, row-major.
    pub pixels: Vec<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectorLimits {
    /// Width and height, in pixels.
    pub size: [u32; 2],
    /// Maximum number of patterns in memory.
    pub patterns: usize,
    /// Bits per pixel; 1 for a binary projector.
    pub bits: u8,
    /// Shortest display time of a pattern.
    pub shortest: Duration,
}

impl ProjectorLimits {
    /// Checks that the projector's memory can hold a number of patterns.
    ///
    /// # Errors
    /// Returns a message with the number and the limit if the memory is too small.
    pub fn check(&self, patterns: usize) -> Result<(), String> {
        if patterns <= self.patterns {
            return Ok(());
        }
        Err(format!("{patterns} patterns exceed the limit of {} patterns", self.patterns))
    }
}

/// Returns entry number `pattern`, from 0, of a projector's list of loaded patterns.
///
/// # Errors
/// Returns a message if the list has no such entry.
pub fn loaded<T: Clone>(loaded: &[T], pattern: usize) -> Result<T, String> {
    let found = loaded.get(pattern).cloned();
    found.ok_or_else(|| {
        format!("pattern {pattern} does not exist, because only {} patterns are loaded", loaded.len())
    })
}

pub trait PatternProjector: Instrument {
    fn limits(&self) -> ProjectorLimits;

    /// Loads patterns, numbered from 0, which replace all earlier patterns.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind limit (number, size, or gray levels on a binary projector), timeout or
    /// disconnected.
    fn load(&mut self, patterns: &[Pattern], within: Duration) -> Result<(), Failure>;

    /// Displays a loaded pattern until the next call, and returns when the light is stable.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind limit (no such pattern), timeout, disconnected or refused.
    fn show(&mut self, pattern: usize, within: Duration) -> Result<(), Failure>;

    /// Turns off the light of the projector.
    ///
    /// # Errors
    /// Returns a [`Failure`] if the projector does not respond as expected within the time `within`.
    fn dark(&mut self, within: Duration) -> Result<(), Failure>;
}
