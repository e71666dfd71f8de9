//! The projector driver, which displays patterns from flash, one at a time.

use super::super::line::{LineError, left};
use super::command::{Command, Entry, Mailbox, Question, Run, Source, complaints};
use super::hid::{Assembler, HidLine, Message};
use super::trigger::Triggers;
use crate::instrument::{
    Failure, Fault, Identity, Instrument, Pattern, PatternProjector, ProjectorLimits, pattern,
};
use std::time::{Duration, Instant};

/// Width and height of the mirror array, in pixels.
pub const SIZE: [u32; 2] = [912, 1140];
/// Shortest period of a one-bit pattern, in microseconds (guide, table of pattern mode).
pub const SHORTEST_US: u32 = 235;
/// Black time after a pattern, in microseconds.
const BLACK_US: u32 = 230;
/// Maximum number of images in flash.
const IMAGES: usize = 64;
/// Number of one-bit planes in an image.
const PLANES: usize = 24;

/// Contents of the flash. `images[i][p]` is plane `p` of image `i`, a one-bit pattern with pixel values 0 and
/// 255.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Flash(pub Vec<Vec<Pattern>>);

/// The location of a pattern in the controller's flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    image: u8,
    plane: u8,
    negative: bool,
}

/// A projector with a DLPC350 controller.
pub struct Dlpc350 {
    name: String,
    line: Box<dyn HidLine>,
    parser: Assembler,
    number: u8,
    flash: Flash,
    period_us: u32,
    leds: u8,
    triggers: Triggers,
    loaded: Vec<Place>,
}

impl Dlpc350 {
    /// Creates a projector on an open line. `leds` is a bit mask of the LEDs to use (1 red, 2 green, 4 blue).
    /// A pattern repeats every `period`.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `limit` if there are too many images or no LED. Also returns this
    /// failure if a pixel value or the period is invalid.
    pub fn new(
        name: &str,
        line: Box<dyn HidLine>,
        flash: Flash,
        leds: u8,
        period: Duration,
    ) -> Result<Self, Failure> {
        let limit = |what: String| Err(Failure::new(Fault::Limit, name, what));
        let (images, planes) = (flash.0.len(), flash.0.iter().map(Vec::len).max().unwrap_or(0));
        if images > IMAGES || planes > PLANES {
            return limit(format!(
                "got {images} images of up to {planes} planes, but the flash memory holds at most {IMAGES} images of {PLANES} \
                 planes; list fewer images in `flash`"
            ));
        }
        if flash.0.iter().flatten().any(|p| !fits(p)) {
            let [w, h] = SIZE;
            return limit(format!(
                "patterns in flash memory must have {w} x {h} pixels with values 0 or 255; create the images with `sunstone rig flash`"
            ));
        }
        if leds == 0 || leds > 7 {
            return limit(format!(
                "invalid LED selection {leds}; expected the sum of 1 for red, 2 for green and 4 for blue"
            ));
        }
        let period_us = u32::try_from(period.as_micros()).unwrap_or(u32::MAX);
        if !(SHORTEST_US..=1_000_000).contains(&period_us) {
            return limit(format!(
                "the period {period:?} is outside the range {SHORTEST_US} µs to 1 s; correct the period"
            ));
        }
        Ok(Self {
            name: name.to_owned(),
            line,
            parser: Assembler::default(),
            number: 0,
            flash,
            period_us,
            leds,
            triggers: Triggers::default(),
            loaded: vec![],
        })
    }

    /// Sets the triggers of the projector.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `limit` if a time is out of range, or if the period is too short for an
    /// input trigger. An input trigger requires 230 µs of black after a pattern.
    pub fn with_triggers(mut self, triggers: Triggers) -> Result<Self, Failure> {
        triggers.commands().map_err(|e| self.failure(Fault::Limit, e))?;
        if triggers.input.is_some() && self.period_us < SHORTEST_US + BLACK_US {
            let what = format!(
                "a period of {} µs is too short: externally triggered patterns need {BLACK_US} µs of black; increase the period",
                self.period_us
            );
            return self.fail(Fault::Limit, what);
        }
        self.triggers = triggers;
        Ok(self)
    }

    fn lost(&self, e: LineError) -> Failure {
        match e {
            LineError::Timeout => self.failure(
                Fault::Timeout,
                "the projector did not answer before the deadline; check the cable and the power",
            ),
            LineError::Gone(why) => self.failure(Fault::Disconnected, why),
        }
    }

