//! Differences that are meant, each with its reason.

use crate::verdict::Verdict;

/// A difference that is meant: what the programs hold, what is said, and why.
struct Known {
    /// All of these stand in the program, in capitals.
    program: &'static [&'static str],
    verdict: fn(&Verdict) -> Option<&String>,
    /// This stands in what is said.
    says: &'static str,
    reason: &'static str,
}

fn differs(verdict: &Verdict) -> Option<&String> {
    if let Verdict::Differs(how) = verdict {
        Some(how)
    } else {
        None
    }
}

fn ours_refuses(verdict: &Verdict) -> Option<&String> {
    if let Verdict::RefusedByUs(why) = verdict {
        Some(why)
    } else {
        None
    }
}

fn theirs_refuses(verdict: &Verdict) -> Option<&String> {
    if let Verdict::AcceptedOnlyByUs(why) = verdict {
        Some(why)
    } else {
        None
    }
}

const fn known(
    program: &'static [&'static str],
    verdict: fn(&Verdict) -> Option<&String>,
    says: &'static str,
    reason: &'static str,
) -> Known {
    Known {
        program,
        verdict,
        says,
        reason,
    }
}

const KNOWN: [Known; 30] = [
    known(
        &[],
        ours_refuses,
        "travel",
        "beyond the travel of the comparison's machine",
    ),
    known(
        &[],
        ours_refuses,
        "M73 outside a subroutine",
        "M73 outside a subroutine restores nothing: refused",
    ),
    known(
        &[],
        ours_refuses,
        "M6 without T",
        "M6 without a tool named before: refused",
    ),
    known(
        &[],
        ours_refuses,
        "a spline moves X and Y only",
        "a third axis in a spline: refused",
    ),
    known(
        &[],
        theirs_refuses,
        "too close to probe point",
        "a probing move of no length: theirs is an error, ours moves nothing",
    ),
    known(
        &["G94"],
        theirs_refuses,
        "zero feed rate",
        "G94 forgets F in theirs, also where G94 holds",
    ),
    known(
        &["G94"],
        theirs_refuses,
        "with 0 feed rate",
        "G94 forgets F in theirs, also where G94 holds",
    ),
    known(
        &["G84", "G18"],
        differs,
        "",
        "G84 outside G17: theirs feeds to permuted axes (2.9)",
    ),
    known(
        &["G84", "G19"],
        differs,
        "",
        "G84 outside G17: theirs feeds to permuted axes (2.9)",
    ),
    known(
        &["G74", "G18"],
        differs,
        "",
        "G74 outside G17: theirs feeds to permuted axes (2.9)",
    ),
    known(
        &["G74", "G19"],
        differs,
        "",
        "G74 outside G17: theirs feeds to permuted axes (2.9)",
    ),
    known(
        &["BREAK", " DO"],
        differs,
        "",
        "theirs leaves a do loop that follows a break (2.9)",
    ),
    known(
        &["G84", "P"],
        differs,
        "theirs: dwell",
        "theirs keeps the P of another cycle for G84",
    ),
    known(
        &["G74", "P"],
        differs,
        "theirs: dwell",
        "theirs keeps the P of another cycle for G74",
    ),
    known(
        &["T0", "G43"],
        differs,
        "",
        "theirs keeps the length of the tool before for an empty spindle",
    ),
    known(
        &["M61Q0", "G43"],
        differs,
        "",
        "theirs keeps the length of the tool before for an empty spindle",
    ),
    known(
        &["G92", "G10L2", "R"],
        differs,
        "",
        "G10 L2 R while G92 or G52 holds: theirs turns where it is without that offset",
    ),
    known(
        &["G52", "G10L2", "R"],
        differs,
        "",
        "G10 L2 R while G92 or G52 holds: theirs turns where it is without that offset",
    ),
    known(
        &["G93", "G38."],
        differs,
        "",
        "a probing move in G93: theirs keeps the feed before",
    ),
    known(&["M72"], differs, "", "M72 restores G92.2 in theirs, too"),
    known(&["M73"], differs, "", "M73 restores G92.2 in theirs, too"),
    known(
        &["M70"],
        differs,
        "",
        "M70 and M72: G92.2 comes back in theirs, too",
    ),
    known(
        &["G5"],
        ours_refuses,
        "G5 without",
        "a block after G5 without I J P Q: refused",
    ),
    known(
        &[],
        ours_refuses,
        "a cycle runs along an axis",
        "a cycle in G18, G19 with X and Y turned: refused",
    ),
    known(
        &[],
        theirs_refuses,
        "polar coordinate except in G17",
        "polar words outside G17: taken by us",
    ),
    known(
        &["#<_SPINDLE", "M6"],
        differs,
        "theirs: message",
        "open: a tool change stops the spindle in theirs",
    ),
    known(
        &["M50"],
        differs,
        "override",
        "open: M50 is the feed override alone",
    ),
    known(
        &["M51"],
        differs,
        "override",
        "open: M51 is the spindle override alone",
    ),
    known(
        &["G96"],
        differs,
        "spindle mode",
        "open: G96 says nothing of the cutting speed",
    ),
    known(
        &["@", "L"],
        differs,
        "",
        "open: polar steps in cycles with L",
    ),
];

/// Why a difference is meant, if it is.
pub fn reason(program: &str, verdict: &Verdict) -> Option<&'static str> {
    let text = program.to_ascii_uppercase();
    let tight = text.replace(' ', "");
    let holds = |known: &&Known| {
        let said = (known.verdict)(verdict).is_some_and(|said| said.contains(known.says));
        said && known
            .program
            .iter()
            .all(|part| text.contains(part) || tight.contains(part))
    };
    KNOWN.iter().find(holds).map(|known| known.reason)
}
