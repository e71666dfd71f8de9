//! Reduces a tensor to the axes of an image. One pass selects, sums and checks the values.

use super::error::FigureError;
use base::spectral_table;
use tensor::array::Tensor;
use tensor::axes::AxisKind;

/// A valid tensor. The values fill the axes. No axis is empty or occurs twice.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// Name of the slice for messages.
    pub slice: &'a str,
    pub tensor: &'a Tensor,
}

/// Sums of a tensor over all axes except the kept axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Reduced {
    /// Sums, row-major over the kept axes in the requested order.
    pub data: Vec<f32>,
    /// Lengths of the kept axes. The length is 1 for axes that the tensor does not have.
    pub shape: Vec<usize>,
}

impl<'a> Source<'a> {
    pub fn new(slice: &'a str, tensor: &'a Tensor) -> Result<Self, FigureError> {
        if let Some(axis) = tensor.axes.iter().find(|a| a.coords.is_empty()) {
            return Err(FigureError::nothing(slice, axis.kind.name()));
        }
        let size = tensor.axes.iter().try_fold(1_usize, |n, a| n.checked_mul(a.coords.len()));
        let twice = tensor.axes.iter().any(|a| tensor.axes.iter().filter(|b| a.kind == b.kind).count() > 1);
        if size != Some(tensor.data.len()) || twice {
            let axes: Vec<String> =
                tensor.axes.iter().map(|a| format!("{} {}", a.coords.len(), a.kind.name())).collect();
            return Err(FigureError::Damaged {
                slice: slice.to_owned(),
                found: tensor.data.len(),
                axes: axes.join(" × "),
            });
        }
        Ok(Self { slice, tensor })
    }

    /// Returns the coordinates of a required axis.
    pub fn need(&self, kind: AxisKind) -> Result<&'a [f64], FigureError> {
        self.coords(kind).ok_or_else(|| {
            let (axis, fix) = match kind {
                AxisKind::T => ("time", "time = { start_ps = …, bin_ps = …, bins = … }"),
                AxisKind::U => ("projector column", "projector = \"all\""),
                AxisKind::V => ("projector row", "projector = \"all\""),
                AxisKind::StokesOut | AxisKind::StokesIn => ("Stokes", "polarization = \"mueller\""),
                AxisKind::Y => ("camera row", "camera = \"all\""),
                AxisKind::X => ("camera column", "camera = \"all\""),
                AxisKind::Bounces => ("bounces", "bounces = true"),
                AxisKind::Component => ("component", "split_first_bounce = true"),
                AxisKind::Label => ("label", "labels = true"),
                AxisKind::Wavelength => ("wavelength", "wavelengths_nm = […]"),
            };
            FigureError::MissingAxis { slice: self.slice.to_owned(), axis, fix }
        })
    }

    /// Returns the coordinates of an axis, or `None` if the tensor does not have the axis.
    pub fn coords(&self, kind: AxisKind) -> Option<&'a [f64]> {
        self.tensor.find(kind).map(|i| self.tensor.axes[i].coords.as_slice())
    }

    /// Returns the wavelengths in nanometres. The list is empty if the tensor has no wavelength axis.
    pub fn wavelengths(&self) -> &'a [f64] {
        self.coords(AxisKind::Wavelength).unwrap_or(&[])
    }

    /// Returns the index of the wavelength `nm`, in nanometres, within [`spectral_table::SAME_NM`]. If `nm` is
    /// `None`, returns the index of the middle wavelength.
    pub fn wavelength(&self, nm: Option<f64>) -> Result<usize, FigureError> {
        let all = self.wavelengths();
        match nm {
            // A tensor without a wavelength axis applies to all wavelengths.
            Some(nm) if !all.is_empty() => {
                spectral_table::entry(all, nm).ok_or_else(|| FigureError::wavelength(self.slice, nm, all))
            }
            _ => Ok(all.len() / 2),
        }
    }

    /// Returns the axes and indices that select a Mueller element. For M00, the Stokes axes may be absent.
    pub fn element(&self, [out, inn]: [usize; 2]) -> Result<[(AxisKind, usize); 2], FigureError> {
        for (kind, i) in [(AxisKind::StokesOut, out), (AxisKind::StokesIn, inn)] {
            if i > 0 || self.coords(kind).is_some() {
                self.index("Stokes elements", i, self.need(kind)?.len())?;
            }
        }
        Ok([(AxisKind::StokesOut, out), (AxisKind::StokesIn, inn)])
    }

    pub fn index(&self, what: &'static str, index: usize, len: usize) -> Result<usize, FigureError> {
        if index < len {
            return Ok(index);
        }
        Err(FigureError::Index { slice: self.slice.to_owned(), what, index, len })
    }

    /// Sums `f(value)` in f64 over every axis that is not in `keep` or `pick`.
    ///
    /// The indices in `pick` must exist ([`Self::index`] checks an index). Axes that the tensor does not have
    /// are ignored.
    pub fn sum(&self, keep: &[AxisKind], pick: &[(AxisKind, usize)], f: impl Fn(f32) -> f64) -> Reduced {
        let shape: Vec<usize> = keep.iter().map(|&k| self.tensor.extent(k)).collect();
        let mut out = vec![0.0_f64; shape.iter().product()];
        // For each axis of the tensor, the number of steps, the stride in the source and the stride in the
        // target.
        let lengths = self.tensor.shape();
        let mut steps: Vec<(usize, usize, usize)> = Vec::with_capacity(lengths.len());
        let mut first = 0;
        for (i, axis) in self.tensor.axes.iter().enumerate() {
            let stride: usize = lengths[i + 1..].iter().product();
            if let Some(&(_, at)) = pick.iter().find(|p| p.0 == axis.kind) {
                first += at * stride;
            } else {
                let target =
                    keep.iter().position(|&k| k == axis.kind).map_or(0, |k| shape[k + 1..].iter().product());
                steps.push((lengths[i], stride, target));
            }
        }
        add(&mut out, &self.tensor.data, &steps, (first, 0), &f);
        Reduced { data: out.into_iter().map(|v| v as f32).collect(), shape }
    }
}

