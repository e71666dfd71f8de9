//! Converts the values that several of Mitsuba's BSDFs use: metals, refractive indices, facets, and values
//! that can be images.

use super::importer::{Importer, is_spectrum};
use super::tree::{Node, Value};
use base::locate::{InputError, Located};
use optics::sampling::microfacet::{Distribution, Masking};
use syntax::material::ConductorFile;
use syntax::texture::{AlbedoFile, AttributeFile, CheckerboardFile, ImageAlbedo, ScalarFile, UvRows};
use syntax::values::{IndexFile, SpectrumFile};
use transport::material::constants;
use transport::material::texture::{Filter, Wrap};

/// Minimum roughness α of rough surfaces. Smooth coats have this roughness.
pub(super) const SMOOTH: f64 = 0.001;

/// Texture coordinate convention of a shape, and whether the current material depends on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coordinates {
    /// Whether Mitsuba's v coordinate is 1 minus Sunstone's v coordinate. Mitsuba flips v of OBJ files when
    /// it reads them.
    pub turned: bool,
    pub images: bool,
}

/// Refractive indices that Mitsuba defines by name (documentation of `dielectric`).
const INDICES: [(&str, f64); 20] = [
    ("vacuum", 1.0),
    ("helium", 1.000_036),
    ("hydrogen", 1.000_132),
    ("air", 1.000_277),
    ("carbon dioxide", 1.000_45),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.520_45),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("diamond", 2.419),
];

/// Returns the metal for Mitsuba's conductor. The defaults η = 0 and k = 1 reflect all light. They apply to a
/// conductor whose `material` is absent or `none`.
pub(super) fn metal<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    uv: &mut Coordinates,
) -> Result<ConductorFile, InputError> {
    let reflectance = albedo(importer, node, "specular_reflectance", 1.0, uv)?;
    let (n, k) = (importer.spectrum(node, "eta")?, importer.spectrum(node, "k")?);
    let name = node.text(importer.source, "material")?.filter(|name| *name != "none");
    let bare = |v: f64| Some(node.at(v.into()));
    let metal = |metal, n, k| ConductorFile { metal, n, k, reflectance };
    match (name, n, k) {
        (None, n, k) => {
            let [none, one] = import::metal::PERFECT;
            Ok(metal(None, n.or_else(|| bare(none)), k.or_else(|| bare(one))))
        }
        (Some(name), None, None) => match constants::find(name) {
            Ok(found) => {
                importer.note(format!("`{name}` uses Sunstone's optical constants ({})", found.source));
                let name = node.at(found.name.clone());
                Ok(metal(Some(name), None, None))
            }
            Err(e) => importer.error(&node.span, e.to_string(), "give eta and k as spectra"),
        },
        (Some(_), ..) => importer.error(
            &node.span,
            "material is given together with eta or k",
            "give both eta and k, or only material=\"Au\"",
        ),
    }
}

/// Refuses the factor `name` of a BSDF if it is not 1, because Sunstone's material does not have this factor.
pub(super) fn one(importer: &Importer, node: &Node, name: &str) -> Result<(), InputError> {
    match importer.spectrum(node, name)?.as_deref() {
        None => Ok(()),
        Some(SpectrumFile::Scalar(v)) if *v == 1.0 => Ok(()),
        Some(_) => importer.error(
            &node.span,
            format!("{name} of {} is not supported", node.kind),
            "remove the parameter; to darken a material, use a blendbsdf with a black bsdf",
        ),
    }
}

/// Returns a refractive index that is given as a number or as one of Mitsuba's material names.
fn index(importer: &Importer, node: &Node, name: &str, missing: f64) -> Result<f64, InputError> {
    let Some(p) = node.get(name) else {
        return Ok(missing);
    };
    if let Value::Text(text) = &p.value {
        let plain = text.to_lowercase();
        return INDICES.iter().find(|(n, _)| *n == plain).map(|(_, v)| *v).ok_or_else(|| {
            let names: Vec<&str> = INDICES.iter().map(|(n, _)| *n).collect();
            let fix = format!("give a number, or one of: {}", names.join(", "));
            importer.source.error(&p.span, format!("unknown refractive index `{text}`"), &fix)
        });
    }
    let error = || {
        importer.source.error(&p.span, format!("`{name}` is not a valid refractive index"), "give a number")
    };
    p.value.number().ok_or_else(error)
}

