//! What the next run of a program on this machine begins with.

use std::fs;
use std::io;

use bus::cell::{CellPaths, if_there};
use bus::sample::{Auxiliaries, FLOOD, Levels, MIST, MODES_RESET, PATH_AXES, SpindleCommand};

use crate::beginning::{Beginning, MODES_OF_END};
use crate::machine::Machine;
use crate::offsets_file::{IN_FORCE, WORK_OFFSETS};

impl Beginning {
    /// What the next run of this cell begins with, by what the master shows and the last run has left.
    ///
    /// # Errors
    /// The cell's folder cannot be read.
    pub fn now(paths: &CellPaths, machine: &Machine, shown: &Auxiliaries) -> io::Result<Beginning> {
        let mut modes = match shown.modes_of_run {
            0 => String::new(),
            MODES_RESET => MODES_OF_END.to_owned(),
            run => if_there(fs::read_to_string(paths.modes(run)))?.unwrap_or_default(),
        };
        modes.push_str(&words_of_levels(&shown.levels));
        let axes = machine.axis_letters().zip(shown.tool_offset);
        let applied = axes.filter(|(_, value)| *value != 0.0);
        Ok(Beginning {
            tool: shown.tool,
            offset_of: shown.tool_offset_of,
            offset: applied
                .map(|(letter, value)| (letter.to_string(), value))
                .collect(),
            modes: modes.trim_start().to_owned(),
        })
    }
}

/// What turns and flows, as words of a block.
fn words_of_levels(levels: &Levels) -> String {
    let mut words = String::new();
    if levels.spindle == SpindleCommand::Turn as u32 && levels.spindle_rpm != 0.0 {
        let code = if levels.spindle_rpm > 0.0 { "M3" } else { "M4" };
        words += &format!(" {code} S{}", levels.spindle_rpm.abs());
    }
    for (bit, word) in [(MIST, " M7"), (FLOOD, " M8")] {
        if levels.coolant & bit != 0 {
            words += word;
        }
    }
    words
}

impl Machine {
    /// Index of the work offset that the next program begins with: 0 is G54.
    pub fn work_offset_in_force(&self) -> usize {
        let mut modes = self.beginning.modes.split_whitespace();
        let of_modes = modes.find_map(|word| WORK_OFFSETS.iter().position(|name| *name == word));
        let kept = self.parameters.get(&IN_FORCE).copied().unwrap_or(1.0);
        of_modes.unwrap_or(kept.clamp(1.0, WORK_OFFSETS.len() as f64) as usize - 1)
    }

    /// The letter that programs give each axis, in the order of the axes: an arm that is in for Y is Y.
    fn axis_letters(&self) -> impl Iterator<Item = char> {
        let kinematics = self.kinematics.as_ref();
        let arm = kinematics.and_then(|kinematics| kinematics.arm_index(&self.axes));
        let axes = self.program_axes().iter().enumerate();
        axes.map(move |(index, axis)| match arm {
            Some(arm) if arm == index => 'Y',
            _ => axis.name.chars().next().unwrap_or('?'),
        })
    }

    /// The offset of the tool that is applied at the beginning, by axis, in mm and degrees.
    pub fn beginning_offset(&self) -> [f64; PATH_AXES] {
        let mut along = [0.0; PATH_AXES];
        for (slot, letter) in along.iter_mut().zip(self.axis_letters()) {
            let value = self.beginning.offset.get(&letter.to_string());
            *slot = value.copied().unwrap_or(0.0);
        }
        along
    }
}
