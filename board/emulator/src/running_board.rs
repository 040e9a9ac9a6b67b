//! A board that runs: the image on the emulated part, in front of whatever stage, with its serial port on a
//! socket.

use std::io::{BufWriter, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;

use crate::board::NucleoBoard;
use crate::converters::{Witness, World};
use crate::live_run::run_live;
use crate::run::{envelope_bytes, envelope_of, stick_slip_envelope};
use crate::serial_line::SharedLine;

use crate::serial_socket;

/// Lines of the true motion that are written at once.
const LINES_AT_ONCE: u32 = 1000;

/// Writes the true motion as lines of text: at every edge of the sample clock the codes of sensor and drive
/// and the position, um.
///
/// # Errors
/// The file cannot be written.
pub fn witness(path: &Path) -> Result<Witness, String> {
    let file =
        std::fs::File::create(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut file = BufWriter::new(file);
    let named = path.display().to_string();
    writeln!(file, "sensor_code,drive_code,position_um")
        .map_err(|error| format!("{named}: {error}"))?;
    let (mut lines, mut failed) = (0, false);
    Ok(Box::new(move |sensor, drive, position_um| {
        lines += 1;
        let mut written = writeln!(file, "{sensor},{drive},{position_um:.7}");
        if lines % LINES_AT_ONCE == 0 {
            // The process ends by being interrupted; whole bunches are there then.
            written = written.and_then(|()| file.flush());
        }
        if let (Err(error), false) = (written, failed) {
            failed = true;
            eprintln!("hysteron board: {named}: {error}; the true motion is not written any more");
        }
    }))
}

/// Runs the image until the process is interrupted, and says first, on a line of its own, where its serial
/// port is. `block` is in the flash at the start, and the safety envelope of the bench.
///
/// # Errors
/// The address cannot be listened at, or the image does not run.
pub fn serve_board(
    mut world: World,
    image: &Path,
    block: Option<&[u8]>,
    address: SocketAddr,
) -> Result<(), String> {
    world.keeps_codes = false;
    let listener = TcpListener::bind(address).map_err(|error| format!("{address}: {error}"))?;
    let address = listener.local_addr().map_err(|error| error.to_string())?;
    println!("the serial port is {address}");
    let _ = std::io::stdout().flush();

    let line = SharedLine::default();
    serial_socket::serve(listener, &line);
    let envelope = envelope_bytes(&if world.encoder {
        stick_slip_envelope(world.scale())
    } else {
        envelope_of(world.scale())
    });
    let world = world.shared();
    let board = NucleoBoard::with_plant(&world).map_err(|error| error.to_string())?;
    run_live(
        image,
        board,
        block,
        Some(&envelope),
        &line,
        |level, text| {
            // The running trace is for programs that decode it.
            if !text.starts_with("trace [") {
                println!("{level:>5} {text}");
                let _ = std::io::stdout().flush();
            }
        },
    )
    .map_err(|error| format!("{error:#}"))
}
