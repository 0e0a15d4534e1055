//! Alarms of the machine: each comes by a signal or by the logic, stays until it is acknowledged, and may stop the machine.

use bus::sample::{Cause, Mode, Refused};
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
}

/// All of them.
#[derive(Debug, Clone)]
pub(super) struct Alarms {
    watched: Vec<Watched>,
    /// Those that are there, a bit each.
    there: u64,
}

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
        });
        Alarms {
            watched: watched.collect(),
            there: 0,
        }
    }

    pub fn count(&self) -> usize {
        self.watched.len()
    }

    /// One scan; those that have come in it, a bit each. `raised` are those of the logic.
    pub fn step(&mut self, values: &[f64], raised: u64) -> u64 {
        let before = self.there;
        for (index, watched) in self.watched.iter_mut().enumerate() {
            let by_signal = watched.signal.and_then(|signal| values.get(signal));
            let by_signal = by_signal.is_some_and(|value| watched.alarm.comes_by(*value));
            let is_due = by_signal || raised.checked_shr(index as u32).unwrap_or(0) & 1 == 1;
            watched.due_scans = if is_due {
                watched.due_scans.saturating_add(1)
            } else {
                0
            };
            let is_there = watched.due_scans > watched.after_scans;
            let bit = 1u64.checked_shl(index as u32).unwrap_or(0);
            self.there = if is_there {
                self.there | bit
            } else {
                self.there & !bit
            };
        }
        self.there & !before
    }

    pub fn there(&self) -> u64 {
        self.there
    }

    /// Whether one is there with a reaction at least as hard as this.
    fn asks(&self, reactions: &[AlarmReaction]) -> bool {
        let mut watched = self.watched.iter().enumerate();
        watched.any(|(index, watched)| {
            let is_there = self.there.checked_shr(index as u32).unwrap_or(0) & 1 == 1;
            is_there && reactions.contains(&watched.alarm.reaction)
        })
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
        let index = self
            .watched
            .iter()
            .position(|watched| watched.alarm.number == number);
        index.and_then(|index| 1u64.checked_shl(index as u32))
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
        let driven = !matches!(self.mode(), Mode::Disabled | Mode::Tripped);
        if trips && driven {
            self.trip(Cause::MachineAlarm, u32::MAX);
        }
        if holds && self.program.is_running() {
            self.modes.hold();
        }
    }

    pub(super) fn order_acknowledge(&mut self, number: f64) -> Result<(), Refusal> {
        let number = whole_number(number)?;
        let named = self.signals.alarms.named(number);
        self.signals
            .acknowledge(named.ok_or(Refused::UnknownAlarm)?);
        Ok(())
    }
}
