//! Work offsets that outlive a run: `offsets.toml` beside the machine file. In it stand the parameters #5161 to #5390, by their names.

use std::fmt::Write;

use toml_edit::Value;

use crate::machine::Machine;
use crate::parameter_file::KeptParameters;
use crate::settings_file::{SettingsFileError, each_entry, number_of};
use crate::tool_table::OFFSET_LETTERS;

/// The work offsets, by their codes; parameter #5220 counts them from 1.
pub const WORK_OFFSETS: [&str; 9] = [
    "G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3",
];
/// Parameter that says which work offset is in force, from 1.
pub const IN_FORCE: u32 = 5220;
/// Parameter that is 1 while G92 applies; its offsets follow.
pub const G92_APPLIES: u32 = 5210;

/// First parameter of each table but the work offsets: of its X.
const OTHERS: [(&str, u32); 3] = [("G92", G92_APPLIES + 1), ("G28", 5161), ("G30", 5181)];
const HEAD: &str = "\
# Work offsets, in machine coordinates: mm, rotary axes in degrees. R turns an offset about Z, in degrees.
# Written by `quadrant offsets`, `quadrant zero`, and at the end of programs that set one.
";

/// The first parameter of a work offset, that of its X; its rotation is 9 behind.
pub fn first_parameter(work_offset: &str) -> Option<u32> {
    let index = WORK_OFFSETS.iter().position(|name| *name == work_offset)?;
    Some(5221 + 20 * index as u32)
}

/// The parameter of an axis (or of R, the rotation) in a group whose X has the parameter `first`.
pub fn parameter_of(first: u32, letter: char) -> Option<u32> {
    match letter {
        'R' => Some(first + 9),
        _ => OFFSET_LETTERS.find(letter).map(|at| first + at as u32),
    }
}

impl Machine {
    /// The letters of the axes that programs of this machine have, in the order of their parameters.
    pub fn program_letters(&self) -> Vec<char> {
        let has = |letter: &char| {
            let of_axis = self.axes.iter().any(|axis| axis.name.starts_with(*letter));
            of_axis || *letter == 'Y' && self.kinematics.is_some()
        };
        OFFSET_LETTERS.chars().filter(has).collect()
    }

    /// What a parameter is where no file says anything else: the machine file gives G54.
    pub fn parameter_default(&self, number: u32) -> f64 {
        if number == IN_FORCE {
            return 1.0;
        }
        let at = number.checked_sub(5221).map(|at| at as usize);
        let letter = at.and_then(|at| OFFSET_LETTERS.get(at..=at));
        let offset = letter.and_then(|letter| self.program.work_offset(letter));
        offset.unwrap_or(0.0)
    }
}

/// First parameter of a table, and whether it is a work offset.
fn group_of(table: &str) -> Option<(u32, bool)> {
    let other = OTHERS.iter().find(|(name, _)| *name == table);
    let work = first_parameter(table).map(|first| (first, true));
    work.or(other.map(|(_, first)| (*first, false)))
}

/// Reads the text of a file of work offsets; `name` is shown in errors.
///
/// # Errors
/// An offset or an axis that there is not, or a value that is none: each with file, line and what would be right.
pub fn parse_offsets(
    name: &str,
    text: &str,
    machine: &Machine,
) -> Result<KeptParameters, SettingsFileError> {
    let letters = machine.program_letters();
    let mut parameters = KeptParameters::new();
    each_entry(name, text, |table, entry| {
        match entry {
            None if group_of(table).is_some() => {}
            None => {
                let known = WORK_OFFSETS.join(" ");
                return Err(format!("[{table}]: one of {known} G92 G28 G30"));
            }
            Some((key, value)) => {
                if let Some((number, value)) = entry_of(table, key, value, &letters)? {
                    parameters.insert(number, value);
                }
            }
        }
        Ok(())
    })?;
    Ok(parameters)
}

