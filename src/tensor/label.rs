//! What a path did on its way, as a set of bits: the coordinates of the axis `label`.
//!
//! Every interaction that sends light elsewhere sets the bit of its kind; what light goes through by a smooth interface or a sheet is
//! a matter of the way, and sets none. So 0 is light that came straight from an emitter, through whatever glass.

/// It was scattered by a medium.
pub const MEDIUM: u8 = 1;
/// It was reflected by something smooth: a mirror, the surface of glass or water, from inside too.
pub const SPECULAR: u8 = 2;
/// It was reflected or refracted by rough facets: a rough metal, frosted glass, the coat of plastic.
pub const GLOSSY: u8 = 4;
/// It was scattered diffusely: by a Lambert surface, or the body of plastic.
pub const DIFFUSE: u8 = 8;

/// Number of sets.
pub const COUNT: u32 = 16;

/// The bits with their names. What a measured table reflects, which is not parted, sets `glossy` and `diffuse`.
pub const BITS: [(u8, &str); 4] = [
    (MEDIUM, "medium"),
    (SPECULAR, "specular"),
    (GLOSSY, "glossy"),
    (DIFFUSE, "diffuse"),
];

/// A set in words: `specular+diffuse`, `none`.
#[must_use]
pub fn name(set: u8) -> String {
    let all: Vec<&str> = BITS
        .iter()
        .filter(|(bit, _)| set & bit != 0)
        .map(|(_, n)| *n)
        .collect();
    if all.is_empty() {
        return "none".to_owned();
    }
    all.join("+")
}

/// The set that words name, in any order.
#[must_use]
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
