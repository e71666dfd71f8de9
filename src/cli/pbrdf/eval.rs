//! `sunstone pbrdf eval`: Mueller matrices of a material at given directions.

use crate::cli::failure::Failure;
use glam::Vec3A;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use sunstone::optics::polarization::mueller::Mueller;
use sunstone::optics::spectrum::Spectral;
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::{Lanes, Lobe};

/// Print the Mueller matrix of a material at given directions, as JSON.
///
/// MATERIAL.toml holds `[materials]` as a scene file does, and `wavelengths_nm` if not 450, 550, 660. Directions point
/// away from the surface: IN to where light comes from, OUT to where it goes; THETA counts from the surface normal
/// (+z), PHI from the tangent (+x), in degrees. Stokes vectors are in frames whose horizontal is perpendicular to the
/// plane of the normal and the direction, (-sin PHI, cos PHI, 0): "s" comes first.
///
/// `mueller` is [wavelength][out][in]: with --out the BRDF in 1/sr (without the cosine), with --mirror and --refract
/// the reflection or transmission matrix of a smooth surface itself (of power; radiance also changes by the squared
/// ratio of the refractive indices). `pdf` is the density per steradian with which the renderer samples IN for OUT.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone pbrdf eval gold.toml --in 60,180 --mirror
  sunstone pbrdf eval plastic.toml --name red --in 40,0 --out 20,120
  sunstone pbrdf eval glass.toml --in 56.3,0 --refract")]
pub struct Arguments {
    /// File of materials.
    material: PathBuf,
    /// Which of them, if there are several.
    #[arg(long)]
    name: Option<String>,
    /// Where light comes from, degrees.
    #[arg(
        long = "in",
        value_name = "THETA,PHI",
        allow_hyphen_values = true,
        required_unless_present = "directions"
    )]
    incoming: Option<Direction>,
    /// Where light goes, degrees.
    #[arg(
        long = "out",
        value_name = "THETA,PHI",
        allow_hyphen_values = true,
        group = "what"
    )]
    outgoing: Option<Direction>,
    /// The mirror direction: the matrix of specular reflection.
    #[arg(long, group = "what")]
    mirror: bool,
    /// The direction behind the surface: the matrix of specular transmission.
    #[arg(long, group = "what")]
    refract: bool,
    /// Many at once: a CSV file with THETA_IN,PHI_IN,THETA_OUT,PHI_OUT in each line (THETA_IN,PHI_IN alone with
    /// --mirror or --refract); prints a list.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["incoming", "outgoing"])]
    directions: Option<PathBuf>,
    /// Texture coordinates.
    #[arg(
        long,
        value_name = "U,V",
        default_value = "0.5,0.5",
        allow_hyphen_values = true
    )]
    uv: Direction,
}

/// Two numbers: a polar angle from the normal and an azimuth from the tangent, degrees.
#[derive(Clone, Copy, Debug)]
struct Direction([f64; 2]);

impl FromStr for Direction {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = numbers(text)?;
        match numbers[..] {
            [a, b] => Ok(Self([a, b])),
            _ => Err(format!("`{text}` is not two numbers with a comma between")),
        }
    }
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',')
        .map(|n| match n.trim().parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(format!("`{n}` is not a number")),
        })
        .collect()
}

impl Direction {
    /// The unit vector, and the horizontal of its Stokes frame.
    fn exact(self) -> [[f64; 3]; 2] {
        let [theta, phi] = self.0.map(f64::to_radians);
        let w = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        [w, [-phi.sin(), phi.cos(), 0.0]]
    }

    /// [`Self::exact`] as the renderer takes it.
    fn vectors(self) -> (Vec3A, Vec3A) {
        let [w, x] = self.exact().map(|v| v.map(|c| c as f32).into());
        (w, x)
    }

    /// The direction of a vector in the plane of incidence of this one, on the other side of the normal.
    fn across(self, w: Vec3A) -> Self {
        let theta = f64::from(w.x.hypot(w.y)).atan2(f64::from(w.z)).to_degrees();
        Self([theta, self.0[1] + 180.0])
    }

    fn json(self) -> Value {
        // Adding 0 turns -0 into 0.
        let [w, x] = self.exact().map(|v| v.map(|c| (c * 1e12).round() / 1e12 + 0.0));
        json!({
            "theta_deg": self.0[0],
            "phi_deg": self.0[1],
            "direction": w,
            "frame": x,
        })
    }
}

