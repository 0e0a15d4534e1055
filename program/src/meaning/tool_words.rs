//! Words that change tools: M6, M61, the length that G43 takes off, and what G10 writes into the table.

use super::{Acts, AxisVector, Cause, EventKind, Group, Refusal, State, Words, base, refuse};
use crate::letters::AXIS_LETTERS;

impl State {
    /// The tool and the offset that a run begins with.
    pub(super) fn begin_with_tool(&mut self) {
        let nine = self.equipment.beginning.offset_by_letter();
        self.offsets.set_tool(self.equipment.by_axis(&nine));
        self.show_tool_parameters();
        self.show_applied_offset();
    }

    /// M6 and M61.
    pub(super) fn change_tool(&mut self, words: &Words, acts: &mut Acts) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::ToolChange) else {
            return Ok(());
        };
        if number == 60 {
            let tool = self.tools.change(word)?;
            // With the same tool nothing is changed on the machine, but the spindle stands all the same.
            if self.in_force.spindle.direction != 0 {
                self.in_force.turn_spindle(0, acts);
            }
            acts.event(EventKind::ToolChange(tool));
        } else {
            self.tools.set(word, words.value('Q'), acts)?;
        }
        self.show_tool_parameters();
        Ok(())
    }

    /// Whether an offset of a tool is applied, also one of 0.
    pub fn applies_offset(&self) -> bool {
        self.tools.offset_of != 0 || *self.offsets.tool() != AxisVector::zeros()
    }

    /// Applies another offset of the tool, that of tool `of`, or none's.
    pub(super) fn apply_offset(&mut self, offset: AxisVector, of: u32, acts: &mut Acts) {
        self.end_tool_centre();
        self.tools.apply_offset_of(of, acts);
        let before = *self.offsets.tool();
        for (axis, (value, before)) in (0..).zip(offset.iter().copied().zip(&before)) {
            if value != *before {
                acts.event(EventKind::ToolOffset { axis, value });
            }
        }
        self.offsets.set_tool(offset);
        self.show_applied_offset();
    }

    /// The parameters that tell of the offset that is applied (LinuxCNC 2.10, `Interp::convert_tool_length_offset`).
    fn show_applied_offset(&mut self) {
        self.set_vector(base::APPLIED, *self.offsets.tool());
    }

    /// The parameters that tell of the tool in the spindle.
    fn show_tool_parameters(&mut self) {
        let number = self.tools.in_spindle;
        let tool = self.tools.find(number).cloned().unwrap_or_default();
        let angles = [
            tool.diameter,
            tool.front_angle_deg,
            tool.back_angle_deg,
            f64::from(tool.orientation),
        ];
        let values = [f64::from(number)]
            .into_iter()
            .chain(tool.offset)
            .chain(angles);
        for (number, value) in (base::TOOL..).zip(values) {
            self.parameters.set(number, value);
        }
    }

    /// G43, G43.1, G43.2, G43.4, G49.
    pub fn tool_length(&mut self, words: &mut Words, acts: &mut Acts) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::ToolLength) else {
            return Ok(());
        };
        let before = *self.offsets.tool();
        let (offset, of) = match number {
            490 => (AxisVector::zeros(), 0),
            // In a tilted plane the length of the tool lies along the tool.
            430 if self.plane.is_none() => self.tool_of_h(words, word.offset, acts)?,
            430 | 434 => {
                let (offset, of) = self.tool_of_h(words, word.offset, acts)?;
                self.apply_offset(offset, of, acts);
                return self.begin_tool_centre(word);
            }
            431 | 432 if self.plane.is_some() => {
                let right = "in a tilted plane G43 takes the length of a tool; G69 ends it";
                return word.refuse(right);
            }
            431 => {
                let offset = self.with_words(words, before);
                words.remove(AXIS_LETTERS);
                (offset, 0)
            }
            _ => {
                let (more, _) = self.tool_of_h(words, word.offset, acts)?;
                (before + more, self.tools.offset_of)
            }
        };
        self.apply_offset(offset, of, acts);
        Ok(())
    }

    /// The offset of the tool that H names, or of the one in the spindle, and its number.
    fn tool_of_h(
        &self,
        words: &Words,
        offset: usize,
        acts: &mut Acts,
    ) -> Result<(AxisVector, u32), Refusal> {
        let (number, place) = match words.value('H') {
            Some(h) if h.value > 0.0 => (h.value as u32, h.offset),
            _ => (self.tools.in_spindle, offset),
        };
        if let Some(tool) = self.tools.find(number) {
            return Ok((self.equipment.by_axis(&tool.offset), number));
        }
        if self.tools.table.is_empty() {
            acts.note("G43: there is no tool table, so tools have no length; name one in the machine file: [program] tool_table");
        } else if number == 0 {
            acts.note("G43 without a tool in the spindle: nothing is taken off, as with G49 (T and M6 before it, or H, say which tool is meant)");
        } else {
            self.tools.check(number, place, format!("G43 H{number}"))?;
        }
        Ok((AxisVector::zeros(), number))
    }

    /// G10 L1, L10 and L11: changes what the table says of a tool.
    pub(super) fn set_tool(&mut self, cause: Cause, how: u32) -> Result<(), Refusal> {
        let words = cause.words;
        let number = words.value('P').map_or(-1.0, |p| p.value);
        let is_number = number >= 0.0 && number.fract() == 0.0;
        let known = self.tools.find(number as u32).filter(|_| is_number);
        let Some(mut changed) = known.cloned() else {
            let found = format!("G10 L{how} P{number}");
            let right = "the number of a tool of the tool table";
            return refuse(cause.place('P'), found, right);
        };
        let place = self.place_without_tool(how);
        for (index, here) in place.iter().enumerate() {
            let slot = self.equipment.place_in_nine(index);
            let slot = slot.and_then(|at| changed.offset.get_mut(at));
            if let (Some(slot), Some(value)) = (slot, self.axis_value(words, index)) {
                *slot = if how == 1 { value } else { here - value };
            }
        }
        if let Some(r) = words.value('R') {
            changed.diameter = 2.0 * r.value * self.in_force.unit_mm();
        }
        for (letter, slot) in [
            ('I', &mut changed.front_angle_deg),
            ('J', &mut changed.back_angle_deg),
        ] {
            if let Some(word) = words.value(letter) {
                *slot = word.value;
            }
        }
        if let Some(q) = words.value('Q') {
            changed.orientation = q.value.clamp(0.0, 9.0) as u32;
        }
        self.tools.put(&changed);
        if changed.number == self.tools.in_spindle {
            self.show_tool_parameters();
        }
        Ok(())
    }

    /// Length along Z, or radius, of a tool of the table, in mm.
    pub fn tool_value(&self, number: u32, is_radius: bool) -> Result<f64, Refusal> {
        let Some(tool) = self.tools.find(number) else {
            return no_tool(number);
        };
        Ok(match is_radius {
            true => tool.diameter / 2.0,
            false => tool.offset.get(2).copied().unwrap_or(0.0),
        })
    }

    /// Sets length along Z, or radius, of a tool of the table, to a value in the unit of the program.
    pub fn set_tool_value(
        &mut self,
        number: u32,
        is_radius: bool,
        value: f64,
    ) -> Result<(), Refusal> {
        let Some(mut changed) = self.tools.find(number).cloned() else {
            return no_tool(number);
        };
        let value_mm = value * self.in_force.unit_mm();
        if is_radius {
            changed.diameter = 2.0 * value_mm;
        } else if let Some(z) = changed.offset.get_mut(2) {
            *z = value_mm;
        }
        self.tools.put(&changed);
        if number == self.tools.in_spindle {
            self.show_tool_parameters();
        }
        Ok(())
    }

    /// Where the machine is, counted from the work offset in force (L10) or from G59.3 (L11), as if no tool had a length.
    fn place_without_tool(&self, how: u32) -> AxisVector {
        if how == 11 {
            return self.position - self.vector_of(base::G54 + 160);
        }
        let offsets = &self.offsets;
        offsets.turned_back(self.position - offsets.work()) - offsets.g92()
    }
}

/// Refuses a tool that the table does not have.
fn no_tool<T>(number: u32) -> Result<T, Refusal> {
    let right = "the number of a tool of the tool table";
    refuse(
        0,
        format!("an offset of tool {number}, which the tool table does not have"),
        right,
    )
}
