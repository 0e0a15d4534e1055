//! Offsets, rotation, reference positions and skip.

use super::block::{Beside, Block, Modes, code_of, word};
use crate::letters::AXIS_LETTERS;
use crate::meaning::State;
use crate::reader::Word;
use crate::refusal::{Refusal, refuse};
use crate::state::Motion;

/// G31: feeds until the probe trips.
fn skip(block: &mut Block, state: &State, beside: &mut Beside) -> Result<(), Refusal> {
    let drills = matches!(state.in_force().motion(), Motion::Cycle(_));
    if let Some((_, skip)) = block.code('G', |code| code == 310).filter(|_| drills) {
        return refuse(
            skip.offset,
            "G31 while a cycle is in force",
            "G80 before it",
        );
    }
    for code in block.words.iter_mut().filter(|word| word.letter == 'G') {
        if code_of(code) == Some(310) {
            code.value = 38.3;
            beside.motion_stays = true;
        }
    }
    Ok(())
}

/// G31, G30 P, G43 H0, G68 and G69, G54.1.
pub fn once(block: &mut Block, state: &State, beside: &mut Beside) -> Result<(), Refusal> {
    skip(block, state, beside)?;
    if block.has('G', |code| code == 434)
        && let Some(h) = block.value('H').filter(|h| h.value == 0.0)
    {
        return h.refuse("the tool whose tip is controlled, such as G43.4 H1; G49 ends it");
    }
    if block.has('G', |code| matches!(code, 280 | 300))
        && let Some((motion, _)) = block.code('G', |code| matches!(code, 0 | 10))
    {
        block.drop_code('G', motion);
        beside.motion_behind = Some(motion);
    }
    if block.has('G', |code| code == 300)
        && let Some(p) = block.take('P')
        && p.value != 2.0
    {
        return p
            .refuse("G30 goes to the second reference position, P2: no third or fourth is kept");
    }
    if block.value('H').is_some_and(|h| h.value == 0.0) && block.has('G', |code| code == 430) {
        block.take('H');
        for code in block.words.iter_mut().filter(|word| word.letter == 'G') {
            if code_of(code) == Some(430) {
                code.value = 49.0;
            }
        }
    }
    if block.has('G', |code| code == 690) {
        beside.turns_back = true;
        block.drop_code('G', 690);
    }
    if let Some((_, code)) = block.code('G', |code| code == 680) {
        block.drop_code('G', 680);
        if !block.is_in_xy(state) {
            return refuse(
                code.offset,
                "G68 in G18 or G19",
                "a rotation about Z, in G17",
            );
        }
        let Some(angle) = block.take('R') else {
            return refuse(
                code.offset,
                "G68 without R",
                "the angle in degrees: G68 X0 Y0 R45",
            );
        };
        let centre = ['X', 'Y'].map(|letter| block.take(letter).map(|word| word.value));
        beside.turn = Some((centre, angle.value, block.is_incremental(state)));
        if let Some(word) = block
            .words
            .iter()
            .find(|word| AXIS_LETTERS.contains(word.letter))
        {
            return word.refuse("G68 takes X, Y and R");
        }
    }
    Ok(())
}

/// D stays in force from block to block (B-64304EN-2, "Tool compensation values").
pub fn cutter(block: &mut Block, modes: &mut Modes) {
    let compensates = block.code('G', |code| matches!(code, 410 | 420));
    if block.has('G', |code| code == 960) {
        return;
    }
    match (block.value('D'), compensates, modes.cutter) {
        (Some(d), Some(_), _) => modes.cutter = Some(d.value),
        (Some(d), None, _) => {
            modes.cutter = Some(d.value);
            block.take('D');
        }
        (None, Some((_, code)), Some(d)) => block.words.push(word('D', d, code.offset)),
        (None, ..) => {}
    }
}

/// G54.1, G154, G110 to G129, and G10 (B-64304EN, 7.2; Haas, "G110 to G129", "G154").
pub fn offsets(block: &mut Block, state: &State, beside: &mut Beside) -> Result<(), Refusal> {
    if let Some((number, code)) = block.code('G', |code| code == 541 || code == 1540) {
        let Some(p) = block.take('P') else {
            return refuse(
                code.offset,
                format!("{code} without P"),
                "the offset: G54.1 P1 to P300",
            );
        };
        beside.more_work = Some(of_more_work(p)?);
        block.drop_code('G', number);
    }
    if let Some((number, _)) = block.code('G', |code| {
        (1100..=1290).contains(&code) && code.is_multiple_of(10)
    }) {
        beside.more_work = Some(number / 10 - 109);
        block.drop_code('G', number);
    }
    let Some((_, code)) = block.code('G', |code| code == 100) else {
        return Ok(());
    };
    let right = "L2 P1 to P6 sets G54 to G59, L20 P1 to P300 G54.1, L10 the length and L12 the radius of tool P";
    let (Some(l), Some(p)) = (block.value('L'), block.value('P')) else {
        return refuse(code.offset, "G10 without L or P", right);
    };
    if block.is_incremental(state) {
        let right = "G90 before it: what G10 would add to in G91 is not done";
        return refuse(code.offset, "G10 in G91", right);
    }
    match l.value {
        2.0 if (1.0..=6.0).contains(&p.value) => return Ok(()),
        20.0 => {
            let number = of_more_work(p)?;
            let axes: Vec<Word> = block
                .words
                .iter()
                .filter(|word| AXIS_LETTERS.contains(word.letter))
                .copied()
                .collect();
            block
                .words
                .retain(|word| !AXIS_LETTERS.contains(word.letter));
            beside.sets_more_work = Some((number, axes));
        }
        10.0 | 12.0 if p.value >= 1.0 && p.value <= 999.0 && p.value.fract() == 0.0 => {
            let Some(r) = block.take('R') else {
                return refuse(
                    l.offset,
                    format!("G10 {l} without R"),
                    "R: the length or the radius",
                );
            };
            let first = if l.value == 10.0 { 11_000 } else { 13_000 };
            beside.sets = Some((first + p.value as u32, r.value));
        }
        _ => return refuse(l.offset, format!("G10 {l} {p}"), right),
    }
    block.drop_code('G', 100);
    block.take('L');
    block.take('P');
    Ok(())
}

/// The number of an offset of G54.1.
fn of_more_work(p: Word) -> Result<u32, Refusal> {
    match (1.0..=300.0).contains(&p.value) && p.value.fract() == 0.0 {
        true => Ok(p.value as u32),
        false => p.refuse("the offsets of G54.1 are P1 to P300"),
    }
}
