//! Assigns photons to pixels by the markers of a galvo scan.

use super::header::Header;

/// Motion of the beam along a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// Duration of a pixel in counts of the time tag (in T3: sync pulses). With [`Self::sine`], this is the
    /// mean duration.
    pub pixel_time: u64,
    /// Fraction of the amplitude of a sinusoidal sweep that a line covers, in (0, 1], or `None` for pixels of
    /// equal duration.
    ///
    /// The position follows `sinusoidal_correction` of `ptufile` (`ImgHdr_SinCorrection`: amplitude in
    /// percent).
    pub sine: Option<f64>,
}

impl Sweep {
    /// Returns the time count, from the start of the line, at which column `x` of `width` begins.
    fn edge(&self, x: u64, width: u64) -> u64 {
        let line = self.pixel_time.saturating_mul(width);
        let Some(sine) = self.sine.filter(|_| x > 0 && x < width) else {
            return self.pixel_time.saturating_mul(x);
        };
        let place = 2.0 * x as f64 / width as f64 - 1.0;
        let phase = (sine * place).asin() / sine.asin();
        // Subtract a margin, so that rounding of `asin` does not move an edge that falls on a whole count.
        (0.5 * line as f64 * (1.0 + phase) - 1e-6).ceil() as u64
    }

    /// Returns the column at a time since the start of the line, and the time range of the column. Returns
    /// `None` after the end of the line.
    fn column(&self, since: u64, width: u64) -> Option<(u64, [u64; 2])> {
        let line = self.pixel_time.saturating_mul(width);
        if since >= line {
            return None;
        }
        let mut x = match self.sine {
            None => since / self.pixel_time,
            Some(sine) => {
                let phase = sine.asin() * (2.0 * since as f64 / line as f64 - 1.0);
                let place = 0.5 * width as f64 * (1.0 + phase.sin() / sine);
                (place.max(0.0) as u64).min(width - 1)
            }
        };
        while x > 0 && self.edge(x, width) > since {
            x -= 1;
        }
        while x + 1 < width && self.edge(x + 1, width) <= since {
            x += 1;
        }
        Some((x, [self.edge(x, width), self.edge(x + 1, width)]))
    }
}

/// Meaning of the markers. A marker is a bit mask: 1 for the first input, 8 for the fourth input, 0 for no
/// marker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// Marker that begins the next line or, without a sweep, the next pixel.
    pub begin: u8,
    /// Marker that ends the line or the pixel. If 0, the last pixel of the line or the next begin marker ends
    /// the line or the pixel.
    pub end: u8,
    /// Marker that restarts the scan at the first line or pixel.
    pub frame: u8,
    /// Motion of the beam along a line. Without a sweep, the beam stays at one point and then moves to the
    /// next point.
    pub sweep: Option<Sweep>,
}

/// Returns whether the header states that every second row is scanned backwards (`ImgHdr_BiDirect`).
pub fn is_bidirectional(header: &Header) -> bool {
    header.number("ImgHdr_BiDirect").is_some_and(|n| n > 0.0)
}

/// A scan by rows that starts at the upper left pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan {
    /// Number of pixels per row.
    pub width: usize,
    pub height: usize,
    /// Whether every second row of a frame is scanned from its last pixel to its first.
    pub bidirectional: bool,
    pub clock: Clock,
}

