//! The position commands of an axis around the present scan.

use bus::sample::{Feedback, PathTag};
use machine::WithinPeriod;

use crate::linear_interpolation::PeriodEnds;
use crate::settings::ServoSettings;
use crate::windows::Windows;

/// What the window in force commands, scan by scan; without a window, or of an axis that no program moves, the command position.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Setpoints<'a> {
    settings: &'a ServoSettings,
    windows: &'a Windows,
    feedback: &'a Feedback,
    command_position: i64,
    /// Position command at the end of the period before the present one; none before the first scan.
    period_start: Option<i64>,
}

impl<'a> Setpoints<'a> {
    /// In the scan of this feedback; `command_position` is where the master has the axis commanded to be.
    pub fn new(
        settings: &'a ServoSettings,
        windows: &'a Windows,
        feedback: &'a Feedback,
        command_position: i64,
    ) -> Setpoints<'a> {
        Setpoints {
            settings,
            windows,
            feedback,
            command_position,
            period_start: None,
        }
    }

    /// The same in a period before which this was commanded.
    pub fn after(self, period_start: i64) -> Setpoints<'a> {
        Setpoints {
            period_start: Some(period_start),
            ..self
        }
    }

    /// Whether there is a window.
    pub fn has_window(&self) -> bool {
        !self.windows.held.is_none()
    }

    /// Scans of this period before the present one.
    pub fn scan_in_period(&self) -> u32 {
        let period = u64::from(self.settings.scans_per_period.max(1));
        u32::try_from(self.feedback.scan % period).unwrap_or(0)
    }

    /// The position command `ahead` scans from this one.
    pub fn at(&self, ahead: i64) -> i64 {
        let path_axis = self.settings.path_axis.filter(|_| self.has_window());
        let Some(axis) = path_axis else {
            return self.command_position;
        };
        let setpoint = i64::from(self.feedback.setpoint) + ahead;
        match self.settings.within_period {
            WithinPeriod::Exact => self.windows.position(axis, setpoint),
            WithinPeriod::Linear => self.interpolated(axis, setpoint, ahead),
        }
    }

    /// Hash of the program that the window in force belongs to; 0 without one.
    pub fn program_hash(&self) -> u64 {
        self.windows.held.header.program_hash
    }

    /// Where on the path the setpoint `ahead` scans from this one is; none without a window.
    pub fn tag(&self, ahead: i64) -> Option<PathTag> {
        self.windows
            .held
            .tag_at(i64::from(self.feedback.setpoint).saturating_add(ahead))
    }

    /// By linear interpolation in the period: the windows stay exact, only what this servo makes of them is split.
    ///
    /// The period in which the window ends is not split: the machine counts as at rest from its last setpoint on.
    fn interpolated(&self, axis: usize, setpoint: i64, ahead: i64) -> i64 {
        let period = self.settings.scans_per_period;
        let scan = i64::try_from(self.feedback.scan).unwrap_or(i64::MAX);
        let scan_in_period = scan.saturating_add(ahead).rem_euclid(period.into());
        let before = setpoint - scan_in_period - 1;
        let last = before + i64::from(period);
        if self.windows.held.ends_by(last) {
            return self.windows.position(axis, setpoint);
        }
        // The window begins with this period: its predecessor's last setpoint is what was commanded.
        let from_predecessor = before < 0 && ahead >= 0;
        let ends = PeriodEnds {
            before: self
                .period_start
                .filter(|_| from_predecessor)
                .unwrap_or_else(|| self.windows.position(axis, before)),
            last: self.windows.position(axis, last),
        };
        ends.split(u32::try_from(scan_in_period).unwrap_or(0), period)
    }
}
