//! The windows a servo holds, and what it refuses.
use bus::sample::{Feedback, MAX_WINDOW_SETPOINTS, PathTag, Setpoint, WindowHeader, WindowId};
use bytemuck::Zeroable;
use loops::braking;
use path::travel::Travel;

use crate::settings::ServoSettings;

/// A window begins at most so many interpolation periods ahead: a farther one would keep all that follow it waiting.
const AHEAD_PERIODS: u32 = 8;

/// Why a window is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Its setpoints do not hash to what its name says.
    #[error("its checksum does not match its setpoints")]
    Checksum,
    /// Setpoint counts outside their bounds or not those of the setpoints.
    #[error(
        "its setpoint counts do not fit its setpoints (2 to {MAX_WINDOW_SETPOINTS}, intended at most all)"
    )]
    RowCount,
    /// It has no name.
    #[error("it has no sequence or incarnation")]
    Unnamed,
    /// Its first scan is not in the future.
    #[error("its first scan is not in the future")]
    TooLate,
    /// Its first scan is further in the future than a planner plans.
    #[error("its first scan is too far in the future")]
    TooFar,
    /// A flag that is neither 0 nor 1.
    #[error("a flag of it is neither 0 nor 1")]
    Flag,
    /// It is of another program than the window being executed, or the path that was left.
    #[error("it is of another program")]
    Program,
    /// Its first scan is not the start of an interpolation period.
    #[error("its first scan is not at a boundary of the interpolation period")]
    OffBoundary,
    /// Another window is pending.
    #[error("another window is pending")]
    OnePending,
    /// Its predecessor is not the window being executed, or not held here.
    #[error("its predecessor is not the window being executed")]
    Predecessor,
    /// It has no predecessor and belongs to another epoch.
    #[error("it belongs to another epoch")]
    Epoch,
    /// It has no predecessor and does not start where the axis is commanded to be.
    #[error("it does not start at the command position")]
    Register,
    /// A setpoint outside the travel.
    #[error("a setpoint is outside the travel")]
    Travel,
    /// Setpoints, or the step to its first setpoint, faster than the axis may be.
    #[error("a setpoint is faster than the axis may be")]
    Speed,
    /// Setpoints, or the way to its first setpoints, with more acceleration than the axis may have.
    #[error("a setpoint asks for more acceleration than the axis may have")]
    Acceleration,
    /// It does not end at rest.
    #[error("it does not end at rest")]
    NotAtRest,
    /// A setpoint whose place on the path is none.
    #[error("a setpoint's distance along the path is no number, or below 0")]
    Tag,
}

/// One window in a buffer that is allocated once.
#[derive(Debug, Clone)]
pub(crate) struct HeldWindow {
    pub(crate) header: WindowHeader,
    setpoints: Vec<Setpoint>,
}

impl HeldWindow {
    pub(crate) fn none() -> HeldWindow {
        HeldWindow {
            header: WindowHeader::zeroed(),
            setpoints: Vec::with_capacity(MAX_WINDOW_SETPOINTS),
        }
    }

    pub(crate) fn id(&self) -> WindowId {
        self.header.id
    }

    pub(crate) fn is_none(&self) -> bool {
        self.header.id.is_none()
    }

    /// The caller has checked that the setpoints fit.
    pub(crate) fn set(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        self.header = *header;
        self.setpoints.clear();
        self.setpoints
            .extend_from_slice(setpoints.get(..MAX_WINDOW_SETPOINTS).unwrap_or(setpoints));
    }

    /// What is left of a window whose last setpoint is reached: it stands. So a servo that came late knows all of it.
    pub(crate) fn stand(&mut self, feedback: &Feedback) {
        let setpoint_count = feedback
            .setpoint
            .saturating_add(1)
            .min(MAX_WINDOW_SETPOINTS as u32);
        self.header = WindowHeader {
            id: feedback.window,
            first_scan: feedback.scan.saturating_sub(feedback.setpoint.into()),
            program_hash: feedback.program_hash,
            intended_setpoints: setpoint_count,
            setpoint_count,
            ..WindowHeader::zeroed()
        };
        let setpoint = Setpoint {
            position: feedback.path_positions(),
            tag: feedback.tag,
        };
        self.setpoints.clear();
        self.setpoints.resize(setpoint_count as usize, setpoint);
    }

