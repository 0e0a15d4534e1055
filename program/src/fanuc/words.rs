//! The words of a block, by the words of LinuxCNC that do the same; what these have no words for is handed back.

use super::block::{Beside, Block, Modes, code_of, word};
use super::cycles::dwell_and_cycles;
use super::lathe::of_lathe;
use super::offsets::{cutter, offsets, once};
use crate::meaning::State;
use crate::reader::Line;
use crate::refusal::{Refusal, refuse};
use crate::state::Motion;
use crate::words::mask_of;

/// G-codes (ten times the number) that have no effect, the letters that belong to them, and what is said; nothing is said of those
/// that end what is not in force.
const NO_EFFECT: [(u32, &str, &str); 10] = [
    (50, "PQR", LOOKS_AHEAD),
    (51, "PQR", LOOKS_AHEAD),
    (80, "P", LOOKS_AHEAD),
    (1030, "P", LOOKS_AHEAD),
    (
        1870,
        "PE",
        "G187 has no effect: the tolerance of the machine file, or P of G64, says how far the path may be left",
    ),
    (
        90,
        "",
        "G9 has no effect: G61.1 stops the tool at the ends of blocks",
    ),
    (230, "", ""),
    (250, "", ""),
    (500, "", ""),
    (670, "", ""),
];
const LOOKS_AHEAD: &str =
    "G5, G5.1, G8 and G103 have no effect: the planner always reads as far ahead as speed asks for";

/// M-codes of machines that have no effect.
const NO_EFFECT_M: [u32; 10] = [10, 11, 29, 31, 33, 41, 42, 43, 44, 36];
const NOT_HERE: &str = "M10, M11 (clamps), M29 (rigid tap), M31, M33, M36 (chips and parts) and M41 to M44 (gears) have no effect";

/// G-codes that are known and not done, with what would be right.
fn why_not(code: u32, is_lathe: bool) -> Option<&'static str> {
    Some(match code {
        120 | 130 => "circular pockets are not supported: G2 and G3 with G41",
        220 => "the travels of the axes are in the machine file",
        270 | 290 => "G28 and G30 go to kept places",
        360 | 370 => "lengths of tools are measured with G31 and set with G10 L10",
        440 => "G43 with a tool length below 0",
        470 => "text is not engraved by a word",
        510 | 511 => "scaling is not supported: write the scaled values, or use variables",
        435 => "tool vectors are not supported: G43.4, with the angles of the rotary axes",
        683 => "this tilted plane is not supported: G68.2 with I, J and K",
        600 => "approach in one direction is not supported: two moves",
        760 if !is_lathe => "fine boring is not supported: G86, or G85",
        870 => "back boring of Fanuc's kind is not supported",
        700..=729 | 740 | 750 | 760 if is_lathe => {
            "cycles of lathes are not supported in this dialect: O-word subroutines and G71 of the dialect linuxcnc"
        }
        900 | 920 | 940 if is_lathe => {
            "G-code system A: single turning cycles are not supported; write the moves"
        }
        700..=729 => "hole patterns are not supported: a macro, or the places of the holes",
        1500 | 2340 | 2540 | 2550 => "this code of Haas' controls is not supported",
        _ => return None,
    })
}

/// Puts LinuxCNC's words in the place of a block's own.
pub fn translate(line: &mut Line, state: &State, modes: &mut Modes) -> Result<Beside, Refusal> {
    let equipment = state.equipment();
    let has_axis = |letter| equipment.axis_index(letter).is_some();
    let is_lathe = has_axis('X') && has_axis('Z') && !has_axis('Y');
    if equipment.standard_decimal_point {
        count_increments(line, state, modes);
    }
    let mut block = Block {
        pointed: line.pointed,
        words: &mut line.words,
    };
    let mut beside = Beside::default();
    for word in block.words.iter().filter(|word| word.letter == 'G') {
        if let Some(right) = code_of(word).and_then(|code| why_not(code, is_lathe)) {
            return word.refuse(right);
        }
    }
    if is_lathe {
        of_lathe(&mut block, state, modes, &mut beside)?;
    }
    once(&mut block, state, &mut beside)?;
    cutter(&mut block, modes);
    offsets(&mut block, state, &mut beside)?;
    without_effect(&mut block, &mut beside);
    dwell_and_cycles(&mut block, state, &mut beside)?;
    polar(&mut block, state, modes)?;
    Ok(beside)
}

