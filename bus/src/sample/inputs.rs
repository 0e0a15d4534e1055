//! What the machine tells a program: inputs, and the answers to what a program asks while it runs (probing, M66).

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::PATH_AXES;

use crate::table;

/// Digital inputs that a program can wait for, M66 P0 to P63.
pub const DIGITAL_INPUTS: usize = 64;
/// Analogue inputs that a program can read, M66 E0 to E7.
pub const ANALOG_INPUTS: usize = 8;

/// In [`ProgramEvent::index`](super::ProgramEvent::index) of a probing motion: it ends where contact is lost (G38.4, G38.5) rather than made.
pub const PROBE_AWAY: u32 = 1;
/// In the same: a motion that ends without it stops the program (G38.2, G38.4).
pub const PROBE_MUST: u32 = 2;

wire_enum! {
    /// What is waited for of an input, in [`ProgramEvent::index`](super::ProgramEvent::index) from bit 8 on; the input's number is below.
    pub enum InputWait {
        /// L0: nothing.
        Immediate = 0,
        /// L1: it goes from off to on.
        Rise = 1,
        /// L2: it goes from on to off.
        Fall = 2,
        /// L3: it is on.
        High = 3,
        /// L4: it is off.
        Low = 4,
    }
}

/// An input that a program asks for, as an event's index carries it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AskedInput {
    /// Which.
    pub number: u32,
    /// M66 E rather than P.
    pub analog: bool,
    /// What is waited for.
    pub wait: InputWait,
}

impl AskedInput {
    const ANALOG: u32 = 1 << 16;

    /// As it travels.
    pub fn wire(self) -> u32 {
        let analog = if self.analog { Self::ANALOG } else { 0 };
        self.number | (self.wait as u32) << 8 | analog
    }

    /// Decodes what came over the wire; none for one that there is not.
    pub fn from_wire(index: u32) -> Option<AskedInput> {
        let wait = (index >> 8 & 0xFF) as usize;
        let asked = AskedInput {
            number: index & 0xFF,
            analog: index & Self::ANALOG != 0,
            wait: InputWait::ALL.get(wait).copied()?,
        };
        let most = if asked.analog {
            ANALOG_INPUTS
        } else {
            DIGITAL_INPUTS
        };
        let sound = index == asked.wire() && (asked.number as usize) < most;
        // An analogue input has no edge and no level.
        let read = !asked.analog || asked.wait == InputWait::Immediate;
        (sound && read).then_some(asked)
    }
}

wire_enum! {
    /// How a question of the program was answered.
    #[derive(Default)]
    pub enum AnswerOutcome {
        /// Nothing was asked.
        #[default]
        None = 0,
        /// The program probes: its axes are on the way, or brake.
        Awaited = 1,
        /// The probe has tripped and the axes rest; the input was as it was waited for.
        Given = 2,
        /// The probing motion ended without contact (or with it, G38.4 and G38.5); the wait for the input lasted too long.
        Missed = 3,
        /// The probe was in contact (or not, G38.4 and G38.5) before the motion began.
        Early = 4,
        /// The contact changed while nobody watched it: where is not known.
        Lost = 5,
    }
}

/// The answer to what the program asked last. It stays until the program asks again.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Answer/2")]
#[repr(C)]
pub struct Answer {
    /// Of an input: what it showed. Of a probe: when it tripped, as a share of the scan.
    pub value: f64,
    /// The scan in which it tripped, 0 as long as it has not; in which the input was as it was waited for.
    pub scan: u64,
    /// Where the axes of the path were when the probe tripped, in increments: by the encoders, as command positions count.
    pub tripped: [i64; PATH_AXES],
    /// Command positions at which they rest afterwards, in increments: the program goes on from there.
    pub rests: [i64; PATH_AXES],
    /// Number of the event that asked; 0 for none.
    pub number: u32,
    /// [`AnswerOutcome`].
    pub outcome: u32,
}
table!(Answer: value, scan, tripped @ PathAxes, rests @ PathAxes, number, outcome);

/// What the inputs show at the start of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Inputs/2")]
#[repr(C)]
pub struct Inputs {
    /// Analogue inputs.
    pub analog: [f64; ANALOG_INPUTS],
    /// Digital inputs, a bit each.
    pub digital: u64,
    /// 1 while the probe is in contact.
    pub contact: u32,
    /// What the operator has switched: bit 0 single block, from bit 8 on by how many percent rapids are slowed down, from bit 16 on by
    /// how many jogs are, in a signed byte.
    pub panel: u32,
}
table!(Inputs: analog, digital, contact, panel);

/// Largest override of feed and of jogs: twice what was asked for, in percent.
pub const OVERRIDE_MAX_PERCENT: u32 = 200;

impl Inputs {
    /// What is shown of the operator's switches: single block, and the overrides of rapids and of jogs in percent.
    pub fn panel(single_block: bool, (rapid_percent, jog_percent): (u32, u32)) -> u32 {
        let jog_less = 100 - jog_percent.min(OVERRIDE_MAX_PERCENT) as i32;
        let jog_less = u32::from(jog_less as u8);
        u32::from(single_block) | (100 - rapid_percent.min(100)) << 8 | jog_less << 16
    }

    /// Whether the operator has single block switched on.
    pub fn single_block(&self) -> bool {
        self.panel & 1 == 1
    }

    /// Override of rapids, in percent.
    pub fn rapid_override_percent(&self) -> u32 {
        100u32.saturating_sub(self.panel >> 8 & 0x7f)
    }

    /// Override of jogs, in percent.
    pub fn jog_override_percent(&self) -> u32 {
        let less = (self.panel >> 16) as u8 as i8;
        (100 - i32::from(less)).clamp(0, OVERRIDE_MAX_PERCENT as i32) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_switches_of_the_operator_are_read_back_and_none_of_them_moved_is_0() {
        assert_eq!(Inputs::panel(false, (100, 100)), 0);
        for single_block in [false, true] {
            for rapid_percent in 0..=100 {
                for jog_percent in 0..=OVERRIDE_MAX_PERCENT {
                    let inputs = Inputs {
                        panel: Inputs::panel(single_block, (rapid_percent, jog_percent)),
                        ..Inputs::default()
                    };
                    assert_eq!(inputs.single_block(), single_block);
                    assert_eq!(inputs.rapid_override_percent(), rapid_percent);
                    assert_eq!(inputs.jog_override_percent(), jog_percent);
                }
            }
        }
    }

    #[test]
    fn what_is_asked_of_an_input_is_read_back_and_what_there_is_not_is_not() {
        for wait in InputWait::ALL {
            for (number, analog) in [(0, false), (63, false), (7, true)] {
                let asked = AskedInput {
                    number,
                    analog,
                    wait,
                };
                let there_is = !analog || wait == InputWait::Immediate;
                let read = AskedInput::from_wire(asked.wire());
                assert_eq!(read, there_is.then_some(asked));
            }
        }
        for none in [64, 5 << 8, 1 << 16 | 8, 1 << 17, u32::MAX] {
            assert_eq!(AskedInput::from_wire(none), None, "{none:#x}");
        }
        for (index, outcome) in AnswerOutcome::ALL.into_iter().enumerate() {
            assert_eq!(AnswerOutcome::from_wire(index as u32), Some(outcome));
        }
        assert_eq!(AnswerOutcome::from_wire(6), None);
    }
}
