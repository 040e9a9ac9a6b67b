//! Friction of the guide in presliding: an elastic bristle that slips at the break-away force.
//!
//! The contact is that of the stick-slip actuator ([`crate::elastoplastic_friction`]) with all forces as
//! force-equivalent displacements (force divided by the stiffness of the actuator): the bristle holds back
//! `bristle_stiffness` per micrometre of its bend and no more than `break_away_um`. `breakaway_ratio` is
//! `z_b / z_s` of the law; at zero, where it stands unless a model file says otherwise, the bristle slips
//! from the first motion on (Dahl's law). The mechanism rests where the piezo force balances spring and
//! bristle. Where the model has inertia, the vibration stage takes the bristle in: it then holds the moving
//! mass, and a small motion inside the presliding range sees it as an additional spring.

use crate::balance_law::ForceLines;
use crate::block::Block;
use crate::elastoplastic_friction::{
    BALANCING_STEPS_MAX, Dahl, ElastoplasticFriction, LAST_STEP_OF_SLIDING_BEND, SLIDES_WITHIN,
};
use crate::law::{Law, deeper};
use crate::physics::*;
use std::f64::consts::PI;

/// Identifier in files and on the command line.
pub const ID: &str = "friction";

/// Elastic-plastic friction element between the piezo force and the structure.
pub struct Friction;

/// The bristle between guide and stage.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bristle {
    /// The contact, forces as the displacements that they make at rest: stiffness in units of the actuator's,
    /// Coulomb force in um.
    contact: ElastoplasticFriction,
    /// Its law, where it has no elastic range.
    dahl: Option<Dahl>,
    /// Bend in steady sliding, um.
    sliding_bend: f64,
    displacement: f64,
    bend: f64,
}

impl Bristle {
    /// The bristle of `model`, if it has one.
    pub(super) fn from_model(model: &Model) -> Option<Self> {
        let values = model.values(ID)?;
        let value = |k: usize| values.get(k).copied().unwrap_or(0.0);
        let breakaway_ratio = (value(2) > 0.0).then_some(value(2));
        let contact = ElastoplasticFriction {
            stiffness_n_um: value(1).max(f64::MIN_POSITIVE),
            damping_n_s_um: 0.0,
            coulomb_force_n: value(0).max(0.0),
            breakaway_ratio,
        };
        Some(Self::with(contact))
    }

    pub(super) fn with(contact: ElastoplasticFriction) -> Self {
        let sliding_bend = contact.sliding_bend_um();
        let dahl = contact
            .breakaway_ratio
            .is_none()
            .then(|| Dahl::with_sliding_bend(sliding_bend));
        Self {
            contact,
            dahl,
            sliding_bend,
            displacement: 0.0,
            bend: 0.0,
        }
    }

    /// Factor by which a stuck bristle raises the natural frequency.
    pub(super) fn stiffening(&self) -> f64 {
        (1.0 + self.contact.stiffness_n_um).sqrt()
    }

    /// Its bend, for those who carry it themselves for a while, um.
    pub(super) fn bend(&self) -> f64 {
        self.bend
    }

    /// Puts it where it has come to.
    pub(super) fn put(&mut self, displacement: f64, bend: f64) {
        (self.displacement, self.bend) = (displacement, bend);
    }

    /// Whether motion in this direction bends it no further: it then holds back its Coulomb force and acts as
    /// no spring.
    #[inline]
    pub(super) fn slides(&self, bend: f64, direction: f64) -> bool {
        (self.sliding_bend - bend * direction.signum()).abs() <= SLIDES_WITHIN * self.sliding_bend
    }

    /// Its bend where it slides in this direction.
    #[inline]
    pub(super) fn bend_in_sliding(&self, direction: f64) -> f64 {
        self.sliding_bend.copysign(direction)
    }

    /// What it holds back at this bend.
    #[inline]
    pub(super) fn held_at(&self, bend: f64) -> f64 {
        self.contact.force_n(bend, 0.0)
    }

    /// Its bend after a motion from this one.
    #[inline]
    pub(super) fn bend_after(&self, bend: f64, motion: f64) -> f64 {
        match &self.dahl {
            Some(dahl) => dahl.bend_after(bend, motion),
            None => self.contact.bend_after(bend, motion),
        }
    }

    /// Its stiffness, in units of the actuator's.
    pub(super) fn stiffness(&self) -> f64 {
        self.contact.stiffness_n_um
    }

    /// What makes it, for those who compare: stiffness, Coulomb force, elastic range.
    pub(super) fn values(&self) -> [f64; 3] {
        [
            self.contact.stiffness_n_um,
            self.contact.coulomb_force_n,
            self.contact.breakaway_ratio.unwrap_or(0.0),
        ]
    }

