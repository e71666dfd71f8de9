//! The `sunstone pbrdf pca` command, which computes principal components of a folder of tables or of the
//! stand-ins.

use super::data::MaterialSource;
use crate::{Failure, bail, places, print, print_paths};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use sunstone::figure::components::{Map, draw};
use sunstone::figure::save;
use sunstone::polarimetry::reconstruct::pca::components::Components;
use sunstone::polarimetry::reconstruct::pca::data_set::{DataSet, Settings, Weight};
use sunstone::polarimetry::reconstruct::second_moment;
use sunstone::store::numpy::{NumpyArray, Values, write_npz};

/// Compute the principal components of the Mueller matrices of measured materials.
///
/// Divides every matrix of every table by its M00 and maps it by arctan(c M), c = 8, after Baek & Heide 2021.
/// Decomposes the matrices minus their mean by singular values. Draws the mean and the first components, each
/// scaled to one standard deviation of the materials along it, and prints the share of the variance that each
/// explains. Without a folder, uses the stand-ins for the 25 materials of the KAIST set.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone pbrdf pca -o components.png                         of the stand-ins
  sunstone pbrdf pca --data pbrdf_tables --npz components.npz  numpy.load('components.npz')['components']
  sunstone pbrdf pca --data pbrdf_tables --map none -n 12
  sunstone pbrdf pca --prior prior.toml                        for sunstone reconstruct --prior")]
pub struct Arguments {
    #[command(flatten)]
    data: MaterialSource,
    /// Picture to write.
    #[arg(short, long, default_value = "components.png", value_parser = crate::figure::picture)]
    output: PathBuf,
    /// Also write arrays: mean (4, 4); spectrum (16), the singular values; share (16) of the variance;
    /// components (16, 4, 4), as drawn; vectors (16, 4, 4), the components with unit length.
    #[arg(long, value_name = "X.npz")]
    npz: Option<PathBuf>,
    /// Also write the second moment of the matrices (M / M00, not mapped), for `sunstone reconstruct
    /// --prior`.
    #[arg(long, value_name = "PRIOR.toml")]
    prior: Option<PathBuf>,
    /// Mapping of the matrices.
    #[arg(long, value_enum, default_value_t)]
    map: Mapping,
    /// The c of arctan(c M).
    #[arg(short, default_value_t = Settings::default().c)]
    c: f64,
    /// Number of components to draw.
    #[arg(short = 'n', long = "components", default_value_t = 6, value_parser = clap::value_parser!(u8).range(1..=16))]
    count: u8,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum Mapping {
    /// None: M / M00 itself.
    None,
    /// arctan(c M / M00), which expands small elements.
    #[default]
    Arctan,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::files([a.data.folder()], [Some(&a.output), a.npz.as_ref(), a.prior.as_ref()])?;
    places::extension(&a.npz, "arrays are", &["npz"])?;
    places::extension(&a.prior, "priors are", &["toml"])?;
    if !(1e-6..=1e6).contains(&a.c) {
        bail!("-c: expected a number from 1e-6 to 1e6, got {}", a.c);
    }
    let data = a.data.load_mapped(a.c, 0)?;
    let moments = match a.map {
        Mapping::None => data.plain(Weight::Bins),
        Mapping::Arctan => data.mapped(Weight::Bins),
    };
    let Some(components) = Components::of(&moments) else {
        return Err(Failure::failed(
            "cannot compute the principal components: the matrix elements are too large",
        ));
    };
    let quantity = match a.map {
        Mapping::None => "Mij / M00".to_owned(),
        Mapping::Arctan => format!("arctan({} Mij / M00)", a.c),
    };
    picture(a, &data, &components, &quantity)?;
    if let Some(path) = &a.npz {
        arrays(path, &components).map_err(Failure::writing(path))?;
    }
    if let Some(path) = &a.prior {
        second_moment::save(path, &a.data.name(), &a.data.frames().second_moment(&data.plain(Weight::Bins)))
            .map_err(Failure::writing(path))?;
    }
    print(table(&data, &components, &quantity).trim_end())?;
    print_paths([Some(&a.output), a.npz.as_ref(), a.prior.as_ref()].into_iter().flatten())
}

/// Returns the cumulative shares of variance of the first components.
fn together(share: &[f64; 16]) -> impl Iterator<Item = f64> {
    share.iter().scan(0.0, |sum, share| {
        *sum += share;
        Some(*sum)
    })
}

fn table(data: &DataSet, c: &Components, quantity: &str) -> String {
    let tally = data.tally();
    let mut text = format!(
        "{quantity} of {} materials, {} bins; excluded bins: {} without values, {} without light, {} with elements larger than \
         M00\ncomponent  singular value  explained  cumulative\n",
        data.materials.len(),
        tally.valid,
        tally.holes,
        tally.dark,
        tally.unreal
    );
    for ((k, sum), (sigma, share)) in (1..).zip(together(&c.share)).zip(c.spectrum.iter().zip(&c.share)) {
        let _ = writeln!(text, "{k:9}  {sigma:14.4}  {:7.3} %  {:7.3} %", 100.0 * share, 100.0 * sum);
    }
    text
}

fn picture(a: &Arguments, data: &DataSet, c: &Components, quantity: &str) -> Result<(), Failure> {
    let count = usize::from(a.count);
    let mean = Map {
        label: "mean".into(),
        caption: format!("over {} materials", data.materials.len()),
        values: c.mean,
    };
    let component = |(k, sum): (usize, f64)| Map {
        label: format!("component {}", k + 1),
        caption: format!("{:.2} %, cumulative {:.2} %", 100.0 * c.share[k], 100.0 * sum),
        values: c.scaled[k],
    };
    let shown = together(&c.share).enumerate().take(count).map(component);
    let maps: Vec<Map> = std::iter::once(mean).chain(shown).collect();
    let notes = [
        "Components scaled by their standard deviation over all bins, with the fraction of the variance they explain. Rows: outgoing \
         Stokes; columns: incoming Stokes. One scale for all."
            .to_owned(),
        format!(
            "{} bins of {} materials at {:?} nm.",
            data.tally().valid,
            data.materials.len(),
            a.data.bands()
        ),
    ];
    let image = draw("Principal components of Mueller matrices", &maps, 4, quantity, &notes)
        .map_err(Failure::input)?;
    Ok(save(&image, &a.output)?)
}

fn arrays(path: &Path, c: &Components) -> std::io::Result<()> {
    let array = |name: &str, shape: &[usize], values: &[f64]| {
        let array = NumpyArray { shape: shape.to_vec(), values: Values::Double(values.to_vec()) };
        (name.to_owned(), array)
    };
    write_npz(
        path,
        &[
            array("mean", &[4, 4], &c.mean),
            array("spectrum", &[16], &c.spectrum),
            array("share", &[16], &c.share),
            array("components", &[16, 4, 4], c.scaled.as_flattened()),
            array("vectors", &[16, 4, 4], c.vectors.as_flattened()),
        ],
    )
}
