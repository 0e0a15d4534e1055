//! Which window is executed: decided here, in one place, for all axes at once (docs/developers/architecture.md, Windows).

use bus::sample::{
    Feedback, MAX_WINDOW_SETPOINTS, PATH_AXES, PathTag, Setpoint, WindowHeader, WindowId,
};
use bytemuck::{Pod, Zeroable};

/// A window as the master keeps it, in a buffer that is allocated once.
#[derive(Debug, Clone)]
struct KeptWindow {
    header: WindowHeader,
    setpoints: Vec<Setpoint>,
}

impl KeptWindow {
    fn none() -> KeptWindow {
        KeptWindow {
            header: WindowHeader::zeroed(),
            setpoints: Vec::with_capacity(MAX_WINDOW_SETPOINTS),
        }
    }

    fn is_none(&self) -> bool {
        self.header.id.is_none()
    }

    fn set(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        self.header = *header;
        self.setpoints.clear();
        self.setpoints
            .extend(setpoints.iter().take(MAX_WINDOW_SETPOINTS).copied());
    }

    fn clear(&mut self) {
        self.header = WindowHeader::zeroed();
        self.setpoints.clear();
    }

    fn setpoint(&self, scan: u64) -> u32 {
        let last = u64::from(self.header.setpoint_count.max(1) - 1);
        scan.saturating_sub(self.header.first_scan).min(last) as u32
    }

    fn tag(&self, setpoint: u32) -> Option<PathTag> {
        self.setpoints.get(setpoint as usize).map(|s| s.tag)
    }
}

/// What of the windows outlives the master.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Left {
    /// Where on the path.
    pub tag: PathTag,
    /// The program it belongs to.
    pub program_hash: u64,
    /// The epoch.
    pub epoch: u32,
    /// KeptWindow zero.
    pub reserved: u32,
}

/// The windows in force and pending.
#[derive(Debug, Clone)]
pub struct WindowArbiter {
    in_force: KeptWindow,
    pending: KeptWindow,
    armed: bool,
    voided: WindowId,
    epoch: u32,
    /// Where the path was when its last window went, and the program it belongs to.
    interrupted_at: PathTag,
    left_program: u64,
    /// What the feedback says of the path while no window is in force.
    shown: PathTag,
}

/// Why there is to be no window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dropped {
    /// A fault: how far the axes stray from where the path was left is still measured.
    Tripped,
    /// The operator moves the axes, or somebody may push them: they are off the path.
    LeavesPath,
}

impl Default for WindowArbiter {
    fn default() -> Self {
        Self::new()
    }
}

impl WindowArbiter {
    /// No window, in the first epoch.
    pub fn new() -> WindowArbiter {
        WindowArbiter {
            in_force: KeptWindow::none(),
            pending: KeptWindow::none(),
            armed: false,
            voided: WindowId::NONE,
            epoch: 1,
            interrupted_at: PathTag::OFF_PATH,
            left_program: 0,
            shown: PathTag::default(),
        }
    }

    /// The window in force in this scan and its setpoint.
    pub fn in_force(&self, scan: u64) -> (WindowId, u32) {
        if self.in_force.is_none() {
            (WindowId::NONE, 0)
        } else {
            (self.in_force.header.id, self.in_force.setpoint(scan))
        }
    }

    /// Where the path was left, its program, and the epoch: what outlives this master.
    pub fn left(&self, scan: u64) -> Left {
        let (tag, program_hash) = self.left_at(self.in_force.tag(self.in_force(scan).1));
        Left {
            tag,
            program_hash,
            epoch: self.epoch,
            reserved: 0,
        }
    }

    /// Goes on where a master before this one left: without a window, in a new epoch, off the path if there was one.
    pub fn restore(&mut self, left: &Left) {
        self.interrupted_at = left.tag;
        self.left_program = left.program_hash;
        self.epoch = left.epoch.saturating_add(1);
        if !left.tag.is_off_path() {
            self.shown = PathTag::OFF_PATH;
        }
    }

