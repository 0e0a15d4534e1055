//! Follows what friction becomes while the machine runs.
use bytemuck::{Pod, Zeroable};
use nalgebra::SVector;

use crate::inverse_dynamics::Belief;
use crate::maxwell_slip::Level;

mod load;
mod lost_motion;
mod normal;

pub use load::{Load, LoadState};
pub use lost_motion::{LostMotion, LostMotionState};
use normal::Normal;

/// What the torque that the model lacks is explained by: friction, the part of it that turns round late, speed, acceleration,
/// a constant force.
const CAUSES: usize = 5;
/// Of them those that the model's friction makes.
const FRICTION: usize = 2;
/// What is believed from stroke to stroke: those, and the constant force.
const BELIEVED: usize = 3;
/// Bandwidth of the filter before everything that is compared, in rad/s: beyond it a torque is not told from noise.
const FILTER_RAD_S: f64 = 500.0;
/// So long after a reversal, in s, nothing is looked at: the gap is being crossed, and the filter still sees it.
const CROSSING_S: f64 = 0.012;
/// So long after something that swings the loop nothing is looked at, in s: ten integral times of 10 ms.
const SETTLE_S: f64 = 0.1;
/// Distance from the reversal beyond which a scan counts by half, in mm: what matters happens near it.
const NEAR_MM: f64 = 3.0;
/// Scans of a stroke, at full weight, below which it teaches nothing, in s.
const STROKE_S_MIN: f64 = 0.02;
/// Part of what is known that a stroke leaves.
const FORGETTING: f64 = 0.9;
/// Strokes that must have taught something for what they say to count in full.
const TRUSTED_STROKES: f64 = 4.0;
/// How much the tuned values weigh against a stroke, as parts of the energy of Coulomb friction: for friction as a whole, its late
/// part, speed, acceleration and the constant force.
const RIDGE: [f64; CAUSES] = [0.02, 0.3, 0.02, 0.3, 1e-3];
/// Part of Coulomb friction that a stroke may leave unexplained; one that leaves more has met another force, and teaches nothing.
const UNEXPLAINED_MAX: f64 = 0.1;
/// Part of the table's Coulomb friction below which its inertia must be for a load to be seen beside it, and below which what a torque
/// must be wrong by that comes so late, in s.
const CALM_PART: f64 = 0.25;
const LATE_PART: f64 = 0.15;
const LATE_S: f64 = 3e-3;
/// Changes below this part of Coulomb friction are noise.
const DEAD_ZONE: f64 = 0.01;
/// Largest change in a stroke, as a part of Coulomb friction.
const CHANGE_MAX: f64 = 0.15;
/// Bounds of what is believed: beyond them the axis is to be tuned, or repaired.
const LEVEL_MIN: f64 = 0.4;
const LEVEL_MAX: f64 = 1.8;
/// Most that the late part is off the whole, and largest constant force, as parts of Coulomb friction.
const LATE_MAX: f64 = 0.5;
const CONSTANT_MAX: f64 = 0.5;
/// A change comes in from this distance from the reversal on, in mm, with this time constant, in s: so that it moves nothing.
const CHANGE_FROM_MM: f64 = 0.1;
const CHANGE_S: f64 = 0.05;

/// Follows friction by the torque that the model lacks between two reversals.
///
/// ```text
/// lacks        y = F − F_ff − M·(x1 − x1_c)''  + (friction fed forward)        all behind the same filter (500 rad/s, twice)
/// explained    y = s·f + d·f_late + β·v + δ·a + c                             f: the model's friction at the level 1
/// at a stroke's end   A ← 0.9·A + A_stroke;  (A + ρ)·θ = b + ρ·θ_tuned
/// ```
///
/// A stroke is the way from one reversal to the next, and counts the same whether it takes long or not. The ridge ρ to the tuned
/// values makes it safe: without excitation nothing changes, and what it believes is bounded. A stroke that leaves more than 10 % of
/// Coulomb friction unexplained (the tool cuts) teaches nothing, nor do scans within 12 ms of a reversal, within 100 ms of a hard acceleration or
/// with the torque at its limit. What it believes comes into force away from reversals, slowly, by at most 15 % of Coulomb friction for a stroke.
///
/// The constant force and what comes and goes beside it decide when the gap is crossed ([`Load`]); where a scale shows the table, the gap is
/// followed as well ([`LostMotion`]). The first strokes count in part.
///
/// Source: regularised recursive least squares on the inverse dynamics (Ljung 1999, §11; for friction at reversals
/// docs/methods/adaptation.md). Units: N at the motor's travel, mm, mm/s, s. First call: the tuned values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptation {
    /// Whether it learns.
    pub learns: bool,
    /// Scan period, in s.
    pub scan_s: f64,
    /// Mass of the whole axis, in kg.
    pub mass_kg: f64,
    /// Coulomb friction of the whole axis, in N.
    pub coulomb_n: f64,
    /// Viscous friction of the whole axis, in N·s/m.
    pub viscous_n_s_per_m: f64,
    /// Coulomb friction of the table, in N.
    pub table_coulomb_n: f64,
    /// Mass of the table, in kg.
    pub table_mass_kg: f64,
    /// Gap, in mm.
    pub gap_mm: f64,
    /// Acceleration above which the loop swings, in mm/s².
    pub acceleration_max_mm_s2: f64,
}

