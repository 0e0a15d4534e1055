//! `report.txt`: one page for people.

use std::fmt::Write as _;

use super::json::{ArcReport, BlockReport, Report, ReversalReport, ScanRange};

/// Lines that a table shows before it says how many more there are.
const ROWS_MAX: usize = 40;
/// Blocks that the table shows: those with the largest contour error.
const BLOCKS_MAX: usize = 16;
/// Gaps of the log that are named in a line before it says how many more there are.
const GAPS_MAX: usize = 5;

/// The page.
pub fn page(report: &Report) -> String {
    let mut page = String::new();
    head(report, &mut page);
    axes(report, &mut page);
    following_error(report, &mut page);
    blocks(report, &mut page);
    arcs(report, &mut page);
    reversals(report, &mut page);
    processes(report, &mut page);
    foot(report, &mut page);
    page
}

// Writing to a string cannot fail; the macro keeps that out of sight.
macro_rules! line {
    ($page:expr) => { $page.push('\n') };
    ($page:expr, $($what:tt)*) => {{ let _ = writeln!($page, $($what)*); }};
}

fn head(report: &Report, page: &mut String) {
    let reason = report.outcome.reason.as_deref();
    let outcome = match reason {
        Some(reason) => format!("{}: {reason}", report.outcome.kind.to_uppercase()),
        None => report.outcome.kind.to_uppercase(),
    };
    line!(
        page,
        "{} on {}    {outcome}",
        report.program,
        report.machine
    );
    line!(page, "{}", "=".repeat(72));
    let period_s = f64::from(report.scan_period_us) * 1e-6;
    line!(
        page,
        "{:.3} s of machine time, {} scans of {} µs, distribution period {} scans, {}",
        report.scans as f64 * period_s,
        report.scans,
        report.scan_period_us,
        report.distribution_period_scans,
        report.pace
    );
    if let (Some(wall_s), Some(factor)) = (report.wall_s, report.real_time_factor) {
        line!(page, "{wall_s:.3} s of wall time: {factor:.1} × real time");
    }
    if let Some(cut) = &report.log.cut {
        line!(
            page,
            "THE LOG IS NOT WHOLE: {cut}. What follows is of the part that is there."
        );
    }
    log_parts(report, page);
    if report.log.program_matches == Some(false) {
        line!(
            page,
            "THE PROGRAM IN THIS FOLDER IS NOT THE ONE THAT RAN: path, arcs and contour error mean nothing."
        );
    }
    line!(
        page,
        "Contour error on the table: peak {:.2} µm, rms {:.2} µm",
        report.contour_error_um.peak,
        report.contour_error_um.rms
    );
    line!(page);
}

/// Says what the log does not have.
fn log_parts(report: &Report, page: &mut String) {
    let missing: Vec<String> = report
        .missing_scans
        .iter()
        .take(GAPS_MAX)
        .map(scans)
        .collect();
    let missing = match (missing.as_slice(), report.missing_scans.len()) {
        ([], _) => "no scan is missing".into(),
        (one, 1) if report.missing_scans.iter().all(|r| r.first == r.last) => {
            format!("{} is missing", one.join(""))
        }
        (some, count) if count > GAPS_MAX => {
            format!(
                "{} and {} more are missing",
                some.join(", "),
                count - GAPS_MAX
            )
        }
        (all, _) => format!("{} are missing", all.join(", ")),
    };
    match report.parts.len() {
        0 | 1 if report.missing_scans.is_empty() => return,
        0 | 1 => line!(page, "LOG WITH GAPS: {missing}"),
        count => line!(page, "log in {count} parts: {missing}"),
    }
    if report.parts.len() > 1 {
        for part in report.parts.iter().take(ROWS_MAX) {
            let from_to = match (part.first_scan, part.last_scan) {
                (Some(first), Some(last)) => format!("scans {first} to {last}"),
                _ => "no scan".into(),
            };
            let cut = if part.cut { ", cut off" } else { "" };
            line!(page, "  {:<14} {from_to}{cut}", part.file);
        }
        more(report.parts.len(), page);
    }
    if !report.missing_scans.is_empty() {
        line!(
            page,
            "What is missing is not bridged: no reversal is measured across it, arcs marked ! are measured on the rest."
        );
    }
}

fn scans(range: &ScanRange) -> String {
    if range.first == range.last {
        format!("scan {}", range.first)
    } else {
        format!("scans {} to {}", range.first, range.last)
    }
}

