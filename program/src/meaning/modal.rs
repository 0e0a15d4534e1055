//! What an operator reads of the state of a program: codes in force, offsets, F, S, T.

use std::sync::Arc;

use path::tool_centre::ToolCentre;

use super::{AxisVector, Offsets, State, base};
use crate::tilted_plane::TiltedPlane;

/// The state of a program at a block, as an operator reads it.
#[derive(Debug, Clone, PartialEq)]
pub struct Modal {
    /// Codes in force, such as G1 G17 G90.
    pub codes: Vec<String>,
    /// Index of the work offset in force: 0 is G54.
    pub work_offset: usize,
    /// F as the program has it, in its unit.
    pub feed: Option<f64>,
    /// S as the program has it: rev/min, in G96 m/min or feet/min.
    pub speed: f64,
    /// The tool in the spindle; 0 for none.
    pub tool: u32,
    offsets: Offsets,
    /// How rotary axes turn tool and work, while the tool's centre point is controlled.
    tool_centre: Option<Arc<ToolCentre>>,
    /// The plane of G68.2, if that counts.
    plane: Option<TiltedPlane>,
}

impl Modal {
    /// A place of the machine in the coordinates of the program, with this offset of the tool applied, in mm and degrees.
    pub fn in_program(&self, place: &AxisVector, tool_offset: &AxisVector) -> AxisVector {
        let place = place - tool_offset + self.offsets.tool();
        let tip = self.tool_centre.as_ref();
        let tip = tip.map(|of| of.programmed(&place, self.offsets.tool()));
        let place = tip.unwrap_or(place);
        let in_plane = self.plane.as_ref();
        let in_plane = in_plane.map(|of| of.in_plane(&place, self.offsets.zero()));
        self.offsets.in_program(&in_plane.unwrap_or(place))
    }

    /// The other way round.
    pub fn in_machine(&self, place: &AxisVector, tool_offset: &AxisVector) -> AxisVector {
        let place = self.offsets.in_machine(place);
        let on_work = self.plane.as_ref();
        let on_work = on_work.map(|of| of.on_work(&place, self.offsets.zero()));
        let place = on_work.unwrap_or(place);
        let axes = self.tool_centre.as_ref();
        let axes = axes.map(|of| of.axes(&place, self.offsets.tool()));
        axes.unwrap_or(place) - self.offsets.tool() + tool_offset
    }

    /// What the length of the tool takes off, in mm and degrees.
    pub fn tool_length(&self) -> AxisVector {
        *self.offsets.tool()
    }
}

/// A code by ten times its number.
fn shown(letter: char, tenfold: f64) -> String {
    format!("{letter}{}", tenfold / 10.0)
}

impl State {
    /// The state as an operator reads it, with ten times the code of the radius compensation.
    pub fn modal(&self, compensation_code: u32) -> Modal {
        let either = |first: bool, yes: &str, no: &str| if first { yes } else { no }.to_owned();
        let modes = &self.in_force;
        let system = self.work_offset();
        let offset = machine::offsets_file::WORK_OFFSETS.get(system);
        let mut codes = vec![
            shown('G', modes.motion_code()),
            shown('G', f64::from(modes.plane.0) * 10.0),
            either(modes.inches, "G20", "G21"),
            shown('G', f64::from(compensation_code)),
            match self.tool_centre() {
                Some(_) => "G43.4".to_owned(),
                None => either(self.applies_offset(), "G43", "G49"),
            },
            match self.more_work {
                Some(number) => format!("G54.1 P{number}"),
                None => offset.copied().unwrap_or("G54").to_owned(),
            },
            shown('G', f64::from(modes.path_control)),
            either(modes.incremental, "G91", "G90"),
            modes.feed_mode.to_string(),
            either(modes.surface.is_some(), "G96", "G97"),
            either(modes.returns_to_r, "G99", "G98"),
        ];
        if modes.diameters {
            codes.push("G7".to_owned());
        }
        if self.plane.is_some() {
            codes.push("G68.2".to_owned());
        }
        if self.offsets.is_turned_about() {
            codes.push("G68".to_owned());
        }
        if self.parameters.get(base::G92_APPLIES) != 0.0 {
            codes.push("G92".to_owned());
        }
        codes.push(match modes.spindle.direction {
            1.. => "M3".to_owned(),
            0 => "M5".to_owned(),
            _ => "M4".to_owned(),
        });
        let coolant = [("M7", modes.coolant[0]), ("M8", modes.coolant[1])];
        codes.extend(
            coolant
                .iter()
                .filter(|(_, on)| *on)
                .map(|(code, _)| (*code).to_owned()),
        );
        if modes.coolant == [false; 2] {
            codes.push("M9".to_owned());
        }
        codes.push(either(
            modes.feed_override && modes.spindle_override,
            "M48",
            "M49",
        ));
        Modal {
            codes,
            work_offset: system,
            feed: modes.feed.map(|feed| feed.value),
            speed: modes.spindle.speed,
            tool: self.tools.in_spindle,
            offsets: self.offsets,
            tool_centre: self.tool_centre().cloned(),
            plane: self.plane.filter(|_| self.controls_tool_centre()),
        }
    }
}
