//! Linear discriminants of several features of a pixel ([`crate::regression::discriminant`]).

use super::seen::{Scoring, Seen};
use crate::error::ApplyError;
use crate::regression::discriminant::Discriminant;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Features {
    /// T00 of all light and the logarithm of T00, per wavelength. The logarithm separates brightness from
    /// colour.
    Colour,
    /// The features of `Colour`, for epipolar light.
    EpipolarColour,
    /// The features of `Colour`, for all light and for epipolar light.
    Space,
    /// For all light, per wavelength: T00 and its logarithm, and the 15 other elements divided by T00.
    Polarization,
    /// The features of `Polarization`, for epipolar light.
    EpipolarPolarization,
    /// The features of `Polarization`, for all light and for epipolar light.
    SpacePolarization,
}

pub(super) struct Classifier {
    features: Features,
    direction: Discriminant,
}

impl Classifier {
    pub(super) fn learn(
        method: &'static str,
        features: Features,
        train: &[Seen],
    ) -> Result<Self, ApplyError> {
        let of = |pixels: fn(&Seen) -> &Vec<usize>| -> Vec<Vec<f64>> {
            train.iter().flat_map(|seen| pixels(seen).iter().map(|p| features.of(seen, *p))).collect()
        };
        let direction = Discriminant::new(&of(|s| &s.real), &of(|s| &s.fake));
        let direction = direction.ok_or_else(|| ApplyError::Unsolved {
            method,
            cause: "the training variants have too few pixels of real or fake fruit; render the variants at a higher resolution"
                .into(),
        })?;
        Ok(Self { features, direction })
    }
}

impl Scoring for Classifier {
    fn score(&self, seen: &Seen, pixel: usize) -> f64 {
        self.direction.score(&self.features.of(seen, pixel))
    }
}

/// Minimum T00 whose logarithm is computed, relative to the brightest pixel.
const DARK: f64 = 1e-6;

impl Features {
    fn of(self, seen: &Seen, pixel: usize) -> Vec<f64> {
        let (all, epipolar) = (&seen.polarimetric, &seen.epipolar);
        let slices = match self {
            Self::Colour | Self::Polarization => vec![all],
            Self::EpipolarColour | Self::EpipolarPolarization => vec![epipolar],
            Self::Space | Self::SpacePolarization => vec![all, epipolar],
        };
        let polarization =
            matches!(self, Self::Polarization | Self::EpipolarPolarization | Self::SpacePolarization);
        let mut out = vec![];
        for p in slices {
            for lane in 0..p.wavelengths {
                let all = p.at(pixel, 0, 0, lane);
                out.extend([all, all.max(DARK).ln()]);
                if polarization {
                    out.extend((1..16).map(|e| if all > 0.0 { p.at(pixel, 0, e, lane) / all } else { 0.0 }));
                }
            }
        }
        out
    }
}
