//! Shape of what a scene shows, by every method of Fig. 11 of Baek & Heide (2021), against the scene itself.
//!
//! `cargo run --release --example shape_scan -- [SCENE.toml STORE.zarr [TWIN.zarr]]`
//!
//! Renders the scene's T(s, u) and Mueller images at 550 nm into STORE.zarr, or takes it from there. The object is what the
//! middle pixel sees. Without a scene, the marble dragon at few samples. TWIN.zarr, a store of the same scene with a diffuse object, adds the pseudo truth of the paper.

use std::path::PathBuf;
use sunstone::apply::map::Map;
use sunstone::apply::pinhole::{Pinhole, Rig};
use sunstone::apply::shape::column_light::ColumnLight;
use sunstone::apply::shape::errors::{angular, depth_errors};
use sunstone::apply::shape::methods::{Code, Inputs, Light, Method, Parameters, run};
use sunstone::tensor::slice::{
    CameraSelect, Polarization, ProjectorAxis, ProjectorSelect, Slice, TimeSelect,
};
use sunstone::transport::device;
use sunstone::transport::geometry::ray::Ray;
use sunstone::{AxisKind, Field, Render, Scene, Store, scene};

/// Half width of the epipolar band, projector pixels of 128 across the image.
const BAND: f32 = 1.5;

/// Rays along a pixel's edge for its true depth and normal.
const RAYS: usize = 4;

type Failure = Box<dyn std::error::Error>;

fn slices(rows: u32) -> Vec<Slice> {
    let slice = |name: &str, projector, polarization| Slice {
        name: name.into(),
        camera: CameraSelect::All,
        projector,
        time: TimeSelect::Sum,
        polarization,
        bounces: false,
        split_first_bounce: false,
        labels: false,
    };
    let half_width_px = BAND * rows as f32 / 128.0;
    let along = ProjectorAxis::U;
    vec![
        slice(
            "columns",
            ProjectorSelect::Binned { nx: 1, ny: rows },
            Polarization::Intensity,
        ),
        slice(
            "epipolar_columns",
            ProjectorSelect::EpipolarAlong { half_width_px, along },
            Polarization::Intensity,
        ),
        slice("polarimetric", ProjectorSelect::Sum, Polarization::Mueller),
        slice(
            "epipolar",
            ProjectorSelect::Epipolar { half_width_px },
            Polarization::Mueller,
        ),
    ]
}

fn pinhole(p: &device::pinhole::Pinhole) -> Pinhole {
    let vector = |v: [f32; 3]| v.map(f64::from);
    Pinhole::new(
        p.resolution.map(|n| n as usize),
        [p.focal.x, p.focal.y],
        [p.principal.x, p.principal.y],
        vector(p.origin.to_array()),
        [p.axes.x_axis, p.axes.y_axis, p.axes.z_axis].map(|a| vector(a.to_array())),
    )
}

/// Values of a slice, the wavelength nearest to 550 nm: `y`, `x`, and the rest as channels.
fn map(store: &Store, name: &str) -> Result<Map, Failure> {
    let all = store.slice(name)?.read_all(Field::Mean)?;
    let lane = all
        .find(AxisKind::Wavelength)
        .map_or(0, |at| all.axes[at].nearest(550.0));
    let one = all.select(AxisKind::Wavelength, lane);
    let [height, width] = [AxisKind::Y, AxisKind::X].map(|kind| one.extent(kind));
    Ok(Map {
        width,
        height,
        channels: one.data.len() / (width * height),
        data: one.data.iter().map(|v| f64::from(*v)).collect(),
    })
}

/// Depth, normal and mask of the object that the middle pixel sees: means over rays through each pixel.
fn truth(scene: &Scene) -> [Map; 3] {
    let camera = &scene.camera;
    let [w, h] = camera.resolution.map(|n| n as usize);
    let hit = |x: f64, y: f64| {
        let dir = camera.direction([x, y].into());
        let ray = Ray {
            origin: camera.origin,
            dir,
        };
        let hit = scene.geometry.intersect(&ray, f32::INFINITY)?;
        let surface = scene.geometry.surface(&ray, &hit);
        let normal = if surface.ng.dot(dir) > 0.0 {
            -surface.ng
        } else {
            surface.ng
        };
        let axes = [camera.axes.x_axis, camera.axes.y_axis, camera.axes.z_axis];
        let depth = f64::from((surface.p - camera.origin).dot(axes[2]));
        Some((surface.material, depth, axes.map(|a| f64::from(normal.dot(a)))))
    };
    let object = hit(w as f64 / 2.0, h as f64 / 2.0).map(|h| h.0);
    let nothing = |channels| Map::from_fn(w, h, channels, |_, _, o| o.fill(f64::NAN));
    let mut maps = [nothing(1), nothing(3), Map::from_fn(w, h, 1, |_, _, _| {})];
    for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
        let at = |i: usize| (i as f64 + 0.5) / RAYS as f64;
        let hits = (0..RAYS * RAYS).map(|i| hit(x as f64 + at(i % RAYS), y as f64 + at(i / RAYS)));
        let hits: Vec<_> = hits.flatten().filter(|h| Some(h.0) == object).collect();
        // The object fills the pixel.
        if hits.len() < RAYS * RAYS {
            continue;
        }
        let mean = |of: &dyn Fn(usize) -> f64| (0..hits.len()).map(of).sum::<f64>() / hits.len() as f64;
        let n = [0, 1, 2].map(|k| mean(&|i| hits[i].2[k]));
        let length = n.iter().map(|v| v * v).sum::<f64>().sqrt();
        let pixel = y * w + x;
        maps[0].data[pixel] = mean(&|i| hits[i].1);
        maps[1].data[3 * pixel..3 * pixel + 3].copy_from_slice(&n.map(|v| v / length));
        maps[2].data[pixel] = 1.0;
    }
    maps
}

