//! A whole program planned in advance, by the windows that the planner would make.

use std::ops::ControlFlow;

use crate::setpoint_audit::{LimitShares, SetpointAudit, SetpointFault};
use path::path_part::PathPart;
use path::window::{Lead, PlanError, PlannedSetpoint, WindowPlanner, WindowRequest};

/// How a program is planned in advance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProgramWalk {
    /// Override to plan at; 1 is the programmed feed.
    pub feed_override: f64,
    /// Setpoints of intended motion in each window. All of them are executed; any number gives the same setpoints.
    pub setpoints_per_window: u32,
    /// So many setpoints are planned and judged one by one; the time of the rest is known without them.
    pub setpoints_max: u64,
}

/// What a program comes to.
#[derive(Debug, Clone, PartialEq)]
pub struct Totals {
    /// Elements of the path.
    pub elements: u64,
    /// Setpoints from the first at rest at the start to the first at rest at the end.
    pub setpoints: u64,
    /// Time of the program, in s.
    pub time_s: f64,
    /// Distance along the path, in mm.
    pub distance_mm: f64,
    /// Setpoints that were planned and judged one by one; the others follow from the speed map alone.
    pub judged_setpoints: u64,
    /// How much of the limits these use.
    pub shares: LimitShares,
    /// The first setpoint over a limit or off the path: none, or the planner is wrong.
    pub fault: Option<SetpointFault>,
    /// Whether the end was reached, not left by the caller's wish.
    pub complete: bool,
    /// The path speed that windows are limited to, if they are.
    pub speed_limited_by_window_mm_s: Option<f64>,
    /// The path speed that is held where elements are so short that more of them would have to be looked at, or read, if it is.
    pub speed_limited_by_look_ahead_mm_s: Option<f64>,
}

/// What a program is planned along: all of it, or as far as it is read.
pub trait Ahead {
    /// Why it cannot be planned, or read.
    type Error: From<PlanError>;

    /// The planner of its windows.
    fn windows(&mut self) -> &mut WindowPlanner;

    /// As much is known ahead of this element as is planned at a time. What lies behind it is needed no more.
    ///
    /// # Errors
    /// What comes next cannot be read, or planned.
    fn read_on(&mut self, element: u32) -> Result<(), Self::Error>;
}

impl Ahead for WindowPlanner {
    type Error = PlanError;

    fn windows(&mut self) -> &mut WindowPlanner {
        self
    }

    fn read_on(&mut self, _element: u32) -> Result<(), PlanError> {
        Ok(())
    }
}

impl ProgramWalk {
    /// Plans from the start of the path to its end, handing out each setpoint until the caller breaks off.
    ///
    /// # Errors
    /// The path cannot be planned, or not be read on.
    pub fn walk<A: Ahead>(
        &self,
        ahead: &mut A,
        mut each: impl FnMut(&PathPart, &PlannedSetpoint) -> ControlFlow<()>,
    ) -> Result<Totals, A::Error> {
        ahead.read_on(0)?;
        let planner = ahead.windows();
        let mut window = Vec::with_capacity(planner.setpoints_max());
        let mut from = planner.start_state();
        let mut leads: Vec<Lead> = Vec::new();
        let leads_max = planner.limits().smoothing_scans() as usize + 1;
        let mut request = WindowRequest {
            intended_setpoints: self.setpoints_per_window.max(1),
            feed_override: self.feed_override,
            repeats_start: true,
            ..WindowRequest::default()
        };
        let mut audit: Option<SetpointAudit> = None;
        let (mut setpoints, mut fault, mut complete) = (0u64, None, false);
        // At no speed there is no end to come to.
        'windows: while self.feed_override > 0.0 && !complete && setpoints < self.setpoints_max {
            ahead.read_on(from.element)?;
            let planner = ahead.windows();
            let outcome = planner.plan_behind(&from, &leads, &request, &mut window)?;
            request.repeats_start = false;
            for setpoint in window.iter().take(outcome.intended_setpoints as usize) {
                let audit = audit.get_or_insert_with(|| {
                    SetpointAudit::at_rest(planner.limits().clone(), setpoint.position_increments)
                });
                let state = &setpoint.state;
                let judged = audit
                    .setpoint(&setpoint.position_increments)
                    .and_then(|()| audit.place(planner.path(), state.element, state.distance_mm));
                fault = fault.or(judged.err());
                setpoints += 1;
                from = *state;
                leads.push(setpoint.lead);
                if each(planner.path(), setpoint).is_break() {
                    break 'windows;
                }
            }
            complete = outcome.ends_program;
            leads.drain(..leads.len().saturating_sub(leads_max));
        }
        if let (true, Some(audit)) = (complete, &mut audit) {
            fault = fault.or(audit.end().err());
        }
        let planner = ahead.windows();
        let judged_setpoints = setpoints;
        if !complete && setpoints >= self.setpoints_max {
            let lead = leads.last().map_or(from, |lead| lead.state);
            let rest_s = planner.time_to_end_s(&lead, self.feed_override)?;
            setpoints += libm::ceil(rest_s / planner.limits().scan_period_s()) as u64;
            (from, complete) = (planner.end_state(), true);
        }
        Ok(Totals {
            elements: u64::from(planner.path().end()),
            setpoints,
            judged_setpoints,
            time_s: setpoints.saturating_sub(1) as f64 * planner.limits().scan_period_s(),
            distance_mm: planner.path().length_before_mm(from.element) + from.distance_mm,
            shares: audit.map_or_else(LimitShares::default, |audit| *audit.shares()),
            fault,
            complete,
            speed_limited_by_window_mm_s: planner.speed_map().speed_limited_by_window_mm_s(),
            speed_limited_by_look_ahead_mm_s: planner.speed_limited_by_look_ahead_mm_s(),
        })
    }
}
