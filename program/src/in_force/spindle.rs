//! The words of spindle, coolant and overrides. What is told to the machine is told in events.

use super::{Acts, Group, InForce, ModalState, Words};
use crate::program::EventKind;
use crate::refusal::{Refusal, refuse};
use crate::surface::SurfaceSpeed;

const METRES_PER_FOOT: f64 = 0.3048;

impl InForce {
    /// G96 and G97; in G96 the axis of the spindle is at `centre_mm` along X, which not every machine has.
    pub fn spindle_mode(&mut self, words: &Words, centre_mm: Option<f64>) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::SpindleMode) else {
            return Ok(());
        };
        let has_speed = words.value('S').is_some();
        if number == 970 {
            if self.modes.surface.take().is_some() && !has_speed {
                let right = "the speed in rev/min, such as G97 S1000: S was a cutting speed";
                return refuse(word.offset, "G97 without S behind G96", right);
            }
            return Ok(());
        }
        if !has_speed {
            let right = "the cutting speed in m/min, in G20 in feet/min, such as G96 D2500 S250";
            return refuse(word.offset, "G96 without S", right);
        }
        let Some(centre_mm) = centre_mm else {
            let right = "the speed follows the distance of X from the spindle's axis: this machine has no X";
            return refuse(word.offset, "G96", right);
        };
        self.modes.surface = Some(SurfaceSpeed {
            m_min: 0.0,
            limit_rpm: words.value('D').map(|limit| limit.value.abs()),
            centre_mm,
        });
        Ok(())
    }

    /// S: the speed of the spindle, or of the cut.
    pub fn set_speed(&mut self, speed: f64, centre_mm: f64, acts: &mut Acts) {
        self.modes.spindle.speed = speed;
        let unit = if self.inches { METRES_PER_FOOT } else { 1.0 };
        acts.event(match &mut self.modes.surface {
            Some(surface) => {
                surface.m_min = speed.abs() * unit;
                surface.centre_mm = centre_mm;
                EventKind::SurfaceSpeed(*surface)
            }
            None => EventKind::SpindleSpeedRpm(speed),
        });
    }

    /// The axis of the spindle is where the program has its X0 now.
    pub fn follow_centre(&mut self, centre_mm: f64, acts: &mut Acts) {
        if let Some(surface) = &mut self.modes.surface
            && surface.centre_mm != centre_mm
        {
            surface.centre_mm = centre_mm;
            acts.event(EventKind::SurfaceSpeed(*surface));
        }
    }

    /// M3, M4, M5 and M19.
    pub fn spindle_words(&mut self, words: &Words, acts: &mut Acts) -> Result<(), Refusal> {
        let Some((number, _)) = words.code(Group::Spindle) else {
            return Ok(());
        };
        if let Some(spindle) = words.value('$').filter(|spindle| spindle.value != 0.0) {
            return spindle.refuse("there is one spindle, $0");
        }
        match number {
            30 => self.turn_spindle(1, acts),
            40 => self.turn_spindle(-1, acts),
            50 => self.turn_spindle(0, acts),
            _ => {
                let angle = words.value('R').map_or(0.0, |angle| angle.value);
                self.modes.spindle.direction = 0;
                acts.event(EventKind::SpindleOrient(angle));
            }
        }
        Ok(())
    }

    /// Turns the spindle: 1 clockwise, −1 counter-clockwise, 0 stops it.
    pub fn turn_spindle(&mut self, direction: i32, acts: &mut Acts) {
        self.modes.spindle.direction = direction;
        acts.event(EventKind::of_spindle(direction));
    }

    /// M7, M8 and M9.
    pub fn coolant_words(&mut self, words: &Words, acts: &mut Acts) {
        let [mist, flood] = self.coolant;
        match words.code(Group::Coolant) {
            Some((70, _)) => self.set_coolant([true, flood], acts),
            Some((80, _)) => self.set_coolant([mist, true], acts),
            Some(_) => self.set_coolant([false; 2], acts),
            None => {}
        }
    }

    /// Mist, flood.
    fn set_coolant(&mut self, coolant: [bool; 2], acts: &mut Acts) {
        let [mist, flood] = coolant;
        // M9 says so even where nothing is on: levels that are set twice do no harm.
        let off = coolant == [false; 2];
        if mist != self.coolant[0] || off {
            acts.event(EventKind::Mist(mist));
        }
        if flood != self.coolant[1] || off {
            acts.event(EventKind::Flood(flood));
        }
        self.modes.coolant = coolant;
    }

    /// M48 to M53.
    pub fn override_words(&mut self, words: &Words, acts: &mut Acts) {
        let Some((number, _)) = words.code(Group::Overrides) else {
            return;
        };
        let on = words.value('P').is_none_or(|p| p.value != 0.0);
        match number {
            480 | 490 => {
                self.modes.feed_override = number == 480;
                self.modes.spindle_override = number == 480;
                acts.event(EventKind::OverridesEnabled(self.feed_override));
            }
            500 => {
                self.modes.feed_override = on;
                acts.event(EventKind::OverridesEnabled(on));
            }
            510 => {
                self.modes.spindle_override = on;
                acts.note("M51 has no effect: the speed of the spindle has no override");
            }
            _ => acts.note(
                "M52 and M53 (adaptive feed, feed stop) have no effect: there is no such input",
            ),
        }
    }

    /// Behind [`InForce::restore`], with the modes before it: tells the machine what is other than it was.
    pub fn tell_restored(
        &mut self,
        saved: &ModalState,
        before: &ModalState,
        centre_mm: f64,
        acts: &mut Acts,
    ) {
        let limit_rpm = |modes: &ModalState| modes.surface.map(|of| of.limit_rpm);
        let mode_changes = limit_rpm(saved) != limit_rpm(before);
        if mode_changes || saved.spindle.speed != before.spindle.speed {
            self.modes.surface = saved.surface;
            self.set_speed(saved.spindle.speed, centre_mm, acts);
        }
        if saved.spindle.direction != before.spindle.direction {
            self.turn_spindle(saved.spindle.direction, acts);
        }
        if saved.coolant != before.coolant {
            self.set_coolant(saved.coolant, acts);
        }
        if saved.feed_override != before.feed_override {
            acts.event(EventKind::OverridesEnabled(saved.feed_override));
        }
    }
}
