//! All modes of a stage, with the actuators between them.
//!
//! An actuator is an element between structure and ground. By reciprocity its extension is
//! `e_j = sum_r compliance_r of_drives_rj q_r`: the vector by which its force acts on the modes. Beside its
//! drive it has Maxwell-slip elements over that extension (M. Goldfarb and N. Celanovic, IEEE Control
//! Systems 17(3), 69-79, 1997), springs that slip at a threshold:
//!
//! ```text
//! s_k = clamp(s_k + change of e_j, -threshold_k, threshold_k)
//! force_j = w_j - sum_k stiffness_k s_k - softening_j
//! ```
//!
//! and it softens while it moves, by the RMS of its extension over the last [`RELAXES_S`]:
//!
//! ```text
//! softening_j = stiffness (half_at / (RMS + half_at) - 1 / 2) e_j
//! ```
//!
//! Maxwell-slip elements only store and lose energy where stiffness and compliance are not negative. Softening
//! cannot take more than the stiffness of the structure within [`ModalStage::softening_most`].

use super::drive_path::{ActuatorSoftening, Held};
use super::modal_motion::{CORRECTIONS, ModalMotion, steps_needed};
use super::modal_stage::ModalStage;

/// Steps in a period in which the force of an actuator runs straight: at a tenth of the sampling rate it then
/// errs by 1 %.
const STEPS_OF_ACTUATORS: usize = 2;

/// Time over which an actuator forgets that it moved. On the fine steering mirror anything from 0.3 s on does as
/// well, and less does worse.
const RELAXES_S: f64 = 0.3;

/// A Maxwell-slip element that is stepped.
#[derive(Clone, Copy, Debug)]
struct Slip {
    threshold: f64,
    stiffness: f64,
    stretch: f64,
}

/// The memory of an actuator that is stepped.
#[derive(Clone, Debug)]
struct ActuatorMemory {
    /// What its force gives each mode.
    acts: Vec<f64>,
    /// What each mode extends it by.
    extends: Vec<f64>,
    slips: Vec<Slip>,
    softening: Option<ActuatorSoftening>,
    extension: f64,
    /// Mean square of the extension, and what a step leaves of it.
    square: f64,
    square_stays: f64,
}

impl Slip {
    fn stretch_after(&self, change: f64) -> f64 {
        (self.stretch + change).clamp(-self.threshold, self.threshold)
    }
}

impl ActuatorMemory {
    fn extension(&self, modes: &[ModalMotion], position: fn(&ModalMotion) -> f64) -> f64 {
        let of_mode = |(share, mode): (&f64, &ModalMotion)| share * position(mode);
        self.extends.iter().zip(modes).map(of_mode).sum()
    }

    fn force(&self, extension: f64) -> f64 {
        let change = extension - self.extension;
        let of_slip = |slip: &Slip| slip.stiffness * slip.stretch_after(change);
        let of_slips: f64 = self.slips.iter().map(of_slip).sum();
        self.softening.map_or(of_slips, |softening| {
            let stays = softening.half_at / (self.square.sqrt() + softening.half_at);
            of_slips + softening.stiffness * (stays - 0.5) * extension
        })
    }

    fn move_to(&mut self, extension: f64) {
        let change = extension - self.extension;
        for slip in &mut self.slips {
            slip.stretch = slip.stretch_after(change);
        }
        self.extension = extension;
        self.square += (1.0 - self.square_stays) * (extension * extension - self.square);
    }
}

/// Modes of a stage that are stepped together.
#[derive(Clone, Debug)]
pub(super) struct StageMotion {
    modes: Vec<ModalMotion>,
    actuators: Vec<ActuatorMemory>,
}

impl StageMotion {
    /// At rest: the modes with these numbers, all of them where an actuator couples them.
    pub(super) fn new(stage: &ModalStage, numbers: &[usize], dt_s: f64) -> Self {
        let modes = || numbers.iter().map(|r| &stage.modes[*r]);
        let remembering = (0..stage.drives.len()).filter(|j| stage.drives[*j].has_memory());
        let together = modes()
            .map(|mode| steps_needed(mode, dt_s))
            .fold(STEPS_OF_ACTUATORS, usize::max);
        let actuators: Vec<ActuatorMemory> = remembering
            .map(|j| ActuatorMemory {
                acts: modes().map(|mode| mode.of_drives[j]).collect(),
                extends: modes()
                    .map(|mode| mode.compliance * mode.of_drives[j])
                    .collect(),
                slips: stage.drives[j]
                    .slips
                    .iter()
                    .map(|[threshold, stiffness]| Slip {
                        threshold: *threshold,
                        stiffness: *stiffness,
                        stretch: 0.0,
                    })
                    .collect(),
                softening: stage.drives[j].softening,
                extension: 0.0,
                square: 0.0,
                square_stays: (-dt_s / together as f64 / RELAXES_S).exp(),
            })
            .collect();
        let switching = stage.switching(dt_s);
        let motion = |mode| {
            if actuators.is_empty() {
                ModalMotion::new(mode, &switching, dt_s)
            } else {
                ModalMotion::with_steps(mode, &switching, dt_s, together)
            }
        };
        Self {
            modes: modes().map(motion).collect(),
            actuators,
        }
    }

    /// Comes to rest under what the drives give now; friction and actuators are unloaded there.
    pub(super) fn settle(&mut self, drives: &[Held]) {
        self.modes.iter_mut().for_each(|mode| mode.settle(drives));
        for actuator in &mut self.actuators {
            actuator.extension = actuator.extension(&self.modes, ModalMotion::position);
        }
    }

    /// The coordinates now.
    pub(super) fn positions(&self) -> impl Iterator<Item = f64> {
        self.modes.iter().map(ModalMotion::position)
    }

    /// Goes on by a period.
    pub(super) fn step(&mut self, drives: &[Held]) {
        if self.actuators.is_empty() {
            self.modes.iter_mut().for_each(|mode| mode.step(drives));
            return;
        }
        let steps = self.modes.first().map_or(0, ModalMotion::steps);
        for step in 0..steps {
            self.modes
                .iter_mut()
                .for_each(|mode| mode.begin(step, drives));
            for _ in 0..CORRECTIONS {
                self.modes.iter_mut().for_each(ModalMotion::correct);
                for actuator in &self.actuators {
                    let extension = actuator.extension(&self.modes, ModalMotion::end_position);
                    let force = actuator.force(extension);
                    for (mode, share) in self.modes.iter_mut().zip(&actuator.acts) {
                        mode.correct_by(-share * force);
                    }
                }
            }
            self.modes.iter_mut().for_each(ModalMotion::finish);
            for actuator in &mut self.actuators {
                let extension = actuator.extension(&self.modes, ModalMotion::position);
                actuator.move_to(extension);
                let force = actuator.force(extension);
                for (mode, share) in self.modes.iter_mut().zip(&actuator.acts) {
                    mode.load_by(-share * force);
                }
            }
        }
    }
}