    pub(crate) fn clear(&mut self) {
        self.header = WindowHeader::zeroed();
        self.setpoints.clear();
    }

    pub(crate) fn has_setpoint(&self, setpoint: u32) -> bool {
        (setpoint as usize) < self.setpoints.len()
    }

    /// A setpoint; before the first that one, beyond the last that one: the window ends at rest.
    fn setpoint(&self, setpoint: i64) -> Option<&Setpoint> {
        let last = self.setpoints.len().saturating_sub(1);
        self.setpoints
            .get(usize::try_from(setpoint).unwrap_or(0).min(last))
    }

    pub(crate) fn position(&self, axis: usize, setpoint: i64) -> i64 {
        self.setpoint(setpoint)
            .and_then(|r| r.position.get(axis))
            .copied()
            .unwrap_or(0)
    }

    /// Whether the window comes to its end in this setpoint or had before: it stands there from then on.
    pub(crate) fn ends_by(&self, setpoint: i64) -> bool {
        setpoint >= i64::from(self.header.setpoint_count) - 1
    }

    pub(crate) fn tag(&self, setpoint: u32) -> PathTag {
        self.setpoint(setpoint.into())
            .map_or_else(PathTag::default, |r| r.tag)
    }

    /// Place on the path of a setpoint; none without a window.
    pub(crate) fn tag_at(&self, setpoint: i64) -> Option<PathTag> {
        self.setpoint(setpoint).map(|setpoint| setpoint.tag)
    }

    /// Deceleration that brings this axis to rest together with all others, in mm/s²; speeds are those commanded from this
    /// setpoint to the next.
    pub(crate) fn stop_deceleration_mm_s2(&self, settings: &ServoSettings, setpoint: u32) -> f64 {
        let (Some(here), Some(next), Some(own)) = (
            self.setpoint(setpoint.into()),
            self.setpoint(i64::from(setpoint) + 1),
            settings.path_axis,
        ) else {
            return settings.quick_stop_mm_s2;
        };
        let steps = here.position.iter().zip(&next.position);
        let scales = settings
            .path_increments_mm
            .iter()
            .zip(&settings.path_quick_stops_mm_s2);
        let axes =
            steps
                .zip(scales)
                .take(settings.path_axes)
                .map(|((from, to), (increment, most))| {
                    let step = to.saturating_sub(*from).saturating_abs() as f64;
                    (step * increment / settings.scan_s, *most)
                });
        braking::deceleration_mm_s2(axes, own)
    }
}

/// Checks of the window itself: name, size, checksum, travel, limits within, end at rest.
pub(crate) fn check_itself(
    settings: &ServoSettings,
    header: &WindowHeader,
    setpoints: &[Setpoint],
    feedback: &Feedback,
) -> Result<(), Refusal> {
    if header.id.sequence == 0 || header.id.incarnation == 0 {
        return Err(Refusal::Unnamed);
    }
    let count = header.setpoint_count as usize;
    if !(2..=MAX_WINDOW_SETPOINTS).contains(&count)
        || count != setpoints.len()
        || header.intended_setpoints > header.setpoint_count
    {
        return Err(Refusal::RowCount);
    }
    if !header
        .first_scan
        .is_multiple_of(settings.scans_per_period.max(1).into())
    {
        return Err(Refusal::OffBoundary);
    }
    if header.ends_program > 1 {
        return Err(Refusal::Flag);
    }
    if bus::window::checksum(header, setpoints) != header.id.checksum {
        return Err(Refusal::Checksum);
    }
    // A planner would go on from such a place, should this window be left there.
    let placed = |setpoint: &Setpoint| {
        setpoint.tag.distance_mm.is_finite() && setpoint.tag.distance_mm >= 0.0
    };
    if !setpoints.iter().all(placed) {
        return Err(Refusal::Tag);
    }
    let Some(axis) = settings.path_axis else {
        return Ok(());
    };
    let first = position(axis, setpoints.first());
    let mut limits = RowLimits {
        settings,
        reach: settings.reach(feedback),
        before: first,
        step: position(axis, setpoints.get(1)).saturating_sub(first),
    };
    // The first setpoint and the step to it are judged against the predecessor, at the seam.
    for setpoint in setpoints.iter().skip(1) {
        limits.take(position(axis, Some(setpoint)))?;
    }
    // It is at its last setpoint from then on: that, too, must be within the limits.
    limits.take(limits.before).map_err(|_| Refusal::NotAtRest)
}

