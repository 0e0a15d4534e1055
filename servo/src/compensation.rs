//! What the identified model of an axis adds to its commands: inverse dynamics, learned residuals, disturbance observer.
use bus::sample::AxisFeedback;
use bytemuck::{Pod, Zeroable};
use loops::adaptation::{Adaptation, AdaptationState, Seen};
use loops::disturbance_observer::{DisturbanceObserver, DisturbanceObserverState};
use loops::inverse_dynamics::{
    Ahead, Belief, InverseDynamics, InverseDynamicsState, LEAD_SCANS_MAX, Motion, Parts,
    SMOOTHING_RAD_S_MAX,
};
use loops::learned_table::LearnedTable;
use loops::maxwell_slip::{MaxwellSlip, SlipElement};
use machine::model::{FrictionCurve, TableModel};
use machine::{AdaptationMode, Axis, AxisModel, DEAD_TIME_SCANS_MAX, DriveMode, ReversalMethod};

/// A difference over fewer increments than this time gives would be rounding, in s.
const DIFFERENCE_S: f64 = 2e-3;
/// Torques kept: that of a scan, and those of as many before it as the dead time may be.
const TORQUES: usize = DEAD_TIME_SCANS_MAX as usize + 1;
/// Most that the current loop adds to the model's lead, in scans.
const CURRENT_LOOP_SCANS_MAX: f64 = 0.999;
/// Scans before this one whose position command the state still holds.
const ROWS_BEHIND: f64 = 2.0;
const _: () = assert!(
    1.0 + DEAD_TIME_SCANS_MAX as f64 + CURRENT_LOOP_SCANS_MAX <= LEAD_SCANS_MAX,
    "the model's state does not reach over the largest dead time: LEAD_SCANS_MAX in control"
);
/// Part of the peak torque that the winding up of the screw may take.
const WINDING_TORQUE_PART: f64 = 0.4;
/// Part of the peak torque that is fed forward at most; the rest is the loop's.
const FED_TORQUE_PART: f64 = 0.8;
/// Part of that which a correction along the path may take.
const PATH_TORQUE_PART: f64 = 0.25;
/// Part of the axis's acceleration above which its loop swings.
const UNSETTLING_PART: f64 = 0.6;
/// An axis is at rest so long after its last command, in s: five integral times of 10 ms.
const RESTING_S: f64 = 0.05;
/// Part of the peak torque that the disturbance observer may ask for.
const OBSERVER_TORQUE_PART: f64 = 0.25;

/// The model's part of a servo's settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelSettings {
    /// None where the axis has no model or makes no use of it.
    pub inverse_dynamics: Option<InverseDynamics>,
    /// Off where its bandwidth is 0.
    pub observer: DisturbanceObserver,
    /// Follows friction; off where the machine file does not ask for it.
    pub adaptation: Adaptation,
    /// Level of friction that it begins with, as a part of the tuned one.
    level: f64,
    /// Lead of the speed that is fed forward, in scans: its advance less the scan that movement commands are centred back.
    pub(crate) speed_lead_scans: f64,
    /// Tp, in s.
    scan_s: f64,
    /// Axis units per increment, in mm.
    increment_mm: f64,
    /// Travel per radian of the motor, in m.
    radius_m: f64,
    /// Torque that holds the weight of the axis, in N·m.
    pub(crate) weight_nm: f64,
    /// Most torque that is fed forward, in N·m.
    fed_nm_max: f64,
    /// Scans from a command to the scan that it acts in.
    dead_time_scans: usize,
}

/// What the model remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ModelState {
    /// Of the inverse dynamics.
    pub inverse_dynamics: InverseDynamicsState,
    /// Of the disturbance observer.
    pub observer: DisturbanceObserverState,
    /// Torques that the model fed forward in this scan and in those before, the newest first, in N·m.
    pub torque_feed_forward_nm: [f64; TORQUES],
    /// What the model asked for beyond the torque that is fed forward, in N·m.
    pub torque_cut_nm: f64,
    /// Motor encoder of the scan before, in increments.
    pub motor_position: i64,
    /// What friction is taken to be.
    pub adaptation: AdaptationState,
    /// Friction fed forward in this scan and in those before, at the level 1, the newest first, in N: all, and its late part.
    pub friction_n: [[f64; 2]; TORQUES],
}

