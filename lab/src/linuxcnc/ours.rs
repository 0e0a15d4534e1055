//! Our interpreter, on a machine with travel enough for any program.

use std::path::Path;
use std::sync::LazyLock;

use machine::{Tool, parse_tools};
use path::geometry::{AxisVector, Feed, Shape};
use program::{AxisSetup, EventKind, Program, ProgramEnd, Setup, SurfaceSpeed};

use crate::linuxcnc::trace::{Circle, LETTERS, Place, Step, Trace, Way};

static TOOLS: LazyLock<Vec<Tool>> = LazyLock::new(|| {
    let text = std::fs::read_to_string(crate::linuxcnc::theirs::tools())
        .expect("the tool table of the comparison");
    parse_tools("tools.tbl", &text).expect("a tool table")
});

/// A machine with all axes of a [`Place`].
pub fn setup() -> Setup {
    Setup {
        axes: LETTERS
            .chars()
            .map(|letter| AxisSetup {
                letter,
                travel_min: -1e9,
                travel_max: 1e9,
                rotary: "ABC".contains(letter),
                modulo: false,
            })
            .collect(),
        tools: TOOLS.clone(),
        answers_assumed: true,
        ..Setup::default()
    }
}

/// What we make of a program.
pub fn run(file: &Path) -> Trace {
    let setup = setup();
    let result = std::panic::catch_unwind(|| program::load(file, &setup, AxisVector::zeros()));
    match result {
        // Theirs ends with an error, and the text of it.
        Ok(Ok(program)) if matches!(program.end, ProgramEnd::Abort(_)) => {
            let said = program.messages.last();
            Err(said.map_or(String::new(), |said| said.text.clone()))
        }
        Ok(Ok(program)) => Ok(steps(&program, &setup)),
        Ok(Err(error)) => Err(error.problems.first().map_or(String::new(), |problem| {
            let line = problem.place.map_or(0, |(line, _)| line);
            format!("line {line}: {}: {}", problem.found, problem.right)
        })),
        Err(_) => Err("PANIC".into()),
    }
}

/// What it says, before which element; a place for messages.
fn messages(program: &Program) -> Vec<(usize, String)> {
    let named = program.messages.iter().map(|message| {
        let kind = if message.log_only { "log" } else { "message" };
        let text: Vec<&str> = message.text.split_whitespace().collect();
        (message.before_element, format!("{kind} {}", text.join(" ")))
    });
    named.collect()
}

fn steps(program: &Program, setup: &Setup) -> Vec<Step> {
    let mut steps = vec![];
    let said = messages(program);
    let (mut events, mut said) = (
        program.events.iter().peekable(),
        said.into_iter().peekable(),
    );
    let mut surface = None;
    let mut before = |index: usize, steps: &mut Vec<Step>| {
        while let Some(event) = events.next_if(|event| event.before_element <= index) {
            tell(event.kind, &mut surface, steps);
        }
        while let Some((_, text)) = said.next_if(|(at, _)| *at <= index) {
            steps.push(Step::word(&text, &[]));
        }
    };
    for (index, element) in program.path.elements.iter().enumerate() {
        before(index, &mut steps);
        let (way, feed) = match element.feed {
            Feed::Rapid => (Way::Rapid, 0.0),
            Feed::PathMmS(_) if followed(&steps) => (Way::Feed, f64::NAN),
            Feed::PathMmS(speed) => (Way::Feed, speed * 60.0),
        };
        let travel = |from: &AxisVector, to: &AxisVector, circle| Step::Move {
            way,
            line: element.line,
            from: place(from, setup),
            to: place(to, setup),
            feed,
            circle,
        };
        steps.push(match &element.shape {
            Shape::Line { from, to } => travel(from, to, None),
            Shape::Dwell { seconds, .. } => Step::Dwell { seconds: *seconds },
            Shape::Arc {
                from,
                to,
                centre,
                radius_mm,
                u,
                v,
                sweep_rad,
                ..
            } => {
                let direction = |unit: &AxisVector| {
                    let [x, y, z, ..] = place(unit, setup);
                    [x, y, z]
                };
                let circle = Circle {
                    centre: place(centre, setup),
                    plane: [direction(u), direction(v)],
                    sweep_rad: *sweep_rad,
                    radii_mm: [*radius_mm; 2],
                    others: vec![],
                };
                travel(from, to, Some(circle))
            }
        });
    }
    before(usize::MAX, &mut steps);
    steps
}

