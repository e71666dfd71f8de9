//! Default values of optional scene keys, and predicates that let the serializer omit keys that have their
//! default.

use super::texture::AlbedoFile;
use super::values::{IndexFile, SpectrumFile, TimeFile};
pub(super) use super::values::{is_default, is_one, one};
use base::locate::Located;

/// Generates two functions from each line: one returns the default, and the other returns true if a value
/// equals the default.
macro_rules! defaults {
    ($($name:ident, $is:ident: $t:ty = $value:expr;)*) => {$(
        pub(super) fn $name() -> $t {
            $value
        }
        pub(super) fn $is(value: &$t) -> bool {
            *value == $name()
        }
    )*};
}

defaults! {
    wavelengths, is_wavelengths: Located<Vec<f64>> =
        Located::nowhere(optics::spectrum::Wavelengths::default().nm().to_vec());
    spp, is_spp: Located<u32> = Located::nowhere(64);
    replicates, is_replicates: Located<u32> = Located::nowhere(32);
    max_depth, is_max_depth: Located<u32> = Located::nowhere(6);
    rr_depth, is_rr_depth: u32 = 5;
    tile, is_tile: Located<u32> = Located::nowhere(32);
    time, is_time: TimeFile = TimeFile::Sum;
    unit, is_unit: Located<f64> = Located::nowhere(1.0);
    unit_index, is_unit_index: Located<IndexFile> =
        Located::nowhere(IndexFile::Values(SpectrumFile::Scalar(1.0)));
    unit_spectrum, is_unit_spectrum: Located<SpectrumFile> = Located::nowhere(SpectrumFile::Scalar(1.0));
    unit_albedo, is_unit_albedo: Located<AlbedoFile> = Located::nowhere(AlbedoFile::Spectrum(SpectrumFile::Scalar(1.0)));
    zero_spectrum, is_zero_spectrum: Located<SpectrumFile> = Located::nowhere(SpectrumFile::Scalar(0.0));
    x_axis, is_x_axis: [f64; 3] = [1.0, 0.0, 0.0];
    y_axis, is_y_axis: [f64; 3] = [0.0, 1.0, 0.0];
    down, is_down: [f64; 3] = [0.0, -1.0, 0.0];
    z_axis, is_z_axis: [f64; 3] = [0.0, 0.0, 1.0];
    rectangle_corner, is_rectangle_corner: [f64; 3] = [-1.0, -1.0, 0.0];
    rectangle_u, is_rectangle_u: [f64; 3] = [2.0, 0.0, 0.0];
    rectangle_v, is_rectangle_v: [f64; 3] = [0.0, 2.0, 0.0];
    cube_min, is_cube_min: [f64; 3] = [-1.0; 3];
    cube_max, is_cube_max: [f64; 3] = [1.0; 3];
    fat_percent, is_fat_percent: Located<f64> = Located::nowhere(3.5);
    protein_percent, is_protein_percent: Located<f64> = Located::nowhere(3.4);
    homogenization_mpa, is_homogenization_mpa: Located<f64> = Located::nowhere(20.0);
    skin_g, is_skin_g: Located<f64> = Located::nowhere(0.8);
}
