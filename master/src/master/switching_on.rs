//! Drives that are being switched on: over many scans, with a limit.

use bus::sample::Cause;

use super::axes::Axes;
use super::axis_unit::AxisUnit;
use super::gantry::Gantries;
use super::homing::HOLD_SCANS;

/// Longest wait for drives that are being switched on, in s.
const PATIENCE_S: f64 = 5.0;
/// Time without motion and pull after which the bridge between two motors is relaxed, in s.
const RELAX_S: f64 = 0.3;

/// Drives that are being switched on, where they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct SwitchingOn(Option<UnderWay>);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct UnderWay {
    /// Scans that they may still take.
    scans: u64,
    /// The machine is in hold once they are on.
    hold: bool,
    /// The master has started with it: it was not ordered.
    at_start: bool,
    /// A bit for each axis whose drive had a fault when it was ordered: it is reset on the way.
    forgiven: u32,
    /// A drive was lost when it was ordered: the bus is started again on the way, and all are lost for a while.
    awaits_lost: bool,
    /// Motors of gantries that are not homed are let go first: their bridges relax, and both motors count from one place then.
    relaxes: bool,
    /// Scans in a row in which these motors have neither moved nor pulled.
    slack_scans: u64,
}

/// What a scan of switching on has come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SwitchedOn {
    /// Nothing yet, or nothing is being switched on.
    NotYet,
    /// All drives follow.
    Done { hold: bool },
    /// This axis's drive stays off; at the start of a master there is nobody who could ask again.
    Failed {
        cause: Cause,
        axis: usize,
        at_start: bool,
    },
}

impl SwitchingOn {
    /// Begins, for a hold afterwards or none.
    pub fn begin(&mut self, axes: &Axes, gantries: &Gantries, scan_s: f64, hold: bool) {
        self.0 = Some(UnderWay {
            scans: scans_of(PATIENCE_S, scan_s),
            hold,
            at_start: false,
            forgiven: axes.faulted_drives(),
            awaits_lost: axes.has_lost_drive(),
            relaxes: gantries.must_align(axes),
            slack_scans: 0,
        });
    }

    /// The same for drives that are off when a master starts, without a fault.
    pub fn begin_at_start(&mut self, axes: &Axes, gantries: &Gantries, scan_s: f64, hold: bool) {
        self.begin(axes, gantries, scan_s, hold);
        if let Some(on) = &mut self.0 {
            on.at_start = true;
        }
    }

    pub fn cancel(&mut self) {
        self.0 = None;
    }

    pub fn is_under_way(&self) -> bool {
        self.0.is_some()
    }

    /// Whether motors of gantries are let go first.
    pub fn relaxes(&self) -> bool {
        self.0.is_some_and(|on| on.relaxes)
    }

    /// One scan: done when all drives follow, failed when one does not in time.
    pub fn step(&mut self, axes: &mut Axes, gantries: &Gantries, scan_s: f64) -> SwitchedOn {
        let Some(on) = &mut self.0 else {
            return SwitchedOn::NotYet;
        };
        on.scans = on.scans.saturating_sub(1);
        on.forgiven &= axes.faulted_drives();
        let failed = if on.relaxes && !axes.has_lost_drive() {
            on.relax(axes, gantries, scan_s)
        } else if let Some(failed) = on.failed(axes) {
            Some(failed)
        } else if axes.drives_follow() {
            let hold = on.hold;
            self.cancel();
            return SwitchedOn::Done { hold };
        } else {
            None
        };
        let Some((cause, axis)) = failed else {
            return SwitchedOn::NotYet;
        };
        let at_start = on.at_start;
        self.cancel();
        SwitchedOn::Failed {
            cause,
            axis,
            at_start,
        }
    }

    /// State that a later scan depends on: scans left, whether in hold, whether at the start.
    pub fn inner(&self) -> Option<(u64, bool, bool)> {
        self.0.map(|on| (on.scans, on.hold, on.at_start))
    }
}

impl UnderWay {
    /// The first drive that cannot be waited for, or not any longer.
    fn failed(&self, axes: &Axes) -> Option<(Cause, usize)> {
        let waits = |index: usize, cause: Cause| match cause {
            Cause::None => true,
            Cause::DriveOff => self.scans > 0,
            Cause::DriveFault => self.forgiven >> index & 1 == 1 && self.scans > 0,
            Cause::DriveLost => self.awaits_lost && self.scans > 0,
            _ => false,
        };
        let mut causes = axes.iter().map(AxisUnit::drive_cause).enumerate();
        let failed = causes.find(|(index, cause)| !waits(*index, *cause));
        failed.map(|(index, cause)| (cause, index))
    }

    /// One scan of bridges that relax while their motors are let go. Everybody has seen the new positions before a loop is closed.
    fn relax(
        &mut self,
        axes: &mut Axes,
        gantries: &Gantries,
        scan_s: f64,
    ) -> Option<(Cause, usize)> {
        let not_slack = gantries.not_slack(axes);
        let relaxed = scans_of(RELAX_S, scan_s);
        self.slack_scans = match not_slack {
            None => self.slack_scans.saturating_add(1),
            Some(_) => 0,
        };
        if self.slack_scans > relaxed + HOLD_SCANS {
            self.relaxes = false;
        } else if self.slack_scans == relaxed {
            gantries.align(axes);
        } else if let Some(index) = not_slack.filter(|_| self.scans == 0) {
            return Some((Cause::DriveOff, index));
        }
        None
    }
}

fn scans_of(time_s: f64, scan_s: f64) -> u64 {
    libm::ceil(time_s / scan_s) as u64
}
