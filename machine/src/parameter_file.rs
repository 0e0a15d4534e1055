//! The parameters of programs that outlive a run, in the form of LinuxCNC (manual, *Parameters: numbered, persistent*): a line for each,
//! its number and its value.

use std::collections::BTreeMap;
use std::fmt::Write;

use crate::settings_file::SettingsFileError;

/// The highest number of a parameter.
const NUMBER_MAX: u32 = 5602;

/// The offsets of G54.1, which programs in Fanuc's language have.
const MORE_WORK: std::ops::RangeInclusive<u32> = 14_001..=20_000;

/// The values of numbered parameters, by their numbers.
pub type KeptParameters = BTreeMap<u32, f64>;

/// Whether a parameter outlives a run without being named in the file: the places of G28 and G30, the offsets of G92 and the work
/// offsets, each with its rotation.
pub fn is_always_kept(number: u32) -> bool {
    match number {
        5161..=5169 | 5181..=5189 | 5210..=5220 => true,
        5221..=5390 => (number - 5221) % 20 < 10,
        _ => false,
    }
}

/// Reads the text of a parameter file; `name` is shown in errors. What follows `;` is a remark.
///
/// # Errors
/// A line that is no parameter, or a parameter that is there twice: each with file, line and what would be right.
pub fn parse_parameters(name: &str, text: &str) -> Result<KeptParameters, SettingsFileError> {
    let mut parameters = KeptParameters::new();
    let mut wrong = vec![];
    for (line, of_line) in (1..).zip(text.lines()) {
        let words = of_line.split(';').next().unwrap_or_default();
        let mut refuse = |what: String| wrong.push(format!("{name}:{line}: {what}"));
        match parameter_of(words.trim()) {
            Ok(None) => {}
            Ok(Some((number, value))) => {
                if parameters.insert(number, value).is_some() {
                    refuse(format!("#{number} a second time: each parameter once"));
                }
            }
            Err(what) => refuse(what),
        }
    }
    if wrong.is_empty() {
        Ok(parameters)
    } else {
        Err(SettingsFileError::Broken(wrong))
    }
}

/// A line of a parameter file; none of an empty one.
fn parameter_of(words: &str) -> Result<Option<(u32, f64)>, String> {
    if words.is_empty() {
        return Ok(None);
    }
    let right = "a number and its value, such as `5221 12.5`";
    let mut both = words.split_whitespace();
    let (Some(number), Some(value), None) = (both.next(), both.next(), both.next()) else {
        return Err(format!("{words:?}: {right}"));
    };
    let number = number.parse().ok();
    let number =
        number.filter(|number| (1..=NUMBER_MAX).contains(number) || MORE_WORK.contains(number));
    let number = number.ok_or_else(|| format!("{words:?}: {right}, from 1 to {NUMBER_MAX}"))?;
    let value: f64 = value.parse().map_err(|_| format!("{words:?}: {right}"))?;
    if !value.is_finite() {
        return Err(format!("{words:?}: a value that is finite"));
    }
    if number == 5220 && !(1..=9).any(|system| value == f64::from(system)) {
        return Err(format!(
            "{words:?}: the work offset in force is one of 1 to 9"
        ));
    }
    Ok(Some((number, value)))
}

/// The text of a parameter file, which [`parse_parameters`] reads to the bit.
pub fn parameter_text(parameters: &KeptParameters) -> String {
    let mut text = String::new();
    for (number, value) in parameters {
        // A String takes everything.
        let _ = writeln!(text, "{number}\t{value}");
    }
    text
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn refused(text: &str) -> String {
        let refused = parse_parameters("mill.var", text).expect_err("must be refused");
        refused.to_string()
    }

    #[test]
    fn a_parameter_file_of_linuxcnc_is_read() {
        let text = "100\t3.000000\n5161\t0.000000\n\n5220\t1.000000\n5221\t-12.500000 ; the vice\n";
        let read = parse_parameters("mill.var", text).expect("a file");
        let expected = [(100, 3.0), (5161, 0.0), (5220, 1.0), (5221, -12.5)];
        assert_eq!(read, KeptParameters::from(expected));
    }

    #[test]
    fn what_is_no_parameter_is_refused_with_its_line_and_all_of_it_at_once() {
        let text = "100 1\nx 2\n101\n5603 1\n0 1\n102 nan\n5220 10\n100 2\n103 1 2\n";
        let said = refused(text);
        for line in 2..=9 {
            assert!(said.contains(&format!("mill.var:{line}: ")), "{said}");
        }
        assert_eq!(said.lines().count(), 8, "{said}");
    }

    #[test]
    fn those_are_always_kept_that_linuxcnc_always_keeps() {
        // As many as its interpreter writes into a file that was empty.
        let kept = (1..=NUMBER_MAX).filter(|number| is_always_kept(*number));
        assert_eq!(kept.count(), 9 + 9 + 11 + 9 * 10);
        assert!(!is_always_kept(5231) && is_always_kept(5230) && is_always_kept(5390));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_to_the_bit(
            parameters in prop::collection::btree_map(31_u32..5000, prop::num::f64::NORMAL | prop::num::f64::ZERO, 0..50)
        ) {
            let read = parse_parameters("mill.var", &parameter_text(&parameters)).expect("a file");
            prop_assert_eq!(read.len(), parameters.len());
            for ((number, value), (other, of_other)) in read.iter().zip(&parameters) {
                prop_assert_eq!(number, other);
                prop_assert_eq!(value.to_bits(), of_other.to_bits());
            }
        }
    }
}
