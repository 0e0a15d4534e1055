//! The launcher: one pass of `launcher::supervise`, written again over the model's places. It is the one part whose code is not the
//! product's, because that code is tied to processes and clocks.

use bus::sample::{Feedback, Job, Mode, Order};

use crate::bench::Mistake;
use crate::cell::{Cell, Frame, MasterInbox, Page, Who};
use crate::members::Life;

/// The stop that was ordered last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Asked {
    /// Incarnation of the master that it believed in.
    pub incarnation: u32,
    /// The scan in which one has answered.
    pub answered: Option<u64>,
}

/// What the launcher remembers.
#[derive(Debug, Clone, Copy, Default)]
pub struct Launcher {
    /// Ctrl-C was pressed.
    pub interrupted: bool,
    /// A process is lost for good without which the run cannot go on.
    pub ends: bool,
    /// The stop that was ordered.
    pub asked: Option<Asked>,
    /// The master has left in order.
    pub master_left: bool,
    /// Everything has ended.
    pub exited: bool,
    /// Scans since there was something to do.
    pub idle: u8,
}

impl Launcher {
    /// The order that ends the run: nothing takes it back.
    pub fn stop_order(&self, frame: &Frame) -> Order {
        if frame.makes(Mistake::StopTakenBack) {
            return Order::Stop;
        }
        Order::Down
    }

    /// The master has answered the launcher's stop.
    pub fn stop_answered(&mut self, scan: u64) {
        if let Some(asked) = &mut self.asked {
            asked.answered = Some(scan);
        }
    }
}

impl Cell {
    /// One pass: looks, reaps, starts and admits, orders a stop, ends.
    pub fn supervise(&mut self, frame: &Frame) {
        let is_over = self.is_over(frame);
        self.judge_deaths(frame, is_over);
        if !is_over {
            // Who is started now is admitted in a later pass, once it is ready.
            let joining: Vec<Who> = self.in_life(Life::Joins);
            for who in self.in_life(Life::Due) {
                self.start(frame, who);
            }
            for who in joining {
                self.admit(frame, who);
            }
        }
        self.stop_if_needed(frame);
        let master = self.master_place.life;
        if !master.lives() && master != Life::Due {
            self.launcher.exited = true;
        }
        self.launcher.idle = 0;
    }

    /// Whether a pass would change anything.
    pub fn has_work(&self, frame: &Frame) -> bool {
        let is_over = self.is_over(frame);
        let waits = |life| match life {
            Life::Dead => true,
            Life::Joins | Life::Due => !is_over,
            Life::TakesPart | Life::Gone => false,
        };
        let master = self.master_place.life;
        let ends = !master.lives() && !matches!(master, Life::Due | Life::Dead);
        let all = &mut self.everybody();
        all.any(|who| waits(self.place(who).life)) || ends || self.stop_is_due(frame)
    }

    fn is_over(&self, frame: &Frame) -> bool {
        let last = self.feedback.is_some_and(|feedback| feedback.last == 1);
        last && !frame.makes(Mistake::RestartedAfterTheEnd)
    }

    fn in_life(&self, life: Life) -> Vec<Who> {
        let all = self.everybody();
        all.filter(|who| self.place(*who).life == life).collect()
    }

    fn judge_deaths(&mut self, frame: &Frame, is_over: bool) {
        for who in self.in_life(Life::Dead) {
            let in_order = who == Who::Master && self.launcher.master_left;
            let replaced = !is_over && !in_order && self.replaces(frame, who);
            self.place_mut(who).life = if replaced { Life::Due } else { Life::Gone };
            if in_order {
                continue;
            }
            let participant = self.participant(who);
            participant.live = 0;
            self.roster.version += 1;
            if !replaced && !is_over && !matches!(who, Who::Servo(_)) {
                self.launcher.ends = true;
            }
        }
    }

    fn replaces(&self, frame: &Frame, who: Who) -> bool {
        let restart = &frame.machine.restart;
        match who {
            Who::Servo(index) => {
                let standby = frame.setting.standby[self.servos[index].axis];
                restart.replaces(Job::Servo, standby)
            }
            Who::Planner => restart.replaces(Job::Planner, false),
            Who::Master => restart.replaces(Job::Master, false),
        }
    }

    /// Another process in the place of one that is gone.
    fn start(&mut self, frame: &Frame, who: Who) {
        let incarnation = self.place(who).incarnation + 1;
        match who {
            Who::Servo(index) => {
                let place = &mut self.servos[index];
                place.servo = frame.new_servo(place.axis, place.role, incarnation);
                place.windows.clear();
                place.peer = None;
                place.last = None;
            }
            Who::Planner => {
                self.planner.planner = frame.new_planner(incarnation);
                self.planner.answered = None;
            }
            Who::Master => {
                let page: &Page = &self.page;
                self.master = Some(frame.new_master(page, incarnation));
                self.inbox = MasterInbox::default();
                if self.ghost.ended {
                    self.broken(crate::rules::Broken::Ended);
                }
            }
        }
        let place = self.place_mut(who);
        place.incarnation = incarnation;
        place.life = Life::Joins;
    }

    fn admit(&mut self, frame: &Frame, who: Who) {
        let incarnation = self.place(who).incarnation;
        self.place_mut(who).life = Life::TakesPart;
        let participant = self.participant(who);
        participant.live = 1;
        if !frame.makes(Mistake::AdmittedUnderOldIncarnation) {
            participant.incarnation = incarnation;
        }
        self.roster.version += 1;
    }

    /// Whether a stop is to be ordered, again where the one that was ordered finds no answer.
    fn stop_is_due(&self, frame: &Frame) -> bool {
        let wanted = self.launcher.interrupted || self.launcher.ends;
        let incarnation = self.incarnation_seen();
        let once = frame.makes(Mistake::StopOrderedOnce);
        let holds = self.launcher.asked.is_some_and(|asked| {
            let waits = self.inbox.stop || self.master.is_none();
            let obeyed = asked.answered.is_some() && !self.goes_on_after_stop(&asked);
            once || asked.incarnation == incarnation && (obeyed || waits)
        });
        wanted && !holds
    }

    /// Whether somebody has resumed the machine since it has answered a stop.
    pub fn goes_on_after_stop(&self, asked: &Asked) -> bool {
        let moves = |feedback: &Feedback| {
            let mode = Mode::from_wire(feedback.mode);
            matches!(mode, Some(Mode::Enabled | Mode::Jogging))
        };
        let newest = self.feedback.as_ref().filter(|feedback| moves(feedback));
        newest.is_some_and(|feedback| asked.answered.is_some_and(|at| feedback.scan > at))
    }

    fn incarnation_seen(&self) -> u32 {
        self.feedback.map_or(0, |feedback| feedback.incarnation)
    }

    /// Orders a stop until the master that lives has answered it.
    fn stop_if_needed(&mut self, frame: &Frame) {
        if self.stop_is_due(frame) {
            self.inbox.stop = self.master.is_some();
            self.launcher.asked = Some(Asked {
                incarnation: self.incarnation_seen(),
                answered: None,
            });
        }
    }
}
