//! Optical constants n + i·k of common substances by name.
//!
//! The values come from the table `pbrdf/optical_constants.csv` (refractiveindex.info, CC0), which is
//! compiled into the program. The table and `pbrdf/README.md` cite the paper for each substance. Between the
//! wavelengths of the table, n and k are interpolated linearly, as refractiveindex.info does.

use std::sync::OnceLock;

const TABLE: &str = include_str!("../../../pbrdf/optical_constants.csv");

/// Pairs of an alias and the substance name in the table.
const ALIASES: [(&str, &str); 20] = [
    ("gold", "Au"),
    ("silver", "Ag"),
    ("copper", "Cu"),
    ("aluminium", "Al"),
    ("aluminum", "Al"),
    ("chromium", "Cr"),
    ("chrome", "Cr"),
    ("iron", "Fe"),
    ("nickel", "Ni"),
    ("titanium", "Ti"),
    ("tungsten", "W"),
    ("cu70zn30", "brass"),
    ("bk7", "N-BK7"),
    ("silica", "SiO2"),
    ("fused_silica", "SiO2"),
    ("acrylic", "PMMA"),
    ("magnesium_fluoride", "MgF2"),
    ("silicon_monoxide", "SiO"),
    ("titanium_dioxide", "TiO2"),
    ("h2o", "water"),
];

/// The optical constants of one substance.
#[derive(Clone, Debug)]
pub struct OpticalConstants {
    /// Substance name in the table.
    pub name: String,
    /// Authors and year of the source paper.
    pub source: String,
    /// Samples (vacuum wavelength in nanometres, n, k), ascending by wavelength.
    pub samples: Vec<[f64; 3]>,
}

/// Reasons why a lookup fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConstantsError {
    #[error("unknown optical constants `{name}`; known names: {known}")]
    Unknown { name: String, known: String },
    #[error("the optical constants of {name} cover only {first} to {last} nm, not {nm} nm")]
    Range { name: String, nm: f64, first: f64, last: f64 },
}

/// Returns all substances, in the order of the table.
pub fn all() -> &'static [OpticalConstants] {
    static ALL: OnceLock<Vec<OpticalConstants>> = OnceLock::new();
    ALL.get_or_init(|| parse(TABLE).expect("the built-in table is valid"))
}

fn parse(text: &str) -> Result<Vec<OpticalConstants>, csv::Error> {
    let mut all: Vec<OpticalConstants> = vec![];
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    for row in reader.deserialize() {
        let (name, source, nm, n, k): (String, String, f64, f64, f64) = row?;
        match all.last_mut() {
            Some(last) if last.name == name => last.samples.push([nm, n, k]),
            _ => all.push(OpticalConstants { name, source, samples: vec![[nm, n, k]] }),
        }
    }
    Ok(all)
}

/// Normalizes a name for comparison. Converts letters to lower case, and replaces spaces and hyphens by `_`.
fn plain(name: &str) -> String {
    name.trim().to_lowercase().replace([' ', '-'], "_")
}

/// Finds a substance by name or alias, ignoring case.
///
/// # Errors
/// Returns [`ConstantsError::Unknown`], which lists all names, if there is no such substance.
pub fn find(name: &str) -> Result<&'static OpticalConstants, ConstantsError> {
    let wanted = plain(name);
    let wanted = ALIASES.iter().find(|(alias, _)| *alias == wanted).map_or(wanted, |(_, real)| plain(real));
    all().iter().find(|c| plain(&c.name) == wanted).ok_or_else(|| ConstantsError::Unknown {
        name: name.to_owned(),
        known: all().iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", "),
    })
}

/// Returns refractive index n and extinction coefficient k ≥ 0 at a vacuum wavelength in nanometres.
///
/// # Errors
/// Returns a [`ConstantsError`] if the substance is unknown or the wavelength is outside the range of the
/// substance's table.
pub fn lookup(name: &str, nm: f64) -> Result<(f64, f64), ConstantsError> {
    find(name)?.at(nm)
}

