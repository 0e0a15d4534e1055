//! What follows the loss of a process: restarts by the machine file's `[restart]`, bounded as in Erlang's supervisors. The rule is one
//! for all ([`Restarts`]): who controls the machine and who shows it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use bus::sample::{Feedback, Job, Mode};
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

/// Whether a machine that has answered a stop in this scan goes on all the same: somebody has resumed it since.
pub fn goes_on_after_stop(answered: u64, newest: &Feedback) -> bool {
    let mode = Mode::from_wire(newest.mode);
    newest.scan > answered && matches!(mode, Some(Mode::Enabled | Mode::Jogging))
}

/// The restarts of one place; instants are times since the cell was started.
#[derive(Debug, Default)]
pub struct Restarts {
    /// When it was restarted, of late.
    restarts: VecDeque<Duration>,
    back_off: Duration,
    due: Option<Duration>,
}

impl Restarts {
    /// Plans the restart of a process that has ended; false where it was restarted too often of late.
    pub fn plan(&mut self, policy: &Restart, now: Duration) -> bool {
        let within = Duration::from_secs_f64(policy.within_s);
        let since = |at: &Duration| now.saturating_sub(*at);
        while self.restarts.front().is_some_and(|at| since(at) > within) {
            self.restarts.pop_front();
        }
        if self.restarts.len() as u64 >= u64::from(policy.restarts_max) {
            return false;
        }
        let lived = self.restarts.back().map(since);
        self.back_off = match lived {
            Some(lived) if lived < STEADY => (self.back_off * 2).clamp(BACK_OFF, BACK_OFF_MAX),
            _ => Duration::ZERO,
        };
        self.due = Some(now + self.back_off);
        true
    }

    /// Whether the process is to be started now; it counts as started.
    pub fn take_due(&mut self, now: Duration) -> bool {
        let is_due = self.due.take_if(|due| *due <= now).is_some();
        if is_due {
            self.restarts.push_back(now);
        }
        is_due
    }

    /// It could not be started: once more, later.
    pub fn put_off(&mut self, now: Duration) {
        self.due = Some(now + BACK_OFF_MAX);
    }
}

/// Says that a process is not started again.
pub fn say_given_up(name: &str, policy: &Restart) {
    let (max, within_s) = (policy.restarts_max, policy.within_s);
    tracing::error!("{name} was restarted {max} times within {within_s} s: not again");
}

/// Decides who is restarted and when. Pure: time is an argument, so that a simulation decides as the launcher does.
#[derive(Debug)]
pub struct RestartRules {
    policy: Restart,
    standby: Vec<bool>,
    places: Vec<Restarts>,
}

