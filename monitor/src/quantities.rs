//! Numbers of an axis that the feedback has and that are shown as they are: in `status`, monitor, page, metrics and report. One that
//! is added here is in all of them (docs/developers/adding.md, "A number of the feedback").

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
