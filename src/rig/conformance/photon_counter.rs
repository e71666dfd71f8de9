//! Checks that a photon counter returns the correct number of bins, runs one acquisition at a time, and
//! returns valid time tags.

use super::{Report, SHORT, fails, want};
use crate::instrument::{CounterSettings, Fault, PhotonCounter};
use crate::ptu::record::{Decoder, Event};
use std::time::Duration;

pub fn photon_counter(counter: &mut dyn PhotonCounter) -> Report {
    let mut report = Report::common(counter);
    let limits = counter.limits();
    let sane = limits.bins > 0 && limits.finest_ps > 0.0 && limits.full > 0;
    report.check("reports plausible limits", want(sane, limits));
    report.check("refuses to count before it is configured", fails(counter.begin(), Fault::Refused));
    let settings = |bins: usize| CounterSettings {
        bins,
        bin_ps: limits.finest_ps,
        dwell: Duration::from_millis(5).min(limits.longest),
        offset_ps: 0.0,
        tags: false,
    };
    let mut last = None;
    for bins in [1, limits.bins.min(100)] {
        report.steps("returns the configured number of bins", || {
            counter.configure(&settings(bins), SHORT)?;
            counter.begin()?;
            let h = counter.finish(SHORT)?;
            let newer = last.is_none_or(|n| h.number > n);
            last = Some(h.number);
            let bins_are = h.counts.len() == bins;
            want(bins_are && newer && h.pulses > 0, format_args!("{} bins, {h:?}", h.counts.len()))
        });
    }
    let tagged = CounterSettings { tags: true, ..settings(limits.bins.min(100)) };
    match limits.tags {
        None => report.check(
            "refuses time tags that it does not support",
            fails(counter.configure(&tagged, SHORT), Fault::Limit),
        ),
        Some(record) => report.steps("returns time tags of its pulses in order, without counts", || {
            counter.configure(&tagged, SHORT)?;
            counter.begin()?;
            let h = counter.finish(SHORT)?;
            let mut decoder = Decoder::new(record);
            let events: Vec<Event> = h.records.iter().map(|w| decoder.decode(*w)).collect();
            let time = |e: &Event| match e {
                Event::Photon { time, .. } => Some(*time),
                _ => None,
            };
            let times: Vec<u64> = events.iter().filter_map(time).collect();
            let sound = events.iter().all(|e| !matches!(e, Event::Unknown { .. }));
            let ordered = times.is_sorted() && times.last().is_none_or(|t| *t < h.pulses);
            want(
                sound && ordered && h.counts.is_empty(),
                format_args!("{} records of {} pulses", h.records.len(), h.pulses),
            )?;
            Ok(counter.configure(&settings(1), SHORT)?)
        }),
    }
    report.steps("refuses a second acquisition during the first", || {
        counter.begin()?;
        fails(counter.begin(), Fault::Refused)?;
        counter.finish(SHORT)?;
        Ok(())
    });
    report.check(
        "refuses to return a histogram without an acquisition",
        fails(counter.finish(Duration::from_millis(10)), Fault::Refused),
    );
    for (name, wrong) in [
        ("refuses more bins than the limit", settings(limits.bins + 1)),
        ("refuses 0 bins", settings(0)),
        ("refuses an invalid bin width", CounterSettings { bin_ps: f64::NAN, ..settings(1) }),
    ] {
        report.check(name, fails(counter.configure(&wrong, SHORT), Fault::Limit));
    }
    let dwell = Duration::from_millis(300).min(limits.longest);
    report.steps("reports a timeout at a short deadline and delivers the histogram later", || {
        counter.configure(&CounterSettings { dwell, ..settings(1) }, SHORT)?;
        counter.begin()?;
        fails(counter.finish(Duration::from_millis(1)), Fault::Timeout)?;
        counter.finish(SHORT)?;
        Ok(())
    });
    report
}
