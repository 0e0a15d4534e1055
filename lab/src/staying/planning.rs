//! The planner of a cell that stays up, and the programs that are laid for it.

use std::sync::Arc;

use bus::sample::{Feedback, PlannerStatus, Setpoint, WindowHeader};
use planner::questions::{KeptAnswer, kept_in};
use planner::{Planner, PlannerPorts, ProgramText};

/// The planner process, and the programs that were laid for it: the first is number 1.
#[derive(Clone)]
pub struct Planning {
    /// The one that lives.
    pub planner: Planner,
    pub(super) ports: Ports,
    /// Windows that everybody sees in the next scan.
    windows: Vec<(WindowHeader, Vec<Setpoint>)>,
}

#[derive(Clone, Default)]
pub(super) struct Ports {
    pub programs: Vec<Arc<str>>,
    feedback: Option<Feedback>,
    windows: Vec<(WindowHeader, Vec<Setpoint>)>,
    status: Option<PlannerStatus>,
    /// Of which load and run answers are kept.
    answers_of: (u32, u32),
    answers: Vec<KeptAnswer>,
}

impl PlannerPorts for Ports {
    fn next_feedback(&mut self) -> Option<Feedback> {
        self.feedback.take()
    }

    fn program(&mut self, load: u32) -> Option<ProgramText> {
        let text = self.programs.get((load as usize).checked_sub(1)?)?;
        Some(ProgramText::Here("laid.ngc".into(), Arc::clone(text)))
    }

    fn answers(&mut self, load: u32, run: u32) -> Vec<KeptAnswer> {
        match self.answers_of == (load, run) {
            true => kept_in(bytemuck::cast_slice(&self.answers)),
            false => Vec::new(),
        }
    }

    fn keep_answer(&mut self, load: u32, run: u32, answer: &KeptAnswer) -> bool {
        if self.answers_of != (load, run) {
            self.answers.clear();
        }
        self.answers_of = (load, run);
        self.answers.truncate(answer.index as usize);
        self.answers.push(*answer);
        true
    }

    fn publish_window(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        self.windows.push((*header, setpoints.to_vec()));
    }

    fn publish_status(&mut self, status: &PlannerStatus) {
        self.status = Some(*status);
    }

    fn answered(&mut self, _scan: u64) {}
}

impl Planning {
    pub(super) fn new(planner: Planner) -> Planning {
        Planning {
            planner,
            ports: Ports::default(),
            windows: Vec::new(),
        }
    }

    /// What it says to a feedback that asks it.
    pub(super) fn asked(&mut self, feedback: &Feedback) -> Option<PlannerStatus> {
        let Planning { planner, ports, .. } = self;
        ports.feedback = Some(*feedback);
        planner::cycle(planner, ports);
        self.windows = std::mem::take(&mut ports.windows);
        ports.status.take()
    }

    /// Windows of the scan before.
    pub(super) fn take_windows(&mut self) -> Vec<(WindowHeader, Vec<Setpoint>)> {
        std::mem::take(&mut self.windows)
    }
}
