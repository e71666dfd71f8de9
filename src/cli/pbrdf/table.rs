//! The `sunstone pbrdf info`, `slice` and `plot` commands, which inspect a `.pbsdf` file.

use crate::{Failure, bail, places, print, print_path};
use std::io::Write;
use std::path::{Path, PathBuf};
use sunstone::base::spectral_table::nearest_within;
use sunstone::base::whole_file;
use sunstone::figure::save;
use sunstone::figure::sheet::{Grid, draw};
use sunstone::pbrdf::table_part::{TablePart, band_statistics, nearest_angle, statistics_step};
use sunstone::store::numpy;
use sunstone::transport::material::measured::table::{Options, Table};

#[derive(clap::Args)]
struct TableFile {
    /// Table in the KAIST format.
    file: PathBuf,
    /// Use evenly spaced angles if the axes in the file are empty.
    #[arg(long)]
    even_axes: bool,
}

impl TableFile {
    fn open(&self) -> Result<Table, Failure> {
        let options = Options { even_axes: self.even_axes, ..Options::default() };
        Table::open(&self.file, &options).map_err(|e| Failure::input(format!("{}: {e}", self.file.display())))
    }
}

/// Print the contents of a table.
#[derive(clap::Args)]
pub struct InfoArguments {
    #[command(flatten)]
    source: TableFile,
}

const ANGLES: [&str; 3] = ["phi_d", "theta_d", "theta_h"];

pub fn info(a: &InfoArguments) -> Result<(), Failure> {
    let table = a.source.open()?;
    let bands = table.wavelengths_nm();
    let mut text = format!("{}: {} bytes\n", a.source.file.display(), table.file_len());
    for (name, nodes) in ANGLES.iter().zip(table.angles()) {
        let (first, last) = (nodes[0].to_degrees(), nodes[nodes.len() - 1].to_degrees());
        text += &format!("  {name:8} {:4} entries, {first:.1}° to {last:.1}°\n", nodes.len());
    }
    text += &format!("  bands    {:4} entries, {bands:?} nm\n", bands.len());
    let of = if statistics_step(&table) == 1 { "all" } else { "a sample of" };
    text += &format!(
        "statistics over {of} entries:\n  nm    known      M00 from        to  mean depolarization index\n"
    );
    for band in band_statistics(&table) {
        let (nm, share, index) = (band.nm, 100.0 * band.known, band.depolarization_index);
        text += &format!("  {nm}  {share:5.1} %  {:12.4e}  {:12.4e}  {index:.3}\n", band.low, band.high);
    }
    print(text.trim_end())
}

/// Draw a table's Mueller matrices over half angle and difference angle.
///
/// Draws one 4×4 grid for each band: theta_h increases from left to right, theta_d from bottom to top, phi_d
/// is fixed.
#[derive(clap::Args)]
pub struct PlotArguments {
    #[command(flatten)]
    source: TableFile,
    /// Azimuth difference, degrees (the nearest entry).
    #[arg(long, default_value_t = 90.0, allow_hyphen_values = true)]
    phi_d: f32,
    /// Picture to write.
    #[arg(short, long, default_value = "pbrdf.png", value_parser = crate::figure::picture)]
    output: PathBuf,
}

pub fn plot(a: &PlotArguments) -> Result<(), Failure> {
    places::files([Some(&a.source.file)], [Some(&a.output)])?;
    let table = a.source.open()?;
    let [phi_d, theta_d, theta_h] = table.angles();
    within(&table, [Some(a.phi_d), None, None], None)?;
    let p = nearest_angle(phi_d, a.phi_d);
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
                    table.entry([p, d, i % theta_h.len()], band).unwrap_or([f32::NAN; 16])
                })
                .collect(),
        })
        .collect();
    let name = a.source.file.file_stem().unwrap_or_default().to_string_lossy();
    let title = format!("{name}, φd = {:.0}°", phi_d[p].to_degrees());
    let notes = [
        "Each panel: half angle θh left to right, difference angle θd bottom to top, both 0° to 90°.",
        "M00 (BRDF, 1/sr) is shown as intensity; white is its 99th percentile. Grey: unknown.",
    ];
    let image = draw(&title, &grids, 3, &notes).map_err(Failure::input)?;
    save(&image, &a.output)?;
    print_path(&a.output)
}

