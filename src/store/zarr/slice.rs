//! Represents a stored slice: fields of f32 values over named axes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Map, Value};

use super::atomic::AtomicDirectory;
use super::check;
use super::chunked::ChunkedArray;
use super::describe;
use super::error::{AccessError, OpenError};
use super::partial::{self, Values};
use super::sharded::Region;
use tensor::array::Tensor;
use tensor::axes::{AxisKind, SliceLayout};
use tensor::field::Field;
use tensor::region;

/// An open slice. Cloning is cheap, and clones share locks, so several threads may write through clones.
#[derive(Clone)]
pub struct StoredSlice(Arc<Inner>);

struct Inner {
    path: PathBuf,
    layout: SliceLayout,
    attributes: Map<String, Value>,
    fields: [Option<(SliceLayout, ChunkedArray<f32>)>; Field::ALL.len()],
    values: Values,
}

impl std::fmt::Debug for StoredSlice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StoredSlice").field("path", &self.0.path).finish_non_exhaustive()
    }
}

impl StoredSlice {
    /// Opens and checks a slice of a store whose sample counts have shape `samples` (rows, columns).
    pub(super) fn open(
        storage: &Arc<AtomicDirectory>,
        name: &str,
        samples: Option<[u64; 2]>,
        values: Values,
    ) -> Result<Self, OpenError> {
        let path = storage.root.join(name);
        let group = path.join("zarr.json");
        let damaged = |reason: String| OpenError::Damaged { path: group.clone(), reason };
        let attributes = describe::attributes_of(&storage.json(&format!("{name}/zarr.json"))?)
            .ok_or_else(|| damaged("the attributes are not a JSON object".into()))?;
        let mean = ChunkedArray::<f32>::open(storage, &format!("/{name}/mean"))?;
        let layout = describe::read_layout(storage, name, &mean, &attributes)?;
        let fault = check::slice_fault(&attributes)
            .or_else(|| samples.and_then(|samples| check::camera_fault(&layout, samples)));
        if let Some(reason) = fault {
            return Err(damaged(reason));
        }
        let mut fields = [const { None }; Field::ALL.len()];
        for field in Field::ALL {
            let Some(expected) = field.layout_in(&layout) else {
                continue;
            };
            let array = ChunkedArray::<f32>::open(storage, &format!("/{name}/{}", field.name()))?;
            let names: Vec<&str> = expected.axes.iter().map(|a| a.kind.name()).collect();
            if array.shape() != expected.shape() || array.names() != names {
                let reason = format!(
                    "the array has dimensions {:?} with shape {:?}, expected {names:?} with shape {:?}",
                    array.names(),
                    array.shape(),
                    expected.shape()
                );
                return Err(OpenError::Damaged { path: array.path.clone(), reason });
            }
            fields[field as usize] = Some((expected, array));
        }
        Ok(Self(Arc::new(Inner { path, layout, attributes, fields, values })))
    }

    pub fn name(&self) -> &str {
        &self.0.layout.name
    }

    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Returns the axes of [`Field::Mean`] and [`Field::StdError`].
    pub fn layout(&self) -> &SliceLayout {
        &self.0.layout
    }

    /// Returns the attributes of the slice's group. They are the attributes given at creation and, if time is
    /// resolved, `time_start_ps` and `time_bin_ps`.
    pub fn attributes(&self) -> &Map<String, Value> {
        &self.0.attributes
    }

    /// Returns the attributes of the slice's group, in order, without the attributes that are derived from
    /// the layout.
    pub(crate) fn written_attributes(&self) -> Map<String, Value> {
        let mut attributes = self.0.attributes.clone();
        attributes.retain(|key, _| !["time_start_ps", "time_bin_ps"].contains(&key.as_str()));
        attributes
    }

    pub(super) fn field(&self, field: Field) -> Result<&(SliceLayout, ChunkedArray<f32>), AccessError> {
        self.0.fields[field as usize]
            .as_ref()
            .ok_or_else(|| AccessError::NoField { path: self.0.path.clone(), field: field.name() })
    }

    pub fn has(&self, field: Field) -> bool {
        self.0.fields[field as usize].is_some()
    }

    /// Returns the axes of a field.
    ///
    /// # Errors
    /// Returns an error if the slice does not have the field.
    pub fn field_layout(&self, field: Field) -> Result<&SliceLayout, AccessError> {
        Ok(&self.field(field)?.0)
    }

    /// Writes a region given as first index and shape. `data` is row-major. Several threads may write
    /// concurrently. Elements outside the region keep their values. Two *processes* must not write the same
    /// chunk. Chunks of zeros are not stored.
    ///
    /// # Errors
    /// Returns an error if the region is outside the field, or if the number of values differs from the
    /// number of elements of the region. Returns an error if a partially covered chunk is damaged, or if
    /// writing fails.
    pub fn write(&self, field: Field, start: &[u64], shape: &[u64], data: &[f32]) -> Result<(), AccessError> {
        self.field(field)?.1.write(start, shape, data, None)
    }

