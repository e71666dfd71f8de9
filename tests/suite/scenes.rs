//! Tests the shipped scenes:
//! - The scenes load.
//! - Meshes are closed, and so are shapes that refract or contain a medium.
//! - Camera and projector see the main objects.
//! - Only materials and media differ between a scene and its twin.

use glam::{DVec2, Vec3, Vec3A};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use sunstone::scene::import;
use sunstone::transport::device::pinhole::Pinhole;
use sunstone::transport::geometry::mesh::Mesh;
use sunstone::transport::geometry::ray::Ray;
use sunstone::transport::material::Material;
use sunstone::transport::scene::Scene;
use toml::{Table, Value};

/// A scene, its twin, and spheres (centre, radius in metres) around the objects that camera and projector
/// must see.
struct Shipped {
    folder: &'static str,
    twin: &'static str,
    seen: &'static [([f32; 3], f32)],
}

const SHIPPED: &[Shipped] = &[
    Shipped { folder: "disco_ball", twin: "diffuse.toml", seen: &[([0.0, 0.56, -0.1], 0.212)] },
    Shipped {
        folder: "coins_mirror",
        twin: "diffuse.toml",
        // The spheres enclose the coins and the centre of the mirror.
        seen: &[
            ([-0.055, 0.001, -0.015], 0.021),
            ([-0.02, 0.001, 0.03], 0.021),
            ([0.066, 0.02, 0.005], 0.021),
            ([0.0, 0.041, -0.08], 0.035),
        ],
    },
    Shipped {
        folder: "milky_tank",
        twin: "no_medium.toml",
        // The spheres enclose the doll and each end of the ruler.
        seen: &[
            ([-0.052, 0.058, -0.008], 0.053),
            ([0.015, 0.047, 0.034], 0.015),
            ([0.085, 0.087, -0.028], 0.015),
        ],
    },
    Shipped { folder: "sss_statue", twin: "diffuse.toml", seen: &[([0.0, 0.025, 0.0], 0.026)] },
    Shipped {
        folder: "crystals",
        twin: "diffuse.toml",
        seen: &[([-0.022, 0.01, 0.0], 0.02), ([0.02, 0.011, 0.0], 0.02)],
    },
    Shipped {
        folder: "fruits",
        twin: "diffuse.toml",
        seen: &[
            ([-0.118, 0.045, -0.01], 0.05),
            ([-0.04, 0.033, 0.015], 0.04),
            ([0.04, 0.033, 0.015], 0.04),
            ([0.118, 0.045, -0.01], 0.05),
        ],
    },
];

fn path(folder: &str, file: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenes").join(folder).join(file)
}

fn table(path: &Path) -> Table {
    let text = std::fs::read_to_string(path).unwrap();
    text.parse().unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn objects(scene: &Table) -> impl Iterator<Item = &Table> {
    scene["objects"].as_array().unwrap().iter().filter_map(Value::as_table)
}

fn name<'a>(object: &'a Table, key: &str) -> &'a str {
    object.get(key).and_then(Value::as_str).unwrap_or_default()
}

#[test]
fn every_scene_folder_is_listed() {
    let all = std::fs::read_dir(path("", "")).unwrap();
    let mut found: Vec<_> = all
        .map(|e| e.unwrap())
        .filter(|e| e.path().is_dir())
        .map(|e| e.file_name().into_string().unwrap())
        .collect();
    found.sort();
    let mut known: Vec<_> = SHIPPED
        .iter()
        .map(|s| s.folder)
        .chain(["figures", "gold_mirror", "materials", "mirror_room", "painted_doll", "statue_mirror"])
        .collect();
    known.sort_unstable();
    assert_eq!(found, known);
    let gold = path("gold_mirror", "scene.toml");
    sunstone::scene::load(&gold).unwrap_or_else(|e| panic!("{e}"));
}

