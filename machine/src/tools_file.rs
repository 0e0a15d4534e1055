//! The tool table as a file that is written too: `tools.toml` beside the machine file, a table for each tool.

use std::fmt::Write;

use toml_edit::Value;

use crate::settings_file::{SettingsFileError, each_entry, number_of};
use crate::tool_table::{OFFSET_LETTERS, Tool};

/// Highest number of a tool, and of a place in the magazine.
pub const TOOL_NUMBER_MAX: u32 = 99_999;
/// The key of each length, in the order of [`OFFSET_LETTERS`].
const LENGTH_KEYS: [&str; 9] = [
    "x_mm",
    "y_mm",
    "length_mm",
    "a_deg",
    "b_deg",
    "c_deg",
    "u_mm",
    "v_mm",
    "w_mm",
];
const HEAD: &str = "\
# Tools: length_mm is along Z. Written by `quadrant tool`, and at the end of programs that set one (G10 L1, L10, L11).
";

/// The number of a tool by its name, such as `T3`.
pub fn tool_number(name: &str) -> Option<u32> {
    let digits = name.strip_prefix('T')?;
    let number = digits
        .parse()
        .ok()
        .filter(|number| *number <= TOOL_NUMBER_MAX)?;
    (digits == u32::to_string(&number)).then_some(number)
}

/// Sets what a key says of a tool.
///
/// # Errors
/// No such key, or no such value: what would be right.
pub fn set_key(tool: &mut Tool, key: &str, value: &Value) -> Result<(), String> {
    let what = format!("[T{}] {key}", tool.number);
    let whole = |most: u32| {
        let number = value
            .as_integer()
            .and_then(|number| u32::try_from(number).ok());
        let right = || format!("{what} = {value}: a whole number from 0 to {most}");
        number.filter(|number| *number <= most).ok_or_else(right)
    };
    match key {
        "name" => {
            let right = || format!("{what} = {value}: a text in quotation marks, of one line");
            let name = value.as_str().filter(|name| !name.contains(['\n', '\r']));
            tool.comment = name.ok_or_else(right)?.trim().to_owned();
        }
        "pocket" => tool.pocket = whole(TOOL_NUMBER_MAX)?,
        "orientation" => tool.orientation = whole(9)?,
        "diameter_mm" => {
            let diameter = number_of(&what, value)?;
            if diameter < 0.0 {
                return Err(format!("{what} = {value}: must be at least 0 mm"));
            }
            tool.diameter = diameter;
        }
        "front_angle_deg" => tool.front_angle_deg = number_of(&what, value)?,
        "back_angle_deg" => tool.back_angle_deg = number_of(&what, value)?,
        _ => {
            let at = LENGTH_KEYS.iter().position(|known| *known == key);
            let slot = at.and_then(|at| tool.offset.get_mut(at));
            let right = "one of name, pocket, length_mm, diameter_mm, x_mm, y_mm, a_deg, b_deg, c_deg, u_mm, v_mm, w_mm, front_angle_deg, back_angle_deg, orientation";
            *slot.ok_or_else(|| format!("{what}: {right}"))? = number_of(&what, value)?;
        }
    }
    Ok(())
}

/// Reads the text of such a file; `name` is shown in errors.
///
/// # Errors
/// A table that is no tool, a key or a value that there is not: each with file, line and what would be right.
pub fn parse_tools_file(name: &str, text: &str) -> Result<Vec<Tool>, SettingsFileError> {
    let mut tools: Vec<Tool> = vec![];
    each_entry(name, text, |table, entry| {
        let Some((key, value)) = entry else {
            let right = || format!("[{table}]: a tool such as [T3], from T0 to T{TOOL_NUMBER_MAX}");
            tools.push(Tool {
                number: tool_number(table).ok_or_else(right)?,
                ..Tool::default()
            });
            return Ok(());
        };
        match (table, tool_number(table), tools.last_mut()) {
            ("", ..) => Err(format!(
                "{key}: stands in no table: a tool is one, such as [T3]"
            )),
            (_, Some(_), Some(tool)) => set_key(tool, key, value),
            // The table is refused already.
            _ => Ok(()),
        }
    })?;
    tools.sort_by_key(|tool| tool.number);
    Ok(tools)
}

