//! Errors of screws and guideways: what a drive shows becomes the true place of its axis (docs/howto/geometry.md).
//!
//! `true = shown + Σ e(shown places)`, where each e is a table over the nominal place of one axis. Servos, operators and instruments see
//! true places alone, so no setpoint is touched and a loop corrects its axis as it corrects any error. The correction depends on what
//! the drives show in this scan and on nothing before: whichever servo, planner or master comes next finds the same.

use bus::sample::{MAX_AXES, Mode};
use machine::{GeometryTerm, Machine, PositionFeedback};

use super::axes::Axes;
use super::axis_unit::AxisUnit;

/// A correction that comes into force in a closed loop, such as one that depends on an axis that has just been homed, changes at most
/// this much faster than it would in motion: the axis creeps to its true place and never jumps.
const CHANGE_MARGIN: f64 = 2.0;

/// One that is the same everywhere comes into force at this speed, in mm/s: it never changes in motion.
const CREEP_MM_S: f64 = 0.01;

/// What has to be added to what the drive of an axis shows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Correction {
    /// To its motor's position, in mm.
    pub motor_mm: f64,
    /// To its scale's, in mm.
    pub scale_mm: f64,
}

impl Correction {
    /// Nearer to another one, by this much at most.
    pub fn towards(self, other: Correction, most_mm: f64) -> Correction {
        let nearer = |from: f64, to: f64| from + (to - from).max(-most_mm).min(most_mm);
        Correction {
            motor_mm: nearer(self.motor_mm, other.motor_mm),
            scale_mm: nearer(self.scale_mm, other.scale_mm),
        }
    }
}

/// The corrections of all axes.
#[derive(Debug, Clone)]
pub(super) struct Geometry {
    terms: Vec<GeometryTerm>,
    /// Largest change in a scan while the loop is closed, by axis, in mm.
    change_max_mm: [f64; MAX_AXES],
    scan_s: f64,
}

impl Geometry {
    pub fn new(machine: &Machine) -> Geometry {
        let terms = machine.geometry();
        let mut change_max_mm = [0.0; MAX_AXES];
        for term in &terms {
            let rapid_mm_s = machine.axes.get(term.from).map_or(0.0, |of| of.rapid_mm_s);
            if let Some(most_mm) = change_max_mm.get_mut(term.of) {
                let in_motion_mm_s = term.errors.steepness().slope * rapid_mm_s;
                let speed_mm_s = in_motion_mm_s.max(CREEP_MM_S);
                *most_mm += CHANGE_MARGIN * speed_mm_s * machine.scan_period_s();
            }
        }
        Geometry {
            terms,
            change_max_mm,
            scan_s: machine.scan_period_s(),
        }
    }

    /// Where the drives show the axes now counts. What depends on an axis that does not know its place counts for nothing.
    pub fn correct(&self, axes: &mut Axes, mode: Mode) {
        if self.terms.is_empty() {
            return;
        }
        let mut errors = [Correction::default(); MAX_AXES];
        for term in &self.terms {
            let (of, from) = (axes.get(term.of), axes.get(term.from));
            let known = of.is_some_and(AxisUnit::is_homed);
            let from = from.filter(|axis| known && axis.is_homed());
            if let (Some(errors), Some(from)) = (errors.get_mut(term.of), from) {
                let error_mm = term.errors.at_mm(from.nominal_mm());
                errors.motor_mm += error_mm;
                // An error of the screw is none of a scale that the loop does not go by.
                let by_scale = from.settings.feedback == PositionFeedback::Scale;
                if term.of != term.from || by_scale {
                    errors.scale_mm += error_mm;
                }
            }
        }
        let errors = errors.into_iter().zip(self.change_max_mm);
        for (axis, (errors, most_mm)) in axes.iter_mut().zip(errors) {
            let closed = !axis.loop_is_open(mode);
            axis.correct_by(errors, closed.then_some(most_mm), self.scan_s);
        }
    }

    /// The same before the first scan: axes are commanded to be where they are.
    pub fn begin(&self, axes: &mut Axes) {
        if self.terms.is_empty() {
            return;
        }
        self.correct(axes, Mode::Disabled);
        for axis in axes.iter_mut() {
            axis.command_to(axis.feedback_position());
        }
    }
}