/// What [`Adaptation`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct AdaptationState {
    /// 1 once it has begun.
    pub begun: u64,
    /// The level that it began with.
    tuned: f64,
    /// Behind one filter and behind two: deviation of the motor in mm, force that the model lacks in N, causes.
    deviation_mm: [f64; 2],
    lacking_n: [f64; 2],
    causes: [[f64; 2]; CAUSES - 1],
    /// Speed of the command in the scan before, in mm/s.
    velocity_mm_s: f64,
    /// Since the reversal.
    direction: f64,
    distance_mm: f64,
    since_s: f64,
    /// Time that must still pass, in s.
    unsettled_s: f64,
    stroke: Normal,
    known: Normal,
    /// What it believes: level of all friction, by how much that of the late part is off it, and the constant force.
    believed: [f64; BELIEVED],
    /// What of it is in force.
    in_force: [f64; BELIEVED],
    /// Part of Coulomb friction that the last stroke left unexplained.
    pub unexplained: f64,
    /// Strokes that taught something, and those that did not.
    strokes: [f64; 2],
    load: LoadState,
    lost_motion: LostMotionState,
}

/// One scan of an axis, at the instant its feedback was taken.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Seen {
    /// Force of the motor less what was fed forward, in N.
    pub lacking_n: f64,
    /// Motor less its command, compensation counted, in mm.
    pub deviation_mm: f64,
    /// Friction that was fed forward, at the level 1, in N: all of it, and its late part.
    pub friction_n: [f64; FRICTION],
    /// The level that was in force.
    pub level: Level,
    /// Compensation of lost motion that is meant, in mm.
    pub compensation_mm: f64,
    /// Motor less scale, in mm; 0 without a scale.
    pub wind_mm: f64,
    /// Travel of the command since the scan before, in mm.
    pub travel_mm: f64,
    /// Whether this is a motion that the model is to explain.
    pub counts: bool,
}

/// One step of a first-order filter, twice.
fn filtered(state: &mut [f64; 2], value: f64, keep: f64) -> f64 {
    let [first, second] = state;
    *first = value + (*first - value) * keep;
    *second = *first + (*second - *first) * keep;
    *second
}

impl Adaptation {
    /// Off, with the tuned values.
    pub const OFF: Adaptation = Adaptation {
        learns: false,
        scan_s: 1e-3,
        mass_kg: 0.0,
        coulomb_n: 0.0,
        viscous_n_s_per_m: 0.0,
        table_coulomb_n: 0.0,
        table_mass_kg: 0.0,
        gap_mm: 0.0,
        acceleration_max_mm_s2: 0.0,
    };

    /// What is in force; `tuned` is the level of friction before it has begun.
    pub fn belief(&self, state: &AdaptationState, tuned: f64) -> Belief {
        let level = state.level(tuned);
        if state.begun == 0 {
            return Belief {
                level,
                ..Belief::TUNED
            };
        }
        let [.., constant] = state.in_force;
        let constant_n = constant * self.coulomb_n;
        Belief {
            level,
            load_n: state.trust() * self.load().on_table_n(&state.load, constant_n),
            gap_mm: state.lost_motion.in_force_mm,
        }
    }

    /// The axis is at rest: no tool cuts.
    pub fn rest(&self, state: &mut AdaptationState) {
        let [.., constant] = state.in_force;
        state.load.rest(constant * self.coulomb_n);
    }

    fn load(&self) -> Load {
        Load {
            scan_s: self.scan_s,
            table_coulomb_n: self.table_coulomb_n,
            coulomb_n: self.coulomb_n,
        }
    }

