//! Metrics of an image of signed values. The image isolates one light component, whose true image is known.
//!
//! As a detector, the image is evaluated by the metrics of [`super::roc`] and [`super::precision_recall`].
//! Pixels in which the component has at least a given share are positive. Values of at least a learned
//! [`threshold`] are classified as positive.
//!
//! Two more metrics compare the image with the component. The first metric is the correlation of the image
//! with the component. The second metric is the residual after subtraction of the image times a learned gain.

use super::precision_recall::Counts;

/// Ground-truth class of a pixel for detection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    Positive,
    Negative,
    /// The pixel is too dark to be positive or negative.
    Dark,
}

/// Fraction of the image's mean. Pixels below this fraction are neither positive nor negative.
pub const DARK: f64 = 1e-3;

/// Returns the class of each pixel. A pixel is positive if `light` is at least `share` of `all`.
pub fn classes(light: &[f64], all: &[f64], share: f64) -> Vec<Class> {
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    light
        .iter()
        .zip(all)
        .map(|(light, all)| {
            let lit = *all > DARK * mean;
            match (lit, light / all >= share) {
                (false, _) => Class::Dark,
                (true, true) => Class::Positive,
                (true, false) => Class::Negative,
            }
        })
        .collect()
}

/// Returns the scores of positive pixels and the scores of negative pixels.
pub fn parted(values: &[f64], classes: &[Class]) -> (Vec<f64>, Vec<f64>) {
    let of = |class: Class| {
        let chosen = values.iter().zip(classes).filter(|(_, c)| **c == class);
        chosen.map(|(v, _)| *v).collect()
    };
    (of(Class::Positive), of(Class::Negative))
}

/// Returns the threshold for which the decision "at least the threshold" has the largest F1 on these scores.
/// The threshold is the score of a positive pixel. Of several equally good thresholds, the largest is
/// returned. Returns `None` without positives.
pub fn threshold(positive: &[f64], negative: &[f64]) -> Option<f64> {
    let mut all: Vec<(f64, bool)> = positive.iter().map(|v| (*v, true)).collect();
    all.extend(negative.iter().map(|v| (*v, false)));
    all.retain(|(v, _)| !v.is_nan());
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut found, mut wrong, mut best) = (0, 0, (0.0, None));
    for (i, (value, is)) in all.iter().enumerate() {
        found += u64::from(*is);
        wrong += u64::from(!*is);
        // Equal scores must have the same decision.
        if all.get(i + 1).is_some_and(|next| next.0 == *value) {
            continue;
        }
        let f1 = 2.0 * found as f64 / (found + wrong + positive.len() as u64) as f64;
        if f1 > best.0 {
            best = (f1, Some(*value));
        }
    }
    best.1
}

/// Counts correct and wrong decisions. The decision is positive if the value is at least `threshold`.
pub fn decided(values: &[f64], classes: &[Class], threshold: f64) -> Counts {
    let kept = values.iter().zip(classes).filter(|(_, c)| **c != Class::Dark);
    Counts::of(kept.map(|(v, c)| (*v >= threshold, *c == Class::Positive)))
}

/// Returns Pearson's correlation coefficient of image and light. The result is 0 if the image is constant,
/// and NaN if the light is constant.
pub fn correlation(image: &[f64], light: &[f64]) -> f64 {
    let n = image.len() as f64;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
    let (a, b) = (mean(image), mean(light));
    let sum =
        |f: &dyn Fn(f64, f64) -> f64| image.iter().zip(light).map(|(x, y)| f(x - a, y - b)).sum::<f64>();
    let (xy, xx, yy) = (sum(&|x, y| x * y), sum(&|x, _| x * x), sum(&|_, y| y * y));
    if xx == 0.0 && yy > 0.0 { 0.0 } else { xy / (xx * yy).sqrt() }
}

/// Returns the cosine between image and light as vectors of pixels. With the best gain, the residual is √(1 -
/// cosine²) times the norm of the light. Unlike [`correlation`], the cosine requires an image that is dark
/// where the light is dark. The result is NaN if image or light is zero.
pub fn cosine(image: &[f64], light: &[f64]) -> f64 {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    product(image, light) / (product(image, image) * product(light, light)).sqrt()
}

/// Returns the gain, at least 0, that minimizes the sum of squares of gain · image - light over all pixels.
pub fn gain<'a>(pairs: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> f64 {
    let (mut both, mut own) = (0.0, 0.0);
    for (image, light) in pairs {
        both += image.iter().zip(light).map(|(i, l)| i * l).sum::<f64>();
        own += image.iter().map(|i| i * i).sum::<f64>();
    }
    if both > 0.0 { both / own } else { 0.0 }
}

