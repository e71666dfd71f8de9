//! Markers of a galvo scan: which pixel a photon belongs to.

use super::header::Header;

/// How the beam sweeps along a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// Duration of a pixel in counts of the time tag (in T3: sync pulses). With [`Self::sine`] it is the mean over a line.
    pub pixel_time: u64,
    /// The part of a sine's amplitude that a line covers, in (0, 1]; none if all pixels take equally long.
    ///
    /// The beam's place is that of `ptufile`'s `sinusoidal_correction` (`ImgHdr_SinCorrection` as a percentage of the amplitude).
    pub sine: Option<f64>,
}

impl Sweep {
    /// The first count of time, from the beginning of the line, at which the beam is in column `x` of `width`.
    fn edge(&self, x: u64, width: u64) -> u64 {
        let line = self.pixel_time.saturating_mul(width);
        let Some(sine) = self.sine.filter(|_| x > 0 && x < width) else {
            return self.pixel_time.saturating_mul(x);
        };
        let place = 2.0 * x as f64 / width as f64 - 1.0;
        let phase = (sine * place).asin() / sine.asin();
        // Rounding of `asin` must not move an edge that falls on a whole count.
        (0.5 * line as f64 * (1.0 + phase) - 1e-6).ceil() as u64
    }

    /// The column at a time from the beginning of the line, and the times for which it holds. None after the last pixel.
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

/// What markers mean. Markers are bits: 1 is the first input, 8 the fourth, 0 none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clock {
    /// One marker begins each pixel: the beam stands at a point, then goes to the next.
    Pixels {
        /// Begins the next pixel.
        begin: u8,
        /// Ends it; without one, the next begin does.
        end: u8,
        /// The next pixel is the first again.
        frame: u8,
    },
    /// One marker begins each line: the beam sweeps.
    Lines {
        /// Begins the next line.
        begin: u8,
        /// Ends it; without one, its last pixel does.
        end: u8,
        /// The next line is the first again.
        frame: u8,
        /// The pixels of a line.
        sweep: Sweep,
    },
}

/// Returns whether a header says that every second row runs backwards (`ImgHdr_BiDirect`).
#[must_use]
pub fn is_bidirectional(header: &Header) -> bool {
    header.number("ImgHdr_BiDirect").is_some_and(|n| n > 0.0)
}

/// A scan of rows of pixels from the upper left one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Every second row of a frame runs from its last pixel to its first.
    pub bidirectional: bool,
    /// What markers mean.
    pub clock: Clock,
}

impl Scan {
    /// A scan by lines as a file's own header describes it (`ImgHdr_…`).
    ///
    /// A line scan (`ImgHdr_Dimensions` 2) has one row, to which every line adds.
    ///
    /// # Errors
    /// The tag that is missing or has a value without a meaning.
    pub fn of_header(header: &Header) -> Result<Self, String> {
        let missing = |name: &str| format!("the header does not describe a scan: {name} is missing");
        let marker = |name: &str| match header.number(name) {
            None | Some(0.0) => Ok(0),
            Some(n) if [1.0, 2.0, 3.0, 4.0].contains(&n) => Ok(1_u8 << (n as u8 - 1)),
            Some(n) => Err(format!("{name} is {n}: expected a marker from 1 to 4")),
        };
        let size = |name: &str| match header.number(name) {
            Some(n) if (1.0..1e9).contains(&n) => Ok(n as usize),
            Some(n) => Err(format!("{name} is {n}: expected at least one pixel")),
            None => Err(missing(name)),
        };
        let dimensions = header.number("ImgHdr_Dimensions").unwrap_or(3.0);
        if ![2.0, 3.0].contains(&dimensions) {
            return Err(format!(
                "the header does not describe a scan: ImgHdr_Dimensions is {dimensions}"
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
                return Err(format!("{} and {} are the same marker", names[i], names[j]));
            }
        }
        let per_pixel = header.number("ImgHdr_TimePerPixel").filter(|t| *t > 0.0);
        let per_pixel = 1e-3 * per_pixel.ok_or_else(|| missing("ImgHdr_TimePerPixel"))?;
        let tick = header
            .global_resolution_s()
            .ok_or_else(|| missing("MeasDesc_GlobalResolution"))?;
        let ticks = (per_pixel / tick).round();
        if !(1.0..1e15).contains(&ticks) {
            return Err(format!(
                "ImgHdr_TimePerPixel is {} ms, expected 1 to 1e15 counts of the clock",
                per_pixel * 1e3
            ));
        }
        let sine = match header.number("ImgHdr_SinCorrection").unwrap_or(0.0) {
            0.0 => None,
            percent if percent > 0.0 && percent <= 100.0 => Some(0.01 * percent),
            percent => {
                return Err(format!(
                    "ImgHdr_SinCorrection is {percent}: expected a percentage of the amplitude from 0 to 100"
                ));
            }
        };
        let image = dimensions == 3.0;
        Ok(Self {
            width: size("ImgHdr_PixX")?,
            height: if image { size("ImgHdr_PixY")? } else { 1 },
            bidirectional: is_bidirectional(header),
            clock: Clock::Lines {
                begin: markers[0],
                end: markers[1],
                // Every line of a line scan is the first one again.
                frame: if image { markers[2] } else { markers[0] },
                sweep: Sweep {
                    pixel_time: ticks as u64,
                    sine,
                },
            },
        })
    }

    /// True of rows that run from their last pixel to their first.
    fn is_backwards(&self, row: usize) -> bool {
        self.bidirectional && row % 2 == 1
    }

    /// The pixel at step `n` of a frame, by pixel markers.
    fn pixel(&self, n: usize) -> usize {
        let (x, y) = (n % self.width, n / self.width);
        y * self.width
            + if self.is_backwards(y) {
                self.width - 1 - x
            } else {
                x
            }
    }

    /// The marker that begins a pixel or a line.
    pub(super) fn begin(&self) -> u8 {
        let (Clock::Pixels { begin, .. } | Clock::Lines { begin, .. }) = self.clock;
        begin
    }

    /// Pixels or lines of a frame.
    pub(super) fn steps(&self) -> usize {
        match self.clock {
            Clock::Pixels { .. } => self.width * self.height,
            Clock::Lines { .. } => self.height,
        }
    }
}

/// Where the beam is while records go by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    scan: Option<Scan>,
    /// Pixels or lines that have begun in this frame.
    begun: usize,
    /// Where photons of now belong; none if they belong nowhere.
    pub pixel: Option<usize>,
    /// Times for which [`Self::pixel`] holds (lines alone).
    pub during: [u64; 2],
    /// Begin and number of the line that is under way.
    line: Option<(u64, usize)>,
    /// Pixels or lines that have begun in the file.
    pub begins: u64,
    /// Those of them beyond the last of a frame.
    pub beyond: u64,
    /// Frame markers.
    pub frames: u64,
    /// Pixels or lines that the last frame lacks.
    pub missing: usize,
    /// The first frame marker has just ended a frame whose beginning the file does not have.
    pub torn: bool,
}

