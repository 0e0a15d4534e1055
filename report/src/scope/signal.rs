//! What a scope can show: one number per scan, each with its name, its unit and where it comes from.

use bus::sample::{
    AxisCommand, AxisFeedback, AxisInstruments, BusCycle, Feedback, MAX_SUBSAMPLES, Mode,
};
use console::output::joined;
use machine::{AxisKind, Machine, PositionFeedback};
use path::geometry::{AxisVector, Path};
use path::kinematics::Kinematics;

use super::error::ScopeError;
use crate::align::ScanSet;
use crate::contour;

/// A unit as people read and write it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// As it is on screens; empty for plain numbers.
    pub shown: &'static str,
    /// As it ends the name of a column.
    pub suffix: &'static str,
    /// Units that a threshold may be given in, each with its size in the unit shown.
    accepted: &'static [(&'static str, f64)],
}

const fn unit(
    shown: &'static str,
    suffix: &'static str,
    accepted: &'static [(&'static str, f64)],
) -> Unit {
    Unit {
        shown,
        suffix,
        accepted,
    }
}

/// Units of one kind of number: of a slide, and of a rotary axis.
type Units = [Unit; 2];

const POSITION: Units = [
    unit("mm", "_mm", &[("mm", 1.0), ("um", 1e-3), ("µm", 1e-3)]),
    unit("deg", "_deg", &[("deg", 1.0), ("mdeg", 1e-3)]),
];
/// Small distances.
const DEVIATION: Units = [
    unit("µm", "_um", MICROMETRES),
    unit("mdeg", "_mdeg", &[("mdeg", 1.0), ("deg", 1e3)]),
];
const MICROMETRES: &[(&str, f64)] = &[("um", 1.0), ("µm", 1.0), ("nm", 1e-3), ("mm", 1e3)];
const SPEED: Units = [
    unit("mm/s", "_mm_s", MM_S),
    unit(
        "deg/s",
        "_deg_s",
        &[("deg/s", 1.0), ("deg/min", 1.0 / 60.0)],
    ),
];
const MM_S: &[(&str, f64)] = &[("mm/s", 1.0), ("mm/min", 1.0 / 60.0), ("m/s", 1e3)];
const TORQUE: Units = [unit("N·m", "_nm", NEWTON_METRES); 2];
const NEWTON_METRES: &[(&str, f64)] = &[("Nm", 1.0), ("N·m", 1.0), ("mNm", 1e-3)];
const TIME: Units = [unit("µs", "_us", MICROSECONDS); 2];
const MICROSECONDS: &[(&str, f64)] = &[("us", 1.0), ("µs", 1.0), ("ns", 1e-3), ("ms", 1e3)];
/// Temperature differences.
const TEMPERATURE: Units = [unit("K", "_k", &[("K", 1.0)]); 2];
const PERCENT: Units = [unit("%", "_percent", &[("%", 1.0)]); 2];
/// A number of things, or the number of a thing.
const NUMBER: Units = [unit("", "", &[]); 2];

/// What can be seen in each scan: its word, its units, what it is for people, and how it is seen; none where it is not known.
type Kind = (&'static str, Units, &'static str, See);
type See = fn(&Seen) -> Option<f64>;

/// Of each axis.
#[rustfmt::skip] // a table
const OF_AXIS: [Kind; 15] = [
    ("command", POSITION, "position command that the servo made in this scan",
        |of| of.mm(of.command()?.position)),
    ("feedback", POSITION, "position that the servo read: encoder, or scale where it uses it",
        |of| of.position_mm()),
    ("following_error", DEVIATION, "command minus feedback, compensation not counted",
        |of| Some(of.command()?.following_error_mm * 1e3)),
    ("velocity", SPEED, "measured by the drive",
        |of| Some(of.axis()?.velocity_mm_s)),
    ("velocity_command", SPEED, "velocity command that acts in this scan",
        |of| Some(of.axis()?.velocity_command_mm_s)),
    ("torque", TORQUE, "of the motor, at the end of the scan before",
        |of| Some(of.axis()?.torque_nm)),
    ("torque_command", TORQUE, "asked for by the servo in this scan: fed forward, or all of it in torque mode",
        |of| Some(of.command()?.torque_nm)),
    ("table", POSITION, "the table at the end of the scan, as the bench's instruments see it",
        |of| of.last_mm(|axis| &axis.table_mm)),
    ("wind_up", DEVIATION, "motor minus table at the end of the scan: wind-up and lost motion",
        |of| of.wind_up_um()),
    ("winding", TEMPERATURE, "winding temperature above ambient",
        |of| Some(of.axis()?.winding_k)),
    ("missed_scans", NUMBER, "scans without a command in time, in all",
        |of| Some(of.axis()?.missed_scans.into())),
    ("pulse", SPEED, "backlash acceleration now being output",
        |of| Some(of.command()?.friction_pulse_mm_s)),
    ("friction_level", PERCENT, "friction that the servo goes by, of that of its model",
        |of| Some(of.command()?.friction_level * 100.0)),
    ("unexplained", PERCENT, "part of Coulomb friction that the last way between two reversals left unexplained",
        |of| Some(of.command()?.friction_unexplained * 100.0)),
    ("role", NUMBER, "servo whose command was taken: 0 for a, 1 for its standby",
        |of| Some(of.axis()?.taken_role.into())),
];

