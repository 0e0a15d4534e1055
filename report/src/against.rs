//! Two runs of one program side by side: what a changed machine file, plant or fault script did to it.

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use console::output::joined;
use machine::Machine;
use serde::Serialize;
use serde_json::{Map, Value as Json, json};

use super::document::{Block, Columns, Document, section};
use super::error::ReportError;
use super::evaluation::{evaluate, program_file};
use super::files::write;
use super::json::Report;
use super::side_by_side::SideBySide;
use super::text::shortened;
use super::{circle_plot, contents, html, text, tracking_plot};
use monitor::log::RunLog;

/// Settings that the text shows.
const SETTINGS_IN_TEXT: usize = 20;

/// A setting that is not the same.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Setting {
    /// File in the run directory.
    pub file: String,
    /// Path of the key in it.
    pub key: String,
    /// What A has; null if it has none.
    pub a: Option<String>,
    /// What B has.
    pub b: Option<String>,
}

/// What a comparison wrote.
pub struct Written {
    /// Its folder, in the run directory of A.
    pub folder: PathBuf,
    /// The text of its report.txt.
    pub text: String,
    /// The text of its report.json.
    pub json: String,
}

/// Name that people know a run directory by.
fn run_name(run_dir: &Path) -> Result<String, ReportError> {
    let path = run_dir.canonicalize().map_err(|source| ReportError::Read {
        path: run_dir.into(),
        source,
    })?;
    let name = path.file_name().map(|name| name.to_string_lossy());
    Ok(name.map_or_else(|| "root".into(), |name| name.into_owned()))
}

/// Measures both runs and writes `report.txt`, `report.html`, `report.json` and plots into `against-NAME` in the directory
/// of `a`, NAME being that of `b`. Nothing is written into `b`.
///
/// `settings` are the settings in which they differ: the plant's are none of the monitor's business, so whoever may see them
/// compares them.
///
/// # Errors
/// As [`super::make_report`]; also if the runs are of different machines or programs, or one and the same.
pub fn make_against(a: &Path, b: &Path, settings: Vec<Setting>) -> Result<Written, ReportError> {
    let names = [run_name(a)?, run_name(b)?];
    comparable(a, b)?;
    let runs = [&evaluate(a)?, &evaluate(b)?];
    let reports = runs.map(Report::new);
    let folder = a.join(format!("against-{}", names[1]));
    std::fs::create_dir_all(&folder).map_err(|source| ReportError::Write {
        path: folder.clone(),
        source,
    })?;
    tracking_plot::draw(&folder, &runs, &names)?;
    let circles = circle_plot::draw_all_against(&folder, runs, &names)?;
    let [of_a, of_b] = reports
        .each_ref()
        .map(|r| contents::document(r, &contents::Pictures::default()));
    let compared = SideBySide::of(&of_a, &of_b);
    let document = document(&reports, &names, &settings, &compared, &circles);
    let json = to_json(&reports, &names, &settings, compared.json);
    let text = text::render(&document);
    write(&folder, "report.txt", &text)?;
    write(&folder, "report.html", &html::render(&document, &folder)?)?;
    write(&folder, "report.json", &json)?;
    Ok(Written { folder, text, json })
}

/// Refuses runs whose numbers say nothing about each other.
fn comparable(a: &Path, b: &Path) -> Result<(), ReportError> {
    let refused = |what: String| {
        Err(ReportError::Compare {
            what: format!(
                "{} cannot be held against {}: {what}",
                a.display(),
                b.display()
            ),
        })
    };
    if a.canonicalize().ok() == b.canonicalize().ok() {
        return refused("it is the same run".into());
    }
    let machines = [Machine::load(a)?, Machine::load(b)?];
    let mut differ = Vec::new();
    let [first, second] = &machines;
    if first.name != second.name {
        differ.push(format!(
            "their machines are {} and {}",
            first.name, second.name
        ));
    }
    let axes = machines
        .each_ref()
        .map(|machine| joined(machine.axes.iter().map(|axis| &axis.name), " "));
    if axes[0] != axes[1] {
        differ.push(format!("their axes are {} and {}", axes[0], axes[1]));
    }
    let program = |run_dir: &Path| -> Result<(String, String), ReportError> {
        let reader = RunLog::open(run_dir)?;
        let path = program_file(run_dir, reader.info())?;
        let text = std::fs::read(&path).map_err(|source| ReportError::Read { path, source })?;
        let text = String::from_utf8_lossy(&text).into_owned();
        Ok((reader.info().program.clone(), text))
    };
    let ((name_a, text_a), (name_b, text_b)) = (program(a)?, program(b)?);
    if let Some(line) = first_difference(&text_a, &text_b) {
        let shown = |text: &str| match text.lines().nth(line - 1) {
            Some(text) => format!("\"{}\"", shortened(text.trim(), 60)),
            None => "nothing".into(),
        };
        differ.push(format!(
            "their programs, {name_a} and {name_b}, differ from line {line} on: {} and {}",
            shown(&text_a),
            shown(&text_b)
        ));
    }
    if differ.is_empty() {
        return Ok(());
    }
    refused(format!(
        "{}; only runs of one program on one machine are compared, their settings may differ",
        differ.join("; ")
    ))
}