impl ModelState {
    /// From now on positions come from elsewhere: where the axis is, is no motion.
    pub(crate) fn moved_by_others(&mut self) {
        self.inverse_dynamics.leave();
        self.adaptation.leave();
    }

    /// What is known of friction stays; all else begins again.
    pub(crate) fn kept(&self) -> ModelState {
        let mut kept = ModelState {
            adaptation: self.adaptation,
            ..ModelState::default()
        };
        kept.adaptation.leave();
        kept
    }

    /// Torque fed forward in the last scan, in N·m.
    pub fn torque_nm(&self) -> f64 {
        let [torque_nm, ..] = self.torque_feed_forward_nm;
        torque_nm
    }

    fn take(&mut self, torque_nm: f64, friction_n: [f64; 2]) {
        self.torque_feed_forward_nm.rotate_right(1);
        let [now, ..] = &mut self.torque_feed_forward_nm;
        *now = torque_nm;
        self.friction_n.rotate_right(1);
        let [now, ..] = &mut self.friction_n;
        *now = friction_n;
    }

    /// The part of the torque in this scan's feedback that was fed forward: it acted in the scan before.
    fn acting_torque_nm(&self, dead_time_scans: usize) -> f64 {
        let torque = self.torque_feed_forward_nm.get(dead_time_scans);
        torque.copied().unwrap_or(0.0)
    }
}

/// What is in force without the model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Beside {
    /// Compensation of lost motion in the scan before, in mm.
    pub before_mm: f64,
    /// The one that the position backlash step gives now, in mm.
    pub step_mm: f64,
    /// What the model was off when the axis was at rest, in N·m: the loop's integrator holds as much against it.
    pub torque_nm: f64,
}

/// What is added.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Added {
    /// To the position command, in mm.
    pub compensation_mm: f64,
    /// To the velocity command, in mm/s.
    pub velocity_mm_s: f64,
    /// To the torque, in N·m.
    pub torque_nm: f64,
    /// Speed of the setpoints in the middle of the scan that the command acts in, in mm/s, where the acceleration is fed forward
    /// as torque: speed and torque must tell of the same motion, and movement commands smooth it over a period.
    pub setpoint_mm_s: Option<f64>,
}

impl ModelSettings {
    /// For this axis.
    pub fn new(axis: &Axis, scan_s: f64, dead_time_scans: u32) -> ModelSettings {
        let radius_m = axis.lead_mm * 1e-3 / (2.0 * core::f64::consts::PI);
        ModelSettings {
            inverse_dynamics: inverse_dynamics(axis, scan_s, dead_time_scans.into(), radius_m),
            observer: DisturbanceObserver {
                bandwidth_rad_s: axis.disturbance_observer.bandwidth_rad_s,
                mass_kg: axis.model.map_or(0.0, |model| model.mass_kg),
                scan_s,
                limit_n: OBSERVER_TORQUE_PART * axis.motor.peak_torque_nm / radius_m,
            },
            adaptation: adaptation(axis, scan_s),
            level: axis.adaptation.level,
            speed_lead_scans: axis.feed_forward.advance_ms * 1e-3 / scan_s - 1.0,
            scan_s,
            increment_mm: axis.increment_mm(),
            radius_m,
            weight_nm: axis.weight_nm(),
            fed_nm_max: FED_TORQUE_PART * axis.motor.peak_torque_nm,
            dead_time_scans: dead_time_scans as usize,
        }
    }

