//! What the motor must do, and with which torque, so that the *table* follows the command.
use bytemuck::{Pod, Zeroable};

use crate::learned_table::LearnedTable;
use crate::maxwell_slip::{ELEMENTS, Level, MaxwellSlip};

/// Most scans that the model runs ahead of the position command: a dead time of eight, one of hold, nearly one of current loop.
pub const LEAD_SCANS_MAX: f64 = 9.999;
/// Compensations kept: those of the present scan and of as many before as the lead may have, one more for what lies between.
const HISTORY: usize = 11;
/// Largest bandwidth of the filter on the predicted contact force, in rad/s.
pub const SMOOTHING_RAD_S_MAX: f64 = 1500.0;

/// Part of the table's Coulomb friction that the contact force must exceed for a traversal against the acceleration.
const BACK_PART: f64 = 0.5;

/// At rest the table lies against a side of the gap if the screw carries more than this part of the table's Coulomb friction;
/// below that nobody knows, and it counts as where it was.
const LYING_PART: f64 = 0.25;
/// At rest springs are looked for within this way, in mm: three times the longest break distance that is identified.
const REST_TRAVEL_MM: f64 = 0.2;
/// Halvings of it: to below a nanometre.
const REST_HALVINGS: u32 = 20;

/// Which parts of the model are put out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Parts {
    /// Wind-up and gap on the position command.
    pub compensation: bool,
    /// `M·a` as torque.
    pub acceleration: bool,
    /// Viscous friction as torque.
    pub viscous: bool,
    /// Friction over distance as torque.
    pub friction: bool,
}

/// A motor and a table, joined by a screw with stiffness and a gap, turned round: from the motion that the table is to make to
/// the motion and torque of the motor.
///
/// ```text
/// contact      fc = M2·a + B2·v + f2(x)                       what the screw must carry
/// motor        x1 = x + fc/k + (b/2)·side                     side: −1 … 1, crossed where fc changes sign
/// torque       T  = p·[fc + M1·x1'' + B1·x1' + f1(x1)]        f1, f2: Maxwell slip elements
/// ```
///
/// The gap is crossed along a smooth step (10u³ − 15u⁴ + 6u⁵) in the time `traversal_s`, half of it before the contact force
/// changes sign, half of it after: so neither an early nor a late crossing lets the table go. Everything is computed
/// `lead_scans` ahead, the delay of a command until the middle of the scan that it acts in; the position command gets the
/// compensation of that many scans ago. Learned residuals ([`LearnedTable`]) are added over the distance since the reversal.
///
/// Source: the two-mass equations of docs/methods/physics.md §3 solved for the motor (the system is differentially flat in the
/// table's position: Fliess, Lévine, Martin, Rouchon 1995); predicted crossing: docs/methods/physics.md §4. Units: mm and mm/s for
/// motion, N and kg at the table, N·m at the motor. First call: no spring is wound, neither side of the gap is known, and the
/// compensation is 0. An input that is not a number gives outputs that are not numbers; the caller stops the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseDynamics {
    /// What is put out.
    pub parts: Parts,
    /// Scan period, in s.
    pub scan_s: f64,
    /// Motor and screw, in kg at the table.
    pub motor_mass_kg: f64,
    /// Table, in kg.
    pub table_mass_kg: f64,
    /// Viscous friction at the motor, in N·s/m.
    pub motor_viscous_n_s_per_m: f64,
    /// Viscous friction at the table, in N·s/m.
    pub table_viscous_n_s_per_m: f64,
    /// Screw, in N/m.
    pub stiffness_n_per_m: f64,
    /// Gap, in mm.
    pub gap_mm: f64,
    /// Time for crossing it, in s.
    pub traversal_s: f64,
    /// Lead of the model over the position command, in scans, at most [`LEAD_SCANS_MAX`].
    pub lead_scans: f64,
    /// Bandwidth of the filter on the predicted contact force, in rad/s, at most [`SMOOTHING_RAD_S_MAX`]. A setpoint may step its
    /// acceleration; the motor cannot step the wind-up of the screw. Its delay of 2/ω is made up for by looking that much further ahead.
    pub smoothing_rad_s: f64,
    /// Scans by which the rate of the compensation is held back: 0 where the drive closes the velocity loop and gets it when the
    /// motion is due; the dead time beyond one scan where the servo closes it and compares at once.
    pub velocity_delay_scans: f64,
    /// Friction at the motor.
    pub motor_friction: MaxwellSlip,
    /// Friction at the table.
    pub table_friction: MaxwellSlip,
    /// Travel per radian of the motor, in m.
    pub radius_m: f64,
    /// Force with which weight pulls the table towards lower positions, in N. It decides where the table lies in the gap; the torque that
    /// holds it is not of this model, and the place where it hangs at rest counts as where the motor is.
    pub weight_n: f64,
}

