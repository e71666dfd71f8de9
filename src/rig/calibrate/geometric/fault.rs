//! Errors in the input of a geometric calibration.

/// The reason why a calibration fails. Views and points count from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// No views.
    #[error("there is no view of the board: give images in which all of it is seen")]
    NoViews,
    /// Lists of different lengths.
    #[error("view {view}: {found} points do not go with the {wanted} of the board")]
    Count {
        view: usize,
        /// Number of points in the view.
        found: usize,
        /// Number of points on the board.
        wanted: usize,
    },
    /// A coordinate is not finite.
    #[error("view {view}: a coordinate is not a finite number of pixels")]
    NotFinite { view: usize },
    /// Collinear points determine no pose.
    #[error("view {view}: its points lie on a line or at one place, which tells no pose; leave the view out")]
    Collinear { view: usize },
    /// An invalid board.
    #[error(
        "a board of {columns} × {rows} corners with squares of {square} m: at least 3 × 3 inner corners and a positive length are wanted"
    )]
    Board {
        /// Inner corners along x.
        columns: usize,
        /// Inner corners along y.
        rows: usize,
        /// Side of a square in meters.
        square: f64,
    },
    /// Fewer measurements than unknowns.
    #[error("{measured} coordinates do not determine {unknown} unknowns: give more views, or fix parameters")]
    TooFew {
        /// Number of measured coordinates.
        measured: usize,
        /// Number of free parameters.
        unknown: usize,
    },
    /// The views do not determine a combination of parameters.
    #[error("these views cannot tell {what}; {fix}")]
    NotDetermined {
        /// Parameters, or combinations of them.
        what: String,
        /// How to determine them.
        fix: String,
    },
    /// The fit did not converge to a valid solution.
    #[error(
        "no camera fits the points: the best leaves {rms:.3} pixels RMS; check that the columns, rows and \
         order of the corners are the board's, and that the images are all of one camera and size"
    )]
    NoFit {
        /// Root mean square of the distances in pixels.
        rms: f64,
    },
}
