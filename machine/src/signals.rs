//! `[[signal]]` and `[functions]`: named inputs and outputs of the machine, and what the controller itself does with them
//! (docs/howto/signals.md).

use std::collections::BTreeMap;

use bus::sample::{ANALOG_INPUTS, ANALOG_OUTPUTS, DIGITAL_INPUTS, DIGITAL_OUTPUTS};
use schemars::JsonSchema;
use serde::Deserialize;

/// A named input or output of the machine: one value, from one source, for any number of readers.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Signal {
    /// Its name: lower-case letters, digits and underscores, a letter first.
    pub name: String,
    /// What it can show.
    #[schemars(extend("default" = "bool"))]
    pub kind: SignalKind,
    /// Unit in which a number is shown, such as `bar`.
    #[schemars(extend("default" = ""))]
    pub unit: String,
    /// Value until its source has said one; 0 or 1 of a switch.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000, "default" = 0.0))]
    pub default: f64,
    /// Value while its source is lost, in place of `default`: a wire that is cut, a terminal or a process that does not answer. Of an
    /// output it is what the device shows when nobody commands it any more.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000))]
    pub lost: Option<f64>,
    /// While its source is lost it keeps the value that it had last, in place of `lost`; it outlives the logic and the master, but not
    /// the cell. For what is to be remembered, such as the tool in the spindle; never for what moves something.
    #[schemars(extend("default" = false))]
    pub keeps: bool,
    /// The other way round: a switch that shows 1 for off.
    #[schemars(extend("default" = false))]
    pub inverted: bool,
    /// Where its value comes from.
    pub from: SignalSource,
    /// Devices and inputs of programs that it goes to; its name can be read everywhere.
    pub to: Option<SignalSink>,
}

impl Signal {
    /// What it shows while its source is lost.
    pub fn lost_value(&self) -> f64 {
        self.lost.unwrap_or(self.default)
    }
}

/// What a signal can show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SignalKind {
    /// A switch: 0 or 1.
    Bool,
    /// A whole number.
    Int,
    /// A number.
    Float,
}

impl SignalKind {
    /// Whether a signal of this kind can show this value.
    pub fn can_show(self, value: f64) -> bool {
        match self {
            SignalKind::Bool => value == 0.0 || value == 1.0,
            SignalKind::Int => value.is_finite() && value.fract() == 0.0,
            SignalKind::Float => value.is_finite(),
        }
    }

    /// The nearest value that it can show, to what a source says; none of what is no number.
    pub fn nearest(self, value: f64) -> Option<f64> {
        if !value.is_finite() {
            return None;
        }
        Some(match self {
            SignalKind::Bool => f64::from(u8::from(value != 0.0)),
            SignalKind::Int => value.round(),
            SignalKind::Float => value,
        })
    }

    /// Its word in the machine file.
    pub fn word(self) -> &'static str {
        match self {
            SignalKind::Bool => "bool",
            SignalKind::Int => "int",
            SignalKind::Float => "float",
        }
    }
}

/// Where the value of a signal comes from: exactly one of them. Where drives are simulated, the
/// [plant file](plant-file.md#contact) says what a drive or terminal shows.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
pub struct SignalSource {
    /// Axis whose drive has the input, `bit` of its digital inputs (object 60FD).
    pub drive: Option<String>,
    /// The bit of the drive.
    #[schemars(extend("minimum" = 0, "maximum" = 31))]
    pub bit: Option<u32>,
    /// Place on the cable, from 0, of the terminal that has the input, and its `channel`.
    #[schemars(extend("minimum" = 0, "maximum" = 15))]
    pub terminal: Option<u32>,
    /// The channel of the terminal, from 1.
    #[schemars(extend("minimum" = 1, "maximum" = 256))]
    pub channel: Option<u32>,
    /// Digital output of programs, M62 to M65 P.
    #[schemars(extend("minimum" = 0, "maximum" = DIGITAL_OUTPUTS - 1))]
    pub output: Option<u32>,
    /// Analogue output of programs, M67 and M68 E.
    #[schemars(extend("minimum" = 0, "maximum" = ANALOG_OUTPUTS - 1))]
    pub analog_output: Option<u32>,
    /// What the controller itself commands or is.
    pub state: Option<MachineState>,
    /// Who sets it.
    pub by: Option<SetBy>,
    /// Axis whose travel counts, and `every_m`: a pulse of `for_ms` each time it has travelled so far, and when it moves first.
    pub travel: Option<String>,
    /// Travel from a pulse to the next one; of a rotary axis a metre is 1000°.
    #[schemars(extend("unit" = "m", "exclusiveMinimum" = 0, "maximum" = 100_000))]
    pub every_m: Option<f64>,
    /// Length of a pulse.
    #[schemars(extend("unit" = "ms", "minimum" = 1, "maximum" = 3_600_000))]
    pub for_ms: Option<f64>,
}

/// Who sets a signal that no device shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SetBy {
    /// The operator, by `quadrant signal set`.
    Operator,
    /// The machine's own [logic](../howto/logic.md).
    Logic,
}