fn inputs(scene: &Scene, store: &Store, mask: &Map) -> Result<Inputs, Failure> {
    let projector = scene.projector.as_ref().ok_or("the scene has no projector")?;
    Ok(Inputs {
        rig: Rig {
            camera: pinhole(&scene.camera),
            projector: pinhole(&projector.pinhole),
        },
        columns: ColumnLight {
            light: map(store, "columns")?,
        },
        epipolar_columns: ColumnLight {
            light: map(store, "epipolar_columns")?,
        },
        mueller: map(store, "polarimetric")?,
        epipolar_mueller: map(store, "epipolar")?,
        mask: mask.clone(),
    })
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = tempfile::tempdir()?;
    let (mut scene, path) = if let [file, path, ..] = &arguments[..] {
        (scene::load(file.as_ref())?, PathBuf::from(path))
    } else {
        let mut dragon = scene::load("scenes/sss_statue/scene.toml".as_ref())?;
        dragon.settings.spp = 8;
        (dragon, folder.path().join("dragon.zarr"))
    };
    let rows = scene
        .projector
        .as_ref()
        .ok_or("the scene has no projector")?
        .pinhole
        .resolution[1];
    scene.slices = slices(rows);
    if !path.exists() {
        let summary = Render::new(&scene).to_store(&path)?;
        println!("{} samples in {:.1} s", summary.samples, summary.wall_s);
    }
    let [depth, normals, mask] = truth(&scene);
    let inputs = inputs(&scene, &Store::open(&path)?, &mask)?;
    let twin = arguments.get(2).map(|twin| -> Result<Inputs, Failure> {
        let store = Store::open(twin.as_ref())?;
        Ok(Inputs {
            columns: ColumnLight {
                light: map(&store, "columns")?,
            },
            ..inputs.clone()
        })
    });
    let lit = mask.data.iter().filter(|m| **m != 0.0).count();
    println!(
        "{lit} pixels; normals: mean and median degrees off, of how many; depths: mean and median mm off"
    );
    let line = |name: &str, method: Method, inputs: &Inputs| -> Result<(), Failure> {
        let got = run(method, inputs, &Parameters::default())?;
        let n = angular(&got.normals, &normals, Some(&mask));
        let z = depth_errors(&got.depth, &depth, Some(&mask));
        println!(
            "{name:45} {:6.2} {:6.2} {:4.0} %   {:7.3} {:7.3} {:4.0} %",
            n.mean,
            n.median,
            100.0 * n.coverage,
            1e3 * z.mean,
            1e3 * z.median,
            100.0 * z.coverage
        );
        Ok(())
    };
    for method in Method::FIGURE {
        line(&method.name(), method, &inputs)?;
    }
    for bin in [2, 4, 8] {
        let mut coarse = inputs.clone();
        coarse.rig.projector = inputs.rig.projector.binned_columns(bin);
        coarse.columns = inputs.columns.binned(bin);
        coarse.epipolar_columns = inputs.epipolar_columns.binned(bin);
        for light in [Light::All, Light::Epipolar] {
            for code in [Code::Gray, Code::Logical, Code::Phase] {
                let method = Method::StructuredLight(code, light);
                line(
                    &format!("{}, {} columns", method.name(), coarse.columns.light.channels),
                    method,
                    &coarse,
                )?;
            }
        }
    }
    for code in [Code::Gray, Code::Phase, Code::Micro, Code::Logical] {
        for light in [Light::All, Light::Epipolar] {
            for method in [Method::StructuredLight(code, light), Method::Joint(code, light)] {
                if !Method::FIGURE.contains(&method) {
                    line(&method.name(), method, &inputs)?;
                }
            }
        }
    }
    line(
        "epipolar polarization",
        Method::Polarization(Light::Epipolar),
        &inputs,
    )?;
    if let Some(twin) = twin {
        let twin = twin?;
        for code in [Code::Gray, Code::Phase, Code::Micro] {
            let method = Method::StructuredLight(code, Light::All);
            line(
                &format!("pseudo truth, diffuse twin: {}", method.name()),
                method,
                &twin,
            )?;
        }
    }
    Ok(())
}
