//! One variant of the statue. The variant consists of the input of the methods and the true shape.

use super::column_light::ColumnLight;
use super::likelihood::Measured;
use super::methods::Inputs;
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::Observation;
use nalgebra::Vector3;
use tensor::array::Tensor;
use tensor::axes::AxisKind;

/// Wavelength that all methods use, in nanometres.
const WAVELENGTH: f64 = 550.0;

pub(super) struct Seen {
    pub variant: u64,
    pub seed: u64,
    pub inputs: Inputs,
    /// Input of the methods. T(s, u) belongs to the same statue after spraying with matte paint. All other
    /// inputs belong to the unsprayed statue.
    pub sprayed: Inputs,
    /// True depth in metres, and true normals in the camera's frame. Pixels that the statue does not cover
    /// completely are NaN.
    pub depth: Map,
    pub normals: Map,
}

/// Returns a tensor of the slice `name` at [`WAVELENGTH`] as an image over `y` and `x`. The remaining
/// `channels` entries are the channels of the image.
fn image(
    o: &Observation,
    name: &str,
    mean: &Tensor,
    channels: usize,
    axis: &'static str,
) -> Result<Map, ApplyError> {
    let wrong = |axis| ApplyError::Axis { variant: o.variant, slice: name.to_owned(), axis };
    let lane = mean.find(AxisKind::Wavelength).map_or(0, |at| mean.axes[at].nearest(WAVELENGTH));
    let one = mean.select(AxisKind::Wavelength, lane);
    if (one.find(AxisKind::Y), one.find(AxisKind::X)) != (Some(0), Some(1)) {
        return Err(wrong("rows and columns of the camera"));
    }
    let (height, width) = (one.extent(AxisKind::Y), one.extent(AxisKind::X));
    if one.data.len() != width * height * channels {
        return Err(wrong(axis));
    }
    Ok(Map { width, height, channels, data: one.data.iter().map(|v| f64::from(*v)).collect() })
}

impl Seen {
    pub(super) fn new(o: &Observation) -> Result<Self, ApplyError> {
        let rig = o.rig()?;
        let size = rig.camera.resolution;
        let fits = |map: Map, what: &str| {
            if [map.width, map.height] == size {
                Ok(map)
            } else {
                Err(o.sizes(format!("the camera and {what}")))
            }
        };
        let light = |name: &str| {
            let (mean, all) = (&o.slice(name)?.mean, "all columns of the projector");
            let columns = image(o, name, mean, rig.projector.resolution[0], all)?;
            Ok(ColumnLight { light: fits(columns, name)? })
        };
        let mueller = |name: &str| {
            let part = |of: &Tensor| fits(image(o, name, of, 16, "whole Mueller matrices")?, name);
            let slice = o.slice(name)?;
            Ok::<_, ApplyError>(Measured { mean: part(&slice.mean)?, error: part(&slice.error)? })
        };
        let truth = |name: &str, channels: usize| {
            let map = fits(o.truth(name)?.clone(), name)?;
            if map.channels == channels { Ok(map) } else { Err(o.sizes(format!("channels of {name}"))) }
        };
        let (share, position, normal) = (truth("statue", 1)?, truth("position", 3)?, truth("normal", 3)?);
        let camera = &rig.camera;
        let mask = Map::from_fn(size[0], size[1], 1, |x, y, out| {
            let known = position.at(x, y).iter().chain(normal.at(x, y)).all(|v| v.is_finite());
            out[0] = f64::from(u8::from(share.at(x, y)[0] >= 1.0 && known));
        });
        if mask.data.iter().all(|m| *m == 0.0) {
            return Err(o.no_pixel("only the statue"));
        }
        let forward = camera.axes.column(2).into_owned();
        let depth = Map::from_fn(size[0], size[1], 1, |x, y, out| {
            let p = Vector3::from_column_slice(position.at(x, y));
            out[0] = if mask.at(x, y)[0] == 0.0 { f64::NAN } else { forward.dot(&(p - camera.origin)) };
        });
        let normals = Map::from_fn(size[0], size[1], 3, |x, y, out| {
            let n = camera.axes.transpose() * Vector3::from_column_slice(normal.at(x, y));
            if mask.at(x, y)[0] == 0.0 {
                out.fill(f64::NAN);
            } else {
                out.copy_from_slice(n.normalize().as_slice());
            }
        });
        let inputs = Inputs {
            columns: light("columns")?,
            epipolar_columns: light("epipolar_columns")?,
            mueller: mueller("polarimetric")?,
            epipolar_mueller: mueller("epipolar")?,
            mask,
            rig: rig.clone(),
        };
        let sprayed = Inputs { columns: light("sprayed columns")?, ..inputs.clone() };
        Ok(Self { variant: o.variant, seed: o.seed, inputs, sprayed, depth, normals })
    }
}
