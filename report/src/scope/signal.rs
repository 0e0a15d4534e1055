//! What a scope can show: one number per scan, each with its name, its unit and where it comes from.

use bus::sample::{AxisCommand, AxisFeedback, BusCycle, Feedback, Instruments, Mode};
use machine::{AxisKind, GantryPair, Machine, PositionFeedback};
use path::geometry::{AxisVector, Path};
use path::kinematics::Kinematics;

use super::error::ScopeError;
use crate::align::ScanSet;
use crate::contour;

/// What a number is of, and with it its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Dimension {
    /// Position, in mm (degrees of a rotary axis).
    Position,
    /// Small distance, in µm (thousandths of a degree).
    Deviation,
    /// Speed, in mm/s (degrees/s).
    Speed,
    /// Torque, in N·m.
    Torque,
    /// Time, in µs.
    Time,
    /// Temperature difference, in K.
    Temperature,
    /// Share, in percent.
    Percent,
    /// A number of things, or the number of a thing.
    Number,
}

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

const MM: Unit = Unit {
    shown: "mm",
    suffix: "_mm",
    accepted: &[("mm", 1.0), ("um", 1e-3), ("µm", 1e-3)],
};
const DEGREES: Unit = Unit {
    shown: "deg",
    suffix: "_deg",
    accepted: &[("deg", 1.0), ("mdeg", 1e-3)],
};
const MICROMETRES: Unit = Unit {
    shown: "µm",
    suffix: "_um",
    accepted: &[("um", 1.0), ("µm", 1.0), ("nm", 1e-3), ("mm", 1e3)],
};
const MILLIDEGREES: Unit = Unit {
    shown: "mdeg",
    suffix: "_mdeg",
    accepted: &[("mdeg", 1.0), ("deg", 1e3)],
};
const MM_S: Unit = Unit {
    shown: "mm/s",
    suffix: "_mm_s",
    accepted: &[("mm/s", 1.0), ("mm/min", 1.0 / 60.0), ("m/s", 1e3)],
};
const DEGREES_S: Unit = Unit {
    shown: "deg/s",
    suffix: "_deg_s",
    accepted: &[("deg/s", 1.0), ("deg/min", 1.0 / 60.0)],
};
const NEWTON_METRES: Unit = Unit {
    shown: "N·m",
    suffix: "_nm",
    accepted: &[("Nm", 1.0), ("N·m", 1.0), ("mNm", 1e-3)],
};
const MICROSECONDS: Unit = Unit {
    shown: "µs",
    suffix: "_us",
    accepted: &[("us", 1.0), ("µs", 1.0), ("ns", 1e-3), ("ms", 1e3)],
};
const KELVIN: Unit = Unit {
    shown: "K",
    suffix: "_k",
    accepted: &[("K", 1.0)],
};
const PERCENT: Unit = Unit {
    shown: "%",
    suffix: "_percent",
    accepted: &[("%", 1.0)],
};
const NONE: Unit = Unit {
    shown: "",
    suffix: "",
    accepted: &[],
};

impl Dimension {
    fn unit(self, kind: AxisKind) -> Unit {
        match (self, kind) {
            (Dimension::Position, AxisKind::Linear) => MM,
            (Dimension::Position, AxisKind::Rotary) => DEGREES,
            (Dimension::Deviation, AxisKind::Linear) => MICROMETRES,
            (Dimension::Deviation, AxisKind::Rotary) => MILLIDEGREES,
            (Dimension::Speed, AxisKind::Linear) => MM_S,
            (Dimension::Speed, AxisKind::Rotary) => DEGREES_S,
            (Dimension::Torque, _) => NEWTON_METRES,
            (Dimension::Time, _) => MICROSECONDS,
            (Dimension::Temperature, _) => KELVIN,
            (Dimension::Percent, _) => PERCENT,
            (Dimension::Number, _) => NONE,
        }
    }
}

/// What is known of one axis in each scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OfAxis {
    Command,
    Feedback,
    FollowingError,
    Velocity,
    VelocityCommand,
    Torque,
    TorqueCommand,
    Table,
    WindUp,
    Winding,
    MissedScans,
    Pulse,
    FrictionLevel,
    Unexplained,
    Role,
}

/// What is known of the whole cell in each scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OfCell {
    ContourError,
    PathDistance,
    Line,
    Mode,
    Hold,
    Override,
    OverrunScans,
}

