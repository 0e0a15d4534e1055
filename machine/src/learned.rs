//! What runs have shown of a machine: `learned.toml` beside `machine.toml`. Written by `quadrant run --learn` alone.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::axis::{Axis, DriveMode, PositionFeedback};
use crate::load::machine_file;
use crate::loops::{FeedForward, PositionLoop, VelocityLoop};
use crate::machine::Machine;
use crate::model::{Adaptation, AxisModel, DisturbanceObserver, TorqueFeedForward};
use crate::reversal::Reversal;
use crate::settings_file::{self, Rules, SettingsFileError, read_text};

/// Name of the file.
pub const LEARNED_FILE: &str = "learned.toml";
/// Version of its layout and of [`settings_hash`].
pub const LEARNED_VERSION: u32 = 4;
/// Cells of one direction.
pub const LEARNED_CELLS: usize = 64;
/// Largest share of the peak torque that is believed.
const TORQUE_SHARE_MAX: f64 = 0.25;
/// Largest lost motion that is believed, in µm.
const LOST_MOTION_UM_MAX: i32 = 50;

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Learned {
    /// [`LEARNED_VERSION`].
    pub version: u32,
    /// Name of the machine.
    pub machine: String,
    /// Its axes, those that have learned something.
    #[serde(rename = "axis")]
    #[schemars(extend("default" = []))]
    pub axes: Vec<LearnedAxis>,
}

/// One axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LearnedAxis {
    /// Its letter.
    pub name: String,
    /// [`settings_hash`] of the settings it was learned with.
    pub settings: String,
    /// Passes so far.
    pub passes: u32,
    /// Hash of the program that it learns from.
    pub program: String,
    /// Root mean square of the torque near reversals that the best pass of that program left uncompensated.
    #[schemars(extend("unit" = "N·m", "minimum" = 0))]
    pub residual_rms_nm: f64,
    /// What was on trial was worse: the program teaches nothing more.
    #[schemars(extend("default" = false))]
    pub settled: bool,
    /// What the best pass left of error at its reversals, by the scale; none where there is none.
    pub contour: Option<LearnedContour>,
    /// What it has learned, and a pass has shown to be no worse.
    pub table: LearnedPass,
    /// What the next pass of that program tries.
    pub trial: Option<LearnedPass>,
}

/// What a pass left of error near the reversals of an axis, by the scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LearnedContour {
    /// Largest distance from the path in a reversal, mean over all of them.
    #[schemars(extend("unit" = "µm", "minimum" = 0))]
    pub mean_um: f64,
    /// The largest of them.
    #[schemars(extend("unit" = "µm", "minimum" = 0))]
    pub worst_um: f64,
}

/// What one axis has learned by a pass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LearnedPass {
    /// Friction there is over friction of the model.
    #[schemars(extend("minimum" = 0.1, "maximum" = 10))]
    pub friction_scale: f64,
    /// Torque that the model lacks, over the distance since a reversal to negative travel.
    #[schemars(length(equal = LEARNED_CELLS), extend("unit" = "N·m"))]
    pub negative_torque_nm: Vec<f64>,
    /// The same to positive travel.
    #[schemars(length(equal = LEARNED_CELLS), extend("unit" = "N·m"))]
    pub positive_torque_nm: Vec<f64>,
    /// Lost motion that the model lacks, after a reversal to negative travel.
    #[schemars(length(equal = LEARNED_CELLS), extend("unit" = "µm"), inner(range(min = -LOST_MOTION_UM_MAX, max = LOST_MOTION_UM_MAX)))]
    pub negative_lost_motion_um: Vec<f64>,
    /// The same to positive travel.
    #[schemars(length(equal = LEARNED_CELLS), extend("unit" = "µm"), inner(range(min = -LOST_MOTION_UM_MAX, max = LOST_MOTION_UM_MAX)))]
    pub positive_lost_motion_um: Vec<f64>,
}

