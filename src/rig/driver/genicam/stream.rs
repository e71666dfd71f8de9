//! Frames of a camera's stream.

use super::super::line::left;
use crate::instrument::{Fault, PixelFormat, Region};
use cameleon::payload::{self, Payload, PayloadReceiver};
use cameleon::{DeviceControl, PayloadStream, StreamError};
use std::time::{Duration, Instant};

/// Maximum number of queued frames. Further frames are dropped, which causes gaps in the frame numbers.
const WAITING: usize = 8;
/// Polling interval for frames.
const POLL: Duration = Duration::from_millis(1);

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    pub region: Region,
    /// Pixel format, or `None` if the format is not supported.
    pub format: Option<PixelFormat>,
    pub bytes: Vec<u8>,
    pub number: u64,
    /// Time of the frame on the camera's clock.
    pub timestamp: Duration,
}

pub fn fault(error: &StreamError) -> Fault {
    match error {
        StreamError::Timeout => Fault::Timeout,
        // A damaged frame counts as a lost frame.
        StreamError::InvalidPayload(_) | StreamError::BufferTooSmall => Fault::Timeout,
        StreamError::InStreaming => Fault::Refused,
        _ => Fault::Disconnected,
    }
}

pub trait Frames: Send {
    /// Opens the line. Has no effect if the line is open.
    ///
    /// # Errors
    /// Returns [`StreamError`] if the line cannot be opened.
    fn open(&mut self) -> Result<(), StreamError>;

    /// Closes the line.
    ///
    /// # Errors
    /// Returns [`StreamError`] if the line cannot be closed.
    fn close(&mut self) -> Result<(), StreamError>;

    /// Starts receiving frames, and discards earlier frames.
    ///
    /// # Errors
    /// Returns [`StreamError`] if the line is closed or disconnected.
    fn start(&mut self, control: &mut dyn DeviceControl) -> Result<(), StreamError>;

    /// Returns the next frame, or `None` if no frame arrives before the deadline.
    ///
    /// # Errors
    /// Returns [`StreamError`] if the frame is damaged or the line is disconnected.
    fn next(&mut self, within: Duration) -> Result<Option<Block>, StreamError>;

    /// Stops receiving frames. Has no effect if no reception was started.
    ///
    /// # Errors
    /// Returns [`StreamError`] if the line is disconnected.
    fn stop(&mut self) -> Result<(), StreamError>;
}

/// A stream of the crate `cameleon`.
pub struct Streamed<S> {
    stream: S,
    receiver: Option<PayloadReceiver>,
}

impl<S> Streamed<S> {
    /// Wraps a stopped stream.
    pub fn new(stream: S) -> Self {
        Self { stream, receiver: None }
    }

    /// Returns the wrapped stream, for tests.
    #[cfg(test)]
    pub(super) fn stream_mut(&mut self) -> &mut S {
        &mut self.stream
    }
}

fn block(payload: Payload) -> Result<Block, StreamError> {
    let Some(info) = payload.image_info() else {
        return Err(StreamError::InvalidPayload("the data block of the camera contains no image".into()));
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
                // `cameleon` reports the same error for an empty queue and for a queue whose sender has
                // closed.
                Err(StreamError::ReceiveError(what)) if what.contains("closed") => {
                    return Err(StreamError::Disconnected);
                }
                Err(StreamError::ReceiveError(_)) => {}
                Err(e) => return Err(e),
            }
            if left(until).is_zero() {
                return Ok(None);
            }
            std::thread::sleep(POLL.min(left(until)));
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
