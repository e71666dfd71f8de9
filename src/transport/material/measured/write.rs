//! Writes `.pbsdf` files from given values or from another material.
//!
//! The layout is that of [`super::tensor_file`], with fields in the order of Mitsuba's files and data aligned
//! to 8 bytes. Only the entries of one φ_d are in memory at a time. The file is written to the destination
//! folder under a temporary name and then renamed, so that the destination is never incomplete.

use super::axes::{ANGLES, Axes};
use super::error::PbsdfError;
use super::rusinkiewicz::{Coordinates, directions};
use super::tensor_file::{Dtype, MAGIC};
use crate::geometry::ray::Surface;
use crate::material::Materials;
use base::whole_file;
use glam::Vec3A;
use optics::spectrum::MAX_WAVELENGTHS;
use rayon::prelude::*;
use std::io::Write;
use std::path::Path;

/// Returns all bytes of a file before the data of field M. These bytes are the header and the axes.
fn head(axes: &Axes) -> Vec<u8> {
    let n = axes.angles().map(<[f32]>::len);
    let bands = axes.wavelengths_nm.len();
    let [phi_d, theta_d, theta_h] = axes.angles();
    let floats = |v: &[f32]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let wvls = axes.wavelengths_nm.iter().flat_map(|w| w.to_le_bytes());
    let fields = [
        (ANGLES[0].0, Dtype::F32, vec![1, n[0]], floats(phi_d)),
        (ANGLES[1].0, Dtype::F32, vec![1, n[1]], floats(theta_d)),
        (ANGLES[2].0, Dtype::F32, vec![1, n[2]], floats(theta_h)),
        ("wvls", Dtype::U16, vec![bands], wvls.collect()),
        ("M", Dtype::F32, vec![n[0], n[1], n[2], bands, 4, 4], vec![]),
    ];
    let entry = |name: &str, shape: &[usize]| 13 + name.len() + 8 * shape.len();
    let header: usize = fields.iter().map(|(name, _, shape, _)| entry(name, shape)).sum();
    let mut offset = (super::tensor_file::HEAD + header).next_multiple_of(8);
    let mut out = MAGIC.to_vec();
    out.extend([1, 0]);
    out.extend((fields.len() as u32).to_le_bytes());
    for (name, dtype, shape, data) in &fields {
        out.extend((name.len() as u16).to_le_bytes());
        out.extend(name.as_bytes());
        out.extend((shape.len() as u16).to_le_bytes());
        out.push(dtype.code());
        out.extend((offset as u64).to_le_bytes());
        out.extend(shape.iter().flat_map(|n| (*n as u64).to_le_bytes()));
        offset = (offset + data.len()).next_multiple_of(8);
    }
    for (.., data) in &fields {
        out.resize(out.len().next_multiple_of(8), 0);
        out.extend(data);
    }
    out
}

/// Writes a table.
///
/// `fill` receives the index of a value of φ_d and a buffer for the entries of this value. The elements of
/// the buffer are initially zero. The buffer contains row-major matrices with the shape [theta_d, theta_h,
/// wavelength, 4, 4]. The elements are BRDF values (without the cosine) between s frames. NaN marks unknown
/// values.
///
/// # Errors
/// Returns a [`PbsdfError`] if the axes are invalid or too long, or if the file cannot be written.
pub fn write(path: &Path, axes: &Axes, mut fill: impl FnMut(usize, &mut [f32])) -> Result<(), PbsdfError> {
    axes.check()?;
    let mut slab = vec![0.0_f32; axes.slab_len()?];
    let head = head(axes);
    whole_file::write_with(path, |file| {
        file.write_all(&head)?;
        for i in 0..axes.phi_d.len() {
            slab.fill(0.0);
            fill(i, &mut slab);
            for x in &mut slab {
                *x = f32::from_bits(x.to_bits().to_le());
            }
            file.write_all(bytemuck::cast_slice(&slab))?;
        }
        Ok(())
    })
    .map_err(PbsdfError::Write)
}

/// Minimum cosine to the normal at which a material is tabulated.
const LEAST_COS: f32 = 1e-4;

/// Evaluates a material for one value of φ_d, in the layout of [`write()`].
///
/// Values are NaN where the light or the viewer is below the horizon, or everywhere if the index `phi_d` is
/// out of range. Values are 0 where the material reflects nothing. `sources` is as in [`tabulate`]. Bands
/// without a source stay 0.
pub fn slab(axes: &Axes, sources: &[(&Materials, u32)], phi_d: usize, out: &mut [f32]) {
    let Some(&phi_d) = axes.phi_d.get(phi_d) else {
        out.fill(f32::NAN);
        return;
    };
    out.fill(0.0);
    let (matrices, _) = out.as_chunks_mut::<16>();
    let grid = axes.theta_d.iter().flat_map(|d| axes.theta_h.iter().map(move |h| (*d, *h)));
    let angles: Vec<(f32, f32)> = grid.collect();
    let cells = matrices.par_chunks_exact_mut(axes.wavelengths_nm.len().max(1));
    cells.zip(&angles).with_min_len(256).for_each(|(cell, &(theta_d, theta_h))| {
        let at = Coordinates { phi_d, theta_d, theta_h };
        let (wi, wo, s) = directions(at);
        if wi.z < LEAST_COS || wo.z < LEAST_COS {
            cell.fill([f32::NAN; 16]);
            return;
        }
        for (bands, (materials, id)) in cell.chunks_mut(MAX_WAVELENGTHS).zip(sources) {
            let at = Surface {
                ng: Vec3A::Z,
                ns: Vec3A::Z,
                tangent: Vec3A::X,
                material: *id,
                ..Surface::default()
            };
            let Some(scatter) = materials.eval(*id, &at, wo, wi) else {
                continue;
            };
            let m = scatter.between(wo, s, wi, s);
            for (lane, matrix) in bands.iter_mut().enumerate() {
                let rows = m.lane(lane);
                *matrix = std::array::from_fn(|e| rows[e / 4][e % 4] / wi.z);
            }
        }
    });
}

/// Tabulates the BRDF of a material. As in measurements, entries are holes where the light or the viewer is
/// below the horizon.
///
/// A material has up to four wavelength lanes. `sources` therefore contains versions of the same material for
/// different wavelengths. Each version is given by a table of materials and the index of the material in this
/// table. Bands 0 to 3 are the lanes of the first source, and bands 4 to 7 are the lanes of the second
/// source.
///
/// # Errors
/// Returns a [`PbsdfError`] if there are too few or too many sources, or if [`write()`] fails.
pub fn tabulate(path: &Path, axes: &Axes, sources: &[(&Materials, u32)]) -> Result<(), PbsdfError> {
    let bands = axes.wavelengths_nm.len();
    if bands.div_ceil(MAX_WAVELENGTHS) != sources.len() {
        return Err(PbsdfError::Sources { bands, sources: sources.len() });
    }
    write(path, axes, |i, out| slab(axes, sources, i, out))
}
