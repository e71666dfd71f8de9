//! Byte lines to instruments: a serial port, or a pair of ends in memory, one of which an emulator uses.

use std::io::{ErrorKind, Read, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Reason why sending or receiving failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// Nothing arrived before the deadline.
    #[error("no reply before the deadline")]
    Timeout,
    /// The line is closed or disconnected.
    #[error("connection lost: {0}")]
    Gone(String),
}

/// A bidirectional byte line.
pub trait Line: Send {
    /// Sends all bytes.
    ///
    /// # Errors
    /// [`LineError`].
    fn send(&mut self, bytes: &[u8]) -> Result<(), LineError>;

    /// Waits for bytes and returns at least one.
    ///
    /// # Errors
    /// [`LineError`], at the latest after `within`.
    fn receive(&mut self, within: Duration) -> Result<Vec<u8>, LineError>;

    /// Reopens the line after a disconnection; bytes in transit are lost.
    ///
    /// # Errors
    /// [`LineError`].
    fn reopen(&mut self) -> Result<(), LineError>;
}

/// A serial port: 8 data bits, no parity, one stop bit.
pub struct SerialLine {
    path: String,
    baud: u32,
    hardware: bool,
    port: Option<Box<dyn serialport::SerialPort>>,
}

impl SerialLine {
    /// Opens a port; `hardware` selects RTS/CTS flow control.
    ///
    /// # Errors
    /// [`LineError::Gone`] with the system's error message.
    pub fn open(path: &str, baud: u32, hardware: bool) -> Result<Self, LineError> {
        let mut line = Self { path: path.to_owned(), baud, hardware, port: None };
        line.reopen()?;
        Ok(line)
    }

    fn gone(&mut self, cause: impl ToString) -> LineError {
        self.port = None;
        LineError::Gone(format!("{}: {}", self.path, cause.to_string()))
    }
}

impl Line for SerialLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        let Some(port) = &mut self.port else {
            return Err(LineError::Gone(self.path.clone()));
        };
        // A port that accepts no bytes for two seconds has failed.
        let sent = port
            .set_timeout(Duration::from_secs(2))
            .map_err(std::io::Error::from)
            .and_then(|()| port.write_all(bytes));
        match sent {
            Ok(()) => Ok(()),
            Err(e) if e.kind() == ErrorKind::TimedOut => Err(LineError::Timeout),
            Err(e) => Err(self.gone(e)),
        }
    }

    fn receive(&mut self, within: Duration) -> Result<Vec<u8>, LineError> {
        let Some(port) = &mut self.port else {
            return Err(LineError::Gone(self.path.clone()));
        };
        let mut buffer = [0; 512];
        let got = port
            .set_timeout(within.max(Duration::from_millis(1)))
            .map_err(std::io::Error::from)
            .and_then(|()| port.read(&mut buffer));
        match got {
            Ok(0) => Err(self.gone("the port was closed")),
            Ok(n) => Ok(buffer[..n].to_vec()),
            Err(e) if e.kind() == ErrorKind::TimedOut => Err(LineError::Timeout),
            Err(e) => Err(self.gone(e)),
        }
    }

    fn reopen(&mut self) -> Result<(), LineError> {
        use serialport::FlowControl;
        self.port = None;
        let flow = if self.hardware { FlowControl::Hardware } else { FlowControl::None };
        let open = serialport::new(&self.path, self.baud).flow_control(flow).open();
        match open {
            Ok(port) => {
                self.port = Some(port);
                Ok(())
            }
            Err(e) => Err(self.gone(e)),
        }
    }
}

/// One end of a line in memory.
pub struct MemoryLine {
    to: Sender<Vec<u8>>,
    from: Receiver<Vec<u8>>,
}

impl MemoryLine {
    /// Creates both ends of a line.
    #[must_use]
    pub fn pair() -> (Self, Self) {
        let ((to_b, from_a), (to_a, from_b)) = (channel(), channel());
        let a = Self { to: to_b, from: from_b };
        let b = Self { to: to_a, from: from_a };
        (a, b)
    }
}

impl Line for MemoryLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        let gone = |_| LineError::Gone("the other end was closed".into());
        self.to.send(bytes.to_vec()).map_err(gone)
    }

    fn receive(&mut self, within: Duration) -> Result<Vec<u8>, LineError> {
        loop {
            match self.from.recv_timeout(within) {
                Ok(bytes) if bytes.is_empty() => {}
                Ok(bytes) => return Ok(bytes),
                Err(RecvTimeoutError::Timeout) => return Err(LineError::Timeout),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(LineError::Gone("the other end was closed".into()));
                }
            }
        }
    }

    fn reopen(&mut self) -> Result<(), LineError> {
        while self.from.try_recv().is_ok() {}
        Ok(())
    }
}
