//! Converts material descriptions of mesh files to the closest Sunstone models.
//!
//! A base without a coat becomes diffuse. A base with a coat becomes plastic, whose body albedo gives the
//! same directional albedo at normal incidence as the file's model ([`import::body`]). Metal has refractive
//! indices whose reflectance at normal incidence is the metal's colour ([`import::metal`]). Transmissive
//! materials become glass if they refract, and a thin sheet otherwise.

use super::context::Context;
use base::locate::Located;
use image::{ImageBuffer, ImageFormat, Rgb, Rgba};
use import::appearance::{Appearance, Coat, Model, Opacity, Picture, Source};
use import::body;
use optics::sampling::microfacet::{Distribution, Masking};
use syntax::material::{
    BlendFile, ConductorFile, DielectricFile, DiffuseFile, InterreflectionFile, MaterialFile, NormalMapFile,
    NullFile, PassageFile, PlasticFile, RetarderFile, RoughConductorFile, RoughDielectricFile, TiltFile,
};
use syntax::texture::{AlbedoFile, ImageAlbedo, ScalarFile};
use syntax::values::SpectrumFile;

const SMOOTH: f64 = 0.001;

/// The materials that are created for one material of a file.
pub(super) struct Table<'a> {
    ctx: &'a mut Context,
    file: &'a Located<String>,
    name: &'a str,
    /// Created materials by name. The last entry is the material that replaces the file's material.
    pub made: Vec<(String, MaterialFile)>,
}

/// Texel of an image: a linear colour, or three numbers.
type Texel = [f32; 3];

struct Texels {
    size: [u32; 2],
    values: Vec<Texel>,
}

impl<'a> Table<'a> {
    /// Creates the materials for an appearance. Their names are `name` and names that begin with `name`.
    pub fn new(ctx: &'a mut Context, file: &'a Located<String>, name: &'a str, a: &Appearance) -> Self {
        let mut out = Self { ctx, file, name, made: vec![] };
        let body = out.material(a);
        out.made.push((name.to_owned(), body));
        out
    }

    fn at<T>(&self, value: T) -> Located<T> {
        Located::at(self.file.span(), value)
    }

    fn note(&mut self, text: &str) {
        self.ctx.note(format!("{}: {text}", self.name));
    }

    fn add(&mut self, part: &str, material: MaterialFile) -> Located<String> {
        let name = format!("{}/{part}", self.name);
        self.made.push((name.clone(), material));
        self.at(name)
    }

    fn material(&mut self, a: &Appearance) -> MaterialFile {
        let strongest = a.mirror.into_iter().fold(0.0, f64::max);
        let mut body = match a.coat {
            _ if strongest > 0.0 => self.beside_mirror(a, strongest),
            Some(coat) => self.plastic(a, coat),
            None => MaterialFile::Diffuse(DiffuseFile { albedo: self.albedo(a, |v| v) }),
        };
        if a.metallic > 0.0 {
            let metal = self.metal(a);
            let weight = self.metallic(a);
            body = self.mixed(["base", "metal"], body, metal, weight);
        }
        if a.transmission > 0.0 {
            let glass = self.transparent(a);
            body = self.mixed(["opaque", "glass"], body, glass, a.transmission.into());
        }
        if let Some((picture, strength)) = &a.normals {
            let image = self.name_of(picture);
            let material = self.add("smooth", body);
            body = MaterialFile::NormalMap(NormalMapFile {
                material,
                image: self.at(image),
                strength: self.at(*strength),
                uv: picture.uv,
                wrap: picture.wrap,
                filter: picture.filter,
                layer: None,
            });
        }
        let opacity = self.opacity(a);
        if opacity != ScalarFile::Number(1.0) {
            body = self.mixed(["hole", "there"], MaterialFile::Null(NullFile {}), body, opacity);
        }
        body
    }

    /// Returns the area-weighted blend of the materials `a` and `b`. `weight` is the share of `b`, 0..1.
    fn mixed(
        &mut self,
        [first, second]: [&str; 2],
        a: MaterialFile,
        b: MaterialFile,
        weight: ScalarFile,
    ) -> MaterialFile {
        match weight {
            ScalarFile::Number(w) if w >= 1.0 => return b,
            ScalarFile::Number(w) if w <= 0.0 => return a,
            _ => {}
        }
        MaterialFile::Blend(BlendFile {
            a: self.add(first, a),
            b: self.add(second, b),
            weight: self.at(weight),
        })
    }

