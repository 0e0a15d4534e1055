//! The machine file: what the controller knows of its machine.
//!
//! `machine.toml` is read once, checked whole before anything starts, and shared by every process of the cell. What is
//! true of the simulated machine stands in `plant.toml`, which only the master reads.
//!
//! Slides are in mm. Rotary axes use the same keys with degrees in place of millimetres (`rapid_mm_s` is degrees per
//! second there): they share the code of slides. What forces and masses mean there: docs/methods/pivot-axis.md.

use std::path::{Path, PathBuf};

use serde::Deserialize;

mod interpolation;
mod kinematics;
pub mod learned;
pub mod model;
mod positioning;
mod prediction;
mod restart;
mod rules;
pub mod settings_file;

pub use interpolation::{Interpolation, Rows, StraightLines};
pub use kinematics::{Carries, Kinematics, KinematicsKind};
pub use model::{AxisModel, DisturbanceObserver, TorqueFeedForward};
pub use positioning::{Positioning, RapidProfile};
pub use prediction::{PREDICTION_M_MAX, PREDICTION_M_MIN, Prediction};
pub use restart::{AfterLoss, AfterMaster, AfterMonitor, Restart};

use bus::sample::MAX_AXES;
use bus::service::Shape;

use crate::settings_file::{SettingsFileError, read_text};

/// The whole machine file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// The machine's name, and the cell's unless `--cell` says otherwise.
    pub name: String,
    /// The scan.
    pub scan: Scan,
    /// Path and program settings.
    #[serde(default)]
    pub program: ProgramSettings,
    /// How single rapids are travelled.
    #[serde(default)]
    pub positioning: Positioning,
    /// How rows of setpoints are made.
    #[serde(default)]
    pub interpolation: Interpolation,
    /// How the axes carry the tool; none where they are the program's X, Y, Z ….
    pub kinematics: Option<Kinematics>,
    /// Motion off the path.
    #[serde(default)]
    pub manual: Manual,
    /// What follows when a process is lost.
    #[serde(default)]
    pub restart: Restart,
    /// Its axes, at most [`MAX_AXES`].
    #[serde(rename = "axis")]
    pub axes: Vec<Axis>,
}

/// Clocks of the cell.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scan {
    /// Scan period Tp, in µs.
    pub period_us: u32,
    /// Scans in one distribution period Ts.
    pub distribution_period_scans: u32,
    /// Scans in a row without a command after which a drive brakes by itself.
    #[serde(default = "defaults::watchdog_scans")]
    pub watchdog_scans: u32,
    /// Distribution periods of intended motion a window carries beyond its own and the commit delay.
    #[serde(default = "defaults::look_ahead_periods")]
    pub look_ahead_periods: u32,
    /// Scans at the programmed end within the in-position window before the program counts as done.
    #[serde(default = "defaults::settle_scans")]
    pub settle_scans: u32,
}

/// How programs are understood on this machine.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProgramSettings {
    /// Work offset G54 per axis, in mm: programmed zero stands there in machine coordinates.
    pub work_offset_mm: std::collections::BTreeMap<String, f64>,
}

/// Motion off the path: at reduced speeds, because nobody planned it. Axes that are slower anyway keep their own limit.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Manual {
    /// Speed of a jog, in mm/s.
    pub jog_mm_s: f64,
    /// Speed at which a resumed program returns to where its path was left, in mm/s along the straight line there.
    pub return_mm_s: f64,
}

impl Default for Manual {
    fn default() -> Self {
        Manual {
            jog_mm_s: 10.0,
            return_mm_s: 20.0,
        }
    }
}

/// How an axis changes over to its second, manual controller (docs/methods/two-controllers.md).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Changeover {
    /// The first controller's error after the second has settled is its steady deviation: what the motor drifted stays
    /// in it.
    #[default]
    SettledDeviation,
    /// The motor is first brought back to where it stood before the switch.
    ReturnToStand,
}

/// Slide or rotary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum AxisKind {
    /// A slide: mm.
    #[default]
    Linear,
    /// A rotary axis: degrees.
    Rotary,
}

/// Where the servo's position comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum PositionFeedback {
    /// Motor encoder: semi-closed loop.
    #[default]
    Motor,
    /// Linear scale: full-closed loop.
    Scale,
}

/// Who closes the velocity loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum DriveMode {
    /// The drive (CiA 402 cyclic synchronous velocity with torque offset).
    #[default]
    Velocity,
    /// The servo (CiA 402 cyclic synchronous torque).
    Torque,
}