/// An event; a tap is told by what happens in it.
fn tell(kind: EventKind, surface: &mut Option<SurfaceSpeed>, steps: &mut Vec<Step>) {
    match kind {
        EventKind::SpindleCoupled(_)
        | EventKind::SpindleUncoupled
        | EventKind::ToolOffsetOf(_)
        | EventKind::ToolOffset { .. } => return,
        EventKind::SurfaceSpeed(new) => return surface_words(surface.replace(new), new, steps),
        EventKind::SpindleSpeedRpm(_) => *surface = None,
        _ => {}
    }
    word(&format!("{kind:?}"), steps);
}

/// G96 and S in it; where only the zero of X has changed theirs says nothing.
fn surface_words(old: Option<SurfaceSpeed>, new: SurfaceSpeed, steps: &mut Vec<Step>) {
    let limit_rpm = |of: SurfaceSpeed| of.limit_rpm.unwrap_or(1e30);
    let same_limit = old.is_some_and(|old| limit_rpm(old) == limit_rpm(new));
    let follows = old.is_some_and(|old| old.m_min == new.m_min && old.centre_mm != new.centre_mm);
    if same_limit && follows {
        return;
    }
    if !same_limit {
        steps.push(Step::word("spindle mode", &[limit_rpm(new)]));
    }
    steps.push(Step::word("speed", &[new.m_min]));
}

/// Whether the motion follows the spindle: it has no feed of its own then.
fn followed(steps: &[Step]) -> bool {
    let mut words = steps.iter().rev().filter_map(|step| match step {
        Step::Word { name, .. } if name.ends_with("synchronised") => Some(name == "synchronised"),
        Step::Word { .. } | Step::Move { .. } | Step::Spline { .. } | Step::Dwell { .. } => None,
    });
    words.next().unwrap_or(false)
}

fn place(vector: &AxisVector, setup: &Setup) -> Place {
    let mut place = [0.0; 9];
    for (axis, value) in setup.axes.iter().zip(vector.iter()) {
        if let Some(slot) = LETTERS
            .find(axis.letter)
            .and_then(|index| place.get_mut(index))
        {
            *slot = *value;
        }
    }
    place
}

/// The numbers in the text of an event, true and false as 1 and 0.
fn numbers(text: &str) -> Vec<f64> {
    text.split(|c: char| !(c.is_alphanumeric() || "+-.".contains(c)))
        .filter_map(|word| match word {
            "true" => Some(1.0),
            "false" => Some(0.0),
            _ => word.parse().ok(),
        })
        .collect()
}

fn word(event: &str, steps: &mut Vec<Step>) {
    let kind = event.split(['(', ' ']).next().unwrap_or_default();
    let name = match kind {
        "SpindleSpeedRpm" => "speed",
        "SpindleClockwise" => "clockwise",
        "SpindleCounterClockwise" => "counter-clockwise",
        "SpindleStop" => "spindle stop",
        "SpindleOrient" => "orient",
        "SpindleFollowed" => "synchronised",
        "SpindleReleased" => "not synchronised",
        "Mist" => "mist",
        "Flood" => "flood",
        "ToolPrepare" => "select tool",
        "ToolChange" => "change tool",
        "ToolIs" => "tool is",
        "ProgramStop" => "stop",
        "OptionalStop" => "optional stop",
        "PalletStop" => "pallet",
        "OverridesEnabled" => "overrides",
        "DigitalOutput" => "output",
        "AnalogOutput" => "analogue output",
        // Theirs shows none.
        "Probe" | "ProbeEnd" | "AwaitInput" => return,
        other => other,
    };
    let values = numbers(event.get(kind.len()..).unwrap_or_default());
    steps.push(Step::word(name, &values));
}