const NEVER: [u64; 2] = [u64::MAX, 0];

impl Beam {
    /// Before the first marker. Without a scan, everything belongs to pixel 0.
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

    /// True if photons move the beam on.
    pub fn is_timed(&self) -> bool {
        self.scan.is_some_and(|s| matches!(s.clock, Clock::Lines { .. }))
    }

    /// A marker came. Ends come before frames and those before begins, if they come at once.
    pub fn marker(&mut self, time: u64, bits: u8) {
        let Some(scan) = self.scan else { return };
        let (Clock::Pixels { begin, end, frame }
        | Clock::Lines {
            begin, end, frame, ..
        }) = scan.clock;
        if bits & (end | frame) != 0 {
            (self.pixel, self.line, self.during) = (None, None, NEVER);
        }
        let steps = scan.steps();
        if bits & frame != 0 {
            self.frames += 1;
            // `ptufile` leaves out a first frame that lacks more than one line.
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

    /// Puts the beam of a line scan where it is at a time outside [`Self::during`].
    #[cold]
    pub fn advance(&mut self, time: u64) {
        (self.pixel, self.during) = (None, NEVER);
        let (Some(scan), Some((begin, line))) = (self.scan, self.line) else {
            return;
        };
        let Clock::Lines { sweep, .. } = scan.clock else {
            return;
        };
        let width = scan.width as u64;
        let duration = sweep.pixel_time.saturating_mul(width);
        let Some(since) = time.checked_sub(begin).filter(|since| *since < duration) else {
            return;
        };
        // A line that runs backwards is one that runs forwards from its end, as `ptufile` has it: counts that lie across
        // an edge of a sinusoidal sweep go to the same pixel.
        let back = scan.is_backwards(line);
        let along = if back { duration - 1 - since } else { since };
        if let Some((x, [from, to])) = sweep.column(along, width) {
            self.pixel = Some(line * scan.width + x as usize);
            let [from, to] = if back {
                [duration - to, duration - from]
            } else {
                [from, to]
            };
            self.during = [begin + from, begin.saturating_add(to)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The edges of columns of a sinusoidal sweep are the arcsines of their places: closed form, for all parts of the amplitude.
    #[test]
    fn columns_of_a_sine_are_its_arcsines() {
        for (percent, width, pixel_time) in [(80.0, 8, 100), (100.0, 5, 37), (1.0, 16, 3), (50.0, 2, 1000)] {
            let sweep = Sweep {
                pixel_time,
                sine: Some(0.01 * percent),
            };
            let line = width * pixel_time;
            for since in 0..line {
                let amplitude = 0.01 * percent;
                let phase = (2.0 * since as f64 / line as f64 - 1.0) * f64::asin(amplitude);
                let place = 0.5 * width as f64 * (1.0 + phase.sin() / amplitude);
                let (x, [from, to]) = sweep.column(since, width).expect("a column");
                assert!((from..to).contains(&since));
                // A place on an edge may be on either side by rounding.
                assert!(
                    (x as f64 - 1e-5..=x as f64 + 1.0 + 1e-5).contains(&place),
                    "{since}: {x} {place}"
                );
            }
            assert_eq!(sweep.column(line, width), None);
        }
    }
}