#[rustfmt::skip] // a table
const OF_AXIS: [(OfAxis, &str, Dimension, &str); 15] = [
    (OfAxis::Command,         "command",          Dimension::Position,    "position command that the servo made in this scan"),
    (OfAxis::Feedback,        "feedback",         Dimension::Position,    "position that the servo read: encoder, or scale where it uses it"),
    (OfAxis::FollowingError,  "following_error",  Dimension::Deviation,   "command minus feedback, compensation not counted"),
    (OfAxis::Velocity,        "velocity",         Dimension::Speed,       "measured by the drive"),
    (OfAxis::VelocityCommand, "velocity_command", Dimension::Speed,       "velocity command that acts in this scan"),
    (OfAxis::Torque,          "torque",           Dimension::Torque,      "of the motor, at the end of the scan before"),
    (OfAxis::TorqueCommand,   "torque_command",   Dimension::Torque,      "asked for by the servo in this scan: fed forward, or all of it in torque mode"),
    (OfAxis::Table,           "table",            Dimension::Position,    "the table at the end of the scan, as the bench's instruments see it"),
    (OfAxis::WindUp,          "wind_up",          Dimension::Deviation,   "motor minus table at the end of the scan: wind-up and lost motion"),
    (OfAxis::Winding,         "winding",          Dimension::Temperature, "winding temperature above ambient"),
    (OfAxis::MissedScans,     "missed_scans",     Dimension::Number,      "scans without a command in time, in all"),
    (OfAxis::Pulse,            "pulse",             Dimension::Speed,       "backlash acceleration now being output"),
    (OfAxis::FrictionLevel,   "friction_level",   Dimension::Percent,     "friction that the servo goes by, of that of its model"),
    (OfAxis::Unexplained,     "unexplained",      Dimension::Percent,     "part of Coulomb friction that the last way between two reversals left unexplained"),
    (OfAxis::Role,            "role",             Dimension::Number,      "servo whose command was taken: 0 for a, 1 for its standby"),
];

#[rustfmt::skip] // a table
const OF_CELL: [(OfCell, &str, Dimension, &str); 7] = [
    (OfCell::ContourError, "contour_error", Dimension::Deviation, "distance of the table from the programmed path at the end of the scan"),
    (OfCell::PathDistance, "path_distance", Dimension::Position,  "way along the program's path"),
    (OfCell::Line,         "line",          Dimension::Number,    "line of the program that is under way"),
    (OfCell::Mode,         "mode",          Dimension::Number,    "0 disabled, 1 enabled, 2 stopping, 3 stopped, 4 tripped, 5 finished, 6 jogging, 7 ready"),
    (OfCell::Hold,         "hold",          Dimension::Number,    "1 while feed hold is latched"),
    (OfCell::Override,     "override",      Dimension::Percent,   "feed override"),
    (OfCell::OverrunScans, "overrun_scans", Dimension::Number,    "scans skipped because the master was late, in all"),
];

/// What is known of the fieldbus in each scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OfBus {
    RoundTrip,
    ClockOffset,
    Sent,
    Missed,
    Short,
    Late,
    Foreign,
    Repeated,
    SlavesOperational,
}

#[rustfmt::skip] // a table
const OF_BUS: [(OfBus, &str, Dimension, &str); 9] = [
    (OfBus::RoundTrip,         "round_trip",         Dimension::Time,   "from sending the frame of this scan to its answer; not known without an answer"),
    (OfBus::ClockOffset,       "clock_offset",       Dimension::Time,   "how much later than in the middle between two SYNC0 the frame passed the reference clock"),
    (OfBus::Sent,              "sent",               Dimension::Number, "frames sent, in all"),
    (OfBus::Missed,            "missed",             Dimension::Number, "frames without an answer in time, in all"),
    (OfBus::Short,             "short",              Dimension::Number, "frames that some slave took no part in, in all"),
    (OfBus::Late,              "late",               Dimension::Number, "answers that came too late or twice, in all"),
    (OfBus::Foreign,           "foreign",            Dimension::Number, "frames of others and damaged ones, in all"),
    (OfBus::Repeated,          "repeated",           Dimension::Number, "frames sent again because the master was silent, in all"),
    (OfBus::SlavesOperational, "slaves_operational", Dimension::Number, "slaves in operation (AL state OP)"),
];

/// Of the axes of a machine with a fieldbus: the digital inputs of the drive.
const INPUTS: (&str, &str) = (
    "inputs",
    "digital inputs of the drive (object 60FD) as one number, 0 where its process data lack them",
);

/// Whose number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum What {
    Axis(usize, OfAxis),
    Inputs(usize),
    Cell(OfCell),
    Bus(OfBus),
}

/// A signal of one machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// As it is asked for: `X.torque`, `contour_error`.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// What it is, for people.
    pub about: &'static str,
    what: What,
}

