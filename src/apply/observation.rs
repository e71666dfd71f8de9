//! The data of one variant of a scene with one seed. The data contains slices with standard errors, and
//! ground-truth maps.

use crate::error::ApplyError;
use crate::map::Map;
use crate::pinhole::Rig;
use std::collections::BTreeMap;
use tensor::array::Tensor;
use tensor::axes::AxisKind;

#[derive(Clone, Debug, Default)]
pub struct Observation {
    pub variant: u64,
    pub seed: u64,
    /// Numeric scene parameters of the variant.
    pub values: BTreeMap<String, f64>,
    /// Text parameters of the variant.
    pub words: BTreeMap<String, String>,
    /// Calibrated camera and projector, or `None` for a scene without a projector.
    pub rig: Option<Rig>,
    pub slices: BTreeMap<String, Slice>,
    /// Ground-truth maps by name.
    pub truth: BTreeMap<String, Map>,
}

/// A slice of the tensor in W/(m² sr nm) per unit drive. Outgoing Stokes vectors are in the camera's frame,
/// and incoming Stokes vectors are in the projector's frame.
#[derive(Clone, Debug)]
pub struct Slice {
    pub mean: Tensor,
    /// Standard errors of `mean`, in the same unit.
    pub error: Tensor,
}

/// A slice as pixels with their Mueller matrices: `[pixel][bin][4 i + j][wavelength]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    pub width: usize,
    pub height: usize,
    /// Number of time bins, or 1 for a slice without a time axis.
    pub bins: usize,
    /// Number of matrix elements: 16, or 1 for intensities.
    pub elements: usize,
    pub wavelengths: usize,
    pub mean: Vec<f64>,
    /// Standard errors of `mean`.
    pub error: Vec<f64>,
}

impl Observation {
    /// Returns a slice.
    ///
    /// # Errors
    /// [`ApplyError::Missing`] if the observation does not contain the slice.
    pub fn slice(&self, name: &str) -> Result<&Slice, ApplyError> {
        self.slices.get(name).ok_or_else(|| self.missing("slice", name))
    }

    /// Returns a ground-truth map.
    ///
    /// # Errors
    /// [`ApplyError::Missing`] if the observation does not contain the map.
    pub fn truth(&self, name: &str) -> Result<&Map, ApplyError> {
        self.truth.get(name).ok_or_else(|| self.missing("truth map", name))
    }

    /// Returns a slice as pixels.
    ///
    /// # Errors
    /// [`ApplyError::Missing`] if the slice is missing. [`ApplyError::Axis`] if the slice has no camera rows
    /// and columns, or lacks the matrices that `mueller` requires. [`ApplyError::Sizes`] if the standard
    /// errors and the means have different shapes.
    pub fn pixels(&self, name: &str, mueller: bool) -> Result<Pixels, ApplyError> {
        let slice = self.slice(name)?;
        let axis = |axis| ApplyError::Axis { variant: self.variant, slice: name.to_owned(), axis };
        let t = &slice.mean;
        let at = |kind: AxisKind| t.find(kind);
        if at(AxisKind::Y).is_none() || at(AxisKind::X).is_none() {
            return Err(axis("rows and columns of the camera"));
        }
        let (out, inn) = (t.extent(AxisKind::StokesOut), t.extent(AxisKind::StokesIn));
        let elements = out * inn;
        if mueller && (out, inn) != (4, 4) || elements != 1 && elements != 16 {
            return Err(axis("whole Mueller matrices"));
        }
        if t.axes != slice.error.axes || t.data.len() != slice.error.data.len() {
            return Err(self.sizes(format!("means and errors of slice `{name}`")));
        }
        let mut pixels = Pixels {
            width: t.extent(AxisKind::X),
            height: t.extent(AxisKind::Y),
            bins: t.extent(AxisKind::T),
            elements,
            wavelengths: t.extent(AxisKind::Wavelength),
            mean: vec![],
            error: vec![],
        };
        let kept = pixels.len();
        if kept != t.data.len() {
            return Err(axis("only the camera, time, polarization and wavelength"));
        }
        (pixels.mean, pixels.error) = (vec![0.0; kept], vec![0.0; kept]);
        let kinds = [
            AxisKind::Y,
            AxisKind::X,
            AxisKind::T,
            AxisKind::StokesOut,
            AxisKind::StokesIn,
            AxisKind::Wavelength,
        ];
        let axes = kinds.map(at);
        t.walk(|index, from| {
            let [y, x, bin, i, j, lane] = axes.map(|axis| axis.map_or(0, |a| index[a]));
            let place = pixels.place(y * pixels.width + x, bin, i * inn + j, lane);
            pixels.mean[place] = f64::from(t.data[from]);
            pixels.error[place] = f64::from(slice.error.data[from]);
        });
        Ok(pixels)
    }

