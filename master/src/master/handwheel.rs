//! A handwheel that is wired: its count and the switches beside it become the orders of a [wheel](super::wheel).

use bus::sample::{OperatorRequest, Order};
use machine::{Handwheel, Machine};

/// Sessions of it: a new one each time that an axis or a step is chosen, so that what was counted before moves nothing. The commands of
/// operators draw theirs from all numbers.
const SESSION_FIRST: u32 = u32::MAX - 0xffff;
const SESSIONS: u32 = 0xffff;

/// A handwheel by the indices of its signals.
#[derive(Debug, Clone)]
pub(super) struct PlannedWheel {
    counts: usize,
    counts_per_click: f64,
    /// Switch and axis.
    axes: Vec<(usize, u32)>,
    step_mm: f64,
    /// Switches, with what they multiply the step by.
    times: [(Option<usize>, f64); 2],
    enable: Option<usize>,
    velocity_mode: u32,
}

/// What it tells the master.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turned {
    axis: u32,
    step_mm: f64,
    clicks: i32,
}

impl PlannedWheel {
    /// None where a signal is missing, which the rules of the machine file refuse.
    pub fn of(machine: &Machine, wheel: &Handwheel) -> Option<PlannedWheel> {
        let index = |name: &Option<String>| machine.signal(name.as_deref()?);
        let axes = wheel.axes.iter().filter_map(|(axis, switch)| {
            Some((machine.signal(switch)?, machine.axis_index(axis).ok()?))
        });
        Some(PlannedWheel {
            counts: machine.signal(&wheel.counts)?,
            counts_per_click: f64::from(wheel.counts_per_click),
            axes: axes.collect(),
            step_mm: wheel.step_mm,
            times: [
                (index(&wheel.times_10), 10.0),
                (index(&wheel.times_100), 100.0),
            ],
            enable: index(&wheel.enable),
            velocity_mode: wheel.rests_with_wheel.into(),
        })
    }

    /// What it says with these values of signals, none where one is lost; none while it moves nothing.
    pub fn turned(&self, value: impl Fn(usize) -> Option<f64>) -> Option<Turned> {
        let is_on = |switch: usize| value(switch) == Some(1.0);
        let counts = value(self.counts)?;
        if !self.enable.is_none_or(is_on) {
            return None;
        }
        let mut chosen = self.axes.iter().filter(|(switch, _)| is_on(*switch));
        let (_, axis) = chosen.next().filter(|_| chosen.next().is_none())?;
        let times = self
            .times
            .iter()
            .filter(|(switch, _)| switch.is_some_and(is_on));
        Some(Turned {
            axis: *axis,
            step_mm: times.fold(self.step_mm, |step, (_, times)| step * times),
            // It goes on behind the largest number with the smallest.
            clicks: libm::floor(counts / self.counts_per_click) as i64 as i32,
        })
    }

    /// The order of what has been turned since it was told last; none without.
    pub fn order(&self, turned: Turned, told: &mut Told) -> Option<OperatorRequest> {
        let before = told.last.replace(turned);
        if before == Some(turned) {
            return None;
        }
        let same = |before: Turned| (before.axis, before.step_mm) == (turned.axis, turned.step_mm);
        if !before.is_some_and(same) {
            told.choices = (told.choices + 1) % SESSIONS;
        }
        Some(OperatorRequest {
            axis: turned.axis,
            value: turned.step_mm,
            session: SESSION_FIRST + told.choices,
            count: turned.clicks,
            velocity_mode: self.velocity_mode,
            ..OperatorRequest::of(Order::Wheel)
        })
    }
}

/// What it has told.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Told {
    /// None while it moves nothing.
    pub last: Option<Turned>,
    /// Axes and steps that were chosen.
    choices: u32,
}
