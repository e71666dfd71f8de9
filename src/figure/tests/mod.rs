//! Tests every kind of figure with known and with degenerate tensors.

use image::RgbImage;

use super::colour::UNDEFINED;
use super::drawing::Rect;
use super::{
    Drawing, FigureError, Format, Panel, animate, draw, is_animation, mueller, profile, save, save_animation,
};
use crate::spec::{FlightView, MapView, MuellerView, PhotoView, ProfileView, SignedScale, View};
use tensor::array::Tensor;
use tensor::axes::{Axis, AxisKind};

const RGB_NM: [f64; 3] = [450.0, 550.0, 660.0];

mod content;
mod degenerate;
mod formats;
mod refusals;

fn axis(kind: AxisKind, coords: Vec<f64>) -> Axis {
    Axis { kind, chunk: coords.len() as u64, coords }
}

fn counted(kind: AxisKind, n: usize) -> Axis {
    axis(kind, (0..n).map(|i| i as f64).collect())
}

/// Returns axes of the given lengths, with coordinates from 0.
fn axes<const N: usize>(lengths: [(AxisKind, usize); N]) -> Vec<Axis> {
    lengths.map(|(kind, n)| counted(kind, n)).into()
}

/// Indices of one entry of a tensor. There is one index per axis.
struct At<'a>(&'a Tensor, Vec<usize>);

impl At<'_> {
    /// Returns the index along an axis, or 0 if the tensor does not have the axis.
    fn i(&self, kind: AxisKind) -> usize {
        self.0.find(kind).map_or(0, |k| self.1[k])
    }

    fn f(&self, kind: AxisKind) -> f64 {
        self.i(kind) as f64
    }
}

fn tensor(axes: Vec<Axis>, value: impl Fn(&At) -> f64) -> Tensor {
    let mut t = Tensor::zeros("synthetic", axes);
    let shape = t.shape();
    let data = (0..t.data.len())
        .map(|mut i| {
            let mut index = vec![0; shape.len()];
            for (k, n) in shape.iter().enumerate().rev() {
                index[k] = i % n;
                i /= n;
            }
            value(&At(&t, index)) as f32
        })
        .collect();
    t.data = data;
    t
}

fn panel(mean: &Tensor) -> Panel<'_> {
    Panel { mean, std_error: None, overflow: None }
}

fn photo_view() -> View {
    let slice = "s".into();
    View::Photo(PhotoView { slice, white: None })
}

fn white_view(white: f32) -> View {
    let (slice, white) = ("s".into(), Some(white));
    View::Photo(PhotoView { slice, white })
}

fn mueller_view(normalized: bool) -> View {
    View::Mueller(MuellerView {
        slice: "s".into(),
        wavelength_nm: None,
        time_ps: None,
        normalized,
        limit: None,
        scale: SignedScale::Linear,
        mask_sigmas: None,
    })
}

fn map_view(row: usize, element: [usize; 2], wavelength_nm: Option<f64>) -> MapView {
    MapView { slice: "s".into(), wavelength_nm, row, element, scale: SignedScale::Linear }
}

fn flight_view(frames: usize) -> View {
    let slice = "s".into();
    View::Flight(FlightView { slice, frames })
}

fn profile_view(pixel: [f64; 2], element: [usize; 2]) -> View {
    View::Profile(ProfileView { slice: "s".into(), pixel, element })
}

/// Returns one view of every kind.
fn all_views() -> Vec<View> {
    vec![
        photo_view(),
        mueller_view(true),
        mueller_view(false),
        View::SpaceSpace(map_view(0, [0, 0], None)),
        View::SpaceTime(map_view(0, [0, 0], None)),
        View::SpaceTime(map_view(0, [0, 0], Some(660.0))),
        View::SpaceSpace(map_view(0, [1, 2], None)),
        flight_view(12),
        profile_view([3.0, 2.0], [0, 0]),
        profile_view([3.0, 2.0], [1, 1]),
    ]
}

/// Returns whether a document is well-formed and all coordinates in the document are finite.
pub fn numbers(svg: &str) -> bool {
    let xml = roxmltree::Document::parse(svg).unwrap();
    let mut values = xml.descendants().flat_map(|e| e.attributes()).map(|a| a.value());
    values.all(|v| v.starts_with("data:") || !v.contains("NaN") && !v.contains("inf"))
}

fn images(drawing: &Drawing) -> Vec<Rect> {
    let svg = drawing.svg();
    let xml = roxmltree::Document::parse(&svg).unwrap();
    let images = xml.descendants().filter(|e| e.has_tag_name("image"));
    let place = |e: roxmltree::Node| {
        let [x, y, w, h] = ["x", "y", "width", "height"].map(|a| e.attribute(a).unwrap().parse().unwrap());
        Rect { x, y, w, h }
    };
    images.map(place).collect()
}

/// Draws a view and returns the pixels and the rectangle of the data.
fn seen(view: &View, panel: &Panel) -> (RgbImage, Rect) {
    let drawing = draw(view, "t", panel).unwrap();
    (drawing.pixels().unwrap(), drawing.data)
}

/// Returns the colour of an image at a position in a rectangle. The position is 0..1 from the left and from
/// the top.
fn colour(img: &RgbImage, r: Rect, across: f64, down: f64) -> [u8; 3] {
    img.get_pixel((r.x + across * r.w) as u32, (r.y + down * r.h) as u32).0
}
