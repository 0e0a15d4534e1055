//! The drive: velocity loop, torque limit, modes and its own braking.
//!
//! Commands come in mm/s at the table and N·m at the motor; inside, everything is SI and linear (`F = T/p`).

use bytemuck::{Pod, Zeroable};
use machine::BrakeBy;
use master::DriveCommand;

/// How a drive is set up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveParameters {
    /// Proportional gain Kv of the velocity loop, in N·s/m at the table.
    pub velocity_gain_n_s_per_m: f64,
    /// Integral time Ti of the velocity loop, in ms.
    pub integral_time_ms: f64,
    /// Gain of the position loop, in 1/s; of a drive that closes it.
    pub position_gain_per_s: f64,
    /// Period of its loops, in µs.
    pub period_us: u32,
    /// Torque limit, in N·m; the motor's own peak torque limits as well.
    pub torque_limit_nm: f64,
    /// Deceleration of the drive's own quick stop, in mm/s², where a command does not name one or is not a number.
    pub quick_stop_mm_s2: f64,
    /// Torque that holds the weight of the axis, in N·m, as the drive is set up; 0 where nothing hangs.
    pub weight_nm: f64,
    /// Who opens and closes the brake of the motor, where it has one.
    pub brake: Option<BrakeBy>,
}

/// The constants of [`DriveSettings::update`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveSettings {
    gain_n_s_per_m: f64,
    /// Integral gain times period, Kv/Ti·T, in N·s/m.
    integral_step_n_s_per_m: f64,
    position_gain_per_s: f64,
    count_m: f64,
    period_s: f64,
    limit_n: f64,
    quick_stop_m_s2: f64,
    per_lead_rad_m: f64,
    count_m_per_s: f64,
    weight_n: f64,
    /// The torque of the weight is there as soon as the drive is on: it opens the brake itself.
    preloads: bool,
}

const MODE_DISABLED: u32 = 0;
const MODE_VELOCITY: u32 = 1;
const MODE_TORQUE: u32 = 2;
const MODE_BRAKE: u32 = 3;

/// What a drive remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct DriveState {
    /// Encoder counts at the last period.
    pub counts: i64,
    /// Velocity from the counts of the last period, in m/s.
    pub velocity_m_s: f64,
    /// Velocity command of the last period, in m/s.
    pub command_m_s: f64,
    /// Integral part of the velocity loop, in N.
    pub integral_n: f64,
    /// Torque offset of the last period, as a force in N.
    pub offset_n: f64,
    /// Force demand after the limit, in N.
    pub demand_n: f64,
    /// Mode of the last period: 0 disabled, 1 velocity, 2 torque, 3 brake.
    pub mode: u32,
    /// 1 if the torque limit cut the last demand.
    pub limited: u32,
}

impl DriveState {
    /// Whether it brakes, and has brought its command to rest.
    pub fn holds(&self) -> bool {
        self.mode == MODE_BRAKE && self.command_m_s == 0.0
    }
}

impl DriveSettings {
    /// Prepares a drive. `radius_m` is p = lead/2π, `count_m` one encoder count as travel.
    pub fn new(
        parameters: &DriveParameters,
        peak_torque_nm: f64,
        radius_m: f64,
        count_m: f64,
    ) -> Self {
        let period_s = f64::from(parameters.period_us) * 1e-6;
        let gain_n_s_per_m = parameters.velocity_gain_n_s_per_m;
        DriveSettings {
            gain_n_s_per_m,
            integral_step_n_s_per_m: gain_n_s_per_m * period_s
                / (parameters.integral_time_ms * 1e-3),
            position_gain_per_s: parameters.position_gain_per_s,
            count_m,
            period_s,
            limit_n: parameters.torque_limit_nm.min(peak_torque_nm) / radius_m,
            quick_stop_m_s2: parameters.quick_stop_mm_s2 * 1e-3,
            per_lead_rad_m: 1.0 / radius_m,
            count_m_per_s: count_m / period_s,
            weight_n: parameters.weight_nm / radius_m,
            preloads: parameters.brake == Some(BrakeBy::Drive),
        }
    }

