//! TI's DLPC350, the controller of LightCrafter 4500 projectors, in pattern mode over USB HID (programmer's guide DLPU010).
//!
//! **What pattern mode can do.** Its patterns are bit planes of images in the controller's flash, written there with its
//! firmware by TI's own program, or of the video port; none can be sent over USB while it runs. The driver therefore takes a
//! list of what its flash holds (`dlpc350::projector::Flash`), and loads patterns by finding them, or their negatives, there;
//! white and black are always there. A pattern that is not is a limit, told as such. The video port is not driven.
//!
//! What no machine of the project's could try is the real hardware: packets are those of the independent package
//! `pycrafter4500` (`validation/dlpc350.py`), behaviour is that of this module's emulator, written after the guide; the
//! device file of the system ([`hidraw`]) is only known to be found and opened.

pub mod command;
pub mod emulator;
pub mod flash;
pub mod hid;
#[cfg(target_os = "linux")]
pub mod hidraw;
pub mod projector;
#[cfg(test)]
mod tests;
pub mod trigger;
