//! Words that nothing in their block makes use of are refused: whoever wrote them meant something.

use super::{Motion, Refusal, State, refuse};
use crate::letters::AXIS_LETTERS;
use crate::words::{Group, Words, mask_of};

/// F, S and T set what stays in force, in any block.
const ALWAYS: u32 = mask_of("FST");
const AXES: u32 = mask_of(AXIS_LETTERS);

/// The letters that a code makes use of beside its own.
fn letters_of(letter: char, number: u32) -> u32 {
    match (letter, number) {
        ('G', 40) => mask_of("P"),
        ('G', 100) => mask_of("PLRIJQXYZABCUVW"),
        ('G', 280 | 300 | 431 | 520 | 920) => AXES,
        ('G', 430 | 432 | 434) => mask_of("H"),
        ('G', 682) => mask_of("XYZIJK"),
        ('G', 640) => mask_of("PQ"),
        ('G', 700) => mask_of("QXZDEP"),
        ('G', 710..=712 | 720..=722) => mask_of("QXZDIRUW"),
        ('G', 410 | 420 | 960) => mask_of("D"),
        ('G', 411 | 421) => mask_of("DL"),
        ('M', 30 | 40 | 50) => mask_of("$"),
        ('M', 190) => mask_of("RQP$"),
        ('M', 610) => mask_of("Q"),
        ('M', 500..=530 | 620..=650) => mask_of("P"),
        ('M', 660) => mask_of("PELQ"),
        ('M', 670 | 680) => mask_of("EQ"),
        ('M', 980) => mask_of("PL"),
        ('M', 1000..=1990) => mask_of("PQ"),
        _ => 0,
    }
}

/// G28 or G30 beside G0 or G1, as Fanuc's programs have it: the return takes the words of the axes, the other is the mode from then on.
/// LinuxCNC refuses it, so that it means nothing else.
pub fn goes_home_first(words: &Words) -> bool {
    matches!(words.code(Group::Once), Some((280 | 300, _)))
        && matches!(words.code(Group::Motion), Some((0 | 10, _)))
        && words.code(Group::ToolLength).is_none()
}

/// What a letter is for.
fn belongs_to(letter: char) -> &'static str {
    match letter {
        'I' | 'J' | 'K' => "I J K belong to G2, G3, G5, G33, G68.2, G76 and G87",
        'R' => {
            "R belongs to G2 and G3 (radius), G76, and to G73, G74 and G81 to G89 with X, Y or Z (level)"
        }
        'L' => {
            "L belongs to G81 to G89, G73 and G74 with X, Y or Z (holes), G5.2, G76, G10 and M98"
        }
        'P' => {
            "P belongs to G4 (seconds), G64 (tolerance), G2 and G3 (turns), G5, G5.2, G76, G74, G82, G84, G86, G88 and G89 (seconds), G10, M62 to M66, M98 and M100 to M199"
        }
        'Q' => {
            "Q belongs to G64 (tolerance), G83 (peck), G73, G5, G70 to G72, G76, M61, M67, M68 and M100 to M199"
        }
        'H' => "H belongs to G43 and G43.4 (tool length)",
        '@' | '^' => "@ and ^ belong to motions",
        'D' => "D belongs to G41, G42, G70 to G72 and G96",
        'E' => "E belongs to G70, M67 and M68",
        _ => "no code in this block makes use of it",
    }
}

impl State {
    /// The motion mode that is in force in this block.
    pub(super) fn motion_of(&self, words: &Words) -> Motion {
        let code = words.code(Group::Motion);
        code.map_or(self.in_force.motion(), |(number, _)| {
            Motion::of_code(number)
        })
    }

    /// The letters that a motion makes use of.
    fn letters_of_motion(&self, words: &Words) -> u32 {
        let has_axis = words.first_in(AXES | mask_of("@^")).is_some();
        let of_motion = match self.motion_of(words) {
            Motion::Arc { .. } => {
                let has_circle = words.first_of("IJKR").is_some();
                mask_of("IJKR") | if has_circle { mask_of("P") } else { 0 }
            }
            Motion::Cycle(cycle) if has_axis => cycle.letters(),
            Motion::Spline(spline) if has_axis || words.code(Group::Motion).is_some() => {
                mask_of(spline.letters())
            }
            Motion::InStep(motion) if has_axis => mask_of(motion.letters()),
            _ => 0,
        };
        AXES | mask_of("@^") | of_motion
    }

    /// Refuses words that nothing in the block makes use of, and words that two codes could mean.
    pub fn check_words_used(&self, words: &Words) -> Result<(), Refusal> {
        let mut used = ALWAYS;
        let (mut p_users, mut q_users) = (0, 0);
        let mut count = |letters: u32| {
            used |= letters;
            p_users += u32::from(letters & mask_of("P") != 0);
            q_users += u32::from(letters & mask_of("Q") != 0);
        };
        for (number, word) in words.codes() {
            count(letters_of(word.letter, number));
        }
        let takers = [Group::Once, Group::ToolLength].map(|group| words.code(group));
        let mut takers = takers.into_iter().flatten();
        let takes_axes = takers.any(|(number, word)| letters_of(word.letter, number) & AXES != 0);
        if takes_axes
            && words.code(Group::Motion).is_some()
            && !goes_home_first(words)
            && let Some(word) = words.first_in(AXES)
        {
            let found = format!("{word} in a block of two codes that take it");
            return refuse(word.offset, found, "one of them in a block");
        }
        if !takes_axes {
            count(self.letters_of_motion(words));
        }
        if let Some(word) = words.first_in(!used) {
            let letter = word.letter;
            let found = match letter {
                'I' | 'J' | 'K' => format!("{letter} without an arc"),
                'R' => "R without an arc or a hole".into(),
                _ => word.to_string(),
            };
            return refuse(word.offset, found, belongs_to(letter));
        }
        if let Some(p) = words.value('P').filter(|_| p_users > 1) {
            return p.refuse("only one of G4, G64, G2/G3, G82 in a block with P: which is it for?");
        }
        if let Some(q) = words.value('Q').filter(|_| q_users > 1) {
            return q.refuse("only one of G64 and G83 in a block with Q: which is it for?");
        }
        Ok(())
    }
}