/// What the controller commands or is, as the source of a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MachineState {
    /// The spindle is commanded to turn clockwise (M3).
    SpindleClockwise,
    /// It is commanded to turn counter-clockwise (M4).
    SpindleCounterClockwise,
    /// Commanded speed of the spindle, in rev/min, without its sign.
    SpindleSpeed,
    /// It is commanded to stand at an angle (M19).
    SpindleOrient,
    /// The angle at which it is commanded to stand, in degrees.
    SpindleAngle,
    /// Coolant as mist (M7).
    Mist,
    /// Coolant as flood (M8).
    Flood,
    /// Number of the tool that is to be in the spindle.
    ToolWanted,
    /// A changer is to bring the tool that is wanted (M6): the program waits for it, and the spindle stands. Off in hold and while the
    /// drives are off.
    ToolChange,
    /// Number of the tool that is to be ready for the next change.
    ToolPrepared,
    /// The drives are on.
    DrivesOn,
    /// A program runs and is not held.
    ProgramRuns,
    /// The machine has tripped.
    Tripped,
    /// The M-code that the machine is to do ([`MachineCodes`]); 0 for none.
    MCode,
    /// Its P; -1 without one.
    MCodeP,
    /// A number of its own for each time that one is to be done: after the death of a process the same one is the same call.
    MCodeCall,
}

/// Where a signal goes, one or several of them.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize, JsonSchema)]
pub struct SignalSink {
    /// Axis whose drive has the output, `bit` of its digital outputs (object 60FE:1).
    pub drive: Option<String>,
    /// The bit of the drive: 0 is the brake, 16 and above what the drive's maker leaves to the user.
    #[schemars(extend("minimum" = 0, "maximum" = 31))]
    pub bit: Option<u32>,
    /// Place on the cable, from 0, of the terminal that has the output, and its `channel`.
    #[schemars(extend("minimum" = 0, "maximum" = 15))]
    pub terminal: Option<u32>,
    /// The channel of the terminal, from 1.
    #[schemars(extend("minimum" = 1, "maximum" = 256))]
    pub channel: Option<u32>,
    /// Digital input of programs, M66 P.
    #[schemars(extend("minimum" = 0, "maximum" = DIGITAL_INPUTS - 1))]
    pub input: Option<u32>,
    /// Analogue input of programs, M66 E.
    #[schemars(extend("minimum" = 0, "maximum" = ANALOG_INPUTS - 1))]
    pub analog_input: Option<u32>,
}

impl SignalSource {
    /// Whether a device outside the controller has it.
    pub fn is_outside(&self) -> bool {
        self.drive.is_some() || self.terminal.is_some()
    }

    /// How many sources it names.
    pub(crate) fn count(&self) -> usize {
        let named = [
            self.drive.is_some(),
            self.terminal.is_some(),
            self.output.is_some(),
            self.analog_output.is_some(),
            self.state.is_some(),
            self.by.is_some(),
            self.travel.is_some(),
        ];
        named.into_iter().filter(|named| *named).count()
    }
}

/// Signals that the controller itself acts on. Each is the name of a `[[signal]]`; none need be named. **These are no safety functions**:
/// what protects people stays in hardware ([safety](../howto/signals.md#no-safety-function)).
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
pub struct Functions {
    /// A switch, 1 while the emergency-stop chain is closed. Open, or its wire lost: the machine brakes at its limits and trips; `enable`
    /// is refused until it is closed.
    pub emergency_stop: Option<String>,
    /// A switch, 1 while drives may be on. Off: the machine brakes and trips; `enable` is refused.
    pub drives_may: Option<String>,
    /// A switch, 1 while doors and guards are closed. Open: feed hold, spindle at rest; `start`, `resume` and motions by hand are refused.
    pub door: Option<String>,
    /// Switches that must show 1 for a program to be started or resumed (air, hydraulics, lubrication, a clamped workpiece). One that goes
    /// off while a program runs holds it.
    #[schemars(length(max = 16), extend("default" = []))]
    pub ready: Vec<String>,
    /// A button: pressed, the loaded program is started, or goes on from a hold.
    pub cycle_start: Option<String>,
    /// A button: pressed, feed hold.
    pub feed_hold: Option<String>,
    /// A number, the override of the feed in percent; it takes the place of what the operator has ordered.
    pub feed_override: Option<String>,
    /// A number, the override of rapids in percent.
    pub rapid_override: Option<String>,
    /// A switch, 1 while the touch probe is in contact.
    pub probe: Option<String>,
    /// A switch, 1 while the spindle turns at its commanded speed; with a bus it is what M3 waits for.
    pub spindle_at_speed: Option<String>,
    /// A number, the speed that the spindle shows in rev/min, without its sign.
    pub spindle_speed: Option<String>,
    /// A switch, 1 while the spindle stands at its commanded angle: what M19 waits for.
    pub spindle_oriented: Option<String>,
    /// A number, the tool that the changer shows in the spindle.
    pub tool_in_spindle: Option<String>,
    /// M-codes that the machine itself does.
    pub m_codes: Option<MachineCodes>,
    /// A handwheel that moves axes by hand.
    pub handwheel: Option<Handwheel>,
}

