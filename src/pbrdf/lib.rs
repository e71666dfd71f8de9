//! Polarimetric materials by themselves, without a scene: data sets of their Mueller matrices to learn from, the stand-ins for
//! a measured set, tables of analytic materials, and evaluation with frames and power. Needs the rooms of tracer and
//! scenes, since their materials and media are what is looked at.

#![warn(missing_docs)]

pub mod data_set;
pub mod evaluate;
pub mod phase;
pub mod stand_ins;
pub mod synth;
pub mod table_part;