impl RestartRules {
    /// For a cell of this machine.
    pub fn new(machine: &Machine) -> RestartRules {
        RestartRules {
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

    /// Judges an untimely death in this place and plans the restart. Who `gave_up` has reported why: another process would fare
    /// no better. `covered` where another process goes on that does the same.
    pub fn judge(
        &mut self,
        index: usize,
        process: Process,
        gave_up: bool,
        covered: bool,
        now: Duration,
    ) -> Verdict {
        let replaces = self.replaces(process);
        let without = match process.job {
            Job::Planner | Job::Master => Verdict::Ends,
            Job::Fieldbus if covered => Verdict::GoesOn,
            Job::Fieldbus => Verdict::Ends,
            // The master waits for one that is to be replaced: nobody else ends that.
            Job::Servo if replaces && !covered => Verdict::Ends,
            Job::Servo | Job::Monitor | Job::Logic => Verdict::GoesOn,
        };
        if gave_up || !replaces {
            return without;
        }
        let policy = self.policy;
        match self.place(index).plan(&policy, now) {
            true => Verdict::Restarts,
            false => without,
        }
    }

    fn place(&mut self, index: usize) -> &mut Restarts {
        while self.places.len() <= index {
            self.places.push(Restarts::default());
        }
        &mut self.places[index]
    }

    /// The next place whose process is to be started now; it counts as started.
    pub fn take_due(&mut self, now: Duration) -> Option<usize> {
        let mut places = self.places.iter_mut();
        places.position(|place| place.take_due(now))
    }

    /// It could not be started: once more, later.
    pub fn put_off(&mut self, index: usize, now: Duration) {
        self.place(index).put_off(now);
    }

    /// Forgets that the process of this place was given up.
    pub fn try_again(&mut self, index: usize, now: Duration) {
        let place = self.place(index);
        place.restarts.clear();
        place.back_off = Duration::ZERO;
        place.due = Some(now);
    }

    /// Whether the process of this place is about to be started.
    pub fn is_due(&self, index: usize) -> bool {
        self.places.get(index).is_some_and(|p| p.due.is_some())
    }

    /// Whether any is.
    pub fn is_any_due(&self) -> bool {
        self.places.iter().any(|place| place.due.is_some())
    }
}

/// Decides about restarts and sees to them.
#[derive(Debug)]
pub struct Supervisor {
    rules: RestartRules,
    begun: Instant,
}

impl Supervisor {
    /// For a cell of this machine.
    pub fn new(machine: &Machine) -> Supervisor {
        Supervisor {
            rules: RestartRules::new(machine),
            begun: Instant::now(),
        }
    }

    /// Whether a lost process of this job is to be replaced.
    pub fn replaces(&self, process: Process) -> bool {
        self.rules.replaces(process)
    }

    /// Judges an untimely death and plans the restart.
    pub fn judge(&mut self, group: &Group, death: &Death) -> Verdict {
        let Some(role) = group.role_of(death.place) else {
            return Verdict::GoesOn;
        };
        // A master that gave up by itself has reported why. One that could not take its place may find it free in a moment.
        let gave_up =
            role.process.job == Job::Master && death.status.code().is_some() && death.took_part;
        let now = self.begun.elapsed();
        let covered = group.is_covered(role.process);
        let rules = &mut self.rules;
        let verdict = rules.judge(death.place, role.process, gave_up, covered, now);
        if verdict != Verdict::Restarts && !gave_up && self.replaces(role.process) {
            say_given_up(&death.name, &self.rules.policy);
        }
        verdict
    }

    /// Starts whoever is due.
    pub fn start_due(&mut self, group: &mut Group) {
        let now = self.begun.elapsed();
        while let Some(place) = self.rules.take_due(now) {
            if let Err(error) = group.respawn(place, None) {
                tracing::error!("{}", console::exit::words(&error));
                self.rules.put_off(place, now);
            }
        }
        group.end_unready();
    }

    /// Whether a process is about to be started, or on its way into the roster: the launcher looks more often then.
    pub fn is_busy(&self, group: &Group) -> bool {
        self.rules.is_any_due() || group.somebody_joins()
    }

    /// Forgets that the process of this place was given up.
    pub fn try_again(&mut self, place: usize) {
        self.rules.try_again(place, self.begun.elapsed());
    }

    /// Whether the process of this place is about to be started.
    pub fn is_due(&self, place: usize) -> bool {
        self.rules.is_due(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rules(restarts_max: u32) -> RestartRules {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let mut machine = Machine::load(&folder).expect("machine.toml");
        machine.restart.restarts_max = restarts_max;
        machine.restart.within_s = 10.0;
        RestartRules::new(&machine)
    }

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn who_dies_again_and_again_is_started_later_and_later_and_then_given_up() {
        let mut rules = rules(4);
        let planner: Process = Job::Planner.into();
        let mut now = ms(1000);
        let mut waits = Vec::new();
        loop {
            if rules.judge(2, planner, false, false, now) == Verdict::Ends {
                break;
            }
            assert!(rules.is_due(2) && !rules.is_due(1));
            let died = now;
            while rules.take_due(now).is_none() {
                now += ms(1);
            }
            waits.push((now - died).as_millis());
            now += ms(20);
        }
        assert_eq!(waits, [0, 10, 20, 40]);
        assert!(!rules.is_any_due());
        // What is long ago does not count.
        let later = now + ms(20_000);
        assert_eq!(
            rules.judge(2, planner, false, false, later),
            Verdict::Restarts
        );
    }

    /// The machine would wait for it for ever.
    #[test]
    fn a_servo_that_is_given_up_ends_the_run_unless_the_other_one_of_its_axis_goes_on() {
        let servo = Process::servo(0, 0);
        for (covered, verdict) in [(false, Verdict::Ends), (true, Verdict::GoesOn)] {
            let mut rules = rules(1);
            rules.policy.servo = machine::AfterLoss::Wait;
            let first = rules.judge(0, servo, false, covered, ms(0));
            assert_eq!(first, Verdict::Restarts);
            assert_eq!(rules.take_due(ms(0)), Some(0));
            assert_eq!(rules.judge(0, servo, false, covered, ms(9)), verdict);
        }
    }

    #[test]
    fn a_stop_that_somebody_takes_back_is_ordered_again() {
        let in_mode = |scan: u64, mode: Mode| Feedback {
            scan,
            mode: mode as u32,
            ..bytemuck::Zeroable::zeroed()
        };
        for (scan, mode, again) in [
            (10, Mode::Enabled, false),
            (11, Mode::Stopping, false),
            (40, Mode::Stopped, false),
            (40, Mode::Enabled, true),
            (40, Mode::Tripped, false),
        ] {
            let newest = in_mode(scan, mode);
            assert_eq!(goes_on_after_stop(10, &newest), again, "{scan} {mode:?}");
        }
    }

    #[test]
    fn who_gave_up_is_not_replaced_and_who_was_given_up_may_get_another_chance() {
        let mut rules = rules(1);
        let (master, recorder) = (Job::Master.into(), Job::Monitor.into());
        assert_eq!(rules.judge(0, master, true, false, ms(0)), Verdict::Ends);
        assert_eq!(
            rules.judge(1, recorder, false, false, ms(0)),
            Verdict::Restarts
        );
        assert_eq!(rules.take_due(ms(0)), Some(1));
        assert_eq!(
            rules.judge(1, recorder, false, false, ms(5)),
            Verdict::GoesOn
        );
        rules.try_again(1, ms(6));
        assert_eq!(rules.take_due(ms(6)), Some(1));
    }
}