/// Returns the refractive indices inside and outside of a dielectric. `inside` is the default inside. The
/// default outside is air.
pub(super) fn indices(
    importer: &Importer,
    node: &Node,
    inside: f64,
) -> Result<[Located<IndexFile>; 2], InputError> {
    let at = |v: f64| node.at(v.into());
    Ok([at(index(importer, node, "int_ior", inside)?), at(index(importer, node, "ext_ior", 1.000_277)?)])
}

/// Returns the angle of a polarizer or retarder sheet in degrees, in Mitsuba's sense of rotation.
pub(super) fn angle(importer: &Importer, node: &Node) -> Result<f64, InputError> {
    let Some(p) = node.get("theta") else {
        return Ok(0.0);
    };
    let error = || importer.source.error(&p.span, "theta is not a number", "give an angle in degrees");
    p.value.number().ok_or_else(error)
}

pub(super) struct Facets {
    pub alpha: Located<ScalarFile>,
    pub distribution: Distribution,
    pub masking: Masking,
}

/// Returns the facets (GGX or Beckmann) of a rough surface, with Mitsuba's separable masking.
pub(super) fn facets<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    uv: &mut Coordinates,
) -> Result<Facets, InputError> {
    let source = importer.source;
    let kind = node.text(source, "distribution")?.unwrap_or("beckmann").to_lowercase();
    let distribution = match kind.as_str() {
        "beckmann" => Distribution::Beckmann,
        "ggx" => Distribution::Ggx,
        _ => {
            bail!(importer.source, &node.span, "unsupported distribution `{kind}`", "use beckmann or ggx");
        }
    };
    let has = |name: &str| node.named(name).is_some() || node.get(name).is_some();
    let mut number = |importer: &Importer<'a>, name, missing| {
        let read = scalar(importer, node, name, missing, uv)?;
        Ok::<_, InputError>((*read).clone())
    };
    let mut alpha = match (has("alpha_u"), has("alpha_v")) {
        (false, false) => number(importer, "alpha", Some(0.1))?,
        (true, true) => {
            let [u, v] = ["alpha_u", "alpha_v"].map(|name| number(importer, name, None));
            round(importer, node, u?, v?)?
        }
        (has_u, _) => {
            let [given, missing] = if has_u { ["alpha_u", "alpha_v"] } else { ["alpha_v", "alpha_u"] };
            return importer.error(
                &node.span,
                format!("{given} is given without {missing}"),
                "give both, or only alpha",
            );
        }
    };
    if numbers(&mut alpha).into_iter().any(|v| *v < SMOOTH) {
        importer.note(format!("alpha below {SMOOTH} is increased to {SMOOTH}"));
        numbers(&mut alpha).into_iter().for_each(|v| *v = v.max(SMOOTH));
    }
    let alpha = node.at(alpha);
    Ok(Facets { alpha, distribution, masking: Masking::Separable })
}

/// Returns references to the numbers of a constant or a checkerboard, or an empty list for an image.
fn numbers(s: &mut ScalarFile) -> Vec<&mut f64> {
    match s {
        ScalarFile::Number(v) => vec![v],
        ScalarFile::Image(_) | ScalarFile::Attribute(_) => vec![],
        ScalarFile::Checkerboard(board) => {
            let squares = board.checkerboard.iter_mut().filter_map(|s| match s {
                SpectrumFile::Scalar(v) => Some(v),
                _ => None,
            });
            squares.collect()
        }
    }
}