    /// One scan, beside what is in force without it; `setpoint` the position command so many scans from now.
    pub(crate) fn update(
        &self,
        state: &mut ModelState,
        axis: &AxisFeedback,
        learned: Option<&LearnedTable>,
        beside: &Beside,
        setpoint: impl Fn(i64) -> i64,
    ) -> Added {
        let mut added = Added {
            compensation_mm: beside.step_mm,
            ..Added::default()
        };
        let tuned = self.tuned(learned);
        let belief = self.adaptation.belief(&state.adaptation, tuned);
        let mut friction_n = [0.0; 2];
        if let Some(model) = &self.inverse_dynamics {
            self.move_table(model, state, learned, &belief, &setpoint, &mut added);
            friction_n = model.friction_n(&state.inverse_dynamics, &belief.level);
        }
        // The weight is no friction: with the axis at rest, and in either direction, the torque that holds it is the same.
        let asked_nm = added.torque_nm + beside.torque_nm + self.weight_nm;
        added.torque_nm = asked_nm.clamp(-self.fed_nm_max, self.fed_nm_max);
        state.torque_cut_nm = asked_nm - added.torque_nm;
        let models_nm = added.torque_nm - beside.torque_nm;
        let acting_nm = state.acting_torque_nm(self.dead_time_scans);
        let acting_friction_n = state.friction_n.get(self.dead_time_scans).copied();
        state.take(models_nm, friction_n);
        let travel = setpoint(0).saturating_sub(setpoint(-1)) as f64 * self.increment_mm;
        let lacking_n = (axis.torque_nm - acting_nm) / self.radius_m;
        let seen = Seen {
            lacking_n,
            deviation_mm: axis.motor_position.saturating_sub(setpoint(-1)) as f64
                * self.increment_mm
                - beside.before_mm,
            friction_n: acting_friction_n.unwrap_or_default(),
            level: belief.level,
            compensation_mm: beside.before_mm,
            wind_mm: axis.motor_position.saturating_sub(axis.scale_position) as f64
                * self.increment_mm,
            travel_mm: travel,
            counts: axis.torque_limited == 0,
        };
        self.adaptation.update(&mut state.adaptation, &seen, tuned);
        if self.observer.bandwidth_rad_s > 0.0 {
            // A step of the compensation is no motion that was meant; the model's own is.
            let models = self
                .inverse_dynamics
                .is_some_and(|model| model.parts.compensation);
            let compensated_mm = if models {
                added.compensation_mm - beside.before_mm
            } else {
                0.0
            };
            let travelled_mm =
                axis.motor_position.saturating_sub(state.motor_position) as f64 * self.increment_mm;
            let off_mm_s = (travelled_mm - (travel + compensated_mm)) / self.scan_s;
            let resisting_n = self
                .observer
                .update(&mut state.observer, lacking_n, off_mm_s);
            added.torque_nm += resisting_n * self.radius_m;
        }
        state.motor_position = axis.motor_position;
        added
    }

    /// Level of friction that the axis begins with: of the machine file, and of what was learned in runs before.
    fn tuned(&self, learned: Option<&LearnedTable>) -> f64 {
        self.level * learned.map_or(1.0, |table| table.friction_scale)
    }

    /// The axis is at rest: the model goes by the torque that holds it. What must be fed beside the model for the torque to stay as
    /// it is, in N·m, changes by what this returns; a disturbance observer holds it itself.
    pub(crate) fn rest_at(
        &self,
        state: &mut ModelState,
        learned: Option<&LearnedTable>,
        torque_nm: f64,
    ) -> f64 {
        let Some(model) = &self.inverse_dynamics else {
            return 0.0;
        };
        self.adaptation.rest(&mut state.adaptation);
        let before_n = state.inverse_dynamics.force_n;
        let belief = self
            .adaptation
            .belief(&state.adaptation, self.tuned(learned));
        let torque_nm = torque_nm - self.weight_nm;
        model.rest_at(&mut state.inverse_dynamics, torque_nm, &belief);
        let change_n = state.inverse_dynamics.force_n - before_n;
        for fed_nm in &mut state.torque_feed_forward_nm {
            *fed_nm += change_n * self.radius_m;
        }
        if self.observer.bandwidth_rad_s > 0.0 {
            state.observer.filtered_n -= change_n;
            return 0.0;
        }
        -change_n * self.radius_m
    }