    /// No window, and no place on any path: another program is to begin.
    pub fn forget_path(&mut self, scan: u64) {
        self.drop_all(scan, Dropped::LeavesPath);
        self.interrupted_at = PathTag::OFF_PATH;
        self.left_program = 0;
        self.shown = PathTag::default();
    }

    /// The path of a program begins at this place, where the axes are not yet.
    pub fn begin_at(&mut self, scan: u64, place: PathTag, program_hash: u64) {
        self.drop_all(scan, Dropped::LeavesPath);
        self.interrupted_at = place;
        self.left_program = program_hash;
        self.shown = PathTag::OFF_PATH;
    }

    /// Whether the path has been started: a window of it was in force once.
    pub fn has_started(&self) -> bool {
        !self.in_force.is_none() || !self.interrupted_at.is_off_path()
    }

    /// The window that waits to be decided about; none without one.
    pub fn pending(&self) -> WindowId {
        self.pending.header.id
    }

    /// Whether a window is in force.
    pub fn has_window(&self) -> bool {
        !self.in_force.is_none()
    }

    /// Whether the command is in this scan: the window's last setpoint is reached.
    pub fn at_rest(&self, scan: u64) -> bool {
        self.in_force.is_none()
            || self.in_force.setpoint(scan) + 1 >= self.in_force.header.setpoint_count
    }

    /// Where the window in force has the axes in this scan, in increments; none without a window.
    pub fn positions(&self, scan: u64) -> Option<&[i64; PATH_AXES]> {
        let setpoint = self.in_force.setpoint(scan);
        let setpoint = self.in_force.setpoints.get(setpoint as usize)?;
        Some(&setpoint.position)
    }

    /// Where on the path the setpoint executed in this scan is; none without a window.
    pub fn tag_in(&self, scan: u64) -> Option<PathTag> {
        self.in_force.tag(self.in_force.setpoint(scan))
    }

    /// Whether the setpoint executed in this scan is one of the program's path.
    pub fn is_on_path(&self, scan: u64) -> bool {
        self.tag_in(scan).is_some_and(|tag| !tag.is_off_path())
    }

    /// Whether the window in force brings the program to its end.
    pub fn ends_program(&self) -> bool {
        self.in_force.header.ends_program == 1
    }

    /// Writes into the feedback what everybody is to execute in this scan.
    pub fn tell(&self, scan: u64, feedback: &mut Feedback) {
        let (window, setpoint) = self.in_force(scan);
        feedback.window = window;
        feedback.setpoint = setpoint;
        let tag = self.in_force.tag(setpoint);
        feedback.tag = tag.unwrap_or(self.shown);
        (feedback.interrupted_at, feedback.program_hash) = self.left_at(tag);
        feedback.at_rest = u32::from(self.at_rest(scan));
        feedback.armed = if self.armed {
            self.pending.header.id
        } else {
            WindowId::NONE
        };
        feedback.voided = self.voided;
        feedback.epoch = self.epoch;
    }

    /// The place where the path is left, for this one in the window in force, and its program.
    fn left_at(&self, tag: Option<PathTag>) -> (PathTag, u64) {
        let program_hash = if self.in_force.is_none() {
            self.left_program
        } else {
            self.in_force.header.program_hash
        };
        let on_path = tag.filter(|tag| !tag.is_off_path());
        (on_path.unwrap_or(self.interrupted_at), program_hash)
    }

    /// A window came in from the planner of this incarnation. A second one while one is pending is void at once, and
    /// so is one of a planner that is not the live one or of another size than it says.
    pub fn offer(&mut self, header: &WindowHeader, setpoints: &[Setpoint], planner: u32) {
        let known = header.id.incarnation == planner && planner != 0;
        let sized = header.setpoint_count as usize == setpoints.len()
            && !setpoints.is_empty()
            && setpoints.len() <= MAX_WINDOW_SETPOINTS;
        let reported =
            header.intended_setpoints >= 1 && header.intended_setpoints <= header.setpoint_count;
        if !self.pending.is_none() || !known || !sized || !reported {
            self.voided = header.id;
            return;
        }
        self.pending.set(header, setpoints);
    }

