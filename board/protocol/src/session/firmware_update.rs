//! Another image over the line: `UPD`.

use hysteron_core::command_text::BlockPiece;
use hysteron_core::firmware_update::{AuthenticationCode, text};

use super::{Pending, Session, Step};
use crate::device::{Device, UpdateRefusal, UpdateState};
use crate::error_code::ErrorCode;
use crate::words::Words;

/// A step of an update that waits for the flash.
#[derive(Clone, Copy, Debug)]
pub(super) enum UpdateStep {
    Take(BlockPiece),
    Commit(AuthenticationCode),
}

impl From<UpdateRefusal> for ErrorCode {
    fn from(refusal: UpdateRefusal) -> Self {
        match refusal {
            UpdateRefusal::Unsupported => Self::NoUpdate,
            UpdateRefusal::NotDisarmed | UpdateRefusal::Busy => Self::InMotion,
            UpdateRefusal::NoImage => Self::InvalidBlock,
        }
    }
}

impl<D: Device + 'static> Session<D> {
    /// `BEGIN <bytes>`, `DATA <offset> <hexadecimal>` in order, `COMMIT <authentication code>`.
    pub(super) fn bring_image(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        match words.word()? {
            "BEGIN" | "begin" => {
                let bytes = words.whole()?;
                words.end()?;
                Ok(self.device.begin_update(bytes)?)
            }
            "DATA" | "data" => {
                let offset = words.whole()?;
                let piece =
                    BlockPiece::parse(offset, words.word()?).map_err(|_| ErrorCode::Syntax)?;
                words.end()?;
                self.pending = Pending::Update(UpdateStep::Take(piece));
                Ok(())
            }
            "COMMIT" | "commit" => {
                let code = BlockPiece::parse(0, words.word()?).map_err(|_| ErrorCode::Syntax)?;
                words.end()?;
                let code = code.bytes().try_into().map_err(|_| ErrorCode::Syntax)?;
                self.pending = Pending::Update(UpdateStep::Commit(code));
                Ok(())
            }
            _ => Err(ErrorCode::Syntax),
        }
    }

    /// A step that waits until the flash is idle. Every wait of the flash has an end.
    pub(super) fn next_of_update(&mut self, step: UpdateStep) -> Step {
        let taken = match &step {
            UpdateStep::Take(piece) => self.device.take_update(piece),
            UpdateStep::Commit(code) => self.device.commit_update(code),
        };
        match taken {
            Ok(true) => Step::Done,
            Ok(false) => {
                self.pending = Pending::Update(step);
                Step::Work
            }
            Err(refusal) => {
                self.error = ErrorCode::from(refusal) as u16;
                Step::Done
            }
        }
    }

    /// What the running image is, and how far an update is.
    pub(super) fn update(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        words.end()?;
        if let Some(image) = self.device.image() {
            let (board, front_end, version) = (
                text(&image.board),
                text(&image.front_end),
                text(&image.version),
            );
            self.say(format_args!(
                "IMAGE={board} {front_end} {} {version}",
                image.sample_rate_hz
            ))?;
        }
        match self.device.update() {
            UpdateState::Unsupported => self.say(format_args!("STATE=UNSUPPORTED")),
            UpdateState::Nothing => self.say(format_args!("STATE=NOTHING")),
            UpdateState::Erasing => self.say(format_args!("STATE=ERASING")),
            UpdateState::Receiving { stored } => self.say(format_args!("STATE=RECEIVING {stored}")),
            UpdateState::Verifying => self.say(format_args!("STATE=VERIFYING")),
            UpdateState::Ready => self.say(format_args!("STATE=READY")),
            UpdateState::Refused(reason) => self.say(format_args!("STATE=REFUSED {reason}")),
            UpdateState::Trial => self.say(format_args!("STATE=TRIAL")),
            UpdateState::Confirmed => self.say(format_args!("STATE=CONFIRMED")),
            UpdateState::NotInstalled => self.say(format_args!("STATE=NOT_INSTALLED")),
            UpdateState::RolledBack => self.say(format_args!("STATE=ROLLED_BACK")),
        }
    }
}
