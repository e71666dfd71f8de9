//! Converts Mitsuba's participating media to media of a scene file.

use super::importer::Importer;
use super::names::{free, plain};
use super::tree::Node;
use crate::build::pose::matrix;
use base::locate::{InputError, Located};
use glam::DAffine3;
use std::collections::BTreeMap;
use syntax::medium::{
    GridFile, GridFilter, HenyeyGreensteinFile, HeterogeneousFile, HomogeneousFile, MediumFile, PhaseFile,
    RayleighFile,
};
use syntax::values::SpectrumFile;

/// Converts media. Each medium is converted only once.
#[derive(Default)]
pub(super) struct MediumReader {
    /// Converted media by name.
    pub media: BTreeMap<String, Located<MediumFile>>,
    /// Names of converted media by the byte offset of their XML element.
    done: BTreeMap<usize, String>,
}

impl MediumReader {
    pub fn named<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
    ) -> Result<Located<String>, InputError> {
        let at = |name: &str| node.at(name.to_owned());
        if let Some(name) = self.done.get(&node.span.start) {
            return Ok(at(name));
        }
        let medium = medium(importer, node)?;
        let base = plain(node.id.as_deref().unwrap_or("medium"));
        let name = free(&base, |name| self.media.contains_key(name));
        self.media.insert(name.clone(), node.at(medium));
        self.done.insert(node.span.start, name.clone());
        Ok(at(&name))
    }
}

fn medium<'a>(importer: &mut Importer<'a>, node: &'a Node) -> Result<MediumFile, InputError> {
    if !["homogeneous", "heterogeneous"].contains(&node.kind.as_str()) {
        return importer.error(
            &node.span,
            format!("unsupported medium `{}`", node.kind),
            "use homogeneous or heterogeneous",
        );
    }
    let heterogeneous = node.kind == "heterogeneous";
    let extinction = coefficient(importer, node, "sigma_t", 1.0)?;
    let albedo = coefficient(importer, node, "albedo", 0.75)?;
    let scale = node.float(importer.source, "scale")?.unwrap_or(1.0);
    let nm = importer.wavelengths.clone();
    let at = |s: &Coefficient, i: usize| match s {
        Coefficient::Grid(_) => 1.0,
        Coefficient::Everywhere(s, _) => match &**s {
            SpectrumFile::Scalar(v) => *v,
            SpectrumFile::PerWavelength(list) => list.get(i).copied().unwrap_or_default(),
            SpectrumFile::Table(table) => table.table().at(nm[i]),
        },
    };
    let each = |f: &dyn Fn(f64, f64) -> f64| {
        let values: Vec<f64> = (0..nm.len()).map(|i| scale * f(at(&extinction, i), at(&albedo, i))).collect();
        let spectrum = if values.iter().all(|v| *v == values[0]) {
            SpectrumFile::Scalar(values[0])
        } else {
            SpectrumFile::PerWavelength(values)
        };
        node.at(spectrum)
    };
    let (scattering, absorption) = (each(&|t, a| t * a), each(&|t, a| t * (1.0 - a)));
    let mut phase = None;
    // Coefficients are read by name. `finish` reports other children.
    for child in node.children() {
        let inner = importer.peek(child)?;
        if inner.tag != "phase" {
            continue;
        }
        child.take();
        if phase.is_some() {
            return importer.error(
                child.span(),
                "the medium has a second phase function",
                "keep one phase function",
            );
        }
        phase = Some(phase_function(importer, inner)?);
    }
    let phase = phase.unwrap_or(PhaseFile::Isotropic);
    if !node.boolean(importer.source, "sample_emitters")?.unwrap_or(true) {
        importer.note("sample_emitters = false of a medium is not used: Sunstone samples emitters in media");
    }
    // `has_spectral_extinction` affects only how distances are sampled.
    node.finish(importer.source, &["has_spectral_extinction"]);
    let index = node.at(1.0.into());
    let albedo = match albedo {
        Coefficient::Grid(grid) => Some(*grid),
        Coefficient::Everywhere(..) => None,
    };
    if !heterogeneous && albedo.is_none() && matches!(extinction, Coefficient::Everywhere(..)) {
        return Ok(MediumFile::Homogeneous(Box::new(HomogeneousFile {
            absorption,
            scattering,
            index,
            phase,
        })));
    }
    let density = match extinction {
        Coefficient::Grid(grid) => *grid,
        // Mitsuba's heterogeneous media end at the box of their extinction, which is the unit cube by
        // default.
        Coefficient::Everywhere(_, place) if heterogeneous => one(importer, node, place),
        Coefficient::Everywhere(..) => {
            return importer.error(
                &node.span,
                "a homogeneous medium cannot have an albedo grid",
                "use a heterogeneous medium with a gridvolume for sigma_t",
            );
        }
    };
    Ok(MediumFile::Heterogeneous(Box::new(HeterogeneousFile {
        absorption,
        scattering,
        index,
        phase,
        density,
        albedo,
    })))
}

