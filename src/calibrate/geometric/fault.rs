//! Errors in the input of a geometric calibration.

/// The reason why a calibration fails. Views and points are numbered from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    #[error("no view shows the board: use images that show the complete board")]
    NoViews,
    #[error("view {view}: got {found} points, but the board has {wanted} corners; pass one point per corner")]
    Count { view: usize, found: usize, wanted: usize },
    #[error("view {view}: a coordinate is not a finite number of pixels; correct or exclude the view")]
    NotFinite { view: usize },
    #[error("view {view}: all points are on one line, so the pose is undetermined; exclude the view")]
    Collinear { view: usize },
    #[error(
        "a board of {columns} × {rows} corners with squares of {square} m: expected at least 3 × 3 inner corners and a positive length"
    )]
    Board { columns: usize, rows: usize, square: f64 },
    #[error("{measured} coordinates do not determine {unknown} unknowns: use more views, or fix parameters")]
    TooFew { measured: usize, unknown: usize },
    #[error("the views do not determine {what}; {fix}")]
    NotDetermined { what: String, fix: String },
    #[error(
        "no camera model fits the points: the best fit has {rms:.3} pixels RMS; check the columns, the rows and the order of the corners, \
         and that all images are from one camera and have one size"
    )]
    NoFit { rms: f64 },
}
