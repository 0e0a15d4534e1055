//! The model as `stateright` checks it: states, what may happen in each, and the properties.

use std::time::{Duration, Instant};

use stateright::{Checker, Model, Property};

use crate::bench::Setting;
use crate::cell::{Cell, Frame, Who};
use crate::rules::{Broken, STILL_MAX};
use crate::scan::{Fate, Moment, go_on_order};
use crate::settling::Settled;

/// Scans that the launcher may leave what there is to do.
const LAUNCHER_IDLE_SCANS: u8 = 2;

/// What may happen next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// A scan of the master, and what becomes of it.
    Scan(Fate),
    /// A process is killed between two scans.
    Kill(Who),
    /// The launcher looks and does what there is to do.
    Launcher,
    /// The operator orders a stop in the page.
    Stop,
    /// Ctrl-C.
    Interrupt,
    /// The operator brings a waiting machine on.
    GoOn,
}

/// One question to the model.
#[derive(Debug)]
pub struct CellModel {
    frame: Frame,
    settled: Settled,
}

impl CellModel {
    /// Of this setting.
    pub fn new(setting: Setting) -> CellModel {
        CellModel {
            frame: Frame {
                machine: setting.machine(),
                setting,
            },
            settled: Settled::default(),
        }
    }

    /// What every step needs.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    fn fates(&self, cell: &Cell, fates: &mut Vec<Fate>) {
        fates.push(Fate::Good);
        if cell.ghost.still >= STILL_MAX {
            return;
        }
        if cell.budget.losses > 0 {
            for (index, servo) in cell.servos.iter().enumerate() {
                if servo.place.life.lives() {
                    fates.push(Fate::FeedbackLost(index));
                    fates.push(Fate::CommandLate(index));
                    fates.push(Fate::WindowLost(index));
                }
            }
            fates.extend([Fate::WindowLostToMaster, Fate::PlannerLate]);
        }
        if cell.budget.kills > 0 {
            let moments = [
                Moment::BeforeFeedback,
                Moment::AfterFeedback,
                Moment::AfterSaving,
                Moment::AfterOrders,
            ];
            fates.extend(moments.map(Fate::MasterKilled));
        }
    }
}

impl Model for CellModel {
    type State = Cell;
    type Action = Action;

    fn init_states(&self) -> Vec<Cell> {
        vec![self.frame.start()]
    }

    fn actions(&self, cell: &Cell, actions: &mut Vec<Action>) {
        if cell.launcher.exited || cell.ghost.broken.is_some() {
            return;
        }
        let work = cell.has_work(&self.frame);
        if work {
            actions.push(Action::Launcher);
        }
        let in_time = !work || cell.launcher.idle < LAUNCHER_IDLE_SCANS;
        if cell.master.is_some() && in_time {
            let mut fates = Vec::new();
            self.fates(cell, &mut fates);
            actions.extend(fates.into_iter().map(Action::Scan));
        }
        if cell.ghost.still >= STILL_MAX {
            return;
        }
        if cell.budget.kills > 0 {
            let can_die = |who: &Who| cell.place(*who).life.lives() && *who != Who::Master;
            actions.extend(cell.everybody().filter(can_die).map(Action::Kill));
        }
        if cell.budget.stops > 0 && !cell.page.stop && !cell.launcher.interrupted {
            actions.extend([Action::Stop, Action::Interrupt]);
        }
        let waits = cell.feedback.as_ref().and_then(go_on_order).is_some();
        let free = cell.master.is_some() && cell.inbox.go_on.is_none();
        if cell.budget.go_ons > 0 && waits && free {
            actions.push(Action::GoOn);
        }
    }