/// What a line says; none of a table that is refused already.
fn entry_of(
    table: &str,
    key: &str,
    value: &Value,
    letters: &[char],
) -> Result<Option<(u32, f64)>, String> {
    if table.is_empty() {
        return match (key, value.as_str()) {
            ("in_force", Some(name)) if WORK_OFFSETS.contains(&name) => {
                let index = WORK_OFFSETS.iter().position(|known| *known == name);
                Ok(Some((IN_FORCE, index.unwrap_or(0) as f64 + 1.0)))
            }
            ("in_force", _) => Err(format!("in_force = {value}: one of {WORK_OFFSETS:?}")),
            _ => Err(format!("{key}: `in_force`, or a table such as [G55]")),
        };
    }
    let Some((first, is_work)) = group_of(table) else {
        return Ok(None);
    };
    if table == "G92" && key == "applies" {
        let right = || format!("[G92] applies = {value}: true or false");
        let applies = value.as_bool().ok_or_else(right)?;
        return Ok(Some((G92_APPLIES, f64::from(u8::from(applies)))));
    }
    let number = letters
        .iter()
        .find(|letter| key == letter.to_string())
        .copied()
        .or((is_work && key == "R").then_some('R'))
        .and_then(|letter| parameter_of(first, letter));
    let Some(number) = number else {
        let known: Vec<String> = letters.iter().map(char::to_string).collect();
        let turned = if is_work { " and R" } else { "" };
        return Err(format!(
            "[{table}] {key}: the machine has no such axis; it has {}{turned}",
            known.join(" ")
        ));
    };
    let value = number_of(&format!("[{table}] {key}"), value)?;
    Ok(Some((number, value)))
}

/// The text of a file of work offsets, which [`parse_offsets`] reads to the bit.
pub fn offsets_text(parameters: &KeptParameters, machine: &Machine) -> String {
    let letters = machine.program_letters();
    let mut text = HEAD.to_owned();
    let in_force = parameters.get(&IN_FORCE).map_or(1.0, |value| *value);
    if let Some(name) = WORK_OFFSETS.get((in_force - 1.0) as usize)
        && in_force != 1.0
    {
        // A String takes everything.
        let _ = writeln!(text, "\nin_force = \"{name}\"");
    }
    let work = WORK_OFFSETS
        .iter()
        .map(|name| (*name, first_parameter(name)));
    let others = OTHERS.iter().map(|(name, first)| (*name, Some(*first)));
    for (name, first) in work.chain(others) {
        let first = first.unwrap_or(0);
        let of_table = letters.iter().chain(['R'].iter()).filter_map(|letter| {
            let number = parameter_of(first, *letter)?;
            let is_there = *letter != 'R' || first >= 5221;
            let value = parameters.get(&number).filter(|_| is_there)?;
            Some(format!("{letter} = {value:?}\n"))
        });
        let mut of_table: String = of_table.collect();
        if name == "G92"
            && parameters
                .get(&G92_APPLIES)
                .is_some_and(|value| *value != 0.0)
        {
            of_table.insert_str(0, "applies = true\n");
        }
        if !of_table.is_empty() {
            let quote = if name.contains('.') { "\"" } else { "" };
            let _ = write!(text, "\n[{quote}{name}{quote}]\n{of_table}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn machine() -> Machine {
        let text = include_str!("../../machines/xyz-mill/machine.toml");
        Machine::parse("machine.toml", text).expect("a machine")
    }

    #[test]
    fn what_is_wrong_is_refused_with_its_line_and_all_of_it_at_once() {
        let text = "in_force = \"G60\"\n[G54]\nX = nan\nQ = 1\n[G60]\nX = 1\n[G28]\nR = 1\n[G92]\napplies = 1\n";
        let refused = parse_offsets("offsets.toml", text, &machine()).expect_err("refused");
        let said = refused.to_string();
        for line in [1, 3, 4, 5, 8, 10] {
            assert!(said.contains(&format!("offsets.toml:{line}: ")), "{said}");
        }
        assert_eq!(said.lines().count(), 6, "{said}");
        let half = "[G54]\nX = 1\n[G5";
        let refused = parse_offsets("offsets.toml", half, &machine()).expect_err("refused");
        assert!(
            refused.to_string().starts_with("offsets.toml:3: "),
            "{refused}"
        );
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_to_the_bit(
            values in prop::collection::btree_map((0_usize..9, prop::sample::select(vec!['X', 'Y', 'Z', 'R'])), -1e6_f64..1e6, 0..20),
            in_force in 1_u32..=9, applies in any::<bool>(),
        ) {
            let machine = machine();
            let mut parameters = KeptParameters::new();
            for ((work, letter), value) in values {
                let first = first_parameter(WORK_OFFSETS[work]).expect("a work offset");
                parameters.insert(parameter_of(first, letter).expect("a letter"), value);
            }
            if in_force != 1 {
                parameters.insert(IN_FORCE, f64::from(in_force));
            }
            if applies {
                parameters.insert(G92_APPLIES, 1.0);
                parameters.insert(G92_APPLIES + 1, 3.5);
            }
            let text = offsets_text(&parameters, &machine);
            let read = parse_offsets("offsets.toml", &text, &machine).expect("a file");
            prop_assert_eq!(read, parameters);
        }
    }
}