/// M-codes that the machine itself does, by its logic or its wiring. The program rests, the signals of `m-code` and `m-code-p` show what is
/// to be done, and the program goes on once it is done; then they show 0, and no other code before `done` is off again.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
pub struct MachineCodes {
    /// Their numbers, of M100 to M199; the others run [programs](../howto/user-codes.md).
    #[schemars(length(min = 1, max = 100), inner(range(min = 100, max = 199)))]
    pub numbers: Vec<u32>,
    /// A switch, 1 once the code that is shown is done.
    pub done: String,
    /// Longest wait for it; after it the machine trips.
    #[schemars(extend("unit" = "s", "exclusiveMinimum" = 0, "maximum" = 3600, "default" = 60.0))]
    pub patience_s: f64,
}

/// A handwheel: a running count, and switches that say which axis follows it by how much. What it counts while no axis is chosen, or none
/// may be jogged, moves nothing later.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
pub struct Handwheel {
    /// A whole number, the count of its encoder.
    pub counts: String,
    /// Counts from one click to the next.
    #[schemars(extend("unit" = "counts", "minimum" = 1, "maximum" = 1_000_000, "default" = 4))]
    pub counts_per_click: u32,
    /// The switch of each axis that can be chosen; none moves while two are on.
    #[schemars(extend("additionalProperties" = {
        "type": "string", "description": "Switch that chooses the axis of this name."
    }))]
    pub axes: BTreeMap<String, String>,
    /// Way of a click; of rotary axes in degrees. The sign says which way round.
    #[schemars(extend("unit" = "mm", "minimum" = -10, "maximum" = 10, "default" = 0.001))]
    pub step_mm: f64,
    /// A switch: ten times the way.
    pub times_10: Option<String>,
    /// A switch: a hundred times the way.
    pub times_100: Option<String>,
    /// A switch that must be on for it to move anything, such as an enabling button.
    pub enable: Option<String>,
    /// Whether the axis rests with the wheel, and counts that it could not keep up with are lost; otherwise each count is travelled.
    #[schemars(extend("default" = false))]
    pub rests_with_wheel: bool,
}

impl Functions {
    /// M-codes that the machine itself does.
    pub fn machine_codes(&self) -> &[u32] {
        self.m_codes.as_ref().map_or(&[], |codes| &codes.numbers)
    }

    /// Each signal that is named, by its keys, with its name and whether it must be a switch.
    pub fn named(&self) -> impl Iterator<Item = (Vec<&str>, &str, bool)> {
        let single = [
            ("emergency_stop", &self.emergency_stop, true),
            ("drives_may", &self.drives_may, true),
            ("door", &self.door, true),
            ("cycle_start", &self.cycle_start, true),
            ("feed_hold", &self.feed_hold, true),
            ("feed_override", &self.feed_override, false),
            ("rapid_override", &self.rapid_override, false),
            ("probe", &self.probe, true),
            ("spindle_at_speed", &self.spindle_at_speed, true),
            ("spindle_speed", &self.spindle_speed, false),
            ("spindle_oriented", &self.spindle_oriented, true),
            ("tool_in_spindle", &self.tool_in_spindle, false),
        ];
        let single = single
            .into_iter()
            .filter_map(|(key, name, switch)| Some((vec![key], name.as_deref()?, switch)));
        let ready = self.ready.iter();
        let ready = ready.map(|name| (vec!["ready"], name.as_str(), true));
        let codes = self.m_codes.iter();
        let codes = codes.map(|codes| (vec!["m_codes", "done"], codes.done.as_str(), true));
        let wheel = self.handwheel.iter().flat_map(Handwheel::named);
        single.chain(ready).chain(codes).chain(wheel)
    }
}

impl Handwheel {
    fn named(&self) -> impl Iterator<Item = (Vec<&str>, &str, bool)> {
        let switches = [
            ("times_10", &self.times_10),
            ("times_100", &self.times_100),
            ("enable", &self.enable),
        ];
        let switches = switches
            .into_iter()
            .filter_map(|(key, name)| Some((vec![key], name.as_deref()?, true)));
        let axes = self.axes.iter();
        let axes = axes.map(|(axis, name)| (vec!["axes", axis], name.as_str(), true));
        let counts = [(vec!["counts"], self.counts.as_str(), false)];
        let all = counts.into_iter().chain(switches).chain(axes);
        all.map(|(mut keys, name, switch)| {
            keys.insert(0, "handwheel");
            (keys, name, switch)
        })
    }
}

/// Switches at the ends of an axis, 1 while the axis is not on them (normally closed: a wire that is cut counts as the switch). On one, the
/// machine brakes at its limits and trips; afterwards the axis moves only off it.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize, JsonSchema)]
pub struct LimitSwitches {
    /// Signal of the one at the end of low positions.
    pub negative: Option<String>,
    /// Signal of the one at the end of high positions.
    pub positive: Option<String>,
}
