//! `quadrant report`: report and plots from a run's log, or from two.

use std::fs;
use std::path::Path;

use anyhow::Context;

use crate::options::ReportOptions;
use crate::runs::must_be_no_cell;
use crate::settings_difference;
use console::exit::{Kind, Outcome};
use console::logs;
use console::output::say;

/// Of a report that is made beside a machine that moves.
const NICENESS: i32 = 19;

/// Makes report.json, report.txt, report.html and the plots of a run directory; the text.
///
/// # Errors
/// The log cannot be read, or the folder not be written.
pub fn make(run_dir: &Path) -> anyhow::Result<String> {
    let report = crate::make_report(run_dir)?;
    if report.samples_lost > 0 {
        tracing::warn!(
            "{} samples are missing in the log: its digest compares with no other run's",
            report.samples_lost
        );
    }
    let text = run_dir.join("report.txt");
    fs::read_to_string(&text).with_context(|| format!("{}: cannot be read", text.display()))
}

/// Makes the report again and prints it.
pub fn report(options: &ReportOptions) -> Outcome {
    logs::init_launcher();
    if options.background {
        // Before it has other threads: what they inherit.
        let _ = rustix::process::setpriority_process(None, NICENESS);
    }
    must_be_no_cell(&options.run_dir).input()?;
    if let Some(other) = &options.against {
        return against(&options.run_dir, other, options.json);
    }
    let text = make(&options.run_dir).input()?;
    if options.json {
        let json = options.run_dir.join("report.json");
        say(&fs::read_to_string(json).input()?);
    } else {
        say(&text);
    }
    Ok(())
}

/// Holds one run against another and prints what differs.
fn against(a: &Path, b: &Path, json: bool) -> Outcome {
    let settings = settings_difference::between(a, b).input()?;
    let written = crate::against::make_against(a, b, settings).input()?;
    if json {
        say(&written.json);
    } else {
        say(&written.text);
        say(&format!("Comparison: {}", written.folder.display()));
    }
    Ok(())
}
