//! Builds a scene in code and renders it into arrays, without any file. The scene contains a gold sphere in
//! front of a wall, and a projector.
//!
//! `cargo run --release --example scene_in_code`

use sunstone::{AxisKind, Camera, Field, Material, Object, Projector, Render, SceneBuilder, Slice};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let light = Camera::look_at([1.0, 1.0, 3.0], [0.0; 3]).fov_x_deg(50.0).resolution(64, 64);
    let scene = SceneBuilder::new()
        .camera(Camera::look_at([0.0, 0.5, 3.0], [0.0; 3]).fov_x_deg(45.0).resolution(64, 48))
        .projector(Projector::new(light))
        .material("gold", Material::rough_metal("Au", 0.2))
        .material("wall", Material::diffuse(0.6))
        .object(Object::sphere([0.0; 3], 0.6).material("gold"))
        .object(Object::rectangle([-2.0, -2.0, -1.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]).material("wall"))
        .slice(Slice::new("mueller").mueller())
        .slice(Slice::new("time").time(15_000.0, 500.0, 40))
        .spp(32)
        .build()?;

    let arrays = Render::new(&scene).to_arrays()?;
    for name in arrays.names() {
        let mean = arrays.get(name, Field::Mean).ok_or("every slice has means")?;
        let axes: Vec<&str> = mean.axes.iter().map(|a| a.kind.name()).collect();
        println!("{name}: {:?} over {}", mean.shape(), axes.join(", "));
    }

    // Prints the Mueller matrix at the centre of the gold sphere, and the standard error of the matrix.
    let pixel = [(AxisKind::Y, 24), (AxisKind::X, 32), (AxisKind::Wavelength, 1)];
    let [mean, error] = [Field::Mean, Field::StdError].map(|f| arrays.get("mueller", f));
    let (mean, error) = (mean.ok_or("means")?, error.ok_or("errors")?);
    for i in 0..4 {
        for j in 0..4 {
            let at = [&pixel[..], &[(AxisKind::StokesOut, i), (AxisKind::StokesIn, j)]].concat();
            print!("{:+.4} ± {:.4}  ", mean.at(&at), error.at(&at));
        }
        println!();
    }
    Ok(())
}
