//! `sunstone layers`.

use super::failure::Failure;
use super::output::print;
use super::places;
use serde_json::{Map, json};
use std::path::PathBuf;
use std::time::Instant;
use sunstone::store::{npz_layers, zarr};
use sunstone::transport::render::layers::{Options, layers};
use tracing::info;

/// Most rays a pixel along each side.
const MOST_RAYS: i64 = 64;

/// Write what is in every camera pixel of a scene, which no lab knows: depth, position, normals, object, material, albedo.
///
/// Arrays over y, x: depth (metres along the ray from the pinhole, not along the axis), optical_length, position (x, y, z),
/// geometric_normal and shading_normal (world, toward the camera), object, copy (of a group) and material as numbers with their
/// names, albedo by wavelength (NaN of what has none: metals, glass, sheets, measured tables), coverage of the pixel by its object.
/// The object that most rays of a pixel meet counts, and all else is the mean over these, so that edges are not mixed; -1 and NaN
/// where there is nothing. No light is computed: it takes seconds.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone layers scenes/mirror_room/scene.toml -o truth.npz     numpy.load('truth.npz')['depth']
  sunstone layers scene.toml -o truth.zarr                       xarray.open_zarr('truth.zarr')
  sunstone layers tank.toml --through -o behind.npz              what stands behind glass and in water")]
pub struct Arguments {
    /// Scene file (TOML).
    scene: PathBuf,
    /// What to write: .npz or .zarr.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// See through smooth interfaces (glass, water, crystals), by rays bent as refraction bends them, and through sheets.
    #[arg(long)]
    through: bool,
    /// Rays a pixel along each side: 4 are 16 a pixel.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=MOST_RAYS))]
    rays: u32,
    /// Replace layers that are there already (.zarr; a file is replaced anyway).
    #[arg(long)]
    force: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::extension(&a.output, "layers are", &["npz", "zarr"])?;
    let is_file = a.output.extension().is_some_and(|e| e == "npz");
    if is_file {
        places::files([Some(&a.scene)], [Some(&a.output)])?;
    } else {
        places::folders([Some(&a.scene)], [Some(&a.output)])?;
    }
    let shown = a.output.display();
    if !is_file && !a.force && std::fs::symlink_metadata(&a.output).is_ok() {
        return Err(Failure::input(format!(
            "{shown} exists; choose another name, or pass --force to replace it"
        )));
    }
    let scene = sunstone::scene::load(&a.scene)?;
    for note in &scene.notes {
        eprintln!("note: {note}");
    }
    let begun = Instant::now();
    let options = Options {
        side: a.rays,
        through: a.through,
    };
    let set = layers(&scene, options);
    info!("{} rays per pixel in {:.2?}", a.rays * a.rays, begun.elapsed());
    if is_file {
        npz_layers::write_npz(&a.output, &set).map_err(|e| Failure::failed(format!("{shown}: {e}")))?;
    } else {
        let attributes = Map::from_iter([
            ("title".to_owned(), json!(scene.name)),
            ("scene_sha256".to_owned(), json!(scene.sha256)),
            ("rays_per_pixel".to_owned(), json!(a.rays * a.rays)),
            ("through_interfaces".to_owned(), json!(a.through)),
            (
                "source".to_owned(),
                json!(format!("sunstone {}", env!("CARGO_PKG_VERSION"))),
            ),
        ]);
        zarr::write_layers(&a.output, &set, &attributes, a.force)
            .map_err(|e| Failure::of_system(e.is_of_system(), e))?;
    }
    print(&shown.to_string())
}
