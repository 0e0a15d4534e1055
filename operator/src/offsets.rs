//! `offsets` and `zero`: the work offsets that the next program begins with.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use bus::numbers::short_numbers;
use bus::sample::{Feedback, Mode, Reference};
use machine::offsets_file::{G92_APPLIES, WORK_OFFSETS, first_parameter, parameter_of};
use machine::{Axis, KeptParameters, Machine, TURN_DEG, update_offsets};
use master::STANDSTILL_MM_S;
use monitor::words::shown;
use serde_json::{Map, Value, json};

use super::eyes::Eyes;
use super::kept::{Subject, is_started, number, pair, written};
use crate::options::{OffsetsChange, OffsetsOptions, ZeroOptions};
use console::exit::{Failure, Kind, Outcome};
use console::output::{joined, say};

/// `offsets`.
pub fn offsets(options: &OffsetsOptions) -> Outcome {
    let subject = Subject::of(options.machine.as_deref(), options.cell.as_deref())?;
    let file = file_of(&subject)?;
    match &options.change {
        None if options.json => say(&json_of(&subject, &file)),
        None => say(&table(&subject, &file)),
        Some(OffsetsChange::Set { offset, values }) => {
            let first = first_of(offset)?;
            let values = values
                .iter()
                .map(|word| value_of(&subject.machine, first, word));
            let values = values.collect::<Result<Vec<_>, _>>()?;
            change(&subject, &file, |now| now.extend(values))?;
            told(&subject, &file, &offset.to_uppercase())?;
        }
        Some(OffsetsChange::Clear { offset }) => {
            let offset = offset.to_uppercase();
            let group = match offset.as_str() {
                "G92" => G92_APPLIES..=G92_APPLIES + 9,
                _ => first_of(&offset)?..=first_of(&offset)? + 9,
            };
            change(&subject, &file, |now| {
                now.retain(|number, _| !group.contains(number));
            })?;
            told(&subject, &file, &offset)?;
        }
    }
    Ok(())
}

/// `zero`.
pub fn zero(options: &ZeroOptions) -> Outcome {
    let subject = Subject::of(None, options.cell.as_deref())?;
    let file = file_of(&subject)?;
    let client = subject.client.as_ref();
    let client = client.ok_or_else(|| Failure::Input(anyhow!("no cell runs")))?;
    let now = Eyes::open(client)?.look()?;
    let machine = &client.machine_of_next_program(&now.auxiliary).input()?;
    let letters = options.axes.iter().map(|word| letter_of(machine, word));
    let letters = letters.collect::<Result<Vec<_>, _>>()?;
    may_touch_off(&subject, &now, &letters)?;
    let offset = options.offset.as_deref().map(str::to_uppercase);
    let offset = offset.as_deref().unwrap_or(in_force(machine));
    let first = first_of(offset)?;
    let length = options.tool.as_deref();
    let applied = machine.beginning.offset_by_letter();
    let length = length.map_or(Ok(applied), |name| tool_length(machine, name))?;
    let found = Touched {
        machine,
        now: &now,
        first,
        length,
    };
    let values = found.offsets(&letters, options.at);
    for (number, value) in &values {
        judge(machine, *number, first, *value)?;
    }
    change(&subject, &file, |now| now.extend(values))?;
    told(&subject, &file, offset)
}

fn file_of(subject: &Subject) -> Result<PathBuf, Failure> {
    subject.files.offsets.clone().ok_or_else(|| {
        Failure::Input(anyhow!(
            "{}: its machine file holds `parameters` itself, as the copies of a run do: name the machine's own file",
            subject.name()
        ))
    })
}

fn first_of(offset: &str) -> Result<u32, Failure> {
    let known = WORK_OFFSETS.join(" ");
    first_parameter(&offset.to_uppercase())
        .ok_or_else(|| Failure::Input(anyhow!("{offset:?}: a work offset is one of {known}")))
}

fn in_force(machine: &Machine) -> &'static str {
    let index = machine.work_offset_in_force();
    WORK_OFFSETS.get(index).copied().unwrap_or("G54")
}

