//! What can be wrong with the input of a geometric calibration.

/// Why there is no calibration; views and points count from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// Nothing to work on.
    #[error("there is no view of the board: give images in which all of it is seen")]
    NoViews,
    /// Lists of different lengths.
    #[error("view {view}: {found} points do not go with the {wanted} of the board")]
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
    #[error("view {view}: its points lie on a line or at one place, which tells no pose; leave the view out")]
    Collinear {
        /// The view.
        view: usize,
    },
    /// A board that is none.
    #[error(
        "a board of {columns} × {rows} corners with squares of {square} m: at least 3 × 3 inner corners and a positive length are wanted"
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
    #[error("{measured} coordinates do not determine {unknown} unknowns: give more views, or fix parameters")]
    TooFew {
        /// Measured numbers.
        measured: usize,
        /// Free parameters.
        unknown: usize,
    },
    /// The views leave a combination of parameters open.
    #[error("these views cannot tell {what}; {fix}")]
    NotDetermined {
        /// Parameters, or combinations of them.
        what: String,
        /// What would.
        fix: String,
    },
    /// The fit went nowhere.
    #[error(
        "no camera fits the points: the best leaves {rms:.3} pixels RMS; check that the columns, rows and \
         order of the corners are the board's, and that the images are all of one camera and size"
    )]
    NoFit {
        /// Root mean square of the distances, pixels.
        rms: f64,
    },
}
