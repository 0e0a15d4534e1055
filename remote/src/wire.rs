//! What is reported over the link: JSON with a format number, bounded in size, every field checked by whoever receives it.
//!
//! A message that is too large, not JSON, of another format, with an unknown or missing field, with a number out of all reason or
//! with a text that could steer a terminal is refused whole and counted; nothing of it is shown.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::state::{CellState, CircleState, ReversalState, TimingState};

/// Number of this format; every message carries it. Any change of what follows is another format.
pub const FORMAT: u32 = 6;
/// The largest message, in bytes: a machine file with room to spare.
pub const MESSAGE_BYTES_MAX: usize = 256 << 10;
/// The longest text but a machine file, in bytes.
pub const TEXT_BYTES_MAX: usize = 400;
/// Items of a list: the degrees of a circle, with room to spare.
const ITEMS_MAX: usize = 400;
/// Axes of a cell.
const AXES_MAX: usize = 8;
/// Processes of a cell.
const PROCESSES_MAX: usize = 24;
/// Numbers of an axis beside those that have fields of their own.
const QUANTITIES_MAX: usize = 16;
/// Bars of the timing.
const BARS_MAX: usize = 16;
/// Degrees of a circle.
const CIRCLE_DEGREES: usize = 360;
/// Highest override of feeds that a machine may have, in percent.
pub const OVERRIDE_MAX_PERCENT: u32 = 200;
/// Reversals a snapshot repeats: those of a link that was lost for a moment are not missed.
pub const REVERSALS_MAX: usize = 16;
/// Events of one answer.
pub const EVENTS_MAX: usize = 100;
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
        field: String,
        /// What was found.
        found: String,
    },
}

/// A message that can be sent and checked.
pub trait Message: Serialize + DeserializeOwned {
    /// Which server reported it: a number that no other has.
    fn session(&self) -> u64;
    /// Checks what one field says of another.
    ///
    /// # Errors
    /// [`Refusal::Field`] for the first that cannot be.
    fn check(&self) -> Result<(), Refusal> {
        Ok(())
    }
}

/// A message as bytes. Of a machine that says nonsense what can be said is: a number out of all reason is null, a text is cut to length
/// and without what a terminal would obey.
///
/// # Errors
/// It would be refused all the same: what goes out is judged as what comes in.
pub fn encode<M: Message>(message: &M) -> Result<Vec<u8>, Refusal> {
    let mut value = serde_json::to_value(message)?;
    make_plain("", &mut value);
    let bytes = serde_json::to_vec(&value)?;
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
    let value: Value = serde_json::from_slice(bytes)?;
    let head = Head::deserialize(&value)?;
    if head.format != FORMAT {
        return Err(Refusal::Format(head.format));
    }
    check("message", &value)?;
    let message: M = serde_json::from_value(value)?;
    message.check()?;
    Ok(message)
}

/// What a cell is like at one moment.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// [`FORMAT`].
    pub format: u32,
    /// The server.
    pub session: u64,
    /// Counted by the server from 1.
    pub sequence: u64,
    /// The server's clock when the feedback of this state came, in µs.
    pub heard_us: u64,
    /// The cell.
    pub state: CellState,
    /// Reversals that the server has seen in all.
    pub reversals_count: u64,
    /// The last of them, newest last.
    pub reversals: Vec<ReversalState>,
    /// Where on the circle the tool is: the circle itself comes less often.
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

/// The circle that is travelled: reported less often than the rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CircleReport {
    /// [`FORMAT`].
    pub format: u32,
    /// The server.
    pub session: u64,
    /// The circle.
    pub circle: CircleState,
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

/// The one field that is a whole file, of many lines.
const FILE: &str = "machine_toml";

/// Whether a terminal might obey this letter of a field.
fn steers(field: &str, letter: char) -> bool {
    letter.is_control() && !(field == FILE && matches!(letter, '\n' | '\r' | '\t'))
}

fn is_plausible(number: &serde_json::Number) -> bool {
    // Whole numbers are counts, times and sessions.
    !number.is_f64()
        || number
            .as_f64()
            .is_some_and(|value| value.abs() <= NUMBER_MAX)
}

fn refuse(field: &str, found: impl std::fmt::Display) -> Refusal {
    Refusal::Field {
        field: field.into(),
        found: found.to_string(),
    }
}