/// First line, from 1, in which two programs differ; ends of lines do not count.
fn first_difference(a: &str, b: &str) -> Option<usize> {
    let (mut a, mut b) = (a.lines(), b.lines());
    let mut line = 0;
    loop {
        line += 1;
        match (a.next(), b.next()) {
            (None, None) => return None,
            (a, b) if a == b => {}
            _ => return Some(line),
        }
    }
}

/// Whether both moved the same to the bit; none where one has no digest.
fn same_motion([a, b]: &[Report; 2]) -> Option<bool> {
    let digests = a.motion_digest.as_ref().zip(b.motion_digest.as_ref());
    digests.map(|(a, b)| a == b)
}

/// The text of `report.json`: what differs besides the numbers, and the numbers.
fn to_json(
    reports: &[Report; 2],
    names: &[String; 2],
    settings: &[Setting],
    mut compared: Map<String, Json>,
) -> String {
    let side = |report: &Report, run: &str| {
        json!({
            "run": run,
            "quadrant": report.quadrant,
            "pace": report.pace,
            "outcome": report.outcome,
            "cut": report.log.cut,
            "program_matches": report.log.program_matches,
            "motion_digest": report.motion_digest,
            "faults": report.faults,
        })
    };
    let [a, b] = reports;
    for (key, value) in [
        ("machine", json!(a.machine)),
        ("program", json!(a.program)),
        ("a", side(a, &names[0])),
        ("b", side(b, &names[1])),
        ("same_motion", json!(same_motion(reports))),
        ("settings", json!(settings)),
    ] {
        compared.insert(key.into(), value);
    }
    // Numbers and strings: it cannot fail, and if it did the file would show it.
    let mut text = serde_json::to_string_pretty(&compared).unwrap_or_default();
    text.push('\n');
    text
}

/// The comparison for people.
fn document(
    reports: &[Report; 2],
    names: &[String; 2],
    settings: &[Setting],
    compared: &SideBySide,
    circles: &[String],
) -> Document {
    let [a, _] = reports;
    let [name_a, name_b] = names;
    let mut head = Vec::new();
    for (letter, (report, name)) in ["A", "B"].into_iter().zip(reports.iter().zip(names)) {
        let run = format!("{letter}  {name}, {}", report.pace);
        head.extend(contents::ending(report, Some(run)));
        head.push(Block::List(contents::faults(report)));
    }
    let motion = match same_motion(reports) {
        Some(true) => "Both moved the same to the bit (motion digest).",
        Some(false) => "Their motion is not the same (motion digest).",
        None => "Whether their motion is the same is not known: a motion digest is missing.",
    };
    let note = "Differences are A - B, per cent those of B: minus is less than in B. Undercuts are negative.";
    head.extend([Block::Text(motion.into()), Block::Note(note.into())]);
    let side = |value: &Option<String>| value.clone().unwrap_or_else(|| "–".into());
    let mut table = Columns::of("settings that differ", settings)
        .words("File", |setting| setting.file.clone())
        .words("Setting", |setting| setting.key.clone())
        .words("A", |setting| side(&setting.a))
        .words("B", |setting| side(&setting.b))
        .done();
    table.rows_in_text = SETTINGS_IN_TEXT;
    let mut differ = vec![Block::Table(table)];
    if settings.is_empty() {
        differ = vec![Block::Text("The same in both.".into())];
    }
    let mut sections = vec![section("", head), section("Settings", differ)];
    for (key, mut section) in compared.sections() {
        if key == "following_error_um" {
            section.blocks.push(Block::Plot {
                file: "tracking.svg".into(),
                caption: "Following error of both runs over time".into(),
            });
        }
        if key == "circular_deviation_um" {
            let circles = contents::circle_plots(circles, "in both runs");
            section.blocks.extend(circles);
        }
        sections.push(section);
    }
    Document {
        title: format!("{name_a} against {name_b}"),
        about: format!("{} on {}: one run against another", a.program, a.machine),
        sections,
    }
}
