//! What a report has to say: the document of one run.

use machine::AxisKind;
use monitor::quantities::OF_AXIS;
use serde_json::Value as Json;

use super::axes::{AxisReport, PeakRmsPercentiles};
use super::cause_sections;
use super::document::{Block, Columns, Document, Fact, Outcome, Section, digits, section};
use super::json::{ArcReport, Report, ScanRange};
use super::match_up::orders;
use super::peaks::PeakReport;
use super::rounded::{r3, um};
use crate::measure::auxiliary::AuxiliaryEvent;
use crate::measure::faults::FaultResult;
use crate::measure::outcome::Reaction;
use crate::measure::reversal::ReversalResult;
use bus::sample::RunOutcome;
use monitor::said::Line;
use program::Note;

/// Blocks that the text shows: those with the largest contour error.
const BLOCKS_IN_TEXT: usize = 16;
/// Events beside the axes that are listed before it says how many more there are.
const AUXILIARY_EVENTS_MAX: usize = 40;
/// Gaps of the log that are named in a line before it says how many more there are.
const GAPS_MAX: usize = 5;

/// Pictures of a run beside that of the following error.
#[derive(Debug, Default)]
pub(super) struct Pictures {
    /// Whether there is one of the path.
    pub path: bool,
    /// Files of the ball-bar plots.
    pub circles: Vec<String>,
}

/// The document of a run.
pub(super) fn document(report: &Report, pictures: &Pictures) -> Document {
    let mut sections = vec![
        head(report),
        section("Remarks on the program", vec![Block::List(notes(report))]),
        section("Faults", vec![Block::List(faults(report))]),
        section(
            "Spindle, coolant, outputs and stops",
            vec![Block::List(auxiliary_events(report))],
        ),
        section(
            "Messages of the program",
            vec![Block::List(messages(report))],
        ),
        contour_peaks(report),
        cause_sections::contour_parts(report, pictures.path),
        following_error(report),
        blocks(report),
        arcs(report, &pictures.circles),
    ];
    sections.extend(cause_sections::ball_bars(report));
    sections.extend([reversals(report), drives(report), foot(report)]);
    Document {
        title: format!("{} on {}", report.program, report.machine),
        about: format!(
            "{} scans of {} µs, interpolation period {} scans, {}",
            report.scans, report.scan_period_us, report.distribution_period_scans, report.pace
        ),
        sections,
    }
}

/// What of the program was accepted with a remark.
fn notes(report: &Report) -> Vec<String> {
    report.notes.iter().map(Note::shown).collect()
}

/// What happened beside the axes; what comes after the first events is in report.json.
fn auxiliary_events(report: &Report) -> Vec<String> {
    let events = report.auxiliary_events.iter();
    let line = |event: &AuxiliaryEvent| {
        let at_s = time_s(report, event.scan);
        format!("{at_s:.3} s: {}", event.words)
    };
    let mut lines: Vec<String> = events.take(AUXILIARY_EVENTS_MAX).map(line).collect();
    let more = report.auxiliary_events.len().saturating_sub(lines.len());
    if more > 0 {
        lines.push(format!("and {more} more, in report.json"));
    }
    lines
}

/// What the program has said; what comes after the first messages is in report.json.
fn messages(report: &Report) -> Vec<String> {
    let line = |said: &Line| {
        let at_s = time_s(report, said.scan);
        let line = said
            .line
            .map_or(String::new(), |line| format!("line {line}: "));
        format!("{at_s:.3} s, {line}{}", said.text)
    };
    let all = report.messages.iter();
    let mut lines: Vec<String> = all.take(AUXILIARY_EVENTS_MAX).map(line).collect();
    let more = (report.messages.len() - lines.len()) as u64 + report.messages_more;
    if more > 0 {
        lines.push(format!("and {more} more, in messages.jsonl"));
    }
    if report.messages_dropped > 0 {
        let dropped = report.messages_dropped;
        lines.push(format!(
            "{dropped} more are lost: they were said faster than they could be read"
        ));
    }
    lines
}