    /// Rest position for a force, without any inertia.
    #[inline]
    pub(super) fn balance(&mut self, force: f64) -> f64 {
        let unbalanced = force - self.displacement - self.held_at(self.bend);
        if unbalanced.abs() < BALANCED_UM {
            return self.displacement;
        }
        let (motion, bend) = match &self.dahl {
            Some(dahl) => dahl.balanced(self.contact.stiffness_n_um, self.bend, unbalanced),
            None => self.balanced(unbalanced),
        };
        self.displacement += motion;
        self.bend = bend;
        self.displacement
    }

    /// Motion that takes up an imbalance, and the bend after it, where the contact has an elastic range.
    fn balanced(&self, unbalanced: f64) -> (f64, f64) {
        let stiffness = self.contact.stiffness_n_um;
        // x + z(x) = force. The bristle holds back no more than one that goes on bending as it does now, and
        // no more than the Coulomb force: both solutions are short of the true one. Since the bristle only
        // stiffens less and less, Newton's steps from the longer one stay on its side.
        let slides = self.contact.coulomb_force_n > 0.0;
        let elastic_share = |bend: f64| {
            if slides {
                self.contact.elastic_share(bend, unbalanced).0
            } else {
                0.0
            }
        };
        let force = unbalanced + self.held_at(self.bend);
        let bending = unbalanced / (1.0 + stiffness * elastic_share(self.bend));
        let sliding = force - self.contact.coulomb_force_n.copysign(unbalanced);
        let mut motion = if sliding * unbalanced > 0.0 && sliding.abs() > bending.abs() {
            sliding
        } else {
            bending
        };
        let mut bend = self.bend;
        for _ in 0..BALANCING_STEPS_MAX {
            bend = self.bend_after(self.bend, motion);
            let share = elastic_share(bend);
            let further = (force - motion - stiffness * bend) / (1.0 + stiffness * share);
            motion += further;
            // So short a way is straight.
            bend += share * further;
            if further.abs() < LAST_STEP_UM {
                break;
            }
        }
        (motion, bend)
    }

    /// [`Self::bend_after`] as [`crate::law`] writes: from a bend after a motion to another.
    pub(super) fn bend_in_lines(&self, bend: &str, motion: &str, to: &str) -> String {
        let slides = self.sliding_bend;
        if slides <= 0.0 {
            return format!("{to} = 0\n");
        }
        let Some(ratio) = self.contact.breakaway_ratio else {
            return format!(
                "towards = {slides:e}
if {motion} < 0
  towards = -towards
{to} = towards + ({bend} - towards) * exp(-abs({motion}) / {slides:e})
"
            );
        };
        let breaks = ratio.clamp(0.0, 1.0) * slides;
        let width = slides - breaks;
        let (reach, least) = (20.0 * slides, 0.05 * width);
        let plastic = if width > 1e-9 * slides {
            let [here, midway] =
                ["bent", "halfway"].map(|at| deeper(&self.elastic_share_in_lines(at), 1));
            format!(
                "gone = 0
longer = min(longer, {reach:e})
while gone < longer && bent < {slides:e}
  part = min({least:e} + 0.1 * gone, longer - gone)
{here}  halfway = bent + 0.5 * part * elastic
{midway}  bent = bent + part * elastic
  gone = gone + part
"
            )
        } else {
            String::new()
        };
        format!(
            "side = 1
if {motion} < 0
  side = -1
bent = {bend} * side
longer = abs({motion})
if bent < {breaks:e}
  elastic = min(longer, {breaks:e} - bent)
  bent = bent + elastic
  longer = longer - elastic
{plastic}{to} = side * min(bent, {slides:e})
"
        )
    }

    /// The share of a motion in the direction of a bend that is elastic, where the contact has an elastic range.
    fn elastic_share_in_lines(&self, bend: &str) -> String {
        let slides = self.sliding_bend;
        let breaks = self.contact.breakaway_ratio.unwrap_or(0.0) * slides;
        let width = slides - breaks;
        format!(
            "plastic = min(max(({bend} - {breaks:e}) / {width:e}, 0), 1)
elastic = 1 - (0.5 - 0.5 * cos({PI:e} * plastic)) * {bend} / {slides:e}
"
        )
    }

    /// [`Self::balance`] as [`crate::law`] writes, of the states `stands` and `bend`.
    pub(super) fn balance_in_lines(&self) -> String {
        let stiffness = self.contact.stiffness_n_um;
        let moves = if self.dahl.is_some() || self.sliding_bend <= 0.0 {
            self.moves_after_dahl()
        } else {
            self.moves_with_elastic_range()
        };
        format!(
            "lacks = x - stands - {stiffness:e} * bend
if abs(lacks) >= {BALANCED_UM:e}
  turned = 1
  if lacks < 0
    turned = -1
{}",
            deeper(&moves, 1)
        )
    }

