//! Errors in the input of a geometric calibration.

/// The reason why a calibration fails. Views and points count from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    #[error("there is no view of the board: give images in which all of it is seen")]
    NoViews,
    #[error("view {view}: {found} points do not go with the {wanted} of the board")]
    Count {
        view: usize,
        found: usize,
        wanted: usize,
    },
    #[error("view {view}: a coordinate is not a finite number of pixels")]
    NotFinite { view: usize },
    #[error("view {view}: its points lie on a line or at one place, which tells no pose; leave the view out")]
    Collinear { view: usize },
    #[error(
        "a board of {columns} × {rows} corners with squares of {square} m: at least 3 × 3 inner corners and a positive length are wanted"
    )]
    Board {
        columns: usize,
        rows: usize,
        square: f64,
    },
    #[error("{measured} coordinates do not determine {unknown} unknowns: give more views, or fix parameters")]
    TooFew { measured: usize, unknown: usize },
    #[error("these views cannot tell {what}; {fix}")]
    NotDetermined { what: String, fix: String },
    #[error(
        "no camera fits the points: the best leaves {rms:.3} pixels RMS; check that the columns, rows and \
         order of the corners are the board's, and that the images are all of one camera and size"
    )]
    NoFit { rms: f64 },
}
