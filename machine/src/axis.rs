//! `[[axis]]`: one axis of the machine.

use bus::sample::{MAX_AXES, PATH_AXES};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::axis_kind::AxisKind;
use crate::fieldbus::AxisDrive;
use crate::gantry::{Gantry, SECOND_MOTOR};
use crate::geometry::AxisCompensation;
use crate::homing::{Homing, HomingMethod, INDEX_TURNS, JOG_ACCELERATION_SHARE};
use crate::loops::{FeedForward, PositionLoop, Prediction, VelocityLoop};
use crate::model::{Adaptation, AxisModel, DisturbanceObserver, TorqueFeedForward};
use crate::reversal::Reversal;
use crate::signals::LimitSwitches;
use crate::transmission::Transmission;
use crate::weight::{Brake, BrakeBy, Gravity};

/// One axis.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Axis {
    /// Its letter in part programs: up to 9 axes have one, and come first in the file. The second motor of a gantry has the letter of its
    /// axis with a 2 behind it. Axes that no program moves are called P1 to P31: they are moved [by hand](../howto/by-hand.md).
    #[schemars(extend("enum" = axis_names()))]
    pub name: String,
    /// Linear or rotary.
    #[schemars(extend("default" = "linear"))]
    pub kind: AxisKind,
    /// A rotary axis that turns without end, such as a rotary table ([what a word does](g-code.md#axes-that-turn-without-end)): it has
    /// no travel, and its places are shown from 0 to 360 degrees.
    #[schemars(extend("default" = false))]
    pub modulo: bool,
    /// Increment of positions between the processes; of a rotary axis 1 stands for 10⁻⁶ degrees.
    #[schemars(extend("unit" = "nm", "minimum" = 0.01, "maximum" = 10_000, "default" = 1.0))]
    pub increment_nm: f64,
    /// Lower end of the travel, in machine coordinates.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000, "unless" = "modulo"))]
    pub travel_min_mm: f64,
    /// Upper end of the travel, above `travel_min_mm`.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000, "unless" = "modulo"))]
    pub travel_max_mm: f64,
    /// Highest speed; also that of rapids.
    #[schemars(extend("unit" = "mm/s", "exclusiveMinimum" = 0, "maximum" = 5000))]
    pub rapid_mm_s: f64,
    /// Highest acceleration of setpoints.
    #[schemars(extend("unit" = "mm/s²", "exclusiveMinimum" = 0, "maximum" = 200_000))]
    pub acceleration_mm_s2: f64,
    /// Highest jerk of setpoints of a program ([method](../methods/smooth-motion.md)). Without it jerk is limited by the scan alone.
    #[schemars(extend("unit" = "mm/s³", "exclusiveMinimum" = 0, "maximum" = 100_000_000))]
    pub jerk_mm_s3: Option<f64>,
    /// Highest deceleration that the drive uses when it brakes by itself.
    #[schemars(extend("unit" = "mm/s²", "exclusiveMinimum" = 0, "maximum" = 500_000))]
    pub quick_stop_mm_s2: f64,
    /// Following error that trips the axis.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 100))]
    pub following_error_limit_mm: f64,
    /// In-position window.
    #[schemars(extend("unit" = "µm", "exclusiveMinimum" = 0, "maximum" = 10_000, "default" = 20.0))]
    pub in_position_um: f64,
    /// Travel of the axis in one turn of the motor.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 1000, "unless" = "transmission"))]
    pub lead_mm: f64,
    /// Screw, rack, belt or gear, in place of `lead_mm`.
    pub transmission: Option<Transmission>,
    /// Where the servo's position comes from ([method](../methods/full-closed-loop.md)).
    #[schemars(extend("default" = "motor"))]
    pub feedback: PositionFeedback,
    /// With a scale: time constant below which the motor encoder is believed rather than the scale.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub dual_feedback_ms: f64,
    /// Which loops the drive closes.
    #[schemars(extend("default" = "velocity"))]
    pub drive_mode: DriveMode,
    /// How the axis changes over between the program's controller and the one for motion by hand
    /// ([method](../methods/two-controllers.md)).
    #[schemars(extend("default" = "settled-deviation"))]
    pub changeover: Changeover,
    /// A second servo stands by, in the same state to the bit, and takes over in the scan in which the first is silent.
    #[schemars(extend("default" = false))]
    pub standby: bool,
    /// Its drive on the fieldbus; only with `[bus]`.
    pub drive: Option<AxisDrive>,
    /// How the axis finds its place after it was switched on ([how](../howto/home.md)). Without this table its encoder is absolute.
    pub homing: Option<Homing>,
    /// Switches at the ends of its travel.
    pub limit_switches: Option<LimitSwitches>,
    /// This is the second motor of an axis that two motors drive ([how](../howto/gantry.md)). Such axes come last in the file.
    pub gantry: Option<Gantry>,
    /// Errors of its screw or scale, which are corrected ([how](../howto/geometry.md)). Without this table it has none.
    pub compensation: Option<AxisCompensation>,
    /// Weight that pulls the axis ([how](../howto/vertical-axis.md)). Without this table none does.
    pub gravity: Option<Gravity>,
    /// The holding brake of its motor. Without this table it has none.
    pub brake: Option<Brake>,
    /// The motor's rating plate.
    pub motor: Motor,
    /// Position loop.
    pub position_loop: PositionLoop,
    /// Velocity loop, of the drive or of the servo.
    pub velocity_loop: VelocityLoop,
    /// Velocity feed-forward ([method](../methods/overview.md)).
    pub feed_forward: FeedForward,
    /// First-difference prediction of the feedback position ([method](../methods/prediction.md)). Without this table there is none.
    pub prediction: Option<Prediction>,
    /// What is done where the axis reverses.
    pub reversal: Reversal,
    /// What the axis has to move, as felt at the table: mass, friction and elasticity. Methods that compute torque need it; `quadrant
    /// tune` identifies it. Rotary axes use the same keys with a thousand degrees in place of the metre.
    pub model: Option<AxisModel>,
    /// Torque that is fed forward, part by part ([method](../methods/contact-force.md)).
    pub torque_feed_forward: TorqueFeedForward,
    /// How the axis follows what friction becomes ([method](../methods/adaptation.md)).
    pub adaptation: Adaptation,
    /// Disturbance observer ([method](../methods/disturbance-observer.md)).
    pub disturbance_observer: DisturbanceObserver,
}

