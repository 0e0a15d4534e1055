//! Tools: T, M6, M61, and the length that G43 takes off.

use super::*;
use crate::reader::Word;

impl Interpreter {
    pub(super) fn tool_of(&self, number: u32) -> Option<&Tool> {
        self.tools.iter().find(|tool| tool.number == number)
    }

    /// Refuses a tool that the table does not have.
    fn check_tool(&self, number: u32, offset: usize, found: String) -> Result<(), Refusal> {
        if number == 0 || self.tools.is_empty() || self.tool_of(number).is_some() {
            return Ok(());
        }
        let known = self.tools.iter().map(|tool| tool.number.to_string());
        let known: Vec<String> = known.collect();
        let right = format!("the tool table has {}", known.join(" "));
        refuse(offset, found, right)
    }

    pub(super) fn prepare_tool(&mut self, line: u32, word: Word) -> Result<(), Refusal> {
        let number = word.value as u32;
        self.check_tool(number, word.offset, format!("T{number}"))?;
        self.tool.prepared = Some(number);
        self.event(line, EventKind::ToolPrepare(number));
        Ok(())
    }

    /// M6 and M61.
    pub(super) fn change_tool(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::ToolChange) else {
            return Ok(());
        };
        if number == 60 {
            let Some(tool) = self.tool.prepared else {
                return refuse(word.offset, "M6 without T", "the tool, such as T1 M6");
            };
            self.tool.number = tool;
            // With the same tool nothing is changed on the machine, but the spindle stands all the same.
            if self.modes.spindle.direction != 0 {
                self.turn_spindle(line, 0);
            }
            self.event(line, EventKind::ToolChange(tool));
        } else {
            let is_number = |q: &Word| q.value >= 0.0 && q.value.fract() == 0.0;
            let Some(q) = words.value('Q').filter(is_number) else {
                let right = "the tool that is in the spindle, such as M61 Q3";
                return refuse(word.offset, "M61 without Q", right);
            };
            self.check_tool(q.value as u32, q.offset, q.to_string())?;
            self.tool.number = q.value as u32;
            self.event(line, EventKind::ToolIs(self.tool.number));
        }
        self.show_tool_parameters();
        Ok(())
    }

    /// The tool and the offset that a run begins with.
    pub(super) fn begin_with_tool(&mut self) {
        let setup = Arc::clone(&self.setup);
        self.tool.number = setup.beginning.tool;
        self.tool.offset_of = setup.beginning.offset_of;
        self.offsets.tool = self.by_axis(&setup.beginning.offset_by_letter());
        self.show_tool_parameters();
        self.show_applied_offset();
        self.refresh_zero();
    }

    /// Applies another offset of the tool, that of tool `of`, or none's.
    pub(super) fn apply_offset(&mut self, line: u32, offset: AxisVector, of: u32) {
        if of != self.tool.offset_of {
            self.event(line, EventKind::ToolOffsetOf(of));
        }
        let before = self.offsets.tool;
        for (axis, (value, before)) in (0..).zip(offset.iter().copied().zip(&before)) {
            if value != *before {
                self.event(line, EventKind::ToolOffset { axis, value });
            }
        }
        self.tool.offset_of = of;
        self.offsets.tool = offset;
        self.show_applied_offset();
        self.refresh_zero();
    }

    /// The parameters that tell of the offset that is applied (LinuxCNC 2.10, `Interp::convert_tool_length_offset`).
    fn show_applied_offset(&mut self) {
        self.set_vector(base::APPLIED, self.offsets.tool);
    }

    /// The parameters that tell of the tool in the spindle.
    fn show_tool_parameters(&mut self) {
        let tool = self.tool_of(self.tool.number).cloned().unwrap_or_default();
        let angles = [
            tool.diameter,
            tool.front_angle_deg,
            tool.back_angle_deg,
            f64::from(tool.orientation),
        ];
        let values = [f64::from(self.tool.number)]
            .into_iter()
            .chain(tool.offset)
            .chain(angles);
        for (number, value) in (base::TOOL..).zip(values) {
            self.parameters.set(number, value);
        }
    }

    /// Offsets by letter, by axis.
    fn by_axis(&self, offset: &[f64; 9]) -> AxisVector {
        let mut vector = AxisVector::zeros();
        for (component, axis) in vector.iter_mut().zip(&self.setup.axes) {
            let at = AXIS_LETTERS.find(axis.letter);
            *component = at.and_then(|at| offset.get(at)).copied().unwrap_or(0.0);
        }
        vector
    }

    /// G43, G43.1, G43.2, G49.
    pub(super) fn tool_length(&mut self, line: u32, words: &mut Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::ToolLength) else {
            return Ok(());
        };
        let before = self.offsets.tool;
        let (offset, of) = match number {
            490 => (AxisVector::zeros(), 0),
            431 => {
                let offset = self.with_words(words, before);
                words.remove(AXIS_LETTERS);
                (offset, 0)
            }
            430 => self.tool_of_h(line, words, word.offset)?,
            _ => (
                before + self.tool_of_h(line, words, word.offset)?.0,
                self.tool.offset_of,
            ),
        };
        self.apply_offset(line, offset, of);
        // Cycles in a row return with the tip of the tool to where it was before them.
        if let Some(series) = &mut self.series {
            let longer = offset - before;
            series.initial_mm += longer.get(series.drill_axis).copied().unwrap_or(0.0);
        }
        Ok(())
    }

    /// The offset of the tool that H names, or of the one in the spindle, and its number.
    fn tool_of_h(
        &mut self,
        line: u32,
        words: &Words,
        offset: usize,
    ) -> Result<(AxisVector, u32), Refusal> {
        let (number, place) = match words.value('H') {
            Some(h) if h.value > 0.0 => (h.value as u32, h.offset),
            _ => (self.tool.number, offset),
        };
        if let Some(tool) = self.tool_of(number) {
            return Ok((self.by_axis(&tool.offset), number));
        }
        if self.tools.is_empty() {
            self.note(line, "G43: there is no tool table, so tools have no length; name one in the machine file: [program] tool_table");
            return Ok((AxisVector::zeros(), number));
        }
        if number == 0 {
            self.note(line, "G43 without a tool in the spindle: nothing is taken off, as with G49 (T and M6 before it, or H, say which tool is meant)");
            return Ok((AxisVector::zeros(), 0));
        }
        self.check_tool(number, place, format!("G43 H{number}"))?;
        Ok((AxisVector::zeros(), number))
    }

    /// G10 L1, L10 and L11: changes what the table says of a tool.
    pub(super) fn set_tool(
        &mut self,
        words: &Words,
        how: u32,
        offset: usize,
    ) -> Result<(), Refusal> {
        let number = words.value('P').map_or(-1.0, |p| p.value);
        let known = number >= 0.0 && number.fract() == 0.0 && self.tool_of(number as u32).is_some();
        if !known {
            let found = format!("G10 L{how} P{number}");
            let right = "the number of a tool of the tool table";
            return refuse(words.place('P', offset), found, right);
        }
        let place = self.place_without_tool(how);
        let mut changed = self.tool_of(number as u32).cloned().unwrap_or_default();
        for (index, (axis, here)) in self.setup.axes.iter().zip(&place).enumerate() {
            let slot = AXIS_LETTERS.find(axis.letter);
            let slot = slot.and_then(|at| changed.offset.get_mut(at));
            if let (Some(slot), Some(value)) = (slot, self.axis_value(words, index)) {
                *slot = if how == 1 { value } else { here - value };
            }
        }
        if let Some(r) = words.value('R') {
            changed.diameter = 2.0 * r.value * self.unit_mm();
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
        let is_in_spindle = changed.number == self.tool.number;
        for tool in Arc::make_mut(&mut self.tools) {
            if tool.number == changed.number {
                *tool = changed.clone();
            }
        }
        if is_in_spindle {
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
        offsets.turned_back(self.position - offsets.work) - offsets.g92
    }
}