    fn lost_motion(&self) -> LostMotion {
        LostMotion {
            gap_mm: self.gap_mm,
        }
    }

    /// One scan: what the axis did, and whether it teaches anything.
    pub fn update(&self, state: &mut AdaptationState, seen: &Seen, tuned: f64) {
        if !self.learns || !seen.is_finite() {
            return;
        }
        if state.begun == 0 {
            *state = AdaptationState {
                begun: 1,
                deviation_mm: [seen.deviation_mm; 2],
                tuned,
                believed: [tuned, 0.0, 0.0],
                in_force: [tuned, 0.0, 0.0],
                unsettled_s: SETTLE_S,
                ..AdaptationState::default()
            };
        }
        let [.., [_, inertia_before_n]] = state.causes;
        let (value_n, causes, acceleration_mm_s2) = self.compared(state, seen);
        let step_mm = seen.travel_mm;
        if step_mm * state.direction < 0.0 || (state.direction == 0.0 && step_mm != 0.0) {
            self.end_stroke(state);
            self.lost_motion()
                .end_stroke(&mut state.lost_motion, state.direction);
            state.direction = step_mm.signum();
            state.distance_mm = 0.0;
            state.since_s = 0.0;
        }
        state.distance_mm += step_mm.abs();
        state.since_s += self.scan_s;
        if !seen.counts || acceleration_mm_s2.abs() > self.acceleration_max_mm_s2 {
            state.unsettled_s = SETTLE_S;
        } else {
            state.unsettled_s = (state.unsettled_s - self.scan_s).max(0.0);
        }
        if state.unsettled_s == 0.0 && step_mm != 0.0 {
            let table_n = self.table_mass_kg * acceleration_mm_s2 * 1e-3;
            let is_calm = table_n.abs() < CALM_PART * self.table_coulomb_n;
            let [.., inertia_n, _] = causes;
            let late_n = (inertia_n - inertia_before_n) / self.scan_s * LATE_S;
            let is_steady = is_calm && late_n.abs() < LATE_PART * self.table_coulomb_n;
            if state.since_s > CROSSING_S {
                self.look(state, seen, value_n, &causes, is_steady);
            }
            if is_calm {
                let (wind_mm, meant_mm) = (seen.wind_mm, seen.compensation_mm);
                let lost_motion = &mut state.lost_motion;
                self.lost_motion()
                    .update(lost_motion, wind_mm, meant_mm, state.distance_mm);
            }
        }
        if state.distance_mm > CHANGE_FROM_MM {
            let part = 1.0 - libm::exp(-self.scan_s / CHANGE_S);
            for (own, wanted) in state.in_force.iter_mut().zip(state.believed) {
                *own += part * (wanted - *own);
            }
            self.lost_motion()
                .come_into_force(&mut state.lost_motion, part);
        }
    }

    /// A scan of a stroke that teaches something, of its load too where the motion is steady.
    fn look(
        &self,
        state: &mut AdaptationState,
        seen: &Seen,
        value_n: f64,
        causes: &[f64; CAUSES],
        is_steady: bool,
    ) {
        let near = state.distance_mm / NEAR_MM;
        let weight = self.scan_s / (1.0 + near);
        state.stroke.add(causes, value_n, weight);
        if is_steady {
            let [all_n, late_n, ..] = causes;
            let Level { early, late } = seen.level;
            let explained_n = early * (all_n - late_n) + late * late_n;
            self.load().update(&mut state.load, value_n - explained_n);
        }
    }

    /// What is to be explained and by what, each behind the filter; acceleration of the command in mm/s².
    fn compared(&self, state: &mut AdaptationState, seen: &Seen) -> (f64, [f64; CAUSES], f64) {
        let keep = libm::exp(-FILTER_RAD_S * self.scan_s);
        // (1 − F)² is the second difference behind F², but for a constant.
        let ratio = (1.0 - keep) / (keep * self.scan_s);
        let twice_mm = filtered(&mut state.deviation_mm, seen.deviation_mm, keep);
        let [once_mm, _] = state.deviation_mm;
        let own_mm_s2 = (seen.deviation_mm - 2.0 * once_mm + twice_mm) * ratio * ratio;
        let velocity_mm_s = seen.travel_mm / self.scan_s;
        let acceleration_mm_s2 = (velocity_mm_s - state.velocity_mm_s) / self.scan_s;
        state.velocity_mm_s = velocity_mm_s;
        let [all_n, late_n] = seen.friction_n;
        let Level { early, late } = seen.level;
        let lacking_n = seen.lacking_n + early * (all_n - late_n) + late * late_n;
        let lacking_n = filtered(&mut state.lacking_n, lacking_n, keep);
        let raw = [
            all_n,
            late_n,
            self.viscous_n_s_per_m * velocity_mm_s * 1e-3,
            self.mass_kg * acceleration_mm_s2 * 1e-3,
        ];
        let mut causes = [self.coulomb_n; CAUSES];
        for ((cause, memory), raw) in causes.iter_mut().zip(&mut state.causes).zip(raw) {
            *cause = filtered(memory, raw, keep);
        }
        let value_n = lacking_n - self.mass_kg * own_mm_s2 * 1e-3;
        (value_n, causes, acceleration_mm_s2)
    }

