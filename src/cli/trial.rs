//! `sunstone trial`: capture schemes against each other, on matrices that are known.

use super::capture::{NoiseArguments, typical_noise};
use super::failure::Failure;
use super::matrices::{MatrixSource, Target};
use nalgebra::DMatrix;
use report::{Row, csv, curve, short, table};
use std::io::Write;
use std::path::PathBuf;
use sunstone::base::whole_file;
use sunstone::figure::{chart, maps as error_maps};
use sunstone::polarimetry::capture::design_matrix::DesignMatrix;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::polarimetry::capture::scheme_file::load;
use sunstone::polarimetry::capture::simulate::{Captured, Layout, Noise, averaged, simulate};
use sunstone::polarimetry::reconstruct::loss::Moment;
use sunstone::polarimetry::reconstruct::pixels::{Options, Reconstruction};
use sunstone::polarimetry::reconstruct::second_moment;

mod report;

/// Try capture schemes in simulation: capture known Mueller matrices, reconstruct them, and compare.
///
/// Captures as `sunstone capture` does and reconstructs as `sunstone reconstruct` does, with the variances where a camera states
/// them. The stored matrices count as the truth. Schemes that do not determine a matrix use the prior if one is given, and else
/// the matrix of least norm among those that explain the captures.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone trial out/mirror_room.zarr polarimetric --scheme drr36.toml --scheme lqrpr36.toml --relative-noise 5e-4
  sunstone trial M.npy --scheme drr36.toml --scheme drr9p.toml --detector camera.toml --repeat 10 -o trial.csv
  sunstone trial out/mirror_room.zarr polarimetric -k wavelength=550 --scheme lqrpr8.toml --prior prior.toml \\
      --relative-noise 0.01 --figure errors.png

Columns: predicted, what the closed form σ √(tr (AᵀA)⁻¹ / 16) says; RMSE, the root mean square error of all 16 elements; both
over the mean T00. ΔTij/T00: mean absolute error of the 15 normalized elements, where T00 is above a tenth of its mean.")]
pub struct Arguments {
    #[command(flatten)]
    from: MatrixSource,
    /// Scheme to try. Repeatable.
    #[arg(long = "scheme", required = true, value_name = "SCHEME")]
    schemes: Vec<PathBuf>,
    /// Wavelengths of the last axis before the matrices of an array, nanometres. Without them there is one, 550.
    #[arg(long, value_delimiter = ',')]
    wavelengths: Vec<f64>,
    #[command(flatten)]
    noise: NoiseArguments,
    /// Second moment of matrices (.toml) to expect, for schemes below rank 16.
    #[arg(long, value_name = "PRIOR.toml")]
    prior: Option<PathBuf>,
    /// How often every scheme is tried, with seeds that follow one another.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    repeat: u32,
    /// Table to write.
    #[arg(short, long, value_name = "TABLE.csv")]
    output: Option<PathBuf>,
    /// Picture of each scheme's errors, pixel by pixel, of the first try.
    #[arg(long, value_name = "MAPS.png|.svg|.pdf", value_parser = super::figure::picture)]
    figure: Option<PathBuf>,
    /// Chart of the errors against the number of captures, a line for each kind of scheme (its name without the number).
    #[arg(long, value_name = "CURVE.png|.svg|.pdf", value_parser = super::figure::picture)]
    curve: Option<PathBuf>,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let prior = a.prior.as_deref().map(second_moment::load).transpose()?;
    let mut schemes = vec![];
    for path in &a.schemes {
        schemes.push(load(path)?);
    }
    let matrices = a
        .from
        .read("trial", &format!("--scheme {}", a.schemes[0].display()))?;
    let target = Target::new(matrices, &a.wavelengths)?;
    if !(target.mean() > 0.0 && target.mean().is_finite()) {
        return Err(Failure::input(
            "the mean T00 of the matrices is not positive, so no error is relative to it",
        ));
    }
    let noise = a.noise.resolve(&target)?;
    let (mut rows, mut maps) = (vec![], vec![]);
    for scheme in &schemes {
        let (row, map) = attempt(a, &target, scheme, &noise, prior.as_ref())?;
        maps.push(error_maps::Map {
            label: row.name.clone(),
            caption: format!("RMSE {}", short(row.rmse)),
            ..map
        });
        rows.push(row);
    }
    super::print(table(&rows).trim_end())?;
    if let Some(path) = &a.output {
        let text = csv(&rows).map_err(Failure::failed)?;
        whole_file::write_with(path, |file| file.write_all(&text))
            .map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
    }
    if let Some(path) = &a.figure {
        let note =
            "√(Σ ΔTij²) over the mean T00 of all pixels, root mean square over wavelengths. Grey: lost.";
        let columns = (maps.len() as f64).sqrt().ceil() as usize;
        let quantity = "error / mean T00";
        let image = error_maps::draw(
            "Errors of reconstruction",
            &maps,
            columns,
            quantity,
            error_maps::Quantity::Size,
            &[note.to_owned()],
        );
        super::figure::save(&image?, path)?;
    }
    if let Some(path) = &a.curve {
        let image = chart::draw(&curve(&rows))?;
        super::figure::save(&image, path)?;
    }
    for path in [&a.output, &a.figure, &a.curve].into_iter().flatten() {
        super::print(&path.display().to_string())?;
    }
    Ok(())
}

