//! `report.html`: the report for people who rather look. One file that stands alone.

use std::path::Path;

use super::ReportError;
use super::json::{ArcReport, BlockReport, FaultReport, Report, ReversalReport, ScanRange};
use super::page::{Cell, Page};
use super::text::{number, worst_blocks};

/// Rows of a table that are shown without being asked for.
const ROWS_OPEN: usize = 24;
/// Rows of a table; what is beyond them stands in report.json.
const ROWS_MAX: usize = 400;

/// The page; the plots are read from the run directory, where they were drawn just now.
pub(super) fn page(
    report: &Report,
    run_dir: &Path,
    circles: &[String],
) -> Result<String, ReportError> {
    let mut page = Page::new(&format!("{} on {}", report.program, report.machine));
    head(report, &mut page);
    faults(report, &mut page);
    numbers(report, &mut page);
    page.heading("Following error");
    following_error(report, &mut page);
    page.plot(
        &run_dir.join("tracking.svg"),
        "Following error of every axis over time",
    )?;
    blocks(report, &mut page);
    arcs(report, &mut page);
    for (index, circle) in circles.iter().enumerate() {
        let what = format!("Radial deviation of circle {}, exaggerated", index + 1);
        page.plot(&run_dir.join(circle), &what)?;
    }
    reversals(report, &mut page);
    axes(report, &mut page);
    foot(report, &mut page);
    Ok(page.finish())
}

/// How it ended, as one would say it: whether well, the word, and the rest.
pub(super) fn outcome_words(report: &Report) -> (bool, &'static str, String) {
    let reason = report.outcome.reason.as_deref();
    match report.outcome.kind.as_str() {
        "completed" => (true, "Completed.", "The program ran to its end.".into()),
        "interrupted" => (
            false,
            "Interrupted.",
            reason.map_or_else(
                || "Somebody stopped the run before the program's end.".into(),
                str::to_string,
            ),
        ),
        _ => (
            false,
            "Stopped.",
            reason.unwrap_or("The log does not say why.").into(),
        ),
    }
}

/// Time of a scan in s.
fn time_s(report: &Report, scan: u64) -> f64 {
    scan as f64 * f64::from(report.scan_period_us) * 1e-6
}

fn head(report: &Report, page: &mut Page) {
    let wall = match (report.wall_s, report.real_time_factor) {
        (Some(wall_s), Some(factor)) => {
            format!(" · {wall_s:.3} s of wall time, {factor:.1} × real time")
        }
        _ => String::new(),
    };
    page.headline(
        &format!("{} on {}", report.program, report.machine),
        &format!(
            "{:.3} s of machine time · {} scans of {} µs · {}{wall}",
            time_s(report, report.scans),
            report.scans,
            report.scan_period_us,
            report.pace
        ),
    );
    let (good, word, rest) = outcome_words(report);
    page.outcome(good, word, &rest);
    let mut warnings = Vec::new();
    if let Some(cut) = &report.log.cut {
        warnings.push(format!(
            "The log is not whole: {cut}. What follows is of the part that is there."
        ));
    }
    if report.log.program_matches == Some(false) {
        warnings.push("The program in this folder is not the one that ran: path, arcs and contour error mean nothing.".into());
    }
    let missing = |range: &ScanRange| range.last - range.first + 1;
    let missing: u64 = report.missing_scans.iter().map(missing).sum();
    if missing > 0 {
        warnings.push(format!(
            "{missing} scans are missing in the log, in {}: no reversal is measured across a gap, arcs are measured on the rest.",
            match report.missing_scans.len() {
                1 => "one gap".to_string(),
                gaps => format!("{gaps} gaps"),
            }
        ));
    }
    if report.samples_lost > 0 {
        warnings.push(format!(
            "{} samples are missing in the log: its digest compares with no other run's.",
            report.samples_lost
        ));
    }
    let limits = &report.limits;
    for (count, what) in [
        (limits.velocity_exceeded, "velocity"),
        (limits.acceleration_exceeded, "acceleration"),
        (limits.jerk_exceeded, "jerk"),
        (limits.travel_exceeded, "travel"),
    ] {
        if count > 0 {
            warnings.push(format!(
                "{count} setpoints were beyond the limit of {what}."
            ));
        }
    }
    page.list(&warnings);
}

