//! What is reported over the link: JSON with a format number, bounded in size, every field checked by whoever receives it.
//!
//! A message that is too large, not JSON, of another format, with an unknown or missing field, with a number out of all reason or
//! with a text that could steer a terminal is refused whole and counted; nothing of it is shown.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

mod auxiliary;

pub use auxiliary::{ANALOG_OUTPUTS, AuxiliaryState};

/// Number of this format; every message carries it. Any change of what follows is another format.
pub const FORMAT: u32 = 4;
/// The largest message, in bytes: a machine file with room to spare.
pub const MESSAGE_BYTES_MAX: usize = 256 << 10;
/// The longest text but a machine file, in bytes.
pub const TEXT_BYTES_MAX: usize = 400;
/// Axes of a cell.
pub const AXES_MAX: usize = 8;
/// Processes of a cell.
pub const PROCESSES_MAX: usize = 24;
/// Reversals a snapshot repeats: those of a link that was lost for a moment are not missed.
pub const REVERSALS_MAX: usize = 16;
/// Events of one answer.
pub const EVENTS_MAX: usize = 100;
/// Angles of a circle.
pub const CIRCLE_BINS: usize = 360;
/// Bars of the timing.
pub const BARS_MAX: usize = 16;
/// Highest override of feeds that a machine may have, in percent.
pub const OVERRIDE_MAX_PERCENT: usize = 200;
/// No quantity of a machine is larger, in any unit that is used here.
const NUMBER_MAX: f64 = 1e15;

/// Why a message is not believed.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// Too large.
    #[error("a message of {0} bytes: at most {MESSAGE_BYTES_MAX} are taken")]
    Size(usize),
    /// Not what is expected.
    #[error("not a message of format {FORMAT}: {0}")]
    Shape(#[from] serde_json::Error),
    /// Of another version.
    #[error("a message of format {0}, this program knows format {FORMAT}")]
    Format(u32),
    /// A field out of range.
    #[error("{field}: {found}")]
    Field {
        /// Which.
        field: &'static str,
        /// What was found.
        found: String,
    },
}

/// A message that can be sent and checked.
pub trait Message: Serialize + DeserializeOwned {
    /// Its format number.
    fn format(&self) -> u32;
    /// Which server reported it: a number that no other has.
    fn session(&self) -> u64;
    /// Checks every field.
    ///
    /// # Errors
    /// [`Refusal::Field`] for the first that is out of range.
    fn check(&self) -> Result<(), Refusal>;
}

/// A message as bytes.
///
/// # Errors
/// It would be refused: what goes out is judged as what comes in.
pub fn encode<M: Message>(message: &M) -> Result<Vec<u8>, Refusal> {
    let bytes = serde_json::to_vec(message)?;
    decode::<M>(&bytes)?;
    Ok(bytes)
}

/// Bytes from outside as a message.
///
/// # Errors
/// [`Refusal`]: nothing of it is to be used.
pub fn decode<M: Message>(bytes: &[u8]) -> Result<M, Refusal> {
    /// Of another format, the rest may be anything.
    #[derive(Deserialize)]
    struct Head {
        format: u32,
    }
    if bytes.len() > MESSAGE_BYTES_MAX {
        return Err(Refusal::Size(bytes.len()));
    }
    let head: Head = serde_json::from_slice(bytes)?;
    if head.format != FORMAT {
        return Err(Refusal::Format(head.format));
    }
    let message: M = serde_json::from_slice(bytes)?;
    message.check()?;
    Ok(message)
}