/// All tries of a scheme, and the errors of the first in a map without a name.
fn attempt(
    a: &Arguments,
    target: &Target,
    scheme: &Scheme,
    noise: &Noise,
    prior: Option<&Moment>,
) -> Result<(Row, error_maps::Map), Failure> {
    let designs: Vec<DesignMatrix> = target
        .rays
        .iter()
        .map(|ray| DesignMatrix::new(scheme, ray))
        .collect();
    let rank = designs.iter().map(DesignMatrix::rank).min().unwrap_or(0);
    let lanes = designs.len() as f64;
    let variance = designs
        .iter()
        .map(|d| d.error_variance().ok())
        .sum::<Option<f64>>();
    let mut seen: Vec<Compared> = vec![];
    let (mut method, mut predicted, mut map) = ("", None, None);
    for i in 0..a.repeat {
        let seed = a.noise.seed.wrapping_add(u64::from(i));
        let captured = simulate(&target.matrices, target.layout, scheme, &target.rays, noise, seed)
            .map_err(Failure::input)?;
        let truth = averaged(&target.matrices, target.layout, captured.layout);
        let found = if rank == 16 || prior.is_some() {
            let below = prior.filter(|_| rank < 16);
            method = if below.is_some() { "prior" } else { "least squares" };
            estimated(target, scheme, noise, &captured, below)?
        } else {
            method = "minimum norm";
            least_norm(&designs, &captured)
        };
        let compared = compare(&truth, &found);
        if let (None, Noise::Gaussian { sigma }) = (predicted, noise) {
            predicted = variance.map(|v| sigma * (v / lanes / 16.0).sqrt() / compared.mean);
        }
        map.get_or_insert_with(|| error_map(&truth, &found, captured.layout, compared.mean));
        seen.push(compared);
    }
    let n = seen.len() as f64;
    let mean = |of: fn(&Compared) -> f64| seen.iter().map(of).sum::<f64>() / n;
    let rmse = mean(|c| c.rmse);
    let scatter = seen.iter().map(|c| (c.rmse - rmse).powi(2)).sum::<f64>();
    let row = Row {
        name: scheme.name.clone(),
        captures: scheme.captures(),
        rank,
        condition: designs.iter().map(DesignMatrix::condition).fold(0.0, f64::max),
        method,
        predicted,
        rmse,
        rmse_error: (scatter / (n - 1.0) / n).sqrt(),
        normalized: mean(|c| c.normalized),
        lost: mean(|c| c.lost),
    };
    map.map(|map| (row, map))
        .ok_or_else(|| Failure::failed("nothing was tried"))
}