    /// [`Dahl::balanced`] in lines.
    fn moves_after_dahl(&self) -> String {
        let (stiffness, slides) = (self.contact.stiffness_n_um, self.sliding_bend);
        let as_good_as_sliding = SLIDES_WITHIN * slides;
        let last = LAST_STEP_OF_SLIDING_BEND * slides;
        format!(
            "imbalance = abs(lacks)
room = {slides:e} - turned * bend
most = {stiffness:e} * room
if room <= {as_good_as_sliding:e} && imbalance > most
  stands = stands + turned * max(imbalance - most, 0)
  bend = turned * {slides:e}
else
  stiff = most / {slides:e}
  way = imbalance / (1 + stiff)
  way = way * (1 + 0.5 * way / {slides:e} * stiff / (1 + stiff))
  way = max(min(way, imbalance), imbalance - most)
  remains = 1
  trial = 0
  while trial < {BALANCING_STEPS_MAX}
    remains = exp(-way / {slides:e})
    slope = stiff * remains
    further = (imbalance - way - most * (1 - remains)) / (1 + slope)
    further = further * (1 + 0.5 * further * slope / {slides:e} / (1 + slope))
    way = way + further
    shorter = further / {slides:e}
    remains = remains * (1 - shorter * (1 - 0.5 * shorter))
    trial = trial + 1
    if abs(further) < {last:e}
      trial = {BALANCING_STEPS_MAX}
  stands = stands + turned * way
  bend = turned * ({slides:e} - room * remains)
"
        )
    }

    /// [`Self::balanced`] in lines.
    fn moves_with_elastic_range(&self) -> String {
        let stiffness = self.contact.stiffness_n_um;
        let coulomb = self.contact.coulomb_force_n;
        let share = self.elastic_share_in_lines("along");
        let again = deeper(&share, 1);
        let bends = deeper(&self.bend_in_lines("bend", "way", "after"), 1);
        format!(
            "along = turned * bend
{share}wanted = lacks + {stiffness:e} * bend
way = lacks / (1 + {stiffness:e} * elastic)
sliding = wanted - turned * {coulomb:e}
if sliding * lacks > 0 && abs(sliding) > abs(way)
  way = sliding
trial = 0
while trial < {BALANCING_STEPS_MAX}
{bends}  along = turned * after
{again}  further = (wanted - way - {stiffness:e} * after) / (1 + {stiffness:e} * elastic)
  way = way + further
  after = after + elastic * further
  trial = trial + 1
  if abs(further) < {LAST_STEP_UM:e}
    trial = {BALANCING_STEPS_MAX}
stands = stands + way
bend = after
"
        )
    }

    /// Relaxed at a displacement.
    pub(super) fn relax(&mut self, displacement: f64) {
        self.displacement = displacement;
        self.bend = 0.0;
    }
}

/// Beside other forces of the moving mass; its memory is its bend.
impl RestoringForce for Bristle {
    fn held(&self, memory: f64, way: Travel) -> (f64, f64) {
        let bend = self.bend_after(memory, way.to_um - way.from_um);
        (self.held_at(bend), bend)
    }
    fn at_rest(&self, _at_um: f64) -> (f64, f64) {
        (0.0, 0.0)
    }
    fn stiffening(&self, _memory: f64, _swing_um: f64) -> f64 {
        self.contact.stiffness_n_um
    }
    fn lines(&self) -> ForceLines {
        let stiffness = self.contact.stiffness_n_um;
        let bends = self.bend_in_lines("memory", "(place - came)", "kept");
        ForceLines {
            held: format!("{bends}given = {stiffness:e} * kept\n"),
            at_rest: "given = 0\nkept = 0\n".into(),
            stiffening: format!("stiff = stiff + {stiffness:e}\n"),
            remembers: true,
        }
    }
}

/// Imbalance, in um, below which nothing moves: a millionth of what any sensor sees.
const BALANCED_UM: f64 = 1e-9;
/// A step of Newton's, in um, behind which as good as nothing is left: the error is half its square over the
/// sliding bend, less than [`BALANCED_UM`] from a bend of half a nanometre on.
const LAST_STEP_UM: f64 = 1e-6;

struct FrictionStage {
    bristle: Bristle,
}

