//! The `sunstone pbrdf sheet` command, which renders each material of a file as a sphere. One page shows the
//! spheres as 4×4 Mueller grids.

use crate::{Failure, bail, print_path};
use std::path::{Path, PathBuf};
use sunstone::base::spectral_table;
use sunstone::figure::save;
use sunstone::figure::sheet::{Grid, draw};
use sunstone::render::{Target, Unwatched, render};
use sunstone::scene::materials::MaterialSet;
use sunstone::scene::{Camera, Emitter, Material, Object, Projector, SceneBuilder, Slice};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::field::Field;

/// Render every material of a file as a sphere in a 4×4 Mueller grid, all on one page.
///
/// A projector to the right of the camera lights the sphere. Smooth materials, which it cannot light, are
/// rendered under a uniform unpolarized sky instead.
#[derive(clap::Args)]
pub struct Arguments {
    /// File of materials.
    material: PathBuf,
    /// Picture to write.
    #[arg(short, long, default_value = "sheet.png", value_parser = crate::figure::picture)]
    output: PathBuf,
    /// Wavelength to show, nanometres (the nearest available).
    #[arg(short, long, default_value_t = 550.0, value_parser = crate::places::wavelength)]
    wavelength: f64,
    /// Number of materials per row.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    columns: u16,
    /// Width of each sphere's picture in pixels.
    #[arg(long, default_value_t = 72, value_parser = clap::value_parser!(u32).range(8..=1024))]
    size: u32,
    /// Samples per pixel.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    spp: u32,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    crate::places::files([Some(&a.material)], [Some(&a.output)])?;
    let set = MaterialSet::load(&a.material)?;
    if spectral_table::nearest_within(set.wavelengths.nm(), a.wavelength).is_none() {
        bail!(
            "--wavelength {}: not available; the materials are given at {:?} nm",
            a.wavelength,
            set.wavelengths.nm()
        );
    }
    let grids: Result<Vec<Grid>, Failure> =
        set.names.iter().map(|(name, id)| sphere(a, &set, name, *id)).collect();
    let nm = set.wavelengths.nm();
    let title = format!("Mueller matrices at {} nm", nm[nearest(nm, a.wavelength)]);
    let notes = [
        "Spheres lit by a projector 45° to the right of the camera and above it. Rows of each grid: outgoing Stokes; columns: incoming \
         Stokes.",
        "M00 is shown as intensity on its own scale. Grey: no light.",
    ];
    let image = draw(&title, &grids?, a.columns.into(), &notes).map_err(Failure::input)?;
    save(&image, &a.output)?;
    print_path(&a.output)
}

/// Returns the index of the wavelength nearest to `wanted`, in nanometres.
fn nearest(nm: &[f64], wanted: f64) -> usize {
    spectral_table::nearest(nm, wanted).unwrap_or(0)
}

/// Returns the name of placeholder material `id`. The alphabetical order of the names is the numerical order.
fn place(id: u32) -> String {
    format!("m{id:06}")
}

/// Renders a sphere of one material. The scene contains only placeholder materials, so that the
/// file's materials, which can be large tables, are read only once.
fn sphere(a: &Arguments, set: &MaterialSet, name: &str, id: u32) -> Result<Grid, Failure> {
    let camera = Camera::look_at([0.0, 0.0, 6.0], [0.0; 3]);
    let mut builder = SceneBuilder::new()
        .wavelengths_nm(set.wavelengths.nm())
        .spp(a.spp)
        .tile(16)
        .camera(camera.resolution(a.size, a.size).fov_x_deg(20.0))
        .object(Object::sphere([0.0; 3], 1.0).material(place(id)))
        .slice(Slice::new("mueller").mueller());
    for i in 0..set.materials.list.len() as u32 {
        builder = builder.material(place(i), Material::diffuse(0.0));
    }
    let light = Camera::look_at([4.2, 2.4, 4.2], [0.0; 3]);
    let light = Projector::new(light.resolution(8, 8).fov_x_deg(60.0));
    let builder = if set.materials.has_extended_lobe(id) {
        builder.projector(light.irradiance(41.0)).max_depth(2)
    } else {
        builder.emitter(Emitter::environment(1.0)).max_depth(8)
    };
    let mut scene = builder.build()?;
    scene.set_materials(set.materials.clone());
    let folder = tempfile::tempdir().map_err(Failure::failed)?;
    let target = Target { path: folder.path().join("sphere"), ..Target::default() };
    render(&scene, &target, &Unwatched).map_err(Failure::failed)?;
    Ok(Grid {
        label: name.to_owned(),
        width: a.size as usize,
        data: matrices(&target.path, scene.wavelengths.nm(), a.wavelength)?,
    })
}

/// Returns the Mueller matrices of a store's only slice at the wavelength nearest to `wavelength`, row-major
/// from the top.
fn matrices(store: &Path, nm: &[f64], wavelength: f64) -> Result<Vec<[f32; 16]>, Failure> {
    let store = TensorStore::open(store).map_err(Failure::failed)?;
    let slice = store.slice("mueller").map_err(Failure::failed)?;
    let mean = slice.read_all(Field::Mean).map_err(Failure::failed)?;
    let lanes = nm.len();
    let lane = nearest(nm, wavelength);
    // Axes of the slice: y, x, Stokes out, Stokes in, wavelength.
    let pixels = mean.data.chunks_exact(16 * lanes);
    Ok(pixels.map(|m| std::array::from_fn(|i| m[i * lanes + lane])).collect())
}
