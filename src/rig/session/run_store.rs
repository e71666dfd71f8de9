//! The store of a run. The store contains raw frames over named axes, and all data that the reconstruction of
//! Mueller matrices requires.

use super::journal::{self, Event, FrameRecord};
use super::masks::Mask;
use super::plan::Work;
use super::rig_file::RigPlan;
use super::steps::Steps;
use super::writer::{DiskError, remove_log};
use polarimetry::capture::scheme_file;
use serde_json::{Map, Value, json};
use std::path::Path;
use store::zarr::frames::{FrameAxis, FrameLayout, FrameMap, FrameNumber, FrameStore};
use store::zarr::{CreateError, OpenError};

#[derive(Debug, thiserror::Error)]
pub enum RunStoreError {
    #[error(transparent)]
    Create(#[from] CreateError),
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The store belongs to another run.
    #[error(
        "{path}: the run was started with another plan, scheme or rig ({what} differs); resume with the same files, or choose another `-o`"
    )]
    Other {
        path: String,
        /// The attribute that differs.
        what: String,
    },
    #[error("{path}: the run is already finished; compute Mueller matrices with `sunstone reconstruct`")]
    Finished { path: String },
}

fn indices(name: &str, n: u64) -> FrameAxis {
    FrameAxis { name: name.into(), units: "1".into(), coords: (0..n).map(|i| i as f64).collect() }
}

/// Returns the layout of a plan's frames.
pub fn layout(steps: &Steps) -> FrameLayout {
    let [captures, second, third] = steps.plan.run_shape();
    match &steps.plan.work {
        Work::Camera(work) => {
            let exposures = work.exposures.iter().map(std::time::Duration::as_secs_f64).collect();
            let exposure = FrameAxis { name: "exposure".into(), units: "s".into(), coords: exposures };
            let [width, height] = steps.frame_size.map(u64::from);
            FrameLayout {
                axes: vec![
                    indices("capture", captures),
                    indices("shot", second),
                    exposure,
                    indices("y", height),
                    indices("x", width),
                ],
                run_axes: 3,
                gathered: false,
                number: FrameNumber::U16,
            }
        }
        Work::Scan(work) => {
            let centre = |i: u32| work.offset_ps + (f64::from(i) + 0.5) * work.bin_ps;
            let t = FrameAxis {
                name: "t".into(),
                units: "ps".into(),
                coords: (0..work.bins).map(centre).collect(),
            };
            FrameLayout {
                axes: vec![indices("capture", captures), indices("y", second), indices("x", third), t],
                run_axes: 3,
                gathered: true,
                number: FrameNumber::U32,
            }
        }
    }
}

/// Returns the attributes of a run's store. `sample` is the name of a known sample, if the run captures one.
pub fn attributes(steps: &Steps, rig: &RigPlan, sample: Option<&str>) -> Map<String, Value> {
    let mut first = 0;
    let masks: Vec<Value> = steps
        .masks
        .iter()
        .map(|m| {
            let value = json!({"name": m.name, "first": first, "shots": m.shots.len()});
            first += m.shots.len();
            value
        })
        .collect();
    let work = match &steps.plan.work {
        Work::Camera(work) => json!({
            "kind": "camera",
            "masks": masks,
            "regions": steps.shots.iter().map(|(_, r)| [r.x, r.y, r.width, r.height]).collect::<Vec<_>>(),
            "gain_db": work.gain_db,
            "format": work.format.name(),
        }),
        Work::Scan(work) => json!({
            "kind": "scan",
            "fov_x_deg": work.fov_x_deg,
            "dwell_s": work.dwell.as_secs_f64(),
            "bin_ps": work.bin_ps,
            "offset_ps": work.offset_ps,
            "rate_hz": work.rate_hz,
        }),
    };
    let detector = match &steps.plan.work {
        Work::Camera(_) => json!({"cmos": rig.cmos}),
        Work::Scan(_) => json!({"spad": rig.spad}),
    };
    let mut all = Map::new();
    all.insert("kind".into(), json!("frames"));
    all.insert("program".into(), json!(format!("sunstone {}", env!("CARGO_PKG_VERSION"))));
    all.insert("name".into(), json!(steps.plan.name));
    all.insert("plan".into(), json!(steps.plan.text));
    // The numbers are finite, so the conversion to TOML cannot fail.
    let scheme = scheme_file::to_toml(&steps.plan.scheme).unwrap_or_default();
    all.insert("scheme".into(), json!(scheme));
    all.insert("rig".into(), json!(rig.name));
    all.insert("stages".into(), json!(steps.stage_names));
    all.insert("wavelength_nm".into(), json!(rig.wavelength_nm));
    all.insert("detector".into(), detector);
    all.insert("work".into(), work);
    if let Some(sample) = sample {
        all.insert("sample".into(), json!(sample));
    }
    all
}