/// Returns the isotropic roughness that replaces separate roughnesses along the texture coordinates u and v:
/// their geometric mean.
fn round(
    importer: &mut Importer,
    node: &Node,
    mut u: ScalarFile,
    mut v: ScalarFile,
) -> Result<ScalarFile, InputError> {
    if u == v {
        return Ok(u);
    }
    let equal = match (&u, &v) {
        (ScalarFile::Number(_), ScalarFile::Number(_)) => true,
        (ScalarFile::Checkerboard(a), ScalarFile::Checkerboard(b)) => a.uv == b.uv,
        _ => false,
    };
    if !equal {
        return importer.error(
            &node.span,
            "alpha_u and alpha_v are different textures, but Sunstone's rough surfaces are isotropic",
            "give a single alpha",
        );
    }
    for (u, v) in numbers(&mut u).into_iter().zip(numbers(&mut v)) {
        *u = (*u * *v).sqrt();
    }
    importer.note(
        "alpha_u and alpha_v are replaced by their geometric mean, so highlights are round; for a ratio of six, the surface reflects up to \
         7 % (beckmann) or 9 % (ggx) more light in total, and up to 6 % less light at an angle of incidence of 80°",
    );
    Ok(u)
}

/// A texture: a value that varies over a surface.
enum Pattern {
    Image(ImageAlbedo),
    Checkerboard(CheckerboardFile),
    Attribute(AttributeFile),
}

/// Returns the texture of a property, or `None` if the property is not a texture.
fn pattern<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    name: &str,
    raw: bool,
    uv: &mut Coordinates,
) -> Result<Option<Pattern>, InputError> {
    let Some(child) = node.named(name) else {
        return Ok(None);
    };
    let inner = importer.resolve(child)?;
    if inner.tag != "texture" || is_spectrum(inner) {
        return Ok(None);
    }
    Ok(Some(match inner.kind.as_str() {
        "checkerboard" => Pattern::Checkerboard(checkerboard(importer, inner, uv)?),
        "mesh_attribute" => Pattern::Attribute(attribute(importer, inner)?),
        _ => Pattern::Image(bitmap(importer, inner, raw, uv)?),
    }))
}

/// Returns the colour image of a property, or `None` if the property is not an image.
pub(super) fn image_of<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    name: &str,
    uv: &mut Coordinates,
) -> Result<Option<ImageAlbedo>, InputError> {
    match pattern(importer, node, name, false, uv)? {
        Some(Pattern::Image(image)) => Ok(Some(image)),
        Some(Pattern::Checkerboard(_) | Pattern::Attribute(_)) => importer.error(
            &node.span,
            "an emitter with a checkerboard or a mesh attribute is not supported",
            "use a bitmap",
        ),
        None => Ok(None),
    }
}

/// Returns the map from the surface's texture coordinates to the texture coordinates at which Mitsuba
/// evaluates a texture.
fn to_uv(importer: &Importer, node: &Node, uv: &mut Coordinates) -> Result<UvRows, InputError> {
    uv.images = true;
    let map = node.transform(importer.source, "to_uv")?.unwrap_or_default();
    let (m, t) = (map.matrix3, map.translation);
    let rows = [[m.x_axis.x, m.y_axis.x, t.x], [m.x_axis.y, m.y_axis.y, t.y]];
    Ok(if uv.turned { rows.map(|[a, b, c]| [a, -b, b + c]) } else { rows })
}

/// Simplifies a texture coordinate map. Returns `None` for the identity. Integer offsets are dropped if the
/// texture repeats.
fn shortest(rows: UvRows, repeats: bool) -> Option<UvRows> {
    let rows = rows.map(|[a, b, c]| {
        let c = if repeats { c.rem_euclid(1.0) } else { c };
        [a, b, c].map(|v| v + 0.0)
    });
    (rows != [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).then_some(rows)
}

/// Converts Mitsuba's `mesh_attribute` texture to an attribute of the mesh.
fn attribute(importer: &Importer, node: &Node) -> Result<AttributeFile, InputError> {
    let name = node.text(importer.source, "name")?.unwrap_or_default();
    let scale = node.float(importer.source, "scale")?.unwrap_or(1.0);
    node.finish(importer.source, &[]);
    Ok(AttributeFile { attribute: node.at(name.to_owned()), scale })
}

fn checkerboard<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    uv: &mut Coordinates,
) -> Result<CheckerboardFile, InputError> {
    let rows = to_uv(importer, node, uv)?;
    let square = |name, missing| Ok::<_, InputError>((*importer.spectrum_or(node, name, missing)?).clone());
    let checkerboard = [square("color0", 0.4)?, square("color1", 0.2)?];
    node.finish(importer.source, &[]);
    Ok(CheckerboardFile { checkerboard, uv: shortest(rows, true) })
}

