//! Rigid tapping: the gear between an axis and the spindle begins, and each scan the spindle follows it.

use bus::sample::{Cause, EventCode, Mode, ProgramEvent};

use crate::drives::Drives;
use crate::master::Master;
use crate::master::axis_unit::AxisUnit;
use crate::master::coupling::{Gear, followed_place_mm};

/// A spindle that lags no more than this behind its axis when the drives come on again makes up for it before anything else moves.
const CATCH_UP_TURNS: f64 = 1.0;

impl<D: Drives> Master<D> {
    /// Where spindle and axis stand now, the gear between them begins.
    pub(super) fn couple(&mut self, event: &ProgramEvent) {
        if EventCode::from_wire(event.code) != Some(EventCode::SpindleCouple) {
            return;
        }
        let axis = event.index as usize;
        let Some(unit) = self.axes.get(axis) else {
            return;
        };
        let gear = Gear {
            axis,
            mm_per_turn: match self.auxiliary.latches.direction {
                2 => -event.value,
                _ => event.value,
            },
            turns: self.auxiliary.shown.spindle_turns,
            place_mm: unit.commanded_mm(),
        };
        if gear.is_sound(self.axes.len()) {
            self.auxiliary.latches.couple(&gear);
        }
    }

    /// A spindle in step: its speed for the next scan, from where the axis is and what it will do. After a trip it follows the axis
    /// until that stands.
    pub(in crate::master) fn follow_with_spindle(&mut self) {
        let gear = self.auxiliary.latches.gear();
        let gear = gear.filter(|gear| gear.is_sound(self.axes.len()));
        let axis = gear.and_then(|gear| Some((gear, self.axes.get(gear.axis)?)));
        let motion = axis.and_then(|(gear, unit)| Some((gear, self.followed_motion(&gear, unit)?)));
        let Some((gear, (place_mm, velocity_mm_s))) = motion else {
            self.auxiliary.followed = None;
            self.auxiliary.catches_up = true;
            return;
        };
        let turns = self.auxiliary.shown.spindle_turns;
        let coupling = self.auxiliary.coupling;
        let followed = coupling.follow(&gear, place_mm, velocity_mm_s, turns);
        self.auxiliary.followed = Some(followed);
        let tripped = self.mode() == Mode::Tripped;
        self.auxiliary.catches_up &= followed.lost;
        self.auxiliary.catches_up |= tripped;
        // Of drives that braked each by itself the spindle is out of step by less than a turn: it would trip again and again.
        let reaches = followed.rpm != 0.0 && followed.lag_turns.abs() <= CATCH_UP_TURNS;
        let catches_up = self.auxiliary.catches_up && reaches;
        if followed.lost && !tripped && !catches_up {
            self.trip(Cause::Spindle, u32::MAX);
        }
    }

    /// Place of an axis that is followed, in mm, and its speed in the next scan, in mm/s; none where nothing is followed.
    fn followed_motion(&self, gear: &Gear, unit: &AxisUnit) -> Option<(f64, f64)> {
        let stand = self.axes.stand() && self.auxiliary.stands();
        match self.mode() {
            Mode::Enabled | Mode::Stopping => {
                let in_scan = |scan: u64| {
                    let increments = *self.windows.positions(scan)?.get(gear.axis)?;
                    Some(increments as f64 * unit.settings.increment_mm())
                };
                let now_mm = in_scan(self.scan + 1).unwrap_or(unit.commanded_mm());
                let next_mm = in_scan(self.scan + 2).unwrap_or(now_mm);
                let near_um = unit.settings.in_position_window_um();
                let place_mm = followed_place_mm(now_mm, unit.place_mm(), near_um * 1e-3);
                Some((place_mm, (next_mm - now_mm) / self.timing.scan_period_s))
            }
            Mode::Tripped if self.auxiliary.followed.is_some() && !stand => {
                Some((unit.place_mm(), unit.drive().velocity_mm_s))
            }
            _ => None,
        }
    }
}