    /// Sends one message and returns the payload of its reply. Skips replies with other numbers, because
    /// these replies belong to earlier messages that timed out.
    fn exchange(&mut self, read: bool, code: u16, data: &[u8], until: Instant) -> Result<Vec<u8>, Failure> {
        self.number = self.number.wrapping_add(1);
        self.parser.clear();
        for report in Message::host(read, self.number, code, data).reports() {
            self.line.write(&report).map_err(|e| self.lost(e))?;
        }
        loop {
            if left(until).is_zero() {
                return Err(self.lost(LineError::Timeout));
            }
            let report = self.line.read(left(until)).map_err(|e| self.lost(e))?;
            match self.parser.feed(&report) {
                Some(m) if m.number == self.number && m.read == read => {
                    if m.refused {
                        return self
                            .fail(Fault::Refused, format!("the projector refused command {code:04X}"));
                    }
                    return Ok(m.payload);
                }
                _ => {}
            }
        }
    }

    fn tell(&mut self, command: &Command, until: Instant) -> Result<(), Failure> {
        let (code, data) = command.encode();
        self.exchange(false, code, &data, until).map(drop)
    }

    /// Sends a query and returns its reply of at least `least` bytes.
    fn ask(&mut self, question: Question, least: usize, until: Instant) -> Result<Vec<u8>, Failure> {
        let answer = self.exchange(true, question as u16, &[], until)?;
        if answer.len() < least {
            let what =
                format!("the reply to {question:?} has {} bytes; expected at least {least}", answer.len());
            return self.fail(Fault::Disconnected, what);
        }
        Ok(answer)
    }

    /// Returns the location in flash of a pattern or of its negative. Returns `None` if the flash contains
    /// neither the pattern nor its negative.
    fn find(&self, pattern: &Pattern) -> Option<Place> {
        let all = |value: u8| pattern.pixels.iter().all(|p| *p == value);
        if all(255) || all(0) {
            return Some(Place { image: 0, plane: Entry::WHITE, negative: all(0) });
        }
        let negative_of = |p: &Pattern| p.pixels.iter().zip(&pattern.pixels).all(|(a, b)| *a == 255 - b);
        for (i, image) in self.flash.0.iter().enumerate() {
            for (plane, held) in image.iter().enumerate() {
                let negative = negative_of(held);
                if negative || held.pixels == pattern.pixels {
                    return Some(Place { image: i as u8, plane: plane as u8, negative });
                }
            }
        }
        None
    }

    /// Sets a sequence of one repeating pattern, makes the controller validate the sequence, and starts the
    /// sequence.
    fn run(&mut self, place: Place, until: Instant) -> Result<(), Failure> {
        let outside = self.triggers.input.is_some();
        let exposure_us = self.period_us - if outside { BLACK_US } else { 0 };
        let entry = Entry {
            begin: self.triggers.begin(),
            plane: place.plane,
            bits: 1,
            leds: self.leds,
            negative: place.negative,
            dark_after: outside,
            fetch: true,
            joined: false,
        };
        // Follow the order of the guide. Set all parameters while the sequence is stopped, then validate the
        // sequence.
        let triggers = self.triggers.commands().map_err(|e| self.failure(Fault::Limit, e))?;
        let before = [
            Command::Run(Run::Stop),
            Command::PatternMode(true),
            Command::Source(Source::Flash),
            Command::Config { entries: 1, repeat: true, per_pulse: 1, images: 1 },
            Command::TriggerMode(1),
        ];
        let after = [
            Command::Exposure { exposure_us, period_us: self.period_us },
            Command::Open(Mailbox::Images),
            Command::Address(0),
            Command::ImageTable(vec![place.image]),
            Command::Open(Mailbox::Closed),
            Command::Open(Mailbox::Patterns),
            Command::Address(0),
            Command::PatternTable(vec![entry]),
            Command::Open(Mailbox::Closed),
            Command::Leds(8),
            Command::Validate,
        ];
        for command in before.iter().chain(&triggers).chain(&after) {
            self.tell(command, until)?;
        }
        let bits = loop {
            let bits = self.ask(Question::Validation, 1, until)?[0];
            if bits & 0x80 == 0 {
                break bits;
            }
            std::thread::sleep(Duration::from_millis(1));
        };
        if bits & 3 != 0 {
            let what = format!("the projector rejected the sequence: {}", complaints(bits).join(", "));
            return self.fail(Fault::Limit, what);
        }
        self.tell(&Command::Run(Run::Start), until)
    }

