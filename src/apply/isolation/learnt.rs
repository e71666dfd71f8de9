//! The learned parameters of a method for one task: two images, a threshold and a gain.

use super::element::Element;
use super::linear::{self, Features, Fit};
use super::seen::Seen;
use crate::metrics::isolation::{cosine, gain, parted, threshold};
use crate::metrics::roc::area;
use std::fmt;

/// The image that a detector compares with its threshold, and the image that shows the light component's
/// share of all light.
pub(super) type Pair<T> = [T; 2];

/// The images of each task for a variant.
pub(super) type Drawn = Vec<Option<Pair<Vec<f64>>>>;

/// The learned images of all tasks. A task has no images if no variant contains the task's light, or if no
/// candidate is available.
pub(super) enum Images {
    Elements(Vec<Option<Pair<Shown>>>),
    Linear(Features, Vec<Option<Pair<Fit>>>),
}

/// The image of an element, optionally divided by the photograph.
#[derive(Clone, Copy)]
pub(super) struct Shown {
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

/// Chooses the best candidates for a task. Of equally good candidates, the first one is chosen.
fn best((candidates, either): &(Vec<Element>, bool), task: usize, train: &[Seen]) -> Option<Pair<Shown>> {
    let mut detector: Option<(f64, Shown)> = None;
    let mut image: Option<(f64, Shown)> = None;
    for element in candidates {
        for over in [false, true] {
            let shown = Shown { element: *element, over };
            let values: Vec<Vec<f64>> = train.iter().map(|s| shown.values(s)).collect::<Option<_>>()?;
            let [reached, fits] =
                reached(train.iter().zip(&values).map(|(seen, v)| (seen, &v[..], &v[..])), task);
            // With the opposite sign, the area is one minus the area for this sign.
            keep(&mut detector, shown, reached, 1.0 - reached, *either);
            keep(&mut image, shown, fits, -fits, *either);
        }
    }
    Some([detector?.1, image?.1])
}

impl Images {
    /// Chooses the best candidates for each task. `candidates` holds the elements of each task, and whether
    /// signs are learned.
    pub(super) fn elements(candidates: &[(Vec<Element>, bool)], train: &[Seen]) -> Self {
        let each = candidates.iter().enumerate();
        Self::Elements(each.map(|(task, candidates)| best(candidates, task, train)).collect())
    }

    /// Learns linear combinations of features for each task.
    pub(super) fn linear(features: Features, tasks: usize, train: &[Seen]) -> Self {
        Self::Linear(features, linear::learn(features, tasks, train))
    }

    /// Returns the images of each task for a variant.
    pub(super) fn of(&self, seen: &Seen) -> Drawn {
        match self {
            Self::Elements(all) => {
                let of = |pair: &Pair<Shown>| pair.map(|shown| shown.values(seen).unwrap_or_default());
                all.iter().map(|pair| pair.as_ref().map(of)).collect()
            }
            Self::Linear(features, all) => {
                let features = features.of(seen);
                let of = |[class, share]: &Pair<Fit>| {
                    // A share is within 0..1.
                    let share = share.values(&features).into_iter().map(|v| v.clamp(0.0, 1.0));
                    [class.values(&features), share.collect()]
                };
                all.iter().map(|pair| pair.as_ref().map(of)).collect()
            }
        }
    }

    /// Returns the names of the images of a task.
    fn names(&self, task: usize) -> Pair<String> {
        match self {
            Self::Elements(all) => {
                all[task].map_or_else(Default::default, |pair| pair.map(|s| s.to_string()))
            }
            Self::Linear(_, all) => match &all[task] {
                Some(pair) => [0, 1].map(|i| pair[i].to_string()),
                None => Default::default(),
            },
        }
    }
}

/// The learned parameters of a task.
pub(super) struct Learnt {
    /// Values of at least `threshold` are classified as positive.
    pub threshold: f64,
    /// Gain of the image that shows the share.
    pub gain: f64,
    names: Pair<String>,
    /// Area under the ROC curve of the detector on the training variants, and cosine of the image on the same
    /// variants.
    reached: [f64; 2],
}

impl fmt::Display for Learnt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "light is detected where {} is at least {:.3e} (area under the ROC curve in training: {:.3}); the image is {} times {:.3} \
             (cosine in training: {:.3})",
            self.names[0], self.threshold, self.reached[0], self.names[1], self.gain, self.reached[1]
        )
    }
}

/// Returns the mean over variants of the area under the ROC curve of a detector, and of the cosine between an
/// image and the share. The lists contain variants, values of the detector and values of the image.
fn reached<'a>(variants: impl Iterator<Item = (&'a Seen, &'a [f64], &'a [f64])>, task: usize) -> [f64; 2] {
    let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
    for (seen, detector, image) in variants {
        let truth = &seen.truth[task];
        let (positive, negative) = parted(detector, &truth.classes);
        for (i, v) in [area(&positive, &negative), cosine(image, &truth.share)].into_iter().enumerate() {
            if v.is_finite() {
                sums[i] += v;
                counts[i] += 1.0;
            }
        }
    }
    [sums[0] / counts[0], sums[1] / counts[1]]
}

impl Learnt {
    /// Learns the threshold and the gain of a task. `drawn` holds [`Images::of`] each training variant.
    pub(super) fn new(images: &Images, task: usize, train: &[Seen], drawn: &[Drawn]) -> Option<Self> {
        let variants = train.iter().zip(drawn).map(|(seen, drawn)| Some((seen, drawn[task].as_ref()?)));
        let variants: Vec<(&Seen, &Pair<Vec<f64>>)> = variants.collect::<Option<_>>()?;
        let (mut positive, mut negative) = (vec![], vec![]);
        for (seen, [detector, _]) in &variants {
            let (p, n) = parted(detector, &seen.truth[task].classes);
            positive.extend(p);
            negative.extend(n);
        }
        let shares = variants.iter().map(|(seen, [_, image])| (&image[..], &seen.truth[task].share[..]));
        Some(Self {
            threshold: threshold(&positive, &negative)?,
            gain: gain(shares),
            names: images.names(task),
            reached: reached(variants.iter().map(|(seen, [a, b])| (*seen, &a[..], &b[..])), task),
        })
    }
}