/// Returns ‖gain · image - light‖ / ‖light‖. The error is 0 for the light itself, 1 for a black image, and
/// NaN for zero light.
pub fn error(image: &[f64], light: &[f64], gain: f64) -> f64 {
    let left: f64 = image.iter().zip(light).map(|(i, l)| (gain * i - l).powi(2)).sum();
    let whole: f64 = light.iter().map(|l| l * l).sum();
    if whole > 0.0 { (left / whole).sqrt() } else { f64::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::roc::area;

    /// Returns an image and its light. The light has the value 2 in every second of 8 columns. The image is
    /// the sum of the light and a background.
    fn columns(background: impl Fn(usize) -> f64) -> [Vec<f64>; 2] {
        let light: Vec<f64> = (0..64).map(|i| if i % 2 == 0 { 2.0 } else { 0.0 }).collect();
        let all = light.iter().enumerate().map(|(i, l)| l + background(i)).collect();
        [light, all]
    }

    #[test]
    fn the_light_itself_has_perfect_scores() {
        let [light, all] = columns(|_| 1.0);
        // The share 2/3 is above one half.
        let classes = classes(&light, &all, 0.5);
        let (p, n) = parted(&light, &classes);
        assert_eq!((p.len(), n.len()), (32, 32));
        assert_eq!(area(&p, &n), 1.0);
        let t = threshold(&p, &n).expect("one");
        let c = decided(&light, &classes, t);
        assert_eq!((c.precision(), c.recall(), c.f1()), (1.0, 1.0, 1.0));
        approx::assert_relative_eq!(correlation(&light, &light), 1.0, epsilon = 1e-12);
        // The image is half of the light, so the gain is 2.
        let half: Vec<f64> = light.iter().map(|l| 0.5 * l).collect();
        let g = gain([(&half[..], &light[..])]);
        assert_eq!((g, error(&half, &light, g)), (2.0, 0.0));
        approx::assert_relative_eq!(cosine(&half, &light), 1.0, epsilon = 1e-12);
    }

    #[test]
    fn a_photograph_has_lower_scores() {
        // Over a uniform background, the background is the only error of a photograph. The gain is 6/10, and
        // the residual is (0.2, 0.6) for light (2, 0).
        let [light, all] = columns(|_| 1.0);
        let g = gain([(&all[..], &light[..])]);
        approx::assert_relative_eq!(g, 0.6, epsilon = 1e-12);
        approx::assert_relative_eq!(error(&all, &light, g), (0.4_f64 / 4.0).sqrt(), epsilon = 1e-12);
        approx::assert_relative_eq!(
            error(&all, &light, g),
            (1.0 - cosine(&all, &light).powi(2)).sqrt(),
            epsilon = 1e-12
        );
        // The background is 1 in the upper half and 4 in the lower half. In the columns of the light, the
        // share of the light is therefore 2/3 in the upper half and 1/3 in the lower half.
        let [light, all] = columns(|i| if i < 32 { 1.0 } else { 4.0 });
        let classes = classes(&light, &all, 0.5);
        let (p, n) = parted(&all, &classes);
        assert_eq!((p.len(), n.len()), (16, 48));
        // Positives have the value 3. Of the negatives, 16 have the value 1, 16 have the value 4 and 16 have
        // the value 6. A third of the negatives is therefore below 3.
        approx::assert_relative_eq!(area(&p, &n), 1.0 / 3.0, epsilon = 1e-12);
        // The best decision is "at least 3", with 16 true and 32 false positives.
        let c = decided(&all, &classes, threshold(&p, &n).expect("one"));
        approx::assert_relative_eq!(c.precision(), 1.0 / 3.0, epsilon = 1e-12);
        assert_eq!(c.recall(), 1.0);
        // The covariance is 1, and the variances are 1 and 1 + 1.5².
        approx::assert_relative_eq!(
            correlation(&all, &light),
            1.0 / (1.0 + 1.5_f64.powi(2)).sqrt(),
            epsilon = 1e-12
        );
    }

    #[test]
    fn an_inverted_sign_has_zero_scores() {
        let [light, all] = columns(|_| 1.0);
        let classes = classes(&light, &all, 0.5);
        let turned: Vec<f64> = light.iter().map(|l| -l).collect();
        let (p, n) = parted(&turned, &classes);
        assert_eq!(area(&p, &n), 0.0);
        approx::assert_relative_eq!(correlation(&turned, &light), -1.0, epsilon = 1e-12);
        let g = gain([(&turned[..], &light[..])]);
        assert_eq!((g, error(&turned, &light, g)), (0.0, 1.0));
        // A threshold that was learned from the light classifies no pixel of the negative image as positive.
        let c = decided(&turned, &classes, 2.0);
        assert!(c.recall() == 0.0 && c.f1() == 0.0 && c.precision().is_nan());
    }

    #[test]
    fn degenerate_images_have_defined_scores() {
        let [light, all] = columns(|_| 1.0);
        let flat = vec![3.0; 64];
        assert_eq!(correlation(&flat, &light), 0.0);
        assert!(correlation(&light, &flat).is_nan() && error(&light, &vec![0.0; 64], 1.0).is_nan());
        assert_eq!(threshold(&[], &[1.0]), None);
        // Equal scores have the same decision. The threshold 5 gives 1 true and 2 false positives, and the
        // threshold 4 gives 2 true and 3 false positives.
        assert_eq!(threshold(&[5.0, 4.0], &[5.0, 5.0, 4.0]), Some(4.0));
        assert_eq!(threshold(&[5.0, 1.0], &[4.0, 3.0, 2.0]), Some(5.0));
        // Pixels without light are neither positive nor negative.
        let mut dark = all.clone();
        (dark[0], dark[1]) = (0.0, f64::NAN);
        let classes = classes(&light, &dark[..1], 0.5);
        assert_eq!(classes, [Class::Dark]);
        assert_eq!(decided(&light[..1], &classes, 0.0), Counts::default());
    }
}
