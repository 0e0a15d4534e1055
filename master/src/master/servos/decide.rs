//! Whose command the drive of an axis takes in one scan.
//!
//! The switch stays where it is as long as the active servo answers in time with a command that the drive may see. When it
//! does not, and the other one is eligible, the other's answer of the same scan is taken, and the switch stays there. It
//! is eligible once its command was the same to the bit, state included, in two scans in a row until then, and
//! holds the window in force (docs/developers/architecture.md, "Standby").
use bus::sample::{AxisCommand, Cause, Job, Roster, WindowId};
use bus::service::ROLES;

use super::Servos;
use super::switch::{SAME_SCANS, Switch, Taken};
use crate::master::sane::Sane;

/// What a servo's command is held against.
#[derive(Debug, Clone, Copy)]
pub struct Plan<'a> {
    /// The window in force.
    pub in_force: WindowId,
    /// Where it has the axis in this scan, in increments; none where the servo alone knows: where it
    /// interpolates within the period.
    pub position: Option<i64>,
    /// Whether the loop is closed: an axis with an open one may change over freely.
    pub closed: bool,
    /// What the drive may see.
    pub sane: Sane<'a>,
}

impl Servos {
    /// The commands that answer this scan, by role, from the servos in the roster.
    fn in_time<'a>(
        &self,
        scan: u64,
        index: usize,
        commands: &'a [Option<AxisCommand>; ROLES.len()],
        roster: &Roster,
    ) -> [(bool, Option<&'a AxisCommand>); ROLES.len()] {
        let mut answers = [(false, None); ROLES.len()];
        for (role, (answer, command)) in answers.iter_mut().zip(commands).enumerate() {
            let Some(servo) = roster.living(Job::Servo, index, role as u32) else {
                continue;
            };
            let command = command.as_ref().filter(|c| {
                c.scan == scan
                    && c.axis == index as u32
                    && c.role == role as u32
                    && c.incarnation == servo.incarnation
            });
            *answer = (true, command);
        }
        answers
    }

    /// Decides whose command is taken.
    pub fn decide<'a>(
        &mut self,
        scan: u64,
        index: usize,
        commands: &'a [Option<AxisCommand>; ROLES.len()],
        roster: &Roster,
        plan: &Plan<'_>,
    ) -> Taken<'a> {
        let Plan {
            in_force,
            position,
            closed,
            sane,
        } = *plan;
        let answers = self.in_time(scan, index, commands, roster);
        let [a, b] = answers;
        let ((lives, active), (other_lives, other)) = if self.switch.role == 0 {
            (a, b)
        } else {
            (b, a)
        };
        // Another process has the active one's place, and no roster without it was ever seen here (this side was stopped
        // meanwhile): who drove is lost all the same.
        let has_driven = |incarnation| [0, incarnation].contains(&self.taken_incarnation);
        let (lives, active) = match roster.living(Job::Servo, index, self.switch.role as u32) {
            Some(servo) if closed && !has_driven(servo.incarnation) => (false, None),
            _ => (lives, active),
        };
        let judge = |command: &AxisCommand| match sane.judge(command) {
            // Two servos cannot tell which of them is right: the window can.
            Cause::None if position.is_some_and(|planned| planned != command.position) => {
                Cause::BadValue
            }
            cause => cause,
        };
        let good = |command: &&AxisCommand| judge(command) == Cause::None;
        let other_good = other.filter(good);
        let active_cause = active.map(&judge);
        if let (Some(command), Some(Cause::None)) = (active, active_cause) {
            let same = other_good.is_some_and(|o| command.drives_as(o) && o.held == in_force);
            let was_synchronised = self.switch.same_scans >= SAME_SCANS;
            if !same && was_synchronised && other.is_some_and(|o| o.held == in_force) {
                self.standby.differs();
            }
            self.switch.same_scans = if same {
                self.switch.same_scans.saturating_add(1)
            } else {
                0
            };
            return Taken::Command(command);
        }
        let eligible = self.switch.same_scans >= SAME_SCANS || !closed;
        if let Some(command) = other_good.filter(|o| eligible && o.held == in_force) {
            self.switch = Switch {
                role: 1 - self.switch.role,
                same_scans: 0,
            };
            return Taken::Command(command);
        }
        self.switch.same_scans = 0;
        match active_cause {
            Some(cause) => Taken::Bad(cause),
            None if lives => Taken::Missed,
            None if other_lives && !closed => Taken::Missed,
            None => Taken::Lost,
        }
    }
}