/// What a cell is like at one moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// [`FORMAT`].
    pub format: u32,
    /// The server.
    pub session: u64,
    /// Counted by the server from 1.
    pub sequence: u64,
    /// The server's clock when it made this, in µs.
    pub made_us: u64,
    /// For how long the feedback below had been the newest then, in µs.
    pub feedback_age_us: u64,
    /// `realtime` or `lockstep`.
    pub pace: Option<String>,
    /// The run is over.
    pub ended: bool,
    /// The machine, as the newest feedback says it.
    pub machine: Option<MachineState>,
    /// Per axis of the machine file.
    pub axes: Vec<AxisState>,
    /// The program.
    pub program: ProgramState,
    /// The processes, in the order of the roster.
    pub processes: Vec<ProcessState>,
    /// Reversals that the server has seen in all.
    pub reversals_count: u64,
    /// The last of them, newest last.
    pub reversals: Vec<ReversalState>,
    /// Where on the circle the tool is.
    pub angle_rad: Option<f64>,
    /// Scan periods seen on the spot.
    pub timing: Option<TimingState>,
    /// Number of the last event.
    pub events_count: u64,
    /// Scans that the server has seen.
    pub scans_seen: u64,
    /// Scans that it has not seen.
    pub scans_not_seen: u64,
}

/// From the feedback.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MachineState {
    /// Number of the scan.
    pub scan: u64,
    /// Mode, as in the samples.
    pub mode: u32,
    /// Cause, as in the samples.
    pub cause: u32,
    /// Its axis, or `u32::MAX`.
    pub cause_axis: u32,
    /// Its scan.
    pub cause_scan: u64,
    /// Override in percent.
    pub override_percent: u32,
    /// What the operator has switched, as in the samples.
    pub panel: u32,
    /// Scans that the master was late for.
    pub overrun_scans: u32,
    /// Which master it is.
    pub incarnation: u32,
    /// Feed hold is latched.
    pub hold: bool,
    /// The window's last row is executed.
    pub at_rest: bool,
    /// How far the cell is with its program, as in the samples.
    pub program: u32,
    /// Programs that were started.
    pub run: u32,
    /// The last feedback of the run.
    pub last: bool,
    /// A window is executed.
    pub window: bool,
    /// Element of the path, `u32::MAX` off it.
    pub element: u32,
    /// Distance along it, in mm.
    #[serde(with = "number")]
    pub distance_mm: f64,
    /// Scans of a dwell that are left.
    pub dwell_remaining_scans: u32,
    /// Element where the path was left, `u32::MAX` if it was not.
    pub interrupted_at_element: u32,
    /// Spindle, coolant, outputs, tool and stops.
    pub auxiliary: AuxiliaryState,
}

/// One axis: what is commanded, what is, and what was largest in between two snapshots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisState {
    /// Command position, in mm or degrees.
    #[serde(with = "number")]
    pub command_mm: f64,
    /// Encoder or scale, in mm or degrees.
    #[serde(with = "number")]
    pub feedback_mm: f64,
    /// Speed measured by the drive, in mm/s.
    #[serde(with = "number")]
    pub velocity_mm_s: f64,
    /// Torque, in N·m.
    #[serde(with = "number")]
    pub torque_nm: f64,
    /// Winding above ambient, in K.
    #[serde(with = "number")]
    pub winding_k: f64,
    /// Torque at its limit.
    pub torque_limited: bool,
    /// Scans without a command, in all.
    pub missed_scans: u32,
    /// The same, in a row until now.
    pub missed_in_a_row: u32,
    /// Whether its standby could take over, as in the samples.
    pub redundancy: u32,
    /// Scans in a row in which it could not.
    pub unsynchronised_scans: u32,
    /// How often its two servos have commanded different things.
    pub differences: u32,
    /// Role that drives.
    pub role: u32,
    /// Whether it is homed, as in the samples.
    pub reference: u32,
    /// The newest command of the servo that drives.
    pub command: Option<CommandState>,
    /// Following error now, in µm.
    pub error_um: Option<f64>,
    /// Largest magnitude since the snapshot before: nothing is hidden between two snapshots. None if no command was seen.
    pub error_peak_since_um: Option<f64>,
    /// Largest magnitude since the server came: nothing is hidden by a snapshot that was lost.
    #[serde(with = "number")]
    pub error_peak_um: f64,
}