/// Checks that a sphere is in the device's image, at least `pixels` wide, and visible. The sphere is visible
/// if it contains the first opaque surface on the way to its centre. The sphere is also visible if it
/// contains the first surface of the object itself.
fn sees(scene: &Scene, device: &Pinhole, centre: Vec3A, radius: f32, pixels: f64) -> Result<(), String> {
    let (at, _) = device.project(centre).ok_or("it is out of the image")?;
    let distance = (centre - device.origin).length();
    let (side, _) =
        device.project(centre + device.axes.x_axis * radius).ok_or("its side is out of the image")?;
    let width = 2.0 * DVec2::distance(at, side);
    if width < pixels {
        return Err(format!("it is {width:.1} pixels wide"));
    }
    let mut ray = Ray { origin: device.origin, dir: (centre - device.origin) / distance };
    for _ in 0..20 {
        let hit = scene.geometry.intersect(&ray, f32::INFINITY).ok_or("the way to it meets nothing")?;
        let surface = scene.geometry.surface(&ray, &hit);
        if surface.p.distance(centre) <= radius {
            return Ok(());
        }
        let material = scene.materials.list[surface.material as usize];
        if !matches!(material, Material::Dielectric(_)) {
            return Err(format!("something at {} hides it", surface.p));
        }
        ray.origin = scene.geometry.leave(&surface, ray.dir);
    }
    Err("the way to it does not end".into())
}

#[test]
fn scenes_and_twins_load_and_show_their_objects() {
    for shipped in SHIPPED {
        for file in ["scene.toml", shipped.twin] {
            let path = path(shipped.folder, file);
            let text = sunstone::scene::read(&path).expect("a file");
            let scene = sunstone::scene::from_text(&path, &text).unwrap_or_else(|e| panic!("{e}"));
            let nm = scene.wavelengths.nm();
            let figures =
                sunstone::figure::listed::from_text(&path, &text, &scene.slices, nm).expect("figures");
            let projector = scene.projector.as_ref().unwrap();
            for (device, who) in [(&scene.camera, "camera"), (&projector.pinhole, "projector")] {
                for (centre, radius) in shipped.seen {
                    sees(&scene, device, Vec3A::from_array(*centre), *radius, 9.0)
                        .unwrap_or_else(|e| panic!("{}: {who}, {centre:?}: {e}", path.display()));
                }
            }
            let figures: Vec<_> = figures.iter().map(|f| f.name.as_str()).collect();
            for figure in ["photo", "epipolar", "nonepipolar", "mueller"] {
                assert!(figures.contains(&figure), "{}: {figure}", path.display());
            }
            // Epipolar lines run approximately along rows.
            let baseline = (projector.pinhole.origin - scene.camera.origin).normalize();
            let along = baseline.dot(scene.camera.axes.x_axis);
            assert!(along.abs() > 0.9, "{}: {along}", path.display());
        }
    }
}

/// Returns the part that is common to a scene and its twin.
fn without_materials(mut scene: Table) -> Table {
    for key in ["name", "materials", "media"] {
        scene.remove(key);
    }
    let render = scene["render"].as_table_mut().unwrap();
    render.remove("max_depth");
    for object in scene["objects"].as_array_mut().unwrap() {
        let object = object.as_table_mut().unwrap();
        for key in ["material", "interior", "priority"] {
            object.remove(key);
        }
    }
    scene
}

#[test]
fn twins_differ_only_in_materials_and_media() {
    for shipped in SHIPPED {
        let [scene, twin] = ["scene.toml", shipped.twin].map(|f| table(&path(shipped.folder, f)));
        assert_ne!(
            (scene["materials"].clone(), scene.get("media")),
            (twin["materials"].clone(), twin.get("media")),
            "{}",
            shipped.folder
        );
        assert!(twin.get("media").is_none(), "{}", shipped.folder);
        assert!(objects(&twin).all(|o| o.get("interior").is_none()), "{}", shipped.folder);
        assert_eq!(without_materials(scene), without_materials(twin), "{}", shipped.folder);
    }
}

