//! Mitsuba's layered BSDFs without polarization (`plastic`, `roughplastic`, `principled`) → the nearest polarized models.

use super::import_surfaces::{Coordinates, albedo, facets, indices, scalar};
use super::import_table::Table;
use super::importer::Importer;
use super::tree::Node;
use base::locate::{InputError, Located};
use optics::sampling::microfacet::{Distribution, Masking};
use optics::spectrum::Spectral;
use syntax::material::{BlendFile, MaterialFile, PlasticFile, RoughConductorFile, RoughDielectricFile};
use syntax::texture::{AlbedoFile, ScalarFile};
use syntax::values::{IndexFile, SpectrumFile};
use transport::material::plastic::internal_reflectance;

/// Roughness that stands for a smooth coat.
const SMOOTH: f64 = 0.001;

fn at<T>(node: &Node, value: T) -> Located<T> {
    Located::at(node.span.clone(), value)
}

/// `plastic` and `roughplastic`: a dielectric coat over a Lambertian base with interreflection below the coat.
pub(super) fn plastic<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    uv: &mut Coordinates,
) -> Result<PlasticFile, InputError> {
    importer.note(format!(
        "{} is polarized in sunstone (Fresnel coat, depolarizing base); Mitsuba's is not",
        node.kind
    ));
    if node.kind == "roughplastic" {
        importer.note(
            "Mitsuba's rough coat throws less light back into the base: ours is up to a tenth brighter",
        );
    }
    let mut base: Located<AlbedoFile> = albedo(importer, node, "diffuse_reflectance", 0.5, uv)?;
    let specular = importer.spectrum_or(node, "specular_reflectance", 1.0)?;
    let [ior, exterior_ior] = indices(importer, node, 1.49)?;
    if !node.boolean(importer.source, "nonlinear")?.unwrap_or(false) {
        base = linear(importer, node, base, &ior, &exterior_ior);
    }
    let (alpha, distribution) = if node.kind == "plastic" {
        importer.note(format!(
            "the smooth coat of plastic has a roughness of {SMOOTH} in sunstone"
        ));
        (at(node, SMOOTH.into()), Distribution::Beckmann)
    } else {
        let facets = facets(importer, node, uv)?;
        (facets.alpha, facets.distribution)
    };
    Ok(PlasticFile {
        albedo: base,
        ior,
        exterior_ior,
        specular,
        single_scatter: None,
        interreflection: true,
        alpha,
        distribution,
        masking: Masking::Separable,
    })
}

/// The albedo ρ' that gives with our interreflection ρ'/(1 - ρ'F) what Mitsuba's linear one gives, ρ/(1 - F): the colour
/// of light thrown back below the coat does not grow deeper there.
fn linear(
    importer: &mut Importer,
    node: &Node,
    base: Located<AlbedoFile>,
    ior: &IndexFile,
    exterior: &IndexFile,
) -> Located<AlbedoFile> {
    let number = |index: &IndexFile| match index {
        IndexFile::Values(SpectrumFile::Scalar(v)) => *v,
        _ => 1.0,
    };
    let eta = (number(ior) / number(exterior)) as f32;
    let f = f64::from(internal_reflectance(Spectral::splat(eta)).to_array()[0]);
    let changed = |v: f64| v / (1.0 - f + v * f);
    let spectrum = match &*base {
        AlbedoFile::Spectrum(SpectrumFile::Scalar(v)) => SpectrumFile::Scalar(changed(*v)),
        AlbedoFile::Spectrum(SpectrumFile::PerWavelength(list)) => {
            SpectrumFile::PerWavelength(list.iter().map(|v| changed(*v)).collect())
        }
        _ => {
            importer.note(format!(
                "the colours of {}'s image grow deeper by light thrown back below the coat: nonlinear = true",
                node.kind
            ));
            return base;
        }
    };
    Located::at(base.span(), spectrum.into())
}

