//! Cameras that speak GenICam: features by the names of the Standard Features Naming Convention, over any line that reads and
//! writes registers. Of the crate `cameleon`, built with the feature `genicam`; `usb3_vision` adds the USB line.

pub mod camera;
pub mod nodes;
pub mod stream;
#[cfg(feature = "usb3_vision")]
pub mod usb;

#[cfg(test)]
mod fake;
#[cfg(test)]
mod tests;
