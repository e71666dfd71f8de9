//! What can be wrong with the input of a geometric calibration.

/// Why there is no calibration; views and points count from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// Nothing to work on.
    #[error("no view shows the board: use images that show the complete board")]
    NoViews,
    /// Lists of different lengths.
    #[error("view {view}: got {found} points, but the board has {wanted}")]
    Count {
        /// The view.
        view: usize,
        /// Its points.
        found: usize,
        /// The board's points.
        wanted: usize,
    },
    /// A coordinate is no number.
    #[error("view {view}: a coordinate is not a finite number of pixels")]
    NotFinite {
        /// The view.
        view: usize,
    },
    /// Points on a line tell no pose.
    #[error(
        "view {view}: its points are on a line or at one place, so the pose is undetermined; exclude the view"
    )]
    Collinear {
        /// The view.
        view: usize,
    },
    /// A board that is none.
    #[error(
        "a board of {columns} × {rows} corners with squares of {square} m: expected at least 3 × 3 inner corners and a positive length"
    )]
    Board {
        /// Inner corners along x.
        columns: usize,
        /// Inner corners along y.
        rows: usize,
        /// Side of a square, metres.
        square: f64,
    },
    /// Fewer numbers than unknowns.
    #[error("{measured} coordinates do not determine {unknown} unknowns: use more views, or fix parameters")]
    TooFew {
        /// Measured numbers.
        measured: usize,
        /// Free parameters.
        unknown: usize,
    },
    /// The views leave a combination of parameters open.
    #[error("these views do not determine {what}; {fix}")]
    NotDetermined {
        /// Parameters, or combinations of them.
        what: String,
        /// What would.
        fix: String,
    },
    /// The fit went nowhere.
    #[error(
        "no camera model fits the points: the best fit has {rms:.3} pixels RMS; check the columns, the rows and the order of the corners, \
         and that all images are from one camera and have one size"
    )]
    NoFit {
        /// Root mean square of the distances, pixels.
        rms: f64,
    },
}
