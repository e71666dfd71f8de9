//! The `sunstone layers` command, which writes the ground truth of every camera pixel.

use crate::{Failure, bail, places, print};
use serde_json::{Map, json};
use std::path::PathBuf;
use std::time::Instant;
use sunstone::store::{npz_layers, zarr};
use sunstone::transport::render::layers::{Options, layers};
use tracing::info;

/// Maximum number of rays along each side of a pixel.
const MOST_RAYS: i64 = 64;

/// Write the ground truth of every camera pixel of a scene: depth, position, normals, object, material,
/// albedo.
///
/// Arrays over y, x: depth (metres along the ray from the pinhole, not along the axis), optical_length,
/// position (x, y, z), geometric_normal and shading_normal (world, toward the camera), object, copy (of a
/// group) and material as numbers with their names, albedo by wavelength (NaN for metals, glass, sheets and
/// measured tables, which have none), and coverage of the pixel by its object. A pixel's object is the one
/// that most of its rays hit. All other values are means over these rays, so objects are not mixed at edges.
/// Pixels without an object are -1 and NaN. No light is computed, so this takes seconds.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone layers scenes/mirror_room/scene.toml -o truth.npz     numpy.load('truth.npz')['depth']
  sunstone layers scene.toml -o truth.zarr                       xarray.open_zarr('truth.zarr')
  sunstone layers tank.toml --through -o behind.npz              what stands behind glass and in water")]
pub struct Arguments {
    /// Scene file (TOML).
    scene: PathBuf,
    /// Variant of the scene, if its file has [vary].
    #[arg(long)]
    variant: Option<u64>,
    /// File to write: .npz or .zarr.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Trace rays through smooth interfaces (glass, water, crystals), with refraction, and through sheets.
    #[arg(long)]
    through: bool,
    /// Number of rays along each side of a pixel: 4 gives 16 rays per pixel.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=MOST_RAYS))]
    rays: u32,
    /// Replace an existing .zarr store (a file is always replaced).
    #[arg(long)]
    force: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::extension([&a.output], "layers are", &["npz", "zarr"])?;
    let is_file = a.output.extension().is_some_and(|e| e == "npz");
    if is_file {
        places::files([Some(&a.scene)], [Some(&a.output)])?;
    } else {
        places::folders([Some(&a.scene)], [Some(&a.output)])?;
    }
    let shown = a.output.display();
    if !is_file && !a.force && std::fs::symlink_metadata(&a.output).is_ok() {
        bail!("{shown} exists; choose another output, or pass --force to replace the existing store");
    }
    let text = sunstone::scene::read(&a.scene)?;
    let scene = sunstone::scene::variant_from_text(&a.scene, &text, a.variant)?;
    for note in &scene.notes {
        eprintln!("note: {note}");
    }
    let begun = Instant::now();
    let options = Options { side: a.rays, through: a.through };
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
            ("source".to_owned(), json!(format!("sunstone {}", env!("CARGO_PKG_VERSION")))),
        ]);
        zarr::write_layers(&a.output, &set, &attributes, a.force)
            .map_err(|e| Failure::of_system(e.is_of_system(), e))?;
    }
    print(&shown.to_string())
}
