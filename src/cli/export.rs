//! `sunstone export`.

use super::failure::Failure;
use std::path::PathBuf;
use sunstone::tensor::exr::{ExrOptions, export};
use sunstone::tensor::probe::parse_axes;

/// Export an image slice as OpenEXR with Mitsuba's channel names (S0.R … S3.B, and R, G, B).
///
/// Column 0 of the Mueller matrix is the Stokes image under unpolarized light. Axes other than y and x are summed
/// unless selected or expanded into channels.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    source: super::Source,
    /// Axes to write as channels of their own (comma-separated names).
    #[arg(long, default_value = "")]
    expand: String,
    /// Write all 16 Mueller elements (M00.R … M33.B).
    #[arg(long)]
    mueller: bool,
    /// EXR file to write.
    #[arg(short, long)]
    output: PathBuf,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let (_, slice) = a.source.open()?;
    let options = ExrOptions {
        select: a.source.select.clone(),
        expand: if a.expand.is_empty() {
            vec![]
        } else {
            parse_axes(&a.expand).map_err(Failure::input)?
        },
        mueller: a.mueller,
    };
    export(&slice, &options, &a.output).map_err(Failure::input)?;
    super::print(&a.output.display().to_string())
}