fn faults(report: &Report, page: &mut Page) {
    if report.faults.is_empty() {
        page.paragraph("No process was lost.");
        return;
    }
    page.heading("Faults");
    let texts = report.faults.iter().take(ROWS_MAX);
    let texts: Vec<String> = texts.map(|fault| fault_words(report, fault)).collect();
    page.list(&texts);
    more(report.faults.len(), page);
}

fn fault_words(report: &Report, fault: &FaultReport) -> String {
    let noticed = match fault.noticed_after_scans {
        Some(0) => ", noticed in the same scan".into(),
        Some(1) => ", noticed after 1 scan".into(),
        Some(scans) => format!(", noticed after {scans} scans"),
        None => String::new(),
    };
    let braked = match (fault.brake_distance_mm, fault.deviation_um) {
        (None, None) => String::new(),
        (distance, deviation) => format!(
            " It braked in {} mm, up to {} µm off the path.",
            number(distance, 2),
            number(deviation, 1)
        ),
    };
    let resumed = fault
        .resumed_at_scan
        .filter(|scan| *scan > fault.scan + 1)
        .map_or(String::new(), |scan| {
            format!(
                " Motion went on at {:.3} s (scan {scan}).",
                time_s(report, scan)
            )
        });
    let reaction = match fault.reaction.as_str() {
        "none" => "nothing, motion did not depend on it",
        reaction => reaction,
    };
    format!(
        "At {:.3} s (scan {}) {} was lost: {}{noticed}. What followed: {reaction}.{braked}{resumed} Contour error up to {:.2} µm.",
        time_s(report, fault.scan),
        fault.scan,
        fault.process,
        fault.kind,
        fault.contour_error_um_max
    )
}

fn numbers(report: &Report, page: &mut Page) {
    let worst = |values: &mut dyn Iterator<Item = f64>| values.reduce(f64::max);
    let um = |value: f64| format!("{value:.2} µm");
    let contour = report.contour_error_um;
    let mut numbers = vec![("Contour error, peak", um(contour.peak))];
    let following = &mut report.axes.iter().map(|axis| axis.following_error_um.peak);
    if let Some(peak) = worst(following) {
        numbers.push(("Following error, peak", um(peak)));
    }
    let deviations = &mut report.arcs.iter().map(|arc| arc.circular_deviation_um);
    if let Some(deviation) = worst(deviations) {
        numbers.push(("Circular deviation, worst", um(deviation)));
    }
    let steady = report.reversals.iter().filter(|reversal| reversal.steady);
    if let Some(protrusion) = worst(&mut steady.filter_map(|r| r.protrusion_um)) {
        numbers.push(("Protrusion, worst", um(protrusion)));
    }
    let missed: u64 = report.axes.iter().map(|a| u64::from(a.missed_scans)).sum();
    numbers.push(("Missed scans", missed.to_string()));
    numbers.push(("Lost processes", report.faults.len().to_string()));
    page.numbers(&numbers);
}

fn following_error(report: &Report, page: &mut Page) {
    page.note("Command minus feedback, compensation not counted, in µm. Percentiles over the scans with drives on; at most 0.8 % too high.");
    let rows = report.axes.iter().map(|axis| {
        let error = &axis.following_error_um;
        let values = [error.p50, error.p95, error.p99, error.peak, error.rms];
        let mut row = vec![Cell::Text(axis.axis.clone())];
        row.extend(values.map(|value| Cell::Number(Some(value), 2)));
        row
    });
    page.table(
        &["<Axis", "50 %", "95 %", "99 %", "Peak", "rms"],
        rows.collect(),
    );
}