/// Returns the volume of a mesh in cubic metres. Returns an error unless each edge joins exactly two
/// triangles that traverse the edge in opposite directions. Vertices at equal positions count as one vertex.
fn closed_volume(mesh: &Mesh) -> Result<f64, String> {
    let mut welded = HashMap::new();
    let ids: Vec<usize> = mesh
        .positions
        .iter()
        .map(|p| {
            let next = welded.len();
            // Adding zero makes -0 equal to 0.
            *welded.entry((p + Vec3::ZERO).to_array().map(f32::to_bits)).or_insert(next)
        })
        .collect();
    let mut edges: HashMap<(usize, usize), u32> = HashMap::new();
    let mut volume = 0.0;
    for corners in &mesh.indices {
        let [a, b, c] = corners.map(|i| mesh.positions[i as usize].as_dvec3());
        volume += a.dot(b.cross(c)) / 6.0;
        let [i, j, k] = corners.map(|i| ids[i as usize]);
        for edge in [(i, j), (j, k), (k, i)] {
            *edges.entry(edge).or_default() += 1;
        }
    }
    for ((a, b), n) in &edges {
        if *n != 1 {
            return Err("an edge is run along twice in one direction".into());
        }
        if !edges.contains_key(&(*b, *a)) {
            return Err("there is a hole".into());
        }
    }
    Ok(volume)
}

/// Returns the smallest cosine between the geometric normal of a triangle and the shading normals at its
/// corners.
fn worst_normal(mesh: &Mesh) -> f32 {
    let cosines = mesh.indices.iter().flat_map(|corners| {
        let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
        let n = (b - a).cross(c - a).normalize();
        corners.map(|i| mesh.normals.get(i as usize).map_or(1.0, |s| n.dot(*s)))
    });
    cosines.fold(1.0, f32::min)
}

/// Checks that a shape is closed and that its front faces outward.
fn check_closed(folder: &str, shape: &Table) -> Result<(), String> {
    let (kind, value) = shape.iter().next().unwrap();
    match kind.as_str() {
        "cube" | "sphere" => Ok(()),
        "ply" => {
            let file = path(folder, value["file"].as_str().unwrap());
            for part in import::load(&file).unwrap() {
                let volume = closed_volume(&part.mesh)?;
                if volume <= 0.0 {
                    return Err(format!("it is inside out: {volume} m³"));
                }
                let worst = worst_normal(&part.mesh);
                if worst < 0.0 {
                    return Err(format!("a shading normal points inward: {worst}"));
                }
            }
            Ok(())
        }
        _ => Err(format!("a {kind} is not closed")),
    }
}

#[test]
fn refracting_and_filled_objects_are_closed_and_face_outward() {
    let mut checked = 0;
    for shipped in SHIPPED {
        let scene = table(&path(shipped.folder, "scene.toml"));
        for object in objects(&scene) {
            let material = scene["materials"][name(object, "material")].as_table().unwrap();
            let refracts = ["dielectric", "rough_dielectric", "crystal", "null"];
            let refracts = refracts.iter().any(|kind| material.contains_key(*kind));
            let open = name(object, "name") == "facets";
            let shape = object["shape"].as_table().unwrap();
            if refracts || object.contains_key("interior") || (shape.contains_key("ply") && !open) {
                check_closed(shipped.folder, shape)
                    .unwrap_or_else(|e| panic!("{}: {}: {e}", shipped.folder, name(object, "name")));
                checked += 1;
            }
        }
    }
    assert!(checked >= 18, "{checked} shapes");
}

#[test]
fn an_open_or_inverted_mesh_is_detected() {
    let cube = Mesh::cube();
    assert!((closed_volume(&cube).unwrap() - 8.0).abs() < 1e-6);
    let mut open = cube.clone();
    open.indices.pop();
    assert!(closed_volume(&open).is_err());
    let mut inverted = cube;
    for corners in &mut inverted.indices {
        corners.swap(0, 1);
    }
    assert!(closed_volume(&inverted).unwrap() < 0.0);
}
