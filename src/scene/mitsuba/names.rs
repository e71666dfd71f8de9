//! Names used by both import and export.

/// Name of the `<default>` that contains the wavelengths of a scene. Mitsuba ignores this `<default>`.
pub(super) const WAVELENGTHS: &str = "wavelengths_nm";

/// Name of the `<default>` that contains the projector's resolution. Mitsuba ignores this `<default>`.
pub(super) const PROJECTOR_RESOLUTION: &str = "projector_resolution";

/// Returns the first name of `base`, `base_2`, `base_3`, … that is not taken.
pub(super) fn free(base: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let mut name = base.to_owned();
    for n in 2.. {
        if !is_taken(&name) {
            break;
        }
        name = format!("{base}_{n}");
    }
    name
}

/// Replaces characters other than ASCII letters, digits, `_` and `-` by `_`, so that the name needs no quotes
/// in XML and TOML.
pub(super) fn plain(name: &str) -> String {
    if name.is_empty() {
        return "material".into();
    }
    let keep = |c: char| c.is_ascii_alphanumeric() || "_-".contains(c);
    name.chars().map(|c| if keep(c) { c } else { '_' }).collect()
}
