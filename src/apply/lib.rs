//! What the tensor is for: the applications of Baek & Heide (2021, sections 6 and 8), their published baselines on the same
//! data, and what each is worth against exact ground truth.
//!
//! Methods are functions of images ([`map::Map`]) and tensors; they know no scene, no renderer and no file. An
//! [`application::Application`] names what it needs rendered, its methods and its metrics; [`catalog::all`] lists them all.

pub mod analysis;
pub mod application;
pub mod catalog;
pub mod chain;
pub mod comparison;
pub mod crystals;
pub mod ellipsometry;
pub mod error;
pub mod isolation;
pub mod map;
pub mod metamerism;
pub mod metrics;
pub mod multibounce;
pub mod observation;
pub mod paths;
pub mod pinhole;
pub mod regression;
pub mod scattering;
pub mod shape;
pub mod transient;