/// Of the whole cell.
#[rustfmt::skip] // a table
const OF_CELL: [Kind; 7] = [
    ("contour_error", DEVIATION, "distance of the table from the programmed path at the end of the scan",
        |of| of.contour_error_um()),
    ("path_distance", POSITION, "way along the program's path",
        |of| of.path_distance_mm()),
    ("line", NUMBER, "line of the program that is under way",
        |of| Some(of.path()?.line_of(of.feedback)?.into())),
    ("mode", NUMBER, "0 disabled, 1 enabled, 2 stopping, 3 stopped, 4 tripped, 5 finished, 6 jogging, 7 ready",
        |of| Some(of.feedback.mode.into())),
    ("hold", NUMBER, "1 while feed hold is latched",
        |of| Some(of.feedback.hold.into())),
    ("override", PERCENT, "feed override",
        |of| Some(of.feedback.override_percent.into())),
    ("overrun_scans", NUMBER, "scans skipped because the master was late, in all",
        |of| Some(of.feedback.overrun_scans.into())),
];

/// Of each axis of a machine with a fieldbus.
#[rustfmt::skip] // a table
const OF_DRIVE: [Kind; 1] = [
    ("inputs", NUMBER, "digital inputs of the drive (object 60FD) as one number, 0 where its process data lack them",
        |of| Some(*of.bus()?.inputs.get(of.axis)? as f64)),
];

/// Of the fieldbus.
#[rustfmt::skip] // a table
const OF_BUS: [Kind; 9] = [
    ("round_trip", TIME, "from sending the frame of this scan to its answer; not known without an answer",
        |of| of.bus()?.round_trip_s().and(Some(of.bus()?.round_trip_ns as f64 / 1e3))),
    ("clock_offset", TIME, "how much later than in the middle between two SYNC0 the frame passed the reference clock",
        |of| of.bus()?.clock_offset_s().and(Some(of.bus()?.clock_offset_ns as f64 / 1e3))),
    ("sent", NUMBER, "frames sent, in all",
        |of| Some(of.bus()?.sent as f64)),
    ("missed", NUMBER, "frames without an answer in time, in all",
        |of| Some(of.bus()?.missed as f64)),
    ("short", NUMBER, "frames that some slave took no part in, in all",
        |of| Some(of.bus()?.short as f64)),
    ("late", NUMBER, "answers that came too late or twice, in all",
        |of| Some(of.bus()?.late as f64)),
    ("foreign", NUMBER, "frames of others and damaged ones, in all",
        |of| Some(of.bus()?.foreign as f64)),
    ("repeated", NUMBER, "frames sent again because the master was silent, in all",
        |of| Some(of.bus()?.repeated as f64)),
    ("slaves_operational", NUMBER, "slaves in operation (AL state OP)",
        |of| Some(of.bus()?.slaves_operational.into())),
];

/// A signal of one machine.
#[derive(Debug, Clone)]
pub struct Signal {
    /// As it is asked for: `X.torque`, `contour_error`.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// What it is, for people.
    pub about: &'static str,
    /// Index of its axis, or of its named input or output; 0 where it is of none.
    axis: usize,
    see: See,
}

impl PartialEq for Signal {
    fn eq(&self, other: &Signal) -> bool {
        (&self.name, self.unit) == (&other.name, other.unit)
    }
}

