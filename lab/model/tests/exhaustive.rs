//! Every order of what may go wrong in a small cell, and that the model finds what is made wrong on purpose.

use machine::{AfterLoss, AfterMaster};
use model::bench::{Budget, Mistake, Setting};
use model::check::{Outcome, check};

use crate::size;

fn budget([kills, losses, stops, go_ons]: [u8; 4]) -> Budget {
    Budget {
        kills,
        losses,
        stops,
        go_ons,
    }
}

/// Axis X with a standby, Y without; everybody is replaced, and the machine goes on by itself where it may.
fn resuming(numbers: [u8; 4]) -> Setting {
    Setting {
        standby: [true, false],
        servo: AfterLoss::Resume,
        planner: AfterLoss::Resume,
        master: AfterMaster::Wait,
        budget: budget(numbers),
        mistake: None,
    }
}

/// No standby; the machine waits for the operator after each loss.
fn waiting(numbers: [u8; 4]) -> Setting {
    Setting {
        standby: [false; 2],
        servo: AfterLoss::Wait,
        planner: AfterLoss::Wait,
        ..resuming(numbers)
    }
}

/// Each loss ends the run, but that of one of two servos.
fn ending(numbers: [u8; 4]) -> Setting {
    Setting {
        servo: AfterLoss::End,
        planner: AfterLoss::End,
        master: AfterMaster::End,
        ..resuming(numbers)
    }
}

fn holds(what: &str, setting: Setting) -> Outcome {
    let outcome = check(setting);
    let budget = setting.budget;
    println!(
        "{what}, {} kills, {} lost, {} stops, {} orders to go on: {} states, {} steps, depth {}, {:.1} s",
        budget.kills,
        budget.losses,
        budget.stops,
        budget.go_ons,
        outcome.states,
        outcome.steps,
        outcome.depth,
        outcome.took.as_secs_f64()
    );
    if let Some((name, way)) = outcome.broken.first() {
        panic!("{what}: {name}\n{way}");
    }
    outcome
}

#[test]
fn after_one_kill_and_one_lost_sample_a_cell_that_resumes_is_safe_and_moves_on_or_says_why_not() {
    let outcome = holds("resuming", resuming([1, 1, 0, 0]));
    assert!(outcome.missing.is_empty(), "{:?}", outcome.missing);
    // A change that lets states fall together would check nothing.
    assert!(outcome.states > 20_000, "{} states", outcome.states);
}

#[test]
fn after_two_kills_a_cell_that_resumes_is_safe_and_moves_on_or_says_why_not() {
    if size::is_left_out() {
        return;
    }
    let outcome = holds("resuming", resuming([2, 0, 0, 0]));
    assert!(outcome.missing.is_empty(), "{:?}", outcome.missing);
}

#[test]
fn a_stop_and_an_order_to_go_on_come_at_any_moment_before_or_after_a_kill() {
    holds("resuming", resuming([1, 0, 1, 1]));
    holds("waiting", waiting([1, 0, 1, 1]));
}

#[test]
fn after_two_kills_a_cell_that_waits_says_truly_what_for() {
    if size::is_left_out() {
        return;
    }
    holds("waiting", waiting([2, 0, 0, 1]));
}

#[test]
fn a_run_that_ends_with_a_loss_ends_whatever_else_happens() {
    let losses = u8::from(size::is_full());
    holds("ending", ending([1, losses, 1, 0]));
}

#[test]
fn two_standbys_take_over_after_each_other() {
    let setting = Setting {
        standby: [true; 2],
        ..resuming([2, 0, 0, 0])
    };
    holds("two standbys", setting);
}

/// Minutes; figures in docs/developers/model.md.
#[test]
fn everything_at_once() {
    if size::is_left_out() {
        return;
    }
    holds("resuming", resuming([1, 1, 1, 1]));
    holds("waiting", waiting([1, 1, 1, 1]));
    holds("resuming", resuming([2, 0, 1, 0]));
    holds("waiting", waiting([2, 1, 0, 0]));
    holds("resuming", resuming([2, 1, 0, 0]));
}

/// What a mistake needs to do harm, and the property that it breaks.
fn harm(mistake: Mistake) -> ([u8; 4], &'static str) {
    let settles = "it moves on, ends, or rests with a true reason";
    let window = "an axis is driven along the window that the feedback names";
    match mistake {
        Mistake::WindowWithoutEveryAxis => ([0, 1, 0, 0], window),
        Mistake::AdmittedUnderOldIncarnation => ([1, 0, 0, 0], settles),
        Mistake::StaleFeedbackObeyed => ([0, 1, 0, 0], window),
        Mistake::RestartedAfterTheEnd => ([1, 0, 0, 0], "a run that has ended stays so"),
        Mistake::StopOrderedOnce => ([1, 0, 1, 0], settles),
        Mistake::ScanPublishedTwice => ([1, 0, 0, 0], "no scan is published twice"),
        Mistake::WindowOfAnyPlanner => ([1, 0, 0, 0], "nobody answers for another incarnation"),
        Mistake::AnsweredBeforeSaved => ([1, 0, 1, 0], settles),
        Mistake::StopTakenBack => ([0, 0, 1, 1], "a stop that was accepted holds"),
        Mistake::PlaceForgotten => (
            [1, 0, 0, 2],
            "the tool follows the path in order and without a gap",
        ),
    }
}

/// A property that nothing could break would say nothing.
#[test]
fn each_rule_that_is_broken_on_purpose_is_found() {
    for mistake in Mistake::ALL {
        let (numbers, property) = harm(mistake);
        let outcome = check(Setting {
            mistake: Some(mistake),
            ..resuming(numbers)
        });
        let broken: Vec<&str> = outcome.broken.iter().map(|(name, _)| *name).collect();
        println!("{mistake:?}: {} states, broken: {broken:?}", outcome.states);
        assert!(broken.contains(&property), "{mistake:?}: {broken:?}");
    }
}