impl OpticalConstants {
    /// Returns n and k at a vacuum wavelength in nanometres.
    ///
    /// # Errors
    /// Returns [`ConstantsError::Range`] if the wavelength is outside the range of the table.
    pub fn at(&self, nm: f64) -> Result<(f64, f64), ConstantsError> {
        let after = self.samples.partition_point(|[x, ..]| *x < nm);
        match (after.checked_sub(1).map(|i| self.samples[i]), self.samples.get(after)) {
            (_, Some([x, n, k])) if *x == nm => Ok((*n, *k)),
            (Some([x0, n0, k0]), Some([x1, n1, k1])) => {
                let t = (nm - x0) / (x1 - x0);
                Ok((n0 + (n1 - n0) * t, k0 + (k1 - k0) * t))
            }
            _ => Err(ConstantsError::Range {
                name: self.name.clone(),
                nm,
                first: self.samples.first().map_or(f64::NAN, |s| s[0]),
                last: self.samples.last().map_or(f64::NAN, |s| s[0]),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies n and k at 450, 550, 635 and 660 nm by comparison with printed values of an independent
    /// evaluation of the database. The tolerance is about half a unit in the last printed digit.
    #[test]
    fn the_table_holds_the_published_numbers() {
        const FACTS: [(&str, [&str; 4], [&str; 4]); 17] = [
            ("Au", ["1.3831", ".4242", ".1802", ".1399"], ["1.9155", "2.4721", "3.4531", "3.7015"]),
            ("Ag", [".0400", ".0596", ".0557", ".0499"], ["2.6484", "3.5974", "4.2931", "4.4869"]),
            ("Al", [".6332", "1.0152", "1.4622", "1.6270"], ["5.4544", "6.6273", "7.5592", "7.8042"]),
            ("Cu", ["1.2404", "1.0066", ".2659", ".2199"], ["2.3929", "2.5823", "3.4360", "3.7521"]),
            ("Cr", ["2.323", "3.1812", "3.1357", "3.0891"], ["3.135", "3.3291", "3.3171", "3.3411"]),
            ("brass", ["1.094", ".527", ".4445", ".445"], ["1.829", "2.765", "3.5655", "3.778"]),
            ("N-BK7", ["1.52532", "1.51852", "1.51501", "1.51421"], ["0"; 4]),
            ("PMMA", ["1.50061", "1.49259", "1.48863", "1.48775"], ["0"; 4]),
            ("water", ["1.33961", "1.33468", "1.33205", "1.33142"], ["0"; 4]),
            ("polystyrene", ["1.61356", "1.59589", "1.58735", "1.58548"], ["0"; 4]),
            ("calcite_o", ["1.67258", "1.66127", "1.65557", "1.65427"], ["0"; 4]),
            ("calcite_e", ["1.49281", "1.48750", "1.48485", "1.48427"], ["0"; 4]),
            ("quartz_o", ["1.55248", "1.54595", "1.54253", "1.54174"], ["0"; 4]),
            ("quartz_e", ["1.56186", "1.55511", "1.55157", "1.55076"], ["0"; 4]),
            ("milk_fat", ["1.470", "1.463", "1.460", "1.459"], ["1.14e-5", "4.6e-6", "5.0e-6", "5.0e-6"]),
            ("casein", ["1.503"; 4], ["0"; 4]),
            // The value of fused silica at the sodium D line is the value given in Born & Wolf.
            ("SiO2", ["1.4656", "1.4599", "1.4570", "1.4563"], ["0"; 4]),
        ];
        let same = |got: f64, printed: &str| {
            let (mantissa, power) = printed.split_once('e').unwrap_or((printed, "0"));
            let digits = mantissa.split_once('.').map_or(0, |(_, d)| d.len() as i32);
            let unit = 10_f64.powi(power.parse::<i32>().unwrap() - digits);
            // The tolerance is 0.55 instead of 0.5 units, because one source value was rounded twice.
            (got - printed.parse::<f64>().unwrap()).abs() <= 0.55 * unit
        };
        for (name, n, k) in FACTS {
            for (i, nm) in [450.0, 550.0, 635.0, 660.0].into_iter().enumerate() {
                let got = lookup(name, nm).unwrap();
                assert!(
                    same(got.0, n[i]) && same(got.1, k[i]),
                    "{name} at {nm} nm: found (n, k) = {got:?}, expected ({}, {})",
                    n[i],
                    k[i]
                );
            }
        }
    }

    #[test]
    fn every_substance_covers_the_visible() {
        assert!(all().len() >= 25);
        for c in all() {
            let rises = c.samples.windows(2).all(|w| w[0][0] < w[1][0]);
            let sane = c.samples.iter().all(|[_, n, k]| *n > 0.01 && *n < 5.0 && *k >= 0.0 && *k < 12.0);
            assert!(rises && sane, "{}", c.name);
            assert!(!c.source.is_empty() && c.name != "material");
            for nm in [400.0, 405.0, 633.0, 700.0] {
                c.at(nm).unwrap();
            }
        }
        for (alias, real) in ALIASES {
            assert_eq!(find(alias).unwrap().name, real);
        }
    }

    #[test]
    fn constants_are_interpolated_and_refused_out_of_range() {
        let c = find("bk7").unwrap();
        let [[x0, n0, _], [x1, n1, _]] = [c.samples[3], c.samples[4]];
        let (n, k) = c.at(0.25 * x0 + 0.75 * x1).unwrap();
        assert!((n - (0.25 * n0 + 0.75 * n1)).abs() < 1e-12 && k == 0.0);
        for name in ["n-bk7", "BK7", " N BK7 "] {
            assert_eq!(find(name).unwrap().name, "N-BK7");
        }
        let error = lookup("gold", 200.0).unwrap_err().to_string();
        assert!(error.contains("Au cover only 380 to 1000 nm, not 200 nm"), "{error}");
        assert!(lookup("gold", 380.0).is_ok() && lookup("gold", 1000.0).is_ok());
        assert!(lookup("gold", f64::NAN).is_err() && lookup("gold", 1000.5).is_err());
        let error = lookup("unobtainium", 550.0).unwrap_err().to_string();
        assert!(error.contains("`unobtainium`") && error.contains("calcite_e"), "{error}");
    }
}
