//! Differences that are meant, each with the source of the rule.
//!
//! "Manual" is LinuxCNC's (*G-Codes*, *M-Codes*, *G-Code Overview*), "NIST" the RS274/NGC interpreter, version 3.

use seen::Seen;

use crate::linuxcnc::verdict::Verdict;

#[path = "known_seen.rs"]
mod seen;

/// Which side a difference is on.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    /// Both run.
    Differs,
    /// Theirs runs.
    OursRefuses,
    /// Ours runs.
    TheirsRefuses,
}
use Side::{Differs, OursRefuses, TheirsRefuses};

/// A difference that is meant.
struct Known {
    side: Side,
    /// This stands in what is said.
    says: &'static str,
    when: fn(&Seen) -> bool,
    reason: &'static str,
}

const fn known(
    side: Side,
    says: &'static str,
    when: fn(&Seen) -> bool,
    reason: &'static str,
) -> Known {
    Known {
        side,
        says,
        when,
        reason,
    }
}

/// What moves the zero of the program.
fn moves_zero(line: &str, codes: &[u32]) -> bool {
    let offsets = |code: &u32| matches!(code, 520 | 540..=593 | 920..=923 | 200 | 210);
    codes.iter().any(offsets) || line.contains("G10L2")
}

/// What leaves the axis elsewhere than where the cycle before has ended, or the next hole another R.
fn leaves_the_level(_: &str, codes: &[u32]) -> bool {
    let leaves = |code: &u32| matches!(code, 280 | 300 | 430..=432 | 490 | 910 | 990);
    codes.iter().any(leaves)
}

fn chooses_plane(_: &str, codes: &[u32]) -> bool {
    codes.iter().any(|code| matches!(code, 170 | 180 | 190))
}

fn taps_upright(seen: &Seen) -> bool {
    let (motion, plane) = seen.motion_and_plane();
    let once = (seen.one_line() || seen.prints("#")) && plane != 170;
    once && matches!(motion, 740 | 840) || seen.taps_upright_in_a_loop()
}

/// By the manual or NIST; ours keeps to them.
const BY_THE_RULES: [Known; 30] = [
    known(
        Differs,
        "",
        |seen| seen.one_line() && seen.series_with(chooses_plane),
        "another plane in a series of cycles: theirs keeps the level of the other axis (manual, G98: the position of that axis)",
    ),
    known(
        OursRefuses,
        "in the first block of a cycle",
        |seen| seen.series_with(chooses_plane),
        "another plane in a series of cycles: theirs keeps R and bottom of the other axis (manual: they stay along one axis)",
    ),
    known(
        Differs,
        "",
        |seen| seen.both_move() && seen.series_with(moves_zero),
        "an offset or a unit changes in a series of cycles: theirs keeps the number of the level before it, not the place (manual, G98)",
    ),
    known(
        Differs,
        "",
        |seen| seen.both_rapid() && (seen.series_with(leaves_the_level) || seen.levels_change()),
        "to the next hole theirs goes from the level before the series, slantwise or lower (manual: up to R, over the hole, down)",
    ),
    known(
        Differs,
        "",
        |seen| seen.both_move() && (seen.has("G83") || seen.has("G73")) && seen.whole_pecks(),
        "a hole of whole pecks: by the last bit theirs pecks once more, over no depth",
    ),
    known(
        Differs,
        "",
        |seen| {
            let apart = seen.apart_in("ABC") || !seen.one_line();
            seen.has_code(431) && seen.turns_home() && apart
        },
        "G28, G30 or G53 with a rotary axis in G43.1: theirs is off by that offset (manual: machine coordinates)",
    ),
    known(
        Differs,
        "",
        |seen| seen.has("G10L2") && seen.has("R") && seen.has_home(),
        "G28 X with X and Y turned: theirs moves X and Y, not to the place of X (manual: the axes that are named, to their places)",
    ),
    known(
        Differs,
        "",
        |seen| seen.sets_offset_parameters(),
        "a parameter of the work offset in force is set: it counts from the next G54 on; theirs passes over a G54 that holds",
    ),
    known(
        OursRefuses,
        "one sign before a value",
        |_| true,
        "+-0: a number has one sign (manual, G-Code Overview: numbers; NIST 3.3.2.1)",
    ),
    known(
        Differs,
        "",
        taps_upright,
        "G84 or G74 outside G17: theirs feeds to permuted axes (2.9)",
    ),
    known(
        TheirsRefuses,
        "L word with no G10",
        |seen| seen.has_code(740),
        "L in a block of G74: refused by theirs (manual, G74: L holes)",
    ),
    known(
        Differs,
        "theirs: clockwise",
        |seen| seen.has_code(880),
        "G88: theirs leaves the way out to the operator, ours makes what he has left of it",
    ),
    known(
        Differs,
        "theirs: dwell",
        |seen| seen.has_code(840) || seen.has_code(740),
        "theirs keeps the P of another cycle for G84 and G74",
    ),
    known(
        Differs,
        "",
        |seen| seen.do_and_break(),
        "theirs leaves a do loop that follows a break after its first pass (2.9)",
    ),
    known(
        OursRefuses,
        "",
        |seen| seen.do_and_break(),
        "theirs leaves a do loop that follows a break after its first pass (2.9)",
    ),
    known(
        Differs,
        "",
        |seen| {
            let empty = seen.has("T0") || seen.has("M61Q0");
            empty && seen.has_code(430)
        },
        "theirs keeps the length of the tool before for an empty spindle (manual, G43: that of the current tool)",
    ),
    known(
        Differs,
        "",
        |seen| {
            let shifted = seen.has_code(920) || seen.has_code(520);
            shifted && seen.has("G10L2") && seen.has("R")
        },
        "G10 L2 R while G92 or G52 holds: theirs turns where it is without that offset",
    ),
    known(
        TheirsRefuses,
        "too close to probe point",
        |_| true,
        "a probing move of no length: theirs is an error, ours moves nothing",
    ),
    known(
        TheirsRefuses,
        "zero feed rate",
        |seen| seen.has_code(940),
        "G94 forgets F in theirs, also where G94 holds (manual, G94: no such rule)",
    ),
    known(
        TheirsRefuses,
        "with 0 feed rate",
        |seen| seen.has_code(940),
        "G94 forgets F in theirs, also where G94 holds (manual, G94: no such rule)",
    ),
    known(
        TheirsRefuses,
        "polar coordinate except in G17",
        |_| true,
        "polar words outside G17: taken by us",
    ),
    known(
        Differs,
        "",
        |seen| {
            seen.prints("#<_FEED>")
                && (seen.has_code(930) || seen.has_code(940) || seen.has_code(950))
        },
        "#<_feed> behind G93 or G94: ours is the F in force, theirs that of before, or that of the last move",
    ),
    known(
        Differs,
        "",
        |seen| seen.has("ATAN") && (seen.mirrored() || seen.quarter_turns_apart()),
        "ATAN of a zero over a number below 0: theirs has zeros below 0, of MOD, SIN and -[0], whose angle is -180, not 180, or SIN[180] a little below 0, -90, not 90",
    ),
    known(
        Differs,
        " 50.0",
        |seen| seen.prints("#<_MOTION_MODE>") && seen.has_code(50),
        "#<_motion_mode> behind G5: theirs has the motion before it still in force",
    ),
    known(
        OursRefuses,
        "splines lie in the plane XY",
        |seen| seen.has_code(50) && (seen.has_code(180) || seen.has_code(190)),
        "axis words behind G5 and another plane: theirs goes on with the motion before G5, ours refuses",
    ),
    known(
        Differs,
        "",
        |seen| {
            let restores = seen.has("M70") || seen.has("M72") || seen.has("M73");
            restores && (920..=923).any(|code| seen.has_code(code))
        },
        "M70 and M72: G92.2 comes back in theirs, too (manual, M70: not among what is saved)",
    ),
    known(
        Differs,
        "",
        |seen| seen.prints("#") && seen.prints_less_than(1e-4),
        "theirs prints values below 0.0001 as 0",
    ),
    known(
        Differs,
        "",
        |seen| seen.prints("#") && seen.has("TAN[90"),
        "TAN of 90 degrees has no value: theirs and ours are two large numbers",
    ),
    known(
        Differs,
        "F0.1",
        |seen| seen.has_code(930) && seen.one_line(),
        "G93: theirs feeds at 0.1 mm/min at least (manual, G93: F minutes for the move)",
    ),
    known(
        TheirsRefuses,
        "R less than z in cycle",
        |seen| seen.has_code(910),
        "G91 behind a cycle of G90: theirs counts R and bottom as steps from there on, ours keeps the levels",
    ),
];