/// Where the servo's position comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PositionFeedback {
    /// Motor encoder: semi-closed loop.
    Motor,
    /// Linear scale: full-closed loop.
    Scale,
}

/// Which loops the drive closes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DriveMode {
    /// That of the velocity (CiA 402 cyclic synchronous velocity with torque offset).
    Velocity,
    /// None but that of the current: the servo closes the others (CiA 402 cyclic synchronous torque).
    Torque,
    /// Those of position and velocity (CiA 402 cyclic synchronous position with velocity and torque offset).
    Position,
}

/// How an axis changes over to its second, manual controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Changeover {
    /// The first controller's error after the second has settled is its steady deviation: what the motor drifted stays in it.
    SettledDeviation,
    /// The motor is first brought back to where it was at rest before the switch.
    ReturnToStand,
}

/// Rating plate.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Motor {
    /// Continuous torque.
    #[schemars(extend("unit" = "N·m", "exclusiveMinimum" = 0, "maximum" = 10_000))]
    pub rated_torque_nm: f64,
    /// Peak torque, at least the continuous one.
    #[schemars(extend("unit" = "N·m", "exclusiveMinimum" = 0, "maximum" = 50_000))]
    pub peak_torque_nm: f64,
}

/// One turn of a rotary axis, in degrees.
pub const TURN_DEG: f64 = 360.0;
/// An axis that turns without end counts so far to either side, in degrees: 100,000 turns.
pub(crate) const ENDLESS_DEG: f64 = 100_000.0 * TURN_DEG;

/// Share of the travel that a search may take where the file does not say.
const SEARCH_SHARE: f64 = 1.1;

/// Letters that axes have in programs: as many as there can be axes on a path.
const LETTERS: [&str; PATH_AXES] = ["X", "Y", "Z", "A", "B", "C", "U", "V", "W"];

/// What an axis can be called.
pub fn axis_names() -> Vec<String> {
    let second = LETTERS.map(|letter| format!("{letter}{SECOND_MOTOR}"));
    let others = (1..MAX_AXES).map(|number| format!("P{number}"));
    let letters = LETTERS.map(String::from).into_iter();
    letters.chain(second).chain(others).collect()
}

/// Whether this name of an axis is one that programs know.
pub fn is_letter(name: &str) -> bool {
    name.len() == 1
}

impl Axis {
    /// A place of it as people read it: within one turn where it turns without end.
    pub fn shown(&self, place_mm: f64) -> f64 {
        if !self.modulo {
            return place_mm;
        }
        let within = place_mm.rem_euclid(TURN_DEG);
        // Just below 0 the remainder rounds to a whole turn.
        if within < TURN_DEG { within } else { 0.0 }
    }

    /// The way that a search may take as a whole: its travel, or a turn where it has none.
    pub fn range_mm(&self) -> f64 {
        if self.modulo {
            TURN_DEG
        } else {
            self.travel_max_mm - self.travel_min_mm
        }
    }

