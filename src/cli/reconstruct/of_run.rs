//! The `sunstone reconstruct` command for the raw frames of a run.

use super::arguments::Arguments;
use crate::{Failure, bail, places, print, print_path};
use serde_json::json;
use std::path::Path;
use sunstone::polarimetry::capture::scheme_file::load;
use sunstone::polarimetry::reconstruct::pixels::Options;
use sunstone::polarimetry::reconstruct::second_moment;
use sunstone::rig::session::image::Run;
use sunstone::rig::session::mueller::{RunOptions, write_store};
use sunstone::store::numpy;

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let inputs = [Some(&a.source), a.scheme.as_ref(), a.prior.as_ref()];
    let array = a.output.extension().is_some_and(|e| e == "npy");
    if array {
        places::files(inputs, [Some(&a.output), a.errors.as_ref()])?;
    } else {
        places::folders(inputs, [Some(&a.output)])?;
        if a.errors.is_some() {
            bail!("--errors: the output is a store, which always contains the errors; remove --errors");
        }
    }
    if a.variance.is_some() || a.noise.is_some() && a.prior.is_none() || a.saturation.is_some() {
        bail!(
            "--variance, --saturation, and --noise without --prior do not apply to runs, because the detector of the run defines \
             these values; remove these options"
        );
    }
    let scheme = a.scheme.as_deref().map(load).transpose()?;
    let run = Run::open(&a.source, scheme.as_ref()).map_err(Failure::input)?;
    let masks: Vec<String> = if a.masks.is_empty() {
        run.masks.iter().filter(|m| *m != "dark").cloned().collect()
    } else {
        a.masks.clone()
    };
    if array && masks.len() != 1 {
        bail!(
            "an array can contain only one mask, but {} masks are selected ({}); select one mask with --mask, or write a store: -o {}",
            masks.len(),
            masks.join(", "),
            a.output.with_extension("zarr").display()
        );
    }
    let how = RunOptions {
        options: Options {
            noise: a.noise,
            realizable: a.realizable,
            prior: a.prior.as_deref().map(second_moment::load).transpose()?,
            saturation: None,
        },
        fov_x: a.view.map(f64::to_radians),
        superpixel: a.superpixel,
    };
    let mut images = vec![];
    for mask in &masks {
        images.push(run.mueller(mask, &how).map_err(Failure::input)?);
    }
    if let Some(image) = images.iter().find(|i| i.tally.lost == i.tally.pixels) {
        bail!(
            "{}: none of the {} pixels of mask {} is determined, because the unsaturated readings do not determine 16 elements; no \
             file was written; reduce the exposure",
            a.source.display(),
            image.tally.pixels,
            image.name
        );
    }
    if array {
        let image = &images[0];
        let mut shape = vec![image.layout.height, image.layout.width];
        if image.time.is_some() {
            shape.push(image.layout.times);
        }
        shape.extend([4, 4]);
        let save = |path: &Path, values: &[f32]| numpy::save(path, &shape, values).map_err(Failure::at(path));
        if let Some(path) = &a.errors {
            save(path, &image.errors)?;
        }
        save(&a.output, &image.mean)?;
    } else {
        let mut attributes = run.attributes().clone();
        attributes.insert("kind".into(), json!("reconstruction"));
        attributes.insert("source".into(), json!(format!("sunstone reconstruct {}", a.source.display())));
        if let Some(path) = &a.scheme {
            attributes.insert("calibrated_scheme".into(), json!(path.display().to_string()));
        }
        write_store(&a.output, &images, run.nm, &attributes, a.force)
            .map_err(|e| Failure::of_system(e.is_of_system(), e))?;
    }
    for image in &images {
        let t = image.tally;
        print(&format!(
            "{:<14} {} pixels, {} with missing measurements, {} not determined",
            image.name, t.pixels, t.partial, t.lost
        ))?;
    }
    print_path(&a.output)
}
