//! The tools: those of the table, the one in the spindle, the next one.

use std::sync::Arc;

use machine::Tool;
use serde::{Deserialize, Serialize};

use crate::act::Acts;
use crate::program::{EventKind, Setup};
use crate::reader::Word;
use crate::refusal::{Refusal, refuse};

/// What numbers tools can have, as in the tool table.
pub const TOOL: &str = "the number of a tool is a whole number from 0 to 99999";

/// Whether a tool can have this number.
pub fn is_tool(number: f64) -> bool {
    (0.0..=99_999.0).contains(&number) && number.fract() == 0.0
}

/// The tool table, and which of its tools is where.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Tools {
    /// T: the next one.
    pub prepared: Option<u32>,
    /// The one in the spindle; 0 for none.
    pub in_spindle: u32,
    /// The one whose offset is applied; 0 where it is none's.
    pub offset_of: u32,
    /// The table, as the program has changed it.
    pub table: Arc<Vec<Tool>>,
}

impl Tools {
    /// The tools that a run begins with.
    pub fn of(setup: &Setup) -> Self {
        Self {
            prepared: None,
            in_spindle: setup.beginning.tool,
            offset_of: setup.beginning.offset_of,
            table: Arc::new(setup.tools.clone()),
        }
    }

    /// Shares the table of a fresh copy if it is the same.
    pub fn share(&mut self, fresh: &Self) {
        if self.table == fresh.table {
            self.table = Arc::clone(&fresh.table);
        }
    }

    /// The tool of a number.
    pub fn find(&self, number: u32) -> Option<&Tool> {
        self.table.iter().find(|tool| tool.number == number)
    }

    /// Refuses a tool that the table does not have.
    pub fn check(&self, number: u32, offset: usize, found: String) -> Result<(), Refusal> {
        if number == 0 || self.table.is_empty() || self.find(number).is_some() {
            return Ok(());
        }
        let known = self.table.iter().map(|tool| tool.number.to_string());
        let known: Vec<String> = known.collect();
        let right = format!("the tool table has {}", known.join(" "));
        refuse(offset, found, right)
    }

    /// T.
    pub fn prepare(&mut self, word: Word, acts: &mut Acts) -> Result<(), Refusal> {
        let number = word.value as u32;
        self.check(number, word.offset, format!("T{number}"))?;
        self.prepared = Some(number);
        acts.event(EventKind::ToolPrepare(number));
        Ok(())
    }

    /// M6: the number of the tool that comes into the spindle.
    pub fn change(&mut self, word: Word) -> Result<u32, Refusal> {
        let Some(tool) = self.prepared else {
            return refuse(word.offset, "M6 without T", "the tool, such as T1 M6");
        };
        self.in_spindle = tool;
        Ok(tool)
    }

    /// M61: the tool that is in the spindle already, by its Q.
    pub fn set(&mut self, word: Word, q: Option<Word>, acts: &mut Acts) -> Result<(), Refusal> {
        let Some(q) = q else {
            let right = "the tool that is in the spindle, such as M61 Q3";
            return refuse(word.offset, "M61 without Q", right);
        };
        if !is_tool(q.value) {
            return q.refuse(TOOL);
        }
        self.check(q.value as u32, q.offset, q.to_string())?;
        self.in_spindle = q.value as u32;
        acts.event(EventKind::ToolIs(self.in_spindle));
        Ok(())
    }

    /// The offset of another tool is applied, 0 for none's.
    pub fn apply_offset_of(&mut self, number: u32, acts: &mut Acts) {
        if number != self.offset_of {
            acts.event(EventKind::ToolOffsetOf(number));
        }
        self.offset_of = number;
    }

    /// Puts what is known of a tool in the place of what the table says.
    pub fn put(&mut self, changed: &Tool) {
        for tool in Arc::make_mut(&mut self.table) {
            if tool.number == changed.number {
                *tool = changed.clone();
            }
        }
    }
}
