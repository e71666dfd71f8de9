//! `sunstone pbrdf sheet`: every material of a file as a sphere, as 4×4 Mueller grids on one page.

use crate::cli::failure::Failure;
use std::path::{Path, PathBuf};
use sunstone::figure::sheet::{Grid, draw};
use sunstone::render::{Target, Unwatched, render};
use sunstone::scene::materials::MaterialSet;
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::field::Field;

/// Render every material of a file as a sphere in a 4×4 Mueller grid, all on one page.
///
/// A projector to the right of the camera lights the sphere; smooth materials, which it cannot light, stand under an even
/// unpolarized sky instead.
#[derive(clap::Args)]
pub struct Arguments {
    /// File of materials.
    material: PathBuf,
    /// Picture to write.
    #[arg(short, long, default_value = "sheet.png", value_parser = crate::cli::figure::picture)]
    output: PathBuf,
    /// Wavelength to show, nanometres (the nearest there is).
    #[arg(short, long, default_value_t = 550.0)]
    wavelength: f64,
    /// Materials a row.
    #[arg(long, default_value_t = 5)]
    columns: usize,
    /// Pixels across each sphere's picture.
    #[arg(long, default_value_t = 72, value_parser = clap::value_parser!(u32).range(8..=1024))]
    size: u32,
    /// Samples per pixel.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    spp: u32,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let set = MaterialSet::load(&a.material)?;
    let grids: Result<Vec<Grid>, Failure> = set
        .names
        .iter()
        .map(|(name, id)| sphere(a, &set, name, *id))
        .collect();
    let nm = set.wavelengths.nm();
    let title = format!("Mueller matrices at {} nm", nm[nearest(nm, a.wavelength)]);
    let notes = [
        "Spheres lit by a projector 45° to the right of the camera and above it; rows of each grid: Stokes out, columns: Stokes in.",
        "M00 is shown as intensity on a scale of its own; grey: no light.",
    ];
    let image = draw(&title, &grids?, a.columns, &notes).map_err(Failure::input)?;
    crate::cli::figure::save(&image, &a.output)?;
    crate::cli::print(&a.output.display().to_string())
}

/// Lane of the wavelength nearest to the wanted one.
fn nearest(nm: &[f64], wanted: f64) -> usize {
    let distance = |lane: &usize| (nm[*lane] - wanted).abs();
    (0..nm.len())
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(0)
}

/// Renders one material. The scene's own materials only hold the places, so that those of the file, which may be large
/// tables, are read once.
fn sphere(a: &Arguments, set: &MaterialSet, name: &str, id: u32) -> Result<Grid, Failure> {
    let (light, depth) = if set.materials.has_extended_lobe(id) {
        let projector = "[projector]\nresolution = [8, 8]\nfov_x_deg = 60\nirradiance = 41\n\
                         pose.look_at = { origin = [4.2, 2.4, 4.2], target = [0, 0, 0] }";
        (projector, 2)
    } else {
        ("[[emitters]]\nenvironment.radiance = 1", 8)
    };
    let places: String = (0..set.materials.list.len())
        .map(|i| format!("m{i:06}.diffuse.albedo = 0\n"))
        .collect();
    let text = format!(
        "wavelengths_nm = {nm:?}\n[materials]\n{places}\
         [render]\nspp = {spp}\nmax_depth = {depth}\ntile = 16\n\
         [camera]\nresolution = [{size}, {size}]\nfov_x_deg = 20\n\
         pose.look_at = {{ origin = [0, 0, 6], target = [0, 0, 0] }}\n{light}\n\
         [[objects]]\nshape.sphere = {{}}\nmaterial = \"m{id:06}\"\n\
         [[slices]]\nname = \"mueller\"\npolarization = \"mueller\"\n",
        nm = set.wavelengths.nm(),
        spp = a.spp,
        size = a.size,
    );
    let mut scene = sunstone::scene::from_text(&a.material, &text)?;
    scene.set_materials(set.materials.clone());
    let folder = tempfile::tempdir().map_err(Failure::failed)?;
    let target = Target {
        path: folder.path().join("sphere"),
        ..Target::default()
    };
    render(&scene, &target, &Unwatched).map_err(Failure::failed)?;
    Ok(Grid {
        label: name.to_owned(),
        width: a.size as usize,
        data: matrices(&target.path, scene.wavelengths.nm(), a.wavelength)?,
    })
}

/// The Mueller matrices of the one slice at the wanted wavelength, row-major from the top.
fn matrices(store: &Path, nm: &[f64], wavelength: f64) -> Result<Vec<[f32; 16]>, Failure> {
    let store = TensorStore::open(store).map_err(Failure::failed)?;
    let slice = store.slice("mueller").map_err(Failure::failed)?;
    let mean = slice.read_all(Field::Mean).map_err(Failure::failed)?;
    let lanes = nm.len();
    let lane = nearest(nm, wavelength);
    // Axes of the slice: y, x, Stokes out, Stokes in, wavelength.
    let pixels = mean.data.chunks_exact(16 * lanes);
    Ok(pixels
        .map(|m| std::array::from_fn(|i| m[i * lanes + lane]))
        .collect())
}