/// Time of a scan in s.
fn time_s(report: &Report, scan: u64) -> f64 {
    scan as f64 * f64::from(report.scan_period_us) * 1e-6
}

/// How a run ended, and what must be known before its numbers are believed.
pub(super) fn ending(report: &Report, run: Option<String>) -> Vec<Block> {
    let reason = report.outcome.reason.as_deref();
    let (good, word, rest) = match report.outcome.kind {
        RunOutcome::Completed => (true, "Completed", "The program ran to its end."),
        RunOutcome::Interrupted => {
            let somebody = "Somebody stopped the run before the program's end.";
            (false, "Interrupted", reason.unwrap_or(somebody))
        }
        RunOutcome::Stopped => {
            let unknown = "The log does not show why.";
            (false, "Stopped", reason.unwrap_or(unknown))
        }
    };
    let mut blocks = vec![Block::Outcome(Outcome {
        run,
        good: good && report.log.cut.is_none(),
        word,
        rest: rest.into(),
    })];
    if let Some(cut) = &report.log.cut {
        let rest = format!("{cut}. What follows is of the part that is there.");
        blocks.push(Block::Warning("The log is not whole".into(), rest));
    }
    if report.log.program_matches == Some(false) {
        let what = "The program in this folder is not the one that ran";
        let rest = "path, arcs and contour error mean nothing.";
        blocks.push(Block::Warning(what.into(), rest.into()));
    }
    blocks
}

fn head(report: &Report) -> Section {
    let mut blocks = ending(report, None);
    blocks.extend(gaps(report));
    if report.samples_lost > 0 {
        let count = format!("{} samples are not in the log", report.samples_lost);
        let rest = "its digest compares with no other run's.";
        blocks.push(Block::Warning(count, rest.into()));
    }
    if report.faults.is_empty() {
        blocks.push(Block::Text("No process was lost.".into()));
    }
    let machine_s = time_s(report, report.scans);
    let time = vec![
        Fact::new("machine time", machine_s, "s", 3).key("machine_time_s"),
        Fact::new("wall time", report.wall_s, "s", 3).key("wall_s"),
        Fact::new("", report.real_time_factor, "× real time", 1),
    ];
    let limits = &report.limits;
    let exceeded = vec![
        Fact::count("velocity", limits.velocity).key("limits/velocity_exceeded"),
        Fact::count("acceleration", limits.acceleration).key("limits/acceleration_exceeded"),
        Fact::count("jerk", limits.jerk).key("limits/jerk_exceeded"),
        Fact::count("travel", limits.travel).key("limits/travel_exceeded"),
    ];
    blocks.extend([
        Block::Facts("Duration", time),
        Block::Facts("Setpoints beyond limits", exceeded),
        Block::Glance(glance(report)),
    ]);
    section("", blocks)
}

fn glance(report: &Report) -> Vec<Fact> {
    let worst = |values: &mut dyn Iterator<Item = f64>| values.reduce(f64::max);
    let (contour, axes) = (report.contour_error_um, report.axes.iter());
    let slides = axes.clone().filter_map(|axis| axis.following_error_um);
    let slides = worst(&mut slides.map(|error| error.peak));
    let rotary = axes.filter_map(|axis| axis.following_error_mdeg);
    let rotary = worst(&mut rotary.map(|error| error.peak));
    let circular = worst(&mut report.arcs.iter().map(|arc| arc.circular_deviation_um));
    let protrusions = steady_reversals(report).into_iter();
    let protrusion = worst(&mut protrusions.map(|(protrusion, _)| protrusion));
    let missed = report.axes.iter().map(|axis| u64::from(axis.missed_scans));
    vec![
        Fact::um("Contour error, peak", contour.peak).key("contour_error_um/peak"),
        Fact::um("Contour error, rms", contour.rms).key("contour_error_um/rms"),
        Fact::um("Following error, peak", slides),
        Fact::new("Following error of rotary axes, peak", rotary, "mdeg", 2),
        Fact::um("Circular deviation, worst", circular),
        Fact::um("Protrusion, worst", protrusion),
        Fact::count("Missed scans", missed.sum::<u64>()),
        Fact::count("Lost processes", report.faults.len() as u64).key("faults"),
    ]
}

