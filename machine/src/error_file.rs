//! A table of an axis's errors as a file: what the software of laser interferometers exports as CSV.

use crate::axis_kind::AxisKind;
use crate::geometry::{AxisCompensation, ERROR_POINTS_MAX};
use crate::settings_file::SettingsFileError;

/// Puts the table that a file has into the compensation of an axis; `name` is the file's, for messages. Columns are divided by commas or
/// semicolons; empty lines and lines that begin with `#` count for nothing.
///
/// # Errors
/// A heading that is none of those known, a line with other than as many numbers, or more points than a table may have: each with
/// file and line, and what would be right.
pub fn read_errors(
    name: &str,
    text: &str,
    kind: AxisKind,
    into: &mut AxisCompensation,
) -> Result<(), SettingsFileError> {
    let broken = |line: usize, what: String| {
        SettingsFileError::Broken(vec![format!("{name}:{line}: {what}")])
    };
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let lines = text.lines().enumerate();
    let lines = lines.map(|(index, line)| (index + 1, line.trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let headings = match kind {
        AxisKind::Linear => ["position_mm", "forward_um", "backward_um"],
        AxisKind::Rotary => ["position_deg", "forward_mdeg", "backward_mdeg"],
    };
    let (line, heading) = lines.next().unwrap_or((1, ""));
    let found = columns(heading);
    if found != headings && Some(found.as_slice()) != headings.get(..2) {
        let right = headings.join(",");
        let what =
            format!("{heading:?}: must be the heading {right}; the last column may be left out");
        return Err(broken(line, what));
    }
    for (line, row) in lines {
        let numbers: Vec<f64> = columns(row).iter().flat_map(|word| word.parse()).collect();
        let whole = numbers.len() == found.len() && columns(row).len() == found.len();
        if !whole || !numbers.iter().all(|number: &f64| number.is_finite()) {
            let what = format!(
                "{row:?}: must be {} numbers, as in the heading",
                found.len()
            );
            return Err(broken(line, what));
        }
        if into.positions_mm.len() == ERROR_POINTS_MAX {
            let what = format!("has more than {ERROR_POINTS_MAX} points");
            return Err(broken(line, what));
        }
        let lists = [
            &mut into.positions_mm,
            &mut into.forward_um,
            &mut into.backward_um,
        ];
        for (list, number) in lists.into_iter().zip(numbers) {
            list.push(number);
        }
    }
    Ok(())
}

fn columns(line: &str) -> Vec<&str> {
    line.split([',', ';']).map(str::trim).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<AxisCompensation, String> {
        let mut into = AxisCompensation::default();
        let read = read_errors("x.csv", text, AxisKind::Linear, &mut into);
        read.map(|()| into).map_err(|error| error.to_string())
    }

    #[test]
    fn a_file_of_a_laser_gives_its_table_with_either_divider_and_one_or_two_directions() {
        let both = read(
            "\u{feff}# run 3\r\nposition_mm; forward_um; backward_um\r\n0;0;1.5\r\n\r\n25;2;4\r\n",
        );
        assert!(both.is_ok_and(|table| table.positions_mm == [0.0, 25.0]
            && table.forward_um == [0.0, 2.0]
            && table.backward_um == [1.5, 4.0]));
        let one = read("position_mm,forward_um\n-10,-1\n10,1\n");
        assert!(
            one.is_ok_and(|table| table.forward_um == [-1.0, 1.0] && table.backward_um.is_empty())
        );
    }

    #[test]
    fn a_file_that_is_no_such_table_is_refused_with_its_line() {
        let many = format!("position_mm,forward_um\n{}", "1,2\n".repeat(1001));
        for (text, says) in [
            (
                "",
                "x.csv:1: \"\": must be the heading position_mm,forward_um,backward_um",
            ),
            ("pos,err\n", "x.csv:1: \"pos,err\": must be the heading"),
            (
                "position_mm,forward_um\n1,2,3\n",
                "x.csv:2: \"1,2,3\": must be 2 numbers",
            ),
            (
                "position_mm,forward_um\n\n1,two\n",
                "x.csv:3: \"1,two\": must be 2 numbers",
            ),
            (
                "position_mm,forward_um\n1,NaN\n",
                "x.csv:2: \"1,NaN\": must be 2 numbers",
            ),
            (many.as_str(), "x.csv:1002: has more than 1000 points"),
        ] {
            let refused = read(text).err().unwrap_or_default();
            assert!(refused.contains(says), "{refused}");
        }
    }
}
