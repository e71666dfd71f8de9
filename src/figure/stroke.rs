//! Antialiased lines, dashes and markers, and the colours that tell series apart.
//!
//! Places are in pixels relative to a rectangle's upper left pixel, whose centre is (0, 0). What one mask covers is
//! painted once, so that strokes that cross themselves do not get darker.

use image::{Rgb, RgbImage};

use super::layout::Rect;
use super::text::blend;

/// A point in pixels.
pub type Point = (f32, f32);

/// Index of black in the palette, for bounds and reference lines.
pub const BLACK: usize = 6;

/// Okabe and Ito's colours, which colour-blind readers tell apart, without the yellow that is too pale on white.
const PALETTE: [[u8; 3]; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [230, 159, 0],
    [204, 121, 167],
    [86, 180, 233],
    [0, 0, 0],
];

/// So many series differ in colour, in marker or in both.
pub const DISTINCT: usize = PALETTE.len() * MARKERS.len();

/// A colour of the palette, which repeats.
#[must_use]
pub fn palette(index: usize) -> Rgb<u8> {
    Rgb(PALETTE[index % PALETTE.len()])
}

/// Shape of a data point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marker {
    /// Filled circle.
    Disc,
    /// Filled square.
    Square,
    /// Filled triangle that points up.
    Up,
    /// Filled square that stands on a corner.
    Diamond,
    /// Filled triangle that points down.
    Down,
    /// Open circle.
    Ring,
    /// Diagonal cross.
    Cross,
    /// Upright cross.
    Plus,
}

const MARKERS: [Marker; 8] = [
    Marker::Disc,
    Marker::Square,
    Marker::Up,
    Marker::Diamond,
    Marker::Down,
    Marker::Ring,
    Marker::Cross,
    Marker::Plus,
];

impl Marker {
    /// The marker that goes with a colour of the palette; their numbers have no common factor, so that the pair of both
    /// repeats only after [`DISTINCT`].
    #[must_use]
    pub fn of(index: usize) -> Self {
        MARKERS[index % MARKERS.len()]
    }

    /// Distance of a place from the edge of the marker, negative inside. Shapes of one radius look equally large.
    fn distance(self, (x, y): Point, radius: f32) -> f32 {
        let triangle = |y: f32| {
            let slope = 0.866 * x.abs() - 0.5 * y;
            (y - 0.62 * radius).max(slope - 0.62 * radius)
        };
        match self {
            Self::Disc => x.hypot(y) - radius,
            Self::Square => x.abs().max(y.abs()) - 0.88 * radius,
            Self::Up => triangle(y),
            Self::Diamond => (x.abs() + y.abs()) * std::f32::consts::FRAC_1_SQRT_2 - 0.88 * radius,
            Self::Down => triangle(-y),
            Self::Ring => (x.hypot(y) - 0.85 * radius).abs() - 0.24 * radius,
            Self::Plus => plus(x, y, radius),
            Self::Cross => {
                let half = std::f32::consts::FRAC_1_SQRT_2;
                plus((x + y) * half, (x - y) * half, radius)
            }
        }
    }
}

fn plus(x: f32, y: f32, radius: f32) -> f32 {
    let bar = |along: f32, across: f32| (along.abs() - 1.15 * radius).max(across.abs() - 0.26 * radius);
    bar(x, y).min(bar(y, x))
}

/// Coverage 0..1 of every pixel of a rectangle; what lies outside is left out.
pub struct Mask {
    place: Rect,
    covered: Vec<f32>,
}

impl Mask {
    /// Nothing covered yet.
    #[must_use]
    pub fn over(place: Rect) -> Self {
        Self {
            place,
            covered: vec![0.0; place.w as usize * place.h as usize],
        }
    }

    /// Covers pixels between two corners by a function of their centres.
    fn cover(&mut self, a: Point, b: Point, reach: f32, coverage: impl Fn(Point) -> f32) {
        let (w, h) = (self.place.w as usize, self.place.h as usize);
        let range = |p: f32, q: f32, n: usize| {
            let low = (p.min(q) - reach).floor().clamp(0.0, n as f32) as usize;
            low..(p.max(q) + reach).ceil().clamp(0.0, n as f32) as usize
        };
        for y in range(a.1, b.1, h) {
            for x in range(a.0, b.0, w) {
                let c = &mut self.covered[y * w + x];
                *c = c.max(coverage((x as f32, y as f32)).clamp(0.0, 1.0));
            }
        }
    }

    /// A segment with round ends and `half` its width.
    pub fn segment(&mut self, a: Point, b: Point, half: f32) {
        let reach = half + 0.5;
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let length = dx * dx + dy * dy;
        self.cover(a, b, reach, |(x, y)| {
            let (px, py) = (x - a.0, y - a.1);
            let part = if length > 0.0 {
                ((px * dx + py * dy) / length).clamp(0.0, 1.0)
            } else {
                0.0
            };
            reach - (px - part * dx).hypot(py - part * dy)
        });
    }

    /// Segments through points. Points that are not finite leave gaps, and one between two gaps is a dot.
    pub fn line(&mut self, points: &[Point], half: f32) {
        let finite = |p: Point| p.0.is_finite() && p.1.is_finite();
        for (i, &a) in points.iter().enumerate() {
            // A value between two that are missing is a dot; every other one starts a segment.
            let b = match points.get(i + 1) {
                Some(&b) if finite(b) => b,
                _ => a,
            };
            if finite(a) {
                self.segment(a, b, half);
            }
        }
    }

