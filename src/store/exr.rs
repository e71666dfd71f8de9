//! Writes slices as OpenEXR images.
//!
//! The channels `stokes.S0.R … stokes.S3.B` contain the Stokes vector of the light received under unpolarized
//! illumination, that is, column 0 of the Mueller matrix. The channels `R`, `G`, `B` repeat S0. If requested,
//! the channels `mueller.M00.R … mueller.M33.B` contain the complete matrix. With three wavelengths, R is the
//! longest and B the shortest wavelength. With any other number of wavelengths, channels are named in
//! nanometres (`stokes.S0.450nm`). All channels are f32. Stokes frames are those of the stored tensor: the
//! projector frame for incoming light, the camera frame for outgoing light. Mitsuba's `stokes` integrator
//! uses another frame in each pixel (see CONVENTIONS.md), so the channels do not have Mitsuba's names `S0.R …
//! S3.B`.

use std::io;
use std::path::{Path, PathBuf};

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, SmallVec, WritableImage};

use super::probe::{Probe, ProbeError, Selection};
use crate::zarr::StoredSlice;
use base::whole_file;
use tensor::array::Tensor;
use tensor::axes::AxisKind;
use tensor::region;

#[derive(Debug, thiserror::Error)]
pub enum ExrError {
    /// The selected tensor is not an image.
    #[error("`{name}` {reason}")]
    NoImage {
        name: String,
        /// Text that describes the fault and the fix.
        reason: String,
    },
    #[error(transparent)]
    Probe(#[from] ProbeError),
    #[error("cannot write {path}: {cause}; check that the directory is writable and the disk is not full")]
    Write { path: PathBuf, cause: String },
}

/// The part of a slice to export.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrOptions {
    /// Parts of axes to export. After the selection, all axes are summed, except the image axes, the Stokes
    /// axes, the wavelength axis and the axes in `expand`.
    pub select: Vec<Selection>,
    /// Axes to expand into separate channels instead of summing them.
    pub expand: Vec<AxisKind>,
    /// Whether to also write all 16 elements of the Mueller matrix (`mueller.M00` …).
    pub mueller: bool,
}

/// Exports a slice as one OpenEXR file at `path`. An existing file is replaced.
///
/// # Errors
/// Returns an error if the selection does not fit the slice, the result has no image axes, or reading or
/// writing fails.
pub fn export(slice: &StoredSlice, options: &ExrOptions, path: &Path) -> Result<(), ExrError> {
    use AxisKind::{Bounces, Component, T, U, V};
    let sum = [V, U, T, Bounces, Component].into_iter().filter(|k| !options.expand.contains(k)).collect();
    let probe = Probe { select: options.select.clone(), sum, ..Probe::default() };
    write_exr(&probe.run(slice)?.mean, options.mueller, path)
}

/// Writes a tensor with the axes y and x, and optionally stokes_out, stokes_in and wavelength. Each entry of
/// any other axis has its own channels. The names of these channels have a prefix such as `t1250ps.` or
/// `component1.`.
///
/// # Errors
/// Returns an error if the tensor has no axes y and x, has stokes_in without stokes_out, or the file cannot
/// be written.
pub fn write_exr(tensor: &Tensor, mueller: bool, path: &Path) -> Result<(), ExrError> {
    let fault = |reason: &str| ExrError::NoImage { name: tensor.name.clone(), reason: reason.into() };
    let (Some(_), Some(_)) = (tensor.find(AxisKind::Y), tensor.find(AxisKind::X)) else {
        return Err(fault("has no image axes y and x: keep both axes"));
    };
    let has = |kind| tensor.find(kind).is_some();
    if has(AxisKind::StokesIn) && !has(AxisKind::StokesOut) {
        return Err(fault(
            "has stokes_in without stokes_out: keep both axes, or contract stokes_in with a Stokes state",
        ));
    }
    if mueller && !has(AxisKind::StokesIn) {
        return Err(fault("has no Mueller matrix to write: keep stokes_out and stokes_in"));
    }
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = channels(tensor, mueller)
        .into_iter()
        .map(|(name, indices)| AnyChannel::new(name.as_str(), FlatSamples::F32(plane(tensor, &indices))))
        .collect();
    let size = (tensor.extent(AxisKind::X), tensor.extent(AxisKind::Y));
    let image = Image::from_channels(size, AnyChannels::sort(channels));
    whole_file::write_with(path, |file| image.write().to_buffered(file).map_err(io::Error::other))
        .map_err(|e| ExrError::Write { path: path.to_owned(), cause: e.to_string() })
}

type Indices = Vec<(AxisKind, usize)>;

