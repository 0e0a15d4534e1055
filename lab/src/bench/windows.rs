//! The windows of a program, one after the other.

use anyhow::Context;
use machine::Machine;
use path::profile::PathState;
use path::window::{Lead, PlannedSetpoint, WindowPlanner, WindowRequest};

/// Windows of a program from its start; every setpoint that one intends is executed.
pub(crate) struct Windows<'a> {
    planner: &'a mut WindowPlanner,
    window: Vec<PlannedSetpoint>,
    leads: Vec<Lead>,
    leads_max: usize,
    from: PathState,
    request: WindowRequest,
    /// The one planned last: setpoints that it intends, and whether it ends the program.
    made: Option<(usize, bool)>,
}

impl<'a> Windows<'a> {
    pub fn new(machine: &Machine, planner: &'a mut WindowPlanner) -> Windows<'a> {
        Windows {
            window: Vec::with_capacity(planner.setpoints_max()),
            leads: Vec::new(),
            leads_max: planner.limits().smoothing_scans() as usize + 1,
            from: planner.start_state(),
            request: WindowRequest {
                intended_setpoints: machine.scan.interpolation_period_scans,
                feed_override: 1.0,
                repeats_start: true,
                ..WindowRequest::default()
            },
            planner,
            made: None,
        }
    }

    /// Plans the next one, and does nothing else: for who times it.
    ///
    /// # Errors
    /// It cannot be planned.
    pub fn plan(&mut self) -> anyhow::Result<()> {
        let (from, leads) = (&self.from, &self.leads);
        let made = self
            .planner
            .plan_behind(from, leads, &self.request, &mut self.window)?;
        self.made = Some((made.intended_setpoints as usize, made.ends_program));
        Ok(())
    }

    /// Executes the one that was planned last; whether another follows.
    ///
    /// # Errors
    /// It intends no setpoint.
    pub fn go_on(&mut self) -> anyhow::Result<bool> {
        let Some((intended, ends_program)) = self.made else {
            return Ok(true);
        };
        self.request.repeats_start = false;
        let mut intended = self.window.iter().take(intended);
        self.leads
            .extend(intended.clone().map(|setpoint| setpoint.lead));
        self.from = intended.next_back().context("an empty window")?.state;
        let older = self.leads.len().saturating_sub(self.leads_max);
        self.leads.drain(..older);
        Ok(!ends_program)
    }
}
