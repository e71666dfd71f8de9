//! Minimizers of smooth functions of angles. The minimizers are Adam, and L-BFGS from the argmin crate.

mod vector;

use argmin::core::{CostFunction, Error, Executor, Gradient, IterState, State};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use vector::Vector;

/// A function with its gradient.
pub trait Smooth: Sync {
    /// Returns the value and the gradient of the function at a point. The value is infinite if the function
    /// is undefined at the point.
    fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>);

    /// Returns whether to stop the search.
    fn is_unwanted(&self) -> bool {
        false
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Minimum {
    pub x: Vec<f64>,
    pub value: f64,
}

/// Minimizes `f` by Adam (Kingma & Ba 2015). The step size decays to zero along half a period of a cosine.
/// Returns the best point found.
pub fn adam(f: &impl Smooth, start: &[f64], steps: usize, rate: f64) -> Minimum {
    let (beta1, beta2) = (0.9_f64, 0.999_f64);
    let mut x = start.to_vec();
    let (mut mean, mut square) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    let mut best = Minimum { x: x.clone(), value: f64::INFINITY };
    for step in 0..=steps {
        if f.is_unwanted() {
            break;
        }
        let (value, gradient) = f.evaluate(&x);
        if value < best.value {
            best = Minimum { x: x.clone(), value };
        }
        let t = (step + 1) as f64;
        let rate = rate * 0.5 * (1.0 + (std::f64::consts::PI * step as f64 / steps.max(1) as f64).cos());
        for i in 0..x.len() {
            mean[i] = beta1 * mean[i] + (1.0 - beta1) * gradient[i];
            square[i] = beta2 * square[i] + (1.0 - beta2) * gradient[i] * gradient[i];
            let (m, v) = (mean[i] / (1.0 - beta1.powf(t)), square[i] / (1.0 - beta2.powf(t)));
            // A zero gradient results in a zero step.
            if v > 0.0 {
                x[i] -= rate * m / v.sqrt();
            }
        }
    }
    best
}

/// A point, and the value and gradient of the function at this point.
type Evaluated = (Vec<f64>, f64, Vec<f64>);

/// Adapts a function to argmin by caching the last evaluation. Argmin requests value and gradient separately.
struct Remembered<'a, F> {
    f: &'a F,
    last: Mutex<Option<Evaluated>>,
    best: Mutex<Minimum>,
    /// Number of consecutive evaluations at which the function is undefined.
    walls: AtomicU32,
}

/// Replacement for undefined values. Argmin's line search recovers from large values, but not from infinite
/// values.
const BAD: f64 = 1e30;
/// Number of consecutive undefined values after which the search stops. Argmin's line search would
/// shorten its steps forever next to a region where the function is undefined.
const MOST_WALLS: u32 = 200;

impl<F: Smooth> Remembered<'_, F> {
    fn at(&self, x: &[f64]) -> Result<(f64, Vec<f64>), Error> {
        let poisoned = |_| Error::msg("another evaluation panicked");
        let mut last = self.last.lock().map_err(poisoned)?;
        if let Some((_, value, gradient)) = last.as_ref().filter(|(at, ..)| at == x) {
            return Ok((*value, gradient.clone()));
        }
        if self.f.is_unwanted() {
            return Err(Error::msg("the optimization was stopped"));
        }
        let (mut value, gradient) = self.f.evaluate(x);
        if value.is_finite() {
            self.walls.store(0, Ordering::Relaxed);
        } else {
            value = BAD;
            if self.walls.fetch_add(1, Ordering::Relaxed) >= MOST_WALLS {
                return Err(Error::msg("the function has no finite value near the last evaluated point"));
            }
        }
        let mut best = self.best.lock().map_err(|_| Error::msg("another evaluation panicked"))?;
        if value < best.value {
            *best = Minimum { x: x.to_vec(), value };
        }
        *last = Some((x.to_vec(), value, gradient.clone()));
        Ok((value, gradient))
    }
}

impl<F: Smooth> CostFunction for &Remembered<'_, F> {
    type Param = Vector;
    type Output = f64;
    fn cost(&self, x: &Vector) -> Result<f64, Error> {
        Ok(self.at(&x.0)?.0)
    }
}

