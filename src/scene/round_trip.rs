//! Round-trip tests: shipped scenes and random values are equal after writing and reading.

use base::locate::Located;
use optics::sampling::microfacet::{Distribution, Masking};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use syntax::device::*;
use syntax::emitter::*;
use syntax::instance::*;
use syntax::material::*;
use syntax::medium::*;
use syntax::scene::{GapsFile, RenderFile, SceneFile};
use syntax::shape::*;
use syntax::slice::*;
use syntax::texture::*;
use syntax::transform::TransformFile;
use syntax::values::*;
use syntax::vary::*;
use transport::material::polarizer::Passes;
use transport::material::texture::{Filter, Wrap};
use transport::scene::{Integrator, Scene};

fn scenes(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            scenes(&path, found);
        } else if path.extension().is_some_and(|e| e == "toml") {
            let text = std::fs::read_to_string(&path).expect("a text");
            if text.lines().any(|line| line.trim() == "[camera]") {
                found.push(path);
            }
        }
    }
}

fn tables(s: &Scene) -> String {
    let materials = (&s.materials.list, &s.materials.textures.images, &s.boundaries);
    let light = (&s.points, &s.environment, &s.lights);
    let devices = (&s.wavelengths, &s.camera, &s.projector, light);
    let copies: Vec<_> = s.geometry.instances().collect();
    let rest = (&s.name, &s.settings, s.geometry.counts(), copies);
    format!("{materials:?} {devices:?} {rest:?} {:?} {:?}", s.media, s.slices)
}

#[test]
#[ignore = "slow: tools/check --all"]
fn shipped_scenes_come_back() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut paths = vec![];
    for folder in ["scenes", "validation"] {
        scenes(&root.join(folder), &mut paths);
    }
    assert!(paths.len() >= 20, "{paths:?}");
    let mut built = 0;
    for path in &paths {
        let text = std::fs::read_to_string(path).expect("a text");
        let first: SceneFile = toml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let written = first.to_toml().expect("a text");
        let second: SceneFile = toml::from_str(&written).unwrap_or_else(|e| panic!("{e}\n{written}"));
        assert_eq!(first, second, "{written}");
        assert_eq!(written, second.to_toml().expect("a text"));
        // Some scenes need generated files.
        if let Ok(a) = crate::from_text(path, &text) {
            let b = crate::from_text(path, &written).unwrap_or_else(|e| panic!("{e}\n{written}"));
            assert_eq!(tables(&a), tables(&b), "{}", path.display());
            built += 1;
        }
    }
    assert!(built >= 14, "{built} of {}", paths.len());
}

#[test]
fn a_short_scene_is_short() {
    let text = "[camera]\nresolution = [2, 3]\nfov_x_deg = 40.0\n\n[camera.pose.look_at]\norigin = [0.0, 0.0, 4.0]\ntarget = [0.0, 0.0, 0.0]\n";
    let scene: SceneFile = toml::from_str(text).expect("a scene");
    assert_eq!(scene.to_toml().expect("a text"), text);
}

/// Decisions from numbers that proptest can shrink. When they are used up, the simplest choice is made.
struct Choices<'a>(std::slice::Iter<'a, u64>);