    /// Dashes along one segment of a path. `walked` is the length of the path before it, and then with it. A segment
    /// far longer than any page is left out, so clip it first.
    pub fn dashes(&mut self, a: Point, b: Point, half: f32, walked: &mut f32) {
        const PERIOD: f32 = 16.0;
        const ON: f32 = 8.5;
        let length = (b.0 - a.0).hypot(b.1 - a.1);
        if !(length > 0.0 && length < 1e5) {
            return;
        }
        let at = |s: f32| {
            let part = (s / length).clamp(0.0, 1.0);
            (a.0 + (b.0 - a.0) * part, a.1 + (b.1 - a.1) * part)
        };
        let mut dash = -(*walked % PERIOD);
        while dash < length {
            if dash + ON > 0.0 {
                self.segment(at(dash), at(dash + ON), half);
            }
            dash += PERIOD;
        }
        *walked = (*walked + length) % PERIOD;
    }

    /// A marker.
    pub fn marker(&mut self, marker: Marker, at: Point, radius: f32) {
        self.grown(marker, at, radius, 0.0);
    }

    /// The rim of a marker, `width` pixels beyond it on every side, together with all that it encloses.
    pub fn rim(&mut self, marker: Marker, at: Point, radius: f32, width: f32) {
        let whole = if marker == Marker::Ring {
            Marker::Disc
        } else {
            marker
        };
        self.grown(whole, at, radius, width);
    }

    fn grown(&mut self, marker: Marker, at: Point, radius: f32, grown: f32) {
        self.cover(at, at, 1.5 * radius + grown + 1.0, |(x, y)| {
            0.5 - (marker.distance((x - at.0, y - at.1), radius) - grown)
        });
    }

    /// Adds what another mask over a rectangle of the same size covers.
    pub fn add(&mut self, other: &Self) {
        for (a, b) in self.covered.iter_mut().zip(&other.covered) {
            *a = a.max(*b);
        }
    }

    /// Number of pixels of a part of the rectangle (relative to it) that are at least half covered.
    #[must_use]
    pub fn busy(&self, part: Rect) -> usize {
        let w = self.place.w as usize;
        let columns = part.x.min(self.place.w) as usize..(part.x + part.w).min(self.place.w) as usize;
        (part.y..(part.y + part.h).min(self.place.h))
            .filter_map(|y| self.covered.get(y as usize * w..(y as usize + 1) * w))
            .flat_map(|row| row.get(columns.clone()).unwrap_or_default())
            .filter(|c| **c >= 0.5)
            .count()
    }

    /// Mixes a colour into the picture where the mask covers it.
    pub fn paint(&self, img: &mut RgbImage, colour: Rgb<u8>) {
        let w = self.place.w.max(1) as usize;
        for (i, &a) in self.covered.iter().enumerate() {
            let (x, y) = ((i % w) as i64, (i / w) as i64);
            blend(
                img,
                i64::from(self.place.x) + x,
                i64::from(self.place.y) + y,
                colour,
                a,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Rect = Rect {
        x: 0,
        y: 0,
        w: 40,
        h: 40,
    };

    fn area(mask: &Mask) -> f32 {
        mask.covered.iter().sum()
    }

    #[test]
    fn markers_differ_and_are_about_equally_large() {
        let masks: Vec<Mask> = MARKERS
            .iter()
            .map(|&m| {
                let mut mask = Mask::over(PLACE);
                mask.marker(m, (20.0, 20.0), 6.0);
                mask
            })
            .collect();
        for (i, a) in masks.iter().enumerate() {
            assert!((40.0..140.0).contains(&area(a)), "{:?} {}", MARKERS[i], area(a));
            for b in &masks[..i] {
                let differ: f32 = a.covered.iter().zip(&b.covered).map(|(a, b)| (a - b).abs()).sum();
                assert!(differ > 10.0, "{:?} looks like another", MARKERS[i]);
            }
        }
        let mut grown = Mask::over(PLACE);
        grown.rim(Marker::Ring, (20.0, 20.0), 6.0, 1.5);
        assert!(area(&grown) > area(&masks[0]) + 40.0);
    }

    /// However a path is cut into segments, its dashes are the same and cover about half of it.
    #[test]
    fn dashes_go_on_across_points() {
        let (mut whole, mut parts) = (Mask::over(PLACE), Mask::over(PLACE));
        whole.dashes((0.0, 20.0), (39.0, 20.0), 1.0, &mut 0.0);
        let mut walked = 0.0;
        for x in 0..39 {
            parts.dashes((x as f32, 20.0), (x as f32 + 1.0, 20.0), 1.0, &mut walked);
        }
        assert!((area(&whole) - area(&parts)).abs() < 0.1 * area(&whole));
        assert!((0.4..0.9).contains(&(whole.busy(Rect { y: 20, h: 1, ..PLACE }) as f32 / 40.0)));
    }

    #[test]
    fn what_lies_outside_is_left_out() {
        let mut mask = Mask::over(PLACE);
        mask.line(&[(-50.0, -50.0), (f32::NAN, 3.0), (90.0, 90.0)], 2.0);
        mask.marker(Marker::Plus, (-40.0, 1e9), 4.0);
        assert_eq!(area(&mask), 0.0);
        mask.line(&[(f32::NAN, 0.0), (10.0, 10.0), (f32::NAN, 0.0)], 2.0);
        assert!(area(&mask) > 8.0, "a lone point is a dot");
        assert_eq!(
            mask.busy(Rect {
                x: 30,
                y: 30,
                w: 90,
                h: 90
            }),
            0
        );
    }
}
