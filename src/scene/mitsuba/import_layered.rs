//! Converts Mitsuba's unpolarized layered BSDFs (`plastic`, `roughplastic`, `principled`) to the closest
//! polarized models.

use super::import_surfaces::{Coordinates, SMOOTH, albedo, facets, indices, scalar};
use super::import_table::Table;
use super::importer::Importer;
use super::tree::Node;
use base::locate::{InputError, Located};
use import::body;
use optics::sampling::microfacet::{Distribution, Masking};
use syntax::material::{
    BlendFile, InterreflectionFile, MaterialFile, PassageFile, PlasticFile, RoughConductorFile,
    RoughDielectricFile,
};
use syntax::texture::{AlbedoFile, AttributeFile, ImageAlbedo, ScalarFile};
use syntax::values::{SpectrumFile, SpectrumTable};

/// Converts `plastic` and `roughplastic`: a dielectric coat over a Lambertian base with
/// interreflection below the coat.
pub(super) fn plastic<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    uv: &mut Coordinates,
) -> Result<PlasticFile, InputError> {
    importer.note(format!(
        "{} is polarized in Sunstone (Fresnel coat, depolarizing base), but not in Mitsuba",
        node.kind
    ));
    let base = albedo(importer, node, "diffuse_reflectance", 0.5, uv)?;
    let specular = importer.spectrum_or(node, "specular_reflectance", 1.0)?;
    let [ior, exterior_ior] = indices(importer, node, 1.49)?;
    let interreflection = if node.boolean(importer.source, "nonlinear")?.unwrap_or(false) {
        InterreflectionFile::Coloured
    } else {
        InterreflectionFile::Linear
    };
    let (alpha, distribution) = if node.kind == "plastic" {
        importer.note(format!("the smooth coat of plastic has a roughness of {SMOOTH} in Sunstone"));
        (node.at(SMOOTH.into()), Distribution::Beckmann)
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
        interreflection,
        passage: if node.kind == "plastic" { PassageFile::Smooth } else { PassageFile::SingleFacet },
        alpha,
        distribution,
        masking: Masking::Separable,
    })
}