fn scans(range: &ScanRange) -> String {
    if range.first == range.last {
        format!("scan {}", range.first)
    } else {
        format!("scans {} to {}", range.first, range.last)
    }
}

/// What the log does not have, and of which parts it is.
fn gaps(report: &Report) -> Vec<Block> {
    let (parts, all) = (&report.parts, &report.missing_scans);
    let mut missing: Vec<String> = all.iter().take(GAPS_MAX).map(scans).collect();
    if let [_, ..] = all.get(GAPS_MAX..).unwrap_or_default() {
        missing.push(format!("{} more gaps", all.len() - GAPS_MAX));
    }
    let missing = match (missing.as_slice(), all.as_slice()) {
        ([], _) => "no scan is missing".into(),
        ([one], [range]) if range.first == range.last => format!("{one} is missing"),
        _ => format!("{} are missing", missing.join(", ")),
    };
    let mut blocks = Vec::new();
    if parts.len() > 1 {
        let count = parts.len();
        blocks.push(Block::Text(format!("log in {count} parts: {missing}")));
        let parts = parts.iter().map(|part| {
            let from_to = match (part.first_scan, part.last_scan) {
                (Some(first), Some(last)) => format!("scans {first} to {last}"),
                _ => "no scan".into(),
            };
            let cut = if part.cut { ", cut off" } else { "" };
            format!("{:<14} {from_to}{cut}", part.file)
        });
        blocks.push(Block::List(parts.collect()));
    } else if !all.is_empty() {
        blocks.push(Block::Warning("The log has gaps".into(), missing));
    }
    if !all.is_empty() {
        let rest = "No reversal is measured across a gap; arcs marked ! are measured on the rest.";
        blocks.push(Block::Text(rest.into()));
    }
    blocks
}

/// A sentence for each loss of a process.
pub(super) fn faults(report: &Report) -> Vec<String> {
    let faults = report.faults.iter();
    faults.map(|fault| fault_words(report, fault)).collect()
}

fn fault_words(report: &Report, fault: &FaultResult) -> String {
    let at = |scan: u64| format!("scan {scan} ({:.3} s)", time_s(report, scan));
    let noticed = match fault.noticed_after_scans {
        Some(0) => ", noticed in the same scan".into(),
        Some(1) => ", noticed after 1 scan".into(),
        Some(scans) => format!(", noticed after {scans} scans"),
        None => String::new(),
    };
    let reaction = match &fault.reaction {
        Reaction::None => "none, motion does not depend on it".into(),
        reaction => reaction.to_string(),
    };
    let braked = match (fault.brake_distance_mm.map(r3), fault.deviation_mm.map(um)) {
        (None, None) => String::new(),
        (distance, deviation) => format!(
            " (in {} mm, up to {} µm off the path)",
            digits(distance, 2),
            digits(deviation, 1)
        ),
    };
    let resumed = fault.resumed_at_scan.filter(|scan| *scan > fault.scan + 1);
    let resumed = resumed.map_or(String::new(), |scan| {
        format!("; motion again from {}", at(scan))
    });
    format!(
        "{}: {} {}{noticed}: {reaction}{braked}{resumed}; contour error up to {:.2} µm",
        at(fault.scan),
        fault.process,
        fault.kind,
        um(fault.contour_error_mm)
    )
}

