//! Motor and table as two masses, joined by a screw with stiffness, damping and a gap.
//!
//! Inside, everything is SI and linear: the motor's inertia is the mass `J/p²` and its torque the force `T/p`, with
//! `p = lead/2π`.

use bytemuck::{Pod, Zeroable};

use crate::cutting::{CuttingState, PlantCutting};
use crate::friction::{FrictionParameters, FrictionSettings, FrictionState, PlantLaw};
use crate::holding_brake::{HoldingBrake, HoldingBrakeState};
use crate::lost_motion::{LostMotion, LostMotionState};
use crate::swinging::{Swinging, SwingingState};
use crate::variation::{Variation, VariationState};

/// Velocities and force lags below this (in m/s and N) are set to zero once per call: far below anything that moves a
/// position by its last bit, and far above the denormal numbers, whose arithmetic is a hundred times slower.
const NOTHING: f64 = 1e-30;

/// What is true of one axis' mechanics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MechanicsParameters {
    /// Motor and screw as a mass, in kg.
    pub motor_mass_kg: f64,
    /// Table, in kg.
    pub table_mass_kg: f64,
    /// Screw stiffness, in N/m.
    pub stiffness_n_per_m: f64,
    /// Screw damping, in N·s/m.
    pub damping_n_s_per_m: f64,
    /// Backlash gap, in m.
    pub gap_m: f64,
    /// Amplitude of the cogging force, in N.
    pub cogging_n: f64,
    /// Cogging periods per metre of motor travel.
    pub cogging_per_m: f64,
    /// Time constant of the current loop, in s.
    pub current_loop_s: f64,
    /// Motor-side friction.
    pub motor_friction: FrictionParameters,
    /// Table friction.
    pub table_friction: FrictionParameters,
    /// What is not as simple as that; none for nothing.
    pub beyond: Option<Beyond>,
}

/// What a machine has beside two masses, a screw and friction that stays.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Beyond {
    /// Friction that is not the same everywhere and always.
    pub variation: Variation,
    /// Hysteresis of the lost motion.
    pub lost_motion: LostMotion,
    /// A mass that swings on the table.
    pub attached: Option<Swinging>,
    /// The cut.
    pub cutting: Option<PlantCutting>,
    /// Force with which weight pulls the table towards lower positions, in N.
    pub weight_n: f64,
    /// A brake at the motor.
    pub brake: Option<HoldingBrake>,
    /// A frame that swings.
    pub frame: Option<Swinging>,
}

/// What that remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct BeyondState {
    /// Of friction.
    pub variation: VariationState,
    /// Of the lost motion.
    pub lost_motion: LostMotionState,
    /// Of the mass on the table.
    pub attached: SwingingState,
    /// Of the cut.
    pub cutting: CuttingState,
    /// Of the brake.
    pub brake: HoldingBrakeState,
    /// Of the frame.
    pub frame: SwingingState,
    /// By which share friction is higher for where other axes are.
    pub friction_share: f64,
}

/// The constants of [`MechanicsSettings::run`] for one microstep length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MechanicsSettings {
    step_s: f64,
    motor_step_s_per_kg: f64,
    table_step_s_per_kg: f64,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
    half_gap_m: f64,
    /// Motor less table where the table hangs still, in m: encoder and table agree there.
    hang_m: f64,
    cogging_n: f64,
    cogging_per_m: f64,
    current_decay: f64,
    motor_friction: FrictionSettings,
    table_friction: FrictionSettings,
    beyond: Option<Beyond>,
}

/// Where everything is and what it remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct MechanicsState {
    /// Motor position, in m of travel.
    pub motor_m: f64,
    /// Table position, in m, as all positions here from the frame.
    pub table_m: f64,
    /// Motor velocity, in m/s.
    pub motor_m_s: f64,
    /// Table velocity, in m/s.
    pub table_m_s: f64,
    /// Force of the motor behind its current loop, in N.
    pub force_n: f64,
    /// Motor-side friction.
    pub motor_friction: FrictionState,
    /// Table friction.
    pub table_friction: FrictionState,
    /// What is not as simple.
    pub beyond: BeyondState,
}

/// What the motor gave over some microsteps.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Effort {
    /// Sum of the motor force over the microsteps, in N.
    pub force_sum_n: f64,
    /// Sum of its square, in N².
    pub force_square_sum_n2: f64,
}