/// Refuses a number out of all reason, a text that is long or could steer a terminal, and a list that is long.
fn check(field: &str, value: &Value) -> Result<(), Refusal> {
    match value {
        Value::Number(number) if !is_plausible(number) => Err(refuse(field, number)),
        Value::String(text) if text.chars().any(|letter| steers(field, letter)) => {
            Err(refuse(field, "a control character"))
        }
        Value::String(text) if text.len() > TEXT_BYTES_MAX && field != FILE => {
            Err(refuse(field, format!("{} bytes", text.len())))
        }
        Value::Array(items) if items.len() > ITEMS_MAX => {
            Err(refuse(field, format!("{} items", items.len())))
        }
        Value::Array(items) => items.iter().try_for_each(|item| check(field, item)),
        Value::Object(fields) => fields
            .iter()
            .try_for_each(|(name, value)| check(name, value)),
        _ => Ok(()),
    }
}

fn make_plain(field: &str, value: &mut Value) {
    match value {
        Value::Number(number) if !is_plausible(number) => *value = Value::Null,
        Value::String(text) if field != FILE => *text = plain_text(text),
        Value::Array(items) => items.iter_mut().for_each(|item| make_plain(field, item)),
        Value::Object(fields) => {
            let fields = fields.iter_mut();
            fields.for_each(|(name, value)| make_plain(name, value));
        }
        _ => {}
    }
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

/// A float that may not be known: JSON has no NaN, so it is null there.
pub(crate) fn number<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::NAN))
}

macro_rules! message {
    ($type:ty $(, $check:expr)?) => {
        impl Message for $type {
            fn session(&self) -> u64 {
                self.session
            }

            $(fn check(&self) -> Result<(), Refusal> {
                let check: fn(&$type) -> Result<(), Refusal> = $check;
                check(self)
            })?
        }
    };
}

fn check_count(field: &str, count: usize, most: usize) -> Result<(), Refusal> {
    if count > most {
        return Err(refuse(field, format!("{count}, at most {most}")));
    }
    Ok(())
}

message!(Snapshot, |message| {
    let (state, reversals) = (&message.state, &message.reversals);
    if !matches!(state.pace.as_deref(), None | Some("realtime" | "lockstep")) {
        return Err(refuse("pace", "neither realtime nor lockstep"));
    }
    let percent = state.override_percent.unwrap_or(0);
    if percent > OVERRIDE_MAX_PERCENT {
        return Err(refuse("override_percent", percent));
    }
    let bars = message
        .timing
        .as_ref()
        .map_or(0, |timing| timing.bars.len());
    check_count("axes", state.axes.len(), AXES_MAX)?;
    check_count("processes", state.processes.len(), PROCESSES_MAX)?;
    let plain = |letter: char| matches!(letter, 'a'..='z' | '0'..='9' | '_');
    for quantities in state.axes.iter().map(|axis| &axis.quantities) {
        check_count("numbers of an axis", quantities.len(), QUANTITIES_MAX)?;
        if !quantities.keys().all(|key| key.chars().all(plain)) {
            return Err(refuse("numbers of an axis", "a key that is no name"));
        }
    }
    check_count("reversals", reversals.len(), REVERSALS_MAX)?;
    check_count("bars", bars, BARS_MAX)?;
    if reversals.len() as u64 > message.reversals_count {
        return Err(refuse("reversals_count", message.reversals_count));
    }
    for reversal in reversals {
        check_count(
            "reversal's axis",
            reversal.axis as usize + 1,
            state.axes.len(),
        )?;
        if !matches!(reversal.direction, -1 | 1) {
            return Err(refuse("direction", reversal.direction));
        }
    }
    Ok(())
});

message!(CircleReport, |message| {
    let deviation_um = &message.circle.deviation_um;
    // Fewer angles or more would be another plot.
    if deviation_um.len() != CIRCLE_DEGREES {
        return Err(refuse("deviation_um", deviation_um.len()));
    }
    let upside_down = deviation_um
        .iter()
        .flatten()
        .find(|[low, _, high]| low > high);
    match upside_down {
        Some([low, _, high]) => Err(refuse("deviation_um", format!("{low} to {high}"))),
        None => Ok(()),
    }
});

message!(MachineReport);
message!(ClockReport);

message!(EventReport, |message| match message.number {
    0 => Err(refuse("number", 0)),
    _ => Ok(()),
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

#[cfg(test)]
mod tests;
