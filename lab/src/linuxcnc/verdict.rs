//! What comes of a comparison.

use std::fmt;
use std::path::Path;

use crate::linuxcnc::ours;
use crate::linuxcnc::theirs::Theirs;
use crate::linuxcnc::trace::{Step, Trace, first_difference, simplified};

/// What two interpreters make of one program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verdict {
    /// The same, to the tolerance.
    Same,
    /// The first difference.
    Differs(String),
    /// Our reason.
    RefusedByUs(String),
    /// Both reasons, theirs first.
    RefusedByBoth(String, String),
    /// Their reason.
    AcceptedOnlyByUs(String),
}

/// A verdict, and whether the program moves a machine.
pub struct Judged {
    pub verdict: Verdict,
    pub moving: bool,
}

impl fmt::Display for Verdict {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Verdict::Same => write!(to, "same"),
            Verdict::Differs(how) => write!(to, "DIFFERS: {how}"),
            Verdict::RefusedByUs(why) => write!(to, "REFUSED BY US: {why}"),
            Verdict::RefusedByBoth(theirs, ours) => {
                write!(to, "refused by both: theirs: {theirs} | ours: {ours}")
            }
            Verdict::AcceptedOnlyByUs(why) => write!(to, "ACCEPTED ONLY BY US: theirs: {why}"),
        }
    }
}

/// Runs a file through both.
pub fn judge(theirs: &mut Theirs, file: &Path) -> Judged {
    theirs.begin(file);
    let mine = ours::run(file);
    compared(theirs.finish(), mine)
}

/// The verdict on two traces.
pub fn compared(theirs: Trace, ours: Trace) -> Judged {
    let moving = theirs
        .as_ref()
        .is_ok_and(|steps| steps.iter().any(Step::moves));
    let verdict = match (theirs, ours) {
        (Ok(theirs), Ok(ours)) => first_difference(&simplified(theirs), &simplified(ours))
            .map_or(Verdict::Same, Verdict::Differs),
        (Ok(_), Err(why)) => Verdict::RefusedByUs(why),
        (Err(why), Ok(_)) => Verdict::AcceptedOnlyByUs(why),
        (Err(theirs), Err(ours)) => Verdict::RefusedByBoth(theirs, ours),
    };
    Judged { verdict, moving }
}

/// How many of each.
#[derive(Debug, Default)]
pub struct Tally {
    /// Same, differs, refused by us, by both, accepted only by us: of those that move, and of the others.
    pub moving: [usize; 5],
    pub still: [usize; 5],
}

impl Tally {
    pub fn count(&mut self, judged: &Judged) {
        let index = match judged.verdict {
            Verdict::Same => 0,
            Verdict::Differs(_) => 1,
            Verdict::RefusedByUs(_) => 2,
            Verdict::RefusedByBoth(..) => 3,
            Verdict::AcceptedOnlyByUs(_) => 4,
        };
        let counts = if judged.moving {
            &mut self.moving
        } else {
            &mut self.still
        };
        if let Some(count) = counts.get_mut(index) {
            *count += 1;
        }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            to,
            "| | same | differs | refused by us | by both | accepted only by us | same, of those that theirs runs |"
        )?;
        writeln!(to, "|---|---|---|---|---|---|---|")?;
        for (name, counts) in [("moving", self.moving), ("no motion", self.still)] {
            let [same, differs, refused, both, only] = counts;
            let all = same + differs + refused;
            let share = 100.0 * same as f64 / all.max(1) as f64;
            writeln!(
                to,
                "| {name} | {same} | {differs} | {refused} | {both} | {only} | {share:.1} % of {all} |"
            )?;
        }
        Ok(())
    }
}