    fn plastic(&mut self, a: &Appearance, coat: Coat) -> MaterialFile {
        // For a roughness image, use roughness 0.5, the middle of the range. α is the squared roughness.
        let alpha = if a.metallic_roughness.is_some() { a.alpha / 4.0 } else { a.alpha };
        let reflected = body::coat_albedo(coat.ior, alpha, Masking::Correlated);
        let albedo = match a.model {
            Model::Gltf => {
                let factor = body::gltf(coat.ior, alpha);
                self.albedo(a, |v| v * factor)
            }
            // MTL's colour is the albedo of coat and body together.
            Model::Mtl => self.albedo(a, |v| ((v - reflected) / (1.0 - reflected)).max(0.0)),
        };
        let specular = self.colour(coat.colour);
        MaterialFile::Plastic(Box::new(PlasticFile {
            albedo,
            ior: self.at(coat.ior.into()),
            exterior_ior: self.at(1.0.into()),
            specular: self.at(specular),
            single_scatter: None,
            interreflection: InterreflectionFile::Linear,
            passage: PassageFile::Facets,
            alpha: self.alpha(a),
            distribution: Distribution::default(),
            masking: Masking::default(),
        }))
    }

    /// Returns the area-weighted blend of a diffuse base and a mirror. Their albedos add up to at most 1.
    /// Each albedo is divided by the area share of its material.
    fn beside_mirror(&mut self, a: &Appearance, share: f64) -> MaterialFile {
        let rest = (1.0 - share).max(1e-9);
        let base = MaterialFile::Diffuse(DiffuseFile { albedo: self.albedo(a, |v| v / rest) });
        let reflectance = self.colour(a.mirror.map(|v| v / share)).into();
        let metal = Some(self.at("mirror".to_owned()));
        let (n, k) = (None, None);
        let reflectance = self.at(reflectance);
        // The mirror is smooth for MTL and has the material's roughness for glTF.
        let mirror = if a.model == Model::Mtl {
            MaterialFile::Conductor(ConductorFile { metal, n, k, reflectance })
        } else {
            MaterialFile::RoughConductor(RoughConductorFile {
                metal,
                n,
                k,
                reflectance,
                alpha: self.alpha(a),
                distribution: Distribution::default(),
                masking: Masking::default(),
            })
        };
        self.mixed(["beside_mirror", "mirror"], base, mirror, share.into())
    }

    fn metal(&mut self, a: &Appearance) -> MaterialFile {
        let mut brightest = a.base;
        let reflectance = match &a.image {
            None => 1.0.into(),
            Some(picture) => {
                // Use the refractive indices of the brightest texel. The image attenuates the reflectance
                // of all other texels.
                let most = self.brightest(picture);
                brightest = std::array::from_fn(|i| a.base[i] * f64::from(most[i]));
                let reference = most.map(|v| v.max(1e-6));
                self.derived(picture, "metal", move |t| [0, 1, 2].map(|i| t[i] / reference[i]))
            }
        };
        let indices = brightest.map(import::metal::metal);
        let column = |i: usize| self.colour([0, 1, 2].map(|c| indices[c][i]));
        let (n, k) = (column(0), column(1));
        MaterialFile::RoughConductor(RoughConductorFile {
            metal: None,
            n: Some(self.at(n)),
            k: Some(self.at(k)),
            reflectance: self.at(reflectance),
            alpha: self.alpha(a),
            distribution: Distribution::default(),
            masking: Masking::default(),
        })
    }

