//! A program on a machine: expanded from where its axes are.

use std::path::Path;

use control::kinematics::Kinematics;
use control::path::AxisVector;
use control::pivot::OutOfReach;
use machine::Machine;

use crate::error::ResumeError;
use crate::program::{Program, Setup};
use crate::{interpret, kinematics_of, read_program};

/// Where the tool is, in the coordinates of programs, with the command positions at these increments.
///
/// # Errors
/// The axes are where no program can start.
pub fn tool_at(machine: &Machine, increments: &[i64]) -> Result<AxisVector, OutOfReach> {
    let mut axes = AxisVector::zeros();
    for ((value, axis), increments) in axes.iter_mut().zip(&machine.axes).zip(increments) {
        *value = *increments as f64 * axis.increment_mm();
    }
    let kinematics = kinematics_of(machine);
    if let Kinematics::PivotY(pivot) = kinematics {
        pivot.check_start(&axes)?;
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
    let start = tool_at(machine, increments)?;
    let setup = Setup {
        rehearsed: true,
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
    let text = read_program(file, &machine.subroutine_folders)?;
    resume_from(machine, increments, &file.display().to_string(), &text)
}