/// Returns the name of each channel and the tensor indices of its image.
fn channels(tensor: &Tensor, mueller: bool) -> Vec<(String, Indices)> {
    let known = [AxisKind::Y, AxisKind::X, AxisKind::StokesOut, AxisKind::StokesIn, AxisKind::Wavelength];
    let extra: Vec<_> = tensor.axes.iter().filter(|a| !known.contains(&a.kind)).collect();
    let lengths: Vec<u64> = extra.iter().map(|a| a.len()).collect();
    let outputs = tensor.extent(AxisKind::StokesOut);
    let mut all = Vec::new();
    for index in region::indices(&vec![0; lengths.len()], &lengths) {
        let mut prefix = String::new();
        let mut base: Indices = Vec::new();
        for (axis, i) in extra.iter().zip(index) {
            let unit = if axis.kind == AxisKind::T { "ps" } else { "" };
            prefix += &format!("{}{}{unit}.", axis.kind.name(), axis.coords[i as usize]);
            base.push((axis.kind, i as usize));
        }
        for (w, colour) in colours(tensor).into_iter().enumerate() {
            let at = |out, inn| {
                let own = [(AxisKind::Wavelength, w), (AxisKind::StokesOut, out), (AxisKind::StokesIn, inn)];
                [&base[..], &own].concat()
            };
            let dotted = if colour.is_empty() { String::new() } else { format!(".{colour}") };
            if ["R", "G", "B"].contains(&colour.as_str()) {
                all.push((format!("{prefix}{colour}"), at(0, 0)));
            }
            for out in 0..outputs {
                all.push((format!("{prefix}stokes.S{out}{dotted}"), at(out, 0)));
                for inn in (0..tensor.extent(AxisKind::StokesIn)).filter(|_| mueller) {
                    all.push((format!("{prefix}mueller.M{out}{inn}{dotted}"), at(out, inn)));
                }
            }
        }
    }
    all
}

/// Returns the name of every wavelength, or one empty name if there is no wavelength axis.
fn colours(tensor: &Tensor) -> Vec<String> {
    let Some(axis) = tensor.find(AxisKind::Wavelength) else {
        return vec![String::new()];
    };
    let coords = &tensor.axes[axis].coords;
    if coords.len() != 3 {
        return coords.iter().map(|c| format!("{c}nm")).collect();
    }
    let rank = |c: f64| coords.iter().filter(|o| **o > c).count().min(2);
    coords.iter().map(|&c| ["R", "G", "B"][rank(c)].to_owned()).collect()
}