/// The settings that what an axis has learned depends on: loops, feed-forward, compensation, model, scan.
#[derive(Debug, Serialize)]
struct Settings<'a> {
    period_us: u32,
    lead_mm: f64,
    feedback: PositionFeedback,
    dual_feedback_ms: f64,
    drive_mode: DriveMode,
    position_loop: &'a PositionLoop,
    velocity_loop: &'a VelocityLoop,
    feed_forward: &'a FeedForward,
    reversal: &'a Reversal,
    torque_feed_forward: &'a TorqueFeedForward,
    adaptation: &'a Adaptation,
    disturbance_observer: &'a DisturbanceObserver,
    model: &'a Option<AxisModel>,
}

/// Names the settings that what an axis has learned depends on, by keys and values as the machine file has them, defaults included.
/// With other settings it is not used. A key that is renamed, added or taken away changes the name: raise [`LEARNED_VERSION`] then,
/// for files from before cannot be told from those of other settings.
pub fn settings_hash(machine: &Machine, axis: &Axis) -> String {
    let settings = Settings {
        period_us: machine.scan.period_us,
        lead_mm: axis.lead_mm,
        feedback: axis.feedback,
        dual_feedback_ms: axis.dual_feedback_ms,
        drive_mode: axis.drive_mode,
        position_loop: &axis.position_loop,
        velocity_loop: &axis.velocity_loop,
        feed_forward: &axis.feed_forward,
        reversal: &axis.reversal,
        torque_feed_forward: &axis.torque_feed_forward,
        adaptation: &axis.adaptation,
        disturbance_observer: &axis.disturbance_observer,
        model: &axis.model,
    };
    // Numbers and words alone, which JSON always has.
    let text = serde_json::to_string(&settings).unwrap_or_default();
    format!("{:016x}", xxh3_64(text.as_bytes()))
}

/// The file beside a machine file.
pub fn learned_file(machine: &Path) -> PathBuf {
    machine_file(machine).with_file_name(LEARNED_FILE)
}

impl Learned {
    /// Nothing learned yet.
    pub fn none(machine: &Machine) -> Learned {
        Learned {
            version: LEARNED_VERSION,
            machine: machine.name.clone(),
            axes: Vec::new(),
        }
    }

    /// Reads what lies beside the machine file; none if there is nothing.
    ///
    /// # Errors
    /// It cannot be read, is of another version or machine, or holds what no axis can have learned.
    pub fn beside(path: &Path, machine: &Machine) -> Result<Option<Learned>, SettingsFileError> {
        let path = learned_file(path);
        if !path.exists() {
            return Ok(None);
        }
        let name = path.display().to_string();
        Learned::parse(&name, &read_text(&path)?, machine).map(Some)
    }

    /// Checks the text of such a file; `name` is in the messages.
    fn parse(name: &str, text: &str, machine: &Machine) -> Result<Learned, SettingsFileError> {
        let judge = |rules: &mut Rules<'_>, learned: &Learned| learned.judge(rules, machine);
        settings_file::load(name, text, &[], judge).map_err(|error| match error {
            SettingsFileError::Broken(lines) => {
                let remedy = |line| format!("{line}; remove the file, or run with --no-learned");
                SettingsFileError::Broken(lines.into_iter().map(remedy).collect())
            }
            unreadable => unreadable,
        })
    }

    /// What this axis has learned with the settings it has now.
    pub fn of(&self, machine: &Machine, axis: &Axis) -> Option<&LearnedAxis> {
        let hash = settings_hash(machine, axis);
        self.axes
            .iter()
            .find(|known| known.name == axis.name && known.settings == hash)
    }

    /// Letters of the axes that have learned with other settings: that is not used.
    pub fn outdated(&self, machine: &Machine) -> Vec<String> {
        machine
            .axes
            .iter()
            .filter(|axis| self.axes.iter().any(|known| known.name == axis.name))
            .filter(|axis| self.of(machine, axis).is_none())
            .map(|axis| axis.name.clone())
            .collect()
    }

