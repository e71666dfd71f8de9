//! Pattern mode over USB HID of TI's DLPC350, the controller of LightCrafter 4500 projectors (guide DLPU010).
//!
//! **Patterns.** In pattern mode the controller displays bit planes of the images in its flash, or bit planes
//! of the video port. TI's own program writes these images together with the firmware. The images cannot be
//! sent over USB while the sequence runs. The driver therefore takes a list of the flash contents
//! (`dlpc350::projector::Flash`). It finds each pattern, or the negative of the pattern, in this list. White
//! and black are always available. Any other pattern fails with a limit error. The video port is not
//! supported.
//!
//! **Tests.** The driver is not tested with real hardware. Packets are compared with those of the independent
//! package `pycrafter4500` (`validation/dlpc350.py`). The behaviour is tested with the emulator of this
//! module, which follows the guide. The tests of device files ([`hidraw`]) cover only finding and opening a
//! file.

pub mod command;
#[cfg(test)]
mod emulator;
pub mod flash;
pub mod hid;
#[cfg(target_os = "linux")]
pub mod hidraw;
pub mod projector;
#[cfg(test)]
mod tests;
pub mod trigger;
