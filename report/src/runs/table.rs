//! Runs as people read them, or scripts.

use serde_json::{Value, json};

use crate::document::Columns;
use crate::text;
use console::output::plain;

/// A run each line, or JSON.
pub(super) fn table(runs: &[Value], as_json: bool) -> String {
    if as_json {
        return serde_json::to_string_pretty(&json!({ "runs": runs })).unwrap_or_default();
    }
    let words = |key| move |run: &Value| plain(run[key].as_str().unwrap_or("–"));
    let number = |key| move |run: &Value| run[key].as_f64();
    if runs.is_empty() {
        return "no runs".into();
    }
    let mut columns = Columns::of("runs", runs)
        .words("Began (UTC)", |run| {
            words("began")(run).replace(['T', 'Z'], " ")
        })
        .words("Program", words("program"))
        .words("Outcome", |run| match run["under_way"] == true {
            true => "under way".into(),
            false => words("outcome")(run),
        })
        .number("Took", "s", 1, number("took_s"))
        .number("Contour error", "µm", 1, number("contour_error_um"));
    for (key, unit) in [("following_error_um", "µm"), ("following_error_mdeg", "m°")] {
        if runs.iter().any(|run| !run[key].is_null()) {
            columns = columns.number("Following error", unit, 1, number(key));
        }
    }
    let mut table = columns
        .number("Size", "MB", 1, |run| Some(run["bytes"].as_f64()? / 1e6))
        .words("Run", |run| match run["marked"].as_str() {
            None => words("run")(run),
            Some(reason) => format!("{}  marked {}", words("run")(run), plain(reason)),
        })
        .done();
    table.rows_in_text = usize::MAX;
    table.letters_in_text = usize::MAX;
    text::of_table(&table).trim_end().into()
}
