//! Dwells and canned cycles.

use super::block::{Beside, Block, word};
use crate::codes::shown_code;
use crate::meaning::State;
use crate::reader::Word;
use crate::refusal::{Refusal, refuse};
use crate::state::Motion;

/// G4, and the canned cycles: P in milliseconds, K as L, a spindle that the tap starts itself.
pub fn dwell_and_cycles(
    block: &mut Block,
    state: &State,
    beside: &mut Beside,
) -> Result<(), Refusal> {
    let milliseconds = !block.is_pointed('P');
    let in_seconds = |p: &mut Word| p.value *= 1e-3;
    if block.has('G', |code| code == 40) {
        if let Some(given) = block.take('X').or_else(|| block.take('U')) {
            block.words.push(word('P', given.value, given.offset));
        } else if milliseconds {
            block
                .words
                .iter_mut()
                .filter(|word| word.letter == 'P')
                .for_each(in_seconds);
        }
        return Ok(());
    }
    let motion = block.code(
        'G',
        |code| matches!(code, 0 | 10 | 20 | 30 | 330..=332 | 382..=385 | 730..=760 | 800..=890),
    );
    let code = match (motion, state.in_force().motion()) {
        (Some((code, _)), _) => code,
        (None, Motion::Cycle(cycle)) => cycle as u32,
        _ => return Ok(()),
    };
    if !matches!(code, 730 | 740 | 810..=890) || block.has('M', |code| matches!(code, 970..=990)) {
        return Ok(());
    }
    if milliseconds {
        block
            .words
            .iter_mut()
            .filter(|word| word.letter == 'P')
            .for_each(in_seconds);
    }
    if let Some(k) = block.take('K') {
        block.words.push(word('L', k.value, k.offset));
    }
    if block.value('L').is_some_and(|l| l.value == 0.0) {
        block.take('L');
        beside.only_keeps = true;
    }
    let taps = [(740, 4.0), (840, 3.0)];
    let starts = taps.iter().find(|(tap, _)| *tap == code);
    let turns =
        state.in_force().turning().is_some() || block.has('M', |code| matches!(code, 30 | 40));
    if let Some((_, spindle)) = starts.filter(|_| !turns && !block.has('M', |code| code == 50)) {
        let offset = motion.map_or(0, |(_, word)| word.offset);
        block.words.push(word('M', *spindle, offset));
        beside
            .notes
            .push("G74 and G84 start a spindle that stands, as rigid taps do");
    }
    if beside.only_keeps
        && !matches!(state.in_force().motion(), Motion::Cycle(_))
        && motion.is_none()
    {
        let found = format!("L0 without a cycle, in G{}", shown_code(code));
        return refuse(0, found, "the cycle in the same block");
    }
    Ok(())
}
