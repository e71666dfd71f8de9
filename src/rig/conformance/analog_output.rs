//! Checks that an analog output card outputs exactly the written buffers and refuses invalid buffers.

use super::{LONG, Report, SHORT, fails, want};
use crate::instrument::{AnalogOutput, AnalogSettings, Fault};
use std::time::Duration;

/// Checks an analog output. The check outputs the full voltage range at the first channel.
pub fn analog_output(card: &mut dyn AnalogOutput) -> Report {
    let mut report = Report::common(card);
    let limits = card.limits();
    let [least, most] = limits.volts;
    let [slow, fast] = limits.rate_hz;
    let sane = limits.channels > 0
        && least < most
        && limits.bits > 0
        && slow > 0.0
        && slow <= fast
        && limits.samples > 0;
    report.check("reports plausible limits", want(sane, limits));
    let half = (least + most) / 2.0;
    report.check("refuses data before it is configured", fails(card.write(&[vec![half]]), Fault::Refused));
    report.check("refuses to start without data", fails(card.start(), Fault::Refused));
    report.check(
        "refuses to wait when nothing was started",
        fails(card.wait(Duration::from_millis(10)), Fault::Refused),
    );
    // Choose a rate at which the samples of a third of a second fit into the card's memory.
    let rate_hz = (limits.samples as f64 * 3.0).min(1000.0).clamp(slow, fast);
    let set = |channels: Vec<usize>, rate_hz: f64| AnalogSettings { channels, rate_hz };
    for (name, settings) in [
        ("refuses an unknown channel", set(vec![limits.channels], rate_hz)),
        ("refuses a duplicate channel", set(vec![0, 0], rate_hz)),
        ("refuses an empty channel list", set(vec![], rate_hz)),
        ("refuses a rate above the limit", set(vec![0], fast * 1.01)),
        ("refuses a rate of NaN", set(vec![0], f64::NAN)),
    ] {
        report.check(name, fails(card.configure(&settings, SHORT), Fault::Limit));
    }
    report.check("accepts a valid configuration", card.configure(&set(vec![0], rate_hz), SHORT));
    for (name, buffer) in [
        ("refuses more lists than channels", vec![vec![half]; 2]),
        ("refuses an empty buffer", vec![vec![]]),
        ("refuses a buffer that is too long", vec![vec![half; limits.samples + 1]]),
        ("refuses voltages outside its range", vec![vec![half, most + 0.1]]),
        ("refuses a voltage of NaN", vec![vec![f64::NAN]]),
    ] {
        report.check(name, fails(card.write(&buffer), Fault::Limit));
    }
    let long = vec![vec![half; ((0.3 * rate_hz) as usize).clamp(1, limits.samples)]];
    report.steps("outputs its full range", || {
        card.write(&[vec![least, most, half]])?;
        card.start()?;
        Ok(card.wait(LONG)?)
    });
    report.steps("outputs the same buffer again", || {
        card.start()?;
        Ok(card.wait(LONG)?)
    });
    report.steps("refuses a second buffer during the first", || {
        card.write(&long)?;
        card.start()?;
        fails(card.start(), Fault::Refused)?;
        fails(card.write(&long), Fault::Refused)?;
        Ok(card.wait(LONG)?)
    });
    report.steps("reports a timeout at a short deadline and continues the buffer", || {
        card.start()?;
        fails(card.wait(Duration::from_millis(1)), Fault::Timeout)?;
        Ok(card.wait(LONG)?)
    });
    report.steps("stops during a buffer and when idle", || {
        card.start()?;
        card.stop(SHORT)?;
        card.stop(SHORT)?;
        fails(card.wait(Duration::from_millis(10)), Fault::Refused)
    });
    report.steps("outputs after a stop", || {
        card.start()?;
        Ok(card.wait(LONG)?)
    });
    report
}