impl Signal {
    /// All signals of a machine, axis by axis, then those of the cell, its named inputs and outputs, then those of its fieldbus.
    pub fn all(machine: &Machine) -> Vec<Signal> {
        let of_axes = |kinds: &'static [Kind]| {
            let axes = machine.axes.iter().enumerate();
            axes.flat_map(move |(index, axis)| {
                let prefix = format!("{}.", axis.name);
                let signal = move |kind| Signal::of(kind, &prefix, axis.kind, index);
                kinds.iter().map(signal)
            })
        };
        let of_cell = |prefix: &'static str, kinds: &'static [Kind]| {
            let signal = move |kind| Signal::of(kind, prefix, AxisKind::Linear, 0);
            kinds.iter().map(signal)
        };
        let mut all: Vec<Signal> = of_axes(&OF_AXIS).chain(of_cell("", &OF_CELL)).collect();
        let named = machine.signals.iter().enumerate();
        all.extend(named.map(|(index, signal)| Signal::named(&signal.name, index)));
        if machine.bus.is_some() {
            all.extend(of_axes(&OF_DRIVE).chain(of_cell("bus.", &OF_BUS)));
        }
        all
    }

    /// A named input or output of the machine.
    fn named(name: &str, index: usize) -> Signal {
        Signal {
            name: format!("signal.{name}"),
            unit: NUMBER[0],
            about: "input or output that the machine file names so",
            axis: index,
            see: |of| of.set.signals.as_ref()?.values().get(of.axis).copied(),
        }
    }

    fn of(&(word, units, about, see): &Kind, prefix: &str, kind: AxisKind, axis: usize) -> Signal {
        let [slide, rotary] = units;
        let name = format!("{prefix}{word}");
        let unit = match kind {
            AxisKind::Linear => slide,
            AxisKind::Rotary => rotary,
        };
        Signal {
            name,
            unit,
            about,
            axis,
            see,
        }
    }

    /// The signal of this name.
    ///
    /// # Errors
    /// There is none: says which there are.
    pub fn parse(text: &str, machine: &Machine) -> Result<Signal, ScopeError> {
        let wanted = text.trim();
        let all = Signal::all(machine);
        if let Some(signal) = all.iter().find(|s| s.name.eq_ignore_ascii_case(wanted)) {
            return Ok(signal.clone());
        }
        let letters = machine.axes.iter().map(|axis| &axis.name);
        let words = |kinds: &[Kind]| joined(kinds.iter().map(|(word, ..)| *word), ", ");
        let bus = machine.bus.is_some();
        let right = match wanted.split_once('.') {
            Some(("bus", _)) if bus => format!("the bus has {}", words(&OF_BUS)),
            Some(("bus", _)) => format!("machine {} has no bus", machine.name),
            Some((axis, _)) if !letters.clone().any(|l| l.eq_ignore_ascii_case(axis)) => {
                format!(
                    "machine {} has axes {}",
                    machine.name,
                    joined(letters, ", ")
                )
            }
            Some(_) => format!("an axis has {}", words(&OF_AXIS)),
            None => format!(
                "the cell has {}; an axis, written AXIS.NAME, has {}",
                words(&OF_CELL),
                words(&OF_AXIS)
            ),
        };
        Err(ScopeError::Input(format!(
            "there is no signal {wanted:?}: {right}"
        )))
    }

    /// Whether it can only be known with the path of the program.
    pub fn needs_path(&self) -> bool {
        ["contour_error", "path_distance", "line"].contains(&self.name.as_str())
    }

    /// Name of its column: the name with its unit at the end.
    pub fn column(&self) -> String {
        format!("{}{}", self.name, self.unit.suffix)
    }

    /// Heading of its chart: its name with its unit.
    pub fn heading(&self) -> String {
        match self.unit.shown {
            "" => self.name.clone(),
            unit => format!("{} in {unit}", self.name),
        }
    }

    /// Whether it counts things or names one: between two values there is none.
    pub fn is_whole(&self) -> bool {
        self.unit.shown.is_empty()
    }

    /// A value of it in words, where a number would tell nothing.
    pub fn word(&self, value: f64) -> Option<&'static str> {
        let mode = (self.name == "mode").then(|| Mode::from_wire(value as u32));
        mode.flatten().map(Mode::word)
    }

    /// A number with or without a unit, in the unit of this signal.
    ///
    /// # Errors
    /// It is no number, or its unit is not one of this signal.
    pub fn value(&self, text: &str) -> Result<f64, ScopeError> {
        let text = text.trim();
        let end = text
            .find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '-' | '+')))
            .unwrap_or(text.len());
        let (number, unit) = text.split_at(end);
        let unit = unit.trim();
        let right = || match self.unit.accepted {
            [] => "a plain number".to_string(),
            units => format!(
                "a number in {}",
                joined(units.iter().map(|(word, _)| word), ", ")
            ),
        };
        let wrong = |what: String| {
            let what = format!("{text:?} for {}: {what}must be {}", self.name, right());
            ScopeError::Input(what)
        };
        let number = number.parse().ok().filter(|n: &f64| n.is_finite());
        let number = number.ok_or_else(|| wrong(String::new()))?;
        if unit.is_empty() {
            return Ok(number);
        }
        let size = self.unit.accepted.iter().find(|(word, _)| *word == unit);
        let (_, size) = size.ok_or_else(|| wrong(format!("unit {unit:?} is none of it: ")))?;
        Ok(number * size)
    }
}

/// The program's path, and how far along it each element begins.
#[derive(Debug, Clone, Default)]
pub struct KnownPath {
    hash: u64,
    path: Path,
    begins_mm: Vec<f64>,
}

