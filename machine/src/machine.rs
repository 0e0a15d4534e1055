//! The whole machine file, its clocks, and what concerns no single axis.

use std::collections::BTreeMap;
use std::path::PathBuf;

use bus::sample::{MAX_AXES, MAX_SUBSAMPLES};
use bus::service::Shape;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::alarms::Alarm;
use crate::auxiliary::{Spindle, ToolChange};
use crate::axis::Axis;
use crate::beginning::Beginning;
use crate::dialect::{DecimalPoint, Dialect};
use crate::fieldbus::{AxisDrive, Fieldbus};
use crate::geometry::{Squareness, Straightness};
use crate::interpolation::Interpolation;
use crate::kept_files::KeptFiles;
use crate::kinematics::Kinematics;
use crate::log_keeping::LogKeeping;
use crate::logic::Logic;
use crate::manual::Manual;
use crate::parameter_file::KeptParameters;
use crate::path::PathSettings;
use crate::positioning::Positioning;
use crate::processes::Processes;
use crate::restart::Restart;
use crate::rotary_line::RotaryLine;
use crate::signals::{Functions, Signal};
use crate::tool_table::Tool;

/// The whole machine file.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Machine {
    /// The machine's name, and the cell's unless `--cell` says otherwise: lower-case letters, digits and hyphens.
    pub name: String,
    /// Clocks of the cell.
    pub scan: Scan,
    /// How programs are understood on this machine.
    pub program: ProgramSettings,
    /// How single rapids are travelled ([method](../methods/positioning.md)).
    pub positioning: Positioning,
    /// How setpoints are made.
    pub interpolation: Interpolation,
    /// How far the path that is travelled may leave the programmed one ([method](../methods/rounding.md)).
    pub path: PathSettings,
    /// How the axes carry the tool ([method](../methods/pivot-axis.md)). Without this table they are the program's X, Y, Z ….
    pub kinematics: Option<Kinematics>,
    /// Lines of the rotary axes for G43.4 ([five axes](../methods/five-axes.md)): of those that carry the work the one nearest to the bed
    /// first, of those that carry the tool the one nearest to the slides.
    #[serde(rename = "rotary_line")]
    #[schemars(extend("default" = []))]
    pub rotary_lines: Vec<RotaryLine>,
    /// Motion off the path: at reduced speeds, because nobody planned it. Axes that are slower anyway keep their own limit.
    pub manual: Manual,
    /// What follows when a process is lost ([all cases](faults.md)).
    pub restart: Restart,
    /// How the processes of the cell run in realtime ([real time](../howto/realtime.md)); in lockstep nothing of it counts.
    pub processes: Processes,
    /// What is recorded of a run ([levels](run-directory.md#levels)), and how much of the
    /// [logs of earlier runs](run-directory.md) is kept. Without a key, of cells that stay up as much as the disk has room for.
    pub log: LogKeeping,
    /// The spindle ([spindle, coolant, outputs and stops](../howto/spindle.md)). Without this table S, M3, M4, M5 and M19 are read and
    /// not acted on.
    pub spindle: Option<Spindle>,
    /// Who changes tools (M6).
    pub tool_change: ToolChange,
    /// The fieldbus that the drives are on ([how](../howto/drives.md)). Without this table they are simulated.
    pub bus: Option<Fieldbus>,
    /// Named inputs and outputs ([signals](../howto/signals.md)).
    #[serde(rename = "signal")]
    #[schemars(extend("default" = []))]
    pub signals: Vec<Signal>,
    /// Signals that the controller itself acts on.
    pub functions: Functions,
    /// Alarms of the machine ([how](../howto/signals.md#alarms)).
    #[serde(rename = "alarm")]
    #[schemars(extend("default" = []))]
    pub alarms: Vec<Alarm>,
    /// The machine's own logic, as a process ([how](../howto/logic.md)).
    pub logic: Option<Logic>,
    /// An axis: a machine has 1 to 32, each with a name of its own; the second motor of a gantry counts as one.
    #[serde(rename = "axis")]
    #[schemars(length(min = 1, max = MAX_AXES))]
    pub axes: Vec<Axis>,
    /// Angles between two axes that are no right ones, and are corrected ([how](../howto/geometry.md)); at most 16.
    #[schemars(extend("default" = []))]
    pub squareness: Vec<Squareness>,
    /// Guideways that are not straight, and are corrected; at most 16.
    #[schemars(extend("default" = []))]
    pub straightness: Vec<Straightness>,
    /// The tools that `program.tool_table` or `program.tools` names.
    #[serde(skip)]
    pub tools: Vec<Tool>,
    /// The parameters that `program.parameter_file`, `program.offsets` or `program.parameters` holds.
    #[serde(skip)]
    pub parameters: KeptParameters,
    /// The tool in the spindle, the offset that is applied and the modes that the next program begins with.
    #[serde(skip)]
    pub beginning: Beginning,
    /// The files of the user that hold what outlives a run.
    #[serde(skip)]
    pub kept_files: KeptFiles,
    /// `program.subroutine_folders`, from the folder of the file.
    #[serde(skip)]
    pub subroutine_folders: Vec<PathBuf>,
}

