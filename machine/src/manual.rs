//! `[manual]`: motion off the path.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::axis_kind::AxisKind;
use crate::settings_file::Rules;

/// One inch, in mm.
const INCH_MM: f64 = 25.4;

/// Motion off the path.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Manual {
    /// Speed of a jog.
    #[schemars(extend("unit" = "mm/s", "exclusiveMinimum" = 0, "maximum" = 100, "default" = 10.0))]
    pub jog_mm_s: f64,
    /// Speed along the straight line at which a resumed program returns to where its path was left.
    #[schemars(extend("unit" = "mm/s", "exclusiveMinimum" = 0, "maximum" = 100, "default" = 20.0))]
    pub return_mm_s: f64,
    /// Increments that the keys of the monitor and the page offer for a jog ([by hand](../howto/by-hand.md)), each larger than the one
    /// before. Rotary axes take the same numbers in degrees.
    #[schemars(length(min = 1, max = 10), inner(range(min = 0.000_01, max = 100.0)), extend("unit" = "mm", "default" = [0.001, 0.01, 0.1, 1.0, 10.0]))]
    pub increments_mm: Vec<f64>,
    /// The same in inches, for linear axes in place of `increments_mm`.
    #[schemars(length(max = 10), inner(range(min = 0.000_001, max = 4.0)), extend("unit" = "in", "default" = []))]
    pub increments_inch: Vec<f64>,
}

/// An increment that is offered for a jog.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Increment {
    /// In mm or degrees.
    pub way: f64,
    /// As the machine file has it, in `unit`.
    pub shown: f64,
    /// `mm`, `in` or `deg`.
    pub unit: &'static str,
}

impl Manual {
    /// The increments that are offered for an axis of this kind, the smallest first.
    pub fn increments(&self, kind: AxisKind) -> Vec<Increment> {
        let of = |list: &[f64], unit: &'static str, by: f64| {
            let increments = list.iter().map(|shown| Increment {
                // To a picometre: 0.1 in are 2.54 mm.
                way: (shown * by * 1e9).round() / 1e9,
                shown: *shown,
                unit,
            });
            increments.collect()
        };
        match kind {
            AxisKind::Linear if !self.increments_inch.is_empty() => {
                of(&self.increments_inch, "in", INCH_MM)
            }
            kind => of(&self.increments_mm, kind.unit(), 1.0),
        }
    }
}

/// Increments go up.
pub(crate) fn judge(rules: &mut Rules<'_>, manual: &Manual) {
    let lists = [
        ("increments_mm", &manual.increments_mm),
        ("increments_inch", &manual.increments_inch),
    ];
    for (key, list) in lists {
        let mut pairs = list.iter().zip(list.iter().skip(1));
        if let Some((before, next)) = pairs.find(|(before, next)| next <= before) {
            let what = format!("= … {before}, {next} …: each must be larger than the one before");
            rules.say(&["manual", key], None, &what);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::{AxisKind, Machine};

    fn with(keys: &str) -> Result<Machine, String> {
        let text = include_str!("../../machines/xy/machine.toml");
        let text = format!("{text}\n[manual]\n{keys}\n");
        Machine::parse("machine.toml", &text).map_err(|error| error.to_string())
    }

    fn shown(machine: &Machine, kind: AxisKind) -> Vec<(f64, f64, &'static str)> {
        let increments = machine.manual.increments(kind);
        let all = increments.iter().map(|of| (of.way, of.shown, of.unit));
        all.collect()
    }

    #[test]
    fn increments_are_those_of_the_file_in_its_unit_and_degrees_of_a_rotary_axis() {
        let usual = with("").unwrap();
        let all = shown(&usual, AxisKind::Linear);
        assert_eq!(all.first(), Some(&(0.001, 0.001, "mm")));
        assert_eq!(all.last(), Some(&(10.0, 10.0, "mm")));
        let own = with("increments_mm = [0.005, 0.5]\nincrements_inch = [0.0001, 0.1]").unwrap();
        let inches = vec![(0.00254, 0.0001, "in"), (2.54, 0.1, "in")];
        assert_eq!(shown(&own, AxisKind::Linear), inches);
        let degrees = vec![(0.005, 0.005, "deg"), (0.5, 0.5, "deg")];
        assert_eq!(shown(&own, AxisKind::Rotary), degrees);
    }

    #[test]
    fn increments_that_are_none_or_do_not_go_up_are_refused_with_what_would_be_right() {
        for (keys, right) in [
            ("increments_mm = []", "1 to 10"),
            ("increments_mm = [0.0]", "at least 0.00001"),
            ("increments_mm = [0.1, 200.0]", "at most 100 mm"),
            ("increments_inch = [0.1, 5.0]", "at most 4 in"),
            ("increments_mm = [0.1, 0.1]", "each must be larger"),
            ("increments_inch = [0.1, 0.01]", "each must be larger"),
            (
                "increments_mm = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]",
                "1 to 10",
            ),
        ] {
            let said = with(keys).expect_err(keys);
            assert!(said.contains(right), "{keys}: {said}");
        }
    }
}
