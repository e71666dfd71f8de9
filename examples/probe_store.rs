//! Renders two slices of the mirror room into a store, and probes the store. The probes return the light of
//! one projector column and a Stokes image.
//!
//! `cargo run --release --example probe_store`

use std::error::Error;
use sunstone::{Field, Pattern, Probe, Render, Store, scene};

fn main() -> Result<(), Box<dyn Error>> {
    let mut room = scene::load("scenes/mirror_room/scene.toml".as_ref())?;
    room.change_slices(|all| all.retain(|s| ["ss", "polarimetric"].contains(&s.name.as_str())));
    room.change_settings(|s| s.spp = 4);
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("room.zarr");
    let summary = Render::new(&room).to_store(&path)?;
    println!("{} samples in {:.1} s", summary.samples, summary.wall_s);

    let store = Store::open(&path)?;
    for name in store.slice_names() {
        let layout = store.slice(name)?.layout().clone();
        let axes: Vec<String> =
            layout.axes.iter().map(|a| format!("{} {}", a.kind.name(), a.len())).collect();
        println!("{name}: {}", axes.join(" x "));
    }

    // Computes I = T P for a pattern P in which one column of the projector is on.
    let mut drive = Pattern::uniform(256, 256, 0.0);
    drive.values.iter_mut().skip(100).step_by(256).for_each(|p| *p = 1.0);
    let stripe = Probe { pattern: Some(drive), ..Probe::default() };
    let lit = stripe.run(&store.slice("ss")?)?;
    println!("column 100 alone: shape {:?}", lit.mean.shape());

    // Computes the Stokes image under horizontally polarized light, and its standard error.
    let horizontal = Probe { stokes: Some([1.0, 1.0, 0.0, 0.0]), ..Probe::default() };
    let stokes = horizontal.run(&store.slice("polarimetric")?)?;
    let truth = store.slice("polarimetric")?.read_all(Field::Mean)?;
    println!("shape {:?} from {:?}", stokes.mean.shape(), truth.shape());
    let finite = stokes.std_error.data.iter().filter(|e| e.is_finite()).count();
    println!("{finite} standard errors");
    Ok(())
}