impl ProgramSettings {
    /// Work offset G54 of a letter, in mm or degrees; none where the file has none.
    pub fn work_offset(&self, letter: &str) -> Option<f64> {
        let of_rotary = self.work_offset_deg.get(letter);
        of_rotary.or(self.work_offset_mm.get(letter)).copied()
    }
}

/// Longest dead time of the drives, in scans.
pub const DEAD_TIME_SCANS_MAX: u32 = 8;

/// Clocks of the cell.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Scan {
    /// Scan period Tp. Above 250 it is a multiple of 250, the instruments' period.
    #[schemars(extend("unit" = "µs", "minimum" = 125, "maximum" = 250 * MAX_SUBSAMPLES))]
    pub period_us: u32,
    /// Scans in one interpolation period Ts.
    #[schemars(extend("unit" = "scans", "minimum" = 2, "maximum" = 32))]
    pub interpolation_period_scans: u32,
    /// Scans from the feedback that a command answers to the scan that it acts in: 1 for simulated drives as shipped, usually 2 to 4
    /// on a fieldbus ([dead time](../methods/dead-time.md)). The setpoints of a scan more must be known ahead.
    #[schemars(extend("unit" = "scans", "minimum" = 1, "maximum" = DEAD_TIME_SCANS_MAX, "default" = 1))]
    pub dead_time_scans: u32,
    /// Scans in a row without a command after which an axis trips. In the first three its drive holds the last command; from then
    /// on the master commands it along the window to rest, and the trip waits until it is there.
    #[schemars(extend("unit" = "scans", "minimum" = 1, "maximum" = 1000, "default" = 4))]
    pub watchdog_scans: u32,
    /// Interpolation periods of intended motion that a window carries beyond its own and the commit delay.
    #[schemars(extend("unit" = "periods", "minimum" = 1, "maximum" = 16, "default" = 2))]
    pub look_ahead_periods: u32,
    /// Scans at the programmed end within the in-position window before the program counts as done.
    #[schemars(extend("unit" = "scans", "minimum" = 1, "maximum" = 100_000, "default" = 100))]
    pub settle_scans: u32,
}

/// How programs are understood on this machine.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
pub struct ProgramSettings {
    /// Work offset G54, a key for each axis: the programmed zero in machine coordinates, within the travel of the axis.
    #[schemars(extend("additionalProperties" = {
        "type": "number", "description": "Work offset of the axis of this letter.",
        "unit": "mm", "minimum": -100_000, "maximum": 100_000, "default": 0.0
    }))]
    pub work_offset_mm: BTreeMap<String, f64>,
    /// The same of rotary axes.
    #[schemars(extend("additionalProperties" = {
        "type": "number", "description": "Work offset of the rotary axis of this letter.",
        "unit": "°", "minimum": -100_000, "maximum": 100_000, "default": 0.0
    }))]
    pub work_offset_deg: BTreeMap<String, f64>,
    /// File of the tools; a path counts from the folder of this file. One whose name ends with `.toml` is what `quadrant tool` writes; any
    /// other has the form of LinuxCNC (a line for each, such as `T1 P1 D6 Z12.5 ;end mill`, in mm). Without it `tools.toml` is used where
    /// it is there, else `tools`. Without any of them every tool can be called, and none has a length.
    #[schemars(extend("default" = ""))]
    pub tool_table: String,
    /// The tools themselves, as the text of such a file. Copies of a machine file hold the table so.
    #[schemars(extend("default" = ""))]
    pub tools: String,
    /// File of the parameters that programs keep from one run to the next ([how](program-flow.md#kept-parameters)), in the form of
    /// LinuxCNC; a path counts from the folder of this file. It need not be there yet. Without it and `parameters` each run begins
    /// with 0.
    #[schemars(extend("default" = ""))]
    pub parameter_file: String,
    /// File of the work offsets, which `quadrant offsets` and `quadrant zero` write ([how](../howto/set-up.md)); a path counts from the
    /// folder of this file. Without it and `parameters` it is `offsets.toml`. It need not be there.
    #[schemars(extend("default" = ""))]
    pub offsets: String,
    /// The parameters themselves, as the text of such a file. Copies of a machine file hold what a run began with so.
    #[schemars(extend("default" = ""))]
    pub parameters: String,
    /// Tool in the spindle, offset and modes that the program begins with, as a text; without it the tool is that of `spindle.toml`
    /// beside this file, which need not be there. Copies of a machine file hold what a run began with so.
    #[schemars(extend("default" = ""))]
    pub begins_with: String,
    /// Folders in which subroutines are looked for that a program calls and does not hold, after the program's own; paths count
    /// from the folder of this file.
    #[schemars(extend("default" = []))]
    pub subroutine_folders: Vec<String>,
    /// Folder of the programs that user M-codes run ([how](../howto/user-codes.md)): `M101` to `M199`, each an executable file; a path
    /// counts from the folder of this file. Without it a program with such a code is refused.
    #[schemars(extend("default" = ""))]
    pub user_codes: String,
    /// How long such a program may take; then it is ended, and the run stops.
    #[schemars(extend("unit" = "s", "exclusiveMinimum" = 0, "maximum" = 3600, "default" = 10.0))]
    pub user_code_patience_s: f64,
    /// Whether blocks that begin with `/` are left out (block delete).
    #[schemars(extend("default" = false))]
    pub block_delete: bool,
    /// Whether there is a touch probe: G38.2 to G38.5 are refused without ([probing](../howto/probe.md)).
    #[schemars(extend("default" = false))]
    pub probe: bool,
    /// Whether optional stops (M1) are switched on when the cell starts; the order `optional-stop` changes it.
    #[schemars(extend("default" = false))]
    pub optional_stop: bool,
    /// Language of programs and typed-in blocks: LinuxCNC's, or [Fanuc's and Haas'](fanuc.md). The option `--dialect` goes before it for
    /// one program.
    #[schemars(extend("default" = "linuxcnc"))]
    pub dialect: Dialect,
    /// What a word without a decimal point counts in programs of the dialect `fanuc`.
    #[schemars(extend("default" = "calculator"))]
    pub fanuc_decimal_point: DecimalPoint,
}