impl Signal {
    /// All signals of a machine, axis by axis, then those of the cell, then those of its fieldbus.
    pub fn all(machine: &Machine) -> Vec<Signal> {
        let axes = machine.axes.iter().enumerate().flat_map(|(index, axis)| {
            OF_AXIS
                .iter()
                .map(move |&(what, word, dimension, about)| Signal {
                    name: format!("{}.{word}", axis.name),
                    unit: dimension.unit(axis.kind),
                    about,
                    what: What::Axis(index, what),
                })
        });
        let cell = OF_CELL
            .iter()
            .map(|&(what, word, dimension, about)| Signal {
                name: word.into(),
                unit: dimension.unit(AxisKind::Linear),
                about,
                what: What::Cell(what),
            });
        axes.chain(cell).chain(Signal::of_bus(machine)).collect()
    }

    /// Those that a machine has with a fieldbus.
    fn of_bus(machine: &Machine) -> Vec<Signal> {
        if machine.bus.is_none() {
            return Vec::new();
        }
        let signal = |name: String, dimension: Dimension, about, what| Signal {
            name,
            unit: dimension.unit(AxisKind::Linear),
            about,
            what,
        };
        let axes = machine.axes.iter().enumerate();
        let inputs = axes.map(|(index, axis)| {
            let (word, about) = INPUTS;
            let name = format!("{}.{word}", axis.name);
            signal(name, Dimension::Number, about, What::Inputs(index))
        });
        let bus = OF_BUS.iter().map(|&(what, word, dimension, about)| {
            signal(format!("bus.{word}"), dimension, about, What::Bus(what))
        });
        inputs.chain(bus).collect()
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
        let letters: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
        let of_axis: Vec<&str> = OF_AXIS.iter().map(|&(_, word, ..)| word).collect();
        let of_cell: Vec<&str> = OF_CELL.iter().map(|&(_, word, ..)| word).collect();
        let bus = machine.bus.is_some();
        let of_bus: Vec<&str> = OF_BUS.iter().map(|&(_, word, ..)| word).collect();
        let right = match wanted.split_once('.') {
            Some(("bus", _)) if bus => format!("the bus has {}", of_bus.join(", ")),
            Some(("bus", _)) => format!("machine {} has no bus", machine.name),
            Some((axis, _)) if !letters.iter().any(|l| l.eq_ignore_ascii_case(axis)) => {
                format!("machine {} has axes {}", machine.name, letters.join(", "))
            }
            Some(_) => format!("an axis has {}", of_axis.join(", ")),
            None => format!(
                "the cell has {}; an axis, written AXIS.NAME, has {}",
                of_cell.join(", "),
                of_axis.join(", ")
            ),
        };
        Err(ScopeError::Input(format!(
            "there is no signal {wanted:?}: {right}"
        )))
    }

    /// Whether it can only be known with the path of the program.
    pub fn needs_path(&self) -> bool {
        matches!(
            self.what,
            What::Cell(OfCell::ContourError | OfCell::PathDistance | OfCell::Line)
        )
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
        self.unit == NONE
    }

