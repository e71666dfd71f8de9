//! Frames as they come from a camera's stream.

use crate::instrument::{Fault, PixelFormat, Region};
use cameleon::payload::{self, Payload, PayloadReceiver};
use cameleon::{DeviceControl, PayloadStream, StreamError};
use std::time::{Duration, Instant};

/// Frames that wait to be fetched at most; later ones are lost, as their numbers show.
const WAITING: usize = 8;
/// Time between two looks whether a frame came.
const POLL: Duration = Duration::from_millis(1);

/// A frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// What of the sensor it shows.
    pub region: Region,
    /// Its pixels, where this program knows them.
    pub format: Option<PixelFormat>,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// Its number.
    pub number: u64,
    /// The camera's time.
    pub timestamp: Duration,
}

/// What a stream's failure is to a session.
#[must_use]
pub fn fault(error: &StreamError) -> Fault {
    match error {
        StreamError::Timeout => Fault::Timeout,
        // A frame that came broken is lost, no more.
        StreamError::InvalidPayload(_) | StreamError::BufferTooSmall => Fault::Timeout,
        StreamError::InStreaming => Fault::Refused,
        _ => Fault::Disconnected,
    }
}

/// Where frames come from.
pub trait Frames: Send {
    /// Opens the line; no matter if it is open.
    ///
    /// # Errors
    /// [`StreamError`].
    fn open(&mut self) -> Result<(), StreamError>;

    /// Closes it.
    ///
    /// # Errors
    /// [`StreamError`].
    fn close(&mut self) -> Result<(), StreamError>;

    /// Begins to receive; frames of before are forgotten.
    ///
    /// # Errors
    /// [`StreamError`].
    fn start(&mut self, control: &mut dyn DeviceControl) -> Result<(), StreamError>;

    /// The next frame, or none before the deadline.
    ///
    /// # Errors
    /// [`StreamError`].
    fn next(&mut self, within: Duration) -> Result<Option<Block>, StreamError>;

    /// Ends it; no matter if it was not begun.
    ///
    /// # Errors
    /// [`StreamError`].
    fn stop(&mut self) -> Result<(), StreamError>;
}

/// A stream of `cameleon`.
pub struct Streamed<S> {
    stream: S,
    receiver: Option<PayloadReceiver>,
}

impl<S> Streamed<S> {
    /// Of a stream that is at rest.
    pub fn new(stream: S) -> Self {
        Self {
            stream,
            receiver: None,
        }
    }

    /// The stream itself, for tests.
    #[cfg(test)]
    pub(super) fn stream_mut(&mut self) -> &mut S {
        &mut self.stream
    }
}

fn block(payload: Payload) -> Result<Block, StreamError> {
    let Some(info) = payload.image_info() else {
        return Err(StreamError::InvalidPayload("it holds no image".into()));
    };
    let n = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
    let format = match info.pixel_format {
        payload::PixelFormat::Mono8 => Some(PixelFormat::Mono8),
        payload::PixelFormat::Mono10p => Some(PixelFormat::Mono10p),
        payload::PixelFormat::Mono12p => Some(PixelFormat::Mono12p),
        payload::PixelFormat::Mono16 => Some(PixelFormat::Mono16),
        _ => None,
    };
    Ok(Block {
        region: Region {
            x: n(info.x_offset),
            y: n(info.y_offset),
            width: n(info.width),
            height: n(info.height),
        },
        format,
        number: payload.id(),
        timestamp: payload.timestamp(),
        bytes: payload.into_vec(),
    })
}

impl<S: PayloadStream + Send> Frames for Streamed<S> {
    fn open(&mut self) -> Result<(), StreamError> {
        self.stream.open()
    }

    fn close(&mut self) -> Result<(), StreamError> {
        self.stop()?;
        self.stream.close()
    }

    fn start(&mut self, control: &mut dyn DeviceControl) -> Result<(), StreamError> {
        let (sender, receiver) = payload::channel(WAITING, WAITING);
        self.stream.start_streaming_loop(sender, control)?;
        self.receiver = Some(receiver);
        Ok(())
    }

    fn next(&mut self, within: Duration) -> Result<Option<Block>, StreamError> {
        let Some(receiver) = &self.receiver else {
            return Err(StreamError::Disconnected);
        };
        let until = Instant::now() + within;
        loop {
            match receiver.try_recv() {
                Ok(payload) => return block(payload).map(Some),
                // An empty queue and one that nobody fills any more are one error of `cameleon`.
                Err(StreamError::ReceiveError(what)) if what.contains("closed") => {
                    return Err(StreamError::Disconnected);
                }
                Err(StreamError::ReceiveError(_)) => {}
                Err(e) => return Err(e),
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            std::thread::sleep(POLL.min(left));
        }
    }

    fn stop(&mut self) -> Result<(), StreamError> {
        self.receiver = None;
        if self.stream.is_loop_running() {
            self.stream.stop_streaming_loop()?;
        }
        Ok(())
    }
}
