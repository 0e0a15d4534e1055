//! What the machine file says of programs.

use machine::{self, AxisKind, KinematicsKind, Machine};
use path::geometry::AxisVector;
use path::kinematics::Kinematics;
use path::pivot::{self, PivotY};

use crate::program::{AxisSetup, Setup};

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
            tolerance_mm: machine.path.tolerance_mm,
            probe: machine.program.probe,
            spindle_max_rpm: machine
                .spindle
                .as_ref()
                .map(|spindle| spindle.speed_max_rpm),
            user_codes: !machine.program.user_codes.is_empty(),
            ..Setup::default()
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