/// What [`InverseDynamics`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct InverseDynamicsState {
    /// 1 where the positions are those of the scan before; 0 at the first call and where the axis was moved by others:
    /// then it goes on from the place it finds, with springs and gap as they were.
    pub running: u64,
    /// Position seen furthest ahead, in mm.
    pub far_mm: f64,
    /// Position seen ahead by lead and filter, in mm.
    pub near_mm: f64,
    /// Motor position, in mm.
    pub motor_mm: f64,
    /// Table friction furthest ahead.
    pub far_table_n: [f64; ELEMENTS],
    /// Table friction.
    pub table_n: [f64; ELEMENTS],
    /// Motor friction.
    pub motor_n: [f64; ELEMENTS],
    /// Where in the gap the motor is, −1 to 1.
    pub side: f64,
    /// Where it goes: −1, 0 (not known yet) or 1.
    pub side_wanted: f64,
    /// Compensations of the last scans, the newest first, in mm.
    pub compensation_mm: [f64; HISTORY],
    /// Force before the present one, in N.
    pub force_n: f64,
    /// Contact force behind the filter, in N, and its rate, in N/s.
    pub contact_n: f64,
    /// Its rate, in N/s.
    pub contact_n_per_s: f64,
    /// Direction of travel: −1, 0 (none yet) or 1.
    pub direction: f64,
    /// Distance since the reversal, in mm.
    pub distance_mm: f64,
}

/// The motion that the table is to make, at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Position, in mm.
    pub position_mm: f64,
    /// Velocity, in mm/s.
    pub velocity_mm_s: f64,
    /// Acceleration, in mm/s².
    pub acceleration_mm_s2: f64,
}

/// The commanded motion at the three leads that the model asks for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ahead {
    /// At [`InverseDynamics::lead_scans`].
    pub here: Motion,
    /// At [`InverseDynamics::near_lead_scans`].
    pub near: Motion,
    /// At [`InverseDynamics::far_lead_scans`].
    pub far: Motion,
}

/// What the machine is believed to be beside the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belief {
    /// How high friction is.
    pub level: Level,
    /// Force that something else puts on the table, in N, positive against positive motion: a cut, a weight, friction that differs by
    /// direction. It decides when the gap is crossed; the loops hold it.
    pub load_n: f64,
    /// Gap beyond that of the model, in mm.
    pub gap_mm: f64,
}

/// What is added to the servo's commands.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wanted {
    /// To the position command of this scan, in mm.
    pub compensation_mm: f64,
    /// To the velocity command, in mm/s.
    pub velocity_mm_s: f64,
    /// To the torque, in N·m.
    pub torque_nm: f64,
}

impl Default for Belief {
    fn default() -> Self {
        Belief::TUNED
    }
}

impl Belief {
    /// As tuned.
    pub const TUNED: Belief = Belief {
        level: Level::TUNED,
        load_n: 0.0,
        gap_mm: 0.0,
    };
}

impl InverseDynamics {
    /// Lead at which the traversal of the gap is decided, in scans.
    pub fn far_lead_scans(&self) -> f64 {
        self.lead_scans + 0.5 * self.traversal_s / self.scan_s
    }

    /// Lead at which the contact force enters its filter, in scans.
    pub fn near_lead_scans(&self) -> f64 {
        self.lead_scans + 2.0 / (self.smoothing_rad_s * self.scan_s)
    }

