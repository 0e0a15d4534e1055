//! The words that begin a cutter radius compensation: G41, G42, G41.1 and G42.1.

use super::{Acts, Cause, Refusal, State, refuse};
use crate::codes::shown_code;
use crate::compensation::{Side, Start};

impl State {
    /// The compensation that a code begins; none where no tool has a radius.
    pub fn radius_words(
        &self,
        cause: Cause,
        number: u32,
        acts: &mut Acts,
    ) -> Result<Option<Start>, Refusal> {
        let code = shown_code(number);
        let Some((radius_mm, orientation)) = self.tool_radius(cause, number, acts)? else {
            return Ok(None);
        };
        let (plane, _, _) = self.in_force.plane;
        if plane == 19 {
            let right = "the radius compensation works in G17 and G18";
            return cause.refuse(format!("G{code} in G19"), right);
        }
        if plane != 18 && !matches!(orientation, 0 | 9) {
            let found = format!("G{code} with a turning tool in G17");
            let right = "a tool with an orientation (Q in the tool table) cuts in G18";
            return cause.refuse(found, right);
        }
        if plane == 18 && self.offsets.is_turned() {
            let found = format!("G{code} in G18 with a turned work offset");
            let right = "a work offset without R: G10 L2 P1 R0";
            return cause.refuse(found, right);
        }
        let axes = self.plane_axes(cause.offset)?;
        // A diameter below 0 is one on the other side.
        let left = matches!(number, 410 | 411) != (radius_mm < 0.0);
        let start = Start {
            side: if left { Side::Left } else { Side::Right },
            radius_mm: radius_mm.abs(),
            plane: axes,
            across: self
                .equipment
                .axis_index(if plane == 18 { 'Y' } else { 'Z' }),
            tip: Start::tip_of_orientation(orientation),
        };
        Ok(Some(start).filter(|_| radius_mm != 0.0))
    }

    /// Radius in mm and orientation of the tool that the block names; none where no tool has a radius.
    fn tool_radius(
        &self,
        cause: Cause,
        number: u32,
        acts: &mut Acts,
    ) -> Result<Option<(f64, u32)>, Refusal> {
        let code = shown_code(number);
        let d = cause.words.value('D');
        if matches!(number, 411 | 421) {
            let Some(diameter_mm) = self.length_mm(cause.words, 'D') else {
                let right = "the diameter of the tool, such as G41.1 D6";
                return cause.refuse(format!("G{code} without D"), right);
            };
            let orientation = match cause.words.value('L') {
                None => 0,
                Some(l) if self.in_force.plane.0 == 18 && (0.0..=9.0).contains(&l.value) => {
                    l.value as u32
                }
                Some(l) => {
                    let right = "L is the orientation of a turning tool, 0 to 9, in G18";
                    return refuse(l.offset, format!("G{code} {l}"), right);
                }
            };
            return Ok(Some((diameter_mm / 2.0, orientation)));
        }
        if let Some(d) = d.filter(|d| d.value < 0.0 || d.value.fract() != 0.0) {
            let right = "D is the number of a tool; G41.1 and G42.1 take a diameter";
            return refuse(d.offset, format!("G{code} {d}"), right);
        }
        let named = d.map_or(0.0, |d| d.value) as u32;
        let number = if named == 0 {
            self.tools.in_spindle
        } else {
            named
        };
        if let Some(tool) = self.tools.find(number) {
            return Ok(Some((tool.diameter / 2.0, tool.orientation)));
        }
        if named == 0 && self.equipment.answers_assumed {
            acts.note("G41 or G42 without a tool that has a radius: the tool's centre follows the programmed path");
            return Ok(None);
        }
        let found = format!("G{code} with a tool whose radius nobody knows");
        let right = "name a tool table in the machine file ([program] tool_table), or write the diameter: G41.1 D6";
        refuse(cause.place('D'), found, right)
    }
}