/// A parameter as the next program begins with it.
fn value(machine: &Machine, number: u32) -> f64 {
    let kept = machine.parameters.get(&number).copied();
    kept.unwrap_or_else(|| machine.parameter_default(number))
}

fn letter_of(machine: &Machine, word: &str) -> Result<char, Failure> {
    let letters = machine.program_letters();
    let upper = word.to_uppercase();
    let found = letters.iter().find(|letter| letter.to_string() == upper);
    found.copied().ok_or_else(|| {
        let known = joined(&letters, " ");
        let what = format!("the machine has none of that name; it has {known}");
        Failure::input(format!("axis {word:?}: {what}"))
    })
}

/// A word such as `X=12.5` as a parameter of a work offset.
fn value_of(machine: &Machine, first: u32, word: &str) -> Result<(u32, f64), Failure> {
    let (name, text) = pair(word)?;
    let letter = match name.to_uppercase().as_str() {
        "R" => 'R',
        _ => letter_of(machine, name)?,
    };
    let parameter = parameter_of(first, letter).unwrap_or(first);
    let value = number(&letter.to_string(), text)?;
    judge(machine, parameter, first, value)?;
    Ok((parameter, value))
}

/// Refuses an offset that lies out of the travel by more than the travel is long, and a rotation of more than a turn.
fn judge(machine: &Machine, parameter: u32, first: u32, value: f64) -> Result<(), Failure> {
    let letters = machine.program_letters();
    let mut letters = letters.iter();
    let letter = letters.find(|letter| parameter_of(first, **letter) == Some(parameter));
    let axis = letter.and_then(|letter| axis_of(machine, *letter));
    let (what, low, high) = match (letter, axis) {
        (None, _) => ("R", -360.0, 360.0),
        (Some(_), Some(axis)) if axis.modulo => (axis.name.as_str(), -TURN_DEG, TURN_DEG),
        (Some(_), Some(axis)) => {
            let length = axis.travel_max_mm - axis.travel_min_mm;
            let (low, high) = (axis.travel_min_mm - length, axis.travel_max_mm + length);
            (axis.name.as_str(), low, high)
        }
        // An arm that is in for Y.
        (Some(_), None) => ("Y", -1e5, 1e5),
    };
    if (low..=high).contains(&value) {
        return Ok(());
    }
    let value = short_numbers(value.to_string());
    Err(Failure::Input(anyhow!(
        "{what} = {value}: must be from {low} to {high}: an offset lies out of the travel of its axis by the length of that travel at most"
    )))
}

fn axis_of(machine: &Machine, letter: char) -> Option<&Axis> {
    let mut axes = machine.axes.iter();
    axes.find(|axis| axis.name.starts_with(letter))
}

fn change(
    subject: &Subject,
    file: &Path,
    change: impl FnOnce(&mut KeptParameters),
) -> Result<(), Failure> {
    subject.must_be_between_runs(file)?;
    written(update_offsets(file, &subject.machine, change))
}

/// Says what a work offset is now.
fn told(subject: &Subject, file: &Path, offset: &str) -> Outcome {
    let mut machine = subject.machine.clone();
    let kept = subject.files.read(&machine).input()?;
    machine.take_kept(kept).input()?;
    let first = match offset {
        "G92" => G92_APPLIES + 1,
        _ => first_of(offset)?,
    };
    let letters = machine.program_letters();
    let values = letters.iter().filter_map(|letter| {
        let value = shown(value(&machine, parameter_of(first, *letter)?), 4);
        Some(format!("{letter} {value} {}", subject.unit(*letter)))
    });
    subject.say_changed(&format!("{offset} is {}", joined(values, "  ")), file);
    Ok(())
}

