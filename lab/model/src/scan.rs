//! One scan of the cell: the master's own `cycle` over ports that reach the other processes at once.

use std::convert::Infallible;
use std::sync::Arc;

use bus::sample::{
    AxisCommand, Feedback, Instruments, Job, Mode, OperatorRequest, OperatorResponse, Order,
    Roster, Setpoint, WindowHeader,
};
use master::cycle::cycle;
use master::saved::{Latches, SavedState};
use master::{Answered, Answers, Drives, Flow, MasterPorts};

use crate::bench::Mistake;
use crate::cell::{Cell, Frame, MasterInbox};
use crate::members::{Life, PlannerScan, ServoScan};
use crate::rules::Broken;

/// Where in its scan a master is killed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// Before it publishes the feedback.
    BeforeFeedback,
    /// After that: the others answer, nothing is saved.
    AfterFeedback,
    /// After it has saved its state.
    AfterSaving,
    /// After it has judged and answered the orders.
    AfterOrders,
}

/// What happens in a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// Nothing.
    Good,
    /// This servo does not see the feedback.
    FeedbackLost(usize),
    /// This servo's command comes too late.
    CommandLate(usize),
    /// This servo does not see a window.
    WindowLost(usize),
    /// The master does not see a window.
    WindowLostToMaster,
    /// The planner does not see the feedback.
    PlannerLate,
    /// The master is killed.
    MasterKilled(Moment),
}

/// The ports of a master for one scan.
struct Scan<'a> {
    cell: &'a mut Cell,
    frame: &'a Frame,
    fate: Fate,
    answers: Answers,
    /// The commands of the scan, by axis and role.
    commands: [Option<AxisCommand>; 4],
    before: Option<Feedback>,
}

impl Cell {
    /// One scan.
    pub fn scan(&mut self, frame: &Frame, fate: Fate) {
        let Some(mut master) = self.master.take() else {
            return;
        };
        let before = self.feedback;
        let known = [master.feedback().window, master.inner().pending];
        let mut scan = Scan {
            cell: self,
            frame,
            fate,
            answers: Answers::of_axes(2),
            commands: [None; 4],
            before,
        };
        let Ok(flow) = cycle(Arc::make_mut(&mut master), &mut scan);
        let commands = scan.commands;
        if flow == Flow::GoOn {
            if let Some(feedback) = self.feedback {
                let (next, inner) = (master.feedback(), master.inner());
                let followed = [0, 1].map(|axis: usize| inner.axes[axis].followed);
                self.judge_windows(known, [next.window, inner.pending]);
                self.judge_taken(&feedback, &next, followed, &commands);
            }
            self.master = Some(master);
        } else if master.is_last() && !matches!(fate, Fate::MasterKilled(_)) {
            self.inbox = MasterInbox::default();
            self.launcher.master_left = true;
            self.master_place.life = Life::Dead;
        } else {
            self.inbox = MasterInbox::default();
            self.master_place.life = Life::Dead;
        }
        self.forget_windows();
    }
}

impl Scan<'_> {
    /// Every servo that lives answers.
    fn ask_servos(&mut self, feedback: &Feedback) {
        let mut sent = Vec::new();
        for (index, place) in self.cell.servos.iter_mut().enumerate() {
            if !place.place.life.lives() {
                continue;
            }
            let mut seen = *feedback;
            if self.fate == Fate::FeedbackLost(index) {
                let Some(before) = self
                    .before
                    .filter(|_| self.frame.makes(Mistake::StaleFeedbackObeyed))
                else {
                    continue;
                };
                seen.window = before.window;
                seen.setpoint = before.setpoint;
            }
            let mut ports = ServoScan {
                feedback: Some(seen),
                windows: &mut place.windows,
                peer: &mut place.peer,
                command: None,
            };
            servo::cycle(Arc::make_mut(&mut place.servo), &mut ports);
            let Some(command) = ports.command else {
                continue;
            };
            place.last = Some(command);
            sent.push((index, command));
        }
        for (index, command) in sent {
            let (axis, role) = (command.axis as usize, command.role as usize);
            if self.fate != Fate::CommandLate(index) {
                self.answers.commands[axis][role] = Some(command);
                self.commands[axis * 2 + role] = Some(command);
            }
            for other in &mut self.cell.servos {
                if other.axis == axis && other.role != role && other.place.life.lives() {
                    other.peer = Some(command);
                }
            }
        }
        if self.frame.makes(Mistake::WindowWithoutEveryAxis)
            && let [[x, _], [y, _], ..] = self.answers.commands.as_mut_slice()
            && let (Some(x), Some(y)) = (x, y)
        {
            y.pending = x.pending;
        }
    }

    fn ask_planner(&mut self, feedback: &Feedback) {
        let place = &mut self.cell.planner;
        let asked = place.place.life.lives() && self.fate != Fate::PlannerLate;
        if !asked || !place.asks(feedback.scan) {
            return;
        }
        let mut ports = PlannerScan {
            feedback: Some(*feedback),
            ..PlannerScan::default()
        };
        planner::cycle(Arc::make_mut(&mut place.planner), &mut ports);
        self.answers.planner = ports.status;
        let Some(window) = ports.window else {
            return;
        };
        self.cell.windows.push(Arc::clone(&window));
        for (index, servo) in self.cell.servos.iter_mut().enumerate() {
            if servo.place.life.lives() && self.fate != Fate::WindowLost(index) {
                servo.windows.push(Arc::clone(&window));
            }
        }
        if self.fate != Fate::WindowLostToMaster {
            self.cell.inbox.windows.push(window);
        }
    }
}