impl KnownPath {
    /// Of the program that path tags with this hash belong to.
    pub fn new(hash: u64, path: Path) -> KnownPath {
        KnownPath {
            hash,
            begins_mm: contour::begins_mm(&path),
            path,
        }
    }

    /// Whether the feedback's tag is one of this path.
    pub fn is_of(&self, feedback: &Feedback) -> bool {
        feedback.program_hash == self.hash
            && feedback.program_hash != 0
            && !feedback.window.is_none()
            && !feedback.tag.is_off_path()
    }

    /// First element at or behind a line; none if the program ends before it.
    pub fn first_element_of(&self, line: u32) -> Option<u32> {
        let found = self.path.elements.iter().position(|e| e.line >= line);
        found.and_then(|index| u32::try_from(index).ok())
    }

    /// First and last line that move anything.
    pub fn lines(&self) -> Option<(u32, u32)> {
        let first = self.path.elements.first()?.line;
        Some((first, self.path.elements.last()?.line))
    }

    /// Line of the feedback's element.
    pub fn line_of(&self, feedback: &Feedback) -> Option<u32> {
        let element = self.path.elements.get(feedback.tag.element as usize)?;
        self.is_of(feedback).then_some(element.line)
    }
}

/// What is needed to make numbers of samples.
#[derive(Debug)]
pub struct Eyes {
    increment_mm: Vec<f64>,
    by_scale: Vec<bool>,
    kinematics: Kinematics,
    machine: Machine,
    /// Path of the program, once it is known.
    pub path: Option<KnownPath>,
}

impl Eyes {
    /// For a machine.
    pub fn of(machine: &Machine) -> Eyes {
        Eyes {
            increment_mm: machine.axes.iter().map(|a| a.increment_mm()).collect(),
            by_scale: machine
                .axes
                .iter()
                .map(|a| a.feedback == PositionFeedback::Scale)
                .collect(),
            kinematics: program::kinematics_of(machine),
            machine: machine.clone(),
            path: None,
        }
    }

    /// The value of a signal in one scan; NaN where it is not known.
    pub fn see(&self, signal: &Signal, set: &ScanSet, feedback: &Feedback) -> f64 {
        let seen = Seen {
            eyes: self,
            set,
            feedback,
            axis: signal.axis,
        };
        (signal.see)(&seen).unwrap_or(f64::NAN)
    }
}

/// One scan, as a signal is seen in it.
struct Seen<'a> {
    eyes: &'a Eyes,
    set: &'a ScanSet,
    feedback: &'a Feedback,
    axis: usize,
}

impl Seen<'_> {
    fn axis(&self) -> Option<&AxisFeedback> {
        self.feedback.axes().get(self.axis)
    }

    fn command(&self) -> Option<&AxisCommand> {
        self.set.command(self.axis)
    }

    fn bus(&self) -> Option<&BusCycle> {
        self.set.bus_cycle.as_deref()
    }

    fn path(&self) -> Option<&KnownPath> {
        let path = self.eyes.path.as_ref();
        path.filter(|path| path.is_of(self.feedback))
    }

    fn mm(&self, increments: i64) -> Option<f64> {
        Some(increments as f64 * self.eyes.increment_mm.get(self.axis)?)
    }

    fn position_mm(&self) -> Option<f64> {
        let axis = self.axis()?;
        self.mm(match self.eyes.by_scale.get(self.axis)? {
            true => axis.scale_position,
            false => axis.motor_position,
        })
    }

    /// Where an instrument saw the axis at the end of the scan.
    fn last_mm(&self, of: fn(&AxisInstruments) -> &[f64; MAX_SUBSAMPLES]) -> Option<f64> {
        let instruments = self.set.instruments.as_ref()?;
        let axis = instruments.axes().get(self.axis)?;
        of(axis).get(instruments.last()?).copied()
    }

    fn wind_up_um(&self) -> Option<f64> {
        Some((self.last_mm(|axis| &axis.motor_mm)? - self.last_mm(|axis| &axis.table_mm)?) * 1e3)
    }

    fn contour_error_um(&self) -> Option<f64> {
        let instruments = self.set.instruments.as_ref()?;
        let table_mm = instruments.places_mm(instruments.last()?, |axis| &axis.table_mm);
        let table_mm = AxisVector::from(self.eyes.machine.to_program_axes(table_mm));
        let tool_mm = self.eyes.kinematics.tool(&table_mm);
        Some(contour::error_mm(&self.path()?.path, &self.feedback.tag, &tool_mm)? * 1e3)
    }

    fn path_distance_mm(&self) -> Option<f64> {
        let tag = &self.feedback.tag;
        Some(self.path()?.begins_mm.get(tag.element as usize)? + tag.distance_mm)
    }
}