impl Scan {
    /// Returns the scan by lines that a file's header describes (`ImgHdr_…`).
    ///
    /// A line scan (`ImgHdr_Dimensions` 2) has one row, in which all lines are accumulated.
    ///
    /// # Errors
    /// Returns a message that names the missing or invalid tag.
    pub fn of_header(header: &Header) -> Result<Self, String> {
        let missing = |name: &str| format!("the header does not describe a scan: the tag {name} is missing");
        let marker = |name: &str| match header.number(name) {
            None | Some(0.0) => Ok(0),
            Some(n) if [1.0, 2.0, 3.0, 4.0].contains(&n) => Ok(1_u8 << (n as u8 - 1)),
            Some(n) => Err(format!("the tag {name} is {n}: expected a marker number from 1 to 4")),
        };
        let size = |name: &str| match header.number(name) {
            Some(n) if (1.0..1e9).contains(&n) => Ok(n as usize),
            Some(n) => Err(format!("the tag {name} is {n}: expected at least one pixel")),
            None => Err(missing(name)),
        };
        let dimensions = header.number("ImgHdr_Dimensions").unwrap_or(3.0);
        if ![2.0, 3.0].contains(&dimensions) {
            return Err(format!(
                "the header does not describe a scan: the tag ImgHdr_Dimensions is {dimensions}, expected 2 or 3"
            ));
        }
        let [begin, end, frame] =
            ["ImgHdr_LineStart", "ImgHdr_LineStop", "ImgHdr_Frame"].map(|name| (name, marker(name)));
        let markers = [begin.1?, end.1?, frame.1?];
        if markers[0] == 0 {
            return Err(missing(begin.0));
        }
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            if markers[i] != 0 && markers[i] == markers[j] {
                let names = [begin.0, end.0, frame.0];
                return Err(format!("the tags {} and {} have the same marker number", names[i], names[j]));
            }
        }
        let per_pixel = header.number("ImgHdr_TimePerPixel").filter(|t| *t > 0.0);
        let per_pixel = 1e-3 * per_pixel.ok_or_else(|| missing("ImgHdr_TimePerPixel"))?;
        let tick = header.global_resolution_s().ok_or_else(|| missing("MeasDesc_GlobalResolution"))?;
        let ticks = (per_pixel / tick).round();
        if !(1.0..1e15).contains(&ticks) {
            return Err(format!(
                "the tag ImgHdr_TimePerPixel is {} ms ({ticks} counts of the clock); expected 1 to 1e15 counts",
                per_pixel * 1e3
            ));
        }
        let sine = match header.number("ImgHdr_SinCorrection").unwrap_or(0.0) {
            0.0 => None,
            percent if percent > 0.0 && percent <= 100.0 => Some(0.01 * percent),
            percent => {
                return Err(format!(
                    "the tag ImgHdr_SinCorrection is {percent}: expected a percentage of the amplitude from 0 to 100"
                ));
            }
        };
        let image = dimensions == 3.0;
        Ok(Self {
            width: size("ImgHdr_PixX")?,
            height: if image { size("ImgHdr_PixY")? } else { 1 },
            bidirectional: is_bidirectional(header),
            clock: Clock {
                begin: markers[0],
                end: markers[1],
                // Every line of a line scan restarts at the first row.
                frame: if image { markers[2] } else { markers[0] },
                sweep: Some(Sweep { pixel_time: ticks as u64, sine }),
            },
        })
    }

    /// Returns whether a row runs from its last pixel to its first.
    fn is_backwards(&self, row: usize) -> bool {
        self.bidirectional && row % 2 == 1
    }

    /// Returns the pixel at step `n` of a frame, for scans with pixel markers.
    fn pixel(&self, n: usize) -> usize {
        let (x, y) = (n % self.width, n / self.width);
        y * self.width + if self.is_backwards(y) { self.width - 1 - x } else { x }
    }

    /// Returns the number of pixels or lines in a frame.
    pub(super) fn steps(&self) -> usize {
        if self.clock.sweep.is_some() { self.height } else { self.width * self.height }
    }
}

/// Position of the beam during the pass over the records.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    scan: Option<Scan>,
    /// Number of pixels or lines that have begun in this frame.
    begun: usize,
    /// Pixel of the current photons, or `None` outside all pixels.
    pub pixel: Option<usize>,
    /// Time range in which [`Self::pixel`] is valid (scans by lines only).
    pub during: [u64; 2],
    /// Start time and number of the current line.
    line: Option<(u64, usize)>,
    /// Number of pixels or lines that have begun in the file.
    pub begins: u64,
    /// Number of pixels or lines that began after the last pixel or line of a frame.
    pub beyond: u64,
    /// Number of frame markers.
    pub frames: u64,
    /// Number of pixels or lines that are missing in the last frame.
    pub missing: usize,
    /// Whether the first frame marker has just ended a frame whose beginning is missing.
    pub torn: bool,
}