/// Name of a row that is of an axis.
fn axis_name(_: usize, axis: &AxisReport) -> (String, Vec<(&'static str, Json)>) {
    let name = axis.axis.clone();
    (name.clone(), vec![("axis", name.into())])
}

/// Following errors of slides, or of rotary axes.
fn following_errors<'r>(
    axes: impl Iterator<Item = &'r AxisReport>,
    of: fn(&AxisReport) -> Option<PeakRmsPercentiles>,
    unit: &'static str,
    [p99, peak, rms]: [&'static str; 3],
) -> Block {
    let table = Columns::of("axes", axes)
        .words("Axis", |axis| axis.axis.clone())
        .number("50 %", unit, 2, |axis| Some(of(axis)?.p50))
        .number("95 %", unit, 2, |axis| Some(of(axis)?.p95))
        .number("99 %", unit, 2, |axis| Some(of(axis)?.p99))
        .key(p99)
        .number("Peak", unit, 2, |axis| Some(of(axis)?.peak))
        .key(peak)
        .number("rms", unit, 2, |axis| Some(of(axis)?.rms))
        .key(rms)
        .named("axes", axis_name);
    Block::Table(table.done())
}

fn following_error(report: &Report) -> Section {
    let note = "Command minus feedback, compensation not counted. 50, 95 and 99 % of the scans with drives on do not exceed; at most 0.8 % too high.";
    let axes = || report.axes.iter();
    let slides = following_errors(
        axes().filter(|axis| !axis.is_rotary()),
        |axis| axis.following_error_um,
        AxisKind::Linear.deviation_unit(),
        [
            "following_error_um/p99",
            "following_error_um/peak",
            "following_error_um/rms",
        ],
    );
    let rotary = following_errors(
        axes().filter(|axis| axis.is_rotary()),
        |axis| axis.following_error_mdeg,
        AxisKind::Rotary.deviation_unit(),
        [
            "following_error_mdeg/p99",
            "following_error_mdeg/peak",
            "following_error_mdeg/rms",
        ],
    );
    let plot = Block::Plot {
        file: "tracking.svg".into(),
        caption: "Following error of every axis over time".into(),
    };
    section(
        "Following error",
        vec![Block::Note(note.into()), slides, rotary, plot],
    )
}

/// Where the contour error was largest.
fn contour_peaks(report: &Report) -> Section {
    let line = |peak: &PeakReport| peak.block.map_or("–".into(), |line| line.to_string());
    let table = Columns::of("contour_peaks", &report.contour_peaks)
        .number("Error", "µm", 2, |peak| Some(peak.contour_error_um))
        .written("Line", "", line)
        .number("at", "s", 3, |peak| Some(time_s(report, peak.scan)))
        .words("Machine position", PeakReport::place)
        .words("Block", |peak| peak.text.clone())
        .done();
    section("Greatest contour errors", vec![Block::Table(table)])
}

fn blocks(report: &Report) -> Section {
    let mut table = Columns::of("blocks", &report.blocks)
        .count("Line", |block| block.block.into())
        .count("Scans", |block| block.scans)
        .number("Contour error", "µm", 2, |b| Some(b.contour_error_um_peak))
        .largest(BLOCKS_IN_TEXT);
    for of in &report.axes {
        let title = format!("Error {}", of.axis);
        table = table.number(title, of.deviation_unit(), 2, |block| {
            block.following_error_peak(&of.axis)
        });
    }
    let note = "A block is a line of the program, all passes through it together. Contour error, and following error of each axis; of many blocks those with the largest contour error.";
    section(
        "Peaks per block",
        vec![Block::Note(note.into()), Block::Table(table.done())],
    )
}

/// The ball-bar plots in these files.
pub(super) fn circle_plots(files: &[String], how: &str) -> impl Iterator<Item = Block> {
    files
        .iter()
        .enumerate()
        .map(move |(index, file)| Block::Plot {
            file: file.clone(),
            caption: format!("Radial deviation of circle {}, {how}", index + 1),
        })
}

fn arcs(report: &Report, circles: &[String]) -> Section {
    let centre = |arc: &ArcReport, index: usize| {
        let offset = arc.centre_offset_um.as_ref()?;
        offset.get(index).copied()
    };
    let gap = |arc: &ArcReport| if arc.missing_scans > 0 { "!" } else { "" };
    let turn = |arc: &ArcReport| if arc.clockwise { "cw" } else { "ccw" };
    let feed = |arc: &ArcReport| arc.feed_mm_min.unwrap_or(arc.speed_mm_min);
    let orders = orders(&report.arcs, |arc| {
        (arc.block, arc.plane.clone(), arc.clockwise)
    });
    let name = |index: usize, arc: &ArcReport| {
        let feed = arc.feed_mm_min;
        let feed = feed.map_or("rapid".into(), |feed| format!("F{feed:.0}"));
        let (block, plane, radius) = (arc.block, arc.plane.clone(), arc.radius_mm);
        let mut label = format!("line {block} {plane} R{radius} {feed} {}", turn(arc));
        let order = orders.get(index).copied().unwrap_or(1);
        if order > 1 {
            label += &format!(", no. {order}");
        }
        let id = vec![
            ("block", block.into()),
            ("order", order.into()),
            ("plane", plane.into()),
            ("radius_mm", radius.into()),
            ("feed_mm_min", arc.feed_mm_min.into()),
            ("clockwise", arc.clockwise.into()),
        ];
        (label, id)
    };
    let table = Columns::of("arcs", &report.arcs)
        .count("Line", |arc| arc.block.into())
        .words("Plane", |arc| arc.plane.clone())
        .number("Radius", "mm", 3, |arc| Some(arc.radius_mm))
        .number("Feed", "mm/min", 0, |arc| Some(feed(arc)))
        .words("Turn", |arc| turn(arc).into())
        .written("Steady", "°", |arc| {
            format!("{:.0}{}", arc.measured_deg, gap(arc))
        })
        .number("G", "µm", 2, |arc| Some(arc.circular_deviation_um))
        .key("circular_deviation_um")
        .number("Centre 1st", "µm", 2, |arc| centre(arc, 0))
        .number("Centre 2nd", "µm", 2, |arc| centre(arc, 1))
        .number("Radius error", "µm", 2, |arc| arc.radius_error_um)
        .key("radius_error_um")
        .number("Motor G", "µm", 2, |a| Some(a.motor_circular_deviation_um))
        .named("arcs", name);
    let note = "On the table, in the terms of ISO 230-4. Centre and radius by least squares outside the reversal windows; circular deviation G about that centre, over the steady part.";
    let mut blocks = vec![Block::Note(note.into()), Block::Table(table.done())];
    blocks.extend(circle_plots(circles, "exaggerated"));
    section("Circles and arcs", blocks)
}

/// Reversals on arcs in steady motion, taken together: (protrusion, undercut) in µm.
fn steady_reversals(report: &Report) -> Vec<(f64, f64)> {
    let steady = report.reversals.iter().filter(|reversal| reversal.steady);
    steady
        .filter_map(|reversal| reversal.protrusion_um.zip(reversal.undercut_um))
        .collect()
}

fn reversal_facts(report: &Report, on_arcs: usize) -> Vec<Fact> {
    let steady = steady_reversals(report);
    let protrusions = || steady.iter().map(|(protrusion, _)| *protrusion);
    let mean = protrusions().sum::<f64>() / steady.len() as f64;
    let mean = Some(mean).filter(|_| !steady.is_empty());
    let highest = protrusions().reduce(f64::max);
    let deepest = steady.iter().map(|(_, undercut)| *undercut);
    let deepest = deepest.reduce(f64::min);
    vec![
        Fact::count(
            "in all",
            report.reversals.len() as u64 + report.reversals_not_listed,
        ),
        Fact::count("on arcs", on_arcs as u64),
        Fact::count("in steady motion", steady.len() as u64).key("protrusions_um/count"),
        Fact::um("mean protrusion", mean).key("protrusions_um/mean"),
        Fact::um("highest protrusion", highest).key("protrusions_um/worst"),
        Fact::um("deepest undercut", deepest).key("protrusions_um/deepest_undercut"),
    ]
}

fn reversals(report: &Report) -> Section {
    type Reversal = ReversalResult;
    let sign = |r: &Reversal| if r.new_direction > 0 { '+' } else { '-' };
    let steady = |r: &Reversal| if r.steady { "" } else { " *" };
    // All are counted, so that the order is that of travel; those on arcs have something to compare.
    let orders = orders(&report.reversals, |r| {
        (r.axis.clone(), r.block, r.new_direction)
    });
    let all = orders.into_iter().zip(&report.reversals);
    let (orders, on_arcs): (Vec<usize>, Vec<&Reversal>) =
        all.filter(|(_, r)| r.protrusion_um.is_some()).unzip();
    let mut blocks = vec![Block::Facts("Count", reversal_facts(report, on_arcs.len()))];
    let name = |index: usize, r: &Reversal| {
        let order = orders.get(index).copied().unwrap_or(1);
        let block = r
            .block
            .map_or(String::new(), |line| format!(" line {line}"));
        let label = format!("{}{}{block}, no. {order}", r.axis, sign(r));
        let id = vec![
            ("axis", r.axis.clone().into()),
            ("new_direction", r.new_direction.into()),
            ("block", r.block.into()),
            ("order", order.into()),
        ];
        (label, id)
    };
    let table = Columns::of("reversals on arcs", on_arcs)
        .words("Axis", |r| format!("{}{}{}", r.axis, sign(r), steady(r)))
        .number("Time", "s", 3, |r| Some(time_s(report, r.scan)))
        .number("Line", "", 0, |r| r.block.map(f64::from))
        .number("Radius", "mm", 3, |r| r.radius_mm)
        .number("Feed", "mm/min", 0, |r| r.feed_mm_min)
        .number("Protrusion", "µm", 2, |r| r.protrusion_um)
        .key("protrusion_um")
        .number("Undercut", "µm", 2, |r| r.undercut_um)
        .key("undercut_um")
        .number("Width", "ms", 1, |r| r.width_half_height_ms)
        .number("Pulse lead", "ms", 2, |r| r.kick_lead_ms)
        .named("reversals", name)
        .done();
    if !table.rows.is_empty() {
        let note = "Protrusion: quadrant protrusion (reversal spike in ISO 230-4, glitch), + outward: the axis is late. * Not in steady motion.";
        blocks.push(Block::Note(note.into()));
    }
    blocks.push(Block::Table(table));
    section("Reversals", blocks)
}

/// Part of Coulomb friction, in percent, from which on what a servo sees between two reversals is not what it knows.
const UNEXPLAINED_PERCENT: f64 = 10.0;

/// Where the friction that the model knows is not what the motor meets: what to do.
fn friction_of_another_kind(axis: &AxisReport) -> Option<String> {
    let percent = axis.friction_unexplained_percent?;
    (percent >= UNEXPLAINED_PERCENT).then(|| {
        format!(
            "{}: between two reversals {percent:.0} % of Coulomb friction are not what the model knows: a tool cut, or the \
             friction is of another kind. Ways that leave more than 10 % teach nothing. In the air: `quadrant tune`, or `run --learn-path`",
            axis.axis
        )
    })
}

fn drives(report: &Report) -> Section {
    let mut table = Columns::of("axes", &report.axes)
        .words("Axis", |axis| axis.axis.clone())
        .words("Mode", |axis| axis.drive_mode.into())
        .number("Peak torque", "Nm", 2, |axis| Some(axis.torque_peak_nm))
        .number("rms torque", "Nm", 2, |axis| Some(axis.torque_rms_nm))
        .key("torque_rms_nm")
        .number("of rated", "%", 0, |axis| Some(axis.torque_rms_percent));
    for one in &OF_AXIS {
        let key = one.peak_key();
        table = table.number(one.heading, one.unit, one.decimals, |axis| {
            axis.quantities.get(&key).copied()
        });
    }
    let table = table
        .count("Missed scans", |axis| axis.missed_scans.into())
        .key("missed_scans")
        .named("axes", axis_name);
    let predictions = report.axes.iter();
    let predictions =
        predictions.filter_map(|axis| Some(axis.prediction.as_ref()?.words(&axis.axis)));
    let cut = report.axes.iter().filter(|axis| axis.torque_cut_scans > 0);
    let cut = cut.map(|axis| {
        let (scans, most_nm) = (axis.torque_cut_scans, axis.torque_cut_nm_peak);
        format!(
            "{}: the model asked for more torque than is fed forward in {scans} scans, by up to {most_nm:.2} Nm",
            axis.axis
        )
    });
    let foreign = report.axes.iter().filter_map(friction_of_another_kind);
    let mut blocks = vec![
        Block::Table(table.done()),
        Block::List(
            predictions
                .chain(cut)
                .chain(foreign)
                .chain(skews(report))
                .chain(drops(report))
                .collect(),
        ),
    ];
    blocks.push(Block::Note("Winding: largest rise above ambient.".into()));
    section("Drives", blocks)
}

/// How far each axis with a weight has dropped.
fn drops(report: &Report) -> impl Iterator<Item = String> + '_ {
    report.axes.iter().filter_map(|axis| {
        let weight = axis.weight?;
        let allowed = weight
            .closing_allows_um
            .map(|um| format!("; the closing time of its brake allows {um:.1} µm"));
        Some(format!(
            "{}: dropped by {:.1} µm at most while its drive was off or the machine had tripped{}",
            axis.axis,
            weight.drop_um_peak,
            allowed.unwrap_or_default()
        ))
    })
}