    /// Decides about the pending window for scan `next`: it takes over at its first scan if every axis holds it by
    /// then, its predecessor is the one in force (or its epoch the present one) and motion is allowed; otherwise it is
    /// void for good.
    pub fn decide(&mut self, next: u64, allowed: bool, held_by_all: impl Fn(WindowId) -> bool) {
        if self.pending.is_none() {
            return;
        }
        let header = self.pending.header;
        let continues = header.predecessor == self.in_force.header.id
            && (!header.predecessor.is_none() || header.epoch == self.epoch);
        let held = held_by_all(header.id);
        let too_far = header.first_scan > next + MAX_WINDOW_SETPOINTS as u64;
        if !allowed || !continues || too_far || header.first_scan < next {
            self.void();
        } else if header.first_scan == next {
            if held {
                std::mem::swap(&mut self.in_force, &mut self.pending);
                self.pending.clear();
                self.armed = false;
            } else {
                self.void();
            }
        } else {
            self.armed = held;
        }
    }

    /// Whether the window that waits begins where the axes are commanded to be, in increments; it does where it follows another.
    pub fn pending_begins_at(&self, commanded: impl Iterator<Item = i64>) -> bool {
        let first = self.pending.setpoints.first();
        self.has_window()
            || first.is_none_or(|first| first.position.iter().zip(commanded).all(|(a, b)| *a == b))
    }

    /// Whether the window that waits comes to rest on the path no later than the one in force.
    pub fn pending_rests_no_later(&self) -> bool {
        let rests = |kept: &KeptWindow| kept.setpoints.last().map(|last| last.tag);
        let (Some(pending), Some(in_force)) = (rests(&self.pending), rests(&self.in_force)) else {
            return false;
        };
        pending.element < in_force.element
            || pending.element == in_force.element && pending.distance_mm <= in_force.distance_mm
    }

    fn void(&mut self) {
        self.voided = self.pending.header.id;
        self.pending.clear();
        self.armed = false;
    }

    /// No window from `scan` on: a new epoch begins. Where on the path the one in force stood is kept.
    pub fn drop_all(&mut self, scan: u64, why: Dropped) {
        if !self.pending.is_none() {
            self.void();
        }
        if !self.in_force.is_none() {
            let tag = self.in_force.tag(self.in_force.setpoint(scan));
            self.shown = tag.unwrap_or_default();
            if !self.shown.is_off_path() {
                self.interrupted_at = self.shown;
            }
            self.left_program = self.in_force.header.program_hash;
        }
        if why == Dropped::LeavesPath && !self.interrupted_at.is_off_path() {
            self.shown = PathTag::OFF_PATH;
        }
        self.in_force.clear();
        self.epoch += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: PathTag = PathTag {
        distance_mm: 1.5,
        element: 7,
        dwell_remaining_scans: 0,
    };

    fn left(tag: PathTag) -> Left {
        Left {
            tag,
            program_hash: 3,
            epoch: 4,
            reserved: 0,
        }
    }

    fn shown(windows: &WindowArbiter) -> PathTag {
        let mut feedback = Feedback::zeroed();
        windows.tell(0, &mut feedback);
        feedback.tag
    }

    #[test]
    fn a_master_after_another_is_off_the_path_only_where_there_was_one() {
        let mut windows = WindowArbiter::new();
        windows.restore(&left(PLACE));
        assert_eq!(
            (shown(&windows), windows.has_started()),
            (PathTag::OFF_PATH, true)
        );
        assert_eq!(
            windows.left(0),
            Left {
                epoch: 5,
                ..left(PLACE)
            }
        );
        let mut before_the_path = WindowArbiter::new();
        before_the_path.restore(&left(PathTag::OFF_PATH));
        assert_eq!(
            (shown(&before_the_path), before_the_path.has_started()),
            (PathTag::default(), false)
        );
    }

    #[test]
    fn a_path_has_started_with_its_first_window_and_not_before() {
        let mut windows = WindowArbiter::new();
        assert!(!windows.has_started());
        windows.restore(&left(PLACE));
        windows.forget_path(0);
        assert!(!windows.has_started());
        assert_eq!(shown(&windows), PathTag::default());
    }
}
