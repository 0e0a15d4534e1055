//! The state of a cell, as all who show it have it: `status --json`, the page, the terminal, another machine.
//!
//! It is made in one place (`view`), under the names that scripts know. Positions are in mm and deviations in µm, for a
//! rotary axis in degrees and thousandths of a degree, under names that say so in printed JSON. None is what cannot be known.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::wire::number;

/// A cell at one moment.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellState {
    /// Its name.
    pub cell: String,
    /// `realtime` or `lockstep`.
    pub pace: Option<String>,
    /// The newest scan.
    pub scan: Option<u64>,
    /// Its time since the first one, in s.
    pub time_s: Option<f64>,
    /// What the machine is doing.
    pub mode: Option<String>,
    /// The same for people, in one sentence.
    pub state: String,
    /// What can be done, or what comes by itself.
    pub next: String,
    /// The sentence in its parts, and how it is meant.
    pub says: StateWords,
    /// Feed hold is latched.
    pub hold: Option<bool>,
    /// The command rests.
    pub at_rest: Option<bool>,
    /// Feed override, in percent.
    pub override_percent: Option<u32>,
    /// Override of rapids, in percent.
    pub rapid_override_percent: Option<u32>,
    /// Override of jogs, in percent.
    pub jog_override_percent: Option<u32>,
    /// The machine rests behind each block.
    pub single_block: Option<bool>,
    /// Why it stopped.
    pub cause: Option<CauseState>,
    /// Scans that the master was late for.
    pub overrun_scans: Option<u32>,
    /// Age of the newest feedback where it was taken, in s.
    pub feedback_age_s: f64,
    /// The run is over.
    pub ended: bool,
    /// The program.
    pub program: ProgramState,
    /// What the program has said to its operator, the last few, newest last.
    pub messages: Vec<MessageState>,
    /// Spindle, coolant, outputs, tool and stops.
    pub auxiliary: Option<AuxiliaryState>,
    /// The fieldbus, of a cell with one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bus: Option<BusState>,
    /// What run directories take, of a cell that stays up and records.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub runs: Option<RunsState>,
    /// The digital readout beside the axes.
    pub readout: Readout,
    /// The axes of the machine file, in its order.
    pub axes: Vec<AxisState>,
    /// The processes, in the order of the roster; empty before one was heard.
    pub processes: Vec<ProcessState>,
    /// Named inputs and outputs, of a machine that has any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub signals: Vec<SignalState>,
    /// Alarms that are there, or that nobody has acknowledged.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub alarms: Vec<AlarmState>,
    /// The link, of a view from another machine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remote: Option<LinkState>,
}

/// An alarm of the machine.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlarmState {
    /// Its number.
    pub number: u32,
    /// What is wrong.
    pub text: String,
    /// What to do about it.
    pub remedy: String,
    /// It is there now.
    pub active: bool,
    /// Somebody has acknowledged it since it came.
    pub acknowledged: bool,
    /// Scan in which it came last.
    pub scan: u64,
    /// Time of that since the cell's first scan, in s.
    pub time_s: f64,
}

/// A named input or output.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignalState {
    /// Its name.
    pub name: String,
    /// `bool`, `int` or `float`.
    pub kind: String,
    /// What it shows: 0 or 1 of a switch.
    pub value: f64,
    /// Unit of a number.
    pub unit: String,
    /// Where its value comes from, in words.
    pub source: String,
    /// Its source is lost: it shows what the machine file names for that.
    pub lost: bool,
    /// The operator holds it at this value.
    pub forced: bool,
}

/// A state for people, in its parts.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateWords {
    /// A sign that tells the states apart without colour.
    pub symbol: String,
    /// The state in a word or two.
    pub state: String,
    /// More about it.
    pub detail: String,
    /// How it is meant.
    pub tone: Tone,
}

/// How a state is meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tone {
    /// All is well.
    Good,
    /// It waits for somebody.
    #[default]
    Waits,
    /// Something is wrong.
    Bad,
}

/// Why the machine stopped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CauseState {
    /// As in the samples.
    pub code: u32,
    /// In words.
    pub words: String,
    /// Its axis, if it is of one.
    pub axis: Option<String>,
    /// Its scan.
    pub scan: u64,
}