/// A number without a decimal point counts least input increments (B-64304EN, 5.5 "Decimal point programming").
fn count_increments(line: &mut Line, state: &State, modes: &Modes) {
    let block = Block {
        pointed: line.pointed,
        words: &mut line.words,
    };
    let inches = block.in_block(200, 210, state.in_force().inches);
    let of_length = if inches { 1e-4 } else { 1e-3 };
    // Letters of angles and times, which count thousandths in either unit.
    let thousandths = match () {
        () if block.has('G', |code| code == 40) => "XU",
        () if block.has('G', |code| code == 680) => "R",
        () if block.has('G', |code| code == 682) => "IJK",
        () if modes.polar => "Y",
        () => "",
    };
    let increment = |letter: char| match letter {
        'A' | 'B' | 'C' => 1e-3,
        _ if thousandths.contains(letter) => 1e-3,
        _ => of_length,
    };
    let is_cycle = |code| matches!(code, 730 | 740 | 810..=890);
    let moves = block.has('G', |code| matches!(code, 0 | 10 | 20 | 30));
    let drills = matches!(state.in_force().motion(), Motion::Cycle(_)) && !moves;
    // K of a cycle counts its holes.
    let holes = if drills || block.has('G', is_cycle) {
        mask_of("K")
    } else {
        0
    };
    let is_call = line
        .words
        .iter()
        .any(|word| word.letter == 'G' && matches!(word.value, 65.0 | 66.0));
    for word in &mut line.words {
        let letter = mask_of(word.letter.encode_utf8(&mut [0; 4]));
        let counts = mask_of("XYZABCUVWIJKRQ") & !holes;
        let counts = counts & letter & !line.pointed & !line.computed != 0;
        if counts && !is_call {
            word.value *= increment(word.letter);
        }
    }
    if let Some(corner) = line.corner.as_mut().filter(|corner| corner.is_plain) {
        corner.size *= of_length;
        corner.is_plain = false;
    }
}

/// Takes words away that have no effect.
fn without_effect(block: &mut Block, beside: &mut Beside) {
    for (code, letters, note) in NO_EFFECT {
        if block.has('G', |of| of == code) {
            block.drop_code('G', code);
            for letter in letters.chars() {
                block.take(letter);
            }
            beside
                .notes
                .extend(Some(note).filter(|note| !note.is_empty()));
        }
    }
    for (both, spindle) in [(130, 3.0), (140, 4.0)] {
        if let Some((_, code)) = block.code('M', |of| of == both) {
            block.drop_code('M', both);
            block.words.push(word('M', spindle, code.offset));
            block.words.push(word('M', 8.0, code.offset));
        }
    }
    for code in NO_EFFECT_M {
        if block.has('M', |of| of == code * 10) {
            block.drop_code('M', code * 10);
            beside.notes.push(NOT_HERE);
        }
    }
}

/// G15 and G16: X is a distance from the zero, Y an angle (B-64304EN-2, 5.4 "Polar coordinate command").
fn polar(block: &mut Block, state: &State, modes: &mut Modes) -> Result<(), Refusal> {
    if block.has('G', |code| code == 150) {
        block.drop_code('G', 150);
        modes.polar = false;
    }
    if let Some((_, code)) = block.code('G', |code| code == 160) {
        block.drop_code('G', 160);
        if !block.is_in_xy(state) {
            return refuse(
                code.offset,
                "G16 outside G17",
                "polar places are in X and Y, in G17",
            );
        }
        modes.polar = true;
    }
    let is_place = !block.has('G', |code| matches!(code, 280..=300 | 520 | 530 | 920));
    if !modes.polar || !is_place {
        return Ok(());
    }
    let incremental = block.is_incremental(state);
    for (from, to) in [('X', '@'), ('Y', '^')] {
        let Some(place) = block.value(from) else {
            continue;
        };
        if incremental {
            return place.refuse("polar places in G91 are not supported: G90");
        }
        block.take(from);
        block.words.push(word(to, place.value, place.offset));
    }
    Ok(())
}
