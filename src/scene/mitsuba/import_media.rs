//! Mitsuba's participating media → media of a scene file.

use super::importer::Importer;
use super::names::plain;
use super::tree::Node;
use base::locate::{InputError, Located};
use std::collections::BTreeMap;
use syntax::medium::{HenyeyGreensteinFile, HomogeneousFile, MediumFile, PhaseFile, RayleighFile};
use syntax::values::SpectrumFile;

/// Reads media, each once.
#[derive(Default)]
pub(super) struct MediumReader {
    /// The media so far, by name.
    pub media: BTreeMap<String, Located<MediumFile>>,
    /// Name of the medium that begins at a byte.
    done: BTreeMap<usize, String>,
}

impl MediumReader {
    /// The name of a medium.
    pub fn named<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
    ) -> Result<Located<String>, InputError> {
        let at = |name: &str| Located::at(node.span.clone(), name.to_owned());
        if let Some(name) = self.done.get(&node.span.start) {
            return Ok(at(name));
        }
        let medium = homogeneous(importer, node)?;
        let base = plain(node.id.as_deref().unwrap_or("medium"));
        let mut name = base.clone();
        let mut n = 2;
        while self.media.contains_key(&name) {
            name = format!("{base}_{n}");
            n += 1;
        }
        self.media
            .insert(name.clone(), Located::at(node.span.clone(), medium));
        self.done.insert(node.span.start, name.clone());
        Ok(at(&name))
    }
}

fn homogeneous<'a>(importer: &mut Importer<'a>, node: &'a Node) -> Result<MediumFile, InputError> {
    if node.kind != "homogeneous" {
        return importer.error(
            &node.span,
            format!("sunstone has no medium `{}`", node.kind),
            "use homogeneous",
        );
    }
    let extinction = coefficient(importer, node, "sigma_t", 1.0)?;
    let albedo = coefficient(importer, node, "albedo", 0.75)?;
    let scale = node.float(importer.source, "scale")?.unwrap_or(1.0);
    let nm = importer.wavelengths.clone();
    let at = |s: &SpectrumFile, i: usize| match s {
        SpectrumFile::Scalar(v) => *v,
        SpectrumFile::PerWavelength(list) => list.get(i).copied().unwrap_or_default(),
        SpectrumFile::Table(table) => table.table().at(nm[i]),
    };
    let each = |f: &dyn Fn(f64, f64) -> f64| {
        let values: Vec<f64> = (0..nm.len())
            .map(|i| scale * f(at(&extinction, i), at(&albedo, i)))
            .collect();
        let spectrum = if values.iter().all(|v| *v == values[0]) {
            SpectrumFile::Scalar(values[0])
        } else {
            SpectrumFile::PerWavelength(values)
        };
        Located::at(node.span.clone(), spectrum)
    };
    let (scattering, absorption) = (each(&|t, a| t * a), each(&|t, a| t * (1.0 - a)));
    let mut phase = None;
    // Coefficients have been read by name; what else is inside is reported by `finish`.
    for child in node.children() {
        let inner = importer.peek(child)?;
        if inner.tag != "phase" {
            continue;
        }
        child.take();
        if phase.is_some() {
            return importer.error(child.span(), "the medium has a second phase function", "keep one");
        }
        phase = Some(phase_function(importer, inner)?);
    }
    let phase = phase.unwrap_or(PhaseFile::Isotropic);
    if !node.boolean(importer.source, "sample_emitters")?.unwrap_or(true) {
        importer
            .note("sample_emitters = false of a medium: sunstone looks for emitters in media as elsewhere");
    }
    // How distances are sampled.
    node.finish(importer.source, &["has_spectral_extinction"]);
    Ok(MediumFile::Homogeneous(Box::new(HomogeneousFile {
        absorption,
        scattering,
        index: Located::at(node.span.clone(), 1.0.into()),
        phase,
    })))
}

/// A coefficient, which may stand in a volume that is the same everywhere.
fn coefficient(
    importer: &Importer,
    node: &Node,
    name: &str,
    missing: f64,
) -> Result<Located<SpectrumFile>, InputError> {
    if let Some(child) = node.named(name) {
        let inner = importer.resolve(child)?;
        if inner.tag == "volume" && inner.kind == "constvolume" {
            let value = importer.spectrum_or(inner, "value", missing)?;
            inner.finish(importer.source, &[]);
            return Ok(value);
        }
    }
    importer.spectrum_or(node, name, missing)
}

fn phase_function(importer: &mut Importer, node: &Node) -> Result<PhaseFile, InputError> {
    let at = |v: f64| Located::at(node.span.clone(), v);
    let phase = match node.kind.as_str() {
        "isotropic" => PhaseFile::Isotropic,
        "hg" => PhaseFile::HenyeyGreenstein(HenyeyGreensteinFile {
            g: Located::at(
                node.span.clone(),
                node.float(importer.source, "g")?.unwrap_or(0.8).into(),
            ),
            linear: at(0.0),
            circular: at(0.0),
        }),
        "rayleigh" => {
            importer.note("rayleigh scattering is polarized in sunstone");
            PhaseFile::Rayleigh(RayleighFile {
                depolarization: at(0.0),
            })
        }
        other => {
            return importer.error(
                &node.span,
                format!("sunstone has no phase function `{other}`"),
                "use isotropic, hg or rayleigh",
            );
        }
    };
    node.finish(importer.source, &[]);
    Ok(phase)
}