/// The work offsets, a line each.
fn table(subject: &Subject, file: &Path) -> String {
    let machine = &subject.machine;
    let letters = machine.program_letters();
    let mut text = format!(
        "{}: work offsets in machine coordinates ({})\n",
        subject.name(),
        file.display()
    );
    text.push_str("         ");
    for letter in letters.iter().chain(['R'].iter()) {
        let heading = format!("{letter} {}", subject.unit(*letter));
        text.push_str(&format!("{heading:>12}"));
    }
    let row = |name: &str, first: u32, turned: bool, mark: &str| {
        let letters = letters.iter().chain(['R'].iter().filter(|_| turned));
        let values = letters.filter_map(|letter| parameter_of(first, *letter));
        let values = values.map(|number| format!("{:>12}", shown(value(machine, number), 4)));
        format!("\n{mark}{name:<7}{}", values.collect::<String>())
    };
    let mark = |is_in_force: bool| if is_in_force { "▸ " } else { "  " };
    for name in WORK_OFFSETS {
        let (first, mark) = (first_parameter(name), mark(name == in_force(machine)));
        text.push_str(&row(name, first.unwrap_or(0), true, mark));
    }
    let mark = mark(value(machine, G92_APPLIES) != 0.0);
    text.push_str(&row("G92", G92_APPLIES + 1, false, mark));
    text.push_str("\n▸ in force when a program begins");
    if !file.exists() {
        text.push_str(&format!(
            "; {} is not there yet: the first `offsets set` or `zero` makes it, and from then on programs keep what they set",
            file.display()
        ));
    }
    text
}

fn json_of(subject: &Subject, file: &Path) -> String {
    let machine = &subject.machine;
    let position = |first: u32, unit: &str| -> Map<String, Value> {
        let letters = machine.program_letters().into_iter();
        letters
            .filter(|letter| subject.unit(*letter) == unit)
            .filter_map(|letter| {
                let number = parameter_of(first, letter)?;
                Some((letter.to_string(), json!(value(machine, number))))
            })
            .collect()
    };
    let offsets = WORK_OFFSETS.map(|name| {
        let first = first_parameter(name).unwrap_or(0);
        json!({
            "offset": name,
            "in_force": name == in_force(machine),
            "position_mm": position(first, "mm"),
            "position_deg": position(first, "deg"),
            "rotation_deg": value(machine, first + 9),
        })
    });
    let all = json!({
        "machine": machine.name,
        "file": file.display().to_string(),
        "file_exists": file.exists(),
        "offsets": offsets,
        "g92": {
            "applies": value(machine, G92_APPLIES) != 0.0,
            "position_mm": position(G92_APPLIES + 1, "mm"),
            "position_deg": position(G92_APPLIES + 1, "deg"),
        },
    });
    serde_json::to_string_pretty(&all).unwrap_or_default()
}

fn tool_length(machine: &Machine, name: &str) -> Result<[f64; 9], Failure> {
    let number = name.trim_start_matches(['T', 't']).parse().ok();
    let tools = machine.tools.iter();
    let tool = tools.clone().find(|tool| Some(tool.number) == number);
    tool.map(|tool| tool.offset).ok_or_else(|| {
        let known = match machine.tools.len() {
            0 => "none".into(),
            _ => joined(tools.map(|tool| format!("T{}", tool.number)), " "),
        };
        Failure::input(format!("tool {name:?}: the tool table has {known}"))
    })
}

/// Refuses while something moves, a program is started, or an axis has no reference.
fn may_touch_off(subject: &Subject, now: &Feedback, letters: &[char]) -> Result<(), Failure> {
    let refuse = |why: String| Failure::Stopped(anyhow!("{}: refused: {why}", subject.name()));
    if is_started(now) {
        return Err(refuse(format!(
            "run {} is started: touch off once it is over, or after `quadrant load`",
            now.run
        )));
    }
    let moves = |axis: &bus::sample::AxisFeedback| axis.velocity_mm_s.abs() >= STANDSTILL_MM_S;
    let mode = Mode::from_wire(now.mode);
    let is_moved = matches!(mode, Some(Mode::Jogging | Mode::Stopping));
    if is_moved || now.rested == 0 && now.axes().iter().any(moves) {
        return Err(refuse("an axis moves: touch off at rest".into()));
    }
    if mode == Some(Mode::Tripped) {
        return Err(refuse("the machine has tripped: where its axes stand is not known well enough; `quadrant enable` first".into()));
    }
    for (axis, sample) in subject.machine.axes.iter().zip(now.axes()) {
        let is_meant = letters.iter().any(|letter| axis.name.starts_with(*letter));
        let is_meant = is_meant || subject.machine.kinematics.is_some();
        if is_meant && sample.reference != Reference::Known as u32 {
            let why = match Reference::from_wire(sample.reference) {
                Some(Reference::Unseen) => "shows no place: its drive does not answer",
                Some(Reference::Displaced) => {
                    "came back elsewhere than its drive was lost: `quadrant alarms acknowledge` first"
                }
                _ => "has no reference: `quadrant home` first",
            };
            return Err(refuse(format!("axis {} {why}", axis.name)));
        }
    }
    Ok(())
}

