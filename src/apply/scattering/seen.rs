//! The slices, masks and ground truth of one variant of the tank.

use crate::error::ApplyError;
use crate::isolation::seen::within;
use crate::map::Map;
use crate::observation::{Observation, Pixels};

/// Name of the truth slice, which shows the same objects in clear water.
pub(super) const CLEAR: &str = "clear";
/// Name of the truth slice that shows the same objects in clear water, in bins of travel time.
pub(super) const CLEAR_IN_TIME: &str = "clear in time";

/// Slices and ground truth of a variant.
pub(super) struct Seen {
    pub variant: u64,
    /// Mueller matrices, summed over all projector pixels.
    pub polarimetric: Pixels,
    /// Mueller matrices, summed over the projector pixels on the epipolar line of each camera pixel.
    pub epipolar: Pixels,
    /// Mueller matrices of epipolar light as in `epipolar`, in bins of travel time.
    pub gated: Pixels,
    /// M00 summed over all projector pixels, in bins of travel time.
    pub transient: Pixels,
    /// The bin of travel time in which the pixel is brightest in clear water.
    pub arrival: Vec<usize>,
    /// The image without milk, with one channel per wavelength.
    pub truth: Map,
    /// Maximum value of the truth in the mask.
    pub peak: f64,
    /// Mask of the objects in the milk.
    pub mask: Vec<bool>,
    pub ruler: Vec<bool>,
    /// Position along the ruler as a fraction 0..1, measured from the near end.
    pub depth: Vec<f64>,
}

impl Seen {
    pub(super) fn new(o: &Observation) -> Result<Self, ApplyError> {
        let whole = |name: &str| within(o, name, |v| v[0] >= 1.0);
        let texture = o.truth("texture")?;
        let mut seen = Self {
            variant: o.variant,
            polarimetric: o.pixels("polarimetric", true)?,
            epipolar: o.pixels("epipolar", true)?,
            gated: o.pixels("gated", true)?,
            transient: o.pixels("transient", false)?,
            arrival: brightest_bins(&o.pixels(CLEAR_IN_TIME, false)?),
            truth: o.pixels(CLEAR, true)?.weighed(&[1.0]),
            peak: 0.0,
            mask: whole("inside")?,
            ruler: whole("ruler")?,
            depth: texture.data.iter().step_by(texture.channels.max(1)).copied().collect(),
        };
        let [n, lanes] = [seen.polarimetric.count(), seen.polarimetric.wavelengths];
        let slices = [&seen.epipolar, &seen.gated, &seen.transient];
        let equal = slices.iter().all(|p| p.count() == n && p.wavelengths == lanes)
            && seen.truth.width == seen.polarimetric.width
            && seen.truth.data.len() == n * lanes
            && [seen.mask.len(), seen.ruler.len(), seen.depth.len()] == [n; 3]
            && seen.arrival.len() == n;
        if !equal {
            return Err(o.sizes("slices and truth maps"));
        }
        let counted = seen.truth.data.chunks_exact(lanes.max(1)).zip(&seen.mask).filter(|(_, m)| **m);
        seen.peak = counted.flat_map(|(v, _)| v.iter().copied()).fold(0.0, f64::max);
        if seen.peak <= 0.0 {
            return Err(ApplyError::Empty(format!(
                "variant {}: no lit pixel shows an object in the tank; check the camera",
                o.variant
            )));
        }
        Ok(seen)
    }
}

/// Returns the bin with the largest sum of T00 over all wavelengths, for each pixel.
fn brightest_bins(p: &Pixels) -> Vec<usize> {
    let brightest =
        |pixel: usize| (0..p.bins).max_by(|a, b| p.light(pixel, *a).total_cmp(&p.light(pixel, *b)));
    (0..p.count()).map(|pixel| brightest(pixel).unwrap_or(0)).collect()
}

/// Returns the number of wavelengths. Checks that all variants have equal numbers of wavelengths and bins.
pub(super) fn wavelengths(train: &[Seen], test: &[Seen]) -> Result<usize, ApplyError> {
    let Some(first) = train.first() else {
        return Err(ApplyError::Empty("variants are missing; pass at least one variant for training".into()));
    };
    let shape = |s: &Seen| [s.polarimetric.wavelengths, s.gated.bins, s.transient.bins];
    match train.iter().chain(test).find(|s| shape(s) != shape(first)) {
        Some(other) => Err(ApplyError::Sizes { variant: other.variant, what: "wavelengths or bins".into() }),
        None => Ok(first.polarimetric.wavelengths),
    }
}