fn axes(report: &Report, page: &mut String) {
    line!(
        page,
        "Axes            following error      torque               winding   missed"
    );
    line!(
        page,
        "                peak µm   rms µm    peak Nm  rms Nm  rated     °C    scans"
    );
    for axis in &report.axes {
        line!(
            page,
            "  {:<2} {:<9} {:>8.2} {:>8.2}    {:>7.2} {:>7.2} {:>5.0} %  {:>5.1}  {:>7}",
            axis.axis,
            axis.drive_mode,
            axis.following_error_um.peak,
            axis.following_error_um.rms,
            axis.torque_peak_nm,
            axis.torque_rms_nm,
            axis.torque_rms_percent,
            axis.winding_c_peak,
            axis.missed_scans
        );
    }
    for axis in &report.axes {
        if let Some(prediction) = &axis.prediction {
            line!(page, "  {}", prediction.words(&axis.axis));
        }
    }
    if let Some(axis) = report.axes.first() {
        line!(
            page,
            "  (winding: rise above an assumed room temperature of {} °C)",
            axis.ambient_c
        );
    }
    line!(page);
}

fn following_error(report: &Report, page: &mut String) {
    if report.axes.is_empty() {
        return;
    }
    line!(
        page,
        "Following error, in µm: 50, 95 and 99 % of the scans do not exceed (0.8 % too high at most)"
    );
    line!(page, "           50 %      95 %      99 %      peak");
    for axis in &report.axes {
        let error = &axis.following_error_um;
        line!(
            page,
            "  {:<2} {:>10.2}{:>10.2}{:>10.2}{:>10.2}",
            axis.axis,
            error.p50,
            error.p95,
            error.p99,
            error.peak
        );
    }
    line!(page);
}

/// The blocks with the largest contour error, at most `most`, in the order of the program.
pub(super) fn worst_blocks(report: &Report, most: usize) -> Vec<&BlockReport> {
    let mut blocks: Vec<&BlockReport> = report.blocks.iter().collect();
    let peak = |block: &BlockReport| block.contour_error_um_peak;
    blocks.sort_by(|a, b| peak(b).total_cmp(&peak(a)).then(a.block.cmp(&b.block)));
    blocks.truncate(most);
    blocks.sort_by_key(|block| block.block);
    blocks
}

fn blocks(report: &Report, page: &mut String) {
    if report.blocks.is_empty() {
        return;
    }
    let count = report.blocks.len();
    line!(
        page,
        "Peaks per block, in µm: contour error, following error of each axis"
    );
    if count > BLOCKS_MAX {
        line!(
            page,
            "(the {BLOCKS_MAX} of {count} with the largest contour error; all stand in report.json)"
        );
    }
    let heads = report.axes.iter().map(|axis| format!("{:>8}", axis.axis));
    line!(page, "  line    scans contour{}", heads.collect::<String>());
    for block in worst_blocks(report, BLOCKS_MAX) {
        let errors = report.axes.iter().map(|axis| {
            let error = block.following_error_um_peak.get(&axis.axis).copied();
            format!("{:>8}", number(error, 2))
        });
        line!(
            page,
            "{:>6} {:>8} {:>7.2}{}",
            block.block,
            block.scans,
            block.contour_error_um_peak,
            errors.collect::<String>()
        );
    }
    line!(page);
}

fn arcs(report: &Report, page: &mut String) {
    if report.arcs.is_empty() {
        return;
    }
    line!(
        page,
        "Circles and arcs, on the table (ISO 230-4; µm; centre and radius by least squares outside"
    );
    line!(
        page,
        "the reversal windows; G about that centre, measured over the steady part)"
    );
    line!(
        page,
        "  line plane   radius    feed dir   steady       G   centre offset    radius   motor"
    );
    line!(
        page,
        "                   mm  mm/min          deg              1st     2nd     error    G"
    );
    for arc in report.arcs.iter().take(ROWS_MAX) {
        line!(page, "{}", arc_row(arc));
    }
    more(report.arcs.len(), page);
    line!(page);
}

fn arc_row(arc: &ArcReport) -> String {
    let feed = arc.feed_mm_min.unwrap_or(arc.speed_mm_min);
    let turn = if arc.clockwise { "cw" } else { "ccw" };
    let offset = match arc.centre_offset_um {
        Some([first, second]) => format!("{first:>7.2} {second:>7.2}"),
        None => format!("{:>7} {:>7}", "–", "–"),
    };
    format!(
        "  {:>4} {:<5} {:>8.3} {feed:>7.0} {turn:<4} {:>7.0}{}{:>7.2}  {offset} {:>9} {:>7.2}",
        arc.block,
        arc.plane,
        arc.radius_mm,
        arc.measured_deg,
        if arc.missing_scans > 0 { '!' } else { ' ' },
        arc.circular_deviation_um,
        number(arc.radius_error_um, 2),
        arc.motor_circular_deviation_um,
    )
}