impl<F: Smooth> Gradient for &Remembered<'_, F> {
    type Param = Vector;
    type Gradient = Vector;
    fn gradient(&self, x: &Vector) -> Result<Vector, Error> {
        Ok(Vector(self.at(&x.0)?.1))
    }
}

/// Minimizes `f` by L-BFGS (Nocedal & Wright 2006, alg. 7.5) with the line search of Moré and
/// Thuente. Returns the best point found.
pub fn quasi_newton(f: &impl Smooth, start: &[f64], iterations: u64) -> Minimum {
    let problem = Remembered {
        f,
        last: Mutex::new(None),
        best: Mutex::new(Minimum { x: start.to_vec(), value: f64::INFINITY }),
        walls: AtomicU32::new(0),
    };
    // The loss is of the order of σ². Argmin's tolerances are absolute and must be smaller than the loss
    // for any noise.
    let solver = LBFGS::new(MoreThuenteLineSearch::new(), 20)
        .with_tolerance_grad(0.0)
        .and_then(|s| s.with_tolerance_cost(0.0));
    if let Ok(solver) = solver {
        let configured = Executor::new(&problem, solver).configure(|state: IterState<_, _, _, _, _, _>| {
            state.param(Vector(start.to_vec())).max_iters(iterations).target_cost(f64::NEG_INFINITY)
        });
        // If a line search finds no improvement, argmin ends with an error. The best point found before the
        // error is kept.
        let _ = configured.run().map(|result| result.state().get_iter());
    }
    let best = problem.best.lock().map(|b| b.clone());
    best.unwrap_or(Minimum { x: start.to_vec(), value: f64::INFINITY })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's function, whose minimum is 0 at (1, 1).
    struct Valley;
    impl Smooth for Valley {
        fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            (a * a + 100.0 * b * b, vec![-2.0 * a - 400.0 * x[0] * b, 200.0 * b])
        }
    }

    #[test]
    fn minima_are_found() {
        let found = quasi_newton(&Valley, &[-1.2, 1.0], 200);
        assert!(found.value < 1e-20, "{found:?}");
        let found = adam(&Valley, &[-1.2, 1.0], 20_000, 0.02);
        assert!(found.value < 1e-4, "{found:?}");
    }

    /// A function that is undefined everywhere. A search for the minimum of this function must end.
    struct Wall;
    impl Smooth for Wall {
        fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
            (f64::INFINITY, vec![0.0; x.len()])
        }
    }

    /// A function that becomes undefined after some evaluations. The function can instead request that the
    /// search stops.
    struct Closing {
        looks: AtomicU32,
        open: u32,
        stops: bool,
    }
    impl Smooth for Closing {
        fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
            if self.looks.fetch_add(1, Ordering::Relaxed) >= self.open {
                return Wall.evaluate(x);
            }
            Valley.evaluate(x)
        }
        fn is_unwanted(&self) -> bool {
            self.stops && self.looks.load(Ordering::Relaxed) >= self.open
        }
    }

    /// Verifies that a search ends when the function becomes undefined. The function may become undefined
    /// within a line search.
    #[test]
    fn searches_stop_where_the_function_is_undefined() {
        for (open, stops) in (1..12).flat_map(|open| [(open, false), (open, true)]) {
            let valley = || Closing { looks: AtomicU32::new(0), open, stops };
            let closing = valley();
            let found = quasi_newton(&closing, &[-1.2, 1.0], 1_000_000);
            let looks = closing.looks.load(Ordering::Relaxed);
            assert!(looks <= if stops { open } else { open + MOST_WALLS + 1 }, "{looks} evaluations");
            assert!(found.value <= 24.3, "{found:?}");
            let closing = valley();
            let found = adam(&closing, &[-1.2, 1.0], 50, 0.02);
            assert!(found.value <= 24.3, "{found:?}");
        }
    }

    #[test]
    fn a_function_undefined_everywhere_ends_the_search() {
        assert!(quasi_newton(&Wall, &[0.0, 1.0], 50).value >= BAD);
        assert_eq!(adam(&Wall, &[0.0, 1.0], 5, 0.1).x, [0.0, 1.0]);
    }
}
