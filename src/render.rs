//! From a scene to a store on disk.

use serde_json::{Value, json};
use store::sink::ZarrSink;
pub use store::sink::{SinkError, Target};
pub use tensor::sink::Summary;
use transport::render::schedule;
pub use transport::render::schedule::{Unwatched, Watch};
use transport::scene::Scene;

/// Why a render into a store stopped.
pub type RenderError = schedule::RenderError<SinkError>;

/// Renders all slices of a scene into a store, on the current rayon thread pool.
///
/// # Errors
/// [`RenderError`]; what was finished stays on disk and can be resumed.
pub fn render(scene: &Scene, target: &Target, watch: &dyn Watch) -> Result<Summary, RenderError> {
    render_with(scene, &[], target, watch)
}

/// As [`render`], with attributes of the caller's beside the provenance.
///
/// # Errors
/// As [`render`].
pub fn render_with(
    scene: &Scene,
    extra: &[(&str, Value)],
    target: &Target,
    watch: &dyn Watch,
) -> Result<Summary, RenderError> {
    let version = env!("CARGO_PKG_VERSION");
    let mut attributes = vec![
        ("source", json!(format!("sunstone {version}"))),
        ("version", json!(version)),
    ];
    attributes.extend(extra.iter().map(|(name, value)| (*name, value.clone())));
    let mut sink = ZarrSink::new(target.clone());
    schedule::render(scene, &attributes, &mut sink, watch)
}