impl MasterPorts for Scan<'_> {
    type Error = Infallible;

    fn roster(&self) -> &Roster {
        &self.cell.roster
    }

    fn read_roster(&mut self) {}

    fn begin_scan(&mut self, feedback: &Feedback, _ask_planner: bool) -> Flow {
        if self.fate == Fate::MasterKilled(Moment::BeforeFeedback) {
            return Flow::Leave;
        }
        self.cell.judge_feedback(feedback);
        self.cell.ghost.went_on = false;
        self.cell.feedback = Some(*feedback);
        self.cell.page.published = Some(feedback.scan);
        self.ask_servos(feedback);
        self.ask_planner(feedback);
        if self.fate == Fate::MasterKilled(Moment::AfterFeedback) {
            return Flow::Leave;
        }
        Flow::GoOn
    }

    fn publish_instruments(&mut self, _instruments: &Instruments) {}

    fn save(&mut self, latches: &Latches, drives: &impl Drives) {
        let mut saved = SavedState::of(drives);
        saved.save(latches, drives);
        self.cell.page.saved = Some(Arc::new(saved));
    }

    fn latch(&mut self, _latches: &Latches) {}

    fn await_answers(&mut self, _scan: u64, _ask: bool) -> Result<Answered, Infallible> {
        if self.fate == Fate::MasterKilled(Moment::AfterSaving) {
            return Ok(Answered::Leave);
        }
        Ok(Answered::Scan { overrun_scans: 0 })
    }

    fn answers(&self) -> &Answers {
        &self.answers
    }

    fn serve_orders(
        &mut self,
        scan: u64,
        mut judge: impl FnMut(&OperatorRequest) -> (OperatorResponse, Latches),
    ) {
        let cell = &mut *self.cell;
        let saved = &mut cell.page.saved;
        let mut accepted = |order: Order| {
            let (answer, latches) = judge(&OperatorRequest::of(order));
            let keeps = answer.accepted == 1 && !self.frame.makes(Mistake::AnsweredBeforeSaved);
            if let Some(saved) = saved.as_mut().filter(|_| keeps) {
                Arc::make_mut(saved).latch(&latches);
            }
            answer.accepted == 1
        };
        if cell.page.stop {
            cell.ghost.stopped |= accepted(Order::Stop);
            cell.page.stop = false;
        }
        if cell.inbox.stop {
            cell.ghost.stopped |= accepted(cell.launcher.stop_order(self.frame));
            cell.inbox.stop = false;
            cell.launcher.stop_answered(scan);
        }
        if let Some(order) = cell.inbox.go_on.take()
            && accepted(order)
        {
            if (cell.launcher.asked).is_some_and(|asked| asked.answered.is_some()) {
                // The launcher has been told that the run ends.
                cell.ghost.broken.get_or_insert(Broken::Stop);
            }
            cell.ghost.stopped = false;
            cell.ghost.went_on = true;
        }
    }

    fn launcher_lives(&mut self, _scan: u64) -> Option<bool> {
        (self.fate != Fate::MasterKilled(Moment::AfterOrders)).then_some(true)
    }

    fn for_each_window(
        &mut self,
        scan: u64,
        mut offer: impl FnMut(&WindowHeader, &[Setpoint], &Roster),
    ) {
        let mut roster = self.cell.roster;
        let windows = std::mem::take(&mut self.cell.inbox.windows);
        for window in windows {
            if window.header.visible_from > scan {
                self.cell.inbox.windows.push(window);
                continue;
            }
            if self.frame.makes(Mistake::WindowOfAnyPlanner) {
                let planner = roster.participants.iter_mut();
                for place in planner.filter(|place| place.job == Job::Planner as u32) {
                    place.live = 1;
                    place.incarnation = window.header.id.incarnation;
                }
            }
            offer(&window.header, &window.setpoints, &roster);
        }
    }

    fn finish(&mut self, _scan: u64) {}

    fn leave(&mut self) {}
}

/// What an operator orders to bring a machine on that waits, by what its feedback shows.
pub fn go_on_order(feedback: &Feedback) -> Option<Order> {
    match Mode::from_wire(feedback.mode)? {
        Mode::Disabled => Some(Order::Enable),
        Mode::Tripped | Mode::Stopped => Some(Order::Resume),
        Mode::Enabled if feedback.hold == 1 => Some(Order::Resume),
        _ => None,
    }
}