    /// Returns glass if the appearance refracts, otherwise a thin sheet.
    fn transparent(&mut self, a: &Appearance) -> MaterialFile {
        let (ior, exterior_ior) = (self.at(a.ior.into()), self.at(1.0.into()));
        let tinted = a.image.is_some() || a.base != [1.0; 3];
        if a.refracts {
            if a.model == Model::Gltf && tinted {
                self.note("the base colour does not affect light transmitted by glass");
            }
            if a.alpha <= SMOOTH {
                return MaterialFile::Dielectric(DielectricFile { ior, exterior_ior });
            }
            return MaterialFile::RoughDielectric(RoughDielectricFile {
                ior,
                exterior_ior,
                alpha: self.alpha(a),
                distribution: Distribution::default(),
                masking: Masking::default(),
            });
        }
        if a.alpha > SMOOTH {
            self.note("the roughness does not affect light transmitted by a thin sheet");
        }
        if !tinted {
            return MaterialFile::ThinDielectric(DielectricFile { ior, exterior_ior });
        }
        if a.image.is_some() {
            self.note("the image of the base colour does not affect light transmitted by a thin sheet");
        }
        self.note("a coloured thin sheet does not reflect light");
        let transmittance = self.colour(a.base);
        MaterialFile::Retarder(RetarderFile {
            retardance_deg: Some(self.at(0.0.into())),
            retardance_nm: None,
            angle_deg: Some(self.at(0.0)),
            axis: None,
            transmittance: self.at(transmittance),
            tilt: TiltFile::Constant,
            ior: None,
        })
    }

    fn metallic(&mut self, a: &Appearance) -> ScalarFile {
        let factor = a.metallic as f32;
        match &a.metallic_roughness {
            None => a.metallic.into(),
            Some(picture) => self.numbers(picture, "metallic", move |t| t[2] * factor),
        }
    }

    /// Returns the GGX roughness α of the facets.
    fn alpha(&mut self, a: &Appearance) -> Located<ScalarFile> {
        let factor = a.alpha as f32;
        let value = match &a.metallic_roughness {
            None => a.alpha.into(),
            Some(picture) => {
                self.numbers(picture, "alpha", move |t| (t[1] * t[1] * factor).max(SMOOTH as f32))
            }
        };
        self.at(value)
    }

    /// Returns the opacity: the share of the surface that is present, 0..1.
    fn opacity(&mut self, a: &Appearance) -> ScalarFile {
        let factor = a.opacity as f32;
        match &a.opacity_image {
            None => a.opacity.into(),
            Some((picture, Opacity::First)) => self.numbers(picture, "opacity", move |t| t[0] * factor),
            Some((picture, what)) => {
                let opacity = |alpha: f32| match *what {
                    Opacity::Cut(at) => f32::from(f64::from(alpha) >= at - 1e-6),
                    _ => alpha * factor,
                };
                match self.alphas(picture) {
                    None => a.opacity.into(),
                    alphas => ScalarFile::Image(self.image(picture, "opacity", alphas, |t| t.map(opacity))),
                }
            }
        }
    }

    /// Returns the base colour after applying `change` to each value and limiting the results to 1.
    fn albedo(&mut self, a: &Appearance, change: impl Fn(f64) -> f64) -> Located<AlbedoFile> {
        let value = match &a.image {
            None => {
                let colour = a.base.map(|v| change(v).min(1.0));
                self.colour(colour).into()
            }
            // Use the image unmodified.
            Some(picture) if a.base == [1.0; 3] && change(1.0) == 1.0 && change(0.5) == 0.5 => {
                AlbedoFile::Image(self.reference(picture, false))
            }
            Some(picture) => {
                let base = a.base;
                self.derived(picture, "base", move |t| {
                    std::array::from_fn(|i| change(base[i] * f64::from(t[i])).min(1.0) as f32)
                })
            }
        };
        self.at(value)
    }

    /// Returns the bytes of an image, or `None` if the image cannot be read. The material that uses the image
    /// reports the error.
    fn bytes(&mut self, picture: &Picture) -> Option<Vec<u8>> {
        match &picture.source {
            Source::File(name) => self.ctx.read(name, self.file.span()).ok(),
            Source::Embedded(_, bytes) => Some(bytes.clone()),
        }
    }