    /// Returns the calibrated camera and projector, or an error if the scene has no calibration.
    pub(crate) fn rig(&self) -> Result<&Rig, ApplyError> {
        self.rig.as_ref().ok_or_else(|| self.missing("calibrated rig", "camera and projector"))
    }

    /// Returns a numeric scene parameter.
    pub(crate) fn value(&self, name: &str) -> Result<f64, ApplyError> {
        self.values.get(name).copied().ok_or_else(|| self.missing("value of the parameter", name))
    }

    pub(crate) fn missing(&self, what: &'static str, name: &str) -> ApplyError {
        ApplyError::Missing { variant: self.variant, what, name: name.to_owned() }
    }

    pub(crate) fn sizes(&self, what: impl Into<String>) -> ApplyError {
        ApplyError::Sizes { variant: self.variant, what: what.into() }
    }

    /// Returns the error for a variant in which no pixel shows only the material or object `what`.
    pub(crate) fn no_pixel(&self, what: &str) -> ApplyError {
        let variant = self.variant;
        let cause = format!("variant {variant} has no pixel that shows {what}");
        ApplyError::Empty(cause + "; render the variant at a higher resolution")
    }
}

/// Converts the training and the test variants with `see`.
///
/// # Errors
/// The errors of `see`, and [`ApplyError::Empty`] if there are no training or no test variants.
pub fn seen<S>(
    train: &[Observation],
    test: &[Observation],
    see: impl Fn(&Observation) -> Result<S, ApplyError>,
) -> Result<[Vec<S>; 2], ApplyError> {
    let all = |of: &[Observation]| of.iter().map(&see).collect::<Result<Vec<_>, _>>();
    let both = [all(train)?, all(test)?];
    if let Some(i) = both.iter().position(Vec::is_empty) {
        return Err(ApplyError::Empty(format!(
            "there are no variants for {}; pass at least one variant for training and one for testing",
            ["training", "testing"][i]
        )));
    }
    Ok(both)
}

impl Pixels {
    fn len(&self) -> usize {
        self.width * self.height * self.bins * self.elements * self.wavelengths
    }

    fn place(&self, pixel: usize, bin: usize, element: usize, lane: usize) -> usize {
        ((pixel * self.bins + bin) * self.elements + element) * self.wavelengths + lane
    }

    /// Returns the mean of element 4 i + j at a given pixel, bin and wavelength.
    pub fn at(&self, pixel: usize, bin: usize, element: usize, lane: usize) -> f64 {
        self.mean[self.place(pixel, bin, element, lane)]
    }

    /// Returns the standard error of [`Self::at`].
    pub fn error_at(&self, pixel: usize, bin: usize, element: usize, lane: usize) -> f64 {
        self.error[self.place(pixel, bin, element, lane)]
    }

    /// Returns (0,0) of a bin, summed over wavelengths.
    pub fn light(&self, pixel: usize, bin: usize) -> f64 {
        (0..self.wavelengths).map(|lane| self.at(pixel, bin, 0, lane)).sum()
    }

    pub fn count(&self) -> usize {
        self.width * self.height
    }