    /// Writes a region as [`Self::write`] does, for callers that know which parts of the data are zero.
    /// `touched` has one bit, lowest first, for every [`tensor::sink::STRETCH`] bytes of the data. A bit of 0
    /// means that the corresponding bytes are all zero.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::write`].
    pub fn write_touched(
        &self,
        field: Field,
        start: &[u64],
        shape: &[u64],
        data: &[f32],
        touched: &[u64],
    ) -> Result<(), AccessError> {
        self.field(field)?.1.write(start, shape, data, Some(touched))
    }

    /// Returns whether the chunk that begins at `start` has a file. A chunk of zeros has no file.
    ///
    /// # Errors
    /// Returns an error if the slice does not have the field.
    pub fn is_stored(&self, field: Field, start: &[u64]) -> Result<bool, AccessError> {
        Ok(self.field(field)?.1.is_stored(start))
    }

    /// Returns whether the manifest of a finished store lists the chunk that begins at `start`, even if the
    /// file was lost. For an unfinished store, returns whether the chunk has a file.
    ///
    /// # Errors
    /// Returns an error if the slice does not have the field.
    pub(crate) fn is_listed(&self, field: Field, start: &[u64]) -> Result<bool, AccessError> {
        Ok(self.field(field)?.1.is_listed(start))
    }

    /// Copies the file of the chunk that begins at `start` from the same slice of another store, and checks
    /// the file's checksum.
    ///
    /// # Errors
    /// Returns an error if the slice does not have the field, the chunk is damaged or lost, or writing fails.
    pub(crate) fn copy_chunk(&self, field: Field, start: &[u64], from: &Self) -> Result<(), AccessError> {
        self.field(field)?.1.copy(start, &from.field(field)?.1)
    }

    /// Fetches regions concurrently from a remote store, before the caller reads the regions one by one. All
    /// fields have the same layout. A region is given as first index and shape. Returns the number of fetched
    /// regions, at least one. After reading the fetched regions, the caller calls the function again for the
    /// remaining regions.
    ///
    /// # Errors
    /// Returns an error if the slice does not have a field, a region is outside the field, or an object store
    /// refuses a request.
    pub fn fetch_ahead(
        &self,
        fields: &[Field],
        regions: &[(Vec<u64>, Vec<u64>)],
    ) -> Result<usize, AccessError> {
        let of_region = |(start, shape): &(Vec<u64>, Vec<u64>)| {
            let of = |field: &Field| self.region(*field, start, shape);
            fields.iter().map(of).collect::<Result<Vec<_>, AccessError>>()
        };
        let regions = regions.iter().map(of_region);
        ChunkedArray::fetch_regions(&regions.collect::<Result<Vec<_>, _>>()?)
    }

    fn region(&self, field: Field, start: &[u64], shape: &[u64]) -> Result<Region<'_, f32>, AccessError> {
        Ok(Region { array: &self.field(field)?.1, start: start.to_vec(), shape: shape.to_vec() })
    }

    /// Fetches one region of each of several fields as [`Self::fetch_ahead`] does, with the same limits.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::fetch_ahead`].
    pub fn fetch_together(&self, regions: &[(Field, Vec<u64>, Vec<u64>)]) -> Result<(), AccessError> {
        let of = |(field, start, shape): &(Field, Vec<u64>, Vec<u64>)| self.region(*field, start, shape);
        let regions = regions.iter().map(of).collect::<Result<Vec<_>, AccessError>>()?;
        ChunkedArray::fetch_regions(&[regions]).map(drop)
    }

    /// Reads a region given as first index and shape, row-major.
    ///
    /// # Errors
    /// Returns an error if the region is outside the field, a chunk is damaged or lost, or the store is not
    /// finished.
    pub fn read(&self, field: Field, start: &[u64], shape: &[u64]) -> Result<Vec<f32>, AccessError> {
        let (layout, array) = self.field(field)?;
        if let Values::Unfinished(part) = self.0.values {
            return Err(AccessError::unfinished(&self.0.path, part));
        }
        let mut data = array.read(start, shape)?;
        if let Values::Sampled(samples) = &self.0.values {
            let single = self.0.attributes.get("pixels_per_element").and_then(Value::as_u64) == Some(1);
            partial::hide(samples.as_deref(), layout, single, start, shape, &mut data)?;
        }
        Ok(data)
    }

    /// Reads a whole field into memory.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::read`], and an error if the slice does not have the field.
    pub fn read_all(&self, field: Field) -> Result<Tensor, AccessError> {
        let layout = self.field_layout(field)?;
        let data = self.read(field, &vec![0; layout.axes.len()], &layout.shape())?;
        Ok(Tensor { name: layout.name.clone(), axes: layout.axes.clone(), data })
    }

    /// Returns the boxes (start, shape) of the chunks of a field, clipped to the array, in row-major order.
    ///
    /// # Errors
    /// Returns an error if the slice does not have the field.
    pub fn chunks(
        &self,
        field: Field,
    ) -> Result<impl Iterator<Item = (Vec<u64>, Vec<u64>)> + use<>, AccessError> {
        let array = &self.field(field)?.1;
        Ok(region::chunks(array.shape(), &array.chunk))
    }

    /// Returns the index of the axis of the given kind in [`Self::layout`], or `None` if the slice has no
    /// such axis.
    pub fn find(&self, kind: AxisKind) -> Option<usize> {
        self.0.layout.find(kind)
    }
}
