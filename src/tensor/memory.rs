//! Defines a sink that stores a render as arrays in memory, with the same values as a store on disk.

use crate::array::Tensor;
use crate::field::Field;
use crate::region;
use crate::sink::{Job, JobSlice, Piece, SampleCounts, Sink, Summary, TileRecord};
use std::convert::Infallible;
use std::sync::{Mutex, PoisonError};

/// Arrays of all fields of all slices of a render.
#[derive(Debug, Default)]
pub struct Arrays {
    slices: Vec<[Option<Mutex<Tensor>>; Field::ALL.len()]>,
    names: Vec<String>,
    samples: Mutex<Vec<u32>>,
    camera: [u32; 2],
}

impl Arrays {
    /// Returns the names of the slices, in order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Returns a copy of a field of a slice, row-major over the slice's axes, or `None` if the render does
    /// not have the field.
    pub fn get(&self, slice: &str, field: Field) -> Option<Tensor> {
        let at = self.names.iter().position(|n| n == slice)?;
        let array = self.slices[at][field as usize].as_ref()?;
        Some(array.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }

    /// Removes and returns a field of a slice without copying, or returns `None` if the field does not exist.
    pub fn take(&mut self, slice: &str, field: Field) -> Option<Tensor> {
        let at = self.names.iter().position(|n| n == slice)?;
        let array = self.slices[at][field as usize].take()?;
        Some(array.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Returns the number of valid samples per camera pixel, row-major.
    pub fn samples(&self) -> Vec<u32> {
        self.samples.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Sink for Arrays {
    type Error = Infallible;

    fn begin(&mut self, job: &Job) -> Result<Vec<TileRecord>, Infallible> {
        self.camera = job.camera;
        self.names = job.slices.iter().map(|s| s.layout.name.clone()).collect();
        self.samples = Mutex::new(vec![0; job.camera.iter().product::<u32>() as usize]);
        let fields = |slice: &JobSlice| {
            Field::ALL.map(|f| {
                let layout = f.layout_in(&slice.layout)?;
                Some(Mutex::new(Tensor::zeros(&layout.name, layout.axes)))
            })
        };
        self.slices = job.slices.iter().map(fields).collect();
        Ok(vec![])
    }

    fn put(&self, piece: &Piece) -> Result<(), Infallible> {
        let slice = self.slices.get(piece.slice);
        let Some(array) = slice.and_then(|fields| fields[piece.field as usize].as_ref()) else {
            return Ok(());
        };
        let mut array = array.lock().unwrap_or_else(PoisonError::into_inner);
        let whole: Vec<u64> = array.shape().iter().map(|n| *n as u64).collect();
        let zeros = vec![0; whole.len()];
        let source = region::Window { shape: piece.shape, at: &zeros };
        let target = region::Window { shape: &whole, at: piece.start };
        region::copy(piece.data, source, &mut array.data, target, piece.shape);
        Ok(())
    }

    fn put_samples(&self, s: &SampleCounts) -> Result<(), Infallible> {
        let mut samples = self.samples.lock().unwrap_or_else(PoisonError::into_inner);
        let whole = [self.camera[1], self.camera[0]].map(u64::from);
        let source = region::Window { shape: &s.shape, at: &[0, 0] };
        let target = region::Window { shape: &whole, at: &s.start };
        region::copy(s.counts, source, &mut samples, target, &s.shape);
        Ok(())
    }

    fn tile_done(&self, _: &TileRecord) -> Result<(), Infallible> {
        Ok(())
    }

    fn end(&mut self, _: &Summary) -> Result<(), Infallible> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axes::{Axis, AxisKind, SliceLayout};

    /// Returns a job for an image of 3 × 2 pixels with two time bins.
    fn job() -> Job {
        let axis = |kind, n: u32| Axis { kind, coords: (0..n).map(f64::from).collect(), chunk: 2 };
        let layout = SliceLayout {
            name: "s".into(),
            axes: vec![axis(AxisKind::Y, 2), axis(AxisKind::X, 3), axis(AxisKind::T, 2)],
            time: Some((-0.5, 1.0)),
            totals: false,
        };
        Job {
            slices: vec![JobSlice { layout, attributes: serde_json::Map::new() }],
            attributes: serde_json::Map::new(),
            camera: [3, 2],
            tile: 2,
        }
    }

    #[test]
    fn pieces_fill_boxes_and_the_rest_is_zero() {
        let mut arrays = Arrays::default();
        assert!(arrays.begin(&job()).unwrap().is_empty());
        let put = |slice, field, start: &[u64], shape: &[u64], data: &[f32]| {
            let touched = &[u64::MAX];
            let piece = Piece { slice, field, start, shape, data, touched };
            arrays.put(&piece).unwrap();
        };
        put(0, Field::Mean, &[0, 2, 0], &[2, 1, 2], &[1.0, 2.0, 3.0, 4.0]);
        put(0, Field::Overflow, &[1, 0], &[1, 2], &[5.0, 6.0]);
        put(7, Field::Mean, &[0], &[1], &[9.0]);
        let counts = SampleCounts { start: [1, 1], shape: [1, 2], counts: &[7, 8] };
        arrays.put_samples(&counts).unwrap();
        arrays.end(&Summary::default()).unwrap();
        assert_eq!(arrays.names(), ["s"]);
        assert_eq!(arrays.samples(), [0, 0, 0, 0, 7, 8]);
        let mean = arrays.get("s", Field::Mean).unwrap();
        assert_eq!(mean.data, [0., 0., 0., 0., 1., 2., 0., 0., 0., 0., 3., 4.]);
        assert_eq!(arrays.take("s", Field::Mean), Some(mean));
        assert_eq!(arrays.get("s", Field::Mean), None);
        let overflow = arrays.get("s", Field::Overflow).unwrap();
        assert_eq!(overflow.data, [0., 0., 0., 5., 6., 0.]);
        assert!(arrays.get("none", Field::Mean).is_none());
    }
}