/// Creates the store of a new run.
///
/// # Errors
/// Returns [`RunStoreError`] if the store cannot be created.
pub fn create(
    path: &Path,
    steps: &Steps,
    rig: &RigPlan,
    sample: Option<&str>,
    force: bool,
) -> Result<FrameStore, RunStoreError> {
    let attributes = attributes(steps, rig, sample);
    Ok(FrameStore::create(path, &layout(steps), &maps(steps), &attributes, force)?)
}

/// Returns one map per mask. A map contains the shot in which each camera pixel is read, or −1.
fn maps(steps: &Steps) -> Vec<FrameMap> {
    let of = |s: &Option<u32>| s.map_or(-1.0, f64::from);
    let map = |mask: &Mask| FrameMap {
        name: format!("shot_of_{}", mask.name),
        units: "1".into(),
        values: mask.shot_of.iter().map(of).collect(),
    };
    steps.masks.iter().map(map).collect()
}

/// Opens the store of an unfinished run of the same plan and rig.
///
/// # Errors
/// Returns [`RunStoreError`] if the store cannot be opened or belongs to another run.
pub fn resume(
    path: &Path,
    steps: &Steps,
    rig: &RigPlan,
    sample: Option<&str>,
) -> Result<FrameStore, RunStoreError> {
    let store = FrameStore::open_for_write(path)?;
    let shown = path.display().to_string();
    if store.is_finished() {
        return Err(RunStoreError::Finished { path: shown });
    }
    // Write and parse the attributes, so that they are comparable with stored attributes.
    let wanted = Value::Object(attributes(steps, rig, sample));
    let wanted: Value = serde_json::from_str(&wanted.to_string()).unwrap_or(wanted);
    let found = store.attributes();
    let differs =
        wanted.as_object().into_iter().flatten().find(|(name, value)| found.get(*name) != Some(*value));
    if let Some((name, _)) = differs {
        return Err(RunStoreError::Other { path: shown, what: name.clone() });
    }
    if *store.layout() != layout(steps) {
        return Err(RunStoreError::Other { path: shown, what: "the frames' shape".into() });
    }
    Ok(store)
}

/// Writes the metadata of all frames as columns, then writes the manifest, which marks the run as finished.
///
/// # Errors
/// Returns [`DiskError`] if the store cannot be written.
pub fn finish(path: &Path, steps: &Steps) -> Result<(), DiskError> {
    let failed = |cause: String| DiskError { path: path.to_owned(), cause };
    let store = FrameStore::open_for_write(path).map_err(|e| failed(e.to_string()))?;
    // Keep only columns of numbers in memory, because a run can have half a million frames.
    let scan = matches!(steps.plan.work, Work::Scan(_));
    let mut columns: Vec<(String, &str)> = vec![];
    columns.extend(steps.stage_names.iter().map(|name| (format!("angle_{name}"), "degree")));
    if scan {
        let more = [("pointing_x", "degree"), ("pointing_y", "degree"), ("pulses", "1")];
        columns.extend(more.map(|(name, units)| (name.to_owned(), units)));
    }
    let width = columns.len();
    let stages = steps.stage_names.len();
    let row = |r: FrameRecord| -> Vec<f64> {
        let angle = |i: usize| r.angles_deg.get(i).copied().unwrap_or(f64::NAN);
        let mut row: Vec<f64> = (0..stages).map(angle).collect();
        if scan {
            row.extend(r.pointing_deg.unwrap_or([f64::NAN; 2]));
            row.push(r.pulses.map_or(f64::NAN, |p| p as f64));
        }
        row
    };
    let mut values: Vec<f64> = vec![];
    let mut next = 0;
    journal::read(path, |event| {
        if let Event::Frame(record) = event
            && record.frame <= next
        {
            values.truncate(record.frame as usize * width);
            next = record.frame + 1;
            values.extend(row(record));
        }
    })
    .map_err(|e| failed(e.to_string()))?;
    if u64::from(next) != steps.plan.frames() {
        let frames = steps.plan.frames();
        return Err(failed(format!("only {next} of {frames} frames are recorded; resume the run")));
    }
    for (i, (name, units)) in columns.iter().enumerate() {
        let column: Vec<f64> = values.iter().skip(i).step_by(width).copied().collect();
        store.write_column(name, units, &column).map_err(|e| failed(e.to_string()))?;
    }
    remove_log(path).map_err(|e| failed(e.to_string()))?;
    store.finish().map_err(|e| failed(e.to_string()))
}
