//! Stores raw frames on disk. Raw frames are unmodified digital numbers of a sensor, in a Zarr v3 store with
//! named axes.
//!
//! The group `frames` contains:
//! - The array `raw`, with unsigned integers over the run's axes and the frame's axes.
//! - A coordinate array for every axis.
//! - Columns with one number per frame, such as measured positions or exposure times.
//!
//! A chunk is one frame, or, for small frames, all frames along the last of the run's axes. The bytes of a
//! chunk depend only on its numbers. The manifest is written last, as for slices, so readers do not mistake
//! an unfinished store for a finished one.

use std::path::Path;
use std::sync::Arc;

use base::lock::Lock;
use base::staging;
use serde_json::{Map, Value, json};

use super::atomic::AtomicDirectory;
use super::chunked::{ChunkedArray, Description};
use super::describe;
use super::description;
use super::error::{AccessError, CreateError, OpenError};
use super::manifest::{self, Manifest};
use tensor::region;

/// Name of the group that contains the frames.
const GROUP: &str = "frames";

#[derive(Clone, Debug, PartialEq)]
pub struct FrameAxis {
    /// Name of the axis, which consists of letters, digits and `_`.
    pub name: String,
    /// Unit of the coordinates (UDUNITS), or `1` for dimensionless numbers.
    pub units: String,
    /// Coordinate of each entry of the axis.
    pub coords: Vec<f64>,
}

/// A map with one number for each element of a frame. The map applies to all frames.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameMap {
    /// Name of the map, which consists of letters, digits and `_`.
    pub name: String,
    /// Unit of the numbers (UDUNITS), or `1` for dimensionless numbers.
    pub units: String,
    /// The numbers of the map, row-major.
    pub values: Vec<f64>,
}

/// The type of a frame's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameNumber {
    /// Unsigned integers of 16 bits, for cameras.
    U16,
    /// Unsigned integers of 32 bits, for photon counts.
    U32,
}

/// The axes and the number type of a store of frames.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameLayout {
    /// The axes of the run, followed by the axes of a frame.
    pub axes: Vec<FrameAxis>,
    pub run_axes: usize,
    /// Whether a chunk contains all frames along the last of the run's axes.
    pub gathered: bool,
    pub number: FrameNumber,
}

impl FrameLayout {
    /// Returns the lengths of all axes, in the order of [`Self::axes`].
    pub fn shape(&self) -> Vec<u64> {
        self.axes.iter().map(|a| a.coords.len() as u64).collect()
    }

    fn chunk(&self) -> Vec<u64> {
        let whole = self.run_axes - usize::from(self.gathered && self.run_axes > 0);
        let of = |(i, n): (usize, u64)| if i < whole { 1 } else { n };
        self.shape().into_iter().enumerate().map(of).collect()
    }

    pub fn frames(&self) -> usize {
        self.shape()[..self.run_axes].iter().product::<u64>() as usize
    }

    pub fn frames_per_chunk(&self) -> usize {
        self.chunk()[..self.run_axes].iter().product::<u64>() as usize
    }

    pub fn frame_len(&self) -> usize {
        self.shape()[self.run_axes..].iter().product::<u64>() as usize
    }
}

enum Raw {
    U16(ChunkedArray<u16>),
    U32(ChunkedArray<u32>),
}

impl Raw {
    fn over(&self) -> (&[u64], &[u64], Vec<String>, &Path) {
        match self {
            Self::U16(a) => (a.shape(), &a.chunk, a.names(), &a.path),
            Self::U32(a) => (a.shape(), &a.chunk, a.names(), &a.path),
        }
    }
}

pub struct FrameStore {
    storage: Arc<AtomicDirectory>,
    layout: FrameLayout,
    attributes: Map<String, Value>,
    raw: Raw,
    _lock: Option<Lock>,
}

