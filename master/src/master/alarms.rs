//! Alarms of the machine: each comes by a signal or by the logic, stays until it is acknowledged, and may stop the machine.

use bus::sample::{Cause, HoldReason, Refused, has_bit, with_bit};
use machine::{Alarm, AlarmReaction, Machine};

use super::Master;
use super::orders::{Refusal, whole_number};
use crate::drives::Drives;

/// One of them.
#[derive(Debug, Clone)]
struct Watched {
    alarm: Alarm,
    signal: Option<usize>,
    after_scans: u64,
    /// Scans in a row that it has been due.
    due_scans: u64,
    is_there: bool,
}

/// All of them.
#[derive(Debug, Clone)]
pub(super) struct Alarms(Vec<Watched>);

impl Alarms {
    pub fn new(machine: &Machine) -> Alarms {
        let watched = machine.alarms.iter().map(|alarm| Watched {
            alarm: alarm.clone(),
            signal: alarm
                .signal
                .as_deref()
                .and_then(|name| machine.signal(name)),
            after_scans: libm::ceil(alarm.after_s / machine.scan_period_s()) as u64,
            due_scans: 0,
            is_there: false,
        });
        Alarms(watched.collect())
    }

    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// One scan; those that have come in it, a bit each. `raised` are those of the logic.
    pub fn step(&mut self, values: &[f64], raised: u64) -> u64 {
        let before = self.there();
        for (index, watched) in self.0.iter_mut().enumerate() {
            let by_signal = watched.signal.and_then(|signal| values.get(signal));
            let by_signal = by_signal.is_some_and(|value| watched.alarm.comes_by(*value));
            watched.due_scans = match by_signal || has_bit(raised, index) {
                true => watched.due_scans.saturating_add(1),
                false => 0,
            };
            watched.is_there = watched.due_scans > watched.after_scans;
        }
        self.there() & !before
    }

    /// Those that are there, a bit each.
    pub fn there(&self) -> u64 {
        let all = self.0.iter().enumerate();
        all.fold(0, |set, (index, watched)| {
            with_bit(set, index, watched.is_there)
        })
    }

    /// Whether one is there with one of these reactions.
    fn asks(&self, reactions: &[AlarmReaction]) -> bool {
        let asks = |watched: &Watched| reactions.contains(&watched.alarm.reaction);
        self.0
            .iter()
            .any(|watched| watched.is_there && asks(watched))
    }

    /// Whether a program may be started or resumed.
    pub fn allow_program(&self) -> Result<(), Refused> {
        use AlarmReaction::{Hold, NoStart, Trip};
        match self.asks(&[NoStart, Hold, Trip]) {
            true => Err(Refused::AlarmThere),
            false => Ok(()),
        }
    }

    /// Whether drives may be switched on.
    pub fn allow_drives(&self) -> Result<(), Refused> {
        match self.asks(&[AlarmReaction::Trip]) {
            true => Err(Refused::AlarmThere),
            false => Ok(()),
        }
    }

    /// The alarm of this number, as a bit; of 0, all.
    fn named(&self, number: u32) -> Option<u64> {
        if number == 0 {
            return Some(u64::MAX);
        }
        let mut all = self.0.iter();
        let index = all.position(|watched| watched.alarm.number == number)?;
        Some(with_bit(0, index, true))
    }
}

impl<D: Drives> Master<D> {
    /// What alarms stop.
    pub(super) fn heed_alarms(&mut self) {
        let alarms = &self.signals.alarms;
        let (trips, holds) = (
            alarms.asks(&[AlarmReaction::Trip]),
            alarms.asks(&[AlarmReaction::Hold]),
        );
        let driven = self.mode().is_driven();
        if trips && driven {
            self.trip(Cause::MachineAlarm, u32::MAX);
        }
        if holds && self.program.is_running() {
            self.modes.hold(HoldReason::Alarm);
        }
    }

    pub(super) fn order_acknowledge(&mut self, number: f64) -> Result<(), Refusal> {
        let number = whole_number(number)?;
        let named = self.signals.alarms.named(number);
        self.signals
            .acknowledge(named.ok_or(Refused::UnknownAlarm)?);
        if number == 0 {
            self.axes.iter_mut().for_each(|axis| axis.place.confirm());
        }
        Ok(())
    }
}
