//! The comparison for people: text of 88 columns, and a page.

use std::fmt::Write as _;
use std::path::Path;

use super::{Against, Compared, Setting, Side};
use crate::report::ReportError;
use crate::report::json::FaultReport;
use crate::report::page::{Cell, Page};

/// Columns of the text.
const WIDTH: usize = 88;
/// Rows of one table in the text.
const ROWS_MAX: usize = 40;
/// Settings in the text.
const SETTINGS_MAX: usize = 20;
/// Rows of one table in the page.
const PAGE_ROWS_MAX: usize = 400;

/// One line of a table: what, both values, digits behind the point.
struct Row {
    what: String,
    values: Compared,
    digits: usize,
}

/// Lines under one headline.
struct Section {
    title: &'static str,
    rows: Vec<Row>,
}

fn row(what: impl Into<String>, values: Compared, digits: usize) -> Row {
    Row {
        what: what.into(),
        values,
        digits,
    }
}

/// At most so many characters; what is cut is shown by an ellipsis.
pub(super) fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.into();
    }
    let kept: String = text.chars().take(most.saturating_sub(1)).collect();
    format!("{kept}…")
}

fn sections(against: &Against) -> Vec<Section> {
    let contour = &against.contour_error_um;
    let mut sections = vec![Section {
        title: "Contour error on the table, in µm",
        rows: vec![row("peak", contour.peak, 2), row("rms", contour.rms, 2)],
    }];
    let errors = against.axes.iter().flat_map(|axis| {
        let error = &axis.following_error_um;
        [
            row(format!("{} peak", axis.axis), error.peak, 2),
            row(format!("{} 99 % of the scans", axis.axis), error.p99, 2),
            row(format!("{} rms", axis.axis), error.rms, 2),
        ]
    });
    sections.push(Section {
        title: "Following error, in µm",
        rows: errors.collect(),
    });
    let arcs = against.arcs.iter().map(|arc| {
        let turn = if arc.clockwise { "cw" } else { "ccw" };
        let feed = arc
            .feed_mm_min
            .map_or("rapid".into(), |feed| format!("F{feed:.0}"));
        let order = match arc.order {
            1 => String::new(),
            order => format!(", no. {order}"),
        };
        let what = format!(
            "line {} {} R{} {feed} {turn}{order}",
            arc.block, arc.plane, arc.radius_mm
        );
        row(what, arc.circular_deviation_um, 2)
    });
    sections.push(Section {
        title: "Circular deviation G, in µm",
        rows: arcs.collect(),
    });
    let all = &against.protrusions_um;
    if all.worst.a.or(all.worst.b).is_some() {
        sections.push(Section {
            title: "Reversals on arcs in steady motion, in µm",
            rows: vec![
                row("how many", all.count, 0),
                row("mean protrusion", all.mean, 2),
                row("highest protrusion", all.worst, 2),
                row("deepest undercut", all.deepest_undercut, 2),
            ],
        });
    }
    let reversals = against.reversals.iter().map(|reversal| {
        let sign = if reversal.new_direction > 0 { '+' } else { '-' };
        let block = reversal
            .block
            .map_or(String::new(), |block| format!(" line {block}"));
        let what = format!("{}{sign}{block}, no. {}", reversal.axis, reversal.order);
        row(what, reversal.protrusion_um, 2)
    });
    sections.push(Section {
        title: "Protrusion of each reversal on an arc, in µm",
        rows: reversals.collect(),
    });
    let mut timing = vec![
        row("machine time, s", against.machine_time_s, 3),
        row("wall time, s", against.wall_s, 3),
    ];
    let missed = against.axes.iter();
    timing.extend(
        missed.map(|axis| row(format!("missed scans {}", axis.axis), axis.missed_scans, 0)),
    );
    timing.push(row("overrun scans", against.overrun_scans, 0));
    timing.push(row("samples lost in the log", against.samples_lost, 0));
    timing.push(row("lost processes", against.faults, 0));
    sections.push(Section {
        title: "Timing and faults",
        rows: timing,
    });
    let limits = &against.limits;
    sections.push(Section {
        title: "Setpoints beyond limits",
        rows: vec![
            row("velocity", limits.velocity_exceeded, 0),
            row("acceleration", limits.acceleration_exceeded, 0),
            row("jerk", limits.jerk_exceeded, 0),
            row("travel", limits.travel_exceeded, 0),
        ],
    });
    let torque = against.axes.iter();
    let torque = torque.map(|axis| row(axis.axis.clone(), axis.torque_rms_nm, 2));
    sections.push(Section {
        title: "Motor torque, rms in Nm",
        rows: torque.collect(),
    });
    sections.retain(|section| !section.rows.is_empty());
    sections
}