/// Write part of a table. Given angles and wavelengths are fixed at their nearest entries; the other axes are
/// kept.
///
/// NAME.npy contains an array over the kept angles, the wavelength if it is kept, and 4×4 matrices (in this
/// order). NAME.csv has a row for each matrix. Unknown values are NaN.
#[derive(clap::Args)]
pub struct SliceArguments {
    #[command(flatten)]
    source: TableFile,
    /// Azimuth difference, degrees.
    #[arg(long, allow_hyphen_values = true)]
    phi_d: Option<f32>,
    /// Difference angle, degrees.
    #[arg(long, allow_hyphen_values = true)]
    theta_d: Option<f32>,
    /// Half angle, degrees.
    #[arg(long, allow_hyphen_values = true)]
    theta_h: Option<f32>,
    /// Band, nanometres.
    #[arg(short, long)]
    wavelength: Option<f32>,
    /// File to write: .npy or .csv.
    #[arg(short, long)]
    output: PathBuf,
}

pub fn slice(a: &SliceArguments) -> Result<(), Failure> {
    places::files([Some(&a.source.file)], [Some(&a.output)])?;
    places::extension([&a.output], "parts of tables are", &["npy", "csv"])?;
    let table = a.source.open()?;
    within(&table, [a.phi_d, a.theta_d, a.theta_h], a.wavelength)?;
    let part = TablePart::new(&table, [a.phi_d, a.theta_d, a.theta_h], a.wavelength);
    let write = if a.output.extension().is_some_and(|e| e == "npy") { npy } else { csv };
    write(&table, &part, &a.output).map_err(Failure::writing(&a.output))?;
    print_path(&a.output)
}

/// Refuses angles (degrees) and wavelengths (nanometres) outside the range of a table.
fn within(table: &Table, degrees: [Option<f32>; 3], nm: Option<f32>) -> Result<(), Failure> {
    for ((name, nodes), wanted) in ANGLES.iter().zip(table.angles()).zip(degrees) {
        let (first, last) = (nodes[0].to_degrees(), nodes[nodes.len() - 1].to_degrees());
        if let Some(deg) = wanted.filter(|deg| !(first - 1.0..=last + 1.0).contains(deg)) {
            bail!(
                "--{} {deg}: the angle is outside the table's range of {first:.1}° to {last:.1}°",
                name.replace('_', "-")
            );
        }
    }
    let bands: Vec<f64> = table.wavelengths_nm().iter().copied().map(f64::from).collect();
    match nm.map(f64::from) {
        Some(nm) if nearest_within(&bands, nm).is_none() => {
            Err(Failure::input(format!("--wavelength {nm}: not in the table; available: {bands:?} nm")))
        }
        _ => Ok(()),
    }
}

fn npy(table: &Table, part: &TablePart, path: &Path) -> std::io::Result<()> {
    let shape = [&part.shape[..], &[4, 4]].concat();
    whole_file::write_with(path, |file| numpy::write(file, &shape, part.entries(table).flat_map(|(_, m)| m)))
}

fn csv(table: &Table, part: &TablePart, path: &Path) -> std::io::Result<()> {
    whole_file::write_with(path, |file| {
        write!(file, "phi_d_deg,theta_d_deg,theta_h_deg,wavelength_nm")?;
        for i in 0..16 {
            write!(file, ",m{}{}", i / 4, i % 4)?;
        }
        writeln!(file)?;
        for (at, m) in part.entries(table) {
            for (nodes, i) in table.angles().iter().zip(at) {
                // Single-precision radians resolve about 1e-5 degrees.
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
