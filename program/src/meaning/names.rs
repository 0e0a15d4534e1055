//! What named parameters tell of the state (LinuxCNC manual, *Predefined Named Parameters*, *System Parameters*).

use super::{State, base};
use crate::letters::AXIS_LETTERS;
use crate::state::FeedMode;

impl State {
    /// Where the tool is along a letter of [`AXIS_LETTERS`], in the coordinates and unit of the program.
    pub fn position_of(&self, letter: usize) -> f64 {
        let letter = AXIS_LETTERS.chars().nth(letter);
        let index = letter.and_then(|letter| self.equipment.axis_index(letter));
        let Some(index) = index else { return 0.0 };
        let place = self.offsets.in_program(&self.position);
        place.get(index).copied().unwrap_or(0.0) / self.unit_of(index)
    }

    /// What a name tells of the state; none for a name that tells nothing of it.
    pub fn predefined(&self, name: &str) -> Option<f64> {
        let is = |truth: bool| f64::from(u8::from(truth));
        let code = |number: u32| f64::from(number) / 10.0;
        let pocket = |number: u32| Some(f64::from(self.tools.find(number)?.pocket));
        Some(match name {
            "_x" | "_y" | "_z" | "_a" | "_b" | "_c" | "_u" | "_v" | "_w" => {
                let letter = name.chars().nth(1)?.to_ascii_uppercase();
                self.position_of(AXIS_LETTERS.find(letter)?)
            }
            "_ijk_absolute_mode" => is(self.in_force.arc_absolute),
            "_adaptive_feed" => 0.0,
            "_feed_hold" => 1.0,
            "_metric" => is(!self.in_force.inches),
            "_imperial" => is(self.in_force.inches),
            "_absolute" => is(!self.in_force.incremental),
            "_incremental" => is(self.in_force.incremental),
            "_inverse_time" => is(self.in_force.feed_mode == FeedMode::InverseTime),
            "_units_per_minute" => is(self.in_force.feed_mode == FeedMode::PerMinute),
            "_units_per_rev" => is(self.in_force.feed_mode == FeedMode::PerRevolution),
            "_lathe_diameter_mode" => is(self.in_force.diameters),
            "_lathe_radius_mode" => is(!self.in_force.diameters),
            "_feed" => self.in_force.feed.map_or(0.0, |feed| feed.value),
            "_rpm" => self.in_force.spindle.speed,
            "_spindle_on" => is(self.in_force.spindle.direction != 0),
            "_spindle_cw" => is(self.in_force.spindle.direction > 0),
            "_spindle_css_mode" => is(self.in_force.surface.is_some()),
            "_spindle_rpm_mode" => is(self.in_force.surface.is_none()),
            "_mist" => is(self.in_force.coolant[0]),
            "_flood" => is(self.in_force.coolant[1]),
            "_feed_override" => is(self.in_force.feed_override),
            "_speed_override" => is(self.in_force.spindle_override),
            "_current_tool" => f64::from(self.tools.in_spindle),
            "_selected_tool" => self.tools.prepared.map_or(-1.0, f64::from),
            "_selected_pocket" => self.tools.prepared.and_then(pocket).unwrap_or(-1.0),
            "_current_pocket" => pocket(self.tools.in_spindle).unwrap_or(0.0),
            "_coord_system" => match self.parameters.get(base::WORK_OFFSET) {
                system if system <= 6.0 => 530.0 + 10.0 * system,
                system => 590.0 + (system - 6.0),
            },
            "_plane" => f64::from(self.in_force.plane.0) * 10.0,
            "_motion_mode" => self.in_force.motion_code(),
            "_tool_offset" => is(self.applies_offset()),
            "_retract_r_plane" => is(self.in_force.returns_to_r),
            "_retract_old_z" => is(!self.in_force.returns_to_r),
            "_remap_level" | "_task" => 0.0,
            "_vmajor" => 2.9,
            "_vminor" => 0.0,
            "_control_mode" | "_path_control" => code(self.in_force.path_control),
            _ => {
                return name
                    .strip_prefix("_abs_")
                    .and_then(|of| self.machine_place(of));
            }
        })
    }

    /// Where the tool is along an axis of this letter, in the coordinates of the machine; 0 where it has none.
    fn machine_place(&self, letter: &str) -> Option<f64> {
        let letter = letter.to_ascii_uppercase();
        let letter = letter.chars().next().filter(|_| letter.len() == 1)?;
        AXIS_LETTERS.find(letter)?;
        let index = self.equipment.axis_index(letter);
        let place = index.and_then(|index| Some((index, self.position.get(index)?)));
        Some(place.map_or(0.0, |(index, place)| place / self.unit_of(index)))
    }
}