fn outcome(side: &Side) -> String {
    let kind = side.outcome.kind.to_uppercase();
    let mut text = match &side.outcome.reason {
        Some(reason) => format!("{kind}: {reason}"),
        None => kind,
    };
    if let Some(cut) = &side.cut {
        let _ = write!(text, "; THE LOG IS NOT WHOLE: {cut}");
    }
    if side.program_matches == Some(false) {
        text += "; THE PROGRAM IN ITS FOLDER IS NOT THE ONE THAT RAN";
    }
    text
}

fn motion(against: &Against) -> &'static str {
    match against.same_motion {
        Some(true) => "Both moved the same to the bit (motion digest).",
        Some(false) => "Their motion is not the same (motion digest).",
        None => "Whether their motion is the same is not known: a motion digest is missing.",
    }
}

fn fault(fault: &FaultReport) -> String {
    format!(
        "scan {}: {} {}: {}; contour error up to {:.2} µm",
        fault.scan, fault.process, fault.kind, fault.reaction, fault.contour_error_um_max
    )
}

fn value(value: Option<f64>, digits: usize) -> String {
    value.map_or("–".into(), |value| format!("{value:.digits$}"))
}

/// With its sign; nothing where nothing differs.
fn signed(value: Option<f64>, digits: usize) -> String {
    match value {
        None => "–".into(),
        Some(0.0) => "=".into(),
        Some(value) => format!("{value:+.digits$}"),
    }
}

fn per_cent(values: &Compared) -> String {
    match values.per_cent {
        Some(0.0) => String::new(),
        Some(per_cent) => format!("{per_cent:+.1} %"),
        None => String::new(),
    }
}

fn setting(setting: &Setting) -> String {
    let side = |value: &Option<String>| value.clone().unwrap_or_else(|| "not there".into());
    format!(
        "{} {}: {} / {}",
        setting.file,
        setting.key,
        side(&setting.a),
        side(&setting.b)
    )
}

/// The text.
pub(super) fn text(against: &Against) -> String {
    let mut page = String::new();
    // Writing to a string cannot fail.
    let mut line = |text: String| {
        page.push_str(&text);
        page.push('\n');
    };
    line(shortened(
        &format!(
            "{} on {}: one run against another",
            against.program, against.machine
        ),
        WIDTH,
    ));
    line("=".repeat(72));
    for (letter, side) in [("A", &against.a), ("B", &against.b)] {
        line(shortened(
            &format!("{letter}  {}, {}", side.run, side.pace),
            WIDTH,
        ));
        wrapped(&outcome(side), "   ", &mut line);
    }
    line(motion(against).into());
    line("Differences are A - B, per cent those of B. Undercuts are negative.".into());
    line(String::new());
    if against.settings.is_empty() {
        line("Settings: the same in both".into());
    } else {
        line("Settings that differ, A / B".into());
        for different in against.settings.iter().take(SETTINGS_MAX) {
            line(shortened(&format!("  {}", setting(different)), WIDTH));
        }
        more(against.settings.len(), SETTINGS_MAX, &mut line);
    }
    line(String::new());
    for section in sections(against) {
        line(
            format!(
                "{:<45}{:>11}{:>11}{:>11}{:>10}",
                section.title, "A", "B", "A - B", ""
            )
            .trim_end()
            .into(),
        );
        for row in section.rows.iter().take(ROWS_MAX) {
            let values = &row.values;
            let text = format!(
                "  {:<43}{:>11}{:>11}{:>11}{:>10}",
                shortened(&row.what, 42),
                value(values.a, row.digits),
                value(values.b, row.digits),
                signed(values.difference, row.digits),
                per_cent(values)
            );
            line(text.trim_end().into());
        }
        more(section.rows.len(), ROWS_MAX, &mut line);
        line(String::new());
    }
    for (letter, side) in [("A", &against.a), ("B", &against.b)] {
        if !side.faults.is_empty() {
            line(format!("Faults in {letter}"));
        }
        for one in side.faults.iter().take(ROWS_MAX) {
            wrapped(&fault(one), "  ", &mut line);
        }
        more(side.faults.len(), ROWS_MAX, &mut line);
    }
    page
}

