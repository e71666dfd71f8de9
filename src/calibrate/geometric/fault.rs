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
        "the board has {columns} × {rows} inner corners and squares of {square} m; expected 3 to 1000 columns and rows, and a positive \
         square size"
    )]
    Board { columns: usize, rows: usize, square: f64 },
    #[error(
        "{measured} coordinates cannot determine {unknown} unknowns; use more views, or exclude parameters from the fit"
    )]
    TooFew { measured: usize, unknown: usize },
    #[error("the views do not determine {what}; {fix}")]
    NotDetermined { what: String, fix: String },
    #[error(
        "no camera model fits the points: the best fit has an RMS error of {rms:.3} pixels; check the columns, the rows and the order of \
         the corners, and check that all images are from one camera and have the same size"
    )]
    NoFit { rms: f64 },
}