/// Returns the image at the given indices of all other axes, row-major.
fn plane(tensor: &Tensor, indices: &Indices) -> Vec<f32> {
    let mut image = Vec::with_capacity(tensor.extent(AxisKind::Y) * tensor.extent(AxisKind::X));
    for y in 0..tensor.extent(AxisKind::Y) {
        for x in 0..tensor.extent(AxisKind::X) {
            image.push(tensor.at(&[&[(AxisKind::Y, y), (AxisKind::X, x)], &indices[..]].concat()));
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers, read};
    use std::collections::BTreeMap;
    use tensor::axes::Axis;

    fn tensor(axes: &[(AxisKind, &[f64])]) -> Tensor {
        let axes = axes
            .iter()
            .map(|(kind, coords)| Axis { kind: *kind, coords: coords.to_vec(), chunk: 1 })
            .collect();
        let mut tensor = Tensor::zeros("image", axes);
        tensor.data.iter_mut().enumerate().for_each(|(i, v)| *v = i as f32 * 0.5 - 3.0);
        tensor
    }

    const STOKES: &[f64] = &[0.0, 1.0, 2.0, 3.0];

    fn read_back(path: &Path) -> BTreeMap<String, Vec<f32>> {
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .unwrap();
        assert_eq!((image.layer_data.size.0, image.layer_data.size.1), (3, 2));
        let channels = image.layer_data.channel_data.list;
        channels
            .into_iter()
            .map(|c| match c.sample_data {
                FlatSamples::F32(values) => (c.name.to_string(), values),
                _ => panic!("channel {} is not f32", c.name),
            })
            .collect()
    }

    #[test]
    fn mueller_images_round_trip() {
        use AxisKind::{StokesIn, StokesOut, Wavelength, X, Y};
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let t = tensor(&[
            (Y, &[0.0, 1.0]),
            (X, &[0.0, 1.0, 2.0]),
            (StokesOut, STOKES),
            (StokesIn, STOKES),
            (Wavelength, &[660.0, 450.0, 550.0]),
        ]);
        write_exr(&t, false, &path).unwrap();
        assert_eq!(read_back(&path).len(), 15);
        write_exr(&t, true, &path).unwrap();
        let channels = read_back(&path);
        assert_eq!(channels.len(), 3 + 12 + 48);
        // Channel names that begin with S or M would imply the Stokes frames of Mitsuba's sensor, which
        // differ from Sunstone's.
        assert!(!channels.keys().any(|name| name.starts_with(['S', 'M'])));
        for (w, colour) in ["R", "B", "G"].into_iter().enumerate() {
            for (out, inn) in (0..4).flat_map(|o| (0..4).map(move |i| (o, i))) {
                let expected = plane(&t, &vec![(StokesOut, out), (StokesIn, inn), (Wavelength, w)]);
                assert_eq!(channels[&format!("mueller.M{out}{inn}.{colour}")], expected);
                if inn == 0 {
                    assert_eq!(channels[&format!("stokes.S{out}.{colour}")], expected);
                }
            }
            assert_eq!(channels[colour], channels[&format!("stokes.S0.{colour}")]);
        }
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn other_axes_and_wavelengths_name_their_channels() {
        use AxisKind::{T, Wavelength, X, Y};
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let image = [(Y, &[0.0, 1.0][..]), (X, &[0.0, 1.0, 2.0][..])];
        let t = tensor(&[image[0], image[1], (T, &[12.5, 37.5]), (Wavelength, &[635.0])]);
        write_exr(&t, false, &path).unwrap();
        let channels = read_back(&path);
        assert_eq!(
            channels.keys().collect::<Vec<_>>(),
            ["t12.5ps.stokes.S0.635nm", "t37.5ps.stokes.S0.635nm"]
        );
        assert_eq!(channels["t37.5ps.stokes.S0.635nm"], plane(&t, &vec![(T, 1)]));
        assert!(write_exr(&t, true, &path).is_err());
        assert!(write_exr(&t.select(Y, 0), false, &path).is_err());
        let bad = tensor(&[image[0], image[1], (AxisKind::StokesIn, STOKES)]);
        assert!(matches!(write_exr(&bad, false, &path), Err(ExrError::NoImage { .. })));
        assert!(matches!(write_exr(&t, false, &path.join("x")), Err(ExrError::Write { .. })));
    }

    #[test]
    fn slices_are_exported_with_time_summed() {
        use crate::zarr::TensorStore;
        use tensor::axes::{Extents, SliceLayout};
        use tensor::field::Field;
        use tensor::slice::{CameraSelect, Polarization, ProjectorSelect, Slice, TimeSelect};
        let dir = tempfile::tempdir().unwrap();
        let wavelengths_nm = vec![450.0, 550.0, 660.0];
        let extents = Extents { camera: [3, 2], projector: None, wavelengths_nm, max_depth: 2, tile: 2 };
        let slice = Slice {
            name: "s".into(),
            camera: CameraSelect::All,
            projector: ProjectorSelect::Sum,
            time: TimeSelect::Bins { start_ps: 0.0, bin_ps: 1.0, bins: 4 },
            polarization: Polarization::Mueller,
            bounces: false,
            split_first_bounce: true,
            labels: false,
        };
        let none = serde_json::Map::new();
        let slices = [(SliceLayout::new(&slice, &extents), none.clone())];
        let slice = TensorStore::create(&dir.path().join("s"), &slices, &none, None, false);
        let slice = slice.unwrap().slice("s").unwrap();
        let shape = slice.layout().shape();
        let data: Vec<f32> = (0..shape.iter().product::<u64>()).map(|i| (i % 97) as f32).collect();
        slice.write(Field::Mean, &vec![0; shape.len()], &shape, &data).unwrap();
        let path = dir.path().join("s.exr");
        let options = ExrOptions {
            select: vec!["t=1:".parse().unwrap()],
            expand: vec![AxisKind::Component],
            mueller: true,
        };
        export(&slice, &options, &path).unwrap();
        let full = slice.read_all(Field::Mean).unwrap();
        let channels = read_back(&path);
        assert_eq!(channels.len(), 2 * 63);
        let mut expected = [0.0; 6];
        for t in 1..4 {
            let one = full.select(AxisKind::T, t);
            let at = vec![
                (AxisKind::Component, 1),
                (AxisKind::StokesOut, 2),
                (AxisKind::StokesIn, 3),
                (AxisKind::Wavelength, 2),
            ];
            plane(&one, &at).iter().zip(&mut expected).for_each(|(v, e)| *e += v);
        }
        assert_eq!(channels["component1.mueller.M23.R"], expected);
    }
}
