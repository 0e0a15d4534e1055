//! One axis, as an observer sees it.

use std::collections::VecDeque;

use bus::sample::{AxisCommand, AxisFeedback, Redundancy, Reference};
use bus::service::ROLES;
use bytemuck::Zeroable;
use machine::{Axis, TURN_DEG};
use monitor::quantities;
use remote::state::AxisState;
use report::turns::Turns;

use super::state::{round, rounded};

/// Reference of an axis that knows its place without being homed.
pub const ABSOLUTE: &str = "absolute";
/// Looks that the history holds: 24 s.
const HISTORY: usize = 240;

/// What is shown of one axis.
#[derive(Debug)]
pub struct AxisView {
    /// Its letter.
    pub name: String,
    /// Unit of its positions.
    pub unit: &'static str,
    /// The newest feedback.
    pub now: AxisFeedback,
    /// The newest command of the servo that drives.
    command: Option<AxisCommand>,
    /// Its following error, in µm.
    pub error_um: Option<f64>,
    /// The largest magnitude of that since the observer came.
    error_peak_um: f64,
    /// Following error that trips the axis, in µm.
    pub error_limit_um: f64,
    /// Largest magnitude between two looks, newest last.
    pub error_history_um: VecDeque<f64>,
    absolute: bool,
    modulo: bool,
    increment_mm: f64,
    rated_nm: f64,
    by_scale: bool,
    follows_friction: bool,
    has_model: bool,
    frame_peak_um: Option<f64>,
    /// Largest magnitude of the following error in the last look; none if no command was seen in it.
    pub look_peak_um: Option<f64>,
    turns: TurnFinder,
}

impl AxisView {
    /// Of an axis of the machine file.
    pub fn of(axis: &Axis) -> Self {
        let increment_mm = axis.increment_mm();
        AxisView {
            name: axis.name.clone(),
            unit: axis.kind.unit(),
            now: AxisFeedback::zeroed(),
            command: None,
            error_um: None,
            error_peak_um: 0.0,
            error_limit_um: axis.following_error_limit_mm * 1e3,
            error_history_um: VecDeque::with_capacity(HISTORY),
            absolute: axis.homing.is_none(),
            modulo: axis.modulo,
            increment_mm,
            rated_nm: axis.motor.rated_torque_nm,
            by_scale: axis.feedback == machine::PositionFeedback::Scale,
            has_model: axis.model.is_some(),
            follows_friction: axis.adaptation.mode == machine::AdaptationMode::On,
            frame_peak_um: None,
            look_peak_um: None,
            turns: TurnFinder::new(increment_mm),
        }
    }

    /// A place in mm or degrees, of an axis that turns without end within a turn.
    fn shown(&self, increments: i64) -> f64 {
        let place_mm = increments as f64 * self.increment_mm;
        if self.modulo {
            place_mm.rem_euclid(TURN_DEG)
        } else {
            place_mm
        }
    }

    /// Takes the feedback of one scan; a reversal, if its command has gone far enough in a new direction.
    pub fn feedback(&mut self, scan: u64, sample: &AxisFeedback, driven: bool) -> Option<Turn> {
        self.now = *sample;
        if !driven {
            self.turns.interrupt();
            return None;
        }
        self.turns.take(scan, sample.command_position)
    }

    /// Takes the command of the servo that drives; its following error in µm, if it is a number.
    pub fn command(&mut self, command: &AxisCommand) -> Option<f64> {
        self.command = Some(*command);
        let error_um = Some(command.following_error_mm * 1e3).filter(|error| error.is_finite())?;
        self.error_um = Some(error_um);
        self.error_peak_um = self.error_peak_um.max(error_um.abs());
        self.peaked(error_um.abs());
        Some(error_um)
    }

    /// A magnitude of the following error in this look.
    pub fn peaked(&mut self, error_um: f64) {
        self.frame_peak_um = Some(self.frame_peak_um.unwrap_or(0.0).max(error_um));
    }

    /// Position command, in mm or degrees.
    pub fn command_mm(&self) -> f64 {
        self.shown(self.now.command_position)
    }

    /// Position by the encoder, or by the scale where that is used, in mm or degrees.
    pub fn feedback_mm(&self) -> f64 {
        self.shown(if self.by_scale {
            self.now.scale_position
        } else {
            self.now.motor_position
        })
    }

