//! What parameters are worth: those that were set, and those that tell of the state (LinuxCNC manual, *Predefined Named
//! Parameters*, *System Parameters*).

use super::*;
use crate::parameters::check_settable;

impl Lookup for Interpreter {
    fn numbered(&self, number: u32) -> Result<f64, Refusal> {
        if (base::POSITION..base::POSITION + 9).contains(&number) {
            return Ok(self.position_of((number - base::POSITION) as usize));
        }
        // Where the state is not known, no number is missing.
        match self.parameters.read(number) {
            Err(_) if !self.state_known => Ok(0.0),
            read => read,
        }
    }

    fn named(&self, name: &str) -> Option<f64> {
        let value = if name.starts_with('_') {
            self.parameters
                .named(name)
                .or_else(|| self.predefined(name))
        } else {
            self.frames.current().named.get(name).copied()
        };
        // Where the state is not known, no name is missing.
        value.or((!self.state_known).then_some(0.0))
    }

    fn check_settable(&self, target: &Target) -> Result<(), Refusal> {
        match target {
            Target::Numbered(number) => check_settable(*number),
            // LinuxCNC has no such names.
            Target::Named(name) if matches!(name.as_str(), "_control_mode" | "_path_control") => {
                Ok(())
            }
            Target::Named(name) if name.starts_with('_') && self.predefined(name).is_some() => {
                let right = "it tells of the machine; a name of your own, such as #<_depth>";
                refuse(0, format!("#<{name}>, which is read-only"), right)
            }
            Target::Named(_) => Ok(()),
        }
    }
}

impl Interpreter {
    /// Where the tool is along a letter of [`AXIS_LETTERS`], in the coordinates and unit of the program.
    fn position_of(&self, letter: usize) -> f64 {
        let index = AXIS_LETTERS
            .chars()
            .nth(letter)
            .and_then(|letter| self.setup.axis_index(letter));
        let Some(index) = index else { return 0.0 };
        let value = self
            .in_program(&self.position)
            .get(index)
            .copied()
            .unwrap_or(0.0);
        value / self.unit_of(index)
    }

    /// Writes the position into its parameters.
    pub(super) fn show_position_parameters(&mut self) {
        for letter in 0..9 {
            let value = self.position_of(letter);
            self.parameters.set(base::POSITION + letter as u32, value);
        }
    }

    fn predefined(&self, name: &str) -> Option<f64> {
        let is = |truth: bool| f64::from(u8::from(truth));
        let code = |number: u32| f64::from(number) / 10.0;
        Some(match name {
            "_x" | "_y" | "_z" | "_a" | "_b" | "_c" | "_u" | "_v" | "_w" => {
                let letter = name.chars().nth(1)?.to_ascii_uppercase();
                self.position_of(AXIS_LETTERS.find(letter)?)
            }
            "_line" => f64::from(self.line),
            "_ijk_absolute_mode" => is(self.modes.arc_absolute),
            "_adaptive_feed" => 0.0,
            "_feed_hold" => 1.0,
            "_metric" => is(!self.modes.inches),
            "_imperial" => is(self.modes.inches),
            "_absolute" => is(!self.modes.incremental),
            "_incremental" => is(self.modes.incremental),
            "_inverse_time" => is(self.modes.feed_mode == FeedMode::InverseTime),
            "_units_per_minute" => is(self.modes.feed_mode == FeedMode::PerMinute),
            "_units_per_rev" => is(self.modes.feed_mode == FeedMode::PerRevolution),
            "_lathe_diameter_mode" => is(self.modes.diameters),
            "_lathe_radius_mode" => is(!self.modes.diameters),
            "_feed" => self.modes.feed.map_or(0.0, |feed| feed.value),
            "_rpm" => self.modes.spindle.speed,
            "_spindle_on" => is(self.modes.spindle.direction != 0),
            "_spindle_cw" => is(self.modes.spindle.direction > 0),
            "_spindle_css_mode" => is(self.modes.surface.is_some()),
            "_spindle_rpm_mode" => is(self.modes.surface.is_none()),
            "_mist" => is(self.modes.coolant[0]),
            "_flood" => is(self.modes.coolant[1]),
            "_feed_override" => is(self.modes.feed_override),
            "_speed_override" => is(self.modes.spindle_override),
            "_current_tool" => f64::from(self.tool.number),
            "_selected_tool" => self.tool.prepared.map_or(-1.0, f64::from),
            "_selected_pocket" => {
                let tool = self.tool.prepared.and_then(|number| self.tool_of(number));
                tool.map_or(-1.0, |tool| f64::from(tool.pocket))
            }
            "_current_pocket" => self
                .tool_of(self.tool.number)
                .map_or(0.0, |tool| f64::from(tool.pocket)),
            "_coord_system" => match self.parameters.get(base::WORK_OFFSET) {
                system if system <= 6.0 => 530.0 + 10.0 * system,
                system => 590.0 + (system - 6.0),
            },
            "_plane" => f64::from(self.modes.plane.0) * 10.0,
            "_motion_mode" => self.motion_mode(),
            "_ccomp" => f64::from(self.compensation_code()),
            "_tool_offset" => is(self.applies_offset()),
            "_retract_r_plane" => is(self.modes.returns_to_r),
            "_retract_old_z" => is(!self.modes.returns_to_r),
            "_call_level" => self.frames.depth() as f64,
            "_remap_level" | "_task" => 0.0,
            "_value" => self.returned.0,
            "_value_returned" => is(self.returned.1),
            "_vmajor" => 2.9,
            "_vminor" => 0.0,
            "_control_mode" | "_path_control" => code(self.modes.path_control),
            _ => {
                return name
                    .strip_prefix("_abs_")
                    .and_then(|of| self.machine_place(of));
            }
        })
    }

    /// Ten times the code of the motion in force.
    pub(super) fn motion_mode(&self) -> f64 {
        match self.motion {
            Motion::None => 800.0,
            Motion::Rapid => 0.0,
            Motion::Line => 10.0,
            Motion::Arc { clockwise: true } => 20.0,
            Motion::Arc { clockwise: false } => 30.0,
            Motion::Probe(number) => f64::from(number),
            Motion::Cycle(cycle) => f64::from(cycle as u32),
            Motion::Spline(spline) => f64::from(spline as u32),
            Motion::InStep(motion) => f64::from(motion as u32),
        }
    }

    /// Where the tool is along an axis of this letter, in the coordinates of the machine; 0 where it has none.
    fn machine_place(&self, letter: &str) -> Option<f64> {
        let letter = letter.to_ascii_uppercase();
        let letter = letter.chars().next().filter(|_| letter.len() == 1)?;
        AXIS_LETTERS.find(letter)?;
        let index = self.setup.axis_index(letter);
        let place = index.and_then(|index| Some((index, self.position.get(index)?)));
        Some(place.map_or(0.0, |(index, place)| place / self.unit_of(index)))
    }
}
