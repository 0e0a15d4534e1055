//! Work coordinates: where the axes are commanded to be, as a readout shows it, and the other way round.

use bus::sample::{Feedback, Waiting};
use machine::Machine;
use path::geometry::AxisVector;
use path::kinematics::Kinematics;

use crate::meaning::Modal;
use crate::modes::Modes;
use crate::setup::kinematics_of;

/// Command position of the axes that programs move, in mm or degrees.
pub fn commanded(machine: &Machine, feedback: &Feedback) -> AxisVector {
    let mut place = AxisVector::zeros();
    let axes = machine.program_axes().iter().zip(feedback.axes());
    for (to, (axis, sample)) in place.iter_mut().zip(axes) {
        *to = sample.command_position as f64 * axis.increment_mm();
    }
    place
}

/// The same in work coordinates; none where the axes are not those of programs.
pub fn work_place(machine: &Machine, feedback: &Feedback, modal: &Modal) -> Option<AxisVector> {
    let applied = AxisVector::from(feedback.auxiliary.tool_offset);
    let is_plain = kinematics_of(machine) == Kinematics::Cartesian;
    let work = is_plain.then(|| modal.in_program(&commanded(machine, feedback), &applied));
    work.map(|mut work| {
        for (value, axis) in work.iter_mut().zip(&machine.axes) {
            *value = axis.shown(*value);
        }
        work
    })
}

/// Ways of all axes to where [`work_place`] has these numbers, by axis, and the others as they are.
pub fn ways_to_work(
    machine: &Machine,
    feedback: &Feedback,
    modal: &Modal,
    numbers: &[(u32, f64)],
) -> Option<AxisVector> {
    let shown = work_place(machine, feedback, modal)?;
    let applied = AxisVector::from(feedback.auxiliary.tool_offset);
    let from = commanded(machine, feedback);
    let mut work = modal.in_program(&from, &applied);
    for (axis, number) in numbers {
        // The readout of a turning axis goes round; the axis does not.
        let index = *axis as usize;
        if let Some((value, shown)) = work.get_mut(index).zip(shown.get(index)) {
            *value += number - shown;
        }
    }
    Some(modal.in_machine(&work, &applied) - from)
}

impl Modes {
    /// The state in the block that this feedback is in, or in which the path was left; none where it is not known.
    pub fn in_force(&self, feedback: &Feedback) -> Option<&Modal> {
        let tag = if feedback.tag.is_off_path() {
            &feedback.interrupted_at
        } else {
            &feedback.tag
        };
        let auxiliary = &feedback.auxiliary;
        // Behind a block of single block nothing waits in a line of its own.
        let waits_in_line =
            auxiliary.waiting != 0 && auxiliary.waiting != Waiting::SingleBlock as u32;
        if waits_in_line {
            // Blocks before it that move nothing have changed the state as well.
            return self.where_it_waits(tag.element, auxiliary.line);
        }
        self.at(tag.element)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use bus::sample::PATH_AXES;
    use bytemuck::Zeroable;
    use machine::offsets_file::{G92_APPLIES, IN_FORCE, WORK_OFFSETS};
    use proptest::prelude::*;

    use super::*;
    use crate::modes::modal_at_start;

    fn machine(name: &str) -> Machine {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        Machine::load(&folder.join("../machines").join(name)).unwrap()
    }

    /// Places, offsets, a tool and modes.
    type Drawn = ([f64; 3], [f64; 3], [f64; 3], [f64; 3], f64, usize, bool);

    fn drawn() -> impl Strategy<Value = Drawn> {
        let near = || prop::array::uniform3(-60.0..60.0f64);
        (
            near(),
            near(),
            near(),
            near(),
            prop_oneof![Just(0.0), -360.0..360.0f64],
            0..WORK_OFFSETS.len(),
            any::<bool>(),
        )
    }

    proptest! {
        #[test]
        fn what_is_moved_by_the_ways_to_a_work_place_reads_that_place(
            (at, work, g92, tool, turn_deg, system, is_applied) in drawn(),
            to in prop::array::uniform3(prop::option::of(-60.0..60.0f64)),
            modes in prop::sample::select(vec!["", "G20", "G7", "G7 G20 G91", "G8 G93"]),
            name in prop::sample::select(vec!["xyz-mill", "xz-lathe", "turning"]),
        ) {
            let mut machine = match name {
                "turning" => machine("xyz-mill"),
                name => machine(name),
            };
            if name == "turning" {
                machine.axes[2].kind = machine::AxisKind::Rotary;
                machine.axes[2].modulo = true;
                machine.axes[2].name = "C".into();
            }
            let first = machine::offsets_file::first_parameter(WORK_OFFSETS[system]).unwrap();
            let mut keep = |number: u32, value: f64| { machine.parameters.insert(number, value); };
            keep(IN_FORCE, system as f64 + 1.0);
            keep(first + 9, turn_deg);
            keep(G92_APPLIES, f64::from(u8::from(is_applied)));
            for (index, letter) in ['X', 'Y', 'Z'].into_iter().enumerate() {
                keep(machine::offsets_file::parameter_of(first, letter).unwrap(), work[index]);
                keep(machine::offsets_file::parameter_of(G92_APPLIES + 1, letter).unwrap(), g92[index]);
            }
            machine.beginning.modes = format!("{modes} {}", WORK_OFFSETS[system]);
            let modal = modal_at_start(&machine);
            let mut feedback = Feedback::zeroed();
            feedback.axis_count = machine.axes.len() as u32;
            feedback.auxiliary.tool_offset[..3].copy_from_slice(&tool);
            for ((sample, axis), at) in feedback.axes.iter_mut().zip(&machine.axes).zip(at) {
                sample.command_position = (at / axis.increment_mm()).round() as i64;
            }
            let numbers: Vec<(u32, f64)> = (0u32..)
                .zip(to)
                .zip(&machine.axes)
                .filter_map(|((axis, to), of)| Some((axis, of.shown(to?))))
                .collect();
            let before = work_place(&machine, &feedback, &modal).unwrap();
            let ways = ways_to_work(&machine, &feedback, &modal, &numbers).unwrap();
            for ((sample, axis), way) in feedback.axes.iter_mut().zip(&machine.axes).zip(&ways) {
                sample.command_position += (way / axis.increment_mm()).round() as i64;
            }
            let after = work_place(&machine, &feedback, &modal).unwrap();
            for (index, axis) in machine.axes.iter().enumerate() {
                let named = numbers.iter().find(|(of, _)| *of as usize == index);
                let wanted = named.map_or(before[index], |(_, number)| *number);
                let off = (after[index] - wanted).abs();
                let off = if axis.modulo { off.min(360.0 - off) } else { off };
                // What rounding to increments leaves of a turned place.
                prop_assert!(off <= 1.5 * axis.increment_mm(), "{name} {index}: {} for {wanted}", after[index]);
            }
            prop_assert!(machine.axes.len() <= PATH_AXES);
        }
    }
}
