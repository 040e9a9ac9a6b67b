//! The bytes' way to the board: a serial port of this machine, or a socket.

use std::fmt;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use crate::error::{Error, Result};

/// The line's speed after a start of the board, bit/s.
pub const USUAL_BAUD: u32 = 115_200;
/// Longest wait for a byte before the program looks at other things.
const WAIT: Duration = Duration::from_millis(100);

/// Where the board is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// A serial port by its name, `/dev/ttyACM0` or `COM3`.
    Serial(String),
    /// `HOST:PORT`: an emulated board, or a serial port behind a bridge.
    Tcp(String),
}

impl Address {
    /// A socket's, by its words.
    ///
    /// # Errors
    /// They are not `HOST:PORT`.
    pub fn tcp(name: &str) -> Result<Self> {
        let is_socket = name
            .rsplit_once(':')
            .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
        if is_socket {
            Ok(Self::Tcp(name.into()))
        } else {
            Err(Error::new(
                name,
                "is no address; expected HOST:PORT, as 127.0.0.1:50000",
            ))
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(name) | Self::Tcp(name) => f.write_str(name),
        }
    }
}

/// An open port.
pub enum Port {
    /// A serial port.
    Serial(Box<dyn serialport::SerialPort>),
    /// A socket.
    Tcp(TcpStream),
}

impl Port {
    /// Opens it.
    ///
    /// # Errors
    /// The port does not exist, or another program has it.
    pub fn open(address: &Address) -> Result<Self> {
        match address {
            Address::Serial(name) => {
                let port = serialport::new(name, USUAL_BAUD).timeout(WAIT).open();
                port.map(Self::Serial).map_err(|problem| {
                    Error::new(
                        name,
                        format!("cannot be opened as a serial port: {problem}"),
                    )
                })
            }
            Address::Tcp(name) => {
                let no_address = |problem: std::io::Error| {
                    Error::new(name, format!("is no address HOST:PORT: {problem}"))
                };
                let mut addresses = name.to_socket_addrs().map_err(no_address)?;
                let address = addresses
                    .next()
                    .ok_or_else(|| Error::new(name, "is no address HOST:PORT"))?;
                let refused = |problem: std::io::Error| {
                    Error::new(name, format!("nobody answers there: {problem}"))
                };
                let stream = TcpStream::connect_timeout(&address, Duration::from_secs(10))
                    .map_err(refused)?;
                let prepared = stream
                    .set_nodelay(true)
                    .and_then(|()| stream.set_read_timeout(Some(WAIT)));
                prepared.map(|()| Self::Tcp(stream)).map_err(refused)
            }
        }
    }

    /// Changes the speed of this end; a socket has none.
    ///
    /// # Errors
    /// The port does not have this speed.
    pub fn set_baud(&mut self, baud: u32) -> Result<()> {
        match self {
            Self::Serial(port) => port
                .set_baud_rate(baud)
                .map_err(|problem| Error::new("serial port", format!("{baud} bit/s: {problem}"))),
            Self::Tcp(_) => Ok(()),
        }
    }

    /// Sends all of it.
    ///
    /// # Errors
    /// The other side has gone.
    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        let sent = match self {
            Self::Serial(port) => port.write_all(bytes),
            Self::Tcp(stream) => stream.write_all(bytes),
        };
        sent.map_err(|problem| Error::new("board", format!("the connection has ended: {problem}")))
    }

    /// A second handle of the same port.
    ///
    /// # Errors
    /// The system gives none.
    pub fn second(&self) -> Result<Self> {
        let failed = |problem: &dyn fmt::Display| {
            Error::new("board", format!("no second handle of its port: {problem}"))
        };
        match self {
            Self::Serial(port) => port
                .try_clone()
                .map(Self::Serial)
                .map_err(|problem| failed(&problem)),
            Self::Tcp(stream) => stream
                .try_clone()
                .map(Self::Tcp)
                .map_err(|problem| failed(&problem)),
        }
    }

    /// What has come, within a tenth of a second; nothing where nothing has.
    ///
    /// # Errors
    /// The other side has gone.
    pub fn receive(&mut self) -> Result<Vec<u8>> {
        let mut bytes = vec![0; 4096];
        let received = match self {
            Self::Serial(port) => port.read(&mut bytes),
            Self::Tcp(stream) => stream.read(&mut bytes),
        };
        match received {
            Ok(0) if matches!(self, Self::Tcp(_)) => {
                Err(Error::new("board", "the connection has ended"))
            }
            Ok(count) => {
                bytes.truncate(count);
                Ok(bytes)
            }
            Err(problem)
                if matches!(
                    problem.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                Ok(Vec::new())
            }
            Err(problem) => Err(Error::new(
                "board",
                format!("the connection has ended: {problem}"),
            )),
        }
    }
}
