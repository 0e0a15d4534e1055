//! A program read and interpreted whole: on a machine that is told, or one that stands somewhere.

use std::path::Path;

use machine::Machine;
use path::geometry::AxisVector;

use crate::bundle::read_program;
use crate::error::{ProgramError, ResumeError};
use crate::execution::interpret;
use crate::program::{Program, Setup};
use crate::question::Answer;
use crate::setup::tool_at;

/// Reads and interprets a program file, for a machine that is at `start` (machine coordinates).
///
/// What is no regular file, too large, not text or not a program is refused; a large file before it is read.
pub fn load(file: &Path, setup: &Setup, start: AxisVector) -> Result<Program, ProgramError> {
    let text = read_program(file, &[], setup.dialect)?;
    interpret(&file.display().to_string(), &text, setup, start)
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
    Ok(interpret(
        name,
        text,
        &Setup::rehearsed(machine, &[]),
        start,
    )?)
}

/// The same of a program file, with what a machine has answered to what the program asks; what comes behind the last answer is assumed.
///
/// # Errors
/// [`ResumeError`]; an answer is none to what is asked.
pub fn load_from(
    machine: &Machine,
    increments: &[i64],
    file: &Path,
    answers: &[Answer],
) -> Result<Program, ResumeError> {
    let text = read_program(file, &machine.subroutine_folders, machine.program.dialect)?;
    let setup = Setup::rehearsed(machine, answers);
    let start = tool_at(machine, increments)?;
    Ok(interpret(
        &file.display().to_string(),
        &text,
        &setup,
        start,
    )?)
}
