//! Lengths of time as people write them, in scans.

use super::error::ScopeError;

/// The longest that can be asked for, in s.
const LONGEST_S: f64 = 3600.0;

/// A length of time, not yet in the scans of a machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Span {
    /// In s.
    Seconds(f64),
    /// In scans.
    Scans(u64),
}

impl std::str::FromStr for Span {
    type Err = ScopeError;

    /// `50ms`, `0.2s`, `800us`, `1min`, `200 scans`.
    fn from_str(text: &str) -> Result<Span, ScopeError> {
        let wrong = |found: &str| {
            ScopeError::Input(format!(
                "{text:?}: {found}: must be a length of time such as 50ms, 0.2s, 800us, 1min or \"200 scans\""
            ))
        };
        let text = text.trim();
        let end = text
            .find(|c: char| !(c.is_ascii_digit() || c == '.'))
            .unwrap_or(text.len());
        let (number, unit) = text.split_at(end);
        let number: f64 = number
            .parse()
            .map_err(|_| wrong("does not begin with a number from 0 up"))?;
        let seconds = match unit.trim() {
            "us" | "µs" => number * 1e-6,
            "ms" => number * 1e-3,
            "s" => number,
            "min" => number * 60.0,
            "scans" | "scan" if number.fract() == 0.0 && number <= LONGEST_S * 1e6 => {
                return Ok(Span::Scans(number as u64));
            }
            "scans" | "scan" => return Err(wrong("is no whole number of scans")),
            "" => return Err(wrong("has no unit")),
            unit => return Err(wrong(&format!("{unit:?} is no unit of time"))),
        };
        if seconds > LONGEST_S {
            return Err(wrong("is longer than an hour"));
        }
        Ok(Span::Seconds(seconds))
    }
}

impl Span {
    /// In scans of this period, rounded up: what was asked for is in it.
    pub fn scans(self, period_us: u32) -> u64 {
        match self {
            Span::Scans(scans) => scans,
            Span::Seconds(seconds) => {
                let scans = seconds * 1e6 / f64::from(period_us.max(1));
                // 0.2 s are 200 scans of 1 ms, not 201 for the last bit of 0.2.
                libm::ceil(scans - 1e-6).max(0.0) as u64
            }
        }
    }

    /// In s of this period.
    pub fn seconds(self, period_us: u32) -> f64 {
        match self {
            Span::Scans(scans) => scans as f64 * f64::from(period_us) * 1e-6,
            Span::Seconds(seconds) => seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_time_are_read_as_people_write_them() {
        for (text, period_us, scans) in [
            ("50ms", 1000, 50),
            ("0.2s", 1000, 200),
            ("200 scans", 250, 200),
            ("1scan", 250, 1),
            ("800us", 1000, 1),
            ("1 min", 1000, 60_000),
            ("0ms", 1000, 0),
        ] {
            let span: Span = text.parse().expect(text);
            assert_eq!(span.scans(period_us), scans, "{text}");
        }
    }

    #[test]
    fn what_is_no_length_of_time_is_refused_with_what_would_be() {
        for text in [
            "",
            "50",
            "ms",
            "-5ms",
            "5 parsecs",
            "1.5 scans",
            "2000min",
            "1e3s",
        ] {
            let error = text.parse::<Span>().expect_err(text).to_string();
            assert!(error.contains("such as 50ms"), "{text}: {error}");
        }
    }
}
