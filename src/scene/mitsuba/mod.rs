//! Exports scenes to Mitsuba 3's XML (Jakob et al. 2022, <https://mitsuba.readthedocs.io>) and imports scenes
//! from Mitsuba's files.
//!
//! The conversion handles these differences between the two programs:
//!
//! | | Sunstone | Mitsuba 3 |
//! |---|---|---|
//! | device axes | +x right, +y down, +z forward | +x left, +y up, +z forward |
//! | projector of irradiance E | E on the plane at 1 m | π times its `scale` × `irradiance` there |
//! | spectra | one value per wavelength | pairs wavelength:value, zero beyond the last |
//! | opaque materials | two-sided | one-sided; black from behind unless in `twosided` |
//! | exterior index | 1 | 1.000277 (air) unless given |
//! | polarizer angle | counter-clockwise | clockwise |
//! | texture coordinate v | from the lower edge of the image | from the upper edge |
//! | caps of a tube | part of the tube | separate disks |
//! | copies | `[groups]` and `[[instances]]` | `shapegroup` and `instance` |
//! | emitted light | any Stokes vector | unpolarized: column 0 of T |
//!
//! [`export`] writes and [`import`] reads the same subset. The modules `xml` and `reader` implement the
//! syntax of Mitsuba's files.

mod document;
pub mod export;
mod export_emitters;
mod export_images;
mod export_materials;
mod export_output;
mod files;
mod folders;
pub mod import;
mod import_devices;
mod import_emitters;
mod import_generated;
mod import_instances;
mod import_layered;
mod import_materials;
mod import_media;
mod import_shapes;
mod import_surfaces;
mod import_table;
mod importer;
mod json;
mod names;
mod plugins;
mod reader;
mod source;
mod tree;
mod xml;

pub use files::{Contents, WriteError};
