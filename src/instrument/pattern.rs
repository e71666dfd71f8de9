//! A projector that displays patterns from its memory. The projector is a DMD, or a light source that is on
//! or off.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// A pattern of `width` × `height` pixels. Each pixel is one byte, and 255 is full intensity. The pixels are
/// stored row by row from the top.
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
    /// Bits per pixel, 1 for a binary projector.
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

    /// Checks the size of patterns and, for a binary projector, their values.
    ///
    /// # Errors
    /// Returns a message about the first pattern that the projector cannot show.
    pub fn check_pixels(&self, patterns: &[Pattern]) -> Result<(), String> {
        let [width, height] = self.size;
        for (i, p) in patterns.iter().enumerate() {
            let whole = p.pixels.len() == width as usize * height as usize;
            if [p.width, p.height] != self.size || !whole {
                return Err(format!(
                    "pattern {i} has {} x {} pixels, but the projector has {width} x {height} pixels; use patterns of the projector's \
                     size",
                    p.width, p.height
                ));
            }
            if self.bits == 1
                && let Some(grey) = p.pixels.iter().find(|v| **v != 0 && **v != 255)
            {
                return Err(format!(
                    "pattern {i} has a pixel with the value {grey}; only 255 (on) and 0 (off) are supported"
                ));
            }
        }
        Ok(())
    }
}

/// Returns the entry with index `pattern`, counted from 0, of a projector's list of loaded patterns.
///
/// # Errors
/// Returns a message if the list has no entry with this number.
pub fn loaded<T: Clone>(loaded: &[T], pattern: usize) -> Result<T, String> {
    let found = loaded.get(pattern).cloned();
    found.ok_or_else(|| {
        format!("pattern {pattern} does not exist, because only {} patterns are loaded", loaded.len())
    })
}

pub trait PatternProjector: Instrument {
    fn limits(&self) -> ProjectorLimits;

    /// Loads patterns, numbered from 0. The loaded patterns replace all earlier patterns.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: the number or the size of the patterns is out of range, or a pattern for a binary projector
    ///   has grey levels
    /// - `timeout` or `disconnected`
    fn load(&mut self, patterns: &[Pattern], within: Duration) -> Result<(), Failure>;

    /// Displays a loaded pattern until the next call, and returns when the light is stable.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: no pattern with this number is loaded
    /// - `timeout`, `disconnected` or `refused`
    fn show(&mut self, pattern: usize, within: Duration) -> Result<(), Failure>;

    /// Turns off the light of the projector.
    ///
    /// # Errors
    /// Returns a [`Failure`] if the projector does not respond as expected within the time `within`.
    fn dark(&mut self, within: Duration) -> Result<(), Failure>;
}