    /// A value of it in words, where a number would tell nothing.
    pub fn word(&self, value: f64) -> Option<&'static str> {
        match self.what {
            What::Cell(OfCell::Mode) => Mode::from_wire(value as u32).map(Mode::word),
            _ => None,
        }
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
        let units: Vec<&str> = self.unit.accepted.iter().map(|(word, _)| *word).collect();
        let right = || match units.as_slice() {
            [] => "a plain number".to_string(),
            units => format!("a number in {}", units.join(", ")),
        };
        let number: f64 = number
            .parse()
            .ok()
            .filter(|n: &f64| n.is_finite())
            .ok_or_else(|| {
                ScopeError::Input(format!("{text:?} for {}: must be {}", self.name, right()))
            })?;
        if unit.is_empty() {
            return Ok(number);
        }
        let size = self.unit.accepted.iter().find(|(word, _)| *word == unit);
        let (_, size) = size.ok_or_else(|| {
            ScopeError::Input(format!(
                "{text:?} for {}: unit {unit:?} is none of it: must be {}",
                self.name,
                right()
            ))
        })?;
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
        let mut sum_mm = 0.0;
        let begin = |element: &path::geometry::Element| {
            let begins_mm = sum_mm;
            sum_mm += element.length_mm;
            begins_mm
        };
        let begins_mm = path.elements.iter().map(begin).collect();
        KnownPath {
            hash,
            path,
            begins_mm,
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
    gantries: Vec<GantryPair>,
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
            gantries: machine.gantries().collect(),
            path: None,
        }
    }

    /// The value of a signal in one scan; NaN where it is not known.
    pub fn see(&self, signal: &Signal, set: &ScanSet, feedback: &Feedback) -> f64 {
        let value = match signal.what {
            What::Axis(axis, what) => feedback.axes().get(axis).and_then(|of_feedback| {
                let command = set.command(axis);
                self.of_axis(what, axis, of_feedback, command, set.instruments.as_deref())
            }),
            What::Cell(what) => self.of_cell(what, feedback, set.instruments.as_deref()),
            What::Inputs(axis) => {
                let inputs = set
                    .bus_cycle
                    .as_ref()
                    .and_then(|cycle| cycle.inputs.get(axis));
                inputs.map(|inputs| *inputs as f64)
            }
            What::Bus(what) => set.bus_cycle.as_ref().and_then(|cycle| of_bus(what, cycle)),
        };
        value.unwrap_or(f64::NAN)
    }

    fn of_axis(
        &self,
        what: OfAxis,
        axis: usize,
        feedback: &AxisFeedback,
        command: Option<&AxisCommand>,
        instruments: Option<&Instruments>,
    ) -> Option<f64> {
        let increment_mm = *self.increment_mm.get(axis)?;
        let last_mm = |rows: &[[f64; bus::sample::MAX_SUBSAMPLES]; bus::sample::MAX_AXES]| {
            let last = (instruments?.subsamples as usize).checked_sub(1)?;
            rows.get(axis)?.get(last).copied()
        };
        Some(match what {
            OfAxis::Command => command?.position as f64 * increment_mm,
            OfAxis::Feedback if *self.by_scale.get(axis)? => {
                feedback.scale_position as f64 * increment_mm
            }
            OfAxis::Feedback => feedback.motor_position as f64 * increment_mm,
            OfAxis::FollowingError => command?.following_error_mm * 1e3,
            OfAxis::Velocity => feedback.velocity_mm_s,
            OfAxis::VelocityCommand => feedback.velocity_command_mm_s,
            OfAxis::Torque => feedback.torque_nm,
            OfAxis::TorqueCommand => command?.torque_nm,
            OfAxis::Table => last_mm(&instruments?.table_mm)?,
            OfAxis::WindUp => {
                let instruments = instruments?;
                (last_mm(&instruments.motor_mm)? - last_mm(&instruments.table_mm)?) * 1e3
            }
            OfAxis::Winding => feedback.winding_k,
            OfAxis::MissedScans => f64::from(feedback.missed_scans),
            OfAxis::Pulse => command?.friction_pulse_mm_s,
            OfAxis::FrictionLevel => command?.friction_level * 100.0,
            OfAxis::Unexplained => command?.friction_unexplained * 100.0,
            OfAxis::Role => f64::from(feedback.taken_role),
        })
    }

    fn of_cell(
        &self,
        what: OfCell,
        feedback: &Feedback,
        instruments: Option<&Instruments>,
    ) -> Option<f64> {
        let path = || self.path.as_ref().filter(|path| path.is_of(feedback));
        Some(match what {
            OfCell::ContourError => {
                let instruments = instruments?;
                let last = (instruments.subsamples as usize).checked_sub(1)?;
                let mut table_mm = AxisVector::zeros();
                let rows = instruments.table_mm.iter().take(self.increment_mm.len());
                for (to, row) in table_mm.iter_mut().zip(rows) {
                    *to = *row.get(last)?;
                }
                for pair in &self.gantries {
                    pair.meet(table_mm.as_mut_slice());
                }
                let tool_mm = self.kinematics.tool(&table_mm);
                contour::error_mm(&path()?.path, &feedback.tag, &tool_mm)? * 1e3
            }
            OfCell::PathDistance => {
                let begins_mm = path()?.begins_mm.get(feedback.tag.element as usize)?;
                begins_mm + feedback.tag.distance_mm
            }
            OfCell::Line => f64::from(path()?.line_of(feedback)?),
            OfCell::Mode => f64::from(feedback.mode),
            OfCell::Hold => f64::from(feedback.hold),
            OfCell::Override => f64::from(feedback.override_percent),
            OfCell::OverrunScans => f64::from(feedback.overrun_scans),
        })
    }
}

fn of_bus(what: OfBus, cycle: &BusCycle) -> Option<f64> {
    Some(match what {
        OfBus::RoundTrip => cycle
            .round_trip_s()
            .map(|_| cycle.round_trip_ns as f64 / 1e3)?,
        OfBus::ClockOffset => cycle
            .clock_offset_s()
            .map(|_| cycle.clock_offset_ns as f64 / 1e3)?,
        OfBus::Sent => cycle.sent as f64,
        OfBus::Missed => cycle.missed as f64,
        OfBus::Short => cycle.short as f64,
        OfBus::Late => cycle.late as f64,
        OfBus::Foreign => cycle.foreign as f64,
        OfBus::Repeated => cycle.repeated as f64,
        OfBus::SlavesOperational => f64::from(cycle.slaves_operational),
    })
}