/// One axis.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// Its letter in part programs: X Y Z A B C U V W.
    pub name: String,
    /// Slide or rotary.
    #[serde(default)]
    pub kind: AxisKind,
    /// Increment on the wire, in nm (µdeg·10⁻³… of rotary axes: 1 stands for 10⁻⁶ axis units).
    #[serde(default = "defaults::increment_nm")]
    pub increment_nm: f64,
    /// Travel limits in machine coordinates, in mm.
    pub travel_min_mm: f64,
    /// Upper one.
    pub travel_max_mm: f64,
    /// Highest speed, in mm/s; also the rapid traverse.
    pub rapid_mm_s: f64,
    /// Highest acceleration of a setpoint, in mm/s².
    pub acceleration_mm_s2: f64,
    /// Highest deceleration the drive uses when it brakes by itself, in mm/s².
    pub quick_stop_mm_s2: f64,
    /// Following error that trips the axis, in mm.
    pub following_error_limit_mm: f64,
    /// In-position window, in µm.
    #[serde(default = "defaults::in_position_um")]
    pub in_position_um: f64,
    /// Travel of the table per motor turn, in mm.
    pub lead_mm: f64,
    /// Where the position comes from.
    #[serde(default)]
    pub feedback: PositionFeedback,
    /// With a scale: time constant, in ms, below which the motor encoder is believed rather than the scale.
    #[serde(default)]
    pub dual_feedback_ms: f64,
    /// Who closes the velocity loop.
    #[serde(default)]
    pub drive_mode: DriveMode,
    /// The motor's rating plate.
    pub motor: Motor,
    /// What it has to move, for the methods that reckon with torque.
    #[serde(default)]
    pub model: Option<AxisModel>,
    /// Position loop.
    pub position_loop: PositionLoop,
    /// Velocity loop, of the drive or of the servo.
    pub velocity_loop: VelocityLoop,
    /// Velocity feed-forward.
    #[serde(default)]
    pub feed_forward: FeedForward,
    /// Prediction of the feedback position; none is off.
    pub prediction: Option<Prediction>,
    /// What is done where the axis reverses.
    pub reversal: Reversal,
    /// Torque fed forward from them.
    #[serde(default)]
    pub torque_feed_forward: TorqueFeedForward,
    /// Disturbance observer.
    #[serde(default)]
    pub disturbance_observer: DisturbanceObserver,
    /// How it changes over between its controllers.
    #[serde(default)]
    pub changeover: Changeover,
    /// A second servo stands by, in the same state to the bit, and takes over in the scan in which the first is silent.
    #[serde(default)]
    pub standby: bool,
}

/// Rating plate.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Continuous torque, in N·m.
    pub rated_torque_nm: f64,
    /// Peak torque, in N·m.
    pub peak_torque_nm: f64,
}

/// Position loop.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionLoop {
    /// Kp, in 1/s.
    pub gain_per_s: f64,
}

/// Velocity loop.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocityLoop {
    /// Proportional gain Kv, in N·s/m at the table.
    pub gain_n_s_per_m: f64,
    /// Integral time Ti, in ms.
    pub integral_time_ms: f64,
    /// Period of the drive's loop, in µs (torque mode: the scan period).
    pub period_us: u32,
}

/// Velocity feed-forward (docs/methods/overview.md §2).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeedForward {
    /// On or off.
    pub enabled: bool,
    /// Coefficient α.
    #[serde(default = "defaults::one")]
    pub coefficient: f64,
    /// How far ahead of the position command it is taken, in ms: the delay of everything behind it (transport, drive).
    #[serde(default)]
    pub advance_ms: f64,
}

impl Default for FeedForward {
    fn default() -> Self {
        FeedForward {
            enabled: true,
            coefficient: 1.0,
            advance_ms: 0.0,
        }
    }
}

/// How far reversal errors are compensated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReversalMethod {
    /// Not at all.
    None,
    /// Position backlash step only.
    Backlash,
    /// Position backlash step and backlash acceleration (docs/methods/overview.md §2).
    Kick,
    /// Position backlash crossed when the contact force that `[axis.model]` predicts changes sign (docs/methods/overview.md §8).
    ContactForce,
}

/// What starts the kick (docs/methods/backlash-acceleration.md).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Trigger {
    /// Change of sign of the position error.
    PositionError,
    /// Change of sign of the feed-forward.
    FeedForward,
    /// Change of sign of the velocity command, Kp·ε + FF.
    VelocityCommand,
    /// The source's own: the speed command within A = K·|R2 − R0| of its sign change.
    #[default]
    CommandAcceleration,
}

impl Trigger {
    /// The word in machine files and reports.
    pub fn word(self) -> &'static str {
        match self {
            Trigger::PositionError => "position-error",
            Trigger::FeedForward => "feed-forward",
            Trigger::VelocityCommand => "velocity-command",
            Trigger::CommandAcceleration => "command-acceleration",
        }
    }
}

/// How much of Kp·ε the start of a kick by [`Trigger::CommandAcceleration`] is judged by, beside the speed of the command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum PositionErrorPart {
    /// None: the start depends on the command alone.
    #[default]
    None,
    /// As much as moves the start by half the lead at most.
    Clamped,
    /// All of it, as in the source.
    Full,
}