const NEVER: [u64; 2] = [u64::MAX, 0];

impl Beam {
    /// Creates the state before the first marker. Without a scan, all photons belong to pixel 0.
    pub fn new(scan: Option<Scan>) -> Self {
        Self {
            scan,
            begun: 0,
            pixel: scan.is_none().then_some(0),
            during: NEVER,
            line: None,
            begins: 0,
            beyond: 0,
            frames: 0,
            missing: 0,
            torn: false,
        }
    }

    /// Returns whether the pixel depends on the time of photons.
    pub fn is_timed(&self) -> bool {
        self.scan.is_some_and(|s| s.clock.sweep.is_some())
    }

    /// Updates the state for a marker. Simultaneous markers are processed in this order: end, frame, begin.
    pub fn marker(&mut self, time: u64, bits: u8) {
        let Some(scan) = self.scan else { return };
        let Clock { begin, end, frame, .. } = scan.clock;
        if bits & (end | frame) != 0 {
            (self.pixel, self.line, self.during) = (None, None, NEVER);
        }
        let steps = scan.steps();
        if bits & frame != 0 {
            self.frames += 1;
            // `ptufile` also excludes a first frame in which more than one line is missing.
            self.torn = self.frames == 1 && self.begun > 0 && self.begun + 1 < steps;
            self.begun = 0;
        }
        if bits & begin == 0 {
            return;
        }
        let now = self.begun;
        self.begun = now.saturating_add(1);
        self.begins += 1;
        self.beyond += u64::from(now >= steps);
        self.missing = steps.saturating_sub(self.begun);
        if self.is_timed() {
            (self.pixel, self.during) = (None, NEVER);
            self.line = (now < steps).then_some((time, now));
        } else {
            self.pixel = (now < steps).then(|| scan.pixel(now));
        }
    }

    /// Moves the beam of a scan by lines to a time outside [`Self::during`].
    #[cold]
    pub fn advance(&mut self, time: u64) {
        (self.pixel, self.during) = (None, NEVER);
        let (Some(scan), Some((begin, line))) = (self.scan, self.line) else {
            return;
        };
        let Some(sweep) = scan.clock.sweep else { return };
        let width = scan.width as u64;
        let duration = sweep.pixel_time.saturating_mul(width);
        let Some(since) = time.checked_sub(begin).filter(|since| *since < duration) else {
            return;
        };
        // As in `ptufile`, a backward line is a forward line in reversed time. A count that crosses an edge
        // of a sinusoidal sweep therefore belongs to the same pixel in both directions.
        let back = scan.is_backwards(line);
        let along = if back { duration - 1 - since } else { since };
        if let Some((x, [from, to])) = sweep.column(along, width) {
            self.pixel = Some(line * scan.width + x as usize);
            let [from, to] = if back { [duration - to, duration - from] } else { [from, to] };
            self.during = [begin + from, begin.saturating_add(to)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests that the column edges of a sinusoidal sweep are the arcsines of their positions (closed form).
    /// The test covers every fraction of the amplitude.
    #[test]
    fn column_edges_of_a_sine_sweep_are_arcsines() {
        for (percent, width, pixel_time) in [(80.0, 8, 100), (100.0, 5, 37), (1.0, 16, 3), (50.0, 2, 1000)] {
            let sweep = Sweep { pixel_time, sine: Some(0.01 * percent) };
            let line = width * pixel_time;
            for since in 0..line {
                let amplitude = 0.01 * percent;
                let phase = (2.0 * since as f64 / line as f64 - 1.0) * f64::asin(amplitude);
                let place = 0.5 * width as f64 * (1.0 + phase.sin() / amplitude);
                let (x, [from, to]) = sweep.column(since, width).expect("a column");
                assert!((from..to).contains(&since));
                // Because of rounding, a position on an edge can be on either side.
                assert!((x as f64 - 1e-5..=x as f64 + 1.0 + 1e-5).contains(&place), "{since}: {x} {place}");
            }
            assert_eq!(sweep.column(line, width), None);
        }
    }
}
