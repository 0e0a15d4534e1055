//! Words of lathes.

use super::block::{Beside, Block, Modes, code_of, word};
use crate::letters::AXIS_LETTERS;
use crate::meaning::State;
use crate::refusal::{Refusal, refuse};

/// Words of lathes: T0101, U and W, G50, G98 and G99 (B-64304EN-1; G-code system A).
pub fn of_lathe(
    block: &mut Block,
    state: &State,
    modes: &mut Modes,
    beside: &mut Beside,
) -> Result<(), Refusal> {
    let is_dwell = block.has('G', |code| code == 40);
    for (from, to) in [('U', 'X'), ('W', 'Z'), ('H', 'C')] {
        let is_axis = state.equipment().axis_index(from).is_some();
        let applies = !is_axis && !is_dwell && state.equipment().axis_index(to).is_some();
        if let Some(step) = block
            .value(from)
            .filter(|_| applies && !block.has('G', |code| code == 430))
        {
            block.take(from);
            let here = AXIS_LETTERS
                .find(to)
                .map_or(0.0, |letter| state.position_of(letter))
                + state.owed_along(to);
            let doubled = to == 'X' && state.in_force().diameters;
            let here = if doubled { 2.0 * here } else { here };
            let from = if block.is_incremental(state) {
                0.0
            } else {
                here
            };
            block.words.push(word(to, from + step.value, step.offset));
        }
    }
    if let Some((_, code)) = block.code('G', |code| code == 500)
        && let Some(speed) = block.take('S')
    {
        block.drop_code('G', 500);
        modes.spindle_max_rpm = Some(speed.value);
        if block.has('G', |_| true) {
            return refuse(
                code.offset,
                "G50 S beside another code",
                "G50 S alone in its block",
            );
        }
    }
    if let Some((_, code)) = block.code('G', |code| code == 960)
        && let Some(speed_rpm) = modes.spindle_max_rpm
        && block.value('D').is_none()
    {
        block.words.push(word('D', speed_rpm, code.offset));
    }
    for code in block.words.iter_mut().filter(|word| word.letter == 'G') {
        match code_of(code) {
            Some(980) => code.value = 94.0,
            Some(990) => code.value = 95.0,
            _ => {}
        }
    }
    change_tool(block, state, beside)
}

/// T0101: tool and offset.
fn change_tool(block: &mut Block, state: &State, beside: &mut Beside) -> Result<(), Refusal> {
    let Some(tool) = block.value('T').filter(|tool| tool.value != 0.0) else {
        return Ok(());
    };
    if !(100.0..=9999.0).contains(&tool.value) || tool.value.fract() != 0.0 {
        let right = "tool and offset in two digits each, such as T0101";
        return refuse(tool.offset, tool.to_string(), right);
    }
    block.take('T');
    let (number, offset) = ((tool.value / 100.0).floor(), tool.value % 100.0);
    if state.predefined("_current_tool") != Some(number) {
        block.words.push(word('T', number, tool.offset));
        if !block.has('M', |code| code == 60) {
            block.words.push(word('M', 6.0, tool.offset));
        }
    }
    if offset > 0.0 {
        block.words.push(word('G', 43.0, tool.offset));
        block.words.push(word('H', offset, tool.offset));
    } else {
        block.words.push(word('G', 49.0, tool.offset));
    }
    beside
        .notes
        .push("T0101 changes the tool (M6) and applies the offset of its last two digits (G43)");
    Ok(())
}
