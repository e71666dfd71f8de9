//! A byte line over TCP.

use super::line::{Line, LineError};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// Timeout for connecting and for sending.
const PATIENCE: Duration = Duration::from_secs(2);

/// A connection to `host:port`.
pub struct TcpLine {
    address: String,
    stream: Option<TcpStream>,
}

impl TcpLine {
    /// Connects.
    ///
    /// # Errors
    /// [`LineError::Gone`] with the system's error message.
    pub fn open(address: &str) -> Result<Self, LineError> {
        let mut line = Self { address: address.to_owned(), stream: None };
        line.reopen()?;
        Ok(line)
    }

    fn gone(&mut self, cause: impl ToString) -> LineError {
        self.stream = None;
        LineError::Gone(format!("{}: {}", self.address, cause.to_string()))
    }

    /// Converts a system error to a line error.
    fn describe(&mut self, e: &std::io::Error) -> LineError {
        match e.kind() {
            ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => LineError::Timeout,
            _ => self.gone(e),
        }
    }
}

impl Line for TcpLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        let Some(stream) = &mut self.stream else {
            return Err(LineError::Gone(self.address.clone()));
        };
        stream.write_all(bytes).map_err(|e| self.describe(&e))
    }

    fn receive(&mut self, within: Duration) -> Result<Vec<u8>, LineError> {
        let Some(stream) = &mut self.stream else {
            return Err(LineError::Gone(self.address.clone()));
        };
        let mut buffer = [0; 4096];
        // A timeout of zero would mean no timeout.
        let got = stream
            .set_read_timeout(Some(within.max(Duration::from_millis(1))))
            .and_then(|()| stream.read(&mut buffer));
        match got {
            Ok(0) => Err(self.gone("the other side closed the connection")),
            Ok(n) => Ok(buffer[..n].to_vec()),
            Err(e) => Err(self.describe(&e)),
        }
    }

    fn reopen(&mut self) -> Result<(), LineError> {
        self.stream = None;
        let found = self.address.to_socket_addrs().map(|mut all| all.next());
        let connected = match found {
            Ok(Some(address)) => TcpStream::connect_timeout(&address, PATIENCE),
            Ok(None) => return Err(self.gone("host not found")),
            Err(e) => Err(e),
        };
        let ready = connected.and_then(|s| {
            s.set_nodelay(true)?;
            s.set_write_timeout(Some(PATIENCE))?;
            Ok(s)
        });
        match ready {
            Ok(stream) => {
                self.stream = Some(stream);
                Ok(())
            }
            Err(e) => Err(self.gone(e)),
        }
    }
}