/// Form of the kick; the same area whatever the form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum KickShape {
    /// The source's own: `kick_mm_s` for `kick_ms`.
    #[default]
    Constant,
    /// Follows friction as it turns round over `presliding_um`, from at most `kick_mm_s` decaying with `kick_ms`.
    Decaying,
}

impl KickShape {
    /// The word in machine files and reports.
    pub fn word(self) -> &'static str {
        match self {
            KickShape::Constant => "constant",
            KickShape::Decaying => "decaying",
        }
    }
}

/// Reversal compensation.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reversal {
    /// How much of it.
    pub method: ReversalMethod,
    /// Position backlash compensation, in µm.
    #[serde(default)]
    pub backlash_um: f64,
    /// What starts the kick.
    #[serde(default)]
    pub trigger: Trigger,
    /// How much of Kp·ε `command-acceleration` is judged by.
    #[serde(default)]
    pub position_error_part: PositionErrorPart,
    /// Form of the kick.
    #[serde(default)]
    pub shape: KickShape,
    /// Height of the kick, in mm/s.
    #[serde(default)]
    pub kick_mm_s: f64,
    /// Its length Tb, in ms; of a decaying one its decay time τ.
    #[serde(default)]
    pub kick_ms: f64,
    /// Distance on which friction turns round by 63 %, in µm; 0 turns it at once. Of decaying kicks only.
    #[serde(default)]
    pub presliding_um: f64,
    /// How long before the reversal of the command it starts, in ms; K = lead/(2·Ts²).
    #[serde(default)]
    pub lead_ms: f64,
}

mod defaults {
    pub fn watchdog_scans() -> u32 {
        4
    }
    pub fn look_ahead_periods() -> u32 {
        2
    }
    pub fn settle_scans() -> u32 {
        100
    }
    pub fn increment_nm() -> f64 {
        1.0
    }
    pub fn in_position_um() -> f64 {
        20.0
    }
    pub fn one() -> f64 {
        1.0
    }
}

impl Machine {
    /// Index of the axis of this letter.
    ///
    /// # Errors
    /// The machine has none; says which it has.
    pub fn axis_index(&self, letter: &str) -> Result<u32, String> {
        let index = self.axes.iter().position(|axis| axis.name == letter);
        index.map(|index| index as u32).ok_or_else(|| {
            let names: Vec<&str> = self.axes.iter().map(|axis| axis.name.as_str()).collect();
            format!(
                "axis {letter:?}: the machine has none of that name; it has {}",
                names.join(" ")
            )
        })
    }

    /// What the service table needs to know of it.
    pub fn shape(&self) -> Shape {
        Shape {
            axes: self.axes.iter().map(|axis| axis.name.clone()).collect(),
            period_scans: self.scan.distribution_period_scans,
        }
    }

    /// Reads and checks a machine file; `path` is the file or its folder.
    ///
    /// # Errors
    /// Unreadable, too large, not UTF-8, not TOML, unknown key, or a value against its rule: each with file, line,
    /// value, unit and what would be right.
    pub fn load(path: &Path) -> Result<Machine, SettingsFileError> {
        let path = machine_file(path);
        Self::parse(&path.display().to_string(), &read_text(&path)?)
    }

    /// Checks the text of a machine file; `name` stands in the messages.
    ///
    /// # Errors
    /// As [`Machine::load`].
    pub fn parse(name: &str, text: &str) -> Result<Machine, SettingsFileError> {
        let machine: Machine = settings_file::parse(name, text)?;
        rules::judge(name, text, &machine)?;
        Ok(machine)
    }

    /// Scan period Tp in s.
    pub fn scan_period_s(&self) -> f64 {
        f64::from(self.scan.period_us) * 1e-6
    }

    /// Distribution period Ts in s.
    pub fn distribution_period_s(&self) -> f64 {
        self.scan_period_s() * f64::from(self.scan.distribution_period_scans)
    }

    /// Instrument samples within one scan: one every 250 µs, one where the scan is shorter.
    pub fn subsamples(&self) -> u32 {
        (self.scan.period_us / 250).max(1)
    }

    /// Rows of intended motion in a window: look-ahead, commit delay and one period.
    pub fn intended_rows(&self) -> u32 {
        self.scan.distribution_period_scans * (self.scan.look_ahead_periods + 2)
    }
}

impl AxisKind {
    /// Its unit of position.
    pub fn unit(self) -> &'static str {
        match self {
            AxisKind::Linear => "mm",
            AxisKind::Rotary => "deg",
        }
    }
}

impl Axis {
    /// Axis units per increment, in mm.
    pub fn increment_mm(&self) -> f64 {
        self.increment_nm * 1e-6
    }
}

/// The machine file that a MACHINE argument names: the file itself or `machine.toml` in a folder.
pub fn machine_file(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join("machine.toml")
    } else {
        path.to_path_buf()
    }
}

const _: () = assert!(MAX_AXES == 8);