    /// One period of its loops: the force demand, in N, held until the next.
    ///
    /// ```text
    /// v_cmd = Kp·(x_cmd − counts·e) + v_offset where it closes the position loop;
    /// v = Δcounts·e/T;  I += Kv/Ti·T·(v_cmd − v) unless the limit cuts and the error pushes further;
    /// F = limit(Kv·(v_cmd − v) + I + offset)
    /// ```
    ///
    /// Braking ramps `v_cmd` to zero, from the command where the loop followed it and from the measured velocity where
    /// it did not (torque mode, disabled, at the torque limit); at zero the integral holds the position, since the sum
    /// of Δcounts is a position. The loop starts with the torque that was there before it. A command that is not a
    /// number brakes. First call: `counts` must hold the present encoder counts.
    pub fn update(&self, state: &mut DriveState, command: &DriveCommand, counts: i64) {
        state.velocity_m_s = counts.wrapping_sub(state.counts) as f64 * self.count_m_per_s;
        state.counts = counts;
        match *command {
            DriveCommand::Disabled => {
                *state = DriveState {
                    counts,
                    velocity_m_s: state.velocity_m_s,
                    command_m_s: state.velocity_m_s,
                    mode: MODE_DISABLED,
                    ..DriveState::default()
                };
            }
            DriveCommand::Torque { torque_nm } if torque_nm.is_finite() => {
                let free_n = torque_nm * self.per_lead_rad_m;
                state.mode = MODE_TORQUE;
                state.command_m_s = state.velocity_m_s;
                state.integral_n = 0.0;
                state.offset_n = 0.0;
                self.demand(state, free_n);
            }
            DriveCommand::Velocity {
                velocity_mm_s,
                torque_offset_nm,
            } if velocity_mm_s.is_finite() && torque_offset_nm.is_finite() => {
                self.enter_loop(state);
                self.take_offset(state, torque_offset_nm);
                state.command_m_s = velocity_mm_s * 1e-3;
                self.velocity_loop(state);
            }
            DriveCommand::Position {
                position_mm,
                velocity_offset_mm_s,
                torque_offset_nm,
            } if position_mm.is_finite()
                && velocity_offset_mm_s.is_finite()
                && torque_offset_nm.is_finite() =>
            {
                let error_m = position_mm * 1e-3 - counts as f64 * self.count_m;
                self.enter_loop(state);
                self.take_offset(state, torque_offset_nm);
                state.command_m_s =
                    self.position_gain_per_s * error_m + velocity_offset_mm_s * 1e-3;
                self.velocity_loop(state);
            }
            DriveCommand::Brake { deceleration_mm_s2 } if deceleration_mm_s2 > 0.0 => {
                self.brake(state, deceleration_mm_s2 * 1e-3);
            }
            _ => self.brake(state, self.quick_stop_m_s2),
        }
    }

    fn brake(&self, state: &mut DriveState, deceleration_m_s2: f64) {
        self.enter_loop(state);
        if state.mode == MODE_VELOCITY {
            state.integral_n = self.limit(state.integral_n + state.offset_n);
            if state.limited != 0 {
                state.command_m_s = state.velocity_m_s;
            }
        }
        state.mode = MODE_BRAKE;
        state.offset_n = 0.0;
        let slower_m_s = state.command_m_s.abs() - deceleration_m_s2 * self.period_s;
        state.command_m_s = if slower_m_s > 0.0 {
            slower_m_s.copysign(state.command_m_s)
        } else {
            0.0
        };
        self.velocity_loop(state);
    }

    /// Takes over the torque that is there when the velocity loop was open until now.
    fn enter_loop(&self, state: &mut DriveState) {
        if state.mode == MODE_DISABLED && self.preloads {
            state.integral_n = self.limit(self.weight_n);
        } else if state.mode == MODE_DISABLED || state.mode == MODE_TORQUE {
            state.integral_n = state.demand_n;
        }
    }

    /// Follows commands with this torque. Of an axis with a weight, the loop has held it until now: what the torque brings of that goes
    /// out of the integral, and the axis does not move.
    fn take_offset(&self, state: &mut DriveState, torque_offset_nm: f64) {
        state.offset_n = torque_offset_nm * self.per_lead_rad_m;
        if self.weight_n != 0.0 && state.mode != MODE_VELOCITY {
            let held_n = state.integral_n;
            state.integral_n -= state.offset_n.clamp(held_n.min(0.0), held_n.max(0.0));
        }
        state.mode = MODE_VELOCITY;
    }

    fn velocity_loop(&self, state: &mut DriveState) {
        let error_m_s = state.command_m_s - state.velocity_m_s;
        let integral_n = state.integral_n + self.integral_step_n_s_per_m * error_m_s;
        let free_n = self.gain_n_s_per_m * error_m_s + integral_n + state.offset_n;
        self.demand(state, free_n);
        if state.limited == 0 || free_n * error_m_s < 0.0 {
            state.integral_n = self.limit(integral_n);
        }
    }

    fn demand(&self, state: &mut DriveState, free_n: f64) {
        state.demand_n = self.limit(free_n);
        state.limited = u32::from(state.demand_n != free_n);
    }

    /// No number is no force.
    fn limit(&self, force_n: f64) -> f64 {
        if force_n.is_nan() {
            0.0
        } else {
            force_n.max(-self.limit_n).min(self.limit_n)
        }
    }
}