    /// Returns the linear texels of an image. Colours are decoded if `encoded` is true.
    fn texels(&mut self, picture: &Picture, encoded: bool) -> Option<Texels> {
        let name = match &picture.source {
            Source::File(name) => name.as_str(),
            Source::Embedded(..) => "",
        };
        let pixels = import::picture::decode(name, &self.bytes(picture)?, None).ok()?;
        let decode = |v: f32| import::picture::linear(v, encoded && pixels.encoded);
        Some(Texels {
            size: [pixels.width as u32, pixels.height as u32],
            values: pixels.values.iter().map(|rgb| rgb.map(decode)).collect(),
        })
    }

    /// Returns texels whose three channels all contain the alpha of an image. Alpha is 1 if the image has no
    /// alpha channel.
    fn alphas(&mut self, picture: &Picture) -> Option<Texels> {
        let image = image::load_from_memory(&self.bytes(picture)?).ok()?;
        let alpha = |p: &Rgba<u16>| [f32::from(p.0[3]) / 65535.0; 3];
        Some(Texels {
            size: [image.width(), image.height()],
            values: image.into_rgba16().pixels().map(alpha).collect(),
        })
    }

    fn brightest(&mut self, picture: &Picture) -> [f32; 3] {
        let Some(texels) = self.texels(picture, true) else {
            return [1.0; 3];
        };
        let values = texels.values.iter();
        values.fold([0.0; 3], |most, t| std::array::from_fn(|i| most[i].max(t[i])))
    }

    /// Creates a colour image by applying `change` to the texels of another image.
    fn derived(&mut self, picture: &Picture, part: &str, change: impl Fn(Texel) -> Texel) -> AlbedoFile {
        let texels = self.texels(picture, true);
        AlbedoFile::Image(self.image(picture, part, texels, change))
    }

    /// Creates an image of numbers by applying `change` to the undecoded texels of another image.
    fn numbers(&mut self, picture: &Picture, part: &str, change: impl Fn(Texel) -> f32) -> ScalarFile {
        let texels = self.texels(picture, false);
        ScalarFile::Image(self.image(picture, part, texels, |t| [change(t); 3]))
    }

    /// Creates an in-memory image by applying `change` to the texels of an image. Returns the original image
    /// if its texels cannot be read.
    fn image(
        &mut self,
        picture: &Picture,
        part: &str,
        texels: Option<Texels>,
        change: impl Fn(Texel) -> Texel,
    ) -> ImageAlbedo {
        let made = texels.and_then(|Texels { size: [width, height], values }| {
            let whole = |v: f32| (v.clamp(0.0, 1.0) * 65535.0).round() as u16;
            let values = values.into_iter().flat_map(change).map(whole).collect();
            let image = ImageBuffer::<Rgb<u16>, _>::from_raw(width, height, values)?;
            import::picture::encoded(&image.into(), ImageFormat::Png).ok()
        });
        let Some(bytes) = made else {
            return self.reference(picture, false);
        };
        let name = format!("{}/{part}.png", self.name);
        self.ctx.keep(&name, bytes);
        ImageAlbedo { image: self.at(name), ..self.reference(picture, true) }
    }

    /// Returns the reference of a material to an unmodified image.
    fn reference(&mut self, picture: &Picture, raw: bool) -> ImageAlbedo {
        let name = self.name_of(picture);
        ImageAlbedo {
            image: self.at(name),
            scale: 1.0,
            uv: picture.uv,
            wrap: picture.wrap,
            filter: picture.filter,
            layer: None,
            raw,
            luminance: false,
        }
    }

    /// Returns the name under which the scene can read an image.
    fn name_of(&mut self, picture: &Picture) -> String {
        match &picture.source {
            Source::File(name) => name.clone(),
            Source::Embedded(number, bytes) => {
                let name = format!("{}#{number}", **self.file);
                self.ctx.keep(&name, bytes.clone());
                name
            }
        }
    }

    /// Converts a linear RGB colour to a spectrum: red above 590 nm, green from 500 nm to 590 nm, and blue
    /// below 500 nm.
    fn colour(&self, rgb: [f64; 3]) -> SpectrumFile {
        let channel = |nm: &f64| match *nm {
            nm if nm < 500.0 => rgb[2],
            nm if nm < 590.0 => rgb[1],
            _ => rgb[0],
        };
        SpectrumFile::PerWavelength(self.ctx.listed.nm().iter().map(channel).collect())
    }
}