    /// What a pass of this program runs with: what is on trial in place of what has been shown to be good.
    pub fn on_trial(&self, program: &str) -> Learned {
        let mut learned = self.clone();
        for axis in &mut learned.axes {
            if let Some(trial) = axis.trial.take().filter(|_| axis.program == program) {
                axis.table = trial;
            }
        }
        learned
    }

    fn judge(&self, rules: &mut Rules<'_>, machine: &Machine) {
        if self.version != LEARNED_VERSION {
            let what = format!("= {}: must be {LEARNED_VERSION}", self.version);
            rules.say(&["version"], None, &what);
        }
        if self.machine != machine.name {
            let (of, name) = (&self.machine, &machine.name);
            let what = format!("= {of:?}: belongs to another machine than {name:?}");
            rules.say(&["machine"], None, &what);
        }
        for (index, known) in self.axes.iter().enumerate() {
            let at = Some((index, known.name.as_str()));
            let Some(axis) = machine.axes.iter().find(|axis| axis.name == known.name) else {
                let what = format!("= {:?}: the machine has none of that name", known.name);
                rules.say(&["name"], at, &what);
                continue;
            };
            let most_nm = TORQUE_SHARE_MAX * axis.motor.peak_torque_nm;
            for (of, learned) in [
                ("table", Some(&known.table)),
                ("trial", known.trial.as_ref()),
            ] {
                let columns = learned.map(|of| {
                    [
                        ("negative_torque_nm", &of.negative_torque_nm),
                        ("positive_torque_nm", &of.positive_torque_nm),
                    ]
                });
                for (key, torques_nm) in columns.into_iter().flatten() {
                    for torque_nm in torques_nm {
                        rules.between(&[of, key], at, *torque_nm, "N·m", -most_nm, most_nm);
                    }
                }
            }
        }
    }

    /// The text of the file.
    pub fn text(&self) -> String {
        let mut text = format!(
            "# What `quadrant run --learn` found of machine {}. It is used while the settings of an axis stay as they were;\n\
             # remove the file, or run with --no-learned, to go without it (docs/methods/learned-compensation.md).\n\n",
            self.machine
        );
        let body = toml::to_string(self).unwrap_or_default();
        let _ = write!(text, "{body}");
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Files that were written before are not used any more when this changes: raise [`LEARNED_VERSION`] then.
    #[test]
    fn the_name_of_the_settings_of_an_axis_stays_what_it_is() {
        let text = r#"
            name = "hash"
            scan = { period_us = 1000, interpolation_period_scans = 8 }
            [[axis]]
            name = "X"
            travel_min_mm = -10.0
            travel_max_mm = 10.0
            rapid_mm_s = 250.0
            acceleration_mm_s2 = 5000.0
            quick_stop_mm_s2 = 12000.0
            following_error_limit_mm = 2.0
            lead_mm = 10.0
            motor = { rated_torque_nm = 8.0, peak_torque_nm = 32.0 }
            position_loop = { gain_per_s = 50.0 }
            velocity_loop = { gain_n_s_per_m = 259400.0, integral_time_ms = 10.0, period_us = 250 }
            reversal = { method = "friction-pulse", pulse_mm_s = 3.48, pulse_ms = 10.0 }
        "#;
        let machine = Machine::parse("m.toml", text).unwrap();
        let hash = settings_hash(&machine, &machine.axes[0]);
        assert_eq!((LEARNED_VERSION, hash.as_str()), (4, "1f6f209f8540aec5"));
        let mut other = machine.clone();
        other.axes[0].reversal.pulse_ms = 11.0;
        assert_ne!(settings_hash(&other, &other.axes[0]), hash);
        other = machine.clone();
        other.axes[0].rapid_mm_s = 100.0;
        assert_eq!(settings_hash(&other, &other.axes[0]), hash);
    }
}
