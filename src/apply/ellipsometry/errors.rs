//! Computes the errors of Mueller matrices relative to the mean T00.

use super::bench::Bench;

/// The elements and the pixels over which an error is computed.
pub(super) struct Of<'a> {
    pub elements: &'a [usize],
    /// Object index, or `None` for all pixels.
    pub object: Option<i64>,
}

/// All elements of all pixels.
pub(super) const ALL: Of<'static> =
    Of { elements: &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15], object: None };

/// Returns the root mean square difference between the matrices `found` and `other`, divided by the mean true
/// T00 of the same pixels. Returns NaN if there are no pixels.
pub(super) fn rms(bench: &Bench, found: &[f64], other: &[f64], of: &Of<'_>) -> f64 {
    let (mut squares, mut light, mut n) = (0.0, 0.0, 0.0);
    let matrices = found.chunks_exact(16).zip(other.chunks_exact(16));
    for (i, ((found, other), truth)) in matrices.zip(bench.truth().chunks_exact(16)).enumerate() {
        let object = bench.object[i / bench.lanes];
        if of.object.is_some_and(|o| o != object) {
            continue;
        }
        let square: f64 = of.elements.iter().map(|e| (found[*e] - other[*e]).powi(2)).sum();
        if square.is_finite() {
            (squares, light, n) = (squares + square, light + truth[0], n + 1.0);
        }
    }
    (squares / n / of.elements.len() as f64).sqrt() / (light / n)
}

/// Returns the mean T00 of an object relative to the mean T00 of all pixels. Returns NaN if the object has no
/// pixels.
pub(super) fn share(bench: &Bench, object: i64) -> f64 {
    let lit = bench.truth().chunks_exact(16).enumerate();
    let mine = lit.filter(|(i, _)| bench.object[i / bench.lanes] == object);
    let (n, sum) = mine.fold((0.0, 0.0), |(n, sum), (_, t)| (n + 1.0, sum + t[0]));
    sum / n / bench.brightness()
}