/// A single-precision matrix in its shortest decimal form, rounding noise far below M00 taken off.
fn plain(m: [[f32; 4]; 4]) -> [[f64; 4]; 4] {
    let noise = m[0][0].abs() * 1e-9;
    let shortest = |v: f32| v.to_string().parse().unwrap_or(f64::from(v));
    m.map(|row| row.map(|v| if v.abs() <= noise { 0.0 } else { shortest(v) }))
}

/// What to evaluate.
#[derive(Clone, Copy)]
enum What {
    Brdf(Direction),
    Lobe(Lobe),
}

/// A material of a file, on a flat surface with normal +z and tangent +x.
struct Subject {
    set: MaterialSet,
    id: u32,
    at: Surface,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let set = MaterialSet::load(&a.material)?;
    let (name, id) = choose(&set, &a.material, a.name.as_deref())?;
    let at = Surface {
        p: Vec3A::ZERO,
        ng: Vec3A::Z,
        ns: Vec3A::Z,
        tangent: Vec3A::X,
        uv: a.uv.0.map(|c| c as f32),
        material: id,
    };
    let subject = Subject { set, id, at };
    let lobe = match (a.mirror, a.refract) {
        (true, _) => Some(Lobe::Reflected),
        (_, true) => Some(Lobe::Transmitted),
        _ => None,
    };
    let value = if let Some(path) = &a.directions {
        let list = directions(path, lobe)?;
        let results: Result<Vec<Value>, Failure> = list
            .into_iter()
            .map(|(incoming, what)| subject.eval(&name, incoming, what))
            .collect();
        Value::Array(results?)
    } else {
        let what = match (lobe, a.outgoing) {
            (Some(lobe), _) => What::Lobe(lobe),
            (None, Some(out)) => What::Brdf(out),
            (None, None) => {
                return Err(Failure::input("give --out THETA,PHI, or --mirror, or --refract"));
            }
        };
        let incoming = a.incoming.unwrap_or(Direction([0.0; 2]));
        subject.eval(&name, incoming, what)?
    };
    crate::cli::print(&readable(&value, 0))
}

/// JSON with short values on one line: a matrix stands there row by row.
fn readable(value: &Value, indent: usize) -> String {
    const WIDTH: usize = 120;
    let short = value.to_string();
    let (open, items, close) = match value {
        _ if short.len() + indent <= WIDTH => return short,
        Value::Array(list) => ("[", list.iter().map(|v| readable(v, indent + 2)).collect(), "]"),
        Value::Object(map) => {
            let item = |(key, v): (&String, &Value)| {
                format!("{}: {}", Value::from(key.as_str()), readable(v, indent + 2))
            };
            ("{", map.iter().map(item).collect::<Vec<_>>(), "}")
        }
        _ => return short,
    };
    let (pad, end) = (" ".repeat(indent + 2), " ".repeat(indent));
    format!("{open}\n{pad}{}\n{end}{close}", items.join(&format!(",\n{pad}")))
}

/// The material that is meant, by name.
fn choose(set: &MaterialSet, file: &Path, name: Option<&str>) -> Result<(String, u32), Failure> {
    let known = || set.names.keys().cloned().collect::<Vec<_>>().join(", ");
    let found = match name {
        Some(name) => set.names.get_key_value(name),
        None if set.names.len() == 1 => set.names.iter().next(),
        None => {
            return Err(Failure::input(format!(
                "{} holds several materials; choose one with --name: {}",
                file.display(),
                known()
            )));
        }
    };
    found.map(|(n, id)| (n.clone(), *id)).ok_or_else(|| {
        Failure::input(format!(
            "{} has no material `{}`; it has: {}",
            file.display(),
            name.unwrap_or_default(),
            known()
        ))
    })
}

/// Reads a list of directions.
fn directions(path: &Path, lobe: Option<Lobe>) -> Result<Vec<(Direction, What)>, Failure> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::input(format!("cannot read {}: {e}", path.display())))?;
    let mut list = vec![];
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let place = |m: String| Failure::input(format!("{}:{}: {m}", path.display(), i + 1));
        let values = numbers(line).map_err(place)?;
        list.push(match (values[..].as_ref(), lobe) {
            ([t, p], Some(lobe)) => (Direction([*t, *p]), What::Lobe(lobe)),
            ([ti, pi, to, po], None) => (Direction([*ti, *pi]), What::Brdf(Direction([*to, *po]))),
            (other, _) => {
                let wanted = if lobe.is_some() { 2 } else { 4 };
                return Err(place(format!("{} numbers where {wanted} belong", other.len())));
            }
        });
    }
    Ok(list)
}

