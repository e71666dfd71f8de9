//! Checks of an analog output: it outputs exactly the written buffers.

use super::{LONG, Report, SHORT, common, fails, good, want};
use crate::instrument::{AnalogOutput, AnalogSettings, Fault};
use std::time::Duration;

/// Checks an analog output. The full voltage range appears at its first channel.
pub fn analog_output(card: &mut dyn AnalogOutput) -> Report {
    let mut report = Report::default();
    common(card, &mut report);
    let limits = card.limits();
    let [least, most] = limits.volts;
    let [slow, fast] = limits.rate_hz;
    let sane = limits.channels > 0
        && least < most
        && limits.bits > 0
        && slow > 0.0
        && slow <= fast
        && limits.samples > 0;
    report.check("has limits that can be", want(sane, || format!("{limits:?}")));
    let half = (least + most) / 2.0;
    report.check(
        "takes nothing before it is set",
        fails(card.write(&[vec![half]]), Fault::Refused),
    );
    report.check(
        "starts nothing that was not written",
        fails(card.start(), Fault::Refused),
    );
    report.check(
        "waits for nothing that was not started",
        fails(card.wait(Duration::from_millis(10)), Fault::Refused),
    );
    // Choose a rate at which a third of a second fits into the card's memory.
    let rate_hz = (limits.samples as f64 * 3.0).min(1000.0).clamp(slow, fast);
    let set = |channels: Vec<usize>, rate_hz: f64| AnalogSettings { channels, rate_hz };
    for (name, settings) in [
        (
            "refuses a channel that it has not",
            set(vec![limits.channels], rate_hz),
        ),
        ("refuses a channel twice", set(vec![0, 0], rate_hz)),
        ("refuses no channels", set(vec![], rate_hz)),
        ("refuses a rate beyond its own", set(vec![0], fast * 1.01)),
        ("refuses a rate that is none", set(vec![0], f64::NAN)),
    ] {
        report.check(name, fails(card.configure(&settings, SHORT), Fault::Limit));
    }
    report.check(
        "is set to what it can do",
        good(card.configure(&set(vec![0], rate_hz), SHORT)),
    );
    for (name, buffer) in [
        ("refuses a list too many", vec![vec![half]; 2]),
        ("refuses an empty buffer", vec![vec![]]),
        ("refuses more than it holds", vec![vec![half; limits.samples + 1]]),
        ("refuses volts beyond its range", vec![vec![half, most + 0.1]]),
        ("refuses what is no voltage", vec![vec![f64::NAN]]),
    ] {
        report.check(name, fails(card.write(&buffer), Fault::Limit));
    }
    let long = vec![vec![half; ((0.3 * rate_hz) as usize).clamp(1, limits.samples)]];
    report.check(
        "puts out all of its range",
        good(card.write(&[vec![least, most, half]]))
            .and_then(|()| good(card.start()))
            .and_then(|()| good(card.wait(LONG))),
    );
    report.check(
        "puts it out again",
        good(card.start()).and_then(|()| good(card.wait(LONG))),
    );
    report.check(
        "one buffer at a time",
        good(card.write(&long)).and_then(|()| {
            good(card.start())?;
            fails(card.start(), Fault::Refused)?;
            fails(card.write(&long), Fault::Refused)?;
            good(card.wait(LONG))
        }),
    );
    report.check(
        "a deadline that is too short is a timeout, and the buffer goes on",
        good(card.start()).and_then(|()| {
            fails(card.wait(Duration::from_millis(1)), Fault::Timeout)?;
            good(card.wait(LONG))
        }),
    );
    report.check(
        "stops on the way, and at rest",
        good(card.start()).and_then(|()| {
            good(card.stop(SHORT))?;
            good(card.stop(SHORT))?;
            fails(card.wait(Duration::from_millis(10)), Fault::Refused)
        }),
    );
    report.check(
        "goes on after that",
        good(card.start()).and_then(|()| good(card.wait(LONG))),
    );
    report
}