    /// Waits until the mirrors show the pattern.
    fn stands(&mut self, until: Instant) -> Result<(), Failure> {
        loop {
            let main = self.ask(Question::Main, 1, until)?[0];
            if main & 1 != 0 {
                return self.fail(Fault::Refused, "the mirrors are parked; switch the projector on");
            }
            let period = Duration::from_micros(u64::from(self.period_us));
            if main & 2 != 0 {
                // Wait one period, within which the previous pattern ends.
                std::thread::sleep(period);
                return Ok(());
            }
            let hardware = self.ask(Question::Hardware, 1, until)?[0];
            if hardware & 0xC0 != 0 {
                let what = format!(
                    "the projector aborted the sequence (hardware status {hardware:02X}); switch the projector off and on"
                );
                return self.fail(Fault::Refused, what);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// Returns whether a pattern is one-bit and has the size of the mirror array.
fn fits(p: &Pattern) -> bool {
    [p.width, p.height] == SIZE
        && p.pixels.len() == SIZE[0] as usize * SIZE[1] as usize
        && p.pixels.iter().all(|v| *v == 0 || *v == 255)
}

impl Instrument for Dlpc350 {
    fn name(&self) -> &str {
        &self.name
    }

    /// Returns the firmware's tag as the serial number, because the protocol has no serial number.
    fn identify(&mut self, within: Duration) -> Result<Identity, Failure> {
        let until = Instant::now() + within;
        let v = self.ask(Question::Version, 4, until)?;
        let tag = self.ask(Question::Tag, 1, until)?;
        let tag: Vec<u8> = tag.into_iter().take_while(|b| (0x20..0x7F).contains(b)).collect();
        let tag = String::from_utf8_lossy(&tag).trim().to_owned();
        Ok(Identity {
            maker: "Texas Instruments".into(),
            model: "DLPC350".into(),
            serial: if tag.is_empty() { "unknown".into() } else { tag },
            firmware: format!("{}.{}.{}", v[3], v[2], u16::from_le_bytes([v[0], v[1]])),
        })
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        self.loaded.clear();
        self.parser.clear();
        self.line.reopen().map_err(|e| self.lost(e))?;
        self.identify(within).map(drop)
    }
}

impl PatternProjector for Dlpc350 {
    fn limits(&self) -> ProjectorLimits {
        ProjectorLimits {
            size: SIZE,
            patterns: IMAGES * PLANES,
            bits: 1,
            shortest: Duration::from_micros(u64::from(self.period_us)),
        }
    }

    /// Finds the patterns in flash. The driver sends only one query, for the number of images.
    fn load(&mut self, patterns: &[Pattern], within: Duration) -> Result<(), Failure> {
        let until = Instant::now() + within;
        let limit = |what: String| self.fail(Fault::Limit, what);
        if let Err(what) = self.limits().check(patterns.len()) {
            return limit(what);
        }
        let mut places = Vec::with_capacity(patterns.len());
        for (i, pattern) in patterns.iter().enumerate() {
            if !fits(pattern) {
                let [w, h] = SIZE;
                let grey = pattern.pixels.iter().find(|v| !matches!(v, 0 | 255));
                let grey = grey.map_or(String::new(), |v| format!(" and the value {v}"));
                return limit(format!(
                    "pattern {i} must have {w} x {h} pixels with values 0 or 255, got {} x {} pixels{grey}",
                    pattern.width, pattern.height
                ));
            }
            match self.find(pattern) {
                Some(place) => places.push(place),
                None => {
                    return limit(format!(
                        "pattern {i} is not in flash; write the pattern to flash with the firmware, and list the image in `flash`"
                    ));
                }
            }
        }
        let images = self.ask(Question::Images, 1, until)?[0];
        let needed =
            places.iter().filter(|p| p.plane != Entry::WHITE).map(|p| p.image + 1).max().unwrap_or(0);
        if needed > images {
            let what = format!(
                "the flash memory has {images} images, but the patterns need {needed} images; correct `flash` so that the list \
                 matches the firmware"
            );
            return self.fail(Fault::Limit, what);
        }
        self.loaded = places;
        Ok(())
    }

    fn show(&mut self, pattern: usize, within: Duration) -> Result<(), Failure> {
        let until = Instant::now() + within;
        let place = pattern::loaded(&self.loaded, pattern);
        self.run(place.map_err(|what| self.failure(Fault::Limit, what))?, until)?;
        self.stands(until)
    }

    /// First switches to manual control of the LEDs and turns the LEDs off. The LEDs are then off even if the
    /// sequence still runs.
    fn dark(&mut self, within: Duration) -> Result<(), Failure> {
        let until = Instant::now() + within;
        self.tell(&Command::Leds(0), until)?;
        self.tell(&Command::Run(Run::Stop), until)
    }
}
