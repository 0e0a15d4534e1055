//! Processes that are lost or silent, and what the machine file has follow from it.

use bus::sample::{Job, Roster, STANDBY_ALARM_S};
use machine::{AfterLoss, AfterStandby, Machine, Restart};

use super::RunEnd;
use super::axes::Axes;

/// Losses of processes, and scans that the master itself has lost.
#[derive(Debug, Clone)]
pub(super) struct Losses {
    restart: Restart,
    /// Scans since the planner answered last, and the number after which it is lost; it is asked once a period.
    planner_silent_scans: u64,
    planner_patience_scans: u64,
    /// Scans without a standby that are an alarm.
    standby_alarm_scans: u32,
    overrun_scans: u32,
}

impl Losses {
    pub fn new(machine: &Machine, run_end: RunEnd) -> Losses {
        let period_scans = u64::from(machine.scan.interpolation_period_scans);
        Losses {
            restart: match run_end {
                RunEnd::AfterProgram => machine.restart,
                RunEnd::WhenOrdered => machine.restart.of_staying(),
            },
            planner_silent_scans: 0,
            planner_patience_scans: u64::from(machine.scan.watchdog_scans) + period_scans,
            standby_alarm_scans: (STANDBY_ALARM_S / machine.scan_period_s()) as u32,
            overrun_scans: 0,
        }
    }

    /// Goes on counting where a master before this one left.
    pub fn resume(&mut self, overrun_scans: u32) {
        self.overrun_scans = overrun_scans;
    }

    pub fn overrun_scans(&self) -> u32 {
        self.overrun_scans
    }

    /// Scans that were skipped because the master was late.
    pub fn overrun(&mut self, scans: u32) {
        self.overrun_scans = self.overrun_scans.saturating_add(scans);
    }

    /// Whether a run waits in the trip of a lost servo, for it to come back and for an order to go on.
    pub fn wait_for_servo(&self) -> bool {
        self.restart.servo != AfterLoss::End
    }

    /// Whether it goes on by itself once the servo is back.
    pub fn go_on_with_servo(&self) -> bool {
        self.restart.servo == AfterLoss::Resume
    }

    /// One scan of a planner that has answered, or not; whether the machine is to be in hold when one is back that was lost, or was
    /// silent for longer than the watchdog.
    pub fn hold_for_planner(&mut self, answered: bool, roster: &Roster) -> bool {
        self.planner_silent_scans = if answered {
            0
        } else {
            self.planner_silent_scans.saturating_add(1)
        };
        let planner = roster.find(Job::Planner, 0, 0);
        let lost = self.planner_silent_scans >= self.planner_patience_scans
            || planner.is_some_and(|planner| planner.live == 0);
        lost && self.restart.planner == AfterLoss::Wait
    }

    /// With `[restart] standby = "hold"`, whether an axis has been without its standby for longer than the alarm takes: once for each
    /// loss.
    pub fn hold_for_standby(&self, axes: &mut Axes) -> bool {
        let mut holds = false;
        if self.restart.standby == AfterStandby::Hold {
            for axis in axes.iter_mut() {
                holds |= axis.servos.hold_for_standby(self.standby_alarm_scans);
            }
        }
        holds
    }

    /// State that a later scan depends on: scans since the planner answered last, up to those that make it lost.
    pub fn inner(&self) -> u64 {
        self.planner_silent_scans.min(self.planner_patience_scans)
    }
}