    /// One scan.
    pub fn update(
        &self,
        state: &mut InverseDynamicsState,
        ahead: &Ahead,
        learned: Option<&LearnedTable>,
        belief: &Belief,
    ) -> Wanted {
        if state.running == 0 {
            // The axis was moved by others, who wound no spring of this model: the way until here is none.
            let [compensation_mm, ..] = state.compensation_mm;
            state.running = 1;
            self.hang(state);
            state.far_mm = ahead.far.position_mm;
            state.near_mm = ahead.near.position_mm;
            state.motor_mm = ahead.here.position_mm + compensation_mm;
        }
        // Each part looks as far ahead as it takes until it acts: the crossing by half its time, the filter by its delay.
        let (gap_mm, gap_mm_s2) = self.cross_gap(state, &ahead.far, belief);
        let contact_n_per_s2 = self.carry(state, &ahead.near, belief);
        let (learned_mm, learned_nm) = self.load_trained(state, &ahead.here, learned);

        let modelled_mm = gap_mm + state.contact_n / self.stiffness_n_per_m * 1e3;
        let compensation_mm = if self.parts.compensation {
            modelled_mm + learned_mm
        } else {
            0.0
        };
        let motor_mm = ahead.here.position_mm + compensation_mm;
        let motor_travel_mm = motor_mm - state.motor_mm;
        state.motor_mm = motor_mm;
        let motor_mm_s = motor_travel_mm / self.scan_s;
        // The motor rubs along its own way, compensation included: while it crosses the gap, the table stands.
        let motor_friction_n = self.motor_friction.update(
            &mut state.motor_n,
            motor_travel_mm,
            motor_mm_s,
            &belief.level,
        );
        let force_n = self.force_n(state, ahead, motor_mm_s, motor_friction_n);
        // The drive holds the torque over the scan: the mean of both ends does the work that is asked for in it.
        let mean_n = 0.5 * (force_n + state.force_n);
        state.force_n = force_n;
        // The compensation's own acceleration, from its parts: a difference of differences would be noise.
        let own_m_s2 = gap_mm_s2 * 1e-3 + contact_n_per_s2 / self.stiffness_n_per_m;
        let own_n = if self.parts.compensation && self.parts.acceleration {
            self.motor_mass_kg * own_m_s2
        } else {
            0.0
        };

        // The model runs ahead of the position command, which is compared with the encoder now: it gets what was due then. A lead
        // between two scans is met between their compensations.
        state.compensation_mm.rotate_right(1);
        let [now, .., first] = &mut state.compensation_mm;
        *now = compensation_mm;
        let first = *first;
        let whole = libm::floor(self.lead_scans);
        let part = self.lead_scans - whole;
        let history = &state.compensation_mm;
        let at = |index: f64| history.get(index as usize).copied().unwrap_or(first);
        Wanted {
            compensation_mm: (1.0 - part) * at(whole) + part * at(whole + 1.0),
            velocity_mm_s: (at(self.velocity_delay_scans) - at(self.velocity_delay_scans + 1.0))
                / self.scan_s,
            torque_nm: (mean_n + own_n) * self.radius_m + learned_nm,
        }
    }

    /// The axis is at rest, and its motor holds it with this torque: springs, screw and gap as they then must be.
    ///
    /// After a hard stop the motor is pulled back over the last few µm, which no command tells of. All springs are moved on
    /// together, forwards or back, until they carry that torque; where the table's share of it is large enough, the table lies against
    /// the side that it points to. A torque beyond static friction (a weight hangs on the axis) changes nothing, nor does one that is not a number.
    pub fn rest_at(&self, state: &mut InverseDynamicsState, torque_nm: f64, belief: &Belief) {
        let level = &belief.level;
        let wanted_n = torque_nm / self.radius_m;
        let moved = |travel_mm: f64| {
            let (mut motor_n, mut table_n) = (state.motor_n, state.table_n);
            let motor = &self.motor_friction;
            let table = &self.table_friction;
            let on_motor_n = motor.update(&mut motor_n, travel_mm, 0.0, level);
            let contact_n = table.update(&mut table_n, travel_mm, 0.0, level);
            (on_motor_n + contact_n, contact_n, motor_n, table_n)
        };
        let (mut low_mm, mut high_mm) = (-REST_TRAVEL_MM, REST_TRAVEL_MM);
        // Springs carry more the further they are wound, so the torque is found by halving; beyond both ends no winding carries it.
        let carried = moved(low_mm).0 <= wanted_n && wanted_n <= moved(high_mm).0;
        if !self.parts.friction || !carried {
            return;
        }
        for _ in 0..REST_HALVINGS {
            let middle_mm = 0.5 * (low_mm + high_mm);
            if moved(middle_mm).0 < wanted_n {
                low_mm = middle_mm;
            } else {
                high_mm = middle_mm;
            }
        }
        let (force_n, contact_n, motor_n, table_n) = moved(0.5 * (low_mm + high_mm));
        self.hang(state);
        let before_mm = self.screw_mm(state, belief);
        state.motor_n = motor_n;
        state.table_n = table_n;
        state.far_table_n = table_n;
        state.contact_n = contact_n;
        state.contact_n_per_s = 0.0;
        state.force_n = force_n;
        let lying_n = contact_n + self.weight_n;
        if lying_n.abs() > LYING_PART * self.table_friction.coulomb_at_n(level) {
            state.side = lying_n.signum();
            state.side_wanted = state.side;
        }
        if self.parts.compensation {
            let change_mm = self.screw_mm(state, belief) - before_mm;
            let [newest_mm, ..] = state.compensation_mm;
            state.compensation_mm = [newest_mm + change_mm; HISTORY];
        }
    }

