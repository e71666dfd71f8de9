//! Defines a dense array in memory with named axes, such as a part of a stored slice or the result of a
//! probe.

use super::axes::{Axis, AxisKind};

/// Values over named axes in row-major order (the index of the last axis varies fastest).
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Name for titles and file names.
    pub name: String,
    /// Axes in storage order, or an empty list for a single number.
    pub axes: Vec<Axis>,
    /// Values. Their number is the product of the axes' lengths.
    pub data: Vec<f32>,
}

impl Tensor {
    /// Creates a tensor of zeros over the given axes.
    pub fn zeros(name: &str, axes: Vec<Axis>) -> Self {
        let n = axes.iter().map(|a| a.coords.len()).product();
        Self { name: name.to_owned(), axes, data: vec![0.0; n] }
    }

    /// Returns the length of every axis.
    pub fn shape(&self) -> Vec<usize> {
        self.axes.iter().map(|a| a.coords.len()).collect()
    }

    /// Returns the index of the axis of the given kind in `axes`, or `None` if the tensor has no such axis.
    pub fn find(&self, kind: AxisKind) -> Option<usize> {
        self.axes.iter().position(|a| a.kind == kind)
    }

    /// Returns the length of the axis of the given kind, or 1 if the tensor has no such axis.
    pub fn extent(&self, kind: AxisKind) -> usize {
        self.find(kind).map_or(1, |i| self.axes[i].coords.len())
    }

    /// Returns the value at the given indices. An axis that is not listed has index 0. A listed axis that
    /// the tensor lacks is ignored.
    ///
    /// # Panics
    /// Panics if an index is outside the range of its axis.
    pub fn at(&self, indices: &[(AxisKind, usize)]) -> f32 {
        let mut offset = 0;
        for axis in &self.axes {
            let i = indices.iter().find(|(k, _)| *k == axis.kind).map_or(0, |(_, i)| *i);
            assert!(i < axis.coords.len(), "index {i} is outside axis {}", axis.kind.name());
            offset = offset * axis.coords.len() + i;
        }
        self.data[offset]
    }

    /// Calls `f` for each value in order, with the value's index along every axis and the value's position
    /// in `data`.
    pub fn walk(&self, mut f: impl FnMut(&[usize], usize)) {
        let shape = self.shape();
        let mut index = vec![0; shape.len()];
        for place in 0..self.data.len() {
            f(&index, place);
            for axis in (0..shape.len()).rev() {
                index[axis] += 1;
                if index[axis] < shape[axis] {
                    break;
                }
                index[axis] = 0;
            }
        }
    }

    /// Returns three numbers: the product of the lengths of the axes before `axis`, the length of `axis`, and
    /// the product of the lengths of the axes after `axis`.
    fn strides(&self, axis: usize) -> (usize, usize, usize) {
        let shape = self.shape();
        (shape[..axis].iter().product(), shape[axis], shape[axis + 1..].iter().product())
    }

    /// Returns the sub-tensor at one index of an axis, without that axis. Returns a copy if the axis is
    /// absent.
    pub fn select(&self, kind: AxisKind, index: usize) -> Self {
        self.reduce(kind, |lane, inner, out, k| {
            out.copy_from_slice(&lane[index * inner..(index + 1) * inner]);
            debug_assert!(index < k);
        })
    }

    /// Returns the sum over an axis, accumulated in f64, without that axis. Returns a copy if the axis is
    /// absent.
    pub fn sum(&self, kind: AxisKind) -> Self {
        self.reduce(kind, |lane, inner, out, k| {
            for (j, o) in out.iter_mut().enumerate() {
                *o = (0..k).map(|i| f64::from(lane[i * inner + j])).sum::<f64>() as f32;
            }
        })
    }

    /// Removes an axis. Calls `f(lane, inner, out, length)` for every block along the axis. `lane` contains
    /// `length` runs of `inner` values. `f` writes one run to `out`.
    fn reduce(&self, kind: AxisKind, f: impl Fn(&[f32], usize, &mut [f32], usize)) -> Self {
        let Some(axis) = self.find(kind) else {
            return self.clone();
        };
        let (outer, k, inner) = self.strides(axis);
        let mut axes = self.axes.clone();
        axes.remove(axis);
        let mut data = vec![0.0; outer * inner];
        if inner > 0 {
            for (o, out) in data.chunks_exact_mut(inner).enumerate() {
                f(&self.data[o * k * inner..(o + 1) * k * inner], inner, out, k);
            }
        }
        Self { name: self.name.clone(), axes, data }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(kind: AxisKind, n: usize) -> Axis {
        Axis { kind, coords: (0..n).map(|i| i as f64).collect(), chunk: n as u64 }
    }

    #[test]
    fn select_and_sum_drop_their_axis() {
        let mut t =
            Tensor::zeros("t", vec![axis(AxisKind::Y, 2), axis(AxisKind::X, 3), axis(AxisKind::T, 4)]);
        t.data = (0..24).map(|i| i as f32).collect();
        assert_eq!(t.at(&[(AxisKind::Y, 1), (AxisKind::X, 2), (AxisKind::T, 3)]), 23.0);
        let mut seen = vec![];
        t.walk(|i, place| seen.push((i.to_vec(), place)));
        assert_eq!(seen.len(), 24);
        assert!(seen.iter().all(|(i, place)| 12 * i[0] + 4 * i[1] + i[2] == *place));
        assert!(seen.iter().enumerate().all(|(n, (_, place))| n == *place));
        let s = t.select(AxisKind::X, 1);
        assert_eq!(s.shape(), [2, 4]);
        assert_eq!(s.data, [4., 5., 6., 7., 16., 17., 18., 19.]);
        let s = t.sum(AxisKind::T);
        assert_eq!(s.data, [6., 22., 38., 54., 70., 86.]);
        assert_eq!(t.sum(AxisKind::V), t);
    }
}
