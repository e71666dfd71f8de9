//! Markers of a galvo scan: which pixel a photon belongs to.

/// What markers mean. Markers are bits: 1 is the first input, 8 the fourth, 0 none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// One marker begins each line, whose pixels are of one duration: the beam sweeps.
    Lines {
        /// Begins the next line.
        begin: u8,
        /// Ends it; without one, its last pixel does.
        end: u8,
        /// The next line is the first again.
        frame: u8,
        /// Duration of a pixel in counts of the time tag (in T3: sync pulses).
        pixel_time: u64,
    },
}

/// A scan of rows of pixels from the upper left one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scan {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// What markers mean.
    pub clock: Clock,
}

impl Scan {
    /// A line scan as a file's own header describes it (`ImgHdr_…`), if it does.
    #[must_use]
    pub fn of_header(header: &super::header::Header) -> Option<Self> {
        let marker = |name| match header.int(name) {
            Some(n @ 1..=4) => 1 << (n - 1),
            _ => 0,
        };
        let size = |name| {
            header
                .int(name)
                .and_then(|n| usize::try_from(n).ok())
                .filter(|n| *n > 0)
        };
        let pixel_s = header.float("ImgHdr_TimePerPixel")? * 1e-3;
        let ticks = (pixel_s / header.global_resolution_s()?).round();
        let begin = marker("ImgHdr_LineStart");
        if begin == 0 || !(1.0..1e18).contains(&ticks) {
            return None;
        }
        Some(Self {
            width: size("ImgHdr_PixX")?,
            height: size("ImgHdr_PixY")?,
            clock: Clock::Lines {
                begin,
                end: marker("ImgHdr_LineStop"),
                frame: marker("ImgHdr_Frame"),
                pixel_time: ticks as u64,
            },
        })
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
    /// Begin and first pixel of the line that is under way.
    line: Option<(u64, usize)>,
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
        if bits & frame != 0 {
            self.begun = 0;
        }
        if bits & begin == 0 {
            return;
        }
        let (now, pixels) = (self.begun, scan.width * scan.height);
        self.begun = now.saturating_add(1);
        if self.is_timed() {
            (self.pixel, self.during) = (None, NEVER);
            self.line = (now < scan.height).then(|| (time, now * scan.width));
        } else {
            self.pixel = Some(now).filter(|n| *n < pixels);
        }
    }

    /// Puts the beam of a line scan where it is at a time outside [`Self::during`].
    #[cold]
    pub fn advance(&mut self, time: u64) {
        (self.pixel, self.during) = (None, NEVER);
        let (Some(scan), Some((begin, first))) = (self.scan, self.line) else {
            return;
        };
        let Clock::Lines { pixel_time, .. } = scan.clock else {
            return;
        };
        let pixel_time = pixel_time.max(1);
        let Some(since) = time.checked_sub(begin) else {
            return;
        };
        let x = since / pixel_time;
        if x < scan.width as u64 {
            self.pixel = Some(first + x as usize);
            let from = begin + x * pixel_time;
            self.during = [from, from.saturating_add(pixel_time)];
        }
    }
}