    /// Lower and upper end of its travel, in increments.
    pub fn travel_increments(&self) -> [i64; 2] {
        [self.travel_min_mm, self.travel_max_mm].map(|mm| (mm / self.increment_mm()).round() as i64)
    }

    /// Whether a program may move it from there, in increments: it stands within its travel, or outside by no more than an axis in
    /// position may be off.
    pub fn may_stand_at(&self, position: i64) -> bool {
        let [min, max] = self.travel_increments();
        let window = (self.in_position_window_um() * 1e-3 / self.increment_mm()).round() as i64;
        let outside = min
            .saturating_sub(position)
            .max(position.saturating_sub(max));
        outside <= window
    }

    /// The most that an axis in position may be off by its feedback, in µm: its window and its backlash, with what a table of errors
    /// adds to that.
    pub fn in_position_window_um(&self) -> f64 {
        let lost = self.compensation.as_ref().and_then(|of| of.lost_motion());
        let lost_um = lost.map_or(0.0, |lost| lost.largest_mm() * 1e3);
        self.in_position_um + self.reversal.backlash_um + lost_um
    }

    /// Axis units per increment, in mm.
    pub fn increment_mm(&self) -> f64 {
        self.increment_nm * 1e-6
    }

    /// Whether programs name it. Others are second motors, or are moved by hand alone.
    pub fn has_letter(&self) -> bool {
        is_letter(&self.name)
    }

    /// Whether it is the second motor of another axis.
    pub fn is_follower(&self) -> bool {
        self.gantry.is_some()
    }

    /// Where the axis goes once it is homed, in mm; none where it stays.
    pub fn rest_mm(&self) -> Option<f64> {
        let homing = self.homing?;
        let braking_mm =
            homing.search_mm_s.powi(2) / (2.0 * JOG_ACCELERATION_SHARE * self.acceleration_mm_s2);
        let clear_mm = match homing.method {
            HomingMethod::Switch => self.lead_mm + braking_mm,
            HomingMethod::SwitchIndex => (1.0 + INDEX_TURNS) * self.lead_mm + braking_mm,
            HomingMethod::Index => self.lead_mm / 2.0,
            HomingMethod::Drive => return homing.rest_mm,
        };
        let clear_mm = homing.position_mm - homing.direction.sign() as f64 * clear_mm;
        let rest_mm = clear_mm.clamp(self.travel_min_mm, self.travel_max_mm);
        Some(homing.rest_mm.unwrap_or(rest_mm))
    }

    /// Longest way of a search, in mm; 0 for an axis with an absolute encoder.
    pub fn search_distance_mm(&self) -> f64 {
        let travel_mm = self.range_mm();
        self.homing.map_or(0.0, |homing| {
            homing
                .search_distance_mm
                .unwrap_or(SEARCH_SHARE * travel_mm)
        })
    }

    /// Force with which weight pulls it towards lower positions, in N; 0 without `[axis.gravity]`.
    pub fn weight_n(&self) -> f64 {
        self.gravity.as_ref().map_or(0.0, Gravity::pull_n)
    }

    /// Torque at the motor that holds it, in N·m: F·lead/2π; 0 without `[axis.gravity]`.
    pub fn weight_nm(&self) -> f64 {
        self.weight_n() * self.lead_mm * 1e-3 / std::f64::consts::TAU
    }

    /// Its brake, where the controller opens and closes it.
    pub fn commanded_brake(&self) -> Option<&Brake> {
        let brake = self.brake.as_ref();
        brake.filter(|brake| brake.by == BrakeBy::Controller)
    }

    /// What is accepted with a remark: nothing holds it once its drive is off.
    pub fn falls(&self) -> Option<String> {
        (self.weight_n() != 0.0 && self.brake.is_none()).then(|| {
            format!(
                "axis {}: weight pulls it with {:.0} N, and it has no [axis.brake]: without power friction alone holds it",
                self.name,
                self.weight_n().abs()
            )
        })
    }

    /// Force at the table that the motor's continuous torque makes: T·2π/lead, in N.
    pub fn rated_force_n(&self) -> f64 {
        self.motor.rated_torque_nm * std::f64::consts::TAU / (self.lead_mm * 1e-3)
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use crate::machine::Machine;

    #[test]
    fn places_of_an_axis_that_turns_without_end_are_shown_within_a_turn() {
        let text = include_str!("../../machines/xy/machine.toml");
        let machine = Machine::parse("machine.toml", text).expect("the machine");
        let mut axis = machine.axes.into_iter().next().expect("an axis");
        assert_eq!(axis.shown(725.5), 725.5);
        axis.modulo = true;
        for (place, shown) in [(725.5, 5.5), (360.0, 0.0), (-10.0, 350.0), (-1e-20, 0.0)] {
            assert_eq!(axis.shown(place), shown, "{place}");
        }
    }
}
