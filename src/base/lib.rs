//! Types that every crate uses: units, documents, atomic files, locks, journals and spectral tables.

pub mod calibration_file;
pub mod document;
pub mod input;
pub mod journal;
pub mod length;
pub mod locate;
pub mod lock;
pub mod npy;
pub mod positioned;
pub mod spectral_table;
pub mod staging;
pub mod tables;
pub mod units;
pub mod whole_file;
