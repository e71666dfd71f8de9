//! Measured materials: tables of Mueller matrices by Rusinkiewicz angles and wavelength, in `.pbsdf` files.
//!
//! The data are the isotropic pBRDFs of the KAIST data set, or any file with the same layout. Baek et al.
//! (2020) describe the data set in "Image-based acquisition and modeling of polarimetric reflectance". Tasks
//! of the submodules:
//!
//! - [`table`] interpolates between entries,
//! - [`rusinkiewicz`] defines the angles and Stokes frames,
//! - `importance` samples directions,
//! - [`mod@write`] writes files.

pub mod axes;
pub mod error;
mod importance;
pub mod rusinkiewicz;
pub mod table;
pub mod tensor_file;
pub mod write;

use super::lobe::Sampled;
use super::side::{facing, same_side};
use crate::geometry::ray::Surface;
use glam::{Mat3A, Vec3A};
use optics::polarization::frame::project;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::sampling::warp;
use optics::spectrum::Spectral;
use table::Table;

/// A measured surface.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Index of the table in [`Materials::tables`](super::Materials::tables).
    pub table: u32,
}

/// Fraction of directions sampled with the cosine density. The cosine density covers reflection that the
/// averaged importance tables miss.
const COSINE_SHARE: f32 = 0.1;

/// Returns the rotation from the local frame to world space. The local z axis is `n`, and `wo` is in the half
/// plane y = 0, x ≥ 0.
#[inline]
fn frame(n: Vec3A, wo: Vec3A) -> Mat3A {
    let x = project(wo, n);
    Mat3A::from_cols(x, n.cross(x), n)
}

impl Measured {
    #[inline]
    fn table(self, tables: &[Table]) -> &Table {
        &tables[self.table as usize]
    }

    /// Returns the Mueller matrix of the table times cosθ_i.
    #[inline]
    pub fn eval(&self, tables: &[Table], at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let n = facing(at, wo)?;
        let cos = n.dot(wi);
        if cos <= 0.0 || !same_side(at, wo, wi) {
            return None;
        }
        let (coordinates, s) = rusinkiewicz::coordinates(n, wo, wi);
        Some(Scatter::Full {
            mueller: self.table(tables).eval(coordinates).scaled(Spectral::splat(cos)),
            frame_out: s,
            frame_in: s,
        })
    }

    /// Returns the sampling density of `wi`, 1/sr. The result is the density of half vectors divided by 4
    /// wo·h, mixed with the cosine density.
    #[inline]
    pub fn pdf(&self, tables: &[Table], at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        let Some(n) = facing(at, wo) else { return 0.0 };
        let cos = n.dot(wi);
        if cos <= 0.0 {
            return 0.0;
        }
        let h = (wo + wi).normalize_or(n);
        let local = frame(n, wo).transpose() * h;
        let half = self.table(tables).importance().pdf(n.dot(wo), local);
        let lobe = half / (4.0 * wo.dot(h)).max(1e-6);
        COSINE_SHARE * cos * std::f32::consts::FRAC_1_PI + (1.0 - COSINE_SHARE) * lobe
    }

    /// Samples a half vector from the importance tables, or a cosine-weighted direction.
    #[inline]
    pub fn sample(&self, tables: &[Table], at: &Surface, wo: Vec3A, stream: &mut Stream) -> Option<Sampled> {
        let n = facing(at, wo)?;
        let frame = frame(n, wo);
        let wi = if stream.uniform() < COSINE_SHARE {
            frame * warp::cosine_hemisphere(stream.uniform2())
        } else {
            let ([a, b], [c, d]) = (stream.uniform2(), stream.uniform2());
            let h = frame * self.table(tables).importance().sample(n.dot(wo), [a, b, c, d]);
            h * (2.0 * h.dot(wo)) - wo
        };
        let wi = wi.normalize();
        let value = self.eval(tables, at, wo, wi)?;
        let pdf = self.pdf(tables, at, wo, wi);
        (pdf > 0.0).then(|| Sampled {
            wi,
            scatter: value.scaled(Spectral::splat(pdf.recip())),
            delta: false,
            filling: None,
        })
    }
}