    /// Friction that is fed forward now, at the level 1, in N: all of it, and the part that turns round late.
    pub fn friction_n(&self, state: &InverseDynamicsState, level: &Level) -> [f64; 2] {
        let [motor_n, late_motor_n] = self.motor_friction.at_level_1_n(&state.motor_n, level);
        let [table_n, late_table_n] = self.table_friction.at_level_1_n(&state.table_n, level);
        [motor_n + table_n, late_motor_n + late_table_n]
    }

    /// A table that nothing has moved yet lies where its weight pulls it.
    fn hang(&self, state: &mut InverseDynamicsState) {
        if self.weight_n != 0.0 && state.side_wanted == 0.0 {
            state.side = self.weight_n.signum();
            state.side_wanted = state.side;
        }
    }

    /// What the motor stands from the table's place by gap and wind-up, in mm.
    fn screw_mm(&self, state: &InverseDynamicsState, belief: &Belief) -> f64 {
        self.in_gap_mm(state.side, belief) + state.contact_n / self.stiffness_n_per_m * 1e3
    }

    /// Where in the gap the motor is with the table at a side of it, from −1 to 1, in mm.
    fn in_gap_mm(&self, side: f64, belief: &Belief) -> f64 {
        let u = 0.5 * (side + 1.0);
        let place = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let rests = if self.weight_n == 0.0 {
            0.5
        } else {
            0.5 + 0.5 * self.weight_n.signum()
        };
        (self.gap_mm + belief.gap_mm) * (place - rests)
    }

    /// Where in the gap the motor is, in mm, and its acceleration, in mm/s².
    fn cross_gap(
        &self,
        state: &mut InverseDynamicsState,
        far: &Motion,
        belief: &Belief,
    ) -> (f64, f64) {
        let level = &belief.level;
        let travel_mm = far.position_mm - state.far_mm;
        state.far_mm = far.position_mm;
        let friction_n =
            self.table_friction
                .update(&mut state.far_table_n, travel_mm, far.velocity_mm_s, level);
        let contact_n = self.contact_n(far, friction_n) + belief.load_n + self.weight_n;
        // With the acceleration it is the reversal itself. Against it (friction rises as the table slows down) the motor would
        // cross for a moment and back: only a force that lasts is worth it.
        let lasting_n = BACK_PART * self.table_friction.coulomb_at_n(level);
        let with_acceleration = contact_n * far.acceleration_mm_s2 > 0.0;
        if contact_n != 0.0 && (with_acceleration || contact_n.abs() > lasting_n) {
            state.side_wanted = if contact_n > 0.0 { 1.0 } else { -1.0 };
        }
        // From side to side (2) in the time of a traversal; one that is called back on the way turns round where it is.
        let step = 2.0 * self.scan_s / self.traversal_s;
        let before = state.side;
        state.side += (state.side_wanted - before).max(-step).min(step);
        let rate_per_s = 0.5 * (state.side - before) / self.scan_s;
        let u = 0.5 * (state.side + 1.0);
        let bend = u * (60.0 - 180.0 * u + 120.0 * u * u);
        (
            self.in_gap_mm(state.side, belief),
            (self.gap_mm + belief.gap_mm) * bend * rate_per_s * rate_per_s,
        )
    }

