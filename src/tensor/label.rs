//! Defines path labels. A label is a set of bits that describes a path's interactions, and a coordinate of
//! the axis `label`.
//!
//! Every interaction that changes the direction of light sets the bit of its kind. Transmission through a
//! smooth interface or a sheet sets no bit. Label 0 therefore denotes light that arrives directly from an
//! emitter, possibly through glass.

/// Scattering by a medium.
pub const MEDIUM: u8 = 1;
/// Reflection by a smooth surface, such as a mirror, or glass or water from outside or inside.
pub const SPECULAR: u8 = 2;
/// Reflection or refraction by microfacets, such as those of rough metal, frosted glass or the coat of
/// plastic.
pub const GLOSSY: u8 = 4;
/// Diffuse scattering by a Lambertian surface or by the body of plastic.
pub const DIFFUSE: u8 = 8;

/// Number of possible labels, that is, of sets of the four bits.
pub const COUNT: u32 = 16;

/// The label bits with their names. The reflection of a measured material cannot be separated, so it sets
/// both `glossy` and `diffuse`.
pub const BITS: [(u8, &str); 4] =
    [(MEDIUM, "medium"), (SPECULAR, "specular"), (GLOSSY, "glossy"), (DIFFUSE, "diffuse")];

/// Returns the name of a label, for example `specular+diffuse` or `none`.
pub fn name(set: u8) -> String {
    let all: Vec<&str> = BITS.iter().filter(|(bit, _)| set & bit != 0).map(|(_, n)| *n).collect();
    if all.is_empty() {
        return "none".to_owned();
    }
    all.join("+")
}

/// Parses the name of a label. The names of the bits can have any order. Returns `None` for an unknown name.
pub fn parse(text: &str) -> Option<u8> {
    if text.trim() == "none" {
        return Some(0);
    }
    text.split('+').try_fold(0, |set, word| {
        let bit = BITS.iter().find(|(_, n)| *n == word.trim())?.0;
        Some(set | bit)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for set in 0..COUNT as u8 {
            assert_eq!(parse(&name(set)), Some(set));
        }
        assert_eq!(parse("diffuse + medium"), Some(DIFFUSE | MEDIUM));
        assert_eq!(parse("mirror"), None);
        assert_eq!(parse(""), None);
    }
}
