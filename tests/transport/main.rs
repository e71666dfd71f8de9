//! Compares the tracer with closed forms and independent f64 quadrature.
//!
//! Statistical tolerances are five standard errors at a fixed seed. Values without random variation agree up
//! to f32 rounding.

mod apertures;
mod attributes;
mod bidirectional;
mod bins;
mod bumps;
mod combined;
mod crystals;
mod direct;
mod double_images;
mod doubling;
mod doubt;
mod energy;
mod filled_sheets;
mod frames;
mod glass;
mod grids;
mod imported_albedo;
mod indirect;
mod instances;
mod labels;
mod layers;
mod light_sampling;
mod light_tree;
mod lights;
mod manifold;
mod materials;
mod measured;
mod media;
mod memory;
mod mesh_files;
mod microfacet;
mod mirrors;
mod optics;
mod orthographic;
mod projector_sheets;
mod published_slabs;
mod rough_crystals;
mod rows;
mod scales;
mod scattering;
mod selected;
mod sheets;
mod shipped;
mod slab;
mod slides;
mod specular;
mod stand_ins;
mod standard_errors;
mod strategies;
mod textures;
mod thin_plates;
mod touching;
mod wishes;

use ::support;