    /// Contact force behind its filter, critically damped, exact for an input that is held over a scan; the rate of its rate.
    fn carry(&self, state: &mut InverseDynamicsState, near: &Motion, belief: &Belief) -> f64 {
        let level = &belief.level;
        let travel_mm = near.position_mm - state.near_mm;
        state.near_mm = near.position_mm;
        let friction_n =
            self.table_friction
                .update(&mut state.table_n, travel_mm, near.velocity_mm_s, level);
        let wanted_n = self.contact_n(near, friction_n);
        // In closed form: a difference equation would ring where the bandwidth comes near the scan rate.
        let decay = libm::exp(-self.smoothing_rad_s * self.scan_s);
        let off_n = state.contact_n - wanted_n;
        let slope = state.contact_n_per_s + self.smoothing_rad_s * off_n;
        let left_n = (off_n + slope * self.scan_s) * decay;
        let rate = slope * decay - self.smoothing_rad_s * left_n;
        let rate_of_rate = (rate - state.contact_n_per_s) / self.scan_s;
        state.contact_n = wanted_n + left_n;
        state.contact_n_per_s = rate;
        rate_of_rate
    }

    /// What was learned of this place: on the position, in mm, and on the torque, in N·m.
    fn load_trained(
        &self,
        state: &mut InverseDynamicsState,
        here: &Motion,
        learned: Option<&LearnedTable>,
    ) -> (f64, f64) {
        // A reversal of the command, not of the motor: what was learned stands over the table's way behind it.
        let step_mm = here.velocity_mm_s * self.scan_s;
        if step_mm * state.direction < 0.0 || (state.direction == 0.0 && step_mm != 0.0) {
            state.direction = if step_mm > 0.0 { 1.0 } else { -1.0 };
            state.distance_mm = 0.0;
        }
        state.distance_mm += step_mm.abs();
        match learned {
            Some(table) if state.direction != 0.0 => {
                let value = table.value(state.direction > 0.0, state.distance_mm);
                (value.lost_motion_mm, value.torque_nm)
            }
            _ => (0.0, 0.0),
        }
    }

    fn contact_n(&self, motion: &Motion, friction_n: f64) -> f64 {
        friction_n
            + self.table_mass_kg * motion.acceleration_mm_s2 * 1e-3
            + self.table_viscous_n_s_per_m * motion.velocity_mm_s * 1e-3
    }

    /// The parts asked for, without the compensation's own acceleration.
    fn force_n(
        &self,
        state: &InverseDynamicsState,
        ahead: &Ahead,
        motor_mm_s: f64,
        motor_friction_n: f64,
    ) -> f64 {
        let part = |wanted: bool, force_n: f64| if wanted { force_n } else { 0.0 };
        let mass_kg = self.motor_mass_kg + self.table_mass_kg;
        let viscous_n = (self.motor_viscous_n_s_per_m * motor_mm_s
            + self.table_viscous_n_s_per_m * ahead.near.velocity_mm_s)
            * 1e-3;
        // Table friction as the filter has it: contact force less its other parts.
        let carried_n = state.contact_n
            - (self.table_mass_kg * ahead.here.acceleration_mm_s2
                + self.table_viscous_n_s_per_m * ahead.here.velocity_mm_s)
                * 1e-3;
        part(
            self.parts.acceleration,
            mass_kg * ahead.here.acceleration_mm_s2 * 1e-3,
        ) + part(self.parts.viscous, viscous_n)
            + part(self.parts.friction, carried_n + motor_friction_n)
    }
}

impl InverseDynamicsState {
    /// Compensation at rest, in mm.
    pub fn compensation_at_rest_mm(&self) -> f64 {
        let [compensation_mm, ..] = self.compensation_mm;
        compensation_mm
    }

    /// The axis is moved by others from now on: its next motion starts wherever it then is.
    pub fn leave(&mut self) {
        self.running = 0;
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::panic)]
mod tests {
    use super::*;
    use crate::maxwell_slip::SlipElement;

