//! The `sunstone pbrdf eval` command, which prints Mueller matrices of a material at given directions.

use crate::source::choose;
use crate::{Failure, bail, print};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use sunstone::base::input;
use sunstone::pbrdf::evaluate::{Direction, Specimen};
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::material::Lobe;

/// Print the Mueller matrix of a material at given directions, as JSON.
///
/// MATERIAL.toml contains `[materials]` as in a scene file, and `wavelengths_nm` unless they are 450, 550, 660.
/// Directions point away from the surface: IN toward the light source, OUT toward the viewer. THETA is
/// the angle from the surface normal (+z) and PHI the azimuth from the tangent (+x), in degrees. The
/// horizontal of the Stokes frames is perpendicular to the plane of the normal and the direction, (-sin PHI,
/// cos PHI, 0): "s" comes first.
///
/// `mueller` is [wavelength][out][in]. With --out it is the BRDF in 1/sr (without the cosine). With --mirror
/// and --refract it is the reflection or transmission matrix of the smooth surface itself (of power; radiance
/// also changes by the squared ratio of the refractive indices). `pdf` is the density per steradian with
/// which the renderer samples IN for OUT.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone pbrdf eval gold.toml --in 60,180 --mirror
  sunstone pbrdf eval plastic.toml --name red --in 40,0 --out 20,120
  sunstone pbrdf eval glass.toml --in 56.3,0 --refract")]
pub struct Arguments {
    /// File of materials.
    material: PathBuf,
    /// Name of the material, if the file has several.
    #[arg(long)]
    name: Option<String>,
    /// Direction to the light source, degrees.
    #[arg(
        long = "in",
        value_name = "THETA,PHI",
        allow_hyphen_values = true,
        required_unless_present = "directions"
    )]
    incoming: Option<Pair>,
    /// Direction to the viewer, degrees.
    #[arg(long = "out", value_name = "THETA,PHI", allow_hyphen_values = true, group = "what")]
    outgoing: Option<Pair>,
    /// Use the mirror direction: print the matrix of specular reflection.
    #[arg(long, group = "what")]
    mirror: bool,
    /// Use the refracted direction behind the surface: print the matrix of specular transmission.
    #[arg(long, group = "what")]
    refract: bool,
    /// CSV file of many directions, with THETA_IN,PHI_IN,THETA_OUT,PHI_OUT on each line (only THETA_IN,PHI_IN
    /// with --mirror or --refract); prints a list.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["incoming", "outgoing"])]
    directions: Option<PathBuf>,
    /// Texture coordinates.
    #[arg(long, value_name = "U,V", default_value = "0.5,0.5", allow_hyphen_values = true)]
    uv: Pair,
}

/// Two numbers, which are separated by a comma on the command line.
#[derive(Clone, Copy, Debug)]
struct Pair([f64; 2]);

impl FromStr for Pair {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = numbers(text)?;
        match numbers[..] {
            [a, b] => Ok(Self([a, b])),
            _ => Err(format!("`{text}`: expected two numbers separated by a comma")),
        }
    }
}

impl Pair {
    fn direction(self) -> Direction {
        let [theta_deg, phi_deg] = self.0;
        Direction { theta_deg, phi_deg }
    }
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',')
        .map(|n| match n.trim().parse::<f64>() {
            Ok(v) if v.abs() <= 36_000.0 => Ok(v),
            _ => Err(format!("`{n}`: expected an angle from -36000 to 36000 degrees")),
        })
        .collect()
}

fn shown(direction: Direction) -> Value {
    // Adding 0 converts -0 to 0.
    let [w, x] = [direction.vector(), direction.frame()].map(|v| v.map(|c| (c * 1e12).round() / 1e12 + 0.0));
    json!({
        "theta_deg": direction.theta_deg,
        "phi_deg": direction.phi_deg,
        "direction": w,
        "frame": x,
    })
}

/// Converts a matrix to doubles whose shortest decimal form equals that of the single-precision values.
/// Rounding errors far below M00 become 0.
fn plain(m: [[f32; 4]; 4]) -> [[f64; 4]; 4] {
    let noise = m[0][0].abs() * 1e-9;
    let shortest = |v: f32| v.to_string().parse().unwrap_or(f64::from(v));
    m.map(|row| row.map(|v| if v.abs() <= noise { 0.0 } else { shortest(v) }))
}

/// The quantity that the command evaluates.
#[derive(Clone, Copy)]
enum What {
    Brdf(Direction),
    Lobe(Lobe),
}

