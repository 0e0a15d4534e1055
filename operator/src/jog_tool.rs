//! A jog along an axis that programs have and the machine has not (an arm is in for Y): a typed-in block moves the tool along it.

use anyhow::anyhow;
use machine::Machine;
use path::geometry::AxisVector;
use path::kinematics::Kinematics;
use program::{Setup, kinematics_of};

use super::Client;
use super::eyes::Eyes;
use super::jog::{Asked, ways_of};
use super::mdi;
use super::work::next_start;
use crate::options::JogOptions;
use console::exit::{Failure, Outcome};

/// Whether the tool is to be jogged, by letters of programs, and not axes of the machine.
pub(super) fn is_asked(machine: &Machine, words: &[(&str, f64)], options: &JogOptions) -> bool {
    let letters = machine.program_letters();
    let made = |letter: &str| {
        let letter = letter.to_uppercase();
        let is_of_program = letters.iter().any(|known| known.to_string() == letter);
        is_of_program && machine.program_axis_index(&letter).is_err()
    };
    let by_tool = options.to_work && kinematics_of(machine) != Kinematics::Cartesian;
    by_tool || words.iter().any(|(letter, _)| made(letter))
}

/// Runs the block, and waits until it is done.
pub(super) fn jog(client: &Client, asked: &Asked<'_>, options: &JogOptions) -> Outcome {
    let bad = |wrong: String| Failure::Input(anyhow!(wrong));
    let machine = &client.machine;
    let setup = Setup::of(machine);
    let Asked::By(words) = asked else {
        let what = "jog Y: an arm makes it, and it goes by distances or to places alone: `jog Y 1`";
        return Err(bad(what.into()));
    };
    let known = setup.axes.iter().map(|axis| axis.letter.to_string());
    let known: Vec<String> = known.collect();
    let ways = ways_of(words, |letter| {
        let index = known.iter().position(|of| of == letter);
        index.ok_or_else(|| {
            bad(format!(
                "jog {letter}: the tool is moved along {}; the arm that makes Y is jogged alone, by distances",
                known.join(" ")
            ))
        })
    })?;
    let now = Eyes::open(client)?.look()?;
    let before = next_start(machine, &client.cell.place, &now.auxiliary);
    let motion = before.and_then(|modal| modal.codes.first().cloned());
    let tool = kinematics_of(machine).tool(&program::commanded(machine, &now));
    let speed_mm_min = options.speed.unwrap_or(machine.manual.jog_mm_s * 60.0);
    let text = block(&setup, &tool, &ways, speed_mm_min, options);
    mdi::run(client, "jog", &restoring(&text, motion.as_deref()))
}

/// The block, which leaves its modes.
fn block(
    setup: &Setup,
    tool: &AxisVector,
    ways: &[(usize, f64)],
    speed_mm_min: f64,
    options: &JogOptions,
) -> String {
    let words = ways.iter().filter_map(|(index, number)| {
        let (axis, at) = setup.axes.get(*index).zip(tool.get(*index))?;
        let is_way = !options.to_work && !options.to_machine;
        let place = if is_way { at + number } else { *number };
        Some(format!(" {}{place:.9}", axis.letter))
    });
    let words: String = words.collect();
    let of = if options.to_work { "" } else { "G53 " };
    format!("{of}G1{words} F{speed_mm_min}")
}

/// A block with the modes of before restored behind it.
fn restoring(block: &str, motion: Option<&str>) -> String {
    let motion = motion.unwrap_or("G1");
    format!("M70\nG8 G21 G90 G94\n{block}\nM72\n{motion}")
}
