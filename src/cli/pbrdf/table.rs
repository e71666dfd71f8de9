//! `sunstone pbrdf info`, `slice` and `plot`: what a `.pbsdf` file holds.

use crate::cli::failure::Failure;
use std::io::Write;
use std::path::{Path, PathBuf};
use sunstone::base::whole_file;
use sunstone::figure::sheet::{Grid, draw};
use sunstone::store::numpy;
use sunstone::transport::material::measured::table::{Options, Table};

/// A table to read.
#[derive(clap::Args)]
struct Source {
    /// Table in the KAIST format.
    file: PathBuf,
    /// Take evenly spaced angles where the file leaves its axes empty.
    #[arg(long)]
    even_axes: bool,
}

impl Source {
    fn open(&self) -> Result<Table, Failure> {
        let options = Options {
            even_axes: self.even_axes,
            ..Options::default()
        };
        Table::open(&self.file, &options).map_err(|e| Failure::input(format!("{}: {e}", self.file.display())))
    }
}

/// Print what a table holds.
#[derive(clap::Args)]
pub struct InfoArguments {
    #[command(flatten)]
    source: Source,
}

/// Names of the angles in the order of the table's axes.
const ANGLES: [&str; 3] = ["phi_d", "theta_d", "theta_h"];

pub fn info(a: &InfoArguments) -> Result<(), Failure> {
    let table = a.source.open()?;
    let bands = table.wavelengths_nm();
    let mut text = format!("{}: {} bytes\n", a.source.file.display(), table.file_len());
    for (name, nodes) in ANGLES.iter().zip(table.angles()) {
        let (first, last) = (nodes[0].to_degrees(), nodes[nodes.len() - 1].to_degrees());
        text += &format!(
            "  {name:8} {:4} entries, {first:.1}° to {last:.1}°\n",
            nodes.len()
        );
    }
    text += &format!("  bands    {:4} entries, {bands:?} nm\n", bands.len());
    // All entries of a small table, an even choice of a large one.
    let [p, d, h] = table.angles().map(<[f32]>::len);
    let entries = p * d * h;
    let step = (entries / 200_000).max(1);
    let of = if step == 1 { "all" } else { "a sample of" };
    text += &format!(
        "over {of} the entries:\n  nm    known      M00 from        to  mean degree of polarization kept\n"
    );
    for (band, nm) in bands.iter().enumerate() {
        let (mut seen, mut known, mut low, mut high, mut kept) =
            (0_usize, 0_usize, f32::INFINITY, 0.0_f32, 0.0_f64);
        for i in (0..entries).step_by(step) {
            seen += 1;
            let Some(m) = table.entry([i / (d * h), i / h % d, i % h], band) else {
                continue;
            };
            known += 1;
            (low, high) = (low.min(m[0]), high.max(m[0]));
            // Depolarization index of Gil & Bernabéu (1985): 1 keeps all polarization, 0 none.
            let square: f64 = m.iter().map(|e| f64::from(*e).powi(2)).sum();
            let m00 = f64::from(m[0]).powi(2);
            kept += ((square - m00).max(0.0) / (3.0 * m00.max(1e-30))).sqrt();
        }
        let share = 100.0 * known as f64 / seen.max(1) as f64;
        let kept = kept / known.max(1) as f64;
        text += &format!("  {nm}  {share:5.1} %  {low:12.4e}  {high:12.4e}  {kept:.3}\n");
    }
    crate::cli::print(text.trim_end())
}

/// Draw a table's Mueller matrices over half angle and difference angle.
///
/// One 4×4 grid for each band: theta_h runs from left to right, theta_d from the bottom up, phi_d is fixed.
#[derive(clap::Args)]
pub struct PlotArguments {
    #[command(flatten)]
    source: Source,
    /// Azimuth difference, degrees (the nearest entry).
    #[arg(long, default_value_t = 90.0, allow_hyphen_values = true)]
    phi_d: f32,
    /// Picture to write.
    #[arg(short, long, default_value = "pbrdf.png", value_parser = crate::cli::figure::picture)]
    output: PathBuf,
}

/// The entry nearest to an angle in degrees.
fn nearest(nodes: &[f32], degrees: f32) -> usize {
    let distance = |i: &usize| (nodes[*i] - degrees.to_radians()).abs();
    (0..nodes.len())
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(0)
}

pub fn plot(a: &PlotArguments) -> Result<(), Failure> {
    let table = a.source.open()?;
    let [phi_d, theta_d, theta_h] = table.angles();
    let p = nearest(phi_d, a.phi_d);
    let grids: Vec<Grid> = table
        .wavelengths_nm()
        .iter()
        .enumerate()
        .map(|(band, nm)| Grid {
            label: format!("{nm} nm"),
            width: theta_h.len(),
            data: (0..theta_d.len() * theta_h.len())
                .map(|i| {
                    let d = theta_d.len() - 1 - i / theta_h.len();
                    table
                        .entry([p, d, i % theta_h.len()], band)
                        .unwrap_or([f32::NAN; 16])
                })
                .collect(),
        })
        .collect();
    let name = a.source.file.file_stem().unwrap_or_default().to_string_lossy();
    let title = format!("{name}, φd = {:.0}°", phi_d[p].to_degrees());
    let notes = [
        "Each panel: half angle θh from left to right, difference angle θd from the bottom up, both 0° to 90°.",
        "M00 (BRDF, 1/sr) is shown as intensity, white its 99th percentile; grey: not known.",
    ];
    let image = draw(&title, &grids, 3, &notes).map_err(Failure::input)?;
    crate::cli::figure::save(&image, &a.output)?;
    crate::cli::print(&a.output.display().to_string())
}

