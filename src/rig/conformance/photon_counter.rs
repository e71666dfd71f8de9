//! Checks of a photon counter: number of bins, one acquisition at a time, and valid time tags.

use super::{Report, SHORT, common, fails, good, want};
use crate::instrument::{CounterSettings, Fault, PhotonCounter};
use crate::ptu::record::{Decoder, Event};
use std::time::Duration;

/// Checks a photon counter.
pub fn photon_counter(counter: &mut dyn PhotonCounter) -> Report {
    let mut report = Report::default();
    common(counter, &mut report);
    let limits = counter.limits();
    let sane = limits.bins > 0 && limits.finest_ps > 0.0 && limits.full > 0;
    report.check("reports plausible limits", want(sane, || format!("{limits:?}")));
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
        report.check(
            "returns the configured number of bins",
            good(counter.configure(&settings(bins), SHORT))
                .and_then(|()| good(counter.begin()))
                .and_then(|()| good(counter.finish(SHORT)))
                .and_then(|h| {
                    let newer = last.is_none_or(|n| h.number > n);
                    last = Some(h.number);
                    want(h.counts.len() == bins && newer && h.pulses > 0, || {
                        format!("{} bins, {h:?}", h.counts.len())
                    })
                }),
        );
    }
    let tagged = CounterSettings { tags: true, ..settings(limits.bins.min(100)) };
    match limits.tags {
        None => report.check(
            "refuses time tags that it does not support",
            fails(counter.configure(&tagged, SHORT), Fault::Limit),
        ),
        Some(record) => report.check(
            "returns time tags of its pulses in order, without counts",
            good(counter.configure(&tagged, SHORT))
                .and_then(|()| good(counter.begin()))
                .and_then(|()| good(counter.finish(SHORT)))
                .and_then(|h| {
                    let mut decoder = Decoder::new(record);
                    let events: Vec<Event> = h.records.iter().map(|w| decoder.decode(*w)).collect();
                    let times: Vec<u64> = events
                        .iter()
                        .filter_map(|e| match e {
                            Event::Photon { time, .. } => Some(*time),
                            _ => None,
                        })
                        .collect();
                    let sound = events.iter().all(|e| !matches!(e, Event::Unknown { .. }));
                    let ordered = times.is_sorted() && times.last().is_none_or(|t| *t < h.pulses);
                    want(sound && ordered && h.counts.is_empty(), || {
                        format!("{} records of {} pulses", h.records.len(), h.pulses)
                    })
                })
                .and_then(|()| good(counter.configure(&settings(1), SHORT))),
        ),
    }
    report.check(
        "refuses a second acquisition during the first",
        good(counter.begin()).and_then(|()| {
            fails(counter.begin(), Fault::Refused)?;
            good(counter.finish(SHORT)).map(drop)
        }),
    );
    report.check(
        "refuses to return a histogram without an acquisition",
        fails(counter.finish(Duration::from_millis(10)), Fault::Refused),
    );
    report.check(
        "refuses more bins than the limit",
        fails(counter.configure(&settings(limits.bins + 1), SHORT), Fault::Limit),
    );
    report.check("refuses 0 bins", fails(counter.configure(&settings(0), SHORT), Fault::Limit));
    let mut bad = settings(1);
    bad.bin_ps = f64::NAN;
    report.check("refuses an invalid bin width", fails(counter.configure(&bad, SHORT), Fault::Limit));
    let mut slow = settings(1);
    slow.dwell = Duration::from_millis(300).min(limits.longest);
    report.check(
        "reports a timeout at a short deadline and delivers the histogram later",
        good(counter.configure(&slow, SHORT)).and_then(|()| good(counter.begin())).and_then(|()| {
            fails(counter.finish(Duration::from_millis(1)), Fault::Timeout)?;
            good(counter.finish(SHORT)).map(drop)
        }),
    );
    report
}