/// In lines of the text's width.
fn wrapped(text: &str, indent: &str, line: &mut impl FnMut(String)) {
    let mut current = String::new();
    for word in text.split_whitespace() {
        let longer = indent.len() + current.chars().count() + 1 + word.chars().count();
        if !current.is_empty() && longer > WIDTH {
            line(format!("{indent}{current}"));
            current.clear();
        }
        if !current.is_empty() {
            current.push(' ');
        }
        current.push_str(word);
    }
    line(shortened(&format!("{indent}{current}"), WIDTH));
}

fn more(count: usize, shown: usize, line: &mut impl FnMut(String)) {
    if count > shown {
        line(format!("  … and {} more in report.json", count - shown));
    }
}

/// The page; the plots are read from the folder, where they were drawn just now.
pub(super) fn html(
    against: &Against,
    folder: &Path,
    circles: &[String],
) -> Result<String, ReportError> {
    let (a, b) = (&against.a, &against.b);
    let mut page = Page::new(&format!("{} against {}", a.run, b.run));
    page.headline(
        &format!("{} against {}", a.run, b.run),
        &format!("{} on {}", against.program, against.machine),
    );
    for (letter, side) in [("A", a), ("B", b)] {
        let good = side.outcome.kind == "completed" && side.cut.is_none();
        let rest = format!("{}, {}: {}", side.run, side.pace, outcome(side));
        page.outcome(good, letter, &rest);
        let faults = side.faults.iter().take(PAGE_ROWS_MAX).map(fault);
        page.list(&faults.collect::<Vec<_>>());
    }
    page.paragraph(motion(against));
    page.note("Differences are A − B, per cent those of B: minus is less than in B. Undercuts are negative.");
    settings(against, &mut page);
    for section in sections(against) {
        page.heading(section.title);
        let count = section.rows.len();
        let rows = section.rows.into_iter().take(PAGE_ROWS_MAX).map(|row| {
            vec![
                Cell::Text(row.what),
                Cell::Number(row.values.a, row.digits),
                Cell::Number(row.values.b, row.digits),
                Cell::Right(signed(row.values.difference, row.digits)),
                Cell::Right(per_cent(&row.values)),
            ]
        });
        let rows = rows.collect();
        page.table(&["<", "A", "B", "A − B", "%"], rows);
        if count > PAGE_ROWS_MAX {
            let more = count - PAGE_ROWS_MAX;
            page.note(&format!("… and {more} more in report.json"));
        }
        match section.title {
            "Following error, in µm" => page.plot(
                &folder.join("tracking.svg"),
                "Following error of both runs over time",
            )?,
            "Circular deviation G, in µm" => {
                for (index, circle) in circles.iter().enumerate() {
                    let what = format!("Radial deviation of circle {} in both runs", index + 1);
                    page.plot(&folder.join(circle), &what)?;
                }
            }
            _ => {}
        }
    }
    Ok(page.finish())
}

fn settings(against: &Against, page: &mut Page) {
    page.heading("Settings");
    if against.settings.is_empty() {
        page.paragraph("The same in both.");
        return;
    }
    let side = |value: &Option<String>| Cell::Long(value.clone().unwrap_or_else(|| "–".into()));
    let rows = against.settings.iter().take(PAGE_ROWS_MAX).map(|setting| {
        vec![
            Cell::Text(setting.file.clone()),
            Cell::Text(setting.key.clone()),
            side(&setting.a),
            side(&setting.b),
        ]
    });
    let rows = rows.collect();
    let fill = |page: &mut Page| page.table(&["<File", "<Setting", "<A", "<B"], rows);
    let count = against.settings.len();
    if count <= 24 {
        fill(page);
    } else {
        page.folded(&format!("{count} settings differ"), fill);
    }
}