pub(super) fn scalar<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    name: &str,
    missing: Option<f64>,
    uv: &mut Coordinates,
) -> Result<Located<ScalarFile>, InputError> {
    let at = |v: ScalarFile| Ok(node.at(v));
    match pattern(importer, node, name, true, uv)? {
        Some(Pattern::Image(image)) => return at(image.into()),
        Some(Pattern::Checkerboard(mut board)) => {
            // Mitsuba 3.9 exchanges the colours if a number is requested (`eval_1` of its checkerboard).
            board.checkerboard.reverse();
            return at(ScalarFile::Checkerboard(board));
        }
        Some(Pattern::Attribute(attribute)) => return at(ScalarFile::Attribute(attribute)),
        None => {}
    }
    if let Some(uniform) = importer.uniform(node, name)? {
        return at(uniform.into());
    }
    match node.float(importer.source, name)?.or(missing) {
        Some(v) => at(v.into()),
        None => importer.error(
            &node.span,
            format!("{} has no `{name}`", node.kind),
            "add the parameter as a <float> or a bitmap",
        ),
    }
}

pub(super) fn albedo<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    name: &str,
    missing: f64,
    uv: &mut Coordinates,
) -> Result<Located<AlbedoFile>, InputError> {
    match pattern(importer, node, name, false, uv)? {
        Some(Pattern::Image(image)) => return Ok(node.at(image.into())),
        Some(Pattern::Checkerboard(board)) => return Ok(node.at(board.into())),
        Some(Pattern::Attribute(attribute)) => {
            return Ok(node.at(AlbedoFile::Attribute(attribute)));
        }
        None => {}
    }
    let spectrum = importer.spectrum_or(node, name, missing)?;
    Ok(Located::at(spectrum.span(), (*spectrum).clone().into()))
}

/// Converts Mitsuba's `bitmap` texture to an image. If `number` is true, the result is an image of numbers.
/// Each number is the luminance of the colour, as in Mitsuba.
pub(super) fn bitmap(
    importer: &Importer,
    node: &Node,
    number: bool,
    uv: &mut Coordinates,
) -> Result<ImageAlbedo, InputError> {
    let source = importer.source;
    if node.kind != "bitmap" {
        return importer.error(
            &node.span,
            format!("unsupported texture `{}`", node.kind),
            "use a bitmap, a checkerboard or a mesh_attribute",
        );
    }
    let name = importer.filename(node, "bitmap")?;
    let raw = node.boolean(source, "raw")?.unwrap_or(false);
    let chosen = |key: &str| Ok::<_, InputError>(node.text(source, key)?.unwrap_or_default().to_owned());
    let unknown = |key: &str, value: &str, known: &str| {
        importer.error(
            &node.span,
            format!("unsupported {key} `{value}` of a bitmap"),
            &format!("use {known}"),
        )
    };
    let filter = match chosen("filter_type")?.as_str() {
        "" | "bilinear" => Filter::Bilinear,
        "nearest" => Filter::Nearest,
        other => return unknown("filter_type", other, "bilinear or nearest"),
    };
    let wrap = match chosen("wrap_mode")?.as_str() {
        "" | "repeat" => Wrap::Repeat,
        "mirror" => Wrap::Mirror,
        "clamp" => Wrap::Clamp,
        other => return unknown("wrap_mode", other, "repeat, mirror or clamp"),
    };
    let [across, [d, e, f]] = to_uv(importer, node, uv)?;
    // Mitsuba's image rows start at the top.
    let rows = [across, [-d, -e, 1.0 - f]];
    node.finish(source, &["format", "accel"]);
    Ok(ImageAlbedo {
        image: node.at(importer.file(name)),
        scale: 1.0,
        uv: shortest(rows, wrap == Wrap::Repeat),
        wrap,
        filter,
        raw,
        luminance: number,
        layer: None,
    })
}
