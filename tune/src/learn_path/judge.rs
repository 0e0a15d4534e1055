//! Whether a pass was better, and what the next one runs with.

use crate::path_learning::GAIN;
use machine::learned_path::LearnedPathPass;

/// A pass is worse than the best one from this factor on …
const WORSE: f64 = 1.1;
/// … and so many µm more.
const WORSE_UM: f64 = 0.2;
/// A pass that is not better by this part has gained nothing worth speaking of.
const BETTER: f64 = 0.98;
/// After so many of those there is nothing more to learn.
const PASSES_NO_BETTER_MAX: u32 = 3;
/// Where a pass was worse, the next one takes over half as much; below this there is nothing more to learn.
const GAIN_MIN: f64 = 0.1;
/// What is said once there is nothing more to learn.
const SETTLED: &str = "nothing more to learn: the best correction is kept";

/// How far a program has come.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Standing {
    /// What the best pass left.
    pub best: LearnedPathPass,
    /// Part of the error that the next pass takes over.
    pub gain: f64,
    /// Passes since the last one that was better.
    pub passes_no_better: u32,
    /// Nothing more to learn.
    pub settled: bool,
}

/// What the next pass runs with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    /// With what this one has taught.
    Learn,
    /// With the best correction.
    Best,
}

/// What is made of a pass.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Verdict {
    pub standing: Standing,
    /// The correction that it ran with is the best one now.
    pub takes: bool,
    pub next: Next,
    pub words: &'static str,
}

fn is_beyond(now_um: f64, best_um: f64) -> bool {
    now_um > WORSE * best_um + WORSE_UM
}

/// A pass that is taken, with the least that passes before have left: what is worse by little each time does not become the measure.
fn least(now: LearnedPathPass, best: &LearnedPathPass) -> LearnedPathPass {
    LearnedPathPass {
        mean_um: now.mean_um.min(best.mean_um),
        worst_um: now.worst_um.min(best.worst_um),
        ..now
    }
}

fn is_worse(now: &LearnedPathPass, best: &LearnedPathPass) -> bool {
    is_beyond(now.mean_um, best.mean_um) || is_beyond(now.worst_um, best.worst_um)
}

/// Judges a pass; `ran_best`: with the best correction, not one that was on trial.
pub(super) fn judged(standing: Option<&Standing>, ran_best: bool, now: LearnedPathPass) -> Verdict {
    let first = Standing {
        best: now,
        gain: GAIN,
        passes_no_better: 0,
        settled: false,
    };
    let Some(standing) = standing else {
        return verdict(first, true, Next::Learn, "the first one of this program");
    };
    let best = &standing.best;
    match (ran_best, is_worse(&now, best)) {
        (true, true) => {
            let words = "worse than with the same correction before: learns again";
            verdict(first, false, Next::Learn, words)
        }
        (true, false) if standing.settled => verdict(standing.clone(), false, Next::Best, SETTLED),
        (true, false) => {
            let mut standing = standing.clone();
            standing.best = least(now, best);
            verdict(standing, false, Next::Learn, "with the best correction")
        }
        (false, true) if is_beyond(now.mean_um, best.mean_um) => back(standing),
        (false, _) => on_trial(standing, now),
    }
}

fn verdict(standing: Standing, takes: bool, next: Next, words: &'static str) -> Verdict {
    Verdict {
        standing,
        takes,
        next,
        words,
    }
}

/// A correction on trial was worse.
fn back(standing: &Standing) -> Verdict {
    let gain = 0.5 * standing.gain;
    let standing = Standing {
        gain,
        settled: gain < GAIN_MIN,
        ..standing.clone()
    };
    let words = "worse than the best one: the next one goes back to that";
    verdict(standing, false, Next::Best, words)
}