    fn next_state(&self, cell: &Cell, action: Action) -> Option<Cell> {
        let mut next = cell.clone();
        match action {
            Action::Scan(fate) => {
                match fate {
                    Fate::Good => {}
                    Fate::MasterKilled(_) => next.budget.kills -= 1,
                    _ => next.budget.losses -= 1,
                }
                next.scan(&self.frame, fate);
                // Only counted while there is something to do.
                let idle = next.launcher.idle + 1;
                next.launcher.idle = if next.has_work(&self.frame) { idle } else { 0 };
            }
            Action::Kill(who) => {
                next.budget.kills -= 1;
                next.kill(who);
            }
            Action::Launcher => next.supervise(&self.frame),
            Action::Stop => {
                next.budget.stops -= 1;
                next.page.stop = true;
            }
            Action::Interrupt => {
                next.budget.stops -= 1;
                next.launcher.interrupted = true;
            }
            Action::GoOn => {
                next.budget.go_ons -= 1;
                next.inbox.go_on = next.feedback.as_ref().and_then(go_on_order);
            }
        }
        next.take_name();
        Some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let keeps = Property::<Self>::always;
        vec![
            keeps(
                "an axis is driven along the window that the feedback names",
                |_, c| c.ghost.broken != Some(Broken::Window),
            ),
            keeps("one servo is heard on an axis while it answers", |_, c| {
                c.ghost.broken != Some(Broken::TwoWriters)
            }),
            keeps(
                "the tool follows the path in order and without a gap",
                |_, c| c.ghost.broken != Some(Broken::Path),
            ),
            keeps("nobody answers for another incarnation", |_, c| {
                c.ghost.broken != Some(Broken::Incarnation)
            }),
            keeps("a run that has ended stays so", |_, c| {
                c.ghost.broken != Some(Broken::Ended)
            }),
            keeps("no scan is published twice", |_, c| {
                c.ghost.broken != Some(Broken::Scan)
            }),
            keeps("a stop that was accepted holds", |_, c| {
                c.ghost.broken != Some(Broken::Stop)
            }),
            keeps("it moves on, ends, or rests with a true reason", |m, c| {
                c.ghost.broken.is_some() || c.settles(&m.frame, &m.settled)
            }),
            Property::<Self>::sometimes(
                "a run ends after everything that may go wrong did",
                |_, c| c.launcher.exited && c.budget.kills + c.budget.losses == 0,
            ),
            Property::<Self>::sometimes("a standby takes over", |m, c| {
                !m.frame.setting.standby[0] || c.feedback.is_some_and(|f| f.axes[0].taken_role == 1)
            }),
        ]
    }
}

/// What a check came to.
#[derive(Debug)]
pub struct Outcome {
    /// Distinct states.
    pub states: usize,
    /// Steps that were tried.
    pub steps: usize,
    /// Longest way to a state.
    pub depth: usize,
    /// States of undisturbed ends, beside these.
    pub settled: usize,
    /// Wall time.
    pub took: Duration,
    /// Properties that do not hold, each with the way to where it does not.
    pub broken: Vec<(&'static str, String)>,
    /// Examples that were not found.
    pub missing: Vec<&'static str>,
}

/// Checks a setting exhaustively, or until a property does not hold where something is wrong on purpose.
pub fn check(setting: Setting) -> Outcome {
    let began = Instant::now();
    let checker = CellModel::new(setting)
        .checker()
        .threads(std::thread::available_parallelism().map_or(1, |n| n.get()))
        .spawn_bfs()
        .join();
    let model = checker.model();
    let discoveries = checker.discoveries();
    let mut broken = Vec::new();
    let mut missing = Vec::new();
    for property in model.properties() {
        let found = discoveries.get(property.name);
        if property.expectation.discovery_is_failure() {
            if let Some(path) = found {
                let way = path.clone().into_vec();
                let lines = way
                    .iter()
                    .map(|(state, action)| format!("{state:?}\n   {action:?}"));
                broken.push((property.name, lines.collect::<Vec<_>>().join("\n")));
            }
        } else if found.is_none() {
            missing.push(property.name);
        }
    }
    Outcome {
        states: checker.unique_state_count(),
        steps: checker.state_count(),
        depth: checker.max_depth(),
        settled: model.settled.count(),
        took: began.elapsed(),
        broken,
        missing,
    }
}
