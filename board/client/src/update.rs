//! Another image over the line, and whether the board runs it.

use hysteron_core::firmware_update::{AuthenticationCode, WORD_BYTES, text};

use crate::board::Board;
use crate::error::{Error, Result};
use crate::image::FirmwareImage;

/// Bytes between two reports of the progress.
const REPORT_BYTES: usize = 16 * 1024;
/// How often a board is met again that installs an image, or restarts in its first second.
const MEETINGS: usize = 5;

/// How far it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpdateStage {
    /// The board makes room.
    Erasing,
    /// So many bytes of so many have been sent.
    Sent {
        /// Bytes so far.
        bytes: usize,
        /// All of them.
        of: usize,
    },
    /// The board compares the authentication code.
    Verifying,
    /// The board restarts and installs the image.
    Installing,
    /// The image runs, and is not yet healthy.
    Trial,
}

/// Where mistakes are.
fn wrong(message: impl std::fmt::Display) -> Error {
    Error::new("update", message)
}

/// How far an update is, in the board's word for it.
///
/// # Errors
/// The board does not answer.
pub fn state(board: &mut Board) -> Result<String> {
    answer(board).map(|(_, state)| state)
}

/// What `UPD?` answers: board and converters of the running image, and how far an update is.
fn answer(board: &mut Board) -> Result<(Option<[String; 2]>, String)> {
    let text = board.ask_until("UPD?", |answer| answer.contains("STATE="))?;
    let line = |key: &str| {
        text.lines()
            .find_map(|line| line.trim().strip_prefix(key).map(str::to_string))
    };
    let image = line("IMAGE=").and_then(|image| {
        let mut words = image.split_ascii_whitespace().map(str::to_string);
        Some([words.next()?, words.next()?])
    });
    Ok((
        image,
        line("STATE=")
            .ok_or_else(|| wrong(format!("the board answers `{}` to UPD?", text.trim())))?,
    ))
}

/// Waits for a state; what the board refuses is an error.
fn wait_for(board: &mut Board, wanted: &str) -> Result<()> {
    loop {
        let state = state(board)?;
        if state == wanted {
            return Ok(());
        }
        if let Some(reason) = state.strip_prefix("REFUSED ") {
            return Err(wrong(format!(
                "the board refuses the image: {reason}; the running image stays"
            )));
        }
        if !matches!(state.as_str(), "ERASING" | "VERIFYING") {
            return Err(wrong(format!(
                "the board is at {state} and not at {wanted}; the running image stays"
            )));
        }
        std::thread::sleep(crate::board::BETWEEN_QUESTIONS);
    }
}

/// Sees that the board can take this image now.
fn look(board: &mut Board, image: &FirmwareImage) -> Result<()> {
    let (running, state) = answer(board)?;
    if state == "UNSUPPORTED" {
        return Err(wrong(
            "this board has no room for a second image: flash it over the debug probe (`hysteron board flash IMAGE`)",
        ));
    }
    let wanted =
        [&image.header.board, &image.header.front_end].map(|field| text(field).to_string());
    if let Some(running) = running.filter(|running| *running != wanted) {
        return Err(wrong(format!(
            "the image is for {} with {}, the board is {} with {}",
            wanted[0], wanted[1], running[0], running[1]
        )));
    }
    if board.number("ARM? 1")? != 0.0 {
        return Err(wrong(
            "the amplifier is armed: bring it to rest and switch it off (ARM 1 0)",
        ));
    }
    Ok(())
}

/// Brings an image into the board's flash, with this authentication code. The running image goes on.
///
/// # Errors
/// The board cannot be updated, is in use, or refuses the image; nothing has changed then.
pub fn bring(
    board: &mut Board,
    image: &FirmwareImage,
    code: &AuthenticationCode,
    mut progress: impl FnMut(UpdateStage),
) -> Result<()> {
    look(board, image)?;
    progress(UpdateStage::Erasing);
    board.tell(&format!("UPD BEGIN {}", image.bytes.len()))?;
    wait_for(board, "RECEIVING 0")?;
    for (nth, part) in image.bytes.chunks(REPORT_BYTES).enumerate() {
        let lines: Vec<String> = part
            .chunks(WORD_BYTES)
            .enumerate()
            .map(|(word, bytes)| {
                let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
                format!(
                    "UPD DATA {} {digits}",
                    nth * REPORT_BYTES + word * WORD_BYTES
                )
            })
            .collect();
        board.tell_all(&lines)?;
        progress(UpdateStage::Sent {
            bytes: nth * REPORT_BYTES + part.len(),
            of: image.bytes.len(),
        });
    }
    progress(UpdateStage::Verifying);
    board.tell(&format!("UPD COMMIT {:032x}", u128::from_be_bytes(*code)))?;
    wait_for(board, "READY")
}

/// Restarts the board with the image that was brought, waits until it has been healthy for a second, and
/// returns what it answers to `*IDN?`. `baud` is the speed of the conversation.
///
/// # Errors
/// The image was not installed, or the board has put the previous one back.
pub fn install(
    board: &mut Board,
    baud: Option<u32>,
    mut progress: impl FnMut(UpdateStage),
) -> Result<String> {
    progress(UpdateStage::Installing);
    // A restart is not answered.
    board.send(b"RBT\n")?;
    let mut meetings = 1;
    // A flash that is slow to erase needs longer than a usual restart.
    while let Err(problem) = board.meet_again(baud) {
        if meetings == MEETINGS {
            return Err(problem);
        }
        meetings += 1;
    }
    loop {
        let state = match state(board) {
            Ok(state) => state,
            Err(problem) if meetings == MEETINGS => return Err(problem),
            // An image that is not healthy restarts.
            Err(_) => {
                meetings += 1;
                board.meet_again(baud)?;
                continue;
            }
        };
        match state.as_str() {
            "CONFIRMED" => return Ok(board.identification.clone()),
            "TRIAL" => progress(UpdateStage::Trial),
            "ROLLED_BACK" => {
                return Err(wrong(
                    "the image did not run for a healthy second: the board has put the previous one back",
                ));
            }
            "NOT_INSTALLED" => {
                return Err(wrong(
                    "the image was not installed: it has not its authentication code in flash; the previous one runs",
                ));
            }
            other => {
                return Err(wrong(format!(
                    "behind the restart the board is at {other}: it has not installed the image"
                )));
            }
        }
        std::thread::sleep(crate::board::BETWEEN_QUESTIONS);
    }
}
