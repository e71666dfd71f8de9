//! The `sunstone phase` command, which prints the scattering of participating media.

use crate::source::choose;
use crate::{Failure, bail, places, print, print_path};
use std::fmt::Write;
use std::path::PathBuf;
use std::str::FromStr;
use sunstone::base::whole_file;
use sunstone::optics::spectrum::Wavelengths;
use sunstone::pbrdf::phase::{PhaseTable, tables};
use sunstone::scene::media;

/// Inspect the scattering of participating media.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

commands! {
    Eval(EvalArguments) => eval,
}

/// Print the scattering matrix of a medium over the scattering angle, as CSV.
///
/// MEDIUM.toml contains `[media]` as in a scene file, and `wavelengths_nm` unless they are 450, 550, 660. The
/// matrix is the one that the renderer uses, per steradian, with S11 normalized to the integral 1 over the
/// sphere. The first axis of both Stokes frames is perpendicular to the scattering plane: S12 = M01 = M10 is
/// positive for light polarized perpendicular to that plane, and S34 = M23 = -M32. Lines that begin with #
/// give, for each wavelength, the refractive index of the host, the scattering and absorption coefficients in
/// 1/m, the mean cosine g, and the mean cross sections of a particle in m² (0 for media without particles).
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone phase eval milk.toml
  sunstone phase eval beads.toml --wavelengths 633 --angles 1801 -o beads.csv
  sunstone phase eval scene_media.toml --name fog --angles 0,30,90,180")]
struct EvalArguments {
    /// File of media.
    medium: PathBuf,
    /// Name of the medium, if the file has several.
    #[arg(long)]
    name: Option<String>,
    /// Vacuum wavelengths in nanometres, any number of them; spectra of the file are interpolated.
    #[arg(long, value_name = "NM,…", value_delimiter = ',')]
    wavelengths: Vec<f64>,
    /// Scattering angles: their number from 0 to 180°, or a list in degrees.
    #[arg(long, value_name = "N | DEG,…", default_value = "181")]
    angles: Angles,
    /// CSV file to write instead of printing.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

#[derive(Clone, Debug)]
struct Angles(Vec<f64>);

impl FromStr for Angles {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(count) = text.trim().parse::<usize>() {
            return match count {
                2..=1_000_000 => {
                    let step = 180.0 / (count - 1) as f64;
                    Ok(Self((0..count).map(|i| i as f64 * step).collect()))
                }
                _ => Err(format!(
                    "expected 2 to 1000000 angles, got {count}; for a list of one angle write `{count},`"
                )),
            };
        }
        let items = text.split(',').filter(|t| !t.trim().is_empty());
        let degrees: Result<Vec<f64>, String> = items
            .map(|t| match t.trim().parse::<f64>() {
                Ok(v) if (0.0..=180.0).contains(&v) => Ok(v),
                _ => Err(format!("`{t}`: expected an angle from 0 to 180 degrees")),
            })
            .collect();
        match degrees? {
            degrees if degrees.is_empty() => Err("expected at least one angle".into()),
            degrees => Ok(Self(degrees)),
        }
    }
}

fn eval(a: &EvalArguments) -> Result<(), Failure> {
    places::files([Some(&a.medium)], [a.output.as_ref()])?;
    places::extension(&a.output, "tables are", &["csv"])?;
    // One wavelength at a time allows any number of wavelengths in any order.
    let each = |nm: &f64| Wavelengths::new(vec![*nm]);
    let wavelengths: Vec<Wavelengths> = (a.wavelengths.iter().map(each).collect::<Result<_, _>>())
        .map_err(|e| Failure::input(format!("--wavelengths: {e}")))?;
    let names = media::names(&a.medium)?;
    if names.is_empty() {
        let file = a.medium.display();
        bail!("{file} has no medium; add a table [media.NAME.KIND], such as [media.drink.milk]");
    }
    let name = choose(&a.medium, ["medium", "media"], &names, a.name.as_deref())?;
    let mut head = format!(
        "# medium {name}: wavelength_nm,host_index,scattering_per_m,absorption_per_m,g,scattering_cross_section_m2,\
         absorption_cross_section_m2\n"
    );
    let mut rows = String::new();
    for table in tables(&a.medium, &name, &wavelengths, &a.angles.0)? {
        write_rows(&table, &a.angles.0, &mut head, &mut rows);
    }
    let text = format!("{head}angle_deg,wavelength_nm,S11,S12,S22,S33,S34,S44\n{rows}");
    let Some(path) = &a.output else {
        return print(text.trim_end());
    };
    whole_file::write_with(path, |file| std::io::Write::write_all(file, text.as_bytes()))
        .map_err(Failure::writing(path))?;
    print_path(path)
}

/// Appends the comment lines and the rows of a medium at one wavelength.
fn write_rows(table: &PhaseTable, degrees: &[f64], head: &mut String, rows: &mut String) {
    let _ = writeln!(
        head,
        "# {},{},{:e},{:e},{},{:e},{:e}",
        table.nm,
        table.index,
        table.scattering,
        table.absorption,
        table.asymmetry,
        table.scattering_cross_section,
        table.absorption_cross_section
    );
    for (deg, elements) in degrees.iter().zip(&table.elements) {
        let [s11, s12, s22, s33, s34, s44] = elements.map(|e| plain(e, elements[0]));
        let _ = writeln!(rows, "{deg},{},{s11},{s12},{s22},{s33},{s34},{s44}", table.nm);
    }
}

/// Formats an element in shortest decimal form. Rounding errors far below S11 become 0.
fn plain(element: f32, s11: f32) -> String {
    if element.abs() <= 1e-9 * s11 { "0".into() } else { format!("{element:e}") }
}
