//! Byte lines to instruments. A line is a serial port, a TCP connection, or a line in memory whose other end
//! an emulator uses.

use crate::instrument::Fault;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

/// Timeout for connecting to an instrument and for sending.
const PATIENCE: Duration = Duration::from_secs(2);

/// Returns the time until a deadline.
pub(super) fn left(until: Instant) -> Duration {
    until.saturating_duration_since(Instant::now())
}

/// Reason why sending or receiving failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// Nothing arrived before the deadline.
    #[error("no reply arrived before the deadline")]
    Timeout,
    /// The line is closed or disconnected.
    #[error("connection lost: {0}")]
    Gone(String),
}

impl LineError {
    /// Returns the kind of failure.
    pub fn fault(&self) -> Fault {
        match self {
            Self::Timeout => Fault::Timeout,
            Self::Gone(_) => Fault::Disconnected,
        }
    }
}

/// A bidirectional byte line.
pub trait Line: Send {
    /// Sends all bytes.
    ///
    /// # Errors
    /// Returns [`LineError`] if the bytes cannot be sent in time, or if the line is disconnected.
    fn send(&mut self, bytes: &[u8]) -> Result<(), LineError>;

    /// Waits for bytes and returns at least one.
    ///
    /// # Errors
    /// Returns [`LineError`] if no byte arrives within the time `within`, or if the line is disconnected.
    fn receive(&mut self, within: Duration) -> Result<Vec<u8>, LineError>;

    /// Reopens the line after a disconnection. Bytes in transit are lost.
    ///
    /// # Errors
    /// Returns [`LineError`] if the line cannot be opened.
    fn reopen(&mut self) -> Result<(), LineError>;
}

/// A stream with a timeout for reading and writing.
trait Stream: Read + Write + Send {
    fn set_timeout(&mut self, timeout: Duration) -> io::Result<()>;
}

impl Stream for Box<dyn serialport::SerialPort> {
    fn set_timeout(&mut self, timeout: Duration) -> io::Result<()> {
        Ok(self.as_mut().set_timeout(timeout)?)
    }
}

impl Stream for TcpStream {
    fn set_timeout(&mut self, timeout: Duration) -> io::Result<()> {
        self.set_read_timeout(Some(timeout))?;
        self.set_write_timeout(Some(timeout))
    }
}

type Open = Box<dyn Fn(&str) -> io::Result<Box<dyn Stream>> + Send>;

/// A serial port or a TCP connection.
pub struct StreamLine {
    /// Path of the port, or `host:port`.
    name: String,
    open: Open,
    stream: Option<Box<dyn Stream>>,
}

impl StreamLine {
    /// Opens a serial port with 8 data bits, no parity and one stop bit. If `hardware` is true, RTS/CTS flow
    /// control is used.
    ///
    /// # Errors
    /// Returns [`LineError::Gone`] with the system's error message if the port cannot be opened.
    pub fn serial(path: &str, baud: u32, hardware: bool) -> Result<Self, LineError> {
        use serialport::FlowControl;
        let flow = if hardware { FlowControl::Hardware } else { FlowControl::None };
        Self::open(path, move |path| Ok(Box::new(serialport::new(path, baud).flow_control(flow).open()?)))
    }

    /// Connects to `host:port`.
    ///
    /// # Errors
    /// Returns [`LineError::Gone`] with the system's error message if the connection fails.
    pub fn tcp(address: &str) -> Result<Self, LineError> {
        Self::open(address, |address| {
            let found = address.to_socket_addrs()?.next();
            let found = found.ok_or_else(|| io::Error::other("the host name cannot be resolved"))?;
            let stream = TcpStream::connect_timeout(&found, PATIENCE)?;
            stream.set_nodelay(true)?;
            Ok(Box::new(stream))
        })
    }

    fn open(
        name: &str,
        open: impl Fn(&str) -> io::Result<Box<dyn Stream>> + Send + 'static,
    ) -> Result<Self, LineError> {
        let mut line = Self { name: name.to_owned(), open: Box::new(open), stream: None };
        line.reopen()?;
        Ok(line)
    }

    fn gone(&mut self, cause: impl ToString) -> LineError {
        self.stream = None;
        LineError::Gone(format!("{}: {}", self.name, cause.to_string()))
    }

    /// Sets the timeout of the stream and calls `f` with the stream.
    fn with<T>(
        &mut self,
        timeout: Duration,
        f: impl FnOnce(&mut dyn Stream) -> io::Result<T>,
    ) -> Result<T, LineError> {
        let Some(stream) = &mut self.stream else {
            return Err(LineError::Gone(self.name.clone()));
        };
        // A timeout of zero would mean no timeout.
        let done = stream.set_timeout(timeout.max(Duration::from_millis(1)));
        done.and_then(|()| f(stream.as_mut())).map_err(|e| match e.kind() {
            ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => LineError::Timeout,
            _ => self.gone(e),
        })
    }
}

impl Line for StreamLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        self.with(PATIENCE, |stream| stream.write_all(bytes))
    }

    fn receive(&mut self, within: Duration) -> Result<Vec<u8>, LineError> {
        let mut buffer = [0; 4096];
        match self.with(within, |stream| stream.read(&mut buffer))? {
            0 => Err(self.gone("the instrument closed the connection")),
            n => Ok(buffer[..n].to_vec()),
        }
    }

    fn reopen(&mut self) -> Result<(), LineError> {
        self.stream = None;
        let opened = (self.open)(&self.name);
        self.stream = Some(opened.map_err(|e| self.gone(e))?);
        Ok(())
    }
}

/// One end of a line in memory.
pub struct MemoryLine {
    to: Sender<Vec<u8>>,
    from: Receiver<Vec<u8>>,
}

impl MemoryLine {
    /// Creates both ends of a line.
    pub fn pair() -> (Self, Self) {
        let ((to_b, from_a), (to_a, from_b)) = (channel(), channel());
        let a = Self { to: to_b, from: from_b };
        let b = Self { to: to_a, from: from_a };
        (a, b)
    }
}

impl Line for MemoryLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        let gone = |_| LineError::Gone("the other end closed the connection".into());
        self.to.send(bytes.to_vec()).map_err(gone)
    }

    fn receive(&mut self, within: Duration) -> Result<Vec<u8>, LineError> {
        loop {
            match self.from.recv_timeout(within) {
                Ok(bytes) if bytes.is_empty() => {}
                Ok(bytes) => return Ok(bytes),
                Err(RecvTimeoutError::Timeout) => return Err(LineError::Timeout),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(LineError::Gone("the other end closed the connection".into()));
                }
            }
        }
    }

    fn reopen(&mut self) -> Result<(), LineError> {
        while self.from.try_recv().is_ok() {}
        Ok(())
    }
}