impl Subject {
    fn eval(&self, name: &str, incoming: Direction, what: What) -> Result<Value, Failure> {
        match what {
            What::Brdf(outgoing) => Ok(self.brdf(name, incoming, outgoing)),
            What::Lobe(lobe) => self.lobe(name, incoming, lobe),
        }
    }

    fn lanes(&self) -> usize {
        self.set.wavelengths.count()
    }

    fn brdf(&self, name: &str, incoming: Direction, outgoing: Direction) -> Value {
        let ((wi, xi), (wo, xo)) = (incoming.vectors(), outgoing.vectors());
        let materials = &self.set.materials;
        let m = materials
            .eval(self.id, &self.at, wo, wi)
            .map(|s| {
                s.scaled(Spectral::splat(1.0 / wi.z.abs()))
                    .between(wo, xo, wi, xi)
            })
            .unwrap_or_default();
        let matrices: Vec<_> = (0..self.lanes()).map(|lane| plain(m.lane(lane))).collect();
        json!({
            "material": name,
            "kind": "brdf",
            "unit": "1/sr",
            "in": incoming.json(),
            "out": outgoing.json(),
            "wavelengths_nm": self.set.wavelengths.nm(),
            "mueller": matrices,
            "pdf": materials.pdf(self.id, &self.at, wo, wi),
        })
    }

    /// Each wavelength along its own direction. Light paths are reversible, so the way out is found by following
    /// light that comes out backwards.
    fn lobe(&self, name: &str, incoming: Direction, lobe: Lobe) -> Result<Value, Failure> {
        let materials = &self.set.materials;
        let (wi, xi) = incoming.vectors();
        let missing = || {
            let lobe = match lobe {
                Lobe::Reflected => "mirror",
                Lobe::Transmitted => "transmit",
            };
            Failure::input(format!(
                "material `{name}` does not {lobe} specularly there; give --out for its BRDF"
            ))
        };
        let mut matrices = vec![];
        let mut out = vec![];
        for lane in 0..self.lanes() {
            // Where the reversed light goes is None under total reflection as well: then nothing is transmitted.
            let back = materials.specular(self.id, &self.at, wi, lobe, lane);
            let total = back.is_none() && lobe == Lobe::Transmitted;
            if total && materials.beyond(self.id, &self.at, wi, Lanes::first(1)).is_some() {
                matrices.push(plain(Mueller::ZERO.lane(0)));
                out.push(Value::Null);
                continue;
            }
            let wo = back.ok_or_else(missing)?.wi;
            let forth = materials
                .specular(self.id, &self.at, wo, lobe, lane)
                .ok_or_else(missing)?;
            let outgoing = match lobe {
                Lobe::Reflected => Direction([incoming.0[0], incoming.0[1] + 180.0]),
                Lobe::Transmitted => incoming.across(wo),
            };
            let power = forth
                .scatter
                .scaled(Spectral::splat(self.index_ratio2(wo, wi, lane)));
            let m = power.between(wo, outgoing.vectors().1, wi, xi);
            matrices.push(plain(m.lane(lane)));
            out.push(outgoing.json());
        }
        Ok(json!({
            "material": name,
            "kind": match lobe { Lobe::Reflected => "mirror", Lobe::Transmitted => "refraction" },
            "unit": "1",
            "in": incoming.json(),
            "out": if lobe == Lobe::Reflected { out.swap_remove(0) } else { Value::Array(out) },
            "wavelengths_nm": self.set.wavelengths.nm(),
            "mueller": matrices,
            "pdf": Value::Null,
        }))
    }

    /// (n_in / n_out)²: radiance to power, for light that goes through the surface.
    fn index_ratio2(&self, wo: Vec3A, wi: Vec3A, lane: usize) -> f32 {
        let lanes = Lanes { mask: 1 << lane };
        let beyond = |w: Vec3A| self.set.materials.beyond(self.id, &self.at, w, lanes);
        match (wo.z * wi.z < 0.0, beyond(wo), beyond(wi)) {
            (true, Some(on_wi), Some(on_wo)) => (on_wi.index / on_wo.index).powi(2),
            _ => 1.0,
        }
    }
}
