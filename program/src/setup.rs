//! What the machine file says of programs.

use bus::sample::AnswerOutcome;
use std::sync::Arc;

use machine::{self, AxisKind, Carried, DecimalPoint, KinematicsKind, Machine};
use path::geometry::{AxisVector, PATH_AXES};
use path::kinematics::Kinematics;
use path::pivot::{self, OutOfReach, PivotY};
use path::tool_centre::{RotaryLine, ToolCentre};

use crate::error::{ProgramError, refuse_file};
use crate::letters::AXIS_LETTERS;
use crate::program::{AxisSetup, Setup};
use crate::question::Answer;
use crate::words::unknown_mode;

impl Setup {
    /// The machine as the interpreter needs to know it.
    ///
    /// An arm that is in for Y is Y here, with its reach for travel. X may go as far beyond the slide's travel as the arm
    /// draws the tool back; what the slide itself can reach is judged along the path ([`PivotY::check`]).
    pub fn of(machine: &Machine) -> Setup {
        let mut work_offset = AxisVector::zeros();
        let mut axes: Vec<AxisSetup> = machine
            .program_axes()
            .iter()
            .map(|axis| AxisSetup {
                letter: axis.name.chars().next().unwrap_or('?'),
                travel_min: axis.travel_min_mm,
                travel_max: axis.travel_max_mm,
                rotary: axis.kind == AxisKind::Rotary,
                modulo: axis.modulo,
            })
            .collect();
        if let Kinematics::PivotY(pivot) = kinematics_of(machine) {
            if let Some(arm) = axes.get_mut(pivot.arm) {
                let (low_mm, high_mm) = pivot.reach_mm();
                *arm = AxisSetup {
                    letter: 'Y',
                    travel_min: low_mm,
                    travel_max: high_mm,
                    rotary: false,
                    modulo: false,
                };
            }
            if let Some(slide) = axes.get_mut(pivot.slide) {
                slide.travel_min -= pivot.drawn_back_max_mm();
                slide.travel_max += pivot.drawn_back_max_mm();
            }
        }
        for (offset, axis) in work_offset.iter_mut().zip(&axes) {
            let letter = axis.letter.to_string();
            *offset = machine.program.work_offset(&letter).unwrap_or(0.0);
        }
        Setup {
            axes,
            work_offset,
            parameters: machine.parameters.clone(),
            beginning: machine.beginning.clone(),
            tools: machine.tools.clone(),
            block_delete: machine.program.block_delete,
            tool_centre: tool_centre_of(machine).map(Arc::new),
            dialect: machine.program.dialect,
            standard_decimal_point: machine.program.fanuc_decimal_point == DecimalPoint::Standard,
            tolerance_mm: machine.path.tolerance_mm,
            probe: machine.program.probe,
            spindle_max_rpm: machine
                .spindle
                .as_ref()
                .map(|spindle| spindle.speed_max_rpm),
            user_codes: !machine.program.user_codes.is_empty(),
            machine_codes: machine.functions.machine_codes().to_vec(),
            ..Setup::default()
        }
    }

    /// The same for a program that is read beside its machine: these answers are known, and what comes behind them is assumed.
    pub fn rehearsed(machine: &Machine, answers: &[Answer]) -> Setup {
        Setup {
            rehearsed: true,
            answers: answers.to_vec(),
            ..Setup::of(machine)
        }
    }
}

/// How the axes of a machine carry the tool that programs move.
pub fn kinematics_of(machine: &Machine) -> Kinematics {
    let pivot = machine
        .kinematics
        .as_ref()
        .and_then(|kinematics| match kinematics.kind {
            KinematicsKind::PivotY => Some(PivotY {
                slide: kinematics.slide_index(&machine.axes)?,
                arm: kinematics.arm_index(&machine.axes)?,
                arm_length_mm: kinematics.arm_length_mm,
                arm_min_deg: kinematics.arm_min_deg,
                arm_max_deg: kinematics.arm_max_deg,
                carries: match kinematics.carries {
                    machine::Carries::Arm => pivot::Carries::Arm,
                    machine::Carries::Work => pivot::Carries::Work,
                },
            }),
        });
    pivot.map_or(Kinematics::Cartesian, Kinematics::PivotY)
}

/// How the rotary axes of a machine turn tool and work; none where its file does not say.
fn tool_centre_of(machine: &Machine) -> Option<ToolCentre> {
    let index = |letter: &str| {
        let mut axes = machine.program_axes().iter();
        axes.position(|axis| axis.name == letter)
    };
    let slides = [index("X")?, index("Y")?, index("Z")?];
    let lines = |carried: Carried| -> Option<Vec<RotaryLine>> {
        let lines = machine.rotary_lines.iter();
        let lines = lines.filter(|line| line.carries == carried).map(|line| {
            let point_mm = line.point_mm.as_slice().try_into().ok()?;
            let direction = line.direction.as_slice().try_into().ok()?;
            RotaryLine::new(index(&line.axis)?, point_mm, direction)
        });
        lines.collect()
    };
    let (work, tool) = (lines(Carried::Work)?, lines(Carried::Tool)?);
    let turns = !(work.is_empty() && tool.is_empty());
    turns.then(|| ToolCentre::new(slides, work, tool))
}

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

impl Answer {
    /// What the machine has said, to a probing motion or about an input.
    ///
    /// # Errors
    /// The axes are where no program can go on from.
    pub fn said(
        machine: &Machine,
        said: &bus::sample::Answer,
        probes: bool,
    ) -> Result<Answer, OutOfReach> {
        if !probes {
            return Ok(Answer::Input(said.value));
        }
        let rests = tool_at(machine, &said.rests)?;
        if said.outcome == AnswerOutcome::Missed as u32 {
            return Ok(Answer::Missed { rests });
        }
        let at = tool_at(machine, &said.tripped)?;
        Ok(Answer::Tripped { at, rests })
    }
}

/// Refuses a machine no program can run on; machine files are checked long before.
pub fn check_setup(name: &str, setup: &Setup, start: &AxisVector) -> Result<(), ProgramError> {
    let finite = |vector: &AxisVector| vector.iter().all(|component| component.is_finite());
    let axes = setup.axes.as_slice();
    if axes.is_empty() || axes.len() > PATH_AXES {
        let found = format!("machine with {} axes", axes.len());
        return refuse_file(name, found, "1 to 9 axes");
    }
    for (axis, before) in axes.iter().zip(0..) {
        let taken = setup.axis_index(axis.letter) != Some(before);
        if taken || !AXIS_LETTERS.contains(axis.letter) {
            let found = format!("axis letter {}", axis.letter);
            return refuse_file(name, found, "each of X Y Z A B C U V W at most once");
        }
    }
    if let Some(word) = unknown_mode(&setup.beginning.modes) {
        let found = format!("{word} among the modes that the program begins with");
        return refuse_file(name, found, "words such as G1 G18 G91 F600");
    }
    if !finite(start) || !finite(&setup.work_offset) {
        let found = "start position or work offset that is not a number";
        return refuse_file(name, found, "finite positions");
    }
    Ok(())
}
