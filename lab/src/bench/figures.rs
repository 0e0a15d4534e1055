//! Figures of benches, each beside its floor where it has one: as a table in Markdown and as JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

/// What nobody who does the same can go below, measured in the same run.
#[derive(Debug, Clone)]
struct Floor {
    what: String,
    value: f64,
}

/// One figure.
#[derive(Debug, Clone)]
struct Figure {
    bench: &'static str,
    what: String,
    value: f64,
    unit: &'static str,
    floor: Option<Floor>,
}

/// The figures of a bench, in the order in which they were measured.
#[derive(Debug, Clone, Default)]
pub(crate) struct Figures {
    all: Vec<Figure>,
    /// What could not be measured here, and why.
    left_out: Vec<(&'static str, String)>,
}

impl Figures {
    /// One more.
    pub fn add(
        &mut self,
        bench: &'static str,
        what: impl Into<String>,
        value: f64,
        unit: &'static str,
    ) {
        self.all.push(Figure {
            bench,
            what: what.into(),
            value,
            unit,
            floor: None,
        });
    }

    /// The floor of the last one, in its unit.
    pub fn beside(&mut self, what: impl Into<String>, value: f64) {
        if let Some(last) = self.all.last_mut() {
            last.floor = Some(Floor {
                what: what.into(),
                value,
            });
        }
    }

    /// A bench that cannot be run here.
    pub fn leave_out(&mut self, bench: &'static str, why: impl Into<String>) {
        self.left_out.push((bench, why.into()));
    }

    /// All of them as a table, and what was left out.
    pub fn markdown(&self) -> String {
        let mut text =
            String::from("| bench | figure | | floor | | ratio |\n|---|---|---|---|---|---|\n");
        for figure in &self.all {
            let Figure {
                bench,
                what,
                value,
                unit,
                ..
            } = figure;
            let _ = write!(text, "| {bench} | {what} | {} {unit} |", number(*value));
            let _ = match &figure.floor {
                Some(floor) => writeln!(
                    text,
                    " {} | {} {unit} | {:.2} |",
                    floor.what,
                    number(floor.value),
                    value / floor.value
                ),
                None => writeln!(text, " | | |"),
            };
        }
        for (bench, why) in &self.left_out {
            let _ = writeln!(text, "\nLeft out: {bench}: {why}.");
        }
        text
    }

    /// The same for programs.
    pub fn json(&self) -> Value {
        let figure = |figure: &Figure| {
            let floor = figure.floor.as_ref();
            json!({
                "bench": figure.bench,
                "figure": figure.what,
                "value": figure.value,
                "unit": figure.unit,
                "floor": floor.map(|floor| json!({ "figure": floor.what, "value": floor.value })),
            })
        };
        let left_out = |(bench, why): &(&str, String)| json!({ "bench": bench, "why": why });
        json!({
            "figures": self.all.iter().map(figure).collect::<Vec<_>>(),
            "left_out": self.left_out.iter().map(left_out).collect::<Vec<_>>(),
        })
    }
}

/// Three figures that count, or all before the point.
fn number(value: f64) -> String {
    match value.abs() {
        large if large >= 100.0 => format!("{value:.0}"),
        middle if middle >= 10.0 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_stands_beside_its_floor_and_one_without_stands_alone() {
        let mut figures = Figures::default();
        figures.add("ipc", "a scan", 30.0, "µs");
        figures.beside("ring", 20.0);
        figures.add("faults", "seeds", 12345.6, "1/min");
        figures.leave_out("fieldbus", "no machine with a bus");
        let table = figures.markdown();
        for line in [
            "| ipc | a scan | 30.0 µs | ring | 20.0 µs | 1.50 |",
            "| faults | seeds | 12346 1/min | | | |",
            "Left out: fieldbus: no machine with a bus.",
        ] {
            assert!(table.lines().any(|of| of == line), "{line}: {table}");
        }
        let json = figures.json();
        assert_eq!(json["figures"][0]["floor"]["value"], 20.0);
        assert_eq!(json["figures"][1]["floor"], Value::Null);
        assert_eq!(json["left_out"][0]["bench"], "fieldbus");
    }
}
