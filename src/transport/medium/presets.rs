//! Predefined media: milk, polystyrene beads in water, marble, skin.
//!
//! **Milk** consists of fat globules and casein micelles in water. The model is that of Frisvad, Christensen
//! & Jensen 2007, "Computing the scattering properties of participating media using Lorenz–Mie theory" (ACM
//! TOG 26(3), 60). The parameters are those of Frisvad's program of 2009:
//!
//! - volume fraction of fat (w/0.915)/(100/1.030) and of casein 0.76 (w/1.11)/(100/1.030), where w is the
//!   percentage by weight of fat or of protein,
//! - fat: log-normal, with area-weighted mean radius r43/(c² + 1) and coefficient of variation c = 0.6. r43
//!   decreases with the homogenization pressure P in MPa as log r43 = log r_0 - log(r_0/r_50)/log(50) log P.
//!   r_0 is a fit for untreated milk, and r_50 is a fit for 50 MPa (Walstra 1975; Olson, White & Richter
//!   2004),
//! - casein: the volume-weighted distribution of t = r/(150 nm - r) is log-normal with mean 43/107 and
//!   standard deviation 0.23, and the index is 1.503,
//! - riboflavin (vitamin B2): the water contains 0.17 mg per 100 g of milk. The absorbance (Du et al. 1998,
//!   33 000 per M and cm at 266.5 nm) makes milk yellowish.
//!
//! **Polystyrene** in water: n = 1.5725 + 0.0031080/λ² + 0.00034779/λ⁴, λ in µm (Ma, Lu, Brock, Jacobs,
//! Yang & Hu 2003, Phys. Med. Biol. 48, 4165; 370 to 1610 nm). The absorption of polystyrene is negligible.
//!
//! **Marble, skin**: the source is Jensen, Marschner, Levoy & Hanrahan 2001, "A practical model for
//! subsurface light transport", table of figure 5. The table lists reduced scattering and absorption in red,
//! green and blue. The values for red, green and blue are assigned to 650, 550 and 450 nm and interpolated
//! linearly. Reduced scattering is μ_s' = (1 - g) μ_s. The phase function is that of Henyey & Greenstein with
//! selectable g.

use super::bulk::{Amount, Bulk, BulkError, Kind, Optics, PhaseOptics};
use super::henyey_greenstein::HenyeyGreenstein;
use super::size_distribution::SizeDistribution;
use super::water;
use crate::material::constants::lookup;
use optics::spectrum::Wavelengths;

/// Composition of milk: fat content, homogenization and dilution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Milk {
    /// Percentage of fat by weight, for example 3.5 in whole milk, 1.5 in reduced-fat milk and 0.1 in skimmed
    /// milk.
    pub fat_percent: f64,
    pub protein_percent: f64,
    /// Homogenization pressure in MPa, or 0 for untreated milk.
    pub homogenization_mpa: f64,
    /// Volume fraction of milk in a mixture of milk and water, in [0, 1].
    pub concentration: f64,
}

/// Absorbance of riboflavin every 25 nm, starting at 375 nm, in units of [`RIBOFLAVIN_UNIT`].
const RIBOFLAVIN: [f64; 17] = [
    0.071_17, 0.059_34, 0.072_15, 0.083_00, 0.063_79, 0.019_62, 0.009_50, 0.009_57, 0.011_98, 0.010_47,
    0.010_46, 0.010_61, 0.006_71, 0.010_34, 0.005_89, 0.008_86, 0.010_15,
];

/// Unit of [`RIBOFLAVIN`], per M and metre. An absorbance of 0.25654 corresponds to 33 000 per M and cm.
const RIBOFLAVIN_UNIT: f64 = 3.3e6 / 0.256_54;

/// Concentration of riboflavin in milk, in moles per litre: 0.17 mg per 100 g of milk, with a molar mass of
/// 376.3682 g/mol and a milk density of 1.030 kg/L.
const RIBOFLAVIN_MOLAR: f64 = 0.17 / 376.368_2 / (100.0 / MILK_DENSITY);

/// Density of milk, kg/L.
const MILK_DENSITY: f64 = 1.030;
const FAT_DENSITY: f64 = 0.915;
const CASEIN_DENSITY: f64 = 1.11;

/// Returns the area-weighted mean radius of fat globules, in micrometres.
fn fat_radius_um(fat_percent: f64, mpa: f64) -> f64 {
    let w = fat_percent;
    let untreated =
        if w < 2.0 { -0.252_803_379_4 * w * w + 1.418_606_759 * w } else { 1.456_189_142 * w.powf(0.36) };
    let at_50 = 7.481_403_922e-4 * w * w + 3.203_991_829e-2 * w + 0.116_215_566_7;
    let r43 = if mpa > 1.0 {
        // Use the power law that agrees with both fits, which are at 1 MPa and at 50 MPa.
        untreated * mpa.powf(-(untreated / at_50).ln() / 50.0_f64.ln())
    } else {
        untreated
    };
    r43 / (FAT_VARIATION * FAT_VARIATION + 1.0)
}

/// Area-weighted coefficient of variation of the radii of fat globules.
const FAT_VARIATION: f64 = 0.6;

/// Returns the distribution of the radii of casein micelles.
fn casein_sizes() -> SizeDistribution {
    let largest = 150.0;
    let transform = |r: f64| r / (largest - r);
    let mean = transform(43.0);
    let variance = (0.23_f64 * 0.23 / (mean * mean) + 1.0).ln();
    let centre = mean.ln() - 0.5 * variance;
    let weight = |r: f64| {
        let t = transform(r);
        (-(t.ln() - centre).powi(2) / (2.0 * variance)).exp() / t
    };
    // Divide by r³ to convert from volume weights to number weights. The ends of the range contribute little.
    let radii = (2..75).map(|i| 2.0 * f64::from(i));
    SizeDistribution::List(radii.map(|r| [r * 1e-9, weight(r) / r.powi(3)]).collect())
}