    fn slip(coulomb_n: f64) -> MaxwellSlip {
        let mut elements = [SlipElement::default(); ELEMENTS];
        elements[0] = SlipElement {
            slip_n: coulomb_n,
            break_distance_mm: 5e-3,
        };
        MaxwellSlip {
            elements,
            static_excess: 0.3,
            stribeck_velocity_mm_s: 3.0,
        }
    }

    fn model() -> InverseDynamics {
        InverseDynamics {
            parts: Parts {
                compensation: true,
                acceleration: true,
                viscous: true,
                friction: true,
            },
            scan_s: 1e-3,
            motor_mass_kg: 758.0,
            table_mass_kg: 100.0,
            motor_viscous_n_s_per_m: 1579.0,
            table_viscous_n_s_per_m: 1000.0,
            stiffness_n_per_m: 1.2e8,
            gap_mm: 5e-3,
            traversal_s: 3e-3,
            lead_scans: 2.16,
            smoothing_rad_s: SMOOTHING_RAD_S_MAX,
            velocity_delay_scans: 0.0,
            motor_friction: slip(251.0),
            table_friction: slip(200.0),
            radius_m: 1.5915e-3,
            weight_n: 0.0,
        }
    }

    /// Runs a path given in mm over scans; what is wanted at each scan.
    fn run(model: &InverseDynamics, scans: u32, path: impl Fn(f64) -> f64) -> Vec<Wanted> {
        let motion = |at: f64| Motion {
            position_mm: path(at),
            velocity_mm_s: (path(at + 2.0) - path(at - 2.0)) / (4.0 * model.scan_s),
            acceleration_mm_s2: (path(at + 2.0) - 2.0 * path(at) + path(at - 2.0))
                / (4.0 * model.scan_s * model.scan_s),
        };
        let mut state = InverseDynamicsState::default();
        (0..scans)
            .map(|scan| {
                let scan = f64::from(scan);
                let ahead = Ahead {
                    here: motion(scan + model.lead_scans),
                    near: motion(scan + model.near_lead_scans()),
                    far: motion(scan + model.far_lead_scans()),
                };
                model.update(&mut state, &ahead, None, &Belief::TUNED)
            })
            .collect()
    }

    #[test]
    fn at_constant_speed_it_is_half_the_gap_the_wind_up_and_the_torque_of_friction() {
        let model = model();
        let found = run(&model, 500, |scan| 0.05 * scan);
        let Some(last) = found.last() else { panic!() };
        let contact_n = 200.0 + 1000.0 * 0.05;
        let wind_up_mm = contact_n / 1.2e8 * 1e3;
        assert!(
            (last.compensation_mm - (2.5e-3 + wind_up_mm)).abs() < 1e-9,
            "{last:?}"
        );
        let torque_nm = (contact_n + 251.0 + 1579.0 * 0.05) * model.radius_m;
        assert!(
            (last.torque_nm - torque_nm).abs() < 1e-6,
            "{last:?} {torque_nm}"
        );
        assert!(last.velocity_mm_s.abs() < 1e-9);
    }

    #[test]
    fn the_gap_is_crossed_once_at_every_reversal_and_without_a_jump() {
        let model = model();
        for (radius_mm, feed_mm_s) in [(10.0, 16.7), (10.0, 166.7), (25.0, 50.0), (100.0, 16.7)] {
            let angular = feed_mm_s / radius_mm * model.scan_s;
            let turns = 3.0 * core::f64::consts::TAU / angular;
            let found = run(&model, turns as u32, |scan| {
                radius_mm * libm::sin(angular * scan)
            });
            let settled = found.get((turns / 6.0) as usize..).unwrap_or_default();
            let side = |wanted: &Wanted| wanted.compensation_mm > 0.0;
            let flips = settled
                .windows(2)
                .filter(|w| side(&w[0]) != side(&w[1]))
                .count();
            assert!(
                (5..=6).contains(&flips),
                "R{radius_mm} F{feed_mm_s}: {flips} flips in 2.5 turns"
            );
            let jump_mm = settled
                .windows(2)
                .map(|w| (w[1].compensation_mm - w[0].compensation_mm).abs())
                .fold(0.0, f64::max);
            assert!(jump_mm < 4.5e-3, "R{radius_mm} F{feed_mm_s}: {jump_mm}");
        }
    }