/// Adds `f(value)` of all values along the remaining axes to the target. The function is recursive and begins
/// at a source offset and a target offset.
fn add(
    out: &mut [f64],
    data: &[f32],
    steps: &[(usize, usize, usize)],
    (from, to): (usize, usize),
    f: &impl Fn(f32) -> f64,
) {
    match *steps {
        [] => out[to] += f(data[from]),
        [(len, stride, target)] => {
            for i in 0..len {
                out[to + i * target] += f(data[from + i * stride]);
            }
        }
        [(len, stride, target), ref inner @ ..] => {
            for i in 0..len {
                add(out, data, inner, (from + i * stride, to + i * target), f);
            }
        }
    }
}

/// Returns the values at the outer edges of the first and last entries of a uniform axis. Returns `None` if
/// the entries are not evenly spaced.
pub fn ruler(coords: &[f64]) -> Option<(f64, f64)> {
    let (&first, &last) = (coords.first()?, coords.last()?);
    let step = if coords.len() > 1 { (last - first) / (coords.len() - 1) as f64 } else { 1.0 };
    let even =
        coords.iter().enumerate().all(|(i, c)| (c - (first + i as f64 * step)).abs() <= 1e-3 * step.abs());
    (step.is_finite() && step > 0.0 && even).then_some((first - step / 2.0, last + step / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tensor::axes::Axis;

    fn tensor(axes: &[(AxisKind, usize)]) -> Tensor {
        let axes = axes
            .iter()
            .map(|&(kind, n)| Axis { kind, coords: (0..n).map(|i| i as f64).collect(), chunk: 1 })
            .collect();
        let mut t = Tensor::zeros("t", axes);
        t.data.iter_mut().enumerate().for_each(|(i, v)| *v = i as f32);
        t
    }

    #[test]
    fn one_pass_equals_select_and_sum() {
        let t = tensor(&[
            (AxisKind::Y, 3),
            (AxisKind::X, 4),
            (AxisKind::U, 2),
            (AxisKind::T, 5),
            (AxisKind::StokesOut, 4),
            (AxisKind::StokesIn, 4),
            (AxisKind::Wavelength, 3),
        ]);
        let s = Source::new("t", &t).unwrap();
        let picks =
            [(AxisKind::StokesOut, 1), (AxisKind::StokesIn, 2), (AxisKind::Y, 2), (AxisKind::Wavelength, 1)];
        let got = s.sum(&[AxisKind::T, AxisKind::X, AxisKind::Component], &picks, f64::from);
        assert_eq!(got.shape, [5, 4, 1]);
        let picked = picks.iter().fold(t.clone(), |t, &(kind, i)| t.select(kind, i));
        let want = picked.sum(AxisKind::U);
        for x in 0..4 {
            for k in 0..5 {
                assert_eq!(got.data[k * 4 + x], want.at(&[(AxisKind::X, x), (AxisKind::T, k)]));
            }
        }
    }

    #[test]
    fn a_single_number_is_a_tensor() {
        let mut t = Tensor::zeros("one", vec![]);
        t.data[0] = 7.0;
        let s = Source::new("one", &t).unwrap();
        assert_eq!(s.sum(&[AxisKind::Y], &[], f64::from), Reduced { data: vec![7.0], shape: vec![1] });
    }

    #[test]
    fn rulers_need_evenly_spaced_axes() {
        assert_eq!(ruler(&[0.0, 1.0, 2.0]), Some((-0.5, 2.5)));
        assert_eq!(ruler(&[12.5]), Some((12.0, 13.0)));
        assert_eq!(ruler(&[0.0, 1.0, 5.0]), None);
        assert_eq!(ruler(&[f64::NAN]), None);
        assert_eq!(ruler(&[]), None);
    }
}