    /// Returns the means, weighted by element (`weights[element]`) and summed over bins and elements. The
    /// map has one channel per wavelength.
    pub fn weighed(&self, weights: &[f64]) -> Map {
        Map::from_fn(self.width, self.height, self.wavelengths, |x, y, out| {
            let pixel = y * self.width + x;
            for (lane, o) in out.iter_mut().enumerate() {
                *o = (0..self.bins)
                    .flat_map(|bin| weights.iter().enumerate().map(move |(e, w)| (bin, e, w)))
                    .map(|(bin, e, w)| w * self.at(pixel, bin, e, lane))
                    .sum();
            }
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::application::Run;
    use tensor::axes::Axis;

    /// Returns a tensor of zeros with axes of these lengths. Coordinates are counted from 0.
    pub(crate) fn zeros(name: &str, axes: impl IntoIterator<Item = (AxisKind, usize)>) -> Tensor {
        let coords = |n: usize| (0..n).map(|i| i as f64).collect();
        let axes = axes.into_iter().map(|(kind, n)| Axis { kind, coords: coords(n), chunk: n as u64 });
        Tensor::zeros(name, axes.collect())
    }

    /// Runs an application on an observation that `change` has modified, and returns the error of the run.
    pub(crate) fn failed(run: Run, whole: &Observation, change: &dyn Fn(&mut Observation)) -> ApplyError {
        let mut o = whole.clone();
        change(&mut o);
        run(std::slice::from_ref(&o), std::slice::from_ref(&o)).expect_err("it lacks something")
    }

    /// Returns a slice of matrices from a function of pixel, bin, element and wavelength. All standard errors
    /// are `error`.
    pub(crate) fn slice(
        [width, height, bins, wavelengths]: [usize; 4],
        error: f64,
        mut value: impl FnMut(usize, usize, usize, usize) -> f64,
    ) -> Slice {
        let times = (bins > 1).then_some((AxisKind::T, bins));
        let matrix = [(AxisKind::StokesOut, 4), (AxisKind::StokesIn, 4), (AxisKind::Wavelength, wavelengths)];
        let pixels = [(AxisKind::Y, height), (AxisKind::X, width)];
        let mut mean = zeros("s", pixels.into_iter().chain(times).chain(matrix));
        let mut error_of = mean.clone();
        for (i, v) in mean.data.iter_mut().enumerate() {
            let (lane, rest) = (i % wavelengths, i / wavelengths);
            *v = value(rest / 16 / bins, rest / 16 % bins, rest % 16, lane) as f32;
        }
        error_of.data.fill(error as f32);
        Slice { mean, error: error_of }
    }

    #[test]
    fn pixels_equal_the_slice() {
        let number = |p, b, e, k| (1000 * p + 100 * b + 4 * e + k) as f64;
        let mut o = Observation::default();
        o.slices.insert("s".into(), slice([3, 2, 5, 3], 0.5, number));
        let pixels = o.pixels("s", true).expect("pixels");
        for (p, b, e, k) in [(0, 0, 0, 0), (5, 4, 15, 2), (2, 3, 7, 1)] {
            assert_eq!(pixels.at(p, b, e, k), number(p, b, e, k));
            assert_eq!(pixels.error_at(p, b, e, k), 0.5);
        }
        let mut weights = [0.0; 16];
        weights[5] = 2.0;
        let sum: f64 = (0..5).map(|b| 2.0 * number(4, b, 5, 1)).sum();
        assert_eq!(pixels.weighed(&weights).at(1, 1)[1], sum);
        assert!(matches!(o.pixels("t", true), Err(ApplyError::Missing { .. })));
        let s = o.slices.get_mut("s").expect("it");
        (s.mean, s.error) = (s.mean.select(AxisKind::StokesIn, 0), s.error.select(AxisKind::StokesIn, 0));
        assert!(matches!(o.pixels("s", true), Err(ApplyError::Axis { .. })));
    }
}