impl Stage for FrictionStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.bristle.balance(input)
    }
    fn run(&mut self, _from: usize, signal: &mut [f64]) {
        // A copy stays in registers.
        let mut bristle = self.bristle;
        signal
            .iter_mut()
            .for_each(|value| *value = bristle.balance(*value));
        self.bristle = bristle;
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.bristle.relax(input);
        input
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let step = format!("{}y = stands\n", self.bristle.balance_in_lines());
        let law = Law::of(&step).state("stands", None).state("bend", None);
        Ok(vec![Block::Mass(law.begins("stands = x\nbend = 0\n"))])
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Effect for Friction {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Dry friction in the guide holds the stage at every reversal until the force breaks it away.".into(),
            reference: "thesis Ch. 3, Eqs. 1-6 (presliding); Dupont et al., IEEE Trans. Autom. Control 47 (2002)".into(),
            modifies: Some(id::VIBRATION),
            experiment: "small slow triangles around several positions: plateaus behind each reversal".into(),
            one_sided: true,
            costly: true,
            picture: Picture {
                against: Against::TimeSinceTurn,
                caption: "Friction holds the motion back just after the drive turns, then lets go.",
            },
            planted: Planted::InPairs,
            equations: r"A bristle of bend `z` holds the stage: `s = bristle_stiffness`, `S = break_away_um / s` the bend in steady sliding. While the stage moves, `dz = (1 - a(z) z sign(v) / S) dy` with `a = 1` (Dahl), or, with
`breakaway_ratio = r > 0`, the elastic-plastic `a` of Dupont: 0 below `r S`, 1 above `S`, `(1 - cos(pi (|z| - r S) / (S - r S))) / 2` between, and 0 where `z` and the motion have different signs.

Without `vibration` the stage rests where `y + s z = x`: the output is the solution of it, from the last one on. With `vibration` the bristle holds the moving mass, `m y'' + d y' + y + s z = x`, by a step
that is divided where the mass sticks and slides.",
            ..Declaration::at(Place::Friction)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![
            Parameter::linear(
                "break_away_um",
                "um",
                0.0,
                0.5 * overview.range_um,
                1e-4 * overview.range_um.max(1e-6),
            ),
            Parameter::logarithmic("bristle_stiffness", "1", 1e-2, 50.0),
            Parameter::linear("breakaway_ratio", "1", 0.0, 0.99, 0.01).fixed(),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let mut out = Vec::new();
        for share in [0.002, 0.01] {
            for stiffness in [0.3, 1.0, 4.0, 12.0] {
                out.push(vec![share * overview.range_um, stiffness, 0.0]);
            }
        }
        out
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        // With inertia in the model the bristle acts on the moving mass, not on the force in front of it.
        if from.model.effect(id::VIBRATION).is_some() {
            return None;
        }
        Bristle::from_model(from.model)
            .map(|bristle| Box::new(FrictionStage { bristle }) as Box<dyn Stage + 'a>)
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.03 * case.strength, case.about(1.0)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The chain's bristle and the stick-slip actuator's contact are one law: the bend after slow motion is
    /// the integral of the rate.
    #[test]
    fn the_bristle_is_the_contact_of_the_stick_slip_actuator() {
        for breakaway_ratio in [None, Some(0.6)] {
            let contact = ElastoplasticFriction {
                stiffness_n_um: 2.0,
                damping_n_s_um: 0.0,
                coulomb_force_n: 0.1,
                breakaway_ratio,
            };
            let mut bristle = Bristle::with(contact);
            let (mut displacement, mut bend, step_um) = (0.0, 0.0, 1e-5);
            for (direction, travel_um) in [(1.0, 0.04), (-1.0, 0.11), (1.0, 0.3), (-1.0, 0.02)] {
                for _ in 0..(travel_um / step_um) as usize {
                    displacement += direction * step_um;
                    bend += step_um * contact.bend_rate(bend, direction);
                }
                bristle.put(
                    displacement,
                    bristle.bend_after(bristle.bend, displacement - bristle.displacement),
                );
                let held = bristle.held_at(bristle.bend);
                assert!(
                    (held - 2.0 * bend).abs() < 1e-4,
                    "{breakaway_ratio:?}: {held} {}",
                    2.0 * bend
                );
            }
        }
    }

    #[test]
    fn at_rest_the_force_is_shared_by_spring_and_bristle() {
        for breakaway_ratio in [None, Some(0.6)] {
            let contact = ElastoplasticFriction {
                stiffness_n_um: 3.0,
                damping_n_s_um: 0.0,
                coulomb_force_n: 0.1,
                breakaway_ratio,
            };
            let mut bristle = Bristle::with(contact);
            for force in [0.02, 0.5, 1.4, 1.3, 1.1, 0.2, 0.25, 3.0] {
                let displacement = bristle.balance(force);
                let held = contact.force_n(bristle.bend, 0.0);
                assert!(
                    (displacement + held - force).abs() < 1e-6,
                    "{breakaway_ratio:?}, {force}: {displacement} + {held}"
                );
                assert!(held.abs() <= 0.1 + 1e-9);
            }
        }
    }
}