/// What `sunstone reconstruct` makes of captures.
fn estimated(
    target: &Target,
    scheme: &Scheme,
    noise: &Noise,
    captured: &Captured,
    prior: Option<&Moment>,
) -> Result<Vec<f32>, Failure> {
    let typical = typical_noise(noise, captured).filter(|s| *s > 0.0);
    if prior.is_some() && typical.is_none() && !matches!(noise, Noise::None) {
        return Err(Failure::input(
            "--prior weighs what is expected against the noise, which a [spad] does not state; give --noise or a [cmos]",
        ));
    }
    let options = Options {
        noise: typical,
        prior: prior.copied(),
        ..Options::default()
    };
    let reconstruction = Reconstruction::<f32>::new(scheme, &target.rays, options).map_err(Failure::input)?;
    let mut out = vec![0.0; captured.layout.pixels() * 16];
    reconstruction.apply(
        &captured.intensities,
        captured.variances.as_deref(),
        &mut out,
        None,
    );
    Ok(out)
}

/// The matrices of least norm that explain the captures.
fn least_norm(designs: &[DesignMatrix], captured: &Captured) -> Vec<f32> {
    let weights: Vec<DMatrix<f64>> = designs.iter().map(DesignMatrix::minimum_norm).collect();
    let pixels = captured.layout.pixels();
    let one = |p: usize| -> [f32; 16] {
        let w = &weights[p % weights.len()];
        let at = |m: usize| f64::from(captured.intensities[m * pixels + p]);
        std::array::from_fn(|e| (0..w.ncols()).map(|m| w[(e, m)] * at(m)).sum::<f64>() as f32)
    };
    (0..pixels).flat_map(one).collect()
}

/// One try against the truth.
struct Compared {
    /// Mean T00 of the truth.
    mean: f64,
    rmse: f64,
    normalized: f64,
    lost: f64,
}

/// Pairs of true and found matrices, of pixels whose truth is known.
fn pairs<'a>(truth: &'a [f64], found: &'a [f32]) -> impl Iterator<Item = (&'a [f64], &'a [f32])> {
    let all = truth.chunks_exact(16).zip(found.chunks_exact(16));
    all.filter(|(t, _)| t.iter().all(|v| v.is_finite()))
}

fn is_found(m: &[f32]) -> bool {
    m.iter().all(|v| v.is_finite())
}

fn squared(t: &[f64], m: &[f32]) -> f64 {
    t.iter().zip(m).map(|(t, m)| (f64::from(*m) - t).powi(2)).sum()
}

fn compare(truth: &[f64], found: &[f32]) -> Compared {
    let (n, sum) = pairs(truth, found).fold((0.0, 0.0), |(n, sum), (t, _)| (n + 1.0, sum + t[0]));
    let mean = sum / n;
    let (mut known, mut squares) = (0.0, 0.0);
    let (mut lit, mut off) = (0.0, 0.0);
    for (t, m) in pairs(truth, found).filter(|(_, m)| is_found(m)) {
        known += 1.0;
        squares += squared(t, m);
        if t[0] > 0.1 * mean && m[0] > 0.0 {
            lit += 1.0;
            let of = |e: usize| (f64::from(m[e]) / f64::from(m[0]) - t[e] / t[0]).abs();
            off += (1..16).map(of).sum::<f64>() / 15.0;
        }
    }
    Compared {
        mean,
        rmse: (squares / known / 16.0).sqrt() / mean,
        normalized: off / lit,
        lost: 1.0 - known / n,
    }
}

/// √(Σ ΔT²) over mean T00 at every place, root mean square over what else there is.
fn error_map(truth: &[f64], found: &[f32], layout: Layout, mean: f64) -> error_maps::Map {
    let inner = layout.times * layout.lanes;
    let places = truth.chunks_exact(16 * inner).zip(found.chunks_exact(16 * inner));
    let data = places.map(|(t, m)| ((squared(t, m) / inner as f64).sqrt() / mean) as f32);
    error_maps::Map {
        label: String::new(),
        caption: String::new(),
        width: layout.width,
        data: data.collect(),
    }
}