/// Fewer scans without an answer are no hang of the owner of the bus: a frame or two are late now and then.
const HANG_SCANS_MIN: u32 = 3;

impl Machine {
    /// Whether anything outlives a run of a program.
    pub fn keeps_parameters(&self) -> bool {
        !self.program.parameter_file.is_empty() || !self.program.parameters.is_empty()
    }

    /// Index of the signal of this name.
    pub fn signal(&self, name: &str) -> Option<usize> {
        self.signals.iter().position(|signal| signal.name == name)
    }

    /// Number of scans between two questions to the logic; none where the machine has none of its own.
    pub fn logic_every_scans(&self) -> Option<u64> {
        let logic = self.logic.as_ref()?;
        let period_scans = u64::from(self.scan.interpolation_period_scans);
        Some(period_scans * u64::from(logic.every_periods.max(1)))
    }

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

    /// Letter of an axis; a question mark for one that it does not have.
    pub fn axis_name(&self, axis: usize) -> &str {
        let axis = self.axes.get(axis);
        axis.map_or("?", |axis| axis.name.as_str())
    }

    /// The place on the cable of an axis's drive.
    pub fn slave_of(&self, axis: usize) -> usize {
        let drive = self.axes.get(axis).and_then(|axis| axis.drive.as_ref());
        drive
            .and_then(|drive| drive.slave)
            .map_or(axis, |slave| slave as usize)
    }

    /// Whether a drive on the bus or a signal is this digital input.
    pub fn has_digital_input(&self, number: u32) -> bool {
        let drives = self.axes.iter().filter_map(|axis| axis.drive.as_ref());
        let mut of_drives = drives.flat_map(AxisDrive::inputs);
        let mut of_signals = self.signals.iter().filter_map(|signal| signal.to.as_ref());
        of_drives.any(|(_, input)| input == number) || of_signals.any(|to| to.input == Some(number))
    }

    /// Cycles in a row without an answer after which a device on the bus is lost: by then it has stopped by itself.
    pub fn missed_cycles_max(&self) -> u32 {
        let of_bus = self.bus.as_ref();
        let of_bus = of_bus.map_or(u32::MAX, |bus| bus.watchdog_scans(self.scan.period_us));
        self.scan.watchdog_scans.min(of_bus)
    }

    /// Scans without an answer after which the owner of the bus hangs: early enough for its standby to send before the drives stop, or are
    /// given up.
    pub fn bus_hang_scans(&self) -> u32 {
        (self.missed_cycles_max() / 2).max(HANG_SCANS_MIN)
    }

    /// What the service table needs to know of it.
    pub fn shape(&self) -> Shape {
        Shape {
            axes: self.axes.iter().map(|axis| axis.name.clone()).collect(),
            period_scans: self.scan.interpolation_period_scans,
            has_bus: self.bus.is_some(),
            has_signals: !(self.signals.is_empty() && self.alarms.is_empty()),
            has_logic: self.logic.is_some(),
        }
    }

    /// Scan period Tp in s.
    pub fn scan_period_s(&self) -> f64 {
        f64::from(self.scan.period_us) * 1e-6
    }

    /// Interpolation period Ts in s.
    pub fn interpolation_period_s(&self) -> f64 {
        self.scan_period_s() * f64::from(self.scan.interpolation_period_scans)
    }

    /// How far the setpoints that are held reach ahead in any case: J periods guarantee (J − ½)·Ts, in s.
    pub fn look_ahead_s(&self) -> f64 {
        (f64::from(self.scan.look_ahead_periods) - 0.5) * self.interpolation_period_s()
    }

    /// Instrument samples within one scan: one every 250 µs, one where the scan is shorter.
    pub fn subsamples(&self) -> u32 {
        (self.scan.period_us / 250).max(1)
    }

    /// Setpoints of intended motion in a window: look-ahead, commit delay and one period.
    pub fn intended_setpoints(&self) -> u32 {
        self.scan.interpolation_period_scans * (self.scan.look_ahead_periods + 2)
    }
}

const _: () = assert!(MAX_AXES == 32);