impl FrameStore {
    /// Creates a store without frames. If `replace` is true, an existing store is replaced. The store is
    /// created atomically, including its maps. The store is locked against other writers until the returned
    /// value is dropped.
    ///
    /// # Errors
    /// Returns an error if the path exists, another process writes the store, or writing fails. Returns an
    /// error if the size of a map differs from the size of a frame.
    pub fn create(
        path: &Path,
        layout: &FrameLayout,
        maps: &[FrameMap],
        attributes: &Map<String, Value>,
        replace: bool,
    ) -> Result<Self, CreateError> {
        super::refuse_within(path)?;
        let lock = Lock::take(path).map_err(|e| CreateError::locked(path, e))?;
        let failed = |cause: String| CreateError::Write { path: path.to_owned(), cause };
        let io = |e: std::io::Error| failed(e.to_string());
        staging::recover(path).map_err(io)?;
        if std::fs::symlink_metadata(path).is_ok() {
            if !replace {
                return Err(CreateError::Exists { path: path.into() });
            }
            if !super::is_store(path) {
                return Err(CreateError::NotAStore { path: path.into() });
            }
        }
        // A killed process leaves either a complete store without frames or no store.
        let part = staging::part_of(path);
        staging::remove(&part).map_err(io)?;
        Self::lay_out(&part, layout, maps, attributes)
            .and_then(|()| staging::put(&part, path).map_err(io))
            .inspect_err(|_| {
            let _ = staging::remove(&part);
        })?;
        Self::over(AtomicDirectory::new(path), Some(lock)).map_err(|e| failed(e.to_string()))
    }

    /// Writes the metadata of a store without frames into a new folder.
    fn lay_out(
        path: &Path,
        layout: &FrameLayout,
        maps: &[FrameMap],
        attributes: &Map<String, Value>,
    ) -> Result<(), CreateError> {
        let failed = |e| CreateError::write(path, e);
        let storage = Arc::new(AtomicDirectory::new(path));
        describe::create_root(path, &[], attributes)?;
        let group =
            json!({"zarr_format": 3, "node_type": "group", "attributes": {"run_axes": layout.run_axes}});
        description::write_json(&path.join(GROUP).join("zarr.json"), &group)?;
        for axis in &layout.axes {
            let shape = [axis.coords.len() as u64];
            column(&storage, &axis.name, &[&axis.name], &axis.units, &shape, &axis.coords).map_err(failed)?;
        }
        let of_frame = &layout.axes[layout.run_axes..];
        let names: Vec<&str> = of_frame.iter().map(|a| a.name.as_str()).collect();
        let shape = &layout.shape()[layout.run_axes..];
        for map in maps {
            column(&storage, &map.name, &names, &map.units, shape, &map.values).map_err(failed)?;
        }
        let description = Description {
            shape: layout.shape(),
            chunk: layout.chunk(),
            names: layout.axes.iter().map(|a| a.name.as_str()).collect(),
            attributes: Map::from_iter([(
                "long_name".to_owned(),
                json!("digital numbers as the sensor gave them"),
            )]),
            sharding: None,
        };
        let node = format!("/{GROUP}/raw");
        match layout.number {
            FrameNumber::U16 => drop(ChunkedArray::<u16>::create(&storage, &node, description)?),
            FrameNumber::U32 => drop(ChunkedArray::<u32>::create(&storage, &node, description)?),
        }
        Ok(())
    }