/// The extinction or the albedo of a medium.
enum Coefficient {
    /// A constant spectrum, and the transform of its volume.
    Everywhere(Located<SpectrumFile>, DAffine3),
    Grid(Box<Located<GridFile>>),
}

/// Returns a coefficient given as a number, a spectrum or a volume.
fn coefficient(
    importer: &Importer,
    node: &Node,
    name: &str,
    missing: f64,
) -> Result<Coefficient, InputError> {
    let mut place = DAffine3::IDENTITY;
    if let Some(child) = node.named(name) {
        let inner = importer.resolve(child)?;
        if inner.tag == "volume" {
            place = inner.transform(importer.source, "to_world")?.unwrap_or_default();
        }
        if inner.tag == "volume" && inner.kind == "constvolume" {
            let value = importer.spectrum_or(inner, "value", missing)?;
            inner.finish(importer.source, &[]);
            return Ok(Coefficient::Everywhere(value, place));
        }
        if inner.tag == "volume" && inner.kind == "gridvolume" {
            return Ok(Coefficient::Grid(Box::new(grid(importer, inner, place)?)));
        }
    }
    Ok(Coefficient::Everywhere(importer.spectrum_or(node, name, missing)?, place))
}

fn grid(importer: &Importer, node: &Node, place: DAffine3) -> Result<Located<GridFile>, InputError> {
    let source = importer.source;
    let name = importer.filename(node, "volume")?;
    let filter = match node.text(source, "filter_type")?.unwrap_or("trilinear") {
        "trilinear" => GridFilter::Trilinear,
        "nearest" => GridFilter::Nearest,
        other => {
            let what = format!("unsupported filter_type `{other}` of a volume");
            return importer.error(&node.span, what, "use trilinear or nearest");
        }
    };
    if let Some(other) = node.text(source, "wrap_mode")?.filter(|mode| *mode != "clamp") {
        let what = format!("unsupported wrap_mode `{other}` of a volume");
        return importer.error(&node.span, what, "use clamp (the default)");
    }
    let own = node.boolean(source, "use_grid_bbox")?.unwrap_or(false);
    // `raw` controls the conversion to spectra, and `accel` controls the acceleration of look-ups.
    node.finish(source, &["raw", "accel"]);
    Ok(node.at(GridFile {
        file: node.at(importer.file(name)),
        corners: (!own).then_some(UNIT),
        transform: (place != DAffine3::IDENTITY).then(|| node.at(matrix(&place))),
        filter,
    }))
}

/// Default bounding box of a volume: the lowest and highest x, y and z, in the volume's coordinates.
const UNIT: [[f64; 3]; 2] = [[0.0; 3], [1.0; 3]];

/// Returns a grid with a single value of 1, which is written to a file next to the scene file.
fn one(importer: &mut Importer, node: &Node, place: DAffine3) -> Located<GridFile> {
    let words = [1_i32, 1, 1, 1, 1].map(i32::to_le_bytes);
    let numbers = [0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0].map(f32::to_le_bytes);
    let bytes = [b"VOL\x03", words.as_flattened(), numbers.as_flattened()].concat();
    let file = importer.make("everywhere", "vol", bytes);
    node.at(GridFile {
        file: node.at(file),
        corners: Some(UNIT),
        transform: (place != DAffine3::IDENTITY).then(|| node.at(matrix(&place))),
        filter: GridFilter::Nearest,
    })
}

fn phase_function(importer: &mut Importer, node: &Node) -> Result<PhaseFile, InputError> {
    let at = |v: f64| node.at(v);
    let phase = match node.kind.as_str() {
        "isotropic" => PhaseFile::Isotropic,
        "hg" => PhaseFile::HenyeyGreenstein(HenyeyGreensteinFile {
            g: node.at(node.float(importer.source, "g")?.unwrap_or(0.8).into()),
            linear: at(0.0),
            circular: at(0.0),
        }),
        "rayleigh" => {
            importer.note("rayleigh scattering is polarized in Sunstone");
            PhaseFile::Rayleigh(RayleighFile { depolarization: at(0.0) })
        }
        other => {
            return importer.error(
                &node.span,
                format!("unsupported phase function `{other}`"),
                "use isotropic, hg or rayleigh",
            );
        }
    };
    node.finish(importer.source, &[]);
    Ok(phase)
}