/// Progress of the program.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProgramState {
    /// What the cell does with it.
    pub state: Option<String>,
    /// Programs that were started.
    pub run: Option<u32>,
    /// Name of its file.
    pub name: Option<String>,
    /// Line of the block being executed, or of the one where the path was left.
    pub line: Option<u32>,
    /// Text of that block.
    pub block: Option<String>,
    /// Element of the path.
    pub element: Option<u32>,
    /// Share of the path that is done, in percent.
    pub percent: Option<f64>,
    /// Path travelled, in mm.
    pub path_done_mm: Option<f64>,
    /// Length of the path, in mm.
    pub path_length_mm: Option<f64>,
    /// The run that ended last; none before one has.
    pub last_run: Option<LastRun>,
}

/// How a run ended, as the master says it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LastRun {
    /// Its number.
    pub run: u32,
    /// Completed, interrupted or stopped.
    pub outcome: String,
    /// Its last scan.
    pub scan: u64,
    /// Why; empty where there is nothing to say.
    pub why: String,
}

/// Something that the program has said.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MessageState {
    /// Counted in the run from 1.
    pub number: u32,
    /// Line of the program.
    pub line: u32,
    /// What it said.
    pub text: String,
}

/// What is commanded beside the axes, what the spindle shows and what is waited for.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AuxiliaryState {
    /// The spindle in words: stopped, a speed and a direction, or an angle.
    pub spindle: String,
    /// Speed commanded to it, in rev/min, clockwise positive.
    pub spindle_command_rpm: Option<f64>,
    /// Speed that it shows, in rev/min, clockwise positive.
    pub spindle_rpm: Option<f64>,
    /// It turns at its speed.
    pub at_speed: bool,
    /// Mist.
    pub mist: bool,
    /// Flood.
    pub flood: bool,
    /// Number of the tool in the spindle.
    pub tool: u32,
    /// Number of the tool that is to be ready for the next change.
    pub tool_prepared: u32,
    /// Numbers of the digital outputs that are on.
    pub digital_outputs: Vec<u32>,
    /// Analogue outputs.
    pub analog_outputs: Vec<Option<f64>>,
    /// What is waited for, in words, and its line.
    pub waiting: Option<String>,
    /// Line that the program is to begin at, until the tool is there.
    pub start_line: Option<u32>,
    /// Events of the program that are done.
    pub events_done: u32,
    /// The operator has optional stops switched on.
    pub optional_stop: bool,
    /// The override acts: the program has not switched it off.
    pub override_enabled: bool,
    /// All of it that is not as at rest, in words.
    pub summary: Option<String>,
}

/// What the run directories take whose runs are over.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunsState {
    /// Bytes of the disk.
    pub bytes: u64,
    /// The most that they may take.
    pub bytes_max: u64,
    /// The disk is nearly full, or nothing may go.
    pub alarm: Option<String>,
}

/// A fieldbus, as its drive page shows it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BusState {
    /// What its owner does, in words.
    pub state: String,
    /// Process id of the owner; none while nobody has it.
    pub owner_pid: Option<u32>,
    /// A second process could take it over.
    pub standby: bool,
    /// Frames sent.
    pub frames: u64,
    /// Frames without an answer in time.
    pub missed: u64,
    /// Frames that some slave took no part in.
    pub short: u64,
    /// Answers that came too late or twice.
    pub late: u64,
    /// Frames of others, and damaged ones.
    pub foreign: u64,
    /// Frames sent again because the master was silent.
    pub repeated: u64,
    /// From sending to the answer, in µs; none if the last cycle was not answered.
    pub round_trip_us: Option<f64>,
    /// How much later than in the middle between two SYNC0 the last frame passed the reference clock, in µs.
    pub clock_offset_us: Option<f64>,
    /// How far frames passed it from there on average since the bus started, in µs.
    pub clock_offset_mean_us: Option<f64>,
    /// The same, at most.
    pub clock_offset_peak_us: Option<f64>,
    /// The slaves, in the order of the cable; none while cycles are not exchanged.
    pub slaves: Vec<SlaveState>,
    /// All of it in one line.
    pub summary: String,
    /// What needs a look, in a few words.
    pub alarm: Option<String>,
}

