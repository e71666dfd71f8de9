//! What a session may ask of instruments, whoever made them: one trait a kind of instrument, one small set of failures.
//!
//! Every call has a deadline (`within`) and either does what it says or returns a [`Failure`]; none blocks for longer. A
//! session knows instruments by these traits alone, so a simulated one, a real one, and one written by somebody else are the
//! same to it; `rig::conformance` says whether one keeps to what is written here.

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