/// Converts `principled` to a blend of plastic, metal (with the weight `metallic`) and rough glass (with the
/// weight `spec_trans`). Also returns whether the material is opaque.
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
    // For a roughness image, the body's albedo is computed at roughness 0.5, the middle of the range.
    let mut middle = 0.5;
    let alpha = if let ScalarFile::Number(v) = &*roughness {
        middle = v.clamp(0.0, 1.0);
        node.at((v * v).clamp(SMOOTH, 1.0).into())
    } else {
        importer.note(
            "principled: the roughness image is used as alpha, although roughness is the square root of alpha: a value of 0.5 has the effect of roughness 0.71",
        );
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
                "remove either eta or specular",
            );
        }
    };
    let mut lost = vec![];
    for name in
        ["anisotropic", "spec_tint", "sheen", "sheen_tint", "flatness", "clearcoat", "clearcoat_gloss"]
    {
        if node.named(name).is_some() || node.float(source, name)?.is_some_and(|v| v != 0.0) {
            lost.push(name);
        }
    }
    importer.note(
        "principled is converted to plastic (GGX coat, depolarizing base), blended with metal by `metallic` and with rough glass by \
         `spec_trans`; the brightness is equal within 2 % up to 45° from the normal; non-metals are 3 to 5 % darker at 60° and 9 to 17 % \
         darker at 75°",
    );
    if lost.contains(&"anisotropic") {
        importer.note(
            "principled: `anisotropic` is not used and highlights are round; for `anisotropic` = 0.6 and 0.9, metal is up to 4 % and 19 % \
             brighter, and other materials are up to 5 % and 10 % brighter at 80°",
        );
    }
    if !lost.is_empty() {
        importer.note(format!("principled: these parameters are not used: {}", lost.join(", ")));
    }
    let none = |s: &ScalarFile| *s == ScalarFile::Number(0.0);
    let mut body = MaterialFile::Plastic(Box::new(PlasticFile {
        albedo: body_of(importer, node, &base, body::principled(eta, middle)),
        ior: node.at(eta.into()),
        exterior_ior: node.at(1.0.into()),
        specular: node.at(1.0.into()),
        single_scatter: None,
        interreflection: InterreflectionFile::Linear,
        passage: PassageFile::Facets,
        alpha: alpha.clone(),
        distribution: Distribution::Ggx,
        masking: Masking::Separable,
    }));
    if !none(&metallic) {
        let metal = metal(importer, node, &base, &alpha);
        body = MaterialFile::Blend(BlendFile {
            a: table.add(node, &format!("{wanted}_coat"), body),
            b: table.add(node, &format!("{wanted}_metal"), metal),
            weight: metallic,
        });
    }
    let opaque = none(&spec_trans);
    if !opaque {
        let glass = MaterialFile::RoughDielectric(RoughDielectricFile {
            ior: node.at(eta.into()),
            exterior_ior: node.at(1.0.into()),
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
    node.finish(source, &["main_specular_sampling_rate", "diffuse_reflectance_sampling_rate"]);
    Ok((body, opaque))
}

/// Returns the albedo of the body below a coat: the base colour times `factor`, limited to 1.
fn body_of(
    importer: &mut Importer,
    node: &Node,
    base: &Located<AlbedoFile>,
    factor: f64,
) -> Located<AlbedoFile> {
    let mut brightest = 0.0_f64;
    let mut times = |v: &f64| {
        brightest = brightest.max(v * factor);
        (v * factor).min(1.0)
    };
    let scaled = match &**base {
        AlbedoFile::Spectrum(SpectrumFile::Scalar(v)) => SpectrumFile::Scalar(times(v)).into(),
        AlbedoFile::Spectrum(SpectrumFile::PerWavelength(list)) => {
            SpectrumFile::PerWavelength(list.iter().map(times).collect()).into()
        }
        AlbedoFile::Spectrum(SpectrumFile::Table(table)) => {
            let values = table.values.iter().map(times).collect();
            SpectrumFile::Table(SpectrumTable { values, ..table.clone() }).into()
        }
        AlbedoFile::Image(image) => {
            AlbedoFile::Image(ImageAlbedo { scale: image.scale * factor, ..image.clone() })
        }
        AlbedoFile::Attribute(attribute) => {
            AlbedoFile::Attribute(AttributeFile { scale: attribute.scale * factor, ..attribute.clone() })
        }
        AlbedoFile::Checkerboard(board) => {
            importer.note(format!(
                "principled: the checkerboard of the base colour deviates from Mitsuba's by up to {:.1} %",
                (factor - 1.0).abs() * 100.0
            ));
            AlbedoFile::Checkerboard(board.clone())
        }
    };
    if brightest > 1.0 {
        importer.note(format!(
            "{}: Mitsuba's principled reflects more light than it receives; in Sunstone the reflectance is limited to 1 and is \
             {:.1} % lower at normal incidence",
            node.id.as_deref().unwrap_or("principled"),
            (1.0 - 1.0 / brightest) * 100.0
        ));
    }
    Located::at(base.span(), scaled)
}

/// Returns a metal that reflects the base colour at normal incidence. The increase of reflectance
/// toward grazing incidence is close to Schlick's approximation.
fn metal(
    importer: &mut Importer,
    node: &Node,
    base: &Located<AlbedoFile>,
    alpha: &Located<ScalarFile>,
) -> MaterialFile {
    let list = match &**base {
        AlbedoFile::Spectrum(SpectrumFile::Scalar(r)) => Some(vec![*r]),
        AlbedoFile::Spectrum(SpectrumFile::PerWavelength(list)) => Some(list.clone()),
        _ => None,
    };
    let indices: Option<Vec<[f64; 2]>> =
        list.map(|list| list.into_iter().map(import::metal::metal).collect());
    let column = |indices: &[[f64; 2]], i: usize| match indices {
        [only] => SpectrumFile::Scalar(only[i]),
        all => SpectrumFile::PerWavelength(all.iter().map(|nk| nk[i]).collect()),
    };
    if indices.is_none() {
        importer.note(
            "principled: metal with an image has the same colour at all angles; in Mitsuba such metal reflects more beyond 60° from \
             the normal",
        );
    }
    MaterialFile::RoughConductor(RoughConductorFile {
        metal: indices.is_none().then(|| node.at("mirror".to_owned())),
        n: indices.as_deref().map(|nk| node.at(column(nk, 0))),
        k: indices.as_deref().map(|nk| node.at(column(nk, 1))),
        reflectance: if indices.is_some() { node.at(1.0.into()) } else { base.clone() },
        alpha: alpha.clone(),
        distribution: Distribution::Ggx,
        masking: Masking::Separable,
    })
}
