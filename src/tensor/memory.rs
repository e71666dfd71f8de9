//! Arrays in memory as a sink of renders.

use crate::array::Tensor;
use crate::field::Field;
use crate::region;
use crate::sink::{Job, Piece, SampleCounts, Sink, Summary, TileRecord};
use std::convert::Infallible;
use std::sync::{Mutex, PoisonError};

/// Keeps every field of every slice of a render as an array.
#[derive(Debug, Default)]
pub struct Arrays {
    slices: Vec<[Option<Mutex<Tensor>>; 4]>,
    names: Vec<String>,
    samples: Mutex<Vec<u32>>,
    camera: [u32; 2],
}

impl Arrays {
    /// Names of the slices, in order.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// A field of a slice by its name (shape: the slice's axes, row-major), if the render has it.
    #[must_use]
    pub fn get(&self, slice: &str, field: Field) -> Option<Tensor> {
        let at = self.names.iter().position(|n| n == slice)?;
        let array = self.slices[at][field as usize].as_ref()?;
        Some(array.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }

    /// [`Self::get`] without a copy: the array leaves.
    #[must_use]
    pub fn take(&mut self, slice: &str, field: Field) -> Option<Tensor> {
        let at = self.names.iter().position(|n| n == slice)?;
        let array = self.slices[at][field as usize].take()?;
        Some(array.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// How many samples of each camera pixel count, row by row.
    #[must_use]
    pub fn samples(&self) -> Vec<u32> {
        self.samples
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}

impl Sink for Arrays {
    type Error = Infallible;

    fn begin(&mut self, job: &Job) -> Result<Vec<TileRecord>, Infallible> {
        self.camera = job.camera;
        self.names = job.slices.iter().map(|s| s.layout.name.clone()).collect();
        self.samples = Mutex::new(vec![0; job.camera.iter().product::<u32>() as usize]);
        let fields = |slice: &crate::sink::JobSlice| {
            Field::ALL.map(|f| {
                let layout = f.layout_in(&slice.layout)?;
                Some(Mutex::new(Tensor::zeros(&layout.name, layout.axes)))
            })
        };
        self.slices = job.slices.iter().map(fields).collect();
        Ok(vec![])
    }

    fn put(&self, piece: &Piece) -> Result<(), Infallible> {
        let Some(array) = &self.slices[piece.slice][piece.field as usize] else {
            return Ok(());
        };
        let mut array = array.lock().unwrap_or_else(PoisonError::into_inner);
        let whole: Vec<u64> = array.shape().iter().map(|n| *n as u64).collect();
        let zeros = vec![0; whole.len()];
        let source = region::Place {
            shape: piece.shape,
            at: &zeros,
        };
        let target = region::Place {
            shape: &whole,
            at: piece.start,
        };
        region::copy(piece.data, source, &mut array.data, target, piece.shape);
        Ok(())
    }

    fn put_samples(&self, s: &SampleCounts) -> Result<(), Infallible> {
        let mut samples = self.samples.lock().unwrap_or_else(PoisonError::into_inner);
        let whole = [self.camera[1], self.camera[0]].map(u64::from);
        let source = region::Place {
            shape: &s.shape,
            at: &[0, 0],
        };
        let target = region::Place {
            shape: &whole,
            at: &s.start,
        };
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
