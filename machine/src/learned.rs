//! What runs have taught about a machine: `learned.toml` beside `machine.toml`. Written by `quadrant run --learn` alone.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::{Axis, Machine, machine_file};
use crate::settings_file::{self, SettingsFileError, read_text};

/// Name of the file.
pub const LEARNED_FILE: &str = "learned.toml";
/// Version of its layout.
pub const LEARNED_VERSION: u32 = 1;
/// Cells of one direction.
pub const LEARNED_CELLS: usize = 64;
/// Largest share of the peak torque that is believed.
const TORQUE_SHARE_MAX: f64 = 0.25;
/// Largest lost motion that is believed, in µm.
const LOST_MOTION_UM_MAX: f64 = 50.0;

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learned {
    /// [`LEARNED_VERSION`].
    pub version: u32,
    /// Name of the machine.
    pub machine: String,
    /// Its axes, those that have learned something.
    #[serde(rename = "axis", default)]
    pub axes: Vec<LearnedAxis>,
}

/// One axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnedAxis {
    /// Its letter.
    pub name: String,
    /// [`settings_hash`] of the settings it was learned with.
    pub settings: String,
    /// Passes so far.
    pub passes: u32,
    /// Hash of the program of the last pass.
    pub program: String,
    /// Root mean square of the torque near reversals that the pass before it had left uncompensated, in N·m.
    pub residual_rms_nm: f64,
    /// Friction there is over friction of the model.
    pub friction_scale: f64,
    /// Torque that the model lacks, in N·m, over the distance since a reversal to negative travel.
    pub negative_torque_nm: Vec<f64>,
    /// The same to positive travel.
    pub positive_torque_nm: Vec<f64>,
    /// Lost motion that the model lacks, in µm, after a reversal to negative travel.
    pub negative_lost_motion_um: Vec<f64>,
    /// The same to positive travel.
    pub positive_lost_motion_um: Vec<f64>,
}

/// Names what an axis's lessons depend on: loops, feed-forward, compensation, model, scan. Other settings make them void.
pub fn settings_hash(machine: &Machine, axis: &Axis) -> String {
    let text = format!(
        "{:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}",
        machine.scan.period_us,
        axis.feed_forward,
        axis.dual_feedback_ms,
        axis.lead_mm,
        axis.feedback,
        axis.drive_mode,
        axis.position_loop,
        axis.velocity_loop,
        axis.reversal,
        axis.torque_feed_forward,
        axis.disturbance_observer,
        axis.model
    );
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
        let learned: Learned = settings_file::parse(&name, &read_text(&path)?)?;
        learned.judge(&name, machine)?;
        Ok(Some(learned))
    }

    /// What this axis has learned with the settings it has now.
    pub fn of(&self, machine: &Machine, axis: &Axis) -> Option<&LearnedAxis> {
        let hash = settings_hash(machine, axis);
        self.axes
            .iter()
            .find(|known| known.name == axis.name && known.settings == hash)
    }

    /// Letters of the axes whose lessons belong to other settings: they are not used.
    pub fn outdated(&self, machine: &Machine) -> Vec<String> {
        machine
            .axes
            .iter()
            .filter(|axis| self.axes.iter().any(|known| known.name == axis.name))
            .filter(|axis| self.of(machine, axis).is_none())
            .map(|axis| axis.name.clone())
            .collect()
    }

    fn judge(&self, name: &str, machine: &Machine) -> Result<(), SettingsFileError> {
        let mut broken = Vec::new();
        let remedy = "remove the file, or run with --no-learned";
        if self.version != LEARNED_VERSION {
            broken.push(format!(
                "{name}: version = {}: must be {LEARNED_VERSION}; {remedy}",
                self.version
            ));
        }
        if self.machine != machine.name {
            broken.push(format!(
                "{name}: machine = {:?}: belongs to another machine than {:?}; {remedy}",
                self.machine, machine.name
            ));
        }
        for known in &self.axes {
            let Some(axis) = machine.axes.iter().find(|axis| axis.name == known.name) else {
                broken.push(format!(
                    "{name}: axis {}: the machine has none of that name; {remedy}",
                    known.name
                ));
                continue;
            };
            let torque_max = TORQUE_SHARE_MAX * axis.motor.peak_torque_nm;
            for (key, values, most, unit) in [
                (
                    "negative_torque_nm",
                    &known.negative_torque_nm,
                    torque_max,
                    "N·m",
                ),
                (
                    "positive_torque_nm",
                    &known.positive_torque_nm,
                    torque_max,
                    "N·m",
                ),
                (
                    "negative_lost_motion_um",
                    &known.negative_lost_motion_um,
                    LOST_MOTION_UM_MAX,
                    "µm",
                ),
                (
                    "positive_lost_motion_um",
                    &known.positive_lost_motion_um,
                    LOST_MOTION_UM_MAX,
                    "µm",
                ),
            ] {
                if values.len() != LEARNED_CELLS {
                    broken.push(format!(
                        "{name}: axis {} {key}: has {} values, must have {LEARNED_CELLS}; {remedy}",
                        known.name,
                        values.len()
                    ));
                }
                if let Some(value) = values
                    .iter()
                    .find(|value| value.is_nan() || value.abs() > most)
                {
                    broken.push(format!(
                        "{name}: axis {} {key}: {value} {unit}: must be within ±{most} {unit}; {remedy}",
                        known.name
                    ));
                }
            }
            if !(0.1..=10.0).contains(&known.friction_scale) {
                broken.push(format!(
                    "{name}: axis {} friction_scale = {}: must be 0.1 to 10; {remedy}",
                    known.name, known.friction_scale
                ));
            }
        }
        if broken.is_empty() {
            Ok(())
        } else {
            Err(SettingsFileError::Broken(broken))
        }
    }

    /// The text of the file.
    pub fn text(&self) -> String {
        let mut text = format!(
            "# What `quadrant run --learn` taught about machine {}. It is used while the settings of an axis stay as they were;\n\
             # remove the file, or run with --no-learned, to go without it (docs/methods/learned-compensation.md).\n\n",
            self.machine
        );
        let body = toml::to_string(self).unwrap_or_default();
        let _ = write!(text, "{body}");
        text
    }
}
