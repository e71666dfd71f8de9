//! Interfaces of instruments: one trait for each kind of instrument, and one type of failure.
//!
//! Every call has a deadline (`within`) and succeeds or returns a [`Failure`] before the deadline. A session
//! uses instruments only through the traits of this crate, so simulated, real and third-party instruments are
//! interchangeable. `rig::conformance` checks that an instrument follows the specification of its trait.

pub mod analog_output;
pub mod camera;
pub mod failure;
pub mod galvo;
pub mod identity;
pub mod laser;
pub mod pattern;
pub mod photon_counter;
pub mod pixels;
pub mod rotation_stage;

pub use analog_output::{AnalogLimits, AnalogOutput, AnalogSettings};
pub use camera::{AreaCamera, CameraLimits, CameraSettings, PixelFormat, RawFrame, Region, Trigger};
pub use failure::{Failure, Fault};
pub use galvo::{GalvoLimits, GalvoScanner};
pub use identity::{Identity, Instrument};
pub use laser::{LaserLimits, LaserState, PulsedLaser};
pub use pattern::{Pattern, PatternProjector, ProjectorLimits};
pub use photon_counter::{CounterLimits, CounterSettings, Histogram, PhotonCounter};
pub use rotation_stage::{RotationStage, StageLimits, StageReading};
