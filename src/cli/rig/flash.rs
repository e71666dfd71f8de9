//! The `sunstone rig flash` command, which writes images for a projector's flash memory.

use super::session::stand_in;
use crate::{Failure, bail, places, print};
use std::path::PathBuf;
use sunstone::base::whole_file;
use sunstone::rig::driver::dlpc350::flash;
use sunstone::rig::driver::dlpc350::projector::SIZE;
use sunstone::rigs::prepared::Prepared;

/// Write the patterns of a plan as images for a DLPC350's flash memory.
///
/// Such a projector (LightCrafter 4500) shows images that TI's program writes into its flash memory together
/// with the firmware, 24 patterns per image. List the images in the rig file: `[projector] driver =
/// "dlpc350"`, `flash = ["flash/flash_00.png", …]`. The command does not connect to any instrument.
#[derive(clap::Args)]
pub struct Arguments {
    /// Plan.
    plan: PathBuf,
    /// Rig file [default: the plan's].
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Folder to create for the images.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let session = Prepared::load(&a.plan, a.rig.as_ref())?;
    places::folders(session.inputs.iter().map(Some), [Some(&a.output)])?;
    if a.output.exists() {
        bail!("{}: the output already exists; choose a new folder", a.output.display());
    }
    let steps = session.steps(&stand_in(&session)?)?;
    let [w, h] = SIZE;
    if steps.patterns.is_empty() {
        bail!("{}: the plan uses no projector patterns; pass a plan with patterns", a.plan.display());
    }
    if let Some(p) = steps.patterns.iter().find(|p| [p.width, p.height] != SIZE) {
        bail!(
            "{}: the patterns have {} x {} pixels, but the projector has {w} x {h} pixels; set [projector] size = [{w}, {h}] in the rig \
             file",
            a.plan.display(),
            p.width,
            p.height
        );
    }
    let images = flash::images(&steps.patterns);
    for (i, rgb) in images.iter().enumerate() {
        let path = a.output.join(format!("flash_{i:02}.png"));
        let bytes = flash::to_png(rgb)
            .ok_or_else(|| Failure::failed("internal error: cannot encode an image as PNG"))?;
        whole_file::write(&path, &bytes).map_err(Failure::at(&path))?;
    }
    print(&format!("{}: {} patterns in {} images", a.output.display(), steps.patterns.len(), images.len()))
}
