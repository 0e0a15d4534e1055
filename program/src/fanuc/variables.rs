//! What the number of a variable stands for (B-64304EN, 16.1 "Variables" and 16.2 "System variables"; Haas Mill Operator's Manual,
//! "Macros": the table of system variables).

use crate::refusal::{Refusal, wrong};

/// The first of the offsets of G54.1, twenty for each, up to P300.
const MORE_WORK: u32 = 14_001;

/// What a variable stands for. Axes and offsets count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    /// #0, which never has a value.
    Vacant,
    /// The program's own, by its number.
    Own(u32),
    /// #3000: an alarm with this number ends the program.
    Alarm,
    /// #3006: a stop with a message.
    Stop,
    /// #3003 and #3004: switches of single block and of overrides.
    Switch,
    /// #4001 to #4022: the code in force of a group.
    Code(u32),
    /// #4102 to #4120: the word of this letter that is in force.
    Word(char),
    /// #4130: P of G54.1.
    MoreWorkInForce,
    /// #5001, #5041: where the tool is along an axis, in the program's coordinates.
    Place(usize),
    /// #5021: where the axis is, in the machine's coordinates.
    MachinePlace(usize),
    /// #5061: where the skip signal came.
    Skipped(usize),
    /// #5081: what the offset of the tool takes off.
    Applied(usize),
    /// Length of a tool.
    Length(u32),
    /// Radius of a tool.
    Radius(u32),
    /// #5221: work offset (0 is G54) and axis.
    Work(u32, usize),
    /// #7001, #14001: work offset of G54.1 (0 is P1) and axis.
    MoreWork(u32, usize),
}

impl Variable {
    /// What a number stands for.
    pub fn of(number: u32) -> Result<Variable, Refusal> {
        let place = |base: u32| ((number - base) / 20, ((number - base) % 20) as usize);
        let axis = |base: u32| place(base).1;
        Ok(match number {
            0 => Variable::Vacant,
            1..=33 | 100..=199 | 500..=999 => Variable::Own(number),
            2001..=2200 => Variable::Length(number - 2000),
            11_001..=11_999 => Variable::Length(number - 11_000),
            13_001..=13_999 => Variable::Radius(number - 13_000),
            3000 => Variable::Alarm,
            3003 | 3004 => Variable::Switch,
            3006 => Variable::Stop,
            4001..=4016 if !matches!(number, 4004 | 4011) => Variable::Code(number - 4000),
            4109 => Variable::Word('F'),
            4111 => Variable::Word('H'),
            4119 => Variable::Word('S'),
            4120 => Variable::Word('T'),
            4130 => Variable::MoreWorkInForce,
            5001..=5009 => Variable::Place(axis(5001)),
            5041..=5049 => Variable::Place(axis(5041)),
            5021..=5029 => Variable::MachinePlace(axis(5021)),
            5061..=5069 => Variable::Skipped(axis(5061)),
            5081..=5089 => Variable::Applied(axis(5081)),
            5221..=5340 if axis(5221) < 9 => Variable::Work(place(5221).0, axis(5221)),
            7001..=7960 if axis(7001) < 9 => Variable::MoreWork(place(7001).0, axis(7001)),
            14_001..=20_000 if axis(MORE_WORK) < 9 => {
                let (system, axis) = place(MORE_WORK);
                Variable::MoreWork(system, axis)
            }
            _ => return unknown(number),
        })
    }

    /// Refuses to set what only tells of the machine.
    pub fn check_settable(self, number: u32) -> Result<(), Refusal> {
        let right = match self {
            Variable::Vacant => {
                "#0 never has a value: it is compared with, and #1=#0 takes the value of #1 away"
            }
            Variable::Code(_) | Variable::Word(_) | Variable::MoreWorkInForce => {
                "it tells which code or word is in force"
            }
            Variable::Place(_) | Variable::MachinePlace(_) | Variable::Skipped(_) => {
                "it tells where the axes are; motions change that"
            }
            Variable::Applied(_) => "G43 and G49 set it",
            _ => return Ok(()),
        };
        wrong(format!("#{number}, which is read-only"), right)
    }
}

/// Refuses a number that no variable here has, with what it is on a control.
fn unknown(number: u32) -> Result<Variable, Refusal> {
    let (what, right) = match number {
        34..=99 | 200..=499 => (
            "is no variable of a program",
            "#1 to #33 are local to a call, #100 to #199 and #500 to #999 common to all",
        ),
        1000..=1035 => (
            "is an input",
            "no input of the machine is read by a variable",
        ),
        1100..=1135 => (
            "is an output",
            "no output of the machine is set by a variable",
        ),
        2201..=2999 | 10_000..=10_999 | 12_001..=12_999 => (
            "is an offset or a common variable, which controls number differently",
            "#11001 is the length of tool 1 and #13001 its radius; there is no wear",
        ),
        3001 | 3002 | 3011 | 3012 => ("is a clock", "there is no clock; G4 waits"),
        3005 | 3007 => (
            "is a setting of the control",
            "the machine file has the settings",
        ),
        3901 | 3902 => (
            "counts parts",
            "a variable from #500 on, kept by the parameter file of the machine",
        ),
        4004 | 4011 | 4017..=4330 => (
            "tells of a group or a word that is not told here",
            "#4001 to #4003, #4005 to #4010, #4012 to #4016, #4109, #4111, #4119, #4120 and #4130 tell the modes",
        ),
        5201..=5219 => (
            "is the external offset of the zero, which there is not",
            "#5221 and those behind it are the offsets of G54 to G59",
        ),
        _ => (
            "is no variable that is known",
            "the book has all in a table (reference, fanuc)",
        ),
    };
    wrong(format!("#{number}, which {what}"), right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_for_what_the_manuals_say() {
        let of = |number| Variable::of(number).unwrap();
        assert_eq!(of(0), Variable::Vacant);
        assert_eq!(of(33), Variable::Own(33));
        assert_eq!(of(2007), Variable::Length(7));
        assert_eq!(of(13_002), Variable::Radius(2));
        assert_eq!(of(5223), Variable::Work(0, 2));
        assert_eq!(of(5322), Variable::Work(5, 1));
        assert_eq!(of(7021), Variable::MoreWork(1, 0));
        assert_eq!(of(14_003), of(7003));
        assert_eq!(of(19_983), Variable::MoreWork(299, 2));
        for number in [
            34, 99, 200, 1000, 3001, 4004, 5201, 5230, 5999, 12_001, 99_999,
        ] {
            assert!(Variable::of(number).is_err(), "#{number}");
        }
    }
}