/// Checks of the way into the window: in time, one pending, predecessor, continuous in position, speed, acceleration.
pub(crate) fn check_seam(
    settings: &ServoSettings,
    held: &HeldWindow,
    pending: &HeldWindow,
    header: &WindowHeader,
    setpoints: &[Setpoint],
    feedback: &Feedback,
) -> Result<(), Refusal> {
    if !pending.is_none() {
        return Err(Refusal::OnePending);
    }
    if header.first_scan <= feedback.scan {
        return Err(Refusal::TooLate);
    }
    // A planner plans for the next period; with some to spare.
    let ahead = header.first_scan.saturating_sub(feedback.scan);
    let most = settings.scans_per_period.saturating_mul(AHEAD_PERIODS);
    if ahead > u64::from(most) {
        return Err(Refusal::TooFar);
    }
    if header.predecessor != feedback.window {
        return Err(Refusal::Predecessor);
    }
    if ![0, header.program_hash].contains(&feedback.program_hash) {
        return Err(Refusal::Program);
    }
    let begins = header.predecessor.is_none();
    if begins && header.epoch != feedback.epoch {
        return Err(Refusal::Epoch);
    }
    let Some(axis) = settings.path_axis else {
        return Ok(());
    };
    let mut limits = if begins {
        let command_position = feedback
            .axes
            .get(settings.axis)
            .map_or(i64::MIN, |axis| axis.command_position);
        if position(axis, setpoints.first()) != command_position {
            return Err(Refusal::Register);
        }
        let here = (command_position, command_position);
        RowLimits::starting(settings, feedback, here)
    } else {
        if held.id() != header.predecessor {
            // It came late, or when planners changed, and drives nothing without the window in force: the seam is judged by the
            // servo that does. From this window on it is ready.
            return Ok(());
        }
        if header.first_scan <= held.header.first_scan {
            return Err(Refusal::Predecessor);
        }
        let setpoint =
            i64::try_from(header.first_scan - held.header.first_scan).unwrap_or(i64::MAX);
        let last = [setpoint.saturating_sub(2), setpoint - 1];
        let [before, last] = last.map(|setpoint| held.position(axis, setpoint));
        RowLimits::starting(settings, feedback, (before, last))
    };
    for setpoint in setpoints.iter().take(2) {
        limits.take(position(axis, Some(setpoint)))?;
    }
    Ok(())
}

fn position(path_axis: usize, setpoint: Option<&Setpoint>) -> i64 {
    setpoint
        .and_then(|r| r.position.get(path_axis))
        .copied()
        .unwrap_or(i64::MIN)
}

/// First and second differences of the setpoints, judged one by one.
struct RowLimits<'a> {
    settings: &'a ServoSettings,
    reach: Travel<i64>,
    before: i64,
    step: i64,
}

impl<'a> RowLimits<'a> {
    /// Behind these two.
    fn starting(
        settings: &'a ServoSettings,
        feedback: &Feedback,
        (before, last): (i64, i64),
    ) -> RowLimits<'a> {
        RowLimits {
            settings,
            reach: settings.reach(feedback),
            before: last,
            step: last.saturating_sub(before),
        }
    }

    fn take(&mut self, position: i64) -> Result<(), Refusal> {
        if !self.reach.from_place(self.before).holds(position) {
            return Err(Refusal::Travel);
        }
        let step = position.saturating_sub(self.before);
        if step.saturating_abs() > self.settings.step_max {
            return Err(Refusal::Speed);
        }
        let change = step.saturating_sub(self.step).saturating_abs();
        if change > self.settings.step_change_max {
            return Err(Refusal::Acceleration);
        }
        self.before = position;
        self.step = step;
        Ok(())
    }
}