/// A slave of a fieldbus.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlaveState {
    /// Its place on the cable, from 0.
    pub place: usize,
    /// The axis whose drive it is.
    pub axis: Option<String>,
    /// Its state in words.
    pub al_state: String,
    /// Its AL status code.
    pub al_status_code: u16,
}

/// The digital readout beside the axes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Readout {
    /// The work offset in force.
    pub work_offset: Option<String>,
    /// Number of the tool in the spindle.
    pub tool: Option<u32>,
    /// Speed of the slides together, in mm/min.
    pub feed_mm_min: Option<f64>,
    /// Feed of the block, in mm/min; none in rapid.
    pub programmed_feed_mm_min: Option<f64>,
    /// Where only rotary axes move in the block, in place of both: in degrees/min.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub feed_deg_min: Option<f64>,
    /// The same of the block.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub programmed_feed_deg_min: Option<f64>,
    /// The block is in rapid.
    pub rapid: Option<bool>,
    /// Speed that the spindle shows, in rev/min, clockwise positive.
    pub spindle_rpm: Option<f64>,
    /// Speed commanded to it.
    pub programmed_spindle_rpm: Option<f64>,
    /// F as the program has it, in its unit.
    pub feed_word: Option<f64>,
    /// S as the program has it.
    pub speed_word: Option<f64>,
    /// Codes in force.
    pub active_codes: Vec<String>,
    /// Line of the block.
    pub block_line: Option<u32>,
    /// Its text.
    pub block_text: Option<String>,
    /// Time that the program still takes, in s, without what braking and stops take.
    pub time_left_s: Option<f64>,
    /// It is an estimate.
    pub time_left_is_estimate: bool,
}

/// One axis.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct AxisState {
    /// Its name.
    pub axis: String,
    /// Unit of its positions: `mm` or `deg`.
    pub unit: String,
    /// Position command.
    #[serde(deserialize_with = "number")]
    pub command_mm: f64,
    /// Position by the encoder, or by the scale where that is used.
    #[serde(deserialize_with = "number")]
    pub feedback_mm: f64,
    /// Command in the coordinates of the program.
    pub work_mm: Option<f64>,
    /// Command in the coordinates of the machine.
    #[serde(deserialize_with = "number")]
    pub machine_mm: f64,
    /// Way to the end of the block, signed.
    pub distance_to_go_mm: Option<f64>,
    /// What the length of the tool takes off.
    pub tool_length_mm: Option<f64>,
    /// Speed measured by the drive.
    #[serde(deserialize_with = "number")]
    pub velocity_mm_s: f64,
    /// Velocity command of the servo that drives.
    pub velocity_command_mm_s: Option<f64>,
    /// Following error as that servo computes it.
    pub following_error_um: Option<f64>,
    /// Largest magnitude since the observer came.
    #[serde(deserialize_with = "number")]
    pub following_error_peak_um: f64,
    /// Largest magnitude since the look before; none if no command was seen in it.
    pub following_error_look_um: Option<f64>,
    /// Torque command of the servo that drives, in N·m.
    pub torque_command_nm: Option<f64>,
    /// Torque of the motor, in N·m.
    #[serde(deserialize_with = "number")]
    pub torque_nm: f64,
    /// The same as a share of the rated torque.
    #[serde(deserialize_with = "number")]
    pub torque_percent: f64,
    /// It is at its limit.
    pub torque_limited: bool,
    /// Friction fed forward, in words: its share of the model's, tuned, or none.
    pub friction: String,
    /// Friction level of the servo, as a share of its model's; none where the axis does not follow friction.
    pub friction_level: Option<f64>,
    /// Part of Coulomb friction that the last way between two reversals left unexplained.
    pub friction_unexplained: Option<f64>,
    /// Scans without a command in time, in all.
    pub missed_scans: u32,
    /// The same, in a row until now.
    pub missed_in_a_row: u32,
    /// Servo that drives.
    pub servo: String,
    /// Whether its standby could take over, in words.
    pub standby: String,
    /// How often its two servos have commanded different things.
    pub standby_differences: u32,
    /// How it knows its place, in words.
    pub reference: String,
    /// Skew of a gantry's second motor: its position less the first motor's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skew_um: Option<f64>,
    /// What needs a look, in words.
    pub alarm: Option<String>,
    /// Numbers of the feedback that are shown as they are (`monitor::quantities`), by key. Any other field that is no number is
    /// refused.
    #[serde(flatten)]
    pub quantities: BTreeMap<String, Option<f64>>,
}