impl MechanicsParameters {
    /// Motor less table where the table hangs still, in m; 0 where no weight pulls it.
    fn hang_m(&self) -> f64 {
        let weight_n = self.beyond.map_or(0.0, |beyond| beyond.weight_n);
        if weight_n == 0.0 {
            return 0.0;
        }
        0.5 * self.gap_m * weight_n.signum() + weight_n / self.stiffness_n_per_m
    }
}

impl MechanicsState {
    /// Where the table is from the ground, in m.
    pub fn table_from_ground_m(&self, settings: &MechanicsSettings) -> f64 {
        match settings.beyond.as_ref().and_then(|beyond| beyond.frame) {
            Some(_) => self.table_m + self.beyond.frame.off_m,
            None => self.table_m,
        }
    }
}

impl MechanicsSettings {
    /// Prepares the mechanics for microsteps of `step_s`.
    pub fn new(parameters: &MechanicsParameters, step_s: f64) -> Self {
        MechanicsSettings {
            step_s,
            motor_step_s_per_kg: step_s / parameters.motor_mass_kg,
            table_step_s_per_kg: step_s / parameters.table_mass_kg,
            stiffness_n_per_m: parameters.stiffness_n_per_m,
            damping_n_s_per_m: parameters.damping_n_s_per_m,
            half_gap_m: 0.5 * parameters.gap_m,
            hang_m: parameters.hang_m(),
            cogging_n: parameters.cogging_n,
            cogging_per_m: parameters.cogging_per_m,
            current_decay: libm::exp(-step_s / parameters.current_loop_s),
            motor_friction: FrictionSettings::new(&parameters.motor_friction, step_s),
            table_friction: FrictionSettings::new(&parameters.table_friction, step_s),
            beyond: parameters.beyond.or_else(|| {
                let contacts = [&parameters.motor_friction, &parameters.table_friction];
                let plain = contacts
                    .iter()
                    .all(|f| f.law == PlantLaw::MaxwellSlip && f.measured.is_none());
                (!plain).then(Beyond::default)
            }),
        }
    }

    /// Force in the screw, in N, positive where it pushes the table forward; it can push but not pull across the gap.
    ///
    /// `d = x1 − x2 + hang`; `max(0, k·(d − b/2) + c·(v1 − v2))` above `b/2`, mirrored below `−b/2`, 0 between.
    #[inline]
    pub fn contact_n(&self, state: &MechanicsState) -> f64 {
        let wind_m = state.motor_m - state.table_m + self.hang_m;
        let damping_n = self.damping_n_s_per_m * (state.motor_m_s - state.table_m_s);
        let above_m = wind_m - self.half_gap_m;
        let below_m = wind_m + self.half_gap_m;
        let push_n = (self.stiffness_n_per_m * above_m + damping_n).max(0.0);
        let pull_n = (self.stiffness_n_per_m * below_m + damping_n).min(0.0);
        if above_m > 0.0 {
            push_n
        } else if below_m < 0.0 {
            pull_n
        } else {
            0.0
        }
    }

    /// Cogging force at a motor position, in N: a sine of the motor angle.
    #[inline]
    pub fn cogging_force_n(&self, motor_m: f64) -> f64 {
        self.cogging_n * sine_of_turns(motor_m * self.cogging_per_m)
    }

    /// Before a microstep: another body pushes the table with this force, in N, for one microstep.
    #[inline]
    pub fn push_table(&self, state: &mut MechanicsState, force_n: f64) {
        state.table_m_s += self.table_step_s_per_kg * force_n;
    }

