//! What follows the loss of a process: restarts by the machine file's `[restart]`, bounded as in Erlang's supervisors.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use bus::sample::Job;
use machine::{Machine, Process, Restart};

use crate::group::{Death, Group};

/// Wait before a process that lived shorter than [`STEADY`] is restarted; doubled each time, up to [`BACK_OFF_MAX`].
const BACK_OFF: Duration = Duration::from_millis(10);
const BACK_OFF_MAX: Duration = Duration::from_secs(1);
const STEADY: Duration = Duration::from_millis(500);

/// What the launcher does after a death.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Another process takes its place.
    Restarts,
    /// The cell goes on without it: it trips, rests or records no more.
    GoesOn,
    /// The machine is to come to rest, and the run to end.
    Ends,
}

/// The restarts of one place.
#[derive(Debug, Default)]
struct Place {
    /// When it was restarted, of late.
    restarts: VecDeque<Instant>,
    back_off: Duration,
    due: Option<Instant>,
}

/// Decides about restarts and sees to them.
#[derive(Debug)]
pub struct Supervisor {
    policy: Restart,
    standby: Vec<bool>,
    places: Vec<Place>,
}

impl Supervisor {
    /// For a cell of this machine.
    pub fn new(machine: &Machine) -> Supervisor {
        Supervisor {
            policy: machine.restart,
            standby: machine.axes.iter().map(|axis| axis.standby).collect(),
            places: Vec::new(),
        }
    }

    /// Whether a lost process of this job is to be replaced.
    pub fn replaces(&self, process: Process) -> bool {
        let standby = self.standby.get(process.axis as usize);
        self.policy
            .replaces(process.job, standby.is_some_and(|s| *s))
    }

    /// Judges an untimely death and plans the restart.
    pub fn judge(&mut self, group: &Group, death: &Death) -> Verdict {
        let Some(role) = group.role_of(death.place) else {
            return Verdict::GoesOn;
        };
        let without = match role.process.job {
            Job::Planner | Job::Master => Verdict::Ends,
            Job::Servo | Job::Monitor => Verdict::GoesOn,
        };
        // A master that gave up by itself has reported why: another one would fare no better. One that could not take its place
        // may find it free in a moment.
        let gave_up =
            role.process.job == Job::Master && death.status.code().is_some() && death.took_part;
        if gave_up || !self.replaces(role.process) {
            return without;
        }
        let policy = self.policy;
        let place = self.place(death.place);
        let now = Instant::now();
        let within = Duration::from_secs_f64(policy.within_s);
        while place
            .restarts
            .front()
            .is_some_and(|at| now.duration_since(*at) > within)
        {
            place.restarts.pop_front();
        }
        if place.restarts.len() as u64 >= u64::from(policy.restarts_max) {
            tracing::error!(
                "{} was restarted {} times within {} s: not again",
                death.name,
                place.restarts.len(),
                policy.within_s
            );
            return without;
        }
        let lived = place.restarts.back().map(|at| now.duration_since(*at));
        place.back_off = match lived {
            Some(lived) if lived < STEADY => (place.back_off * 2).clamp(BACK_OFF, BACK_OFF_MAX),
            _ => Duration::ZERO,
        };
        place.due = Some(now + place.back_off);
        Verdict::Restarts
    }

    fn place(&mut self, index: usize) -> &mut Place {
        while self.places.len() <= index {
            self.places.push(Place::default());
        }
        &mut self.places[index]
    }

    /// Starts whoever is due; says when the next one is.
    pub fn start_due(&mut self, group: &mut Group) {
        let now = Instant::now();
        for (index, place) in self.places.iter_mut().enumerate() {
            if place.due.is_none_or(|due| due > now) {
                continue;
            }
            place.due = None;
            place.restarts.push_back(now);
            if let Err(error) = group.respawn(index, None) {
                tracing::error!("{}", crate::exit::words(&error));
                place.due = Some(now + BACK_OFF_MAX);
            }
        }
        group.end_unready();
    }

    /// Whether a process is about to be started, or on its way into the roster: the launcher looks more often then.
    pub fn is_busy(&self, group: &Group) -> bool {
        self.places.iter().any(|place| place.due.is_some()) || group.somebody_joins()
    }

    /// Forgets that the process of this place was given up.
    pub fn try_again(&mut self, place: usize) {
        let place = self.place(place);
        place.restarts.clear();
        place.back_off = Duration::ZERO;
        place.due = Some(Instant::now());
    }

    /// Whether the process of this place is about to be started.
    pub fn is_due(&self, place: usize) -> bool {
        self.places.get(place).is_some_and(|p| p.due.is_some())
    }
}