/// How far apart the two motors of each gantry were.
fn skews(report: &Report) -> impl Iterator<Item = String> + '_ {
    report.axes.iter().filter_map(|axis| {
        let gantry = axis.gantry.as_ref()?;
        Some(format!(
            "{leader} and {}: skew of the gantry at most {:.2} µm, {:.2} µm rms; {:.0} µm are allowed",
            axis.axis,
            gantry.skew_um_peak,
            gantry.skew_um_rms,
            gantry.skew_um_max,
            leader = gantry.leader,
        ))
    })
}

fn foot(report: &Report) -> Section {
    let processes = report.processes.iter().map(|process| {
        let count = |count: usize, one: &str| match count {
            0 => String::new(),
            1 => format!(", 1 {one}"),
            count => format!(", {count} {one}s"),
        };
        let starts = match process.starts {
            0 | 1 => String::new(),
            starts => count(starts as usize, "start"),
        };
        let more = format!("{starts}{}", count(process.deaths.len(), "death"));
        match more.strip_prefix(", ") {
            Some(more) => format!("{} ({more})", process.process),
            None => process.process.clone(),
        }
    });
    let processes: Vec<String> = processes.collect();
    let windows = vec![
        Fact::new(
            "published",
            report.windows.map(|windows| windows as f64),
            "",
            0,
        ),
        Fact::count("voided", report.windows_voided),
    ];
    let log = vec![
        Fact::count("overrun scans", report.overrun_scans).key("overrun_scans"),
        Fact::count("samples lost", report.samples_lost).key("samples_lost"),
    ];
    let recorded = match report.log.level.as_str() {
        "full" => "every sample",
        "axes" => {
            "level axes: the table is not in it, so contour, arcs and windows are not measured (--log control)"
        }
        _ => "every scan, whole servo states (--log full) aside",
    };
    let mut blocks = Vec::new();
    if !processes.is_empty() {
        blocks.push(Block::Text(format!("Processes: {}", processes.join(", "))));
    }
    blocks.extend([
        Block::Facts("Windows", windows),
        Block::Facts("Log", log),
        Block::Text(format!(
            "Digest        {}",
            report.digest.as_deref().unwrap_or("–")
        )),
        Block::Text(format!(
            "Motion digest {}",
            report.motion_digest.as_deref().unwrap_or("–")
        )),
        Block::Text(format!(
            "Quadrant {}. All numbers stand in report.json; run.mcap has {}.",
            report.quadrant, recorded
        )),
    ]);
    section("Processes and log", blocks)
}
