//! A program on a machine: expanded from where its axes are.

use std::path::Path;

use machine::Machine;
use path::geometry::AxisVector;
use path::kinematics::Kinematics;
use path::pivot::OutOfReach;

use crate::error::ResumeError;
use crate::program::{Program, Setup};
use crate::question::Answer;
use crate::{interpret, kinematics_of, read_program};

/// Where the tool is, in the coordinates of programs, with the command positions at these increments.
///
/// # Errors
/// The axes are where no program can start.
pub fn tool_at(machine: &Machine, increments: &[i64]) -> Result<AxisVector, OutOfReach> {
    let mut axes = AxisVector::zeros();
    let named = axes.iter_mut().zip(machine.program_axes());
    for ((value, axis), increments) in named.zip(increments) {
        *value = *increments as f64 * axis.increment_mm();
    }
    let kinematics = kinematics_of(machine);
    if let Kinematics::PivotY(pivot) = kinematics {
        let arm = machine.axes.get(pivot.arm);
        let window_deg = arm.map_or(0.0, |arm| arm.in_position_window_um() * 1e-3);
        pivot.check_start(&axes, window_deg)?;
    }
    Ok(kinematics.tool(&axes))
}

/// Interprets a program's text, for a machine with its command positions at these increments.
///
/// # Errors
/// [`ResumeError`].
pub fn resume_from(
    machine: &Machine,
    increments: &[i64],
    name: &str,
    text: &str,
) -> Result<Program, ResumeError> {
    resume_knowing(machine, increments, name, text, &[])
}

/// The same, with what a machine has answered to what the program asks; what comes behind the last answer is assumed.
///
/// # Errors
/// [`ResumeError`]; an answer is none to what is asked.
pub fn resume_knowing(
    machine: &Machine,
    increments: &[i64],
    name: &str,
    text: &str,
    answers: &[Answer],
) -> Result<Program, ResumeError> {
    let start = tool_at(machine, increments)?;
    let setup = Setup {
        rehearsed: true,
        answers: answers.to_vec(),
        ..Setup::of(machine)
    };
    Ok(interpret(name, text, &setup, start)?)
}

/// The same of a program file.
///
/// # Errors
/// [`ResumeError`].
pub fn load_from(
    machine: &Machine,
    increments: &[i64],
    file: &Path,
) -> Result<Program, ResumeError> {
    load_knowing(machine, increments, file, &[])
}

pub(crate) fn load_knowing(
    machine: &Machine,
    increments: &[i64],
    file: &Path,
    answers: &[Answer],
) -> Result<Program, ResumeError> {
    let text = read_program(file, &machine.subroutine_folders)?;
    let name = file.display().to_string();
    resume_knowing(machine, increments, &name, &text, answers)
}
