//! The gantries of a machine, and what is true of both motors of one.

use bus::drive_codes::with_code;
use bus::sample::{Cause, Feedback, MAX_AXES, PATH_AXES};

use crate::axis::{Axis, PositionFeedback};
use crate::machine::Machine;

/// Two motors of one axis, by their places among the axes of the machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GantryPair {
    /// The axis's own motor.
    pub leader: usize,
    /// Its second motor.
    pub follower: usize,
    /// Largest skew, in mm.
    pub skew_max_mm: f64,
    /// Largest lasting difference of their torques, in percent of the rated ones.
    pub torque_difference_max_percent: f64,
}

impl GantryPair {
    /// Puts the mean of the two motors' places, in mm, in the place of the first.
    fn meet(&self, motors_mm: &mut [f64]) {
        let end_mm = motors_mm.get(self.follower).copied();
        if let Some((place_mm, end_mm)) = motors_mm.get_mut(self.leader).zip(end_mm) {
            *place_mm = 0.5 * (*place_mm + end_mm);
        }
    }
}

impl Machine {
    /// The axes that programs name, in front of all others: the index of one is its place on the path.
    pub fn program_axes(&self) -> &[Axis] {
        let others = self.axes.iter().position(|axis| !axis.has_letter());
        let count = others.unwrap_or(self.axes.len());
        self.axes.get(..count).unwrap_or(&self.axes)
    }

    /// The place of an axis in setpoints, which the second motor of a gantry shares with its axis; none of an axis that no program moves.
    pub fn path_axis(&self, axis: usize) -> Option<usize> {
        let of = self.gantry_of(axis).map_or(axis, |pair| pair.leader);
        (of < self.program_axes().len()).then_some(of)
    }

    /// The gantries of the machine.
    pub fn gantries(&self) -> impl Iterator<Item = GantryPair> + '_ {
        self.axes.iter().enumerate().filter_map(|(follower, axis)| {
            let gantry = axis.gantry.as_ref()?;
            let leader = self.axes.iter().position(|of| of.name == gantry.leader)?;
            Some(GantryPair {
                leader,
                follower,
                skew_max_mm: gantry.skew_max_mm,
                torque_difference_max_percent: gantry.torque_difference_max_percent,
            })
        })
    }

    /// The gantry that an axis is half of.
    pub fn gantry_of(&self, axis: usize) -> Option<GantryPair> {
        self.gantries()
            .find(|pair| pair.leader == axis || pair.follower == axis)
    }

    /// Turns the places of all motors into the places of the axes that programs name: a tool in the middle of a bridge is where the
    /// mean of its two ends is; other motors have none.
    pub fn to_program_axes(&self, mut motors_mm: [f64; MAX_AXES]) -> [f64; PATH_AXES] {
        for pair in self.gantries() {
            pair.meet(&mut motors_mm);
        }
        let mut places_mm = [0.0; PATH_AXES];
        let named = places_mm.iter_mut().zip(motors_mm);
        for ((place_mm, motor_mm), _) in named.zip(self.program_axes()) {
            *place_mm = motor_mm;
        }
        places_mm
    }

    /// Skew of a gantry, in mm: position of its second motor less the position of its first, by the feedback that the servos use.
    pub fn skew_mm(&self, pair: &GantryPair, feedback: &Feedback) -> f64 {
        let place = |index: usize| {
            let (axis, shown) = (self.axes.get(index)?, feedback.axes.get(index)?);
            Some(match axis.feedback {
                PositionFeedback::Motor => shown.motor_position,
                PositionFeedback::Scale => shown.scale_position,
            })
        };
        let skew = place(pair.follower).zip(place(pair.leader));
        let skew = skew.map_or(0, |(follower, leader)| follower.saturating_sub(leader));
        let increment_mm = self.axes.get(pair.follower).map(Axis::increment_mm);
        skew as f64 * increment_mm.unwrap_or(0.0)
    }

    /// A cause of a stop of an axis in words, with the code that its feedback has for it.
    pub fn cause_words(&self, cause: Cause, axis: usize, code: u32) -> String {
        let words = with_code(cause, code);
        let Some(pair) = self.gantry_of(axis) else {
            return words;
        };
        let motors = [pair.leader, pair.follower].map(|motor| self.axis_name(motor));
        let [leader, follower] = motors;
        match cause {
            Cause::Skew => format!(
                "{words} between {leader} and {follower}, at most {} {} is allowed",
                pair.skew_max_mm,
                self.axes.get(axis).map_or("mm", |axis| axis.kind.unit()),
            ),
            Cause::GantryTorque => format!(
                "{words} of their rated torque between {leader} and {follower}, at most {} % is allowed: enable lets the bridge relax; \
                 where it comes again, compare position_mm of the two, or square the bridge",
                pair.torque_difference_max_percent,
            ),
            _ => words,
        }
    }

    /// Index of the axis of this name, for whoever moves or sets it.
    ///
    /// # Errors
    /// The machine has none, or it is the second motor of one; says what is right.
    pub fn program_axis_index(&self, letter: &str) -> Result<u32, String> {
        let index = self.axis_index(letter)?;
        let axis = self.axes.get(index as usize);
        match axis.and_then(|axis| axis.gantry.as_ref()) {
            None => Ok(index),
            Some(gantry) => Err(format!(
                "axis {letter:?}: is the second motor of {leader} and moves with it: name {leader}",
                leader = gantry.leader
            )),
        }
    }
}
