//! The `sunstone probe` command, which queries a stored slice.

use crate::source::{Source, slice};
use crate::{Failure, bail, places, print, print_path};
use std::fmt::Write;
use std::path::PathBuf;
use sunstone::base::input;
use sunstone::store::probe::{
    LeftOut, Pattern, Probe, ProbeResult, Pulse, parse_axes, parse_stokes, std_error_path,
};
use sunstone::tensor::array::Tensor;

/// Slice, sum, contract and convolve a stored slice of T (equations 1 to 9 of Baek & Heide 2021).
///
/// Steps are applied in this order: projector pattern and Stokes state (I = Σ T P over s', p'), pulse
/// (convolution along t), selection, sums. Without steps, the slice is written unchanged. The slice is
/// processed chunk by chunk and may be larger than memory; the result must fit into memory.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone probe room.zarr xt --select x=180 --sum stokes_out --csv -        a time profile as CSV
  sunstone probe room.zarr polarimetric --preset polarimetric                T_p, the 4 x 4 of the whole scene
  sunstone probe room.zarr xt --stokes horizontal --pulse gaussian:50 -o captured.npy
  sunstone probe room.zarr ss --pattern stripes.png -o lit.zarr")]
pub struct Arguments {
    #[command(flatten)]
    source: Source,
    /// Sum over axes (comma-separated names).
    #[arg(long, default_value = "")]
    sum: String,
    /// Start from a classical transport matrix: spatial T_s, temporal T_t, polarimetric T_p.
    #[arg(long)]
    preset: Option<Preset>,
    /// Drive image P(s') of the projector's resolution, brightness 0..1: contracts v and u.
    #[arg(long)]
    pattern: Option<PathBuf>,
    /// Stokes state p' of the projector light: a name (unpolarized, horizontal, right, …) or s0,s1,s2,s3.
    #[arg(long)]
    stokes: Option<String>,
    /// Pulse shape: gaussian:FWHM_PS, or samples:a,b,… at the slice's bin width.
    #[arg(long)]
    pulse: Option<Pulse>,
    /// File or store to write (.npy, .csv or .zarr).
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Print the result as CSV (`--csv -`).
    #[arg(long, value_name = "-", conflicts_with = "output", value_parser = ["-"])]
    csv: Option<String>,
    /// Replace an existing result.
    #[arg(long)]
    force: bool,
}

/// The paper's special cases of T.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Preset {
    /// T_s = Σ_t T(:, :, 0, 0, t).
    Spatial,
    /// T_t = Σ_{s,s'} T(s, s', 0, 0, :).
    Temporal,
    /// T_p = Σ_{s,s',t} T(s, s', :, :, t).
    Polarimetric,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    check(a)?;
    let (store, slice) = slice(&a.source.store, &a.source.slice, a.source.partial)?;
    let mut probe = match a.preset {
        None => Probe::default(),
        Some(Preset::Spatial) => Probe::spatial(),
        Some(Preset::Temporal) => Probe::temporal(),
        Some(Preset::Polarimetric) => Probe::polarimetric(),
    };
    probe.select.extend(a.source.select.iter().copied());
    if !a.sum.is_empty() {
        probe.sum.extend(parse_axes(&a.sum).map_err(Failure::input)?);
    }
    if let Some(path) = &a.pattern {
        probe.pattern = Some(read_pattern(path)?);
    }
    if let Some(s) = &a.stokes {
        probe.stokes = Some(parse_stokes(s).map_err(Failure::input)?);
    }
    probe.pulse.clone_from(&a.pulse);
    let result = probe.run(&slice).map_err(Failure::input)?;
    for note in &result.notes {
        eprintln!("note: {note}");
    }
    report(&result)?;
    if let Some(path) = &a.output {
        let mut attributes = store.attributes();
        attributes.retain(|k, _| k != "figures" && k != "slices");
        result.write(path, &attributes, a.force).map_err(|e| Failure::of_system(e.is_of_system(), e))?;
        return print_path(path);
    }
    if a.csv.is_some() {
        return print(csv(&result).trim_end());
    }
    print(summary(&result).trim_end())
}

