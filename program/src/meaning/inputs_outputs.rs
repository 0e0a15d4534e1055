//! The words of inputs and outputs: M62 to M68.

use super::{EventKind, Group, Refusal, Words, refuse};
use bus::sample::{ANALOG_INPUTS, AskedInput, DIGITAL_INPUTS, InputWait};

/// The most digital and analogue outputs, as LinuxCNC has them by default.
const OUTPUTS_MAX: f64 = 63.0;

/// Longest wait for an input, in s: a day.
const WAIT_S_MAX: f64 = 86_400.0;

/// The output that M62 to M65, M67 or M68 switches.
pub fn output_switched(words: &Words) -> Result<Option<EventKind>, Refusal> {
    let Some((number, word)) = words.code(Group::InputOutput) else {
        return Ok(None);
    };
    let which = |letter: char| {
        let code = number / 10;
        let right = format!("its number, such as M{code} {letter}0");
        let found = format!("M{code} without {letter}");
        let index = words.whole(letter, "a whole number", 0.0..=OUTPUTS_MAX)?;
        index.ok_or_else(|| Refusal::new(word.offset, found, right))
    };
    let kind = match number {
        620..=650 => EventKind::DigitalOutput {
            index: which('P')?,
            on: number == 620 || number == 640,
            synchronised: number < 640,
        },
        670 | 680 => EventKind::AnalogOutput {
            index: which('E')?,
            value: words.value('Q').map_or(0.0, |q| q.value),
            synchronised: number == 670,
        },
        _ => return Ok(None),
    };
    Ok(Some(kind))
}

/// The input that M66 asks for, and the longest wait for it in s.
pub fn input_asked(words: &Words) -> Result<Option<(AskedInput, f64)>, Refusal> {
    let Some((660, word)) = words.code(Group::InputOutput) else {
        return Ok(None);
    };
    let offset = word.offset;
    let whole =
        |letter: char, most: usize| words.whole(letter, "a whole number", 0.0..=most as f64);
    let digital = whole('P', DIGITAL_INPUTS - 1)?;
    let analog = whole('E', ANALOG_INPUTS - 1)?;
    let (Some(number), true) = (digital.or(analog), digital.is_none() || analog.is_none()) else {
        let right = "one input: P for a digital one, E for an analogue one, such as M66 P0 L3 Q5";
        return refuse(offset, "M66", right);
    };
    let wait = whole('L', InputWait::ALL.len() - 1)?.unwrap_or(0);
    let wait = InputWait::ALL.get(wait as usize).copied();
    let wait = wait.unwrap_or(InputWait::Immediate);
    if analog.is_some() && wait != InputWait::Immediate {
        let right = "an analogue input is read at once: L0";
        return refuse(offset, "M66 E with L", right);
    }
    let timeout_s = words.value('Q').map_or(0.0, |q| q.value);
    if wait != InputWait::Immediate && !(timeout_s > 0.0 && timeout_s <= WAIT_S_MAX) {
        let right = "the longest wait in seconds, above 0, such as M66 P0 L3 Q5";
        return refuse(offset, format!("Q{timeout_s}"), right);
    }
    let asked = AskedInput {
        number,
        analog: analog.is_some(),
        wait,
    };
    Ok(Some((asked, timeout_s)))
}
