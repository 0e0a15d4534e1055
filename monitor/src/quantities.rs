//! Numbers of an axis that the feedback has and that are shown as they are: in `status`, monitor, page, metrics and report. One that
//! is added here is in all of them (docs/developers/adding.md, "A number of the feedback").

use std::collections::BTreeMap;

use bus::sample::AxisFeedback;

/// A number of an axis, as it is shown.
#[derive(Debug, Clone, Copy)]
pub struct Quantity {
    /// Key in `status --json`, unit last; with `_peak` behind it in `report.json`.
    pub key: &'static str,
    /// Heading of its column.
    pub heading: &'static str,
    /// The same in at most six characters, for the terminal.
    pub short: &'static str,
    /// Unit behind the number; empty for none.
    pub unit: &'static str,
    /// Decimals that people see.
    pub decimals: usize,
    /// Name and unit of its metric, behind `quadrant_axis_`.
    pub metric: (&'static str, &'static str),
    /// One sentence about it.
    pub help: &'static str,
    /// Its value.
    pub of: fn(&AxisFeedback) -> f64,
}

impl Quantity {
    /// Its value among those that are known of an axis, for people.
    pub fn text(&self, of_axis: &BTreeMap<String, Option<f64>>) -> String {
        let value = of_axis.get(self.key).copied().flatten();
        value.map_or("-".into(), |value| format!("{value:.*}", self.decimals))
    }

    /// Key of its largest magnitude in a run.
    pub fn peak_key(&self) -> String {
        format!("{}_peak", self.key)
    }
}

/// All of them.
pub const OF_AXIS: [Quantity; 1] = [Quantity {
    key: "winding_k",
    heading: "winding",
    short: "wind.K",
    unit: "K",
    decimals: 1,
    metric: ("winding_rise", "kelvin"),
    help: "Winding temperature above ambient.",
    of: |axis| axis.winding_k,
}];

/// Largest magnitudes of the numbers of an axis over a run, in their order; a value that is not a number is none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Peaks([f64; OF_AXIS.len()]);

impl Peaks {
    /// Takes one scan.
    pub fn take(&mut self, axis: &AxisFeedback) {
        for (peak, one) in self.0.iter_mut().zip(&OF_AXIS) {
            let value = (one.of)(axis).abs();
            if value.is_finite() {
                *peak = peak.max(value);
            }
        }
    }

    /// The magnitudes by [their keys](Quantity::peak_key), rounded so.
    pub fn by_key(&self, round: impl Fn(f64) -> f64) -> BTreeMap<String, f64> {
        let peaks = OF_AXIS.iter().zip(self.0);
        peaks
            .map(|(one, peak)| (one.peak_key(), round(peak)))
            .collect()
    }
}