/// Prints notes about light outside the time bins and unknown values, which the result does not contain.
fn report(r: &ProbeResult) -> Result<(), Failure> {
    for note in LeftOut::of(r).notes() {
        eprintln!("note: {note}");
    }
    let values = &r.mean.data;
    let unknown = values.iter().filter(|v| !v.is_finite()).count();
    if unknown == values.len() {
        bail!(
            "all values of the result are NaN, because the selected region is not rendered or the selection is empty; change the \
             selection, or finish the render"
        );
    }
    if unknown > 0 {
        eprintln!("note: {unknown} of {} values are unknown (NaN)", values.len());
    }
    Ok(())
}

/// Checks that the output is not an input.
fn check(a: &Arguments) -> Result<(), Failure> {
    let inputs = [Some(&a.source.store), a.pattern.as_ref()];
    let Some(path) = &a.output else {
        return Ok(());
    };
    places::extension([path], "results are", &["npy", "csv", "zarr"])?;
    if path.extension().is_some_and(|e| e == "zarr") {
        return places::folders(inputs, [Some(path)]);
    }
    let errors = path.extension().is_some_and(|e| e == "npy").then(|| std_error_path(path));
    places::files(inputs, [Some(path), errors.as_ref()])
}

/// Reads a projector pattern as linear brightness from 0 to 1, as for masks in a scene.
fn read_pattern(path: &PathBuf) -> Result<Pattern, Failure> {
    let image = input::open(path)
        .map_err(image::ImageError::from)
        .and_then(|_| image::open(path))
        .map_err(|e| Failure::input(format!("--pattern {}: {e}; pass a PNG or JPEG file", path.display())))?
        .to_luma16();
    Ok(Pattern {
        width: image.width(),
        height: image.height(),
        values: image.pixels().map(|p| f32::from(p.0[0]) / 65535.0).collect(),
    })
}

/// Calls `f` with the coordinates and the index of every element.
fn for_each(t: &Tensor, mut f: impl FnMut(&[f64], usize)) {
    let shape = t.shape();
    let mut coords = vec![0.0; shape.len()];
    for i in 0..t.data.len() {
        let mut rest = i;
        for (k, axis) in t.axes.iter().enumerate().rev() {
            coords[k] = axis.coords[rest % shape[k]];
            rest /= shape[k];
        }
        f(&coords, i);
    }
}

fn csv(r: &ProbeResult) -> String {
    let mut text = String::new();
    for axis in &r.mean.axes {
        let _ = write!(text, "{},", axis.kind.name());
    }
    text.push_str("mean,std_error\n");
    for_each(&r.mean, |coords, i| {
        for c in coords {
            let _ = write!(text, "{c},");
        }
        let _ = writeln!(text, "{:e},{:e}", r.mean.data[i], r.std_error.data[i]);
    });
    text
}

/// Formats a result. The text contains all values of a small result, or the axes and the extreme values of a
/// large result.
fn summary(r: &ProbeResult) -> String {
    let mut text = String::new();
    let axes: Vec<String> =
        r.mean.axes.iter().map(|a| format!("{} {}", a.kind.name(), a.coords.len())).collect();
    let _ = writeln!(text, "{}", if axes.is_empty() { "scalar".into() } else { axes.join(" × ") });
    if r.mean.data.len() <= 64 {
        text.push_str(&csv(r));
    } else {
        let (lo, hi) = r
            .mean
            .data
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        let sum: f64 = r.mean.data.iter().map(|v| f64::from(*v)).sum();
        let _ = writeln!(
            text,
            "sum {sum:.6e}, minimum {lo:.6e}, maximum {hi:.6e}; write all values with -o FILE.npy, .csv or .zarr"
        );
    }
    text
}
