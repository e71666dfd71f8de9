//! GenICam cameras (crate `cameleon`, feature `genicam`): features named by the Standard Features Naming
//! Convention, over any line that reads and writes registers. The feature `usb3_vision` adds the USB line.

pub mod camera;
mod nodes;
pub mod stream;
#[cfg(feature = "usb3_vision")]
pub mod usb;

#[cfg(test)]
mod fake;
#[cfg(test)]
mod tests;