/// Refused by us, for a reason that the message says.
const REFUSED: [Known; 11] = [
    known(
        OursRefuses,
        "travel",
        |_| true,
        "beyond the travel of the comparison's machine",
    ),
    known(
        OursRefuses,
        "M73 outside a subroutine",
        |_| true,
        "M73 outside a subroutine restores nothing: refused",
    ),
    known(
        OursRefuses,
        "M6 without T",
        |_| true,
        "M6 without a tool named before: refused",
    ),
    known(
        OursRefuses,
        "a spline moves X and Y only",
        |_| true,
        "a third axis in a spline: refused",
    ),
    known(
        OursRefuses,
        "probing in G93",
        |_| true,
        "a probing move in G93: refused, its time is not known",
    ),
    known(
        OursRefuses,
        "G5 without",
        |_| true,
        "a block after G5 without I J P Q: refused",
    ),
    known(
        OursRefuses,
        "a cycle runs along an axis",
        |_| true,
        "a cycle in G18, G19 with X and Y turned: refused",
    ),
    known(
        OursRefuses,
        "in G96: one speed of the spindle",
        |_| true,
        "threads and taps in G96: refused, their pitch needs one speed of the spindle",
    ),
    known(
        OursRefuses,
        "lies above the bottom of the hole",
        |seen| seen.has_code(910) && seen.series_with(|_, codes| codes.contains(&900)),
        "G90 behind a cycle of G91: theirs takes R and bottom as places from there on, ours keeps the levels",
    ),
    known(
        OursRefuses,
        "has no blocks",
        |_| true,
        "a program of comments alone: refused",
    ),
    known(
        OursRefuses,
        "G97 without S behind G96",
        |_| true,
        "G97 without S behind G96: theirs takes the cutting speed as rev/min, ours refuses",
    ),
];

/// Why a difference is meant, if it is.
pub fn reason(program: &str, verdict: &Verdict) -> Option<&'static str> {
    let (side, said) = match verdict {
        Verdict::Differs(how) => (Differs, how),
        Verdict::RefusedByUs(why) => (OursRefuses, why),
        Verdict::AcceptedOnlyByUs(why) => (TheirsRefuses, why),
        Verdict::Same | Verdict::RefusedByBoth(..) => return None,
    };
    let seen = Seen::new(program, said);
    let all = BY_THE_RULES.iter().chain(&REFUSED);
    let mut all = all.filter(|known| known.side == side && said.contains(known.says));
    all.find(|known| (known.when)(&seen))
        .map(|known| known.reason)
}
