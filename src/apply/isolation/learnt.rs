//! What a method learns from the training variants: which element, with which sign, threshold and gain.

use super::element::Element;
use super::seen::Seen;
use crate::metrics::isolation::{correlation, gain, parted, threshold};
use crate::metrics::roc::area;
use std::fmt;

/// A detector and an image.
pub(super) struct Learnt {
    /// The element whose values tell pixels apart.
    detector: Element,
    /// Whether they are taken over the photograph.
    over: bool,
    /// Values of at least this are said to be of the light.
    pub threshold: f64,
    /// The element whose image is the light.
    image: Element,
    /// Times this.
    pub gain: f64,
    /// Area and correlation on the training variants.
    reached: [f64; 2],
}

impl fmt::Display for Learnt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let over = if self.over { " over the photograph" } else { "" };
        write!(
            f,
            "found by {}{over} of {:.3e} and more (area {:.3} in training); drawn by {} times {:.3} (correlation {:.3})",
            self.detector, self.threshold, self.reached[0], self.image, self.gain, self.reached[1]
        )
    }
}

/// The mean of what variants say, leaving out those that say nothing.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for v in values.filter(|v| v.is_finite()) {
        sum += v;
        n += 1.0;
    }
    sum / n
}

impl Learnt {
    /// The best of the candidates for a task; `None` if no variant has such light, or no candidate is known. Of equals the first.
    pub(super) fn new(candidates: &[Element], either: bool, task: usize, train: &[Seen]) -> Option<Self> {
        let mut detector: Option<(f64, Element, bool)> = None;
        let mut image: Option<(f64, Element)> = None;
        for candidate in candidates {
            let images: Vec<Vec<f64>> = train.iter().map(|s| s.image(*candidate)).collect::<Option<_>>()?;
            for over in [false, true] {
                let of = |(seen, image): (&Seen, &Vec<f64>)| {
                    let truth = &seen.truth[task];
                    let values = if over {
                        seen.over_photograph(image)
                    } else {
                        image.clone()
                    };
                    let (positive, negative) = parted(&values, &truth.classes);
                    area(&positive, &negative)
                };
                let reached = mean(train.iter().zip(&images).map(of));
                // The other sign has the rest of the area.
                let turned = either && reached < 0.5;
                let value = if turned { 1.0 - reached } else { reached };
                if value.is_finite() && detector.is_none_or(|best| value > best.0) {
                    let element = if turned { candidate.negative() } else { *candidate };
                    detector = Some((value, element, over));
                }
            }
            let reached = mean(
                train
                    .iter()
                    .zip(&images)
                    .map(|(seen, image)| correlation(image, &seen.truth[task].light)),
            );
            let turned = either && reached < 0.0;
            let value = if turned { -reached } else { reached };
            if value.is_finite() && image.is_none_or(|best| value > best.0) {
                let element = if turned { candidate.negative() } else { *candidate };
                image = Some((value, element));
            }
        }
        let ((found, detector, over), (drawn, image)) = (detector?, image?);
        let mut learnt = Self {
            detector,
            over,
            threshold: f64::INFINITY,
            image,
            gain: 1.0,
            reached: [found, drawn],
        };
        let (mut positive, mut negative) = (vec![], vec![]);
        for seen in train {
            let (p, n) = parted(&learnt.values(seen), &seen.truth[task].classes);
            positive.extend(p);
            negative.extend(n);
        }
        learnt.threshold = threshold(&positive, &negative)?;
        let images: Vec<Vec<f64>> = train.iter().map(|s| learnt.image(s)).collect();
        let pairs = images.iter().zip(train);
        learnt.gain = gain(pairs.map(|(image, seen)| (&image[..], &seen.truth[task].light[..])));
        Some(learnt)
    }

    /// What pixels are judged by.
    pub(super) fn values(&self, seen: &Seen) -> Vec<f64> {
        let image = seen.image(self.detector).unwrap_or_default();
        if self.over {
            seen.over_photograph(&image)
        } else {
            image
        }
    }

    /// The element that is the image of the light, as it is.
    pub(super) fn image(&self, seen: &Seen) -> Vec<f64> {
        seen.image(self.image).unwrap_or_default()
    }
}