    /// Scans after which an axis that is not commanded to move is at rest; none where friction is not fed forward.
    pub(crate) fn resting_scans(&self) -> Option<u32> {
        let model = self.inverse_dynamics?;
        let feeds = model.parts.friction;
        feeds.then(|| libm::ceil(RESTING_S / self.scan_s) as u32)
    }

    /// Level of friction that is in force, as a part of the tuned one; 0 without a model.
    pub(crate) fn friction_level(&self, state: &ModelState, learned: Option<&LearnedTable>) -> f64 {
        if self.inverse_dynamics.is_none() {
            return 0.0;
        }
        state.adaptation.level(self.tuned(learned)).early
    }

    /// Compensation of lost motion at rest, in mm, where the model says it.
    pub(crate) fn compensation_at_rest_mm(&self, state: &ModelState) -> Option<f64> {
        let model = self.inverse_dynamics.as_ref();
        let crosses = model.is_some_and(|model| model.parts.compensation);
        crosses.then(|| state.inverse_dynamics.compensation_at_rest_mm())
    }

    /// What moves the table as commanded, by the inverse dynamics.
    fn move_table(
        &self,
        model: &InverseDynamics,
        state: &mut ModelState,
        learned: Option<&LearnedTable>,
        belief: &Belief,
        setpoint: &impl Fn(i64) -> i64,
        added: &mut Added,
    ) {
        let position_mm = |ahead: f64| self.position_mm(ahead, setpoint);
        let motion = |ahead: f64| {
            let wide = self.difference_scans(ahead);
            let wide_s = wide * self.scan_s;
            let (last, here, next) = (
                position_mm(ahead - wide),
                position_mm(ahead),
                position_mm(ahead + wide),
            );
            Motion {
                position_mm: here,
                velocity_mm_s: (next - last) / (2.0 * wide_s),
                acceleration_mm_s2: (next - 2.0 * here + last) / (wide_s * wide_s),
            }
        };
        let ahead = Ahead {
            here: motion(model.lead_scans),
            near: motion(model.near_lead_scans()),
            far: motion(model.far_lead_scans()),
        };
        let wanted = model.update(&mut state.inverse_dynamics, &ahead, learned, belief);
        if model.parts.compensation {
            added.compensation_mm = wanted.compensation_mm;
            added.velocity_mm_s = wanted.velocity_mm_s;
        }
        added.torque_nm = wanted.torque_nm;
        if model.parts.acceleration {
            added.setpoint_mm_s = Some(self.setpoint_mm_s(setpoint));
        }
    }

    /// Speed of the setpoints in the middle of the scan that the command acts in, in mm/s.
    pub(crate) fn setpoint_mm_s(&self, setpoint: impl Fn(i64) -> i64) -> f64 {
        let middle = self.speed_lead_scans;
        let position_mm = |ahead: f64| self.position_mm(ahead, &setpoint);
        let travel_mm = position_mm(middle + 0.5) - position_mm(middle - 0.5);
        travel_mm / self.scan_s
    }

    /// Lead of a torque that accelerates the axis, in scans; none where acceleration is not fed forward.
    pub(crate) fn path_torque_lead_scans(&self) -> Option<f64> {
        let model = self
            .inverse_dynamics
            .filter(|model| model.parts.acceleration)?;
        Some(model.lead_scans)
    }

    /// Scans on either side of a lead that an acceleration is taken from, none of them before the present one.
    pub(crate) fn path_difference_scans(&self, ahead: f64) -> f64 {
        (DIFFERENCE_S / self.scan_s).min(ahead)
    }