fn blocks(report: &Report, page: &mut Page) {
    if report.blocks.is_empty() {
        return;
    }
    let following: Vec<String> = report
        .axes
        .iter()
        .map(|axis| format!("Following error {}", axis.axis))
        .collect();
    let mut heads = vec!["Line", "Scans", "Contour error"];
    heads.extend(following.iter().map(String::as_str));
    let rows = |most: usize| -> Vec<Vec<Cell>> {
        let blocks = worst_blocks(report, most).into_iter();
        blocks.map(|block| block_row(report, block)).collect()
    };
    page.heading("Peaks per block");
    let count = report.blocks.len();
    if count <= ROWS_OPEN {
        page.note("In µm; a block is a line of the program, all passes through it together.");
        page.table(&heads, rows(count));
        return;
    }
    page.note(&format!(
        "In µm; a block is a line of the program, all passes through it together. The {ROWS_OPEN} of {count} with the largest contour error:"
    ));
    page.table(&heads, rows(ROWS_OPEN));
    let shown = count.min(ROWS_MAX);
    page.folded(&format!("{shown} of {count} blocks"), |page| {
        page.table(&heads, rows(shown));
        more(count, page);
    });
}

fn block_row(report: &Report, block: &BlockReport) -> Vec<Cell> {
    let mut row = vec![
        Cell::Count(block.block.into()),
        Cell::Count(block.scans),
        Cell::Number(Some(block.contour_error_um_peak), 2),
    ];
    let errors = report.axes.iter().map(|axis| {
        let error = block.following_error_um_peak.get(&axis.axis);
        Cell::Number(error.copied(), 2)
    });
    row.extend(errors);
    row
}

fn arcs(report: &Report, page: &mut Page) {
    if report.arcs.is_empty() {
        return;
    }
    page.heading("Circles and arcs");
    page.note("On the table, in the terms of ISO 230-4, in µm. Circular deviation G about the least-squares centre, measured over the steady part; * scans of it are missing in the log.");
    let rows = report.arcs.iter().take(ROWS_MAX).map(arc_row).collect();
    page.table(
        &[
            "Line",
            "<Plane",
            "Radius mm",
            "Feed mm/min",
            "<Direction",
            "Measured °",
            "G",
            "Centre 1st",
            "Centre 2nd",
            "Radius error",
            "G of the motors",
        ],
        rows,
    );
    more(report.arcs.len(), page);
}

fn arc_row(arc: &ArcReport) -> Vec<Cell> {
    let turn = if arc.clockwise {
        "clockwise"
    } else {
        "counter-clockwise"
    };
    let centre = |index: usize| {
        let offset = arc.centre_offset_um.as_ref();
        offset.and_then(|offset| offset.get(index).copied())
    };
    let gap = if arc.missing_scans > 0 { "*" } else { "" };
    vec![
        Cell::Count(arc.block.into()),
        Cell::Text(arc.plane.clone()),
        Cell::Number(Some(arc.radius_mm), 3),
        Cell::Number(Some(arc.feed_mm_min.unwrap_or(arc.speed_mm_min)), 0),
        Cell::Text(turn.into()),
        Cell::Right(format!("{:.0}{gap}", arc.measured_deg)),
        Cell::Number(Some(arc.circular_deviation_um), 2),
        Cell::Number(centre(0), 2),
        Cell::Number(centre(1), 2),
        Cell::Number(arc.radius_error_um, 2),
        Cell::Number(Some(arc.motor_circular_deviation_um), 2),
    ]
}

fn reversals(report: &Report, page: &mut Page) {
    let on_arcs: Vec<&ReversalReport> = report
        .reversals
        .iter()
        .filter(|reversal| reversal.protrusion_um.is_some())
        .collect();
    if on_arcs.is_empty() {
        return;
    }
    page.heading("Reversals");
    page.note(&format!(
        "{} in all, {} on arcs. In µm; + outward, the axis is late. * Not in steady motion.",
        report.reversals.len(),
        on_arcs.len()
    ));
    let fill = |page: &mut Page| {
        let rows = on_arcs.iter().take(ROWS_MAX);
        let rows = rows.map(|reversal| reversal_row(report, reversal));
        page.table(
            &[
                "<Axis",
                "Time s",
                "Line",
                "Radius mm",
                "Feed mm/min",
                "Protrusion",
                "Undercut",
                "Width ms",
                "Kick lead ms",
            ],
            rows.collect(),
        );
        more(on_arcs.len(), page);
    };
    if on_arcs.len() <= ROWS_OPEN {
        fill(page);
    } else {
        page.folded(&format!("All {} reversals on arcs", on_arcs.len()), fill);
    }
}