/// What a servo asks of its drive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandState {
    /// Scan whose feedback it answers.
    pub scan: u64,
    /// Position, in mm or degrees.
    #[serde(with = "number")]
    pub position_mm: f64,
    /// Velocity, in mm/s.
    #[serde(with = "number")]
    pub velocity_mm_s: f64,
    /// Torque, in N·m.
    #[serde(with = "number")]
    pub torque_nm: f64,
    /// Friction that the servo goes by, as a part of that of its model; 0 without one.
    #[serde(with = "number")]
    pub friction_level: f64,
    /// Part of Coulomb friction that the last way between two reversals left unexplained.
    #[serde(with = "number")]
    pub friction_unexplained: f64,
}

/// How far the program is.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProgramState {
    /// Its file's name.
    pub name: Option<String>,
    /// Line being executed.
    pub line: Option<u32>,
    /// Its text.
    pub block: Option<String>,
    /// Path travelled, in mm; none before the planner has spoken.
    pub path_done_mm: Option<f64>,
    /// Length of the path, in mm.
    pub path_length_mm: Option<f64>,
}

/// One process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProcessState {
    /// Name, as in logs.
    pub name: String,
    /// `master`, `planner`, `servo` or `recorder`.
    pub job: String,
    /// Process id on the controller PC.
    pub pid: Option<u32>,
    /// Processes that had this place.
    pub starts: u32,
    /// It lives.
    pub live: bool,
    /// It was stopped by a fault script.
    pub stalled: bool,
    /// Its commands are taken.
    pub drives: Option<bool>,
    /// Of a servo whose commands are not taken: whether it could take over, as in the samples.
    pub redundancy: Option<u32>,
    /// Scans since it reported something.
    pub age_scans: Option<u64>,
    /// Scan and signal of its last death.
    pub death: Option<(u64, i32)>,
}

/// One reversal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReversalState {
    /// Axis index.
    pub axis: u32,
    /// −1 or 1.
    pub direction: i32,
    /// First scan in the new direction.
    pub scan: u64,
    /// Height over the arc before it, in µm.
    pub height_um: Option<f64>,
    /// Depth below it, in µm.
    pub undercut_um: Option<f64>,
    /// Largest following error around it, in µm.
    #[serde(with = "number")]
    pub error_peak_um: f64,
}

/// Scan periods.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingState {
    /// How many were seen.
    pub count: u64,
    /// Median, in µs.
    #[serde(with = "number")]
    pub p50_us: f64,
    /// 99th percentile, in µs.
    #[serde(with = "number")]
    pub p99_us: f64,
    /// Longest, in µs.
    #[serde(with = "number")]
    pub max_us: f64,
    /// Periods in each bar of the histogram.
    pub bars: Vec<u64>,
}

/// The circle that is travelled: reported less often than the rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CircleState {
    /// [`FORMAT`].
    pub format: u32,
    /// The server.
    pub session: u64,
    /// Letters of its plane.
    pub plane: String,
    /// Radius, in mm.
    #[serde(with = "number")]
    pub radius_mm: f64,
    /// Programmed feed, in mm/s; none for rapid.
    pub feed_mm_s: Option<f64>,
    /// Line of the program.
    pub line: u32,
    /// It is being travelled now.
    pub running: bool,
    /// Mean, lowest and highest radial deviation at each angle, in nm; none where it was not travelled.
    pub deviation_nm: Vec<Option<(i64, i64, i64)>>,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventReport {
    /// [`FORMAT`].
    pub format: u32,
    /// The server.
    pub session: u64,
    /// Counted by the server from 1. An event that is reported again with the same number has got another text: of small things that
    /// come often, only the count grows.
    pub number: u64,
    /// Its scan.
    pub scan: u64,
    /// Somebody should look at it.
    pub warning: bool,
    /// In words.
    pub text: String,
}

/// Answer to the question for events after a number.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventHistory {
    /// [`FORMAT`].
    pub format: u32,
    /// The server.
    pub session: u64,
    /// Number of the oldest event that is still known.
    pub oldest: u64,
    /// Events after the number that was asked for, in order, at most [`EVENTS_MAX`].
    pub events: Vec<EventReport>,
}

/// Answer to the question for the machine: what is needed to understand the rest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MachineReport {
    /// [`FORMAT`].
    pub format: u32,
    /// The server.
    pub session: u64,
    /// The cell.
    pub cell: String,
    /// Its machine file, as text.
    pub machine_toml: String,
}

