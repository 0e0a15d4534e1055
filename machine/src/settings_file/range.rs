//! Between which values a number must lie.

use std::fmt;

use crate::settings_file::own_units;

/// The lower end of a range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum From {
    /// This value and what is above it.
    AtLeast(f64),
    /// Only what is above this value.
    Above(f64),
}

/// Lower and upper end; an end that is not there is open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Lower end.
    pub from: Option<From>,
    /// Upper end, included.
    pub high: Option<f64>,
}

impl Range {
    /// The same range of values that are divided.
    pub(in crate::settings_file) fn divided(self, by: f64) -> Range {
        let divided = |limit: f64| own_units::divided(limit, by);
        Range {
            from: self.from.map(|from| match from {
                From::AtLeast(low) => From::AtLeast(divided(low)),
                From::Above(low) => From::Above(divided(low)),
            }),
            high: self.high.map(divided),
        }
    }

    /// Whether a value lies in it; NaN lies in none.
    pub fn contains(&self, value: f64) -> bool {
        let above = match self.from {
            Some(From::AtLeast(low)) => value >= low,
            Some(From::Above(low)) => value > low,
            None => !value.is_nan(),
        };
        above && self.high.is_none_or(|high| value <= high)
    }

    /// The range as a table has it.
    pub fn short(&self) -> String {
        let from = match self.from {
            Some(From::AtLeast(low)) => format!("{low}"),
            Some(From::Above(low)) => format!("above {low}"),
            None => String::new(),
        };
        match self.high {
            Some(high) => format!("{from} to {high}"),
            None => from,
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.from {
            Some(From::AtLeast(low)) => write!(f, "at least {low}")?,
            Some(From::Above(low)) => write!(f, "above {low}")?,
            None => {}
        }
        match self.high {
            Some(high) if self.from.is_some() => write!(f, " and at most {high}"),
            Some(high) => write!(f, "at most {high}"),
            None => Ok(()),
        }
    }
}

/// A unit as it follows a number.
pub fn spaced(unit: &str) -> String {
    if unit.is_empty() {
        String::new()
    } else {
        format!(" {unit}")
    }
}
