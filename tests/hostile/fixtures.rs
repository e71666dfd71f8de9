//! Creates valid files with the program once for all cases. Each case damages one file.

use super::case::{contents, copy};
use crate::harness;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use sunstone::store::numpy;

/// A small valid scene with all files to which a scene can refer.
pub const SMALL: &str = r#"name = "small"
wavelengths_nm = [450, 550, 660]
render = { spp = 2, tile = 4, max_depth = 3 }
camera = { resolution = [4, 4], fov_x_deg = 50, pose.look_at = { origin = [0, 1, 3], target = [0, 1, 0] } }
projector = { resolution = [4, 4], fov_x_deg = 40, irradiance = 10, pose.look_at = { origin = [0.2, 1, 3], target = [0, 1, 0] } }
materials.white.diffuse.albedo = [0.7, 0.7, 0.7]
objects = [{ shape.rectangle = { corner = [-1, 0, -1], u = [2, 0, 0], v = [0, 2, 0] }, material = "white" }]

[[slices]]
name = "mueller"
polarization = "mueller"

[[slices]]
name = "flight"
time = { start_ps = 20000, bin_ps = 1000, bins = 12 }
camera = { rows = [1, 2] }

[[slices]]
name = "timed"
polarization = "mueller"
time = { start_ps = 20000, bin_ps = 1000, bins = 12 }

[[slices]]
name = "lit"
projector = "all"

[[figures]]
name = "picture"
view.photo = { slice = "mueller" }
"#;

/// The table `[vary]` of the scene.
const VARY: &str = "\n[vary.shade]\npath = \"materials.white.diffuse.albedo\"\nvalues = [[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]]\n";

/// A figure file that shows the scene.
const FIGURE: &str = r#"columns = 1
[scenes.small]
file = "SCENE"
preview = { pixels = 4, spp = 2 }
full = { pixels = 4, spp = 2 }
[[panels]]
scene = "small"
view.photo = { slice = "mueller" }
caption = "{pixels} pixels"
"#;

/// Number of matrices in the arrays. The arrays are larger than the free space on the nearly full disk that
/// the tests simulate.
const PIXELS: usize = 60;

/// A camera calibration in OpenCV's format.
const CALIBRATION: &str = "image_width: 64\nimage_height: 48\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [60, 0, 32, 0, 60, 24, 0, 0, 1]\n\
distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0, 0, 0, 0]\n";

pub struct Fixtures {
    folder: tempfile::TempDir,
}

impl Fixtures {
    /// Creates all fixture files.
    pub fn make() -> Self {
        let fixtures = Self { folder: folder() };
        let at = fixtures.path();
        let put = |name: &str, text: &str| fs::write(at.join(name), text).expect("a file");
        put("scene.toml", SMALL);
        put("materials.toml", "materials.gold.rough_conductor = { metal = \"Au\", alpha = 0.2 }\n");
        put("media.toml", "media.fog.homogeneous = { scattering = 0.1, phase.rayleigh = {} }\n");
        put("vary.toml", &format!("{SMALL}{VARY}"));
        put("chain.toml", "seed = 1\nscheme = { kind = \"drr\", captures = 36 }\n");
        put("figure.toml", &FIGURE.replace("SCENE", &at.join("scene.toml").to_string_lossy()));
        let scenes = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenes/fruits");
        copy(&scenes, &at.join("scenes/fruits"));
        put("camera.toml", "[cmos]\nexposure_s = 0.5\n");
        put("points.csv", "x,y,z\n0,1,0\n0.1,1,0\n");
        put("rig.toml", super::documents::RIG);
        put("lab.toml", &super::documents::RIG.replace("size = [6, 4]", "size = [912, 1140]"));
        put("plan.toml", super::documents::PLAN);
        put("scan.toml", super::documents::SCAN);
        put(
            "events.csv",
            "kind,time,dtime,channel,markers\nphoton,3,100,0,0\nmarker,4,0,0,1\nphoton,9,7,1,0\n",
        );
        put("directions.csv", "10,0,20,180\n30,0,20,180\n");
        put("calibration.yaml", CALIBRATION);
        harness::scene_files(at, &[("image.png", 2), ("mask.png", 4), ("mask8.png", 8)]);
        fs::create_dir(at.join("tables")).expect("a folder");
        fs::copy(at.join("table.pbsdf"), at.join("tables/one.pbsdf")).expect("a copy");
        fs::create_dir(at.join("empty")).expect("a folder");
        let matrices: Vec<f32> = (0..PIXELS * 16).map(|i| if i % 16 == 0 { 2.0 } else { 0.1 }).collect();
        let shape = [PIXELS, 4, 4];
        numpy::save(&at.join("M.npy"), &shape, &matrices).expect("an array");
        // The projector is dim, so that the simulated camera does not saturate.
        let dim: Vec<f32> = matrices.iter().map(|m| 0.02 * m).collect();
        numpy::save(&at.join("dim.npy"), &shape, &dim).expect("an array");
        let errors = |v: f32| vec![v; PIXELS * 16];
        numpy::save(&at.join("E.npy"), &shape, &errors(0.01)).expect("an array");
        numpy::save(&at.join("negative_errors.npy"), &shape, &errors(-0.01)).expect("an array");
        let variances = vec![-1.0_f32; 36 * PIXELS];
        numpy::save(&at.join("negative.npy"), &[36, PIXELS], &variances).expect("an array");
        let lines = [
            "render scene.toml -o s.zarr --no-figures",
            "render scene.toml -o t.zarr --no-figures --seed 9",
            "scheme drr -k 36 -o drr36.toml",
            "scheme drr -k 9 -o drr9.toml",
            "capture M.npy --scheme drr36.toml -o I.npy --noise 0.001",
            "capture dim.npy --scheme drr36.toml -o I2.npy --detector camera.toml --variance V.npy",
            "learn -k 9 --data tables --bands 550 --folds 0 --starts 1 --iterations 1 --adam-steps 1 -o learned.toml \
             --estimator prior --save-prior prior.toml",
            "rig run plan.toml -o night.zarr",
            "rig run plan.toml --sample mirror -o mirror.zarr",
            "rig run scan.toml -o scan.zarr",
            "ptu write events.csv -o photons.ptu --record timeharp-260-p-t3 --period-ps 100000",
            "export scene.toml --mitsuba mitsuba --wavelength 550",
        ];
        for line in lines {
            let words: Vec<&str> = line.split_whitespace().collect();
            harness::run(at, &words, 0);
        }
        fixtures
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn empty(&self) -> tempfile::TempDir {
        folder()
    }

    /// Returns the current contents of all fixture files.
    pub fn snapshot(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        contents(self.path())
    }
}

/// Returns a folder in memory if the system has one.
fn folder() -> tempfile::TempDir {
    let made = harness::folder();
    // Another user runs some of the cases and must be able to read the files.
    fs::set_permissions(made.path(), fs::Permissions::from_mode(0o755)).expect("its owner");
    made
}
