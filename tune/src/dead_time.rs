//! The dead time of the drives: found from strokes, told, and reckoned with from then on.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::Context;
use console::exit::{Failure, Kind};
use console::output::say;
use machine::{Machine, replace_file};
use toml_edit::DocumentMut;

use super::identify::dead_time::{DriveClock, scans};
use super::keep;
use super::recording::Recording;
use super::write::set_in;

/// What may be set, in scans.
const SCANS: std::ops::RangeInclusive<f64> = 1.0..=8.0;
/// Largest error of what is found, in scans: nearer to a whole number it is that number.
const ERROR_SCANS: f64 = 0.2;

/// The dead time of each drive of a machine.
#[derive(Debug, Clone, PartialEq)]
pub struct DeadTime {
    /// What the machine file has, in scans.
    pub configured: u32,
    /// What its motion shows, axis by axis, in scans with fractions; none where it does not tell.
    pub found: Vec<Option<f64>>,
}

impl DeadTime {
    /// From recordings of strokes, each of all axes, made with the commands of this machine.
    pub fn find(configured: u32, machine: &Machine, strokes: &[Vec<Recording>]) -> DeadTime {
        let of_axis = |(index, axis): (usize, &machine::Axis)| {
            let of_axis: Vec<&Recording> =
                strokes.iter().filter_map(|all| all.get(index)).collect();
            scans(&of_axis, &DriveClock::of(axis))
        };
        DeadTime {
            configured,
            found: machine.axes.iter().enumerate().map(of_axis).collect(),
        }
    }

    /// What machine file and drive files are to have: the longest of all drives, for its loop must be stable too; what they have where
    /// motion does not tell.
    pub fn whole(&self) -> u32 {
        let longest = self.found.iter().flatten().copied().reduce(f64::max);
        longest.map_or(self.configured, |scans| {
            scans.round().clamp(*SCANS.start(), *SCANS.end()) as u32
        })
    }

    /// What the laws of an axis go by, in scans.
    pub fn of_axis(&self, index: usize) -> f64 {
        let found = self.found.get(index).copied().flatten();
        let Some(scans) = found else {
            return self.whole().into();
        };
        let scans = scans.clamp(*SCANS.start(), *SCANS.end());
        if (scans - scans.round()).abs() <= ERROR_SCANS {
            scans.round()
        } else {
            (scans * 100.0).round() / 100.0
        }
    }

    /// Each axis with what was found of it.
    fn list(&self, machine: &Machine) -> String {
        let axes = machine.axes.iter().zip(&self.found);
        let axes = axes.map(|(axis, found)| match found {
            Some(scans) => format!("{} {scans:.2}", axis.name),
            None => format!("{} not known", axis.name),
        });
        axes.collect::<Vec<_>>().join(", ")
    }

    /// Says what was found, and what is right where if it is not what the files have.
    pub fn tell(&self, machine: &Machine) {
        let (configured, whole) = (self.configured, self.whole());
        let mut line = format!(
            "dead time, scans: configured {configured}; found {}",
            self.list(machine)
        );
        if whole != configured {
            line += &format!(": right is [scan] dead_time_scans = {whole} in the machine file");
            for file in drive_files(machine) {
                line += &format!(" and [scaling] dead_time_scans = {whole} in {file}");
            }
        }
        say(&line);
    }

    /// The machine that reckons with what was found, and its file; both as they are where that would be refused.
    pub fn reckoned(&self, machine: &Machine, document: &DocumentMut) -> (Machine, DocumentMut) {
        let (mut machine, mut document) = (machine.clone(), document.clone());
        let whole = self.whole();
        if whole == machine.scan.dead_time_scans {
            return (machine, document);
        }
        let mut other = document.clone();
        let why = format!("tune: {} found", self.list(&machine));
        set_in(
            &mut other,
            "scan",
            "dead_time_scans",
            i64::from(whole),
            &why,
        );
        match keep::check(&other) {
            Ok(()) => (document, machine.scan.dead_time_scans) = (other, whole),
            Err(error) => tracing::warn!("dead_time_scans stays {}: {error:#}", self.configured),
        }
        (machine, document)
    }
}

impl DriveClock {
    /// Of an axis.
    fn of(axis: &machine::Axis) -> DriveClock {
        DriveClock {
            mode: axis.drive_mode,
            speed_age_s: f64::from(axis.velocity_loop.period_us) * 1e-6,
            current_loop_s: super::laws::CURRENT_LOOP_S,
        }
    }
}

/// Names of the drive files of a machine, as its axes name them.
pub fn drive_files(machine: &Machine) -> BTreeSet<&str> {
    let files = machine.axes.iter().filter_map(|axis| axis.drive.as_ref());
    files.map(|drive| drive.file.as_str()).collect()
}

/// Writes another number into a drive file.
///
/// # Errors
/// It cannot be read or written.
pub fn write_drive_file(path: &Path, scans: u32) -> Result<(), Failure> {
    let shown = || path.display().to_string();
    let text = fs::read_to_string(path).with_context(shown).input()?;
    let mut document: DocumentMut = text.parse().with_context(shown).input()?;
    set_in(
        &mut document,
        "scaling",
        "dead_time_scans",
        i64::from(scans),
        "tune: found from motion",
    );
    replace_file(path, &document.to_string())
        .with_context(shown)
        .environment()
}