    /// All that is known of it alone.
    pub fn state(&self) -> AxisState {
        let (now, command) = (&self.now, self.command.as_ref());
        let (friction_level, friction_unexplained) = self.friction().unzip();
        let command_mm = rounded(self.command_mm(), 6);
        AxisState {
            axis: self.name.clone(),
            unit: self.unit.into(),
            command_mm,
            feedback_mm: rounded(self.feedback_mm(), 6),
            machine_mm: command_mm,
            velocity_mm_s: rounded(now.velocity_mm_s, 4),
            velocity_command_mm_s: round(command.map(|of| of.velocity_mm_s), 4),
            following_error_um: round(self.error_um, 3),
            following_error_peak_um: rounded(self.error_peak_um, 3),
            following_error_look_um: round(self.look_peak_um, 3),
            torque_command_nm: round(command.map(|of| of.torque_nm), 4),
            torque_nm: rounded(now.torque_nm, 4),
            torque_percent: rounded(now.torque_nm / self.rated_nm * 100.0, 2),
            torque_limited: now.torque_limited == 1,
            friction: match friction_level {
                Some(level) => format!("{:.0}%", level * 100.0),
                None if self.has_model => "tuned".into(),
                None => "none".into(),
            },
            friction_level: round(friction_level, 4),
            friction_unexplained: round(friction_unexplained, 4),
            missed_scans: now.missed_scans,
            missed_in_a_row: now.missed_in_a_row,
            servo: ROLES
                .get(now.taken_role as usize)
                .copied()
                .unwrap_or("?")
                .into(),
            standby: self.redundancy().words().into(),
            standby_differences: now.differences,
            reference: self.reference_words().into(),
            quantities: quantities::OF_AXIS
                .map(|one| (one.key.into(), round(Some((one.of)(now)), 3)))
                .into(),
            ..AxisState::default()
        }
    }

    /// Whether its standby could take over.
    pub fn redundancy(&self) -> Redundancy {
        Redundancy::from_wire(self.now.redundancy).unwrap_or(Redundancy::Lost)
    }

    /// How it knows its place, in words.
    pub fn reference_words(&self) -> &'static str {
        match Reference::from_wire(self.now.reference).unwrap_or(Reference::Missing) {
            Reference::Known if self.absolute => ABSOLUTE,
            Reference::Missing if self.absolute => "no reference",
            reference => reference.words(),
        }
    }

    /// Friction that the servo goes by and what the last way between two reversals left unexplained, as parts; none where the axis does
    /// not follow friction.
    pub fn friction(&self) -> Option<(f64, f64)> {
        let command = self.command.as_ref().filter(|_| self.follows_friction)?;
        Some((command.friction_level, command.friction_unexplained))
    }

    /// Ends one look: what was largest since the one before goes into the history.
    pub fn end_of_look(&mut self) {
        self.look_peak_um = self.frame_peak_um.take();
        let Some(peak_um) = self.look_peak_um else {
            return;
        };
        if self.error_history_um.len() == HISTORY {
            self.error_history_um.pop_front();
        }
        self.error_history_um.push_back(peak_um);
    }
}

/// A change of direction of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// First scan commanded in the new direction.
    pub scan: u64,
    /// −1 or 1.
    pub direction: i32,
}

/// Finds where a command reverses; never across scans that were not seen.
#[derive(Debug)]
struct TurnFinder {
    turns: Turns<u64>,
    last_scan: Option<u64>,
}

impl TurnFinder {
    fn new(increment_mm: f64) -> Self {
        TurnFinder {
            turns: Turns::new(increment_mm),
            last_scan: None,
        }
    }

    fn interrupt(&mut self) {
        self.turns.interrupt();
        self.last_scan = None;
    }

    fn take(&mut self, scan: u64, position: i64) -> Option<Turn> {
        let before = self.last_scan.replace(scan);
        if before.is_none_or(|before| before + 1 != scan) {
            self.turns.interrupt();
        }
        let (scan, direction) = self.turns.take(position, |_| scan)?;
        Some(Turn { scan, direction })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reversal_is_dated_at_its_first_scan_and_never_found_across_a_gap() {
        let mut finder = TurnFinder::new(1e-6);
        // Up by 60 nm a scan to scan 9, then down: 100 nm count.
        let up_and_down = |scan: u64| 60 * (9 - (scan as i64 - 9).abs());
        let found: Vec<Turn> = (0..30)
            .filter_map(|scan| finder.take(scan, up_and_down(scan)))
            .collect();
        let turn = Turn {
            scan: 10,
            direction: -1,
        };
        assert_eq!(found, [turn]);
        let mut finder = TurnFinder::new(1e-6);
        let gap = (0..30).filter(|scan| !(8..12).contains(scan));
        let found: Vec<Turn> = gap
            .filter_map(|scan| finder.take(scan, up_and_down(scan)))
            .collect();
        assert_eq!(found, []);
    }

    #[test]
    fn rounding_of_a_command_that_stands_is_no_reversal() {
        let mut finder = TurnFinder::new(1e-6);
        let found = (0..100u64).filter_map(|scan| finder.take(scan, (scan % 2) as i64 * 20));
        assert_eq!(found.count(), 0);
    }
}