    /// Torque of an acceleration, in N·m.
    pub(crate) fn path_torque_nm(&self, acceleration_mm_s2: f64) -> f64 {
        let mass_kg = self
            .inverse_dynamics
            .map_or(0.0, |model| model.motor_mass_kg + model.table_mass_kg);
        let most_nm = PATH_TORQUE_PART * self.fed_nm_max;
        (mass_kg * acceleration_mm_s2 * 1e-3 * self.radius_m).clamp(-most_nm, most_nm)
    }

    /// Scans ahead of the present one that a command is looked for at most.
    pub(crate) fn ahead_scans(&self) -> u32 {
        let model = self.inverse_dynamics.map_or(0.0, |model| {
            let furthest = model.near_lead_scans().max(model.far_lead_scans());
            furthest + self.difference_scans(furthest)
        });
        libm::ceil(model.max(self.speed_lead_scans + 0.5)) as u32 + 1
    }

    /// Scans on either side of a place that speed and acceleration there are taken from.
    fn difference_scans(&self, ahead: f64) -> f64 {
        (DIFFERENCE_S / self.scan_s).min(ahead + ROWS_BEHIND)
    }

    /// Position command so many scans ahead, in mm.
    fn position_mm(&self, ahead: f64, setpoint: &impl Fn(i64) -> i64) -> f64 {
        let low = libm::floor(ahead);
        let at = |scans: i64| setpoint(scans) as f64 * self.increment_mm;
        let (here, next) = (at(low as i64), at(low as i64 + 1));
        here + (next - here) * (ahead - low)
    }
}

/// Bandwidth with which the motor can wind up the screw. The contact force turns round by twice the table's friction, its second
/// derivative behind the filter by ω² times that at most, and the motor has to follow the wind-up: on a soft screw more slowly.
fn smoothing_rad_s(axis: &Axis, model: &AxisModel, table: &TableModel, radius_m: f64) -> f64 {
    let force_n = WINDING_TORQUE_PART * axis.motor.peak_torque_nm / radius_m;
    let stiffness_n_per_m = table.stiffness_n_per_um * 1e6;
    let turned_n = 2.0 * table.coulomb_n * (model.mass_kg - table.mass_kg);
    let wanted = libm::sqrt(force_n * stiffness_n_per_m / turned_n);
    // Without friction or mass there is nothing to follow.
    if wanted.is_finite() {
        wanted.min(SMOOTHING_RAD_S_MAX)
    } else {
        SMOOTHING_RAD_S_MAX
    }
}

fn adaptation(axis: &Axis, scan_s: f64) -> Adaptation {
    let Some(model) = axis.model else {
        return Adaptation::OFF;
    };
    Adaptation {
        learns: axis.adaptation.mode == AdaptationMode::On,
        scan_s,
        mass_kg: model.mass_kg,
        coulomb_n: model.coulomb_n,
        viscous_n_s_per_m: model.viscous_n_s_per_m,
        table_coulomb_n: model.table.map_or(0.0, |table| table.coulomb_n),
        table_mass_kg: model.table.map_or(0.0, |table| table.mass_kg),
        gap_mm: model.table.map_or(0.0, |table| table.gap_um * 1e-3),
        acceleration_max_mm_s2: UNSETTLING_PART * axis.acceleration_mm_s2,
    }
}