    /// Opens a finished store for reading.
    ///
    /// # Errors
    /// Returns an error if the store does not exist, is damaged, or is not finished.
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        let Some(manifest) = Manifest::read(path)? else {
            if !is_frames(path) {
                return Err(not_frames(path));
            }
            return Err(OpenError::Unfinished { path: path.into() });
        };
        Self::over(AtomicDirectory::finished(path, manifest), None)
    }

    /// Opens an unfinished store for writing.
    ///
    /// # Errors
    /// Returns an error if the store does not exist, is damaged, or is being written by another process.
    pub fn open_for_write(path: &Path) -> Result<Self, OpenError> {
        if !path.exists() {
            return Err(OpenError::Missing { path: path.into() });
        }
        let lock = Lock::take(path).map_err(|e| OpenError::locked(path, e))?;
        Self::over(AtomicDirectory::new(path), Some(lock))
    }

    fn over(storage: AtomicDirectory, lock: Option<Lock>) -> Result<Self, OpenError> {
        let storage = Arc::new(storage);
        let path = &storage.root;
        if !is_frames(path) {
            return Err(not_frames(path));
        }
        let root = description::read_json(&path.join("zarr.json"))?;
        let mut attributes = describe::attributes_of(&root).unwrap_or_default();
        attributes.remove("slices");
        let group = description::read_json(&path.join(GROUP).join("zarr.json"))?;
        let node = format!("/{GROUP}/raw");
        let (raw, number) = match ChunkedArray::<u16>::open(&storage, &node) {
            Ok(array) => (Raw::U16(array), FrameNumber::U16),
            Err(_) => (Raw::U32(ChunkedArray::open(&storage, &node)?), FrameNumber::U32),
        };
        let (shape, chunk, names, place) = raw.over();
        let damaged = |reason: &str| OpenError::Damaged { path: place.to_owned(), reason: reason.into() };
        let run_axes = group["attributes"]["run_axes"].as_u64().unwrap_or(u64::MAX) as usize;
        if run_axes > shape.len() {
            let (found, most) = (&group["attributes"]["run_axes"], shape.len());
            return Err(damaged(&format!(
                "`run_axes` is {found}, expected at most {most}, the number of axes"
            )));
        }
        let mut axes = vec![];
        for (name, n) in names.iter().zip(shape) {
            if describe::name_fault(name).is_some() {
                return Err(damaged(&format!("{name:?} is not a valid name of an axis")));
            }
            let array = ChunkedArray::<f64>::open(&storage, &format!("/{GROUP}/{name}"))?;
            if array.shape() != [*n] {
                let found = array.shape();
                return Err(damaged(&format!(
                    "the coordinates of axis `{name}` have shape {found:?}, expected [{n}]"
                )));
            }
            let json = description::read_json(&array.path.join("zarr.json"))?;
            axes.push(FrameAxis {
                name: name.clone(),
                units: json["attributes"]["units"].as_str().unwrap_or("1").to_owned(),
                coords: array.read(&[0], &[*n]).map_err(|e| damaged(&e.to_string()))?,
            });
        }
        let mut layout = FrameLayout { axes, run_axes, gathered: false, number };
        if layout.chunk() != chunk {
            layout.gathered = true;
        }
        if layout.chunk() != chunk || layout.axes.len() != shape.len() {
            return Err(damaged("the chunks of the frames do not contain whole frames"));
        }
        drop(group);
        Ok(Self { layout, attributes, raw, _lock: lock, storage })
    }

    /// Returns the axes and the number type of the store.
    pub fn layout(&self) -> &FrameLayout {
        &self.layout
    }

    /// Returns the attributes of the root group.
    pub fn attributes(&self) -> &Map<String, Value> {
        &self.attributes
    }

    pub fn path(&self) -> &Path {
        &self.storage.root
    }

    /// Returns the start and the shape of chunk number `chunk`. Chunks are numbered in the order in which the
    /// run captures them.
    fn place(&self, chunk: usize) -> (Vec<u64>, Vec<u64>) {
        let (shape, size) = (self.layout.shape(), self.layout.chunk());
        let mut start = vec![0; shape.len()];
        let mut left = (chunk * self.layout.frames_per_chunk()) as u64;
        for axis in (0..self.layout.run_axes).rev() {
            start[axis] = left % shape[axis];
            left /= shape[axis];
        }
        (start, size)
    }

    /// Writes all frames of chunk number `chunk`. Numbers that do not fit into the store's integer type are
    /// clamped.
    ///
    /// # Errors
    /// Returns an error if the chunk does not exist, if the number of values differs from the number of
    /// elements of the chunk, or if writing fails.
    pub fn write_chunk(&self, chunk: usize, numbers: &[u32]) -> Result<(), AccessError> {
        let (start, size) = self.place(chunk);
        match &self.raw {
            Raw::U32(array) => array.write(&start, &size, numbers, None),
            Raw::U16(array) => {
                let narrow: Vec<u16> = numbers.iter().map(|n| (*n).min(0xFFFF) as u16).collect();
                array.write(&start, &size, &narrow, None)
            }
        }
    }

    /// Reads all frames of chunk number `chunk`.
    ///
    /// # Errors
    /// Returns an error if the chunk is damaged.
    pub fn read_chunk(&self, chunk: usize) -> Result<Vec<u32>, AccessError> {
        let (start, size) = self.place(chunk);
        match &self.raw {
            Raw::U32(array) => array.read(&start, &size),
            Raw::U16(array) => Ok(array.read(&start, &size)?.into_iter().map(u32::from).collect()),
        }
    }

    /// Writes a column: one number per frame, row-major over the run's axes.
    ///
    /// # Errors
    /// Returns an error if the number of values differs from the number of frames, or writing fails.
    pub fn write_column(&self, name: &str, units: &str, values: &[f64]) -> Result<(), CreateError> {
        let names: Vec<&str> = self.run_names().collect();
        let shape = &self.layout.shape()[..self.layout.run_axes];
        column(&self.storage, name, &names, units, shape, values)
            .map_err(|e| CreateError::write(&self.path().join(GROUP).join(name), e))
    }

    /// Reads a map. Returns `None` if the store has no map of the given name.
    ///
    /// # Errors
    /// Returns an error if the map is damaged.
    pub fn read_map(&self, name: &str) -> Result<Option<Vec<f64>>, OpenError> {
        self.read_numbers(name, self.layout.frame_len())
    }

    /// Waits until the file of a chunk is written to disk. A chunk of zeros has no file.
    ///
    /// # Errors
    /// Returns an error if the file system reports an error.
    pub fn sync_chunk(&self, chunk: usize) -> std::io::Result<()> {
        let (start, _) = self.place(chunk);
        let file = match &self.raw {
            Raw::U16(array) => array.file_of(&start),
            Raw::U32(array) => array.file_of(&start),
        };
        match std::fs::File::open(&file) {
            Ok(file) => file.sync_data()?,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
            Err(e) => return Err(e),
        }
        match file.parent() {
            // Also synchronize the folder, which contains the new file's name.
            Some(folder) => std::fs::File::open(folder)?.sync_data(),
            None => Ok(()),
        }
    }

    fn run_names(&self) -> impl Iterator<Item = &str> {
        self.layout.axes[..self.layout.run_axes].iter().map(|a| a.name.as_str())
    }

    /// Reads a column written by [`Self::write_column`]. Returns `None` if the store has no column of the
    /// given name.
    ///
    /// # Errors
    /// Returns an error if the column is damaged.
    pub fn read_column(&self, name: &str) -> Result<Option<Vec<f64>>, OpenError> {
        self.read_numbers(name, self.layout.frames())
    }

    fn read_numbers(&self, name: &str, expected: usize) -> Result<Option<Vec<f64>>, OpenError> {
        if describe::name_fault(name).is_some() || !self.path().join(GROUP).join(name).is_dir() {
            return Ok(None);
        }
        let array = ChunkedArray::<f64>::open(&self.storage, &format!("/{GROUP}/{name}"))?;
        let shape = array.shape().to_vec();
        let damaged = |reason: String| OpenError::Damaged { path: array.path.clone(), reason };
        if region::volume(&shape) != Some(expected) {
            return Err(damaged(format!("the array has shape {shape:?}, expected {expected} numbers")));
        }
        let read = array.read(&vec![0; shape.len()], &shape);
        read.map(Some).map_err(|e| damaged(e.to_string()))
    }

    /// Writes the manifest, which marks the store as finished.
    ///
    /// # Errors
    /// Returns an error if writing fails.
    pub fn finish(&self) -> Result<(), OpenError> {
        let io = |e: std::io::Error| OpenError::io(self.path(), e);
        self.storage.remove_leftovers().map_err(io)?;
        describe::consolidate(self.path(), &[GROUP.to_owned()])?;
        Manifest::write(self.path()).map_err(io)
    }

    /// Returns whether the store was written completely.
    pub fn is_finished(&self) -> bool {
        self.path().join(manifest::FILE).is_file()
    }
}

/// Returns whether a folder is a store of frames, finished or not.
pub fn is_frames(path: &Path) -> bool {
    path.join("zarr.json").is_file() && path.join(GROUP).join("raw").is_dir()
}

fn not_frames(path: &Path) -> OpenError {
    if !path.exists() {
        return OpenError::Missing { path: path.into() };
    }
    OpenError::NotAStore { path: path.to_owned(), reason: "the folder has no group `frames`".into() }
}

/// Writes an array of numbers into the group `frames`.
fn column(
    storage: &Arc<AtomicDirectory>,
    name: &str,
    names: &[&str],
    units: &str,
    shape: &[u64],
    values: &[f64],
) -> Result<(), Box<dyn std::error::Error>> {
    let description = Description {
        shape: shape.to_vec(),
        chunk: shape.iter().map(|n| (*n).max(1)).collect(),
        names: names.to_vec(),
        attributes: Map::from_iter([("units".to_owned(), json!(units))]),
        sharding: None,
    };
    let array = ChunkedArray::<f64>::create(storage, &format!("/{GROUP}/{name}"), description)?;
    Ok(array.write(&vec![0; shape.len()], shape, values, None)?)
}

#[cfg(test)]
mod tests;