/// One process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProcessState {
    /// Its name, as in logs.
    pub process: String,
    /// `master`, `planner`, `servo`, `recorder` or `fieldbus`.
    pub job: String,
    /// Process id on the controller PC.
    pub pid: Option<u32>,
    /// Processes that had this place.
    pub starts: u32,
    /// It lives.
    pub live: bool,
    /// It stands still.
    pub stalled: bool,
    /// Of a servo: its commands are taken.
    pub drives: Option<bool>,
    /// Of a servo whose commands are not taken: whether it could take over, in words.
    pub standby: Option<String>,
    /// Scans since it was last done with one.
    pub age_scans: Option<u64>,
    /// Its last death.
    pub last_death: Option<Death>,
}

/// A death of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Death {
    /// Its scan.
    pub scan: u64,
    /// Signal; 0 where it ended by itself.
    pub signal: i32,
}

/// The link of a view from another machine.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkState {
    /// Where the server is.
    pub server: String,
    /// What is shown is at most so old, in s; none before the first round trip.
    pub data_age_s_max: Option<f64>,
    /// What is shown is at least so old, in s.
    pub data_age_s_min: Option<f64>,
    /// The last round trip, in s.
    pub round_trip_s: Option<f64>,
    /// The link counts as lost.
    pub link_lost: bool,
    /// Time since the last snapshot came, in s.
    pub silent_s: f64,
    /// Snapshots taken.
    pub snapshots: u64,
    /// Snapshots that were dropped on the way: the link was too slow for them.
    pub snapshots_lost: u64,
    /// Messages that were not believed.
    pub messages_refused: u64,
    /// Messages for which there was no room here.
    pub messages_dropped: u64,
    /// Events that were reported.
    pub events: u64,
    /// Events that the server had forgotten before they could be asked for.
    pub events_lost: u64,
}

/// The circle that is travelled, or was last: radial deviation of the table over the angle.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CircleState {
    /// Letters of its plane.
    pub plane: String,
    /// Line of the program.
    pub line: u32,
    /// Radius.
    #[serde(deserialize_with = "number")]
    pub radius_mm: f64,
    /// Programmed feed; none for rapid.
    pub feed_mm_min: Option<f64>,
    /// It is being travelled now.
    pub running: bool,
    /// Where on it the tool was last.
    pub angle_rad: Option<f64>,
    /// Lowest, mean and highest deviation in each degree, outward positive; none where it was not travelled.
    pub deviation_um: Vec<Option<[f64; 3]>>,
}

impl CircleState {
    /// Lowest and highest deviation, in µm.
    pub fn range_um(&self) -> Option<(f64, f64)> {
        let seen = self.deviation_um.iter().flatten();
        seen.fold(None, |range: Option<(f64, f64)>, [low, _, high]| {
            let (least, most) = range.unwrap_or((*low, *high));
            Some((least.min(*low), most.max(*high)))
        })
    }
}

/// Scan periods, as an observer on the spot has seen them.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingState {
    /// How many were seen.
    pub periods: u64,
    /// Median.
    #[serde(deserialize_with = "number")]
    pub p50_us: f64,
    /// 99th percentile.
    #[serde(deserialize_with = "number")]
    pub p99_us: f64,
    /// Longest.
    #[serde(deserialize_with = "number")]
    pub max_us: f64,
    /// Periods in each bar of the histogram.
    pub bars: Vec<u64>,
}

/// A reversal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReversalState {
    /// Axis index.
    pub axis: u32,
    /// −1 or 1.
    pub direction: i32,
    /// First scan in the new direction.
    pub scan: u64,
    /// Height over the arc before it.
    pub height_um: Option<f64>,
    /// Depth below it.
    pub undercut_um: Option<f64>,
    /// Largest following error around it.
    #[serde(deserialize_with = "number")]
    pub error_peak_um: f64,
}