fn reversals(report: &Report, page: &mut String) {
    if report.reversals.is_empty() {
        return;
    }
    let on_arcs: Vec<&ReversalReport> = report
        .reversals
        .iter()
        .filter(|reversal| reversal.protrusion_um.is_some())
        .collect();
    line!(
        page,
        "Reversals: {} in all, {} on arcs (µm; + outward, the axis is late; * not in steady motion)",
        report.reversals.len(),
        on_arcs.len()
    );
    if !on_arcs.is_empty() {
        line!(
            page,
            "  axis      time s  line   radius    feed  protrusion  undercut  width  kick lead"
        );
        line!(
            page,
            "                             mm  mm/min                           ms         ms"
        );
    }
    for reversal in on_arcs.iter().take(ROWS_MAX) {
        let time_s = reversal.scan as f64 * f64::from(report.scan_period_us) * 1e-6;
        let sign = if reversal.new_direction > 0 { '+' } else { '-' };
        line!(
            page,
            "  {}{sign}{} {time_s:>11.3} {:>5} {:>8} {:>7} {:>10}  {:>9} {:>6} {:>9}",
            reversal.axis,
            if reversal.steady { ' ' } else { '*' },
            reversal.block.map_or("–".into(), |block| block.to_string()),
            number(reversal.radius_mm, 3),
            number(reversal.feed_mm_min, 0),
            number(reversal.protrusion_um, 2),
            number(reversal.undercut_um, 2),
            number(reversal.width_half_height_ms, 1),
            number(reversal.kick_lead_ms, 2),
        );
    }
    more(on_arcs.len(), page);
    let steady: Vec<f64> = on_arcs
        .iter()
        .filter(|reversal| reversal.steady)
        .filter_map(|reversal| reversal.protrusion_um)
        .collect();
    if !steady.is_empty() {
        let mean = steady.iter().sum::<f64>() / steady.len() as f64;
        let worst = steady.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
        line!(
            page,
            "  in steady motion: mean protrusion {mean:.2} µm, worst {worst:.2} µm"
        );
    }
    line!(page);
}

fn processes(report: &Report, page: &mut String) {
    if !report.processes.is_empty() {
        let names: Vec<String> = report
            .processes
            .iter()
            .map(|process| match process.starts {
                0 | 1 => process.process.clone(),
                starts => format!("{} ({starts} starts)", process.process),
            })
            .collect();
        line!(page, "Processes: {}", names.join(", "));
    }
    for fault in report.faults.iter().take(ROWS_MAX) {
        let resumed = fault
            .resumed_at_scan
            .filter(|scan| *scan > fault.scan + 1)
            .map_or(String::new(), |scan| {
                format!(", motion again from scan {scan}")
            });
        let noticed = fault.noticed_after_scans.map_or(String::new(), |scans| {
            format!(", noticed after {scans} scans")
        });
        let braked = match (fault.brake_distance_mm, fault.deviation_um) {
            (None, None) => String::new(),
            (distance, deviation) => format!(
                " (in {} mm, {} µm off the path)",
                number(distance, 2),
                number(deviation, 1)
            ),
        };
        line!(
            page,
            "  scan {}: {} {}{noticed}: {}{braked}{resumed}; contour error up to {:.2} µm",
            fault.scan,
            fault.process,
            fault.kind,
            fault.reaction,
            fault.contour_error_um_max
        );
    }
    more(report.faults.len(), page);
    if !report.processes.is_empty() {
        line!(page);
    }
}

fn foot(report: &Report, page: &mut String) {
    let limits = &report.limits;
    line!(
        page,
        "Setpoints beyond limits: velocity {}, acceleration {}, travel {}",
        limits.velocity_exceeded,
        limits.acceleration_exceeded,
        limits.travel_exceeded
    );
    line!(
        page,
        "Windows {} (voided {}), overrun scans {}, samples lost {}",
        report.windows,
        report.windows_voided,
        report.overrun_scans,
        report.samples_lost
    );
    line!(page, "digest        {}", report.digest);
    line!(
        page,
        "motion digest {}",
        report.motion_digest.as_deref().unwrap_or("–")
    );
    line!(page, "quadrant {}", report.quadrant);
}

fn more(count: usize, page: &mut String) {
    if count > ROWS_MAX {
        line!(page, "  … and {} more in report.json", count - ROWS_MAX);
    }
}

pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("–".into(), |value| format!("{value:.digits$}"))
}
