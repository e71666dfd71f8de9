//! The learned parameters of a method: element, sign, threshold and gain.

use super::element::Element;
use super::seen::Seen;
use crate::metrics::isolation::{cosine, gain, parted, threshold};
use crate::metrics::roc::area;
use std::fmt;

/// A learned detector and a learned image of one light component.
pub(super) struct Learnt {
    /// Element for detection.
    detector: Shown,
    /// Threshold of the detector. Values of at least `threshold` are classified as positive.
    pub threshold: f64,
    /// Element for the image that shows the light component's share of all light.
    image: Shown,
    /// Gain of the image.
    pub gain: f64,
    /// Area under the ROC curve of the detector on the training variants, and cosine of the image on the same
    /// variants.
    reached: [f64; 2],
}

/// The image of an element, optionally divided by the photograph.
#[derive(Clone, Copy)]
struct Shown {
    element: Element,
    over: bool,
}

impl Shown {
    fn values(self, seen: &Seen) -> Option<Vec<f64>> {
        let image = seen.image(self.element)?;
        Some(if self.over { seen.over_photograph(&image) } else { image })
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let over = if self.over { " over the photograph" } else { "" };
        write!(f, "{}{over}", self.element)
    }
}

impl fmt::Display for Learnt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "light is detected where {} is at least {:.3e} (area under the ROC curve in training: {:.3}); the image is {} times {:.3} \
             (cosine in training: {:.3})",
            self.detector, self.threshold, self.reached[0], self.image, self.gain, self.reached[1]
        )
    }
}

/// Replaces `best` by a candidate if the candidate is better. If `either` is true, the function tests the
/// candidate with both signs.
fn keep(best: &mut Option<(f64, Shown)>, shown: Shown, plain: f64, turned: f64, either: bool) {
    let turn = either && turned > plain;
    let value = if turn { turned } else { plain };
    if value.is_finite() && best.is_none_or(|b| value > b.0) {
        let element = if turn { shown.element.negative() } else { shown.element };
        *best = Some((value, Shown { element, ..shown }));
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for v in values.filter(|v| v.is_finite()) {
        sum += v;
        n += 1.0;
    }
    sum / n
}

impl Learnt {
    /// Learns the best candidates for a task. Of equally good candidates, the first one is chosen. Returns
    /// `None` if no variant contains the task's light, or if no candidate is available.
    pub(super) fn new(candidates: &[Element], either: bool, task: usize, train: &[Seen]) -> Option<Self> {
        let mut detector: Option<(f64, Shown)> = None;
        let mut image: Option<(f64, Shown)> = None;
        for element in candidates {
            for over in [false, true] {
                let shown = Shown { element: *element, over };
                let values: Vec<Vec<f64>> = train.iter().map(|s| shown.values(s)).collect::<Option<_>>()?;
                let all = || train.iter().zip(&values);
                let reached = mean(all().map(|(seen, values)| {
                    let (positive, negative) = parted(values, &seen.truth[task].classes);
                    area(&positive, &negative)
                }));
                // With the opposite sign, the area is one minus the area for this sign.
                keep(&mut detector, shown, reached, 1.0 - reached, either);
                let reached = mean(all().map(|(seen, values)| cosine(values, &seen.truth[task].share)));
                keep(&mut image, shown, reached, -reached, either);
            }
        }
        let ((found, detector), (drawn, image)) = (detector?, image?);
        let mut learnt =
            Self { detector, threshold: f64::INFINITY, image, gain: 1.0, reached: [found, drawn] };
        let (mut positive, mut negative) = (vec![], vec![]);
        for seen in train {
            let (p, n) = parted(&learnt.values(seen), &seen.truth[task].classes);
            positive.extend(p);
            negative.extend(n);
        }
        learnt.threshold = threshold(&positive, &negative)?;
        let images: Vec<Vec<f64>> = train.iter().map(|s| learnt.image(s)).collect();
        let pairs = images.iter().zip(train);
        learnt.gain = gain(pairs.map(|(image, seen)| (&image[..], &seen.truth[task].share[..])));
        Some(learnt)
    }

    /// Returns, for each pixel, the value that the detector compares with the threshold.
    pub(super) fn values(&self, seen: &Seen) -> Vec<f64> {
        self.detector.values(seen).unwrap_or_default()
    }

    /// Returns the image that shows the light component's share of all light, before multiplication by the
    /// gain.
    pub(super) fn image(&self, seen: &Seen) -> Vec<f64> {
        self.image.values(seen).unwrap_or_default()
    }
}
