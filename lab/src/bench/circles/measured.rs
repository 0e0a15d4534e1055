//! What one run of circles measured, and the table of all of them as CSV.

use std::fmt::Write as _;

use anyhow::Context;
use serde_json::Value;

/// Radius and feed of a circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Condition {
    /// In mm.
    pub radius_mm: f64,
    /// In mm/min.
    pub feed_mm_min: f64,
}

/// Largest deviations of one axis's reversals in steady motion.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisWorst {
    /// Its letter.
    pub axis: String,
    /// Largest protrusion, at least 0, in µm.
    pub protrusion_um: f64,
    /// Deepest undercut, at most 0, in µm.
    pub undercut_um: f64,
}

/// What one run measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Per axis.
    pub axes: Vec<AxisWorst>,
    /// Radius error on the table, of the arc where it is largest, in µm.
    pub radius_error_um: f64,
}

impl Measured {
    /// From a run's report.
    ///
    /// # Errors
    /// The report has no reversals in steady motion.
    pub fn of(report: &Value) -> anyhow::Result<Measured> {
        let list = |key: &str| report.get(key).and_then(Value::as_array);
        let reversals = list("reversals").context("report.json has no reversals")?;
        let number = |of: &Value, key: &str| of.get(key).and_then(Value::as_f64);
        let mut axes: Vec<AxisWorst> = Vec::new();
        for reversal in reversals {
            let steady = reversal.get("steady") == Some(&Value::Bool(true));
            let found = (
                reversal.get("axis").and_then(Value::as_str),
                number(reversal, "protrusion_um"),
                number(reversal, "undercut_um"),
            );
            let (Some(axis), Some(protrusion_um), Some(undercut_um)) = found else {
                continue;
            };
            if !steady {
                continue;
            }
            let place = axes.iter().position(|a| a.axis == axis);
            let place = place.unwrap_or_else(|| {
                axes.push(AxisWorst {
                    axis: axis.into(),
                    protrusion_um: 0.0,
                    undercut_um: 0.0,
                });
                axes.len() - 1
            });
            if let Some(worst) = axes.get_mut(place) {
                worst.protrusion_um = worst.protrusion_um.max(protrusion_um);
                worst.undercut_um = worst.undercut_um.min(undercut_um);
            }
        }
        if axes.is_empty() {
            anyhow::bail!("the run has no reversal in steady motion");
        }
        axes.sort_by(|a, b| a.axis.cmp(&b.axis));
        let radius_error_um = list("arcs")
            .into_iter()
            .flatten()
            .filter_map(|arc| number(arc, "radius_error_um"))
            .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        Ok(Measured {
            axes,
            radius_error_um,
        })
    }

    /// Largest protrusion, in µm.
    pub fn protrusion_um(&self) -> f64 {
        self.axes
            .iter()
            .map(|a| a.protrusion_um)
            .fold(0.0, f64::max)
    }

    /// Deepest undercut, in µm.
    pub fn undercut_um(&self) -> f64 {
        self.axes.iter().map(|a| a.undercut_um).fold(0.0, f64::min)
    }

    /// The larger of both, in µm.
    pub fn worst_um(&self) -> f64 {
        self.protrusion_um().max(-self.undercut_um())
    }
}

/// One line of the comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Way of compensating.
    pub method: &'static str,
    /// Circle.
    pub condition: Condition,
    /// What came out.
    pub measured: Measured,
    /// By how much it is worse than the reference method, in µm; none where that was not run.
    pub worse_um: Option<f64>,
}

/// The comparison as CSV; lengths in the unit that ends each column's name.
pub fn csv(machine: &str, lines: &[Line]) -> String {
    let axes: Vec<&str> = lines.first().map_or_else(Vec::new, |line| {
        line.measured.axes.iter().map(|a| a.axis.as_str()).collect()
    });
    let mut text = String::from(
        "machine,method,radius_mm,feed_mm_min,worst_um,protrusion_um,undercut_um,worse_than_backlash_um,radius_error_um",
    );
    for axis in &axes {
        let axis = axis.to_lowercase();
        let _ = write!(text, ",{axis}_protrusion_um,{axis}_undercut_um");
    }
    text.push('\n');
    for line in lines {
        let Line {
            method,
            condition,
            measured,
            worse_um,
        } = line;
        let _ = write!(
            text,
            "{machine},{method},{},{},{:.3},{:.3},{:.3},{},{:.3}",
            condition.radius_mm,
            condition.feed_mm_min,
            measured.worst_um(),
            measured.protrusion_um(),
            measured.undercut_um(),
            worse_um.map_or(String::new(), |um| format!("{um:.3}")),
            measured.radius_error_um,
        );
        for axis in &axes {
            let own = measured.axes.iter().find(|a| a.axis == *axis);
            let (protrusion_um, undercut_um) =
                own.map_or((f64::NAN, f64::NAN), |a| (a.protrusion_um, a.undercut_um));
            let _ = write!(text, ",{protrusion_um:.3},{undercut_um:.3}");
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_run_is_judged_by_its_reversals_in_steady_motion_alone() {
        let report = json!({
            "reversals": [
                { "axis": "Y", "protrusion_um": 3.0, "undercut_um": -1.0, "steady": true },
                { "axis": "X", "protrusion_um": 1.0, "undercut_um": -7.5, "steady": true },
                { "axis": "X", "protrusion_um": 2.0, "undercut_um": -0.5, "steady": true },
                { "axis": "X", "protrusion_um": 90.0, "undercut_um": -90.0, "steady": false },
                { "axis": "X", "protrusion_um": null, "undercut_um": null, "steady": false },
            ],
            "arcs": [{ "radius_error_um": 1.0 }, { "radius_error_um": -2.0 }],
        });
        let measured = Measured::of(&report).unwrap();
        assert_eq!(measured.worst_um(), 7.5);
        assert_eq!(measured.protrusion_um(), 3.0);
        assert_eq!(measured.radius_error_um, -2.0);
        let line = Line {
            method: "none",
            condition: Condition {
                radius_mm: 10.0,
                feed_mm_min: 1000.0,
            },
            measured,
            worse_um: None,
        };
        let text = csv("xy", &[line]);
        let rows: Vec<&str> = text.lines().collect();
        assert!(rows[0].ends_with(",x_protrusion_um,x_undercut_um,y_protrusion_um,y_undercut_um"));
        assert_eq!(
            rows[1],
            "xy,none,10,1000,7.500,3.000,-7.500,,-2.000,2.000,-7.500,3.000,-1.000"
        );
        let none = json!({ "reversals": [] });
        assert!(Measured::of(&none).is_err());
    }
}
