//! The `[galvo]` table of a rig file, which contains the limits of a galvo and its wiring to an analog output
//! card.
//!
//! ```toml
//! [galvo]
//! driver = "analog"
//! # Per mechanical degree of a mirror; [x, y] if they differ; negative for a reversed mirror.
//! volts_per_degree = 0.8
//! channels = [0, 1]             # of the card, x and y
//! rate_hz = 100_000             # samples per second
//! speed_deg_per_s = 20_000      # maximum speed of the beam along an S-curve; without it, moves are steps
//! range_deg = [20, 20]          # of the beam
//! settle_us = 300
//! card = { channels = 2, volts = [-10, 10], bits = 16, rate_hz = [1, 1_000_000], samples = 65_536 }
//! ```

use super::rig_syntax::{CardFile, Driver, GalvoFile, PerAxis};
use super::{Fault, unsupported};
use crate::driver::galvo::wiring::{Travel, Wiring};
use crate::instrument::{AnalogLimits, GalvoLimits};
use std::time::Duration;

/// Resolution of simulated mirrors in optical degrees. The value is that of 16 bits over ±10 V at 0.8 V per
/// mechanical degree.
const RESOLUTION_DEG: f64 = 2.0 * 20.0 / 65_536.0 / 0.8;

/// The wiring of the mirrors to a card, and the limits of the card.
type Behind = (Wiring, AnalogLimits);

/// Returns the limits of a galvo, and its wiring if a card drives it.
pub(super) fn check(file: &GalvoFile) -> Result<(GalvoLimits, Option<Behind>), Fault> {
    let range_deg = file.range_deg.unwrap_or([20.0; 2]);
    if !range_deg.iter().all(|r| *r > 0.0 && *r <= 60.0) {
        let help = "set range_deg = [x, y], each above 0 and at most 60";
        return Err(unsupported("range_deg", range_deg, help));
    }
    let settle_us = file.settle_us.unwrap_or(300.0);
    let settle = Duration::try_from_secs_f64(settle_us / 1e6).ok().filter(|s| s.as_secs() < 1000);
    let help = "set a number of microseconds from 0 to less than 1e9";
    let settle = settle.ok_or_else(|| unsupported("settle_us", settle_us, help))?;
    if file.driver != Driver::Analog {
        let others = [
            ("volts_per_degree", file.volts_per_degree.is_some()),
            ("channels", file.channels.is_some()),
            ("rate_hz", file.rate_hz.is_some()),
            ("speed_deg_per_s", file.speed_deg_per_s.is_some()),
            ("card", file.card.is_some()),
        ];
        if let Some((name, _)) = others.iter().find(|(_, given)| *given) {
            let help = "add driver = \"analog\", or remove the key";
            return Err((format!("`{name}` applies only to driver = \"analog\""), help));
        }
        let limits = GalvoLimits { range_deg, resolution_deg: RESOLUTION_DEG, settle };
        return Ok((limits, None));
    }
    let card = card(file.card.unwrap_or_default())?;
    let wiring = Wiring {
        channels: file.channels.unwrap_or([0, 1]),
        volts_per_degree: match file.volts_per_degree {
            None => [0.8; 2],
            Some(PerAxis::Both(v)) => [v; 2],
            Some(PerAxis::Each(v)) => v,
        },
        range_deg,
        rate_hz: file.rate_hz.unwrap_or(1e5),
        travel: file.speed_deg_per_s.map_or(Travel::Stepped, Travel::Smooth),
        settle,
    };
    let help = "see `[galvo]` in docs/instruments.md";
    wiring.check(&card).map_err(|e| (e, help))?;
    Ok((wiring.limits(&card), Some((wiring, card))))
}

fn card(file: CardFile) -> Result<AnalogLimits, Fault> {
    let [least, most] = file.volts;
    let [slow, fast] = file.rate_hz;
    if !(1..=64).contains(&file.channels) {
        return Err(unsupported("card.channels", file.channels, "set 1 to 64 channels"));
    }
    if !(least < most && least.abs().max(most.abs()) <= 1e3) {
        return Err(unsupported("card.volts", file.volts, "set volts = [min, max] within ±1000"));
    }
    if !(1..=32).contains(&file.bits) {
        return Err(unsupported("card.bits", file.bits, "set 1 to 32 bits"));
    }
    if !(slow > 0.0 && slow <= fast && fast <= 1e9) {
        let help = "set rate_hz = [min, max], above 0 and at most 1e9";
        return Err(unsupported("card.rate_hz", file.rate_hz, help));
    }
    if !(1..=1 << 24).contains(&file.samples) {
        return Err(unsupported("card.samples", file.samples, "set 1 to 16777216 samples"));
    }
    Ok(AnalogLimits {
        channels: file.channels,
        volts: file.volts,
        bits: file.bits,
        rate_hz: file.rate_hz,
        samples: file.samples,
    })
}