/// A correction on trial was not worse in the mean. One that is better there and worse at its worst reversal is not taken; but on the
/// way to better ones single reversals do get worse, so it is gone on from, once.
fn on_trial(standing: &Standing, now: LearnedPathPass) -> Verdict {
    let in_mean = now.mean_um < standing.best.mean_um;
    let better = in_mean && !is_worse(&now, &standing.best);
    let gained = better && now.mean_um < BETTER * standing.best.mean_um;
    let passes_no_better = if gained {
        0
    } else {
        standing.passes_no_better + 1
    };
    let settled = passes_no_better >= PASSES_NO_BETTER_MAX;
    let again = !better && standing.passes_no_better > 0;
    let standing = Standing {
        best: if better {
            least(now, &standing.best)
        } else {
            standing.best
        },
        gain: if in_mean && !again { 1.0 } else { 0.5 } * standing.gain,
        passes_no_better,
        settled,
    };
    let words = match (settled, better) {
        (true, _) => SETTLED,
        (false, true) => "the best one so far",
        (false, false) if again => "no better again: the next one goes back to the best one",
        (false, false) if in_mean => "better in the mean, worse at its worst: not taken, goes on",
        (false, false) => "no better: goes on with half the gain",
    };
    let next = if settled || again {
        Next::Best
    } else {
        Next::Learn
    };
    verdict(standing, better, next, words)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pass(mean_um: f64, worst_um: f64) -> LearnedPathPass {
        LearnedPathPass {
            pass: 1,
            mean_um,
            worst_um,
            rms_um: 1.0,
        }
    }

    fn standing(mean_um: f64) -> Standing {
        Standing {
            best: pass(mean_um, 2.0 * mean_um),
            gain: GAIN,
            passes_no_better: 0,
            settled: false,
        }
    }

    #[test]
    fn a_pass_that_is_worse_goes_back_and_halves_the_gain_until_there_is_nothing_to_learn() {
        let found = judged(Some(&standing(2.0)), false, pass(2.5, 4.0));
        assert_eq!((found.takes, found.next), (false, Next::Best));
        assert_eq!(found.standing.best, standing(2.0).best);
        assert!((found.standing.gain - 0.5 * GAIN).abs() < 1e-12);
        let mut at = standing(2.0);
        for _ in 0..3 {
            assert!(!at.settled, "{at:?}");
            at = judged(Some(&at), false, pass(3.0, 4.0)).standing;
        }
        assert!(at.settled);
        let kept = judged(Some(&at), true, pass(2.0, 4.0));
        assert_eq!((kept.takes, kept.next), (false, Next::Best));
    }

    #[test]
    fn passes_that_are_a_little_worse_at_their_worst_do_not_become_the_measure() {
        let mut at = standing(2.0);
        let mut taken = 0;
        for (mean_um, worst_um) in [(1.9, 4.5), (1.8, 5.1), (1.7, 5.8)] {
            let found = judged(Some(&at), false, pass(mean_um, worst_um));
            taken += u32::from(found.takes);
            at = found.standing;
        }
        assert_eq!(taken, 1);
        assert_eq!(at.best.worst_um, 4.0);
        let again = judged(Some(&at), true, pass(2.0, 4.2)).standing;
        assert_eq!((again.best.mean_um, again.best.worst_um), (1.9, 4.0));
    }

    #[test]
    fn a_pass_that_is_better_in_the_mean_and_worse_at_its_worst_is_not_taken_and_gone_on_from_once()
    {
        let found = judged(Some(&standing(2.0)), false, pass(1.8, 4.7));
        assert_eq!((found.takes, found.next), (false, Next::Learn));
        assert_eq!(
            (found.standing.best, found.standing.gain),
            (standing(2.0).best, GAIN)
        );
        let again = judged(Some(&found.standing), false, pass(1.6, 4.7));
        assert_eq!((again.takes, again.next), (false, Next::Best));
        let good = judged(Some(&found.standing), false, pass(1.6, 4.0));
        assert_eq!((good.takes, good.next), (true, Next::Learn));
    }

    #[test]
    fn a_better_pass_is_taken_and_one_that_is_within_the_bound_goes_on_without_being_taken() {
        let better = judged(Some(&standing(2.0)), false, pass(1.5, 4.1));
        assert_eq!((better.takes, better.next), (true, Next::Learn));
        assert!((better.standing.best.mean_um - 1.5).abs() < 1e-12);
        let within = judged(Some(&standing(2.0)), false, pass(2.3, 4.5));
        assert_eq!((within.takes, within.next), (false, Next::Learn));
        assert_eq!(within.standing.best, standing(2.0).best);
        assert!((within.standing.gain - 0.5 * GAIN).abs() < 1e-12);
        let again = judged(Some(&within.standing), false, pass(2.3, 4.5));
        assert_eq!((again.takes, again.next), (false, Next::Best));
    }

    #[test]
    fn three_passes_that_gain_nothing_settle_and_a_machine_that_has_changed_learns_again() {
        let mut at = standing(2.0);
        for mean_um in [1.99, 2.05, 1.98] {
            at = judged(Some(&at), false, pass(mean_um, 4.0)).standing;
        }
        assert!(at.settled && (at.best.mean_um - 1.98).abs() < 1e-12);
        let changed = judged(Some(&at), true, pass(3.0, 5.0));
        assert_eq!((changed.takes, changed.next), (false, Next::Learn));
        assert!(!changed.standing.settled && (changed.standing.best.mean_um - 3.0).abs() < 1e-12);
    }
}
