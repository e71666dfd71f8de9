//! Names that both directions of the translation use.

/// Name of the `<default>` that holds the wavelengths of a scene, which Mitsuba itself has no use for.
pub(super) const WAVELENGTHS: &str = "wavelengths_nm";

/// Name of the `<default>` that holds the projector's resolution, likewise.
pub(super) const PROJECTOR_RESOLUTION: &str = "projector_resolution";

/// A name of letters, digits, `_` and `-`, which XML and TOML leave alone.
pub(super) fn plain(name: &str) -> String {
    if name.is_empty() {
        return "material".into();
    }
    let keep = |c: char| c.is_ascii_alphanumeric() || "_-".contains(c);
    name.chars().map(|c| if keep(c) { c } else { '_' }).collect()
}
