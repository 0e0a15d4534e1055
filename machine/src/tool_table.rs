//! The tool table, in the form of LinuxCNC (manual, *Tool Table*): a line for each tool, `T1 P1 D6 Z12.5 ;end mill`.

use serde::{Deserialize, Serialize};

use crate::settings_file::SettingsFileError;

/// The letters of a tool's lengths, in the order in which they are kept.
pub const OFFSET_LETTERS: &str = "XYZABCUVW";

/// A tool.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Tool {
    /// T: its number, as programs call it.
    pub number: u32,
    /// P: its place in the magazine.
    pub pocket: u32,
    /// X Y Z A B C U V W: its length along each axis, in mm or degrees.
    pub offset: [f64; 9],
    /// D: its diameter, in mm.
    pub diameter: f64,
    /// I: front angle of a turning tool, in degrees.
    pub front_angle_deg: f64,
    /// J: back angle of a turning tool, in degrees.
    pub back_angle_deg: f64,
    /// Q: orientation of a turning tool, 0 to 9.
    pub orientation: u32,
    /// What the table says of it.
    pub comment: String,
}

/// Reads the text of a tool table, in mm; `name` is shown in errors.
///
/// # Errors
/// A line that is no tool, or a tool that is there twice: each with file, line and what would be right.
pub fn parse_tools(name: &str, text: &str) -> Result<Vec<Tool>, SettingsFileError> {
    let mut tools: Vec<Tool> = vec![];
    let mut wrong = vec![];
    for (index, line) in text.lines().enumerate() {
        let (words, comment) = line.split_once(';').unwrap_or((line, ""));
        if words.trim().is_empty() {
            continue;
        }
        match tool_of(words, comment.trim()) {
            Ok(tool) if tools.iter().any(|other| other.number == tool.number) => {
                let number = tool.number;
                wrong.push(format!(
                    "{name}:{}: tool {number} a second time: each tool once",
                    index + 1
                ));
            }
            Ok(tool) => tools.push(tool),
            Err(what) => wrong.push(format!("{name}:{}: {what}", index + 1)),
        }
    }
    if wrong.is_empty() {
        Ok(tools)
    } else {
        Err(SettingsFileError::Broken(wrong))
    }
}

fn tool_of(words: &str, comment: &str) -> Result<Tool, String> {
    let mut tool = Tool {
        comment: comment.to_owned(),
        ..Tool::default()
    };
    let mut is_named = false;
    for word in words.split_whitespace() {
        let mut letters = word.chars();
        let letter = letters.next().unwrap_or(' ').to_ascii_uppercase();
        let value: f64 = letters
            .as_str()
            .parse()
            .ok()
            .filter(|value: &f64| value.is_finite() && value.abs() <= 1e6)
            .ok_or_else(|| format!("{word}: a letter with a number, such as Z12.5"))?;
        let whole = || {
            let is_whole = (0.0..=99_999.0).contains(&value) && value.fract() == 0.0;
            let wrong = format!("{word}: a whole number from 0 to 99999");
            is_whole.then_some(value as u32).ok_or(wrong)
        };
        match letter {
            'T' => {
                tool.number = whole()?;
                is_named = true;
            }
            'P' => tool.pocket = whole()?,
            'Q' => tool.orientation = whole()?,
            'D' => tool.diameter = value,
            'I' => tool.front_angle_deg = value,
            'J' => tool.back_angle_deg = value,
            _ => {
                let at = OFFSET_LETTERS.find(letter);
                let slot = at.and_then(|at| tool.offset.get_mut(at));
                let right = "T P D X Y Z A B C U V W I J Q, then a comment behind ;";
                *slot.ok_or_else(|| format!("{word}: {right}"))? = value;
            }
        }
    }
    if is_named {
        Ok(tool)
    } else {
        Err("a line without T: a tool is T with its number, such as T1 P1 D6 Z12.5".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_as_linuxcnc_writes_it_is_read() {
        let text = ";Tool table\nT1 P1 X0 Z+12.5 D6.000 ;end mill\n\nT21 P3 Z-.5 I95 J155 Q2\n";
        let tools = parse_tools("tool.tbl", text).unwrap();
        assert_eq!(tools.len(), 2);
        assert_eq!((tools[0].offset[2], tools[0].diameter), (12.5, 6.0));
        assert_eq!(tools[0].comment, "end mill");
        assert_eq!((tools[1].number, tools[1].orientation), (21, 2));
    }

    #[test]
    fn mistakes_are_told_with_their_place() {
        for (text, expected) in [
            ("T1 E5", "tool.tbl:1: E5: T P D"),
            ("P1 D6", "tool.tbl:1: a line without T"),
            ("T1\nT1", "tool.tbl:2: tool 1 a second time"),
            ("T1.5", "tool.tbl:1: T1.5: a whole number"),
            ("T1 D", "tool.tbl:1: D: a letter with a number"),
        ] {
            let found = parse_tools("tool.tbl", text).unwrap_err().to_string();
            assert!(found.contains(expected), "{text}: {found}");
        }
    }
}