    #[test]
    fn the_sum_of_all_velocities_it_adds_is_the_compensation() {
        let model = model();
        let found = run(&model, 4000, |scan| 25.0 * libm::sin(2e-3 * scan));
        let mut sum_mm = 0.0;
        let lead = 2;
        for (index, wanted) in found.iter().enumerate() {
            sum_mm += wanted.velocity_mm_s * model.scan_s;
            if let Some(later) = found.get(index + lead) {
                assert!((later.compensation_mm - sum_mm).abs() < 1.5e-3, "{index}");
            }
        }
    }

    #[test]
    fn parts_that_are_off_add_nothing() {
        let off = InverseDynamics {
            parts: Parts::default(),
            ..model()
        };
        let found = run(&off, 3000, |scan| 25.0 * libm::sin(2e-3 * scan));
        assert!(found.iter().all(|wanted| *wanted == Wanted::default()));
    }

    #[test]
    fn an_axis_that_others_moved_goes_on_where_it_is_without_a_jump() {
        let model = model();
        let still = |at: f64| {
            let motion = Motion {
                position_mm: at,
                ..Motion::default()
            };
            Ahead {
                here: motion,
                near: motion,
                far: motion,
            }
        };
        let mut state = InverseDynamicsState::default();
        let mut before = Wanted::default();
        for scan in 0..200 {
            before = model.update(
                &mut state,
                &still(f64::from(scan) * 0.05),
                None,
                &Belief::TUNED,
            );
        }
        state.leave();
        let after = model.update(&mut state, &still(-70.0), None, &Belief::TUNED);
        assert!((after.compensation_mm - before.compensation_mm).abs() < 1e-5);
        assert!(after.velocity_mm_s.abs() < 1.0, "{after:?}");
    }

    /// At rest after a steady motion in positive direction.
    fn at_rest(model: &InverseDynamics) -> InverseDynamicsState {
        let mut state = InverseDynamicsState::default();
        for scan in 0..300 {
            let scan = f64::from(scan).min(200.0);
            let motion = Motion {
                position_mm: 0.01 * scan,
                velocity_mm_s: if scan < 200.0 { 10.0 } else { 0.0 },
                acceleration_mm_s2: 0.0,
            };
            let ahead = Ahead {
                here: motion,
                near: motion,
                far: motion,
            };
            model.update(&mut state, &ahead, None, &Belief::TUNED);
        }
        state
    }

    #[test]
    fn at_rest_springs_and_gap_go_by_the_torque_that_holds_the_axis() {
        let model = model();
        let rest = at_rest(&model);
        for part in [-1.2, -0.6, 0.4, 1.1] {
            let mut state = rest;
            let force_n = part * 451.0;
            model.rest_at(&mut state, force_n * model.radius_m, &Belief::TUNED);
            let motor_n: f64 = state.motor_n.iter().sum();
            let found_n = state.contact_n + motor_n;
            assert!((found_n - force_n).abs() < 0.1, "{found_n} N, {force_n} N");
            assert_eq!(state.side, part.signum());
            // The compensation moves with gap and wind-up.
            let screw_mm = |state: &InverseDynamicsState| {
                0.5 * model.gap_mm * state.side + state.contact_n / model.stiffness_n_per_m * 1e3
            };
            let moved_mm = state.compensation_mm[0] - rest.compensation_mm[0];
            assert!((moved_mm - (screw_mm(&state) - screw_mm(&rest))).abs() < 1e-9);
        }
    }

    #[test]
    fn an_axis_that_was_never_moved_lies_nowhere() {
        let model = model();
        let mut state = InverseDynamicsState::default();
        model.rest_at(&mut state, 0.01 * 451.0 * model.radius_m, &Belief::TUNED);
        assert_eq!((state.side, state.side_wanted), (0.0, 0.0));
    }

    #[test]
    fn a_torque_that_friction_cannot_hold_says_nothing_of_it() {
        let model = model();
        let rest = at_rest(&model);
        for force_n in [700.0, -700.0, f64::NAN, f64::INFINITY] {
            let mut state = rest;
            model.rest_at(&mut state, force_n * model.radius_m, &Belief::TUNED);
            assert_eq!(state, rest);
        }
    }
}