fn reversal_row(report: &Report, reversal: &ReversalReport) -> Vec<Cell> {
    let sign = if reversal.new_direction > 0 {
        '+'
    } else {
        '−'
    };
    let steady = if reversal.steady { "" } else { " *" };
    vec![
        Cell::Text(format!("{}{sign}{steady}", reversal.axis)),
        Cell::Number(Some(time_s(report, reversal.scan)), 3),
        Cell::Number(reversal.block.map(f64::from), 0),
        Cell::Number(reversal.radius_mm, 3),
        Cell::Number(reversal.feed_mm_min, 0),
        Cell::Number(reversal.protrusion_um, 2),
        Cell::Number(reversal.undercut_um, 2),
        Cell::Number(reversal.width_half_height_ms, 1),
        Cell::Number(reversal.kick_lead_ms, 2),
    ]
}

fn axes(report: &Report, page: &mut Page) {
    page.heading("Drives");
    if let Some(axis) = report.axes.first() {
        page.note(&format!(
            "Winding: rise above an assumed room temperature of {} °C.",
            axis.ambient_c
        ));
    }
    let rows = report.axes.iter().map(|axis| {
        vec![
            Cell::Text(axis.axis.clone()),
            Cell::Text(axis.drive_mode.into()),
            Cell::Number(Some(axis.torque_peak_nm), 2),
            Cell::Number(Some(axis.torque_rms_nm), 2),
            Cell::Number(Some(axis.torque_rms_percent), 0),
            Cell::Number(Some(axis.winding_c_peak), 1),
            Cell::Count(axis.missed_scans.into()),
        ]
    });
    page.table(
        &[
            "<Axis",
            "<Mode",
            "Peak torque Nm",
            "rms Nm",
            "% of rated",
            "Winding °C",
            "Missed scans",
        ],
        rows.collect(),
    );
    let predictions = report
        .axes
        .iter()
        .filter_map(|axis| Some(axis.prediction.as_ref()?.words(&axis.axis)));
    page.list(&predictions.collect::<Vec<_>>());
}

fn foot(report: &Report, page: &mut Page) {
    page.heading("Processes and log");
    let rows = report.processes.iter().map(|process| {
        vec![
            Cell::Text(process.process.clone()),
            Cell::Count(process.starts.into()),
            Cell::Count(process.deaths.len() as u64),
        ]
    });
    if !report.processes.is_empty() {
        page.table(&["<Process", "Starts", "Deaths"], rows.collect());
    }
    let limits = &report.limits;
    page.list(&[
        format!(
            "Setpoints beyond limits: velocity {}, acceleration {}, travel {}",
            limits.velocity_exceeded, limits.acceleration_exceeded, limits.travel_exceeded
        ),
        format!(
            "Windows {} (voided {}), overrun scans {}, samples lost {}, log in {} {}",
            report.windows,
            report.windows_voided,
            report.overrun_scans,
            report.samples_lost,
            report.parts.len(),
            if report.parts.len() == 1 {
                "part"
            } else {
                "parts"
            }
        ),
        format!("Digest {}", report.digest),
        format!(
            "Motion digest {}",
            report.motion_digest.as_deref().unwrap_or("–")
        ),
        format!(
            "Quadrant {}. All numbers stand in report.json; every sample in run.mcap.",
            report.quadrant
        ),
    ]);
}

fn more(count: usize, page: &mut Page) {
    if count > ROWS_MAX {
        page.note(&format!("… and {} more in report.json", count - ROWS_MAX));
    }
}