fn inverse_dynamics(
    axis: &Axis,
    scan_s: f64,
    dead_time_scans: f64,
    radius_m: f64,
) -> Option<InverseDynamics> {
    let torque = &axis.torque_feed_forward;
    let crosses = axis.reversal.method == ReversalMethod::ContactForce;
    let model = axis.model.filter(|_| crosses || torque.any())?;
    let table = model.table.unwrap_or_default();
    let curve = model.friction.unwrap_or_default();
    Some(InverseDynamics {
        parts: Parts {
            compensation: crosses,
            acceleration: torque.acceleration,
            viscous: torque.viscous,
            friction: torque.friction,
        },
        scan_s,
        motor_mass_kg: model.mass_kg - table.mass_kg,
        table_mass_kg: table.mass_kg,
        motor_viscous_n_s_per_m: model.viscous_n_s_per_m - table.viscous_n_s_per_m,
        table_viscous_n_s_per_m: table.viscous_n_s_per_m,
        stiffness_n_per_m: table.stiffness_n_per_um * 1e6,
        gap_mm: table.gap_um * 1e-3,
        traversal_s: table.traversal_ms * 1e-3,
        // A command acts a dead time later and is held for a scan; the force follows it by the current loop. A drive that closes the
        // position loop gets the position with it, and is there in the scan in which both act.
        lead_scans: {
            let late_scans = match axis.drive_mode {
                DriveMode::Velocity | DriveMode::Torque => dead_time_scans,
                DriveMode::Position => 0.0,
            };
            let current_loop_scans = torque.current_loop_ms * 1e-3 / scan_s;
            (1.0 + late_scans + current_loop_scans).min(1.0 + late_scans + CURRENT_LOOP_SCANS_MAX)
        },
        smoothing_rad_s: smoothing_rad_s(axis, &model, &table, radius_m),
        velocity_delay_scans: match axis.drive_mode {
            DriveMode::Velocity | DriveMode::Position => 0.0,
            DriveMode::Torque => dead_time_scans - 1.0,
        },
        motor_friction: slip(model.coulomb_n - table.coulomb_n, &curve),
        table_friction: slip(table.coulomb_n, &table.friction.unwrap_or(curve)),
        radius_m,
        weight_n: axis.weight_n(),
    })
}

fn slip(coulomb_n: f64, curve: &FrictionCurve) -> MaxwellSlip {
    let mut slip = MaxwellSlip {
        static_excess: curve.static_ratio - 1.0,
        stribeck_velocity_mm_s: curve.stribeck_mm_s,
        ..MaxwellSlip::default()
    };
    let curve = curve.share.iter().zip(&curve.break_um);
    for (element, (share, break_um)) in slip.elements.iter_mut().zip(curve) {
        *element = SlipElement {
            slip_n: coulomb_n * share,
            break_distance_mm: break_um * 1e-3,
        };
    }
    slip
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::path::Path;

    use machine::Machine;

    use super::*;

    /// The model of axis X of a shipped machine that does not follow friction, and begins with this part of the tuned one.
    fn model(level: f64) -> ModelSettings {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let machine = Machine::load(&folder).unwrap();
        let mut axis = machine.axes.first().unwrap().clone();
        axis.adaptation.mode = AdaptationMode::Off;
        axis.adaptation.level = level;
        ModelSettings::new(&axis, machine.scan_period_s(), 1)
    }

    #[test]
    fn the_level_of_friction_is_that_of_the_learned_table_where_friction_is_not_followed() {
        let table = LearnedTable {
            friction_scale: 0.7,
            ..LearnedTable::default()
        };
        let (state, learned) = (ModelState::default(), Some(&table));
        assert_eq!(model(1.0).friction_level(&state, None), 1.0);
        assert_eq!(model(1.0).friction_level(&state, learned), 0.7);
        assert!((model(0.9).friction_level(&state, learned) - 0.63).abs() < 1e-12);
    }

    #[test]
    fn an_axis_at_rest_is_as_with_friction_tuned_to_what_was_learned() {
        let table = LearnedTable {
            friction_scale: 0.7,
            ..LearnedTable::default()
        };
        let at_rest = |model: ModelSettings, learned: Option<&LearnedTable>| {
            let mut state = ModelState::default();
            // Below break-away friction of the motor: 0.40 N·m in the model.
            let change_nm = model.rest_at(&mut state, learned, 0.2);
            (change_nm, state.inverse_dynamics)
        };
        let learned = at_rest(model(1.0), Some(&table));
        assert_eq!(learned, at_rest(model(0.7), None));
        assert_ne!(learned, at_rest(model(1.0), None));
    }
}