    /// The axis reverses: what the way since the last reversal says.
    fn end_stroke(&self, state: &mut AdaptationState) {
        let stroke = core::mem::take(&mut state.stroke);
        if stroke.weight < STROKE_S_MIN * STROKE_WEIGHT || self.coulomb_n <= 0.0 {
            return;
        }
        let known = state.known.with(FORGETTING, &stroke);
        let Some(values) = self.solved(&known, state.tuned) else {
            return;
        };
        let [taught, refused] = &mut state.strokes;
        state.unexplained = libm::sqrt(stroke.left(&values)) / self.coulomb_n;
        if state.unexplained > UNEXPLAINED_MAX {
            *refused += 1.0;
            return;
        }
        *taught += 1.0;
        state.known = known;
        let trust = state.trust();
        let [all, late, _, _, constant] = values.as_slice() else {
            return;
        };
        let wanted = [
            all.clamp(LEVEL_MIN, LEVEL_MAX),
            late.clamp(-LATE_MAX, LATE_MAX),
            constant.clamp(-CONSTANT_MAX, CONSTANT_MAX),
        ];
        for (own, wanted) in state.believed.iter_mut().zip(wanted) {
            let change = trust * (wanted - *own);
            if change.abs() > DEAD_ZONE {
                *own += change.clamp(-CHANGE_MAX, CHANGE_MAX);
            }
        }
    }

    /// The values that explain most, drawn to the tuned ones.
    fn solved(&self, known: &Normal, tuned: f64) -> Option<SVector<f64, CAUSES>> {
        let mut matrix = known.whole();
        let mut right = SVector::from(known.right);
        let energy = self.coulomb_n * self.coulomb_n;
        for (index, ridge) in RIDGE.iter().enumerate() {
            *matrix.get_mut((index, index))? += ridge * energy;
        }
        let [ridge, ..] = RIDGE;
        *right.get_mut(0)? += ridge * energy * tuned;
        let values = matrix.cholesky()?.solve(&right);
        values
            .iter()
            .all(|value| value.is_finite())
            .then_some(values)
    }
}

/// Weight of a scan near the reversal, by its time.
const STROKE_WEIGHT: f64 = 0.5;

impl Seen {
    fn is_finite(&self) -> bool {
        let [all_n, late_n] = self.friction_n;
        [
            self.lacking_n,
            self.deviation_mm,
            self.travel_mm,
            self.compensation_mm,
            self.wind_mm,
            all_n,
            late_n,
        ]
        .iter()
        .all(|value| value.is_finite())
    }
}

impl AdaptationState {
    /// Level of friction that is in force; `tuned` before it has begun.
    pub fn level(&self, tuned: f64) -> Level {
        if self.begun == 0 {
            return Level::all(tuned);
        }
        let [all, late, _] = self.in_force;
        Level {
            early: all,
            late: all + late,
        }
    }

    /// How much what was learned counts, 0 to 1.
    fn trust(&self) -> f64 {
        let [taught, _] = self.strokes;
        (taught / TRUSTED_STROKES).min(1.0)
    }

    /// The axis is moved by others, or its loop is open: what is known stays, what was being looked at does not.
    pub fn leave(&mut self) {
        *self = AdaptationState {
            begun: self.begun,
            tuned: self.tuned,
            known: self.known,
            believed: self.believed,
            in_force: self.believed,
            unexplained: self.unexplained,
            strokes: self.strokes,
            load: self.load,
            lost_motion: self.lost_motion,
            unsettled_s: SETTLE_S,
            ..AdaptationState::default()
        };
        self.lost_motion.leave();
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests;
