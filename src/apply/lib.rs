//! Applications of the tensor. The crate contains the applications of Baek & Heide (2021, sections 6 and 8),
//! and published baselines on the same data. All applications are evaluated against exact ground truth.
//!
//! Methods are functions of images ([`map::Map`]) and tensors, and do not use scenes, renderers or files. An
//! [`application::Application`] defines its methods, its metrics and the renders that it needs.
//! [`catalog::all`] lists all applications.

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