/// Where the machine is, seen from a work offset.
struct Touched<'a> {
    machine: &'a Machine,
    now: &'a Feedback,
    /// First parameter of the work offset.
    first: u32,
    /// Of the tool, by letters.
    length: [f64; 9],
}

impl Touched<'_> {
    /// The tool's place in the machine along a letter, without the length of the tool.
    fn place(&self, letter: char) -> f64 {
        let mut axes = path::geometry::AxisVector::zeros();
        let samples = self.machine.axes.iter().zip(self.now.axes());
        for (to, (axis, sample)) in axes.iter_mut().zip(samples) {
            *to = axis.shown(sample.command_position as f64 * axis.increment_mm());
        }
        let tool = program::kinematics_of(self.machine).tool(&axes);
        let setup = program::Setup::of(self.machine);
        let index = setup.axes.iter().position(|axis| axis.letter == letter);
        let place = index.and_then(|index| tool.get(index)).copied();
        let at = machine::offsets_file::parameter_of(0, letter).unwrap_or(0);
        place.unwrap_or(0.0) - self.length.get(at as usize).copied().unwrap_or(0.0)
    }

    fn offset(&self, letter: char) -> f64 {
        parameter_of(self.first, letter).map_or(0.0, |number| value(self.machine, number))
    }

    fn g92(&self, letter: char) -> f64 {
        let number = parameter_of(G92_APPLIES + 1, letter).unwrap_or(0);
        match value(self.machine, G92_APPLIES) {
            0.0 => 0.0,
            _ => value(self.machine, number),
        }
    }

    /// Parameters with which the machine is at `at` along these letters, and as before along all others.
    fn offsets(&self, letters: &[char], at: f64) -> Vec<(u32, f64)> {
        let rotation_rad = value(self.machine, self.first + 9).to_radians();
        let has_both = ['X', 'Y']
            .iter()
            .all(|letter| self.machine.program_letters().contains(letter));
        let is_turned = rotation_rad != 0.0 && has_both;
        let turns = |letter: &char| is_turned && matches!(letter, 'X' | 'Y');
        let mut offsets: Vec<(char, f64)> = letters
            .iter()
            .filter(|letter| !turns(letter))
            .map(|letter| (*letter, self.place(*letter) - (at + self.g92(*letter))))
            .collect();
        if letters.iter().any(turns) {
            let (sin, cos) = (libm::sin(rotation_rad), libm::cos(rotation_rad));
            let (dx, dy) = (
                self.place('X') - self.offset('X'),
                self.place('Y') - self.offset('Y'),
            );
            let mut x = dx * cos + dy * sin;
            let mut y = dy * cos - dx * sin;
            if letters.contains(&'X') {
                x = at + self.g92('X');
            }
            if letters.contains(&'Y') {
                y = at + self.g92('Y');
            }
            offsets.push(('X', self.place('X') - (x * cos - y * sin)));
            offsets.push(('Y', self.place('Y') - (x * sin + y * cos)));
        }
        let numbered = offsets.into_iter();
        numbered
            .filter_map(|(letter, value)| {
                // To a picometre: what the sum of two decimal numbers leaves behind is nobody's.
                let value = (value * 1e9).round() / 1e9;
                Some((parameter_of(self.first, letter)?, value))
            })
            .collect()
    }
}
