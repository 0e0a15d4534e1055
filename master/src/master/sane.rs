//! What the master believes of a servo's command, and what it guards itself, whatever the servo says.

use bus::sample::{AxisCommand, Cause};
use loops::guards::AxisGuards;
use machine::Axis;
use path::travel::Travel;

/// A command beyond the axis's speed limit by this factor is no command: friction pulses and the position loop stay well below.
const SPEED_SANITY: f64 = 2.0;
/// Share of the following-error limit from which the loop of a slow axis makes a speed that is allowed beside that.
const SPEED_ERROR_SHARE: f64 = 0.1;
/// A position command further outside the travel than this is no command.
const POSITION_SANITY_MM: f64 = 10.0;
/// The servo's own guards go first: the master's let this much more pass.
const SECOND_GUARD: f64 = 1.25;
/// Share of the following error's limit that the feedback may be beyond the travel.
const TRAVEL_MARGIN: f64 = 0.25;

/// The master's own guards of an axis.
pub(super) fn guards(axis: &Axis) -> AxisGuards {
    let increments = |mm: f64| libm::round(mm / axis.increment_mm()) as i64;
    let [min, max] = axis.travel_increments();
    let following_error_mm = SECOND_GUARD * axis.following_error_limit_mm;
    AxisGuards {
        travel: Travel { min, max },
        travel_margin: increments(TRAVEL_MARGIN * following_error_mm),
        following_error_mm,
        speed_mm_s: SPEED_SANITY * axis.rapid_mm_s,
    }
}

/// What a command is held against.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sane<'a> {
    pub settings: &'a Axis,
    /// Where the axis is commanded to be, in increments.
    pub command_position: i64,
    pub is_homed: bool,
}

impl Sane<'_> {
    /// Whether a command is one that the drive may see; the named cause otherwise.
    pub fn judge(&self, command: &AxisCommand) -> Cause {
        let settings = self.settings;
        let error_mm = SPEED_ERROR_SHARE * settings.following_error_limit_mm;
        let loop_mm_s = settings.position_loop.gain_per_s * error_mm;
        let speed_most = SPEED_SANITY * settings.rapid_mm_s.max(loop_mm_s);
        let finite = command.velocity_mm_s.is_finite()
            && command.torque_nm.is_finite()
            && command.stop_deceleration_mm_s2.is_finite();
        let position_mm = command.position as f64 * settings.increment_mm();
        let before_mm = self.command_position as f64 * settings.increment_mm();
        let (travel_low_mm, travel_high_mm) = if self.is_homed {
            (settings.travel_min_mm, settings.travel_max_mm)
        } else {
            (before_mm, before_mm)
        };
        let low_mm = travel_low_mm.min(before_mm);
        let high_mm = travel_high_mm.max(before_mm);
        let reachable = position_mm >= low_mm - POSITION_SANITY_MM
            && position_mm <= high_mm + POSITION_SANITY_MM;
        let torque_fits = command.torque_nm.abs() <= settings.motor.peak_torque_nm;
        if !finite || !reachable || !torque_fits {
            return Cause::BadValue;
        }
        if command.velocity_mm_s.abs() > speed_most {
            return Cause::SpeedLimit;
        }
        let said = Cause::from_wire(command.cause);
        said.filter(|cause| *cause == Cause::None || cause.is_of_servo())
            .unwrap_or(Cause::BadValue)
    }
}
