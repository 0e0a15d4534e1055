//! Logic of `machines/xyz-cell`, as its `logic.py`: a changer with eight places, a vice, lubrication and a lamp.
//!
//! It remembers nothing that it could not read back: what must outlive it are signals that keep their values (`spindle_tool`, `pocket`,
//! `changing`, `taking`).

use std::process::ExitCode;

use quadrant_logic::{Io, Logic};

const PLACES: u32 = 8;
/// Longest time for one step of the changer, and times of the lubrication, in s of the machine.
const STEP_S: f64 = 5.0;
const LUBE_EVERY_S: f64 = 60.0;
const LUBE_FOR_S: f64 = 2.0;

/// Steps of a change. The number is kept in the signal `changing`, so that a logic that is started again goes on where the last one was.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Idle,
    ToOld,
    InOld,
    OpenOld,
    OutOld,
    ToNew,
    InNew,
    CloseNew,
    OutNew,
}

const STEPS: [Step; 9] = [
    Step::Idle,
    Step::ToOld,
    Step::InOld,
    Step::OpenOld,
    Step::OutOld,
    Step::ToNew,
    Step::InNew,
    Step::CloseNew,
    Step::OutNew,
];

/// Puts the tool in the spindle back into its place, and takes the one that is wanted.
#[derive(Default)]
struct Changer {
    pulse: Option<bool>,
    since_s: f64,
    step: Option<Step>,
}

fn number(io: &Io<'_>, signal: &str) -> u32 {
    io.value(signal) as u32
}

/// Turns the carousel until this place is there.
fn turns_to(io: &mut Io<'_>, place: u32) -> bool {
    let is_there = number(io, "pocket") == place;
    io.set("carousel_motor", !is_there);
    is_there
}

impl Changer {
    fn update(&mut self, io: &mut Io<'_>) {
        let kept = number(io, "changing") as usize;
        let before = STEPS.get(kept).copied().unwrap_or(Step::Idle);
        let (tool, wanted) = (number(io, "spindle_tool"), number(io, "tool_wanted"));
        // What was wanted when the change began: the program may be given up meanwhile, and another tool be wanted.
        let taking = number(io, "taking");
        self.count_places(io);
        // Nothing moves but while the program waits for the change: not in hold, and not where nobody has asked for it.
        let given_up = before != Step::Idle && io.machine().program != "running";
        let moves = io.is_on("tool_change") || given_up && io.is_on("finish_change");
        if given_up {
            io.alarm(703);
            io.inhibit();
        }
        let step = match before {
            same if !moves => same,
            Step::Idle if wanted != tool && wanted <= PLACES => {
                io.set("taking", wanted);
                match tool {
                    0 => Step::OpenOld,
                    _ => Step::ToOld,
                }
            }
            Step::ToOld if turns_to(io, tool) => Step::InOld,
            Step::InOld if io.is_on("arm_in") => Step::OpenOld,
            Step::OpenOld if !io.is_on("tool_clamped") => Step::OutOld,
            Step::OutOld if io.is_on("arm_out") => {
                // An empty spindle that was wanted is reported once the changer is back.
                if taking == 0 {
                    Step::CloseNew
                } else {
                    io.set("spindle_tool", 0);
                    Step::ToNew
                }
            }
            Step::ToNew if turns_to(io, taking) => Step::InNew,
            Step::InNew if io.is_on("arm_in") => Step::CloseNew,
            Step::CloseNew if io.is_on("tool_clamped") => Step::OutNew,
            Step::OutNew if io.is_on("arm_out") => {
                io.set("spindle_tool", taking);
                Step::Idle
            }
            same => same,
        };
        use Step::{CloseNew, InNew, InOld, OpenOld, OutOld, ToNew, ToOld};
        io.set("changing", step as u32);
        io.set(
            "arm_valve",
            matches!(step, InOld | OpenOld | InNew | CloseNew),
        );
        io.set(
            "drawbar_valve",
            matches!(step, OpenOld | OutOld | ToNew | InNew),
        );
        if !moves || !matches!(step, ToOld | ToNew) {
            io.set("carousel_motor", false);
        }
        self.watch(io, step, moves);
    }

    /// A rising pulse is a place further; place 8 is followed by place 1.
    fn count_places(&mut self, io: &mut Io<'_>) {
        let pulse = io.is_on("pocket_pulse");
        if pulse && self.pulse == Some(false) {
            io.set("pocket", number(io, "pocket") % PLACES + 1);
        }
        self.pulse = Some(pulse);
    }

    /// A step that lasts too long is an alarm.
    fn watch(&mut self, io: &mut Io<'_>, step: Step, moves: bool) {
        if self.step != Some(step) || !moves {
            (self.step, self.since_s) = (Some(step), io.time_s());
        }
        if step != Step::Idle && io.time_s() - self.since_s > STEP_S {
            io.alarm(701);
        }
    }
}

#[derive(Default)]
struct Cell {
    changer: Changer,
    lube_since_s: Option<f64>,
}

impl Logic for Cell {
    fn update(&mut self, io: &mut Io<'_>) {
        self.changer.update(io);
        io.set("vice_valve", io.is_on("vice_wanted"));
        let time_s = io.time_s();
        let since_s = match self.lube_since_s {
            Some(since_s) if time_s - since_s <= LUBE_EVERY_S => since_s,
            _ => time_s,
        };
        self.lube_since_s = Some(since_s);
        let lubricates = time_s - since_s < LUBE_FOR_S;
        io.set("lube_pump", lubricates);
        if lubricates && time_s - since_s > LUBE_FOR_S - 0.1 && !io.is_on("lube_pressure") {
            io.alarm(702);
        }
        io.set("lamp_red", io.is_on("tripped"));
        io.set("lamp_green", io.is_on("program_runs"));
    }
}

fn main() -> ExitCode {
    quadrant_logic::run(Cell::default())
}