/// Returns the absorption coefficient of riboflavin in undiluted milk at the vacuum wavelength `nm`, 1/m.
fn riboflavin(nm: f64) -> f64 {
    let absorbance = water::even_table(&RIBOFLAVIN, 375.0, 25.0, nm);
    10.0_f64.ln() * RIBOFLAVIN_MOLAR * RIBOFLAVIN_UNIT * absorbance
}

impl Milk {
    /// Returns the optical properties of the milk at the given wavelengths. The wavelengths must be in the
    /// range 380 to 770 nm.
    ///
    /// # Errors
    /// Returns a [`BulkError`] if a wavelength or a parameter is out of range.
    pub fn optics(&self, wavelengths: &Wavelengths) -> Result<Optics, BulkError> {
        let nm = wavelengths.nm();
        let host = nm.iter().map(|w| water::index(*w)).collect::<Result<Vec<_>, _>>()?;
        let absorption: Vec<f64> =
            nm.iter().map(|w| water::absorption(*w) + self.concentration * riboflavin(*w)).collect();
        let constants = |name: &str| -> Result<Vec<[f64; 2]>, BulkError> {
            let at = |w: &f64| lookup(name, *w).map(|(n, k)| [n, k]);
            Ok(nm.iter().map(at).collect::<Result<_, _>>()?)
        };
        let per_volume = |percent: f64, density: f64| percent / density / (100.0 / MILK_DENSITY);
        let mut kinds = vec![];
        if self.fat_percent > 0.0 {
            let mean = 1e-6 * fat_radius_um(self.fat_percent, self.homogenization_mpa);
            let variance = (FAT_VARIATION * FAT_VARIATION + 1.0).ln();
            kinds.push(Kind {
                sizes: SizeDistribution::LogNormal {
                    // Convert the area-weighted mean to the number median: ⟨r³⟩/⟨r²⟩ = r_g exp(5σ²/2).
                    median: mean * (-2.5 * variance).exp(),
                    sigma: variance.sqrt(),
                },
                index: constants("milk_fat")?,
                amount: Amount::VolumeFraction(
                    self.concentration * per_volume(self.fat_percent, FAT_DENSITY),
                ),
            });
        }
        kinds.push(Kind {
            sizes: casein_sizes(),
            index: constants("casein")?,
            amount: Amount::VolumeFraction(
                self.concentration * 0.76 * per_volume(self.protein_percent, CASEIN_DENSITY),
            ),
        });
        Ok(Optics::particles(nm, &host, &absorption, &kinds)?)
    }
}

/// Returns the refractive index of polystyrene at a vacuum wavelength in nanometres.
pub fn polystyrene_index(nm: f64) -> f64 {
    let l2 = (nm / 1000.0).powi(-2);
    1.572_5 + 0.003_108_0 * l2 + 0.000_347_79 * l2 * l2
}

/// Returns the optical properties of polystyrene spheres in water.
///
/// # Errors
/// Returns a [`BulkError`] if a wavelength or a parameter is out of range.
pub fn polystyrene(
    sizes: SizeDistribution,
    amount: Amount,
    wavelengths: &Wavelengths,
) -> Result<Optics, BulkError> {
    let nm = wavelengths.nm();
    let host = nm.iter().map(|w| water::index(*w)).collect::<Result<Vec<_>, _>>()?;
    let absorption: Vec<f64> = nm.iter().map(|w| water::absorption(*w)).collect();
    let kind = Kind { sizes, index: nm.iter().map(|w| [polystyrene_index(*w), 0.0]).collect(), amount };
    Ok(Optics::particles(nm, &host, &absorption, &[kind])?)
}

/// Coefficients of a translucent material, measured by Jensen et al. (2001).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Translucent {
    /// Reduced scattering coefficient in red, green, blue, 1/mm.
    reduced_scattering: [f64; 3],
    /// Absorption coefficient in red, green, blue, 1/mm.
    absorption: [f64; 3],
    index: f64,
}

/// The material "Marble" of Jensen et al. (2001).
pub const MARBLE: Translucent =
    Translucent { reduced_scattering: [2.19, 2.62, 3.00], absorption: [0.0021, 0.0041, 0.0071], index: 1.5 };

/// The material "Skin1" of Jensen et al. (2001).
pub const SKIN: Translucent =
    Translucent { reduced_scattering: [0.74, 0.88, 1.01], absorption: [0.032, 0.17, 0.48], index: 1.3 };

impl Translucent {
    /// Returns the optical properties at the given wavelengths. `g` is the mean cosine of the scattering
    /// angle.
    pub fn optics(&self, g: f64, wavelengths: &Wavelengths) -> Optics {
        // Interpolate between 450 nm and 650 nm, and convert to 1/m.
        let at = |[red, green, blue]: [f64; 3], nm: f64| {
            1000.0 * water::even_table(&[blue, green, red], 450.0, 100.0, nm)
        };
        let bulk = |nm: &f64| Bulk {
            index: self.index,
            scattering: at(self.reduced_scattering, *nm) / (1.0 - g),
            absorption: at(self.absorption, *nm),
            asymmetry: g,
            ..Bulk::default()
        };
        Optics {
            bulk: wavelengths.nm().iter().map(bulk).collect(),
            phase: PhaseOptics::HenyeyGreenstein(HenyeyGreenstein::new(
                wavelengths.map(|_| g as f32),
                0.0,
                0.0,
            )),
        }
    }
}