/// Write part of a table: angles and wavelength that are given are fixed (at their nearest entry), the others stay.
///
/// NAME.npy holds an array over the angles that stay, the wavelength if it stays, and 4×4 matrices (in this order);
/// NAME.csv has a row for each matrix. NaN marks what is not known.
#[derive(clap::Args)]
pub struct SliceArguments {
    #[command(flatten)]
    source: Source,
    /// Azimuth difference, degrees.
    #[arg(long, allow_hyphen_values = true)]
    phi_d: Option<f32>,
    /// Difference angle, degrees.
    #[arg(long)]
    theta_d: Option<f32>,
    /// Half angle, degrees.
    #[arg(long)]
    theta_h: Option<f32>,
    /// Band, nanometres.
    #[arg(short, long)]
    wavelength: Option<f32>,
    /// File to write: .npy or .csv.
    #[arg(short, long)]
    output: PathBuf,
}

pub fn slice(a: &SliceArguments) -> Result<(), Failure> {
    let table = a.source.open()?;
    let angles = table.angles();
    let fixed = [a.phi_d, a.theta_d, a.theta_h];
    let mut kept: Vec<Vec<usize>> = angles
        .iter()
        .zip(fixed)
        .map(|(nodes, at)| match at {
            Some(degrees) => vec![nearest(nodes, degrees)],
            None => (0..nodes.len()).collect(),
        })
        .collect();
    let bands = table.wavelengths_nm();
    let distance = |nm: f32| move |i: &usize| (f32::from(bands[*i]) - nm).abs();
    kept.push(match a.wavelength {
        Some(nm) => (0..bands.len())
            .min_by(|x, y| distance(nm)(x).total_cmp(&distance(nm)(y)))
            .into_iter()
            .collect(),
        None => (0..bands.len()).collect(),
    });
    let mut stays = vec![];
    for (list, at) in kept.iter().zip([fixed[0], fixed[1], fixed[2], a.wavelength]) {
        if at.is_none() {
            stays.push(list.len());
        }
    }
    match a.output.extension().and_then(|e| e.to_str()) {
        Some("npy") => npy(&table, &kept, &stays, &a.output),
        Some("csv") => csv(&table, &kept, &a.output),
        _ => return Err(Failure::input("the output must end in .npy or .csv")),
    }
    .map_err(|e| Failure::failed(format!("cannot write {}: {e}", a.output.display())))?;
    crate::cli::print(&a.output.display().to_string())
}

/// Every kept entry, last axis fastest: its four indices and its matrix.
fn entries<'a>(
    table: &'a Table,
    kept: &'a [Vec<usize>],
) -> impl Iterator<Item = ([usize; 4], [f32; 16])> + 'a {
    let count: usize = kept.iter().map(Vec::len).product();
    (0..count).map(move |mut i| {
        let mut at = [0; 4];
        for (place, list) in at.iter_mut().zip(kept).rev() {
            *place = list[i % list.len()];
            i /= list.len();
        }
        let m = table
            .entry([at[0], at[1], at[2]], at[3])
            .unwrap_or([f32::NAN; 16]);
        (at, m)
    })
}

fn npy(table: &Table, kept: &[Vec<usize>], stays: &[usize], path: &Path) -> std::io::Result<()> {
    let shape = [stays, &[4, 4]].concat();
    whole_file::write_with(path, |file| {
        numpy::write(file, &shape, entries(table, kept).flat_map(|(_, m)| m))
    })
}

fn csv(table: &Table, kept: &[Vec<usize>], path: &Path) -> std::io::Result<()> {
    whole_file::write_with(path, |file| {
        write!(file, "phi_d_deg,theta_d_deg,theta_h_deg,wavelength_nm")?;
        for i in 0..16 {
            write!(file, ",m{}{}", i / 4, i % 4)?;
        }
        writeln!(file)?;
        for (at, m) in entries(table, kept) {
            for (nodes, i) in table.angles().iter().zip(at) {
                // Single-precision radians hold an angle to about 1e-5 degrees.
                let degrees = f64::from(nodes[i]).to_degrees();
                write!(file, "{},", (degrees * 1e4).round() / 1e4)?;
            }
            write!(file, "{}", table.wavelengths_nm()[at[3]])?;
            for e in m {
                write!(file, ",{e}")?;
            }
            writeln!(file)?;
        }
        Ok(())
    })
}