/// What a table says of a tool, as keys with their values.
pub fn keys_of(tool: &Tool) -> Vec<(&'static str, String)> {
    let mut keys = vec![];
    if !tool.comment.is_empty() {
        keys.push(("name", Value::from(tool.comment.as_str()).to_string()));
    }
    let whole = [("pocket", tool.pocket), ("orientation", tool.orientation)];
    keys.extend(whole.map(|(key, value)| (key, value.to_string())));
    keys.push(("diameter_mm", format!("{:?}", tool.diameter)));
    let lengths = LENGTH_KEYS.into_iter().zip(tool.offset);
    keys.extend(lengths.map(|(key, value)| (key, format!("{value:?}"))));
    keys.push(("front_angle_deg", format!("{:?}", tool.front_angle_deg)));
    keys.push(("back_angle_deg", format!("{:?}", tool.back_angle_deg)));
    let is_said = |(key, value): &(&str, String)| {
        matches!(*key, "length_mm" | "diameter_mm") || value != "0" && value != "0.0"
    };
    keys.retain(is_said);
    keys
}

/// The text of such a file, which [`parse_tools_file`] reads to the bit.
pub fn tools_file_text(tools: &[Tool]) -> String {
    let mut text = HEAD.to_owned();
    for tool in tools {
        // A String takes everything.
        let _ = write!(text, "\n[T{}]\n", tool.number);
        for (key, value) in keys_of(tool) {
            let _ = writeln!(text, "{key} = {value}");
        }
    }
    text
}

/// The text of a tool table in the form of LinuxCNC, which [`crate::parse_tools`] reads to the bit: copies of a machine file hold it so.
pub fn tool_table_text(tools: &[Tool]) -> String {
    let mut text = String::new();
    for tool in tools {
        let _ = write!(text, "T{} P{} D{}", tool.number, tool.pocket, tool.diameter);
        let lengths = OFFSET_LETTERS.chars().zip(tool.offset);
        for (letter, value) in lengths.filter(|(_, value)| *value != 0.0) {
            let _ = write!(text, " {letter}{value}");
        }
        let turning = [('I', tool.front_angle_deg), ('J', tool.back_angle_deg)];
        for (letter, value) in turning.into_iter().filter(|(_, value)| *value != 0.0) {
            let _ = write!(text, " {letter}{value}");
        }
        let _ = writeln!(text, " Q{} ;{}", tool.orientation, tool.comment);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse_tools;

    fn tools() -> Vec<Tool> {
        let text = "T1 P1 D6 Z40.125 ;end \"mill\"\nT3 D8.5 X0.1 Z-62 A1e-3\nT21 P3 I95 J155 Q2\n";
        parse_tools("tool.tbl", text).expect("tools")
    }

    #[test]
    fn what_is_written_is_read_to_the_bit_in_either_form() {
        let read = parse_tools_file("tools.toml", &tools_file_text(&tools())).expect("a file");
        assert_eq!(read, tools());
        let read = parse_tools("tools", &tool_table_text(&tools())).expect("a table");
        assert_eq!(read, tools());
    }

    #[test]
    fn what_is_wrong_is_refused_with_its_line_and_all_of_it_at_once() {
        let text = "x = 1\n[T1]\nlength_mm = nan\ndiameter_mm = -1\nlenght_mm = 2\npocket = 1.5\n[drill]\nlength_mm = 1\n[T007]\n";
        let refused = parse_tools_file("tools.toml", text).expect_err("refused");
        let said = refused.to_string();
        for line in [1, 3, 4, 5, 6, 7, 9] {
            assert!(said.contains(&format!("tools.toml:{line}: ")), "{said}");
        }
        assert_eq!(said.lines().count(), 7, "{said}");
    }
}