impl Choices<'_> {
    fn word(&mut self) -> u64 {
        self.0.next().copied().unwrap_or(0)
    }

    fn below(&mut self, n: u64) -> u64 {
        self.word() % n
    }

    fn yes(&mut self) -> bool {
        self.below(2) == 1
    }

    fn number(&mut self) -> f64 {
        match self.below(6) {
            0 => 0.0,
            1 => 1.0,
            2 => -0.5,
            3 => self.below(1000) as f64,
            4 => 1.0 / (1 + self.below(1000)) as f64,
            _ => Some(f64::from_bits(self.word())).filter(|v| v.is_finite()).unwrap_or(1e300),
        }
    }

    fn whole(&mut self) -> u32 {
        self.word() as u32
    }

    fn three(&mut self) -> [f64; 3] {
        [self.number(), self.number(), self.number()]
    }

    fn rows(&mut self) -> [[f64; 4]; 4] {
        std::array::from_fn(|_| std::array::from_fn(|_| self.number()))
    }

    fn square(&mut self) -> [[f64; 3]; 3] {
        std::array::from_fn(|_| self.three())
    }

    fn text(&mut self) -> String {
        const WORDS: [&str; 10] = ["a", "gold", "", "two words", "a.b", "\"", "\n\\", "ü €", "[x]", "true"];
        WORDS[self.below(10) as usize].to_owned() + &self.below(3).to_string()
    }

    fn some<T>(&mut self, value: impl FnOnce(&mut Self) -> T) -> Option<T> {
        self.yes().then(|| value(self))
    }

    fn list<T>(&mut self, mut value: impl FnMut(&mut Self) -> T) -> Vec<T> {
        (0..self.below(4)).map(|_| value(self)).collect()
    }

    fn map<T>(&mut self, mut value: impl FnMut(&mut Self) -> T) -> BTreeMap<String, T> {
        (0..self.below(4)).map(|_| (self.text(), value(self))).collect()
    }

    fn spectrum(&mut self) -> SpectrumFile {
        match self.below(3) {
            0 => SpectrumFile::Scalar(self.number()),
            1 => SpectrumFile::PerWavelength(self.list(Self::number)),
            _ => SpectrumFile::Table(SpectrumTable {
                nm: self.list(Self::number),
                values: self.list(Self::number),
            }),
        }
    }

    fn image(&mut self) -> ImageAlbedo {
        ImageAlbedo {
            image: self.text().into(),
            scale: self.number(),
            uv: self.uv(),
            wrap: [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp][self.below(3) as usize],
            filter: [Filter::Bilinear, Filter::Nearest][self.below(2) as usize],
            raw: self.below(2) == 0,
            luminance: self.below(2) == 0,
            layer: self.some(Self::text),
        }
    }

    fn uv(&mut self) -> Option<UvRows> {
        (self.below(2) == 0).then(|| std::array::from_fn(|_| std::array::from_fn(|_| self.number())))
    }

    fn checkerboard(&mut self) -> CheckerboardFile {
        CheckerboardFile { checkerboard: [self.spectrum(), self.spectrum()], uv: self.uv() }
    }

    fn albedo(&mut self) -> Located<AlbedoFile> {
        match self.below(3) {
            0 => AlbedoFile::Spectrum(self.spectrum()).into(),
            1 => AlbedoFile::Checkerboard(self.checkerboard()).into(),
            _ => AlbedoFile::Image(self.image()).into(),
        }
    }

    fn scalar(&mut self) -> Located<ScalarFile> {
        match self.below(3) {
            0 => ScalarFile::Number(self.number()).into(),
            1 => ScalarFile::Checkerboard(self.checkerboard()).into(),
            _ => ScalarFile::Image(self.image()).into(),
        }
    }

    fn index(&mut self) -> Located<IndexFile> {
        match self.below(2) {
            0 => IndexFile::Values(self.spectrum()).into(),
            _ => IndexFile::Named(self.text()).into(),
        }
    }

    fn some_spectrum(&mut self) -> Option<Located<SpectrumFile>> {
        self.some(|c| c.spectrum().into())
    }

    fn some_number(&mut self) -> Option<Located<f64>> {
        self.some(|c| c.number().into())
    }

    fn some_text(&mut self) -> Option<Located<String>> {
        self.some(|c| c.text().into())
    }

    fn distribution(&mut self) -> Distribution {
        [Distribution::Ggx, Distribution::Beckmann][self.below(2) as usize]
    }

    fn masking(&mut self) -> Masking {
        [Masking::Correlated, Masking::Separable][self.below(2) as usize]
    }

    fn pose(&mut self) -> Located<PoseFile> {
        let pose = match self.below(3) {
            0 => {
                PoseFile::LookAt(LookAtFile { origin: self.three(), target: self.three(), up: self.three() })
            }
            1 => PoseFile::Matrix(self.rows()),
            _ => PoseFile::Extrinsics(ExtrinsicsFile {
                rotation: self.some(Self::square),
                t: self.some(Self::three),
                rvec: self.some(Self::three),
                tvec: self.some(Self::three),
            }),
        };
        pose.into()
    }

    fn distortion(&mut self) -> Option<Located<DistortionFile>> {
        self.some(|c| {
            let [k1, k2, k3] = c.three();
            let [p1, p2, k4] = c.three();
            let [s1, s2, tau_x] = c.three();
            DistortionFile {
                k1,
                k2,
                k3,
                k4,
                k5: c.number(),
                k6: c.number(),
                p1,
                p2,
                s1,
                s2,
                s3: c.number(),
                s4: c.number(),
                tau_x,
                tau_y: c.number(),
            }
            .into()
        })
    }

    fn aperture(&mut self) -> Option<Located<ApertureFile>> {
        self.some(|c| {
            let (radius, focus) = (c.number(), c.number());
            ApertureFile { radius, focus }.into()
        })
    }

    fn camera(&mut self) -> PinholeFile {
        PinholeFile {
            orthographic_width: self.some_number(),
            calibration: self.some(|c| c.text().into()),
            resolution: [self.whole(), self.whole()].into(),
            fov_x_deg: self.some_number(),
            fov_y_deg: self.some_number(),
            fx: self.some_number(),
            fy: self.some_number(),
            cx: self.some(Self::number),
            cy: self.some(Self::number),
            opencv_matrix: self.some(|c| c.square().into()),
            distortion: self.distortion(),
            opencv: self.some(|c| c.list(Self::number).into()),
            fisheye: self.some(|c| [(); 4].map(|()| c.number()).into()),
            aperture: self.aperture(),
            pose: self.pose(),
        }
    }

    fn projector(&mut self) -> ProjectorFile {
        ProjectorFile {
            irradiance: self.spectrum().into(),
            coaxial: self.yes(),
            calibration: self.some(|c| c.text().into()),
            resolution: self.some(|c| [c.whole(), c.whole()].into()),
            fov_x_deg: self.some_number(),
            fov_y_deg: self.some_number(),
            fx: self.some_number(),
            fy: self.some_number(),
            cx: self.some(Self::number),
            cy: self.some(Self::number),
            opencv_matrix: self.some(|c| c.square().into()),
            distortion: self.distortion(),
            opencv: self.some(|c| c.list(Self::number).into()),
            fisheye: self.some(|c| [(); 4].map(|()| c.number()).into()),
            aperture: self.aperture(),
            pose: self.some(Self::pose),
        }
    }

    fn emitter(&mut self) -> Located<EmitterFile> {
        let emitter = match self.below(6) {
            0 => EmitterFile::Point(PointFile {
                position: self.three(),
                intensity: self.spectrum().into(),
                horizontal: self.three(),
            }),
            1 => EmitterFile::Spot(SpotFile {
                image: None,
                up: None,
                position: self.three(),
                direction: self.three(),
                intensity: self.spectrum().into(),
                cutoff_deg: self.number().into(),
                beam_deg: self.some_number(),
                horizontal: self.three(),
            }),
            2 => EmitterFile::Ies(IesFile {
                file: self.text().into(),
                position: self.three(),
                direction: self.three(),
                zero: self.three(),
                intensity: self.spectrum().into(),
                horizontal: self.three(),
            }),
            3 => EmitterFile::Directional(DirectionalFile {
                direction: self.three(),
                irradiance: self.spectrum().into(),
                origin: self.some(Self::three),
                stokes: self.stokes(),
                polarizer_deg: self.some_number(),
                horizontal: self.three(),
            }),
            4 => EmitterFile::Beam(BeamFile {
                origin: self.three(),
                direction: self.three(),
                power: self.spectrum().into(),
                radius: self.number().into(),
                divergence_mrad: self.some_number(),
                gaussian: self.yes(),
                stokes: self.stokes(),
                polarizer_deg: self.some_number(),
                horizontal: self.three(),
            }),
            _ => EmitterFile::Environment(Box::new(EnvironmentFile {
                radiance: self.spectrum().into(),
                image: self.some_text(),
                layer: self.some(Self::text),
                rows: [Rows::Centres, Rows::Poles][self.below(2) as usize],
                transform: self.some(Self::transform),
                stokes: self.stokes(),
                polarizer_deg: self.some_number(),
                horizontal: self.three(),
            })),
        };
        emitter.into()
    }

    fn stokes(&mut self) -> Option<Located<[f64; 4]>> {
        self.some(|c| [(); 4].map(|()| c.number()).into())
    }

    fn emission(&mut self) -> Located<EmissionFile> {
        let emission = EmissionFile {
            radiance: self.spectrum().into(),
            image: self.some(|c| c.image().into()),
            two_sided: self.yes(),
            stokes: self.stokes(),
            polarizer_deg: self.some_number(),
            horizontal: self.three(),
        };
        emission.into()
    }

    fn transform(&mut self) -> Located<TransformFile> {
        Located::nowhere(TransformFile {
            scale: self.some_spectrum(),
            rotate_deg: self.some(Self::three),
            translate: self.some(Self::three),
            matrix: self.some(Self::rows),
        })
    }

    fn material(&mut self) -> Located<MaterialFile> {
        let material = match self.below(18) {
            0 => MaterialFile::Null(NullFile {}),
            1 => MaterialFile::Diffuse(DiffuseFile { albedo: self.albedo() }),
            2 => MaterialFile::Conductor(ConductorFile {
                metal: self.some_text(),
                n: self.some_spectrum(),
                k: self.some_spectrum(),
                reflectance: self.albedo(),
            }),
            3 => MaterialFile::RoughConductor(RoughConductorFile {
                metal: self.some_text(),
                n: self.some_spectrum(),
                k: self.some_spectrum(),
                reflectance: self.albedo(),
                alpha: self.scalar(),
                distribution: self.distribution(),
                masking: self.masking(),
            }),
            i @ 4..6 => {
                let (ior, exterior_ior) = (self.index(), self.index());
                let file = DielectricFile { ior, exterior_ior };
                if i == 4 { MaterialFile::Dielectric(file) } else { MaterialFile::ThinDielectric(file) }
            }
            6 => MaterialFile::RoughDielectric(RoughDielectricFile {
                ior: self.index(),
                exterior_ior: self.index(),
                alpha: self.scalar(),
                distribution: self.distribution(),
                masking: self.masking(),
            }),
            7 => MaterialFile::Plastic(Box::new(PlasticFile {
                albedo: self.albedo(),
                ior: self.index(),
                exterior_ior: self.index(),
                specular: self.spectrum().into(),
                single_scatter: self.some(|c| SingleScatterFile { albedo: c.albedo(), alpha: c.scalar() }),
                interreflection: [
                    InterreflectionFile::Lost,
                    InterreflectionFile::Coloured,
                    InterreflectionFile::Linear,
                ][self.below(3) as usize],
                passage: [PassageFile::Smooth, PassageFile::Facets, PassageFile::SingleFacet]
                    [self.below(3) as usize],
                alpha: self.scalar(),
                distribution: self.distribution(),
                masking: self.masking(),
            })),
            8 => MaterialFile::TwoSided(TwoSidedFile { front: self.text().into(), back: self.some_text() }),
            9 => MaterialFile::Blend(BlendFile {
                a: self.text().into(),
                b: self.text().into(),
                weight: self.scalar(),
            }),
            10 => MaterialFile::NormalMap(NormalMapFile {
                material: self.text().into(),
                image: self.text().into(),
                strength: self.number().into(),
                uv: self.uv(),
                wrap: [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp][self.below(3) as usize],
                filter: [Filter::Bilinear, Filter::Nearest][self.below(2) as usize],
                layer: self.some(Self::text),
            }),
            11 => MaterialFile::PartialDepolarizer(PartialDepolarizerFile {
                material: self.text().into(),
                fraction: self.scalar(),
            }),
            16 => MaterialFile::BumpMap(BumpMapFile {
                material: self.text().into(),
                image: self.image().into(),
                height: self.number().into(),
            }),
            12 => MaterialFile::CoatedConductor(CoatedConductorFile {
                metal: self.some_text(),
                n: self.some_spectrum(),
                k: self.some_spectrum(),
                films: self
                    .list(|c| {
                        Located::nowhere(FilmFile {
                            ior: c.index(),
                            k: c.some_spectrum(),
                            thickness_nm: c.number().into(),
                        })
                    })
                    .into(),
            }),
            13 => MaterialFile::Polarizer(PolarizerFile {
                angle_deg: self.some_number(),
                axis: self.some(|c| c.three().into()),
                passes: [Passes::Linear, Passes::Right, Passes::Left][self.below(3) as usize],
                transmittance: self.spectrum().into(),
                extinction: self.spectrum().into(),
            }),
            14 => MaterialFile::Retarder(RetarderFile {
                retardance_deg: self.some_spectrum(),
                retardance_nm: self.some_spectrum(),
                angle_deg: self.some_number(),
                axis: self.some(|c| c.three().into()),
                transmittance: self.spectrum().into(),
                tilt: [TiltFile::Plate, TiltFile::Constant, TiltFile::Cosine][self.below(3) as usize],
                ior: self.some_number(),
            }),
            15 => MaterialFile::Crystal(CrystalFile {
                name: self.some_text(),
                n_o: self.some_spectrum(),
                n_e: self.some_spectrum(),
                axis: self.three().into(),
                exterior_ior: self.index(),
                bandwidth_nm: self.number().into(),
                split: self.yes().into(),
                roughness: self.some(Self::scalar),
            }),
            _ => MaterialFile::Measured(MeasuredFile { file: self.text().into(), even_axes: self.yes() }),
        };
        material.into()
    }

    fn kinds(&mut self) -> Located<Vec<Located<KindFile>>> {
        let kind = |c: &mut Self| {
            Located::nowhere(KindFile {
                index: c.index(),
                k: c.some_spectrum(),
                sizes: c.sizes().into(),
                amount: c.amount(),
            })
        };
        self.list(kind).into()
    }

    fn sizes(&mut self) -> SizesFile {
        match self.below(4) {
            0 => SizesFile::Single(SingleFile { radius_nm: self.number() }),
            1 => SizesFile::LogNormal(LogNormalFile { median_nm: self.number(), sigma: self.number() }),
            2 => SizesFile::Gamma(GammaFile {
                effective_radius_nm: self.number(),
                effective_variance: self.number(),
            }),
            _ => SizesFile::List(SizeListFile {
                radius_nm: self.list(Self::number),
                weight: self.list(Self::number),
            }),
        }
    }

    fn amount(&mut self) -> Located<AmountFile> {
        let amount = match self.below(3) {
            0 => AmountFile::VolumeFraction(self.number()),
            1 => AmountFile::PerM3(self.number()),
            _ => AmountFile::Mass(MassFile { grams_per_litre: self.number(), density: self.number() }),
        };
        amount.into()
    }

    fn phase(&mut self) -> PhaseFile {
        match self.below(4) {
            0 => PhaseFile::Isotropic,
            1 => PhaseFile::Rayleigh(RayleighFile { depolarization: self.number().into() }),
            2 => PhaseFile::HenyeyGreenstein(HenyeyGreensteinFile {
                g: self.spectrum().into(),
                linear: self.number().into(),
                circular: self.number().into(),
            }),
            _ => PhaseFile::Mie(MieFile { kinds: self.kinds() }),
        }
    }

    fn grid(&mut self) -> Located<GridFile> {
        let grid = GridFile {
            file: self.text().into(),
            corners: self.some(|c| [c.three(), c.three()]),
            transform: self.some(Self::transform),
            filter: [GridFilter::Trilinear, GridFilter::Nearest][self.below(2) as usize],
        };
        grid.into()
    }

    fn medium(&mut self) -> Located<MediumFile> {
        let medium = match self.below(7) {
            0 => MediumFile::Homogeneous(Box::new(HomogeneousFile {
                absorption: self.spectrum().into(),
                scattering: self.spectrum().into(),
                index: self.index(),
                phase: self.phase(),
            })),
            5 => MediumFile::Heterogeneous(Box::new(HeterogeneousFile {
                absorption: self.spectrum().into(),
                scattering: self.spectrum().into(),
                index: self.index(),
                phase: self.phase(),
                density: self.grid(),
                albedo: self.some(Self::grid),
            })),
            1 => MediumFile::Particles(ParticlesFile {
                host: self.index(),
                host_absorption: self.some_spectrum(),
                kinds: self.kinds(),
            }),
            2 => MediumFile::Milk(MilkFile {
                fat_percent: self.number().into(),
                protein_percent: self.number().into(),
                homogenization_mpa: self.number().into(),
                concentration: self.number().into(),
            }),
            3 => MediumFile::Polystyrene(PolystyreneFile {
                diameter_nm: self.number().into(),
                spread: self.number().into(),
                amount: self.amount(),
            }),
            4 => MediumFile::Marble(MarbleFile { g: self.number().into() }),
            _ => MediumFile::Skin(SkinFile { g: self.number().into() }),
        };
        medium.into()
    }

    fn shape(&mut self) -> Located<ShapeFile> {
        let mesh = |c: &mut Self| MeshFile {
            file: c.text().into(),
            index: c.below(3) as u32,
            flat: c.yes(),
            smooth: c.yes(),
            materials: c.yes(),
        };
        let shape = match self.below(8) {
            0 => ShapeFile::Sphere(SphereFile { center: self.three(), radius: self.number() }),
            1 => ShapeFile::Obj(mesh(self)),
            2 => ShapeFile::Gltf(mesh(self)),
            3 if self.yes() => ShapeFile::Serialized(mesh(self)),
            3 => ShapeFile::Ply(mesh(self)),
            4 => {
                ShapeFile::Rectangle(RectangleFile { corner: self.three(), u: self.three(), v: self.three() })
            }
            5 => ShapeFile::Disk(DiskFile {
                center: self.three(),
                normal: self.three(),
                radius: self.number(),
            }),
            6 => ShapeFile::Cube(CubeFile { min: self.three(), max: self.three() }),
            _ => ShapeFile::Cylinder(CylinderFile {
                p0: self.three(),
                p1: self.three(),
                radius: self.number(),
                caps: self.yes(),
            }),
        };
        shape.into()
    }

    fn object(&mut self) -> Located<ObjectFile> {
        let object = ObjectFile {
            name: self.some(Self::text),
            shape: self.shape(),
            material: self.text().into(),
            part_materials: self.map(|c| c.text().into()),
            interior: self.some_text(),
            priority: self.whole() as i32,
            flip_normals: self.yes(),
            transform: self.some(Self::transform),
            emission: self.some(Self::emission),
        };
        object.into()
    }

    fn instance(&mut self) -> Located<InstanceFile> {
        Located::nowhere(InstanceFile {
            name: self.some(Self::text),
            group: self.text().into(),
            places: self.some_text(),
            transform: self.some(Self::transform),
        })
    }

    fn bins(&mut self) -> BinSize {
        BinSize([self.whole(), self.below(3) as u32])
    }

    fn block(&mut self) -> [u32; 4] {
        std::array::from_fn(|_| self.whole())
    }

    fn coordinate(&mut self) -> CoordinateFile {
        [CoordinateFile::U, CoordinateFile::V][self.below(2) as usize]
    }

    fn slice(&mut self) -> Located<SliceFile> {
        let camera = match self.below(5) {
            0 => CameraSelectFile::All,
            1 => CameraSelectFile::Rows(self.list(Self::whole)),
            2 => CameraSelectFile::Columns(self.list(Self::whole)),
            3 => CameraSelectFile::Block(self.block()),
            _ => CameraSelectFile::Binned(self.bins()),
        };
        let half_width = HalfWidth { half_width_px: self.number() };
        let projector = match self.below(12) {
            0 => ProjectorSelectFile::Sum,
            1 => ProjectorSelectFile::All,
            2 => ProjectorSelectFile::Rows(self.list(Self::whole)),
            3 => ProjectorSelectFile::Columns(self.list(Self::whole)),
            4 => ProjectorSelectFile::Block(self.block()),
            5 => ProjectorSelectFile::Binned(self.bins()),
            6 => ProjectorSelectFile::Mask(self.text()),
            7 => ProjectorSelectFile::Moment(self.coordinate()),
            8 => ProjectorSelectFile::Epipolar(EpipolarFile {
                half_width_px: half_width.half_width_px,
                along: self.some(Self::coordinate),
            }),
            9 => ProjectorSelectFile::Nonepipolar(half_width),
            10 => ProjectorSelectFile::Ambient,
            _ => ProjectorSelectFile::Coaxial,
        };
        let time = match self.below(2) {
            0 => TimeFile::Sum,
            _ => TimeFile::Bins(TimeBins {
                start_ps: self.number(),
                bin_ps: self.number().into(),
                bins: self.whole().into(),
            }),
        };
        let slice = SliceFile {
            name: self.text().into(),
            camera: camera.into(),
            projector: projector.into(),
            time,
            polarization: [PolarizationFile::Intensity, PolarizationFile::Mueller][self.below(2) as usize],
            bounces: self.yes(),
            split_first_bounce: self.yes(),
            labels: self.yes(),
        };
        slice.into()
    }

    fn parameter(&mut self) -> Located<ParameterFile> {
        let any = |c: &mut Self| AnyValue(c.number().into());
        let parameter = ParameterFile {
            path: PathsFile(self.list(Self::text)).into(),
            values: self.some(|c| c.list(any).into()),
            range: self.some(|c| RangeFile { min: any(c), max: any(c) }.into()),
            every: u64::from(self.whole()).into(),
        };
        parameter.into()
    }

    fn scene(&mut self) -> SceneFile {
        SceneFile {
            name: self.some(Self::text),
            wavelengths_nm: self.list(Self::number).into(),
            render: RenderFile {
                spp: self.whole().into(),
                replicates: self.whole().into(),
                max_depth: self.whole().into(),
                rr_depth: self.whole(),
                integrator: [Integrator::Path, Integrator::Bidirectional][self.below(2) as usize],
                manifold: self.some(Self::yes),
                gaps: [GapsFile::Refuse, GapsFile::Warn][self.below(2) as usize],
                seed: self.word() >> 1,
                tile: self.whole().into(),
            },
            camera: self.camera().into(),
            projector: self.some(|c| c.projector().into()),
            emitters: self.list(Self::emitter),
            materials: self.map(Self::material),
            media: self.map(Self::medium),
            objects: self.list(Self::object),
            groups: self.map(|c| {
                let objects = c.list(Self::object);
                Located::nowhere(GroupFile { objects })
            }),
            instances: self.list(Self::instance),
            slices: self.list(Self::slice),
            figures: self.list(|c| {
                let text = c.text();
                toml::Table::from_iter([(text.clone(), toml::Value::String(text))])
            }),
            vary: self.map(Self::parameter),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..Default::default() })]

    #[test]
    #[ignore = "slow: tools/check --all"]
    fn any_scene_comes_back(words in prop::collection::vec(any::<u64>(), 0..600)) {
        let scene = Choices(words.iter()).scene();
        let text = scene.to_toml().expect("a text");
        let back: SceneFile = match toml::from_str(&text) {
            Ok(back) => back,
            Err(e) => return Err(TestCaseError::fail(format!("{e}\n{text}"))),
        };
        prop_assert_eq!(scene, back, "{}", text);
    }
}