/// `principled`: plastic, mixed with metal by `metallic` and with rough glass by `spec_trans`. True of what light does not
/// pass through.
pub(super) fn principled<'a>(
    importer: &mut Importer<'a>,
    table: &mut Table,
    node: &'a Node,
    wanted: &str,
    uv: &mut Coordinates,
) -> Result<(MaterialFile, bool), InputError> {
    let source = importer.source;
    let base = albedo(importer, node, "base_color", 0.5, uv)?;
    let roughness = scalar(importer, node, "roughness", Some(0.5), uv)?;
    let alpha = if let ScalarFile::Number(v) = &*roughness {
        at(node, (v * v).clamp(SMOOTH, 1.0).into())
    } else {
        importer.note("principled: the image of roughness is taken as alpha, not as its root");
        roughness
    };
    let metallic = scalar(importer, node, "metallic", Some(0.0), uv)?;
    let spec_trans = scalar(importer, node, "spec_trans", Some(0.0), uv)?;
    let eta = match (node.float(source, "eta")?, node.float(source, "specular")?) {
        (Some(eta), None) => eta,
        (None, specular) => 2.0 / (1.0 - (0.08 * specular.unwrap_or(0.5)).sqrt()) - 1.0,
        (Some(_), Some(_)) => {
            return importer.error(
                &node.span,
                "both eta and specular are given",
                "keep one of the two",
            );
        }
    };
    let mut lost = vec![];
    for name in [
        "anisotropic",
        "spec_tint",
        "sheen",
        "sheen_tint",
        "flatness",
        "clearcoat",
        "clearcoat_gloss",
    ] {
        if node.float(source, name)?.is_some_and(|v| v != 0.0) {
            lost.push(name);
        }
    }
    importer.note(
        "principled becomes plastic (GGX coat, depolarizing base), mixed with metal by `metallic` and with rough glass by `spec_trans`",
    );
    if !lost.is_empty() {
        importer.note(format!("principled: not used are {}", lost.join(", ")));
    }
    let none = |s: &ScalarFile| *s == ScalarFile::Number(0.0);
    let mut body = MaterialFile::Plastic(Box::new(PlasticFile {
        albedo: base.clone(),
        ior: at(node, eta.into()),
        exterior_ior: at(node, 1.0.into()),
        specular: at(node, 1.0.into()),
        single_scatter: None,
        interreflection: true,
        alpha: alpha.clone(),
        distribution: Distribution::Ggx,
        masking: Masking::Separable,
    }));
    if !none(&metallic) {
        let metal = metal(importer, node, &base, &alpha)?;
        body = MaterialFile::Blend(BlendFile {
            a: table.add(node, &format!("{wanted}_coat"), body),
            b: table.add(node, &format!("{wanted}_metal"), metal),
            weight: metallic,
        });
    }
    let opaque = none(&spec_trans);
    if !opaque {
        let glass = MaterialFile::RoughDielectric(RoughDielectricFile {
            ior: at(node, eta.into()),
            exterior_ior: at(node, 1.0.into()),
            alpha,
            distribution: Distribution::Ggx,
            masking: Masking::Separable,
        });
        body = MaterialFile::Blend(BlendFile {
            a: table.add(node, &format!("{wanted}_opaque"), body),
            b: table.add(node, &format!("{wanted}_glass"), glass),
            weight: spec_trans,
        });
    }
    node.finish(
        source,
        &["main_specular_sampling_rate", "diffuse_reflectance_sampling_rate"],
    );
    Ok((body, opaque))
}

/// A metal that reflects the base colour R at normal incidence: n = (1 + √R)/(1 - √R), k = 0 (Gulbrandsen 2014, eq. 2 at
/// its upper bound).
fn metal(
    importer: &Importer,
    node: &Node,
    base: &AlbedoFile,
    alpha: &Located<ScalarFile>,
) -> Result<MaterialFile, InputError> {
    let index = |r: f64| {
        let root = r.clamp(0.0, 0.98).sqrt();
        (1.0 + root) / (1.0 - root)
    };
    let n = match base {
        AlbedoFile::Spectrum(SpectrumFile::Scalar(r)) => SpectrumFile::Scalar(index(*r)),
        AlbedoFile::Spectrum(SpectrumFile::PerWavelength(list)) => {
            SpectrumFile::PerWavelength(list.iter().map(|r| index(*r)).collect())
        }
        _ => {
            return importer.error(
                &node.span,
                "sunstone has no metals whose colour is an image",
                "give a colour, or metallic = 0",
            );
        }
    };
    Ok(MaterialFile::RoughConductor(RoughConductorFile {
        metal: None,
        n: Some(at(node, n)),
        k: Some(at(node, SpectrumFile::Scalar(0.0))),
        alpha: alpha.clone(),
        distribution: Distribution::Ggx,
        masking: Masking::Separable,
    }))
}
