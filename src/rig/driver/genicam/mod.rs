//! GenICam cameras (crate `cameleon`, Cargo feature `genicam`). Camera features have the names of the
//! Standard Features Naming Convention. The driver accesses the features over any line that reads and writes
//! registers. The Cargo feature `usb3_vision` adds the USB line.

pub mod camera;
mod nodes;
pub mod stream;
#[cfg(feature = "usb3_vision")]
pub mod usb;

#[cfg(test)]
mod fake;
#[cfg(test)]
mod tests;
