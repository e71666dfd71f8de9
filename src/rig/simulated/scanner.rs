//! A simulated pair of galvo mirrors.

use super::{Device, Simulated};
use crate::instrument::{Failure, Fault, GalvoLimits, GalvoScanner, Instrument};
use std::time::Duration;

/// A simulated scanner. The direction of the scanner is stored in the bench.
pub struct Scanner;

impl Device for Scanner {
    const MODEL: &'static str = "galvo scanner";
    type Limits = GalvoLimits;
}

impl GalvoScanner for Simulated<Scanner> {
    fn limits(&self) -> GalvoLimits {
        self.limits
    }

    fn point(&mut self, angles_deg: [f64; 2], within: Duration) -> Result<[f64; 2], Failure> {
        if let Err(what) = self.limits.check(angles_deg) {
            return self.fail(Fault::Limit, what + "; correct the plan");
        }
        self.use_of(within)?;
        self.world.clock().sleep(self.limits.settle.min(within));
        if self.limits.settle > within {
            return self
                .fail(Fault::Timeout, "the mirrors are still moving at the deadline; allow more time");
        }
        let step = self.limits.resolution_deg;
        let reached = angles_deg.map(|a| (a / step).round() * step);
        self.world.with(|w| w.pointing_deg = reached);
        Ok(reached)
    }
}
