//! Numbers as people read them.

/// Digits that stand side by side at most: what is longer is no measure of anything, and no name either.
const DIGITS_MAX: usize = 40;

/// A text whose numbers are short: one of more than 40 digits is written with a power of ten.
pub fn short_numbers(text: String) -> String {
    let is_part = |c: char| c.is_ascii_digit() || c == '.';
    if text.len() <= DIGITS_MAX || !text.split(|c| !is_part(c)).any(is_long) {
        return text;
    }
    let mut short = String::new();
    let mut rest = text.as_str();
    while !rest.is_empty() {
        let (before, behind) = rest.split_at(rest.find(is_part).unwrap_or(rest.len()));
        let (number, behind) =
            behind.split_at(behind.find(|c| !is_part(c)).unwrap_or(behind.len()));
        short += before;
        match number.parse::<f64>().ok().filter(|_| is_long(number)) {
            Some(value) => short += &format!("{value:e}"),
            None => short += number,
        }
        rest = behind;
    }
    short
}

fn is_long(number: &str) -> bool {
    number.split('.').any(|digits| digits.len() > DIGITS_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_nobody_reads_are_written_with_a_power_of_ten_and_all_others_as_they_are() {
        for (text, short) in [
            (
                format!("P{}: must be 0 to 1", 1e308),
                "P1e308: must be 0 to 1".to_owned(),
            ),
            (format!("= -{:.3} mm.", 2e300), "= -2e300 mm.".into()),
            (
                format!("{} to {}", 1e-300, f64::MAX),
                "1e-300 to 1.7976931348623157e308".into(),
            ),
            (
                format!("{}.toml:3: X 12.5", "7".repeat(40)),
                format!("{}.toml:3: X 12.5", "7".repeat(40)),
            ),
        ] {
            assert_eq!(short_numbers(text), short);
        }
    }
}