    /// Runs `steps` microsteps with the force demand held: semi-implicit Euler, velocities first (docs/methods/physics.md §3).
    ///
    /// `F ← u + (F − u)·exp(−h/τI)`, `M1·v1' = F + cogging(x1) − fc − friction1(v1)`, `M2·v2' = fc − friction2(v2)`.
    /// The demand is in N and already limited. First call: at rest, without force.
    pub fn run(&self, state: &mut MechanicsState, steps: u32, demand_n: f64) -> Effort {
        let mut effort = Effort::default();
        // On a copy, so that the compiler keeps what it can in registers.
        let mut s = *state;
        if s.motor_m_s.abs() < NOTHING {
            s.motor_m_s = 0.0;
        }
        if s.table_m_s.abs() < NOTHING {
            s.table_m_s = 0.0;
        }
        if (s.force_n - demand_n).abs() < NOTHING {
            s.force_n = demand_n;
        }
        if let Some(beyond) = &self.beyond {
            self.run_beyond(beyond, &mut s, steps, demand_n, &mut effort);
            *state = s;
            return effort;
        }
        for _ in 0..steps {
            s.force_n = demand_n + (s.force_n - demand_n) * self.current_decay;
            let contact_n = self.contact_n(&s);
            let cogging_n = self.cogging_force_n(s.motor_m);
            let motor_friction_n = self
                .motor_friction
                .update(&mut s.motor_friction, s.motor_m_s);
            let table_friction_n = self
                .table_friction
                .update(&mut s.table_friction, s.table_m_s);
            s.motor_m_s +=
                self.motor_step_s_per_kg * (s.force_n + cogging_n - contact_n - motor_friction_n);
            s.table_m_s += self.table_step_s_per_kg * (contact_n - table_friction_n);
            s.motor_m += self.step_s * s.motor_m_s;
            s.table_m += self.step_s * s.table_m_s;
            effort.force_sum_n += s.force_n;
            effort.force_square_sum_n2 += s.force_n * s.force_n;
        }
        *state = s;
        effort
    }
}

impl MechanicsSettings {
    /// The microsteps of a machine that is not as simple; place, temperature and rest of friction once for all of them.
    fn run_beyond(
        &self,
        beyond: &Beyond,
        s: &mut MechanicsState,
        steps: u32,
        demand_n: f64,
        effort: &mut Effort,
    ) {
        let time_s = f64::from(steps) * self.step_s;
        let variation = &mut s.beyond.variation;
        let mut at = beyond
            .variation
            .update(variation, time_s, s.table_m, s.table_m_s);
        at.level *= 1.0 + s.beyond.friction_share;
        if let Some(brake) = &beyond.brake {
            brake.wait(&mut s.beyond.brake, time_s);
        }
        for _ in 0..steps {
            s.force_n = demand_n + (s.force_n - demand_n) * self.current_decay;
            let faster_m_s = s.motor_m_s - s.table_m_s;
            let lost_n = beyond
                .lost_motion
                .update(&mut s.beyond.lost_motion, faster_m_s);
            let contact_n = self.contact_n(s) + lost_n;
            let cogging_n = self.cogging_force_n(s.motor_m);
            let motor_friction_n =
                self.motor_friction
                    .update_at(&mut s.motor_friction, s.motor_m_s, &at);
            let table_friction_n =
                self.table_friction
                    .update_at(&mut s.table_friction, s.table_m_s, &at);
            let cutting_n = beyond.cutting.map_or(0.0, |cutting| {
                cutting.update(&mut s.beyond.cutting, self.step_s)
            });
            let attached_n = beyond.attached.map_or(0.0, |mass| {
                mass.on_table(&mut s.beyond.attached, s.table_m_s)
            });
            let held_n = beyond
                .brake
                .map_or(0.0, |brake| brake.update(&mut s.beyond.brake, s.motor_m_s));
            s.motor_m_s += self.motor_step_s_per_kg
                * (s.force_n + cogging_n - contact_n - motor_friction_n - held_n);
            s.table_m_s += self.table_step_s_per_kg
                * (contact_n + cutting_n + attached_n - table_friction_n - beyond.weight_n);
            if let Some(frame) = &beyond.frame {
                // The tool stands on the ground: what the cut does to it is not the frame's.
                let faster_m_s =
                    frame.under_table(&mut s.beyond.frame, contact_n - table_friction_n);
                s.table_m_s -= faster_m_s;
                s.beyond.attached.velocity_m_s -= faster_m_s;
            }
            s.motor_m += self.step_s * s.motor_m_s;
            s.table_m += self.step_s * s.table_m_s;
            effort.force_sum_n += s.force_n;
            effort.force_square_sum_n2 += s.force_n * s.force_n;
        }
    }
}

/// sin(2π·turns), by libm on the fraction of a turn.
#[inline]
fn sine_of_turns(turns: f64) -> f64 {
    // Adding and subtracting 1.5·2⁵² rounds to the nearest whole number, for any travel that exists.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let fraction = turns - ((turns + ROUND) - ROUND);
    libm::sin(2.0 * std::f64::consts::PI * fraction)
}