/// A material of a file with its name.
struct Subject<'a> {
    set: &'a MaterialSet,
    name: String,
    specimen: Specimen<'a>,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let set = MaterialSet::load(&a.material)?;
    let names: Vec<String> = set.names.keys().cloned().collect();
    let name = choose(&a.material, ["material", "materials"], &names, a.name.as_deref())?;
    let specimen = Specimen::new(&set, &name, a.uv.0.map(|c| c as f32));
    let subject = Subject {
        set: &set,
        specimen: specimen.ok_or_else(|| Failure::failed("internal error: material missing"))?,
        name,
    };
    let lobe = match (a.mirror, a.refract) {
        (true, _) => Some(Lobe::Reflected),
        (_, true) => Some(Lobe::Transmitted),
        _ => None,
    };
    let value = if let Some(path) = &a.directions {
        let list = directions(path, lobe)?;
        let results: Result<Vec<Value>, Failure> =
            list.into_iter().map(|(incoming, what)| subject.eval(incoming, what)).collect();
        Value::Array(results?)
    } else {
        let what = match (lobe, a.outgoing) {
            (Some(lobe), _) => What::Lobe(lobe),
            (None, Some(out)) => What::Brdf(out.direction()),
            (None, None) => {
                bail!("the outgoing direction is missing; pass --out THETA,PHI, --mirror or --refract")
            }
        };
        let incoming = a.incoming.unwrap_or(Pair([0.0; 2])).direction();
        subject.eval(incoming, what)?
    };
    print(&readable(&value, 0))
}

/// Formats JSON with short values on one line, so that each row of a matrix is on one line.
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

fn directions(path: &Path, lobe: Option<Lobe>) -> Result<Vec<(Direction, What)>, Failure> {
    let text =
        input::read_text(path).map_err(|e| Failure::input(format!("cannot read {}: {e}", path.display())))?;
    let mut list = vec![];
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let place = |m: String| Failure::input(format!("{}:{}: {m}", path.display(), i + 1));
        let values = numbers(line).map_err(place)?;
        list.push(match (values[..].as_ref(), lobe) {
            ([t, p], Some(lobe)) => (Pair([*t, *p]).direction(), What::Lobe(lobe)),
            ([ti, pi, to, po], None) => {
                (Pair([*ti, *pi]).direction(), What::Brdf(Pair([*to, *po]).direction()))
            }
            (other, _) => {
                let wanted = if lobe.is_some() { 2 } else { 4 };
                return Err(place(format!("expected {wanted} numbers per line, got {}", other.len())));
            }
        });
    }
    Ok(list)
}

impl Subject<'_> {
    fn eval(&self, incoming: Direction, what: What) -> Result<Value, Failure> {
        match what {
            What::Brdf(outgoing) => Ok(self.brdf(incoming, outgoing)),
            What::Lobe(lobe) => self.lobe(incoming, lobe),
        }
    }

    fn brdf(&self, incoming: Direction, outgoing: Direction) -> Value {
        let value = self.specimen.brdf(incoming, outgoing);
        let matrices: Vec<_> = value.mueller.into_iter().map(plain).collect();
        json!({
            "material": self.name,
            "kind": "brdf",
            "unit": "1/sr",
            "in": shown(incoming),
            "out": shown(outgoing),
            "wavelengths_nm": self.set.wavelengths.nm(),
            "mueller": matrices,
            "pdf": value.pdf,
        })
    }

    fn lobe(&self, incoming: Direction, lobe: Lobe) -> Result<Value, Failure> {
        let values = self.specimen.specular(incoming, lobe).map_err(|_| {
            let (name, lobe) =
                (&self.name, if lobe == Lobe::Reflected { "reflection" } else { "transmission" });
            Failure::input(format!(
                "material `{name}` has no specular {lobe} for this direction; use --out to evaluate the BRDF"
            ))
        })?;
        let matrices: Vec<_> = values.iter().map(|v| plain(v.mueller)).collect();
        let mut out: Vec<Value> = values.iter().map(|v| v.outgoing.map_or(Value::Null, shown)).collect();
        Ok(json!({
            "material": self.name,
            "kind": match lobe { Lobe::Reflected => "mirror", Lobe::Transmitted => "refraction" },
            "unit": "1",
            "in": shown(incoming),
            "out": if lobe == Lobe::Reflected { out.swap_remove(0) } else { Value::Array(out) },
            "wavelengths_nm": self.set.wavelengths.nm(),
            "mueller": matrices,
            "pdf": Value::Null,
        }))
    }
}
