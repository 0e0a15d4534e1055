//! One axis, as an observer sees it.

use std::collections::VecDeque;

use bus::sample::{AxisCommand, AxisFeedback, Redundancy, Reference};
use machine::{Axis, TURN_DEG};
use remote::wire::{AxisState, CommandState};
use report::turns::Turns;

/// Looks that the history holds: 24 s.
const HISTORY: usize = 240;

/// What is shown of one axis.
#[derive(Debug)]
pub struct AxisView {
    /// Its letter.
    pub name: String,
    /// Unit of its positions.
    pub unit: &'static str,
    /// Unit of its deviations.
    pub error_unit: &'static str,
    /// What is known of it now, as a view on another machine gets it.
    pub now: AxisState,
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
            error_unit: axis.kind.deviation_unit(),
            now: AxisState {
                command_mm: 0.0,
                feedback_mm: 0.0,
                velocity_mm_s: 0.0,
                torque_nm: 0.0,
                winding_k: 0.0,
                torque_limited: false,
                missed_scans: 0,
                missed_in_a_row: 0,
                redundancy: Redundancy::Alone as u32,
                unsynchronised_scans: 0,
                differences: 0,
                role: 0,
                reference: Reference::Known as u32,
                command: None,
                error_um: None,
                error_peak_since_um: None,
                error_peak_um: 0.0,
            },
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
        let position = if self.by_scale {
            sample.scale_position
        } else {
            sample.motor_position
        };
        let redundancy = Redundancy::from_wire(sample.redundancy).unwrap_or(Redundancy::Lost);
        let reference = Reference::from_wire(sample.reference).unwrap_or(Reference::Missing);
        self.now = AxisState {
            command_mm: self.shown(sample.command_position),
            feedback_mm: self.shown(position),
            velocity_mm_s: sample.velocity_mm_s,
            torque_nm: sample.torque_nm,
            winding_k: sample.winding_k,
            torque_limited: sample.torque_limited == 1,
            missed_scans: sample.missed_scans,
            missed_in_a_row: sample.missed_in_a_row,
            redundancy: redundancy as u32,
            unsynchronised_scans: sample.unsynchronised_scans,
            differences: sample.differences,
            role: sample.taken_role,
            reference: reference as u32,
            ..self.now
        };
        if !driven {
            self.turns.interrupt();
            return None;
        }
        self.turns.take(scan, sample.command_position)
    }

    /// Takes the command of the servo that drives; its following error in µm, if it is a number.
    pub fn command(&mut self, command: &AxisCommand) -> Option<f64> {
        self.now.command = Some(CommandState {
            scan: command.scan,
            position_mm: command.position as f64 * self.increment_mm,
            velocity_mm_s: command.velocity_mm_s,
            torque_nm: command.torque_nm,
            friction_level: command.friction_level,
            friction_unexplained: command.friction_unexplained,
        });
        let error_um = Some(command.following_error_mm * 1e3).filter(|error| error.is_finite())?;
        self.now.error_um = Some(error_um);
        self.now.error_peak_um = self.now.error_peak_um.max(error_um.abs());
        self.peaked(error_um.abs());
        Some(error_um)
    }

    /// A magnitude of the following error in this look.
    fn peaked(&mut self, error_um: f64) {
        self.frame_peak_um = Some(self.frame_peak_um.unwrap_or(0.0).max(error_um));
    }

    /// Torque as a share of the motor's rated torque.
    pub fn torque_share(&self) -> f64 {
        self.now.torque_nm / self.rated_nm
    }

    /// Whether its standby could take over.
    pub fn redundancy(&self) -> Redundancy {
        Redundancy::from_wire(self.now.redundancy).unwrap_or(Redundancy::Lost)
    }

    /// Whether its positions are those of the machine.
    pub fn reference(&self) -> Reference {
        Reference::from_wire(self.now.reference).unwrap_or(Reference::Missing)
    }

    /// How it knows its place, in words.
    pub fn reference_words(&self) -> &'static str {
        match self.reference() {
            Reference::Known if self.absolute => "absolute",
            Reference::Missing if self.absolute => "no reference",
            reference => reference.words(),
        }
    }

    /// The same where it has no absolute encoder; none where there is nothing to say.
    pub fn homing_words(&self) -> Option<&'static str> {
        let silent = self.absolute && self.reference() == Reference::Known;
        (!silent).then(|| self.reference_words())
    }

    /// Friction that the servo goes by and what the last way between two reversals left unexplained, as parts; none where the axis does
    /// not follow friction.
    pub fn friction(&self) -> Option<(f64, f64)> {
        let command = self.now.command.filter(|_| self.follows_friction)?;
        Some((command.friction_level, command.friction_unexplained))
    }

    /// The same in words.
    pub fn friction_words(&self) -> String {
        match self.friction() {
            Some((level, _)) => format!("{:.0}%", level * 100.0),
            None if self.has_model => "tuned".into(),
            None => "none".into(),
        }
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

#[cfg(any(feature = "remote", test))]
impl AxisView {
    /// Takes what somebody on the spot has seen of this axis.
    pub fn reported(&mut self, message: &AxisState) {
        self.now = message.clone();
        if let Some(peak_um) = message.error_peak_since_um {
            self.peaked(peak_um);
        }
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
