//! What a run of a program begins with beside parameters and tools: the tool in the spindle, the offset that is applied, the modes in force.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::settings_file::SettingsFileError;
use crate::tool_table::OFFSET_LETTERS;
use crate::tools_file::TOOL_NUMBER_MAX;

/// Name of the file beside a machine file that holds the tool in the spindle over an end of the cell.
pub const SPINDLE_FILE: &str = "spindle.toml";

/// The modes that M2 and M30 leave, and `reset` (LinuxCNC, `Interp::convert_stop`): all others stay, as do S, units and the offset of the tool.
pub const MODES_OF_END: &str = "G1 G17 G40 G54 G90 G94 G97";

/// Longest offset of a tool, in mm or degrees.
const OFFSET_MAX: f64 = 100_000.0;
/// Longest text of modes: a block.
const MODES_BYTES_MAX: usize = 255;

/// The state of the machine beside its axes that a run begins with.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Beginning {
    /// Number of the tool in the spindle; 0 for none.
    pub tool: u32,
    /// Number of the tool whose offset is applied (G43); 0 for none, or an offset of the program's own (G43.1).
    #[serde(skip_serializing_if = "is_none")]
    pub offset_of: u32,
    /// The offset that is applied, by letter, in mm and degrees; a letter that is not there is 0.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub offset: BTreeMap<String, f64>,
    /// The modes in force, and what turns and flows, as the words of a block; none where they are those of a cell that has just started.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub modes: String,
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde asks for a reference"
)]
fn is_none(number: &u32) -> bool {
    *number == 0
}

impl Beginning {
    /// Reads a text that [`Beginning::text`] has made, or a person; `name` is in the messages.
    ///
    /// # Errors
    /// What is no number of a tool, no letter of an axis, or no block.
    pub fn parse(name: &str, text: &str) -> Result<Beginning, SettingsFileError> {
        let wrong = |what: String| SettingsFileError::Unreadable {
            path: name.to_owned(),
            what,
        };
        let read: Beginning =
            toml::from_str(text).map_err(|error| wrong(error.message().to_owned()))?;
        for (key, number) in [("tool", read.tool), ("offset_of", read.offset_of)] {
            if number > TOOL_NUMBER_MAX {
                let right = format!("a whole number from 0 to {TOOL_NUMBER_MAX}");
                return Err(wrong(format!("{key} = {number}: {right}")));
            }
        }
        for (letter, value) in &read.offset {
            let is_axis = letter.len() == 1 && OFFSET_LETTERS.contains(letter.as_str());
            if !is_axis || !(-OFFSET_MAX..=OFFSET_MAX).contains(value) {
                let right = "a letter of X Y Z A B C U V W, and mm or degrees within 100000";
                return Err(wrong(format!("offset.{letter} = {value}: {right}")));
            }
        }
        let is_block = read.modes.len() <= MODES_BYTES_MAX && !read.modes.contains(['\n', '\r']);
        if !is_block {
            return Err(wrong("modes: the words of one block".to_owned()));
        }
        Ok(read)
    }

    /// It as a text; empty where nothing is in the spindle, applied or in force.
    pub fn text(&self) -> String {
        match *self == Beginning::default() {
            true => String::new(),
            false => toml::to_string(self).unwrap_or_default(),
        }
    }

    /// Whether the spindle turns.
    pub fn spindle_turns(&self) -> bool {
        let mut words = self.modes.split_whitespace();
        words.any(|word| ["M3", "M4"].contains(&word))
    }

    /// The offset along each letter of X Y Z A B C U V W, in mm and degrees.
    pub fn offset_by_letter(&self) -> [f64; 9] {
        let mut all = [0.0; 9];
        for (slot, letter) in all.iter_mut().zip(OFFSET_LETTERS.chars()) {
            *slot = self.offset.get(&letter.to_string()).copied().unwrap_or(0.0);
        }
        all
    }
}

/// The text of the file that holds the tool in the spindle.
pub(crate) fn spindle_file_text(tool: u32) -> String {
    format!(
        "# The tool in the spindle, as the cell left it: written at each change of tool (M6, M61).\ntool = {tool}\n"
    )
}

/// The tool that such a file names, as a text.
///
/// # Errors
/// It names more, or no tool.
pub(crate) fn parse_spindle_file(path: &Path, text: &str) -> Result<Beginning, SettingsFileError> {
    let name = path.display().to_string();
    let read = Beginning::parse(&name, text)?;
    match read.tool {
        tool if read
            == (Beginning {
                tool,
                ..Beginning::default()
            }) =>
        {
            Ok(read)
        }
        _ => Err(SettingsFileError::Unreadable {
            path: name,
            what: "holds the tool in the spindle alone: `tool = 3`".to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back_and_nothing_is_no_text() {
        let all = Beginning {
            tool: 3,
            offset_of: 3,
            offset: BTreeMap::from([("X".into(), -0.125), ("Z".into(), 75.3)]),
            modes: "G1 G17 G91 F600".into(),
        };
        for beginning in [Beginning::default(), all] {
            let read = Beginning::parse("here", &beginning.text()).unwrap();
            assert_eq!(read, beginning);
        }
        assert_eq!(Beginning::default().text(), "");
    }

    #[test]
    fn what_no_machine_begins_with_is_refused() {
        for wrong in [
            "tool = -1",
            "tool = 1e9",
            "tool = 100000",
            "tol = 3",
            "[offset]\nQ = 1.0",
            "[offset]\nZ = nan",
            "modes = \"G1\\nG0 X5\"",
        ] {
            assert!(Beginning::parse("here", wrong).is_err(), "{wrong}");
        }
        let file = Path::new("spindle.toml");
        assert_eq!(
            parse_spindle_file(file, &spindle_file_text(7))
                .unwrap()
                .tool,
            7
        );
        assert!(parse_spindle_file(file, "tool = 3\nmodes = \"G91\"").is_err());
    }
}