/// Answer to the question for the server's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockReport {
    /// [`FORMAT`].
    pub format: u32,
    /// The server.
    pub session: u64,
    /// Its clock, in µs.
    pub clock_us: u64,
}

/// A number that is there and not out of all reason: a value gone wild must not keep the rest of a message from being believed.
pub fn plausible(value: Option<f64>) -> Option<f64> {
    value.filter(|value| value.abs() <= NUMBER_MAX)
}

/// A float on the wire: JSON has no NaN, so what is not finite or out of all reason is `null`, and `null` is NaN.
mod number {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
        super::plausible(Some(*value)).serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::NAN))
    }
}

fn refuse(field: &'static str, found: impl std::fmt::Display) -> Refusal {
    Refusal::Field {
        field,
        found: found.to_string(),
    }
}

/// NaN is a value that is shown as such; anything else is a quantity of a machine.
fn check_number(field: &'static str, value: f64) -> Result<(), Refusal> {
    if value.abs() > NUMBER_MAX {
        return Err(refuse(field, value));
    }
    Ok(())
}

fn check_numbers(values: &[(&'static str, Option<f64>)]) -> Result<(), Refusal> {
    for (field, value) in values {
        check_number(field, value.unwrap_or(0.0))?;
    }
    Ok(())
}

/// A text for a screen: short, and nothing in it that a terminal obeys.
fn check_text(field: &'static str, text: &str) -> Result<(), Refusal> {
    if text.len() > TEXT_BYTES_MAX {
        return Err(refuse(field, format!("{} bytes", text.len())));
    }
    if text.chars().any(char::is_control) {
        return Err(refuse(field, "a control character"));
    }
    Ok(())
}

fn check_texts(texts: &[(&'static str, Option<&str>)]) -> Result<(), Refusal> {
    for (field, text) in texts {
        check_text(field, text.unwrap_or_default())?;
    }
    Ok(())
}

fn check_count(field: &'static str, count: usize, most: usize) -> Result<(), Refusal> {
    if count > most {
        return Err(refuse(field, format!("{count}, at most {most}")));
    }
    Ok(())
}

/// A text as it may travel: cut to length, without what a terminal would obey.
pub fn plain_text(text: &str) -> String {
    let mut plain = String::new();
    for c in text.chars() {
        if plain.len() + c.len_utf8() > TEXT_BYTES_MAX {
            break;
        }
        plain.push(if c.is_control() { ' ' } else { c });
    }
    plain
}

macro_rules! message {
    ($type:ty, $check:expr) => {
        impl Message for $type {
            fn format(&self) -> u32 {
                self.format
            }

            fn session(&self) -> u64 {
                self.session
            }

            fn check(&self) -> Result<(), Refusal> {
                if self.format != FORMAT {
                    return Err(Refusal::Format(self.format));
                }
                let check: fn(&$type) -> Result<(), Refusal> = $check;
                check(self)
            }
        }
    };
}

message!(Snapshot, |message| {
    if !matches!(
        message.pace.as_deref(),
        None | Some("realtime" | "lockstep")
    ) {
        return Err(refuse("pace", "neither realtime nor lockstep"));
    }
    check_number("angle_rad", message.angle_rad.unwrap_or(0.0))?;
    check_count("axes", message.axes.len(), AXES_MAX)?;
    check_count("processes", message.processes.len(), PROCESSES_MAX)?;
    check_count("reversals", message.reversals.len(), REVERSALS_MAX)?;
    if message.reversals.len() as u64 > message.reversals_count {
        return Err(refuse("reversals_count", message.reversals_count));
    }
    if let Some(machine) = &message.machine {
        check_number("distance_mm", machine.distance_mm)?;
        machine.auxiliary.check()?;
        check_count(
            "override_percent",
            machine.override_percent as usize,
            OVERRIDE_MAX_PERCENT,
        )?;
        let axis = machine.cause_axis;
        if axis != u32::MAX && axis as usize >= message.axes.len() {
            return Err(refuse("cause_axis", axis));
        }
    }
    message.axes.iter().try_for_each(check_axis)?;
    check_numbers(&[
        ("path_done_mm", message.program.path_done_mm),
        ("path_length_mm", message.program.path_length_mm),
    ])?;
    check_texts(&[
        ("program name", message.program.name.as_deref()),
        ("block", message.program.block.as_deref()),
    ])?;
    for process in &message.processes {
        check_text("process", &process.name)?;
        check_text("job", &process.job)?;
    }
    for reversal in &message.reversals {
        check_count(
            "reversal's axis",
            reversal.axis as usize + 1,
            message.axes.len(),
        )?;
        if !matches!(reversal.direction, -1 | 1) {
            return Err(refuse("direction", reversal.direction));
        }
        check_numbers(&[
            ("height_um", reversal.height_um),
            ("undercut_um", reversal.undercut_um),
            ("error_peak_um", Some(reversal.error_peak_um)),
        ])?;
    }
    if let Some(timing) = &message.timing {
        check_count("bars", timing.bars.len(), BARS_MAX)?;
        check_numbers(&[
            ("p50_us", Some(timing.p50_us)),
            ("p99_us", Some(timing.p99_us)),
            ("max_us", Some(timing.max_us)),
        ])?;
    }
    Ok(())
});

fn check_axis(axis: &AxisState) -> Result<(), Refusal> {
    check_numbers(&[
        ("command_mm", Some(axis.command_mm)),
        ("feedback_mm", Some(axis.feedback_mm)),
        ("velocity_mm_s", Some(axis.velocity_mm_s)),
        ("torque_nm", Some(axis.torque_nm)),
        ("winding_k", Some(axis.winding_k)),
        ("error_um", axis.error_um),
        ("error_peak_since_um", axis.error_peak_since_um),
        ("error_peak_um", Some(axis.error_peak_um)),
    ])?;
    if let Some(command) = &axis.command {
        check_numbers(&[
            ("commanded position_mm", Some(command.position_mm)),
            ("commanded velocity_mm_s", Some(command.velocity_mm_s)),
            ("commanded torque_nm", Some(command.torque_nm)),
        ])?;
    }
    Ok(())
}

message!(CircleState, |message| {
    check_text("plane", &message.plane)?;
    check_numbers(&[
        ("radius_mm", Some(message.radius_mm)),
        ("feed_mm_s", message.feed_mm_s),
    ])?;
    // Fewer angles or more would be another plot.
    if message.deviation_nm.len() != CIRCLE_BINS {
        return Err(refuse("deviation_nm", message.deviation_nm.len()));
    }
    let reasonable = |nm: i64| nm.unsigned_abs() <= 1_000_000_000_000;
    let each = message.deviation_nm.iter().flatten();
    for (mean_nm, low_nm, high_nm) in each {
        if ![*mean_nm, *low_nm, *high_nm].into_iter().all(reasonable) || low_nm > high_nm {
            return Err(refuse("deviation_nm", format!("{low_nm} to {high_nm}")));
        }
    }
    Ok(())
});

message!(EventReport, |message| {
    if message.number == 0 {
        return Err(refuse("number", 0));
    }
    check_text("event", &message.text)
});

message!(EventHistory, |message| {
    check_count("events", message.events.len(), EVENTS_MAX)?;
    for (index, event) in message.events.iter().enumerate() {
        event.check()?;
        if event.session != message.session {
            return Err(refuse("session", event.session));
        }
        let first = message.events.first().map_or(0, |first| first.number);
        if Some(event.number) != first.checked_add(index as u64) {
            return Err(refuse("number", event.number));
        }
    }
    Ok(())
});

message!(MachineReport, |message| {
    check_text("cell", &message.cell)?;
    let steers = |c: char| c.is_control() && !matches!(c, '\n' | '\r' | '\t');
    if message.machine_toml.chars().any(steers) {
        return Err(refuse("machine_toml", "a control character"));
    }
    Ok(())
});

message!(ClockReport, |_| Ok(()));

#[cfg(test)]
mod tests;
