//! From a log to the files of a report, and again.

use bus::sample::RunOutcome;
use machine::LogLevel;
use std::path::Path;

use path::geometry::AxisVector;
use program::Setup;

use super::*;
use crate::test_support::{Deviation, SyntheticRun, machine, machine_text};
use monitor::ended::ENDED_FILE;
use monitor::log::{LOG_FILE, Recorder, RunEnd, RunInfo, Sample, SampleRef};

const PROGRAM: &str = "G17 G21 G90
(there and back on one circle)
G0 X25 Y0
G3 X25 Y0 I-25 J0 P2 F3000
G1 X30 Y5
G1 X25 Y0
G2 X25 Y0 I-25 J0 P2
G0 X50 Y-10
G2 X50 Y-10 I-10 J0 F1000
M2
";

pub(super) const DEVIATION: Deviation = Deviation {
    centre_mm: [0.0012, -0.0007],
    radius_mm: -0.0031,
    bump_mm: [0.0071, 0.0052, 0.0064, 0.0083],
    bump_after_rad: 0.05,
    bump_sigma_rad: 0.017,
    lag_scans: 3.0,
};

/// A run directory with everything but the report.
pub(super) fn run_directory(dir: &Path) {
    run_directory_in_parts(dir, std::iter::empty());
}

/// The same, without these scans: in each gap a recorder died and its successor began the next part.
fn run_directory_in_parts(dir: &Path, gaps: impl IntoIterator<Item = std::ops::Range<u64>>) {
    run_directory_of(dir, DEVIATION, gaps);
}

/// The same of a table that deviates otherwise.
pub(super) fn run_directory_of(
    dir: &Path,
    deviation: Deviation,
    gaps: impl IntoIterator<Item = std::ops::Range<u64>>,
) {
    let mut gaps = gaps.into_iter().peekable();
    std::fs::write(dir.join("machine.toml"), machine_text(&["X", "Y"])).unwrap();
    std::fs::write(dir.join("circle.ngc"), PROGRAM).unwrap();
    let machine = machine(&["X", "Y"]);
    let program = program::load(
        &dir.join("circle.ngc"),
        &Setup::of(&machine),
        AxisVector::zeros(),
    )
    .unwrap();
    let run = SyntheticRun::new(program.path, program.source_hash, deviation);
    let info = RunInfo {
        quadrant: "0.1.0".into(),
        cell: "test".into(),
        pace: "lockstep".into(),
        program: "circle.ngc".into(),
        ..RunInfo::default()
    };
    let mut recorder = Recorder::create_part(dir, &machine, &info, LogLevel::Full).unwrap();
    for sample in run.samples() {
        let scan = match &sample {
            Sample::Feedback(sample) => sample.scan,
            Sample::Instruments(sample) => sample.scan,
            Sample::Command(sample) => sample.scan,
            _ => 0,
        };
        if gaps.next_if(|gap| scan >= gap.end).is_some() {
            let next = Recorder::create_part(dir, &machine, &info, LogLevel::Full).unwrap();
            let mut killed = std::mem::replace(&mut recorder, next);
            killed.flush().unwrap();
            std::mem::forget(killed);
        }
        if gaps.peek().is_some_and(|gap| gap.contains(&scan)) {
            continue;
        }
        match sample {
            Sample::Feedback(sample) => recorder.record(SampleRef::Feedback(&sample)).unwrap(),
            Sample::Instruments(sample) => {
                recorder.record(SampleRef::Instruments(&sample)).unwrap()
            }
            Sample::Command(sample) => {
                recorder
                    .record(SampleRef::Command(sample.axis as usize, &sample))
                    .unwrap();
            }
            _ => {}
        }
    }
    let end = RunEnd {
        wall_s: 0.5,
        ..RunEnd::default()
    };
    recorder.finish(&end).unwrap();
}

#[test]
#[expect(clippy::too_many_lines, reason = "a list of the names")]
fn a_report_has_the_names_of_the_interface_and_is_made_again_to_the_byte() {
    let dir = tempfile::tempdir().unwrap();
    run_directory(dir.path());
    make_report(dir.path()).unwrap();
    let files = [
        "report.json",
        "report.txt",
        "report.html",
        "tracking.svg",
        "path.svg",
        "circle-1.svg",
        "circle-2.svg",
    ];
    let read = || files.map(|name| std::fs::read_to_string(dir.path().join(name)).unwrap());
    let first = read();
    if let Some(keep) = std::env::var_os("QUADRANT_KEEP_REPORT") {
        for name in files.iter().chain(&[LOG_FILE]) {
            std::fs::copy(dir.path().join(name), Path::new(&keep).join(name)).unwrap();
        }
    }
    make_report(dir.path()).unwrap();
    assert_eq!(read(), first);
    assert!(
        !dir.path().join("circle-3.svg").exists(),
        "both directions share a plot"
    );
    let json: serde_json::Value = serde_json::from_str(&first[0]).unwrap();
    for name in [
        "/quadrant",
        "/machine",
        "/program",
        "/pace",
        "/scan_period_us",
        "/distribution_period_scans",
        "/outcome/kind",
        "/outcome/reason",
        "/scans",
        "/wall_s",
        "/real_time_factor",
        "/digest",
        "/motion_digest",
        "/samples_lost",
        "/axes/0/axis",
        "/axes/1/following_error_um/peak",
        "/axes/0/following_error_um/rms",
        "/axes/0/following_error_um/p50",
        "/axes/0/following_error_um/p95",
        "/axes/0/following_error_um/p99",
        "/axes/0/missed_scans",
        "/axes/0/torque_rms_nm",
        "/axes/0/torque_peak_nm",
        "/axes/0/torque_cut_scans",
        "/axes/0/torque_cut_nm_peak",
        "/axes/0/friction_level_percent",
        "/axes/0/friction_unexplained_percent",
        "/axes/0/winding_c_peak",
        "/contour_error_um/peak",
        "/contour_error_um/rms",
        "/blocks/0/block",
        "/blocks/0/scans",
        "/blocks/0/contour_error_um_peak",
        "/blocks/0/following_error_um_peak/X",
        "/blocks/0/following_error_um_peak/Y",
        "/arcs/0/block",
        "/arcs/0/plane",
        "/arcs/0/centre_mm/1",
        "/arcs/0/radius_mm",
        "/arcs/0/feed_mm_min",
        "/arcs/0/clockwise",
        "/arcs/0/circular_deviation_um",
        "/arcs/0/radial_deviation_um/max",
        "/arcs/0/radial_deviation_um/min",
        "/arcs/0/centre_offset_um/1",
        "/arcs/0/radius_error_um",
        "/reversals/0/axis",
        "/reversals/0/new_direction",
        "/reversals/0/scan",
        "/reversals/0/block",
        "/reversals/0/radius_mm",
        "/reversals/0/feed_mm_min",
        "/reversals/0/trigger",
        "/reversals/0/kick_lead_ms",
        "/reversals/0/protrusion_um",
        "/reversals/0/undercut_um",
        "/limits/velocity_exceeded",
        "/limits/acceleration_exceeded",
        "/limits/jerk_exceeded",
        "/limits/travel_exceeded",
        "/processes",
        "/faults",
    ] {
        assert!(json.pointer(name).is_some(), "{name} is missing");
    }
    let at = |name: &str| json.pointer(name).unwrap();
    assert_eq!(at("/outcome/kind"), "completed");
    assert_eq!(at("/log/program_matches"), true);
    assert_eq!(at("/samples_lost"), 0);
    assert_eq!(at("/arcs/0/plane"), "XY");
    assert_eq!(at("/arcs/0/block"), 4);
    let number = |name: &str| at(name).as_f64().unwrap();
    assert!((number("/arcs/0/radius_error_um") + 3.1).abs() < 0.05);
    assert!((number("/arcs/1/centre_offset_um/0") - 1.2).abs() < 0.05);
    assert!((number("/arcs/1/circular_deviation_um") - 8.3).abs() < 0.1);
    assert_eq!(number("/axes/0/winding_c_peak"), 25.0);
    for line in first[1].lines() {
        assert!(line.chars().count() <= 92, "{line}");
    }
    assert_eq!(number("/real_time_factor"), number("/scans") * 1e-3 / 0.5);
}

#[test]
fn the_peaks_of_the_blocks_are_those_of_the_run() {
    let dir = tempfile::tempdir().unwrap();
    run_directory(dir.path());
    let report = make_report(dir.path()).unwrap();
    let lines: Vec<u32> = report.blocks.iter().map(|block| block.block).collect();
    assert_eq!(lines, [3, 4, 5, 6, 7, 8, 9]);
    let scans: u64 = report.blocks.iter().map(|block| block.scans).sum();
    assert!(
        scans <= report.scans && scans + 30 > report.scans,
        "{scans} of {}",
        report.scans
    );
    let peaks = report
        .blocks
        .iter()
        .map(|block| block.contour_error_um_peak);
    assert_eq!(peaks.reduce(f64::max), Some(report.contour_error_um.peak));
    // The table deviates on arcs only.
    let of = |line: u32| {
        report
            .blocks
            .iter()
            .find(|block| block.block == line)
            .unwrap()
    };
    assert!(of(4).contour_error_um_peak > 5.0 * of(6).contour_error_um_peak);
    for axis in &report.axes {
        let error = axis.following_error_um.expect("slides");
        assert!(error.p50 <= error.p95 && error.p95 <= error.p99 && error.p99 <= error.peak);
        let peaks = report
            .blocks
            .iter()
            .map(|b| b.following_error_um_peak[&axis.axis]);
        assert!(peaks.reduce(f64::max) <= Some(error.peak));
    }
}

#[test]
fn the_page_stands_alone_and_says_first_how_it_ended() {
    let dir = tempfile::tempdir().unwrap();
    run_directory(dir.path());
    make_report(dir.path()).unwrap();
    let page = std::fs::read_to_string(dir.path().join("report.html")).unwrap();
    for from_elsewhere in [
        "<script", "<link", "<img", "src=", "href=", "url(", "@import",
    ] {
        assert!(!page.contains(from_elsewhere), "{from_elsewhere}");
    }
    // Names of vocabularies are not fetched; nothing else may name a place in the net.
    let places = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    assert!(!places.contains("http"), "names a place in the net");
    assert_eq!(
        page.matches("<svg ").count(),
        4,
        "path, tracking and two circles"
    );
    let body = page.split("<body>").nth(1).unwrap();
    let outcome = body.find("Completed.").unwrap();
    assert!(outcome < body.find("<table").unwrap() && outcome < body.find("<svg").unwrap());
    for (open, close) in [
        ("<table", "</table>"),
        ("<tr>", "</tr>"),
        ("<div", "</div>"),
        ("<svg", "</svg>"),
    ] {
        assert_eq!(
            page.matches(open).count(),
            page.matches(close).count(),
            "{open}"
        );
    }
}

#[test]
fn a_stopped_run_is_called_so_on_its_page() {
    let dir = tempfile::tempdir().unwrap();
    run_directory(dir.path());
    let log = dir.path().join(LOG_FILE);
    let whole = std::fs::read(&log).unwrap();
    std::fs::write(&log, &whole[..whole.len() / 2]).unwrap();
    make_report(dir.path()).unwrap();
    let page = std::fs::read_to_string(dir.path().join("report.html")).unwrap();
    assert!(
        page.contains("<p class=\"outcome bad\"><b>Stopped.</b>"),
        "{page:.3000}"
    );
    assert!(page.contains("The log is not whole"));
}

#[test]
fn a_cut_log_still_gives_a_report_that_says_so() {
    let dir = tempfile::tempdir().unwrap();
    run_directory(dir.path());
    let log = dir.path().join(LOG_FILE);
    let whole = std::fs::read(&log).unwrap();
    std::fs::write(&log, &whole[..whole.len() * 2 / 3]).unwrap();
    let report = make_report(dir.path()).unwrap();
    assert_eq!(report.outcome.kind, RunOutcome::Stopped);
    assert!(report.log.cut.is_some() && report.wall_s.is_none());
    assert!(!report.arcs.is_empty());
    let page = std::fs::read_to_string(dir.path().join("report.txt")).unwrap();
    assert!(page.contains("THE LOG IS NOT WHOLE"), "{page}");
}

/// What was noted of the end of a run.
fn note_end(dir: &Path, scan: u64, outcome: &str, text: &str) {
    let ended = serde_json::json!(
        { "run": 1, "scan": scan, "outcome": outcome, "cause": 0, "text": text }
    );
    std::fs::write(dir.join(ENDED_FILE), ended.to_string()).unwrap();
}

#[test]
fn a_log_without_its_end_is_of_a_run_that_ended_as_its_folder_says() {
    for (outcome, kind, reason) in [
        ("completed", RunOutcome::Completed, None),
        ("interrupted", RunOutcome::Interrupted, Some("tripped")),
        ("stopped", RunOutcome::Stopped, Some("tripped")),
        ("of a later version", RunOutcome::Stopped, Some("the log")),
    ] {
        let dir = tempfile::tempdir().unwrap();
        run_directory(dir.path());
        let log = dir.path().join(LOG_FILE);
        let whole = std::fs::read(&log).unwrap();
        std::fs::write(&log, &whole[..whole.len() * 2 / 3]).unwrap();
        note_end(dir.path(), 1_000_000, outcome, "the machine tripped");
        let report = make_report(dir.path()).unwrap();
        assert_eq!(report.outcome.kind, kind, "{outcome}");
        let words = report.outcome.reason.unwrap_or_default();
        assert_eq!(words.is_empty(), reason.is_none(), "{outcome}: {words}");
        assert!(words.contains(reason.unwrap_or_default()), "{words}");
        let noted = outcome != "of a later version";
        assert_eq!(report.samples_lost > 3_000_000, noted, "{outcome}");
        assert_eq!(
            report.missing_scans.last().map(|range| range.last),
            noted.then_some(1_000_000)
        );
        assert!(report.log.cut.is_some());
    }
}

#[test]
fn a_log_in_parts_gives_one_report_that_says_what_is_missing() {
    let whole = tempfile::tempdir().unwrap();
    run_directory(whole.path());
    let expected = make_report(whole.path()).unwrap();
    assert_eq!((expected.parts.len(), expected.missing_scans.len()), (1, 0));
    let page = std::fs::read_to_string(whole.path().join("report.txt")).unwrap();
    assert!(
        !page.contains("parts") && !page.contains("missing"),
        "{page}"
    );

    let dir = tempfile::tempdir().unwrap();
    run_directory_in_parts(dir.path(), [901..931, 2000..2001]);
    let report = make_report(dir.path()).unwrap();
    assert_eq!(report.outcome.kind, RunOutcome::Completed);
    assert_eq!(report.log.cut, None);
    assert_eq!(report.wall_s, None, "nobody knows it of the whole run");
    assert_eq!(report.samples_lost, 31 * 4);
    assert_eq!(report.scans, expected.scans);
    assert_eq!(report.arcs.len(), expected.arcs.len());
    // Behind each gap one scan more, in which the backlash compensation in force is not known yet.
    assert_eq!(report.arcs[0].missing_scans, 31 + 2);
    assert_eq!(report.arcs[1].missing_scans, 0);
    assert!(report.contour_error_um.peak <= expected.contour_error_um.peak);
    let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap();
    let (page, text) = (read("report.txt"), read("report.json"));
    for line in [
        "log in 3 parts: scans 901 to 930, scan 2000 are missing",
        "  run.mcap       scans 0 to 900, cut off",
        "  run-2.mcap     scans 931 to 1999, cut off",
        "arcs marked ! are measured on the rest",
    ] {
        assert!(page.contains(line), "{line}\n{page}");
    }
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        json["parts"][0],
        serde_json::json!({ "file": "run.mcap", "first_scan": 0, "last_scan": 900, "cut": true })
    );
    assert_eq!(json["parts"][2]["cut"], false);
    assert_eq!(
        json["missing_scans"],
        serde_json::json!([{ "first": 901, "last": 930 }, { "first": 2000, "last": 2000 }])
    );
    make_report(dir.path()).unwrap();
    assert_eq!(read("report.json"), text, "made again to the byte");
}

#[test]
fn a_log_whose_first_recorder_left_nothing_is_measured_from_where_it_begins() {
    let (whole, dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    run_directory(whole.path());
    run_directory_in_parts(dir.path(), std::iter::once(0..2500));
    let expected = make_report(whole.path()).unwrap();
    let report = make_report(dir.path()).unwrap();
    assert_eq!(report.log.program_matches, Some(true));
    assert_eq!(report.parts[0].first_scan, None);
    assert_eq!(
        report.missing_scans,
        [ScanRange {
            first: 0,
            last: 2499
        }]
    );
    assert_eq!(report.samples_lost, 2500 * 4);
    assert!(report.contour_error_um.peak <= expected.contour_error_um.peak);
    // It begins on the first circle, in the middle of a turn.
    assert!(report.arcs[0].missing_scans > 2000, "{:?}", report.arcs[0]);
    let radius_um = |report: &Report| report.arcs[0].radius_error_um.unwrap();
    assert!((radius_um(&report) - radius_um(&expected)).abs() < 0.05);
    let measured = |report: &Report| report.reversals.iter().filter(|r| r.steady).count();
    assert!(measured(&report) >= measured(&expected) - 4);
}

#[test]
fn parts_without_a_gap_give_the_numbers_of_a_whole_log() {
    let (whole, dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    run_directory(whole.path());
    run_directory_in_parts(dir.path(), std::iter::once(1500..1500));
    let (mut expected, report) = (
        make_report(whole.path()).unwrap(),
        make_report(dir.path()).unwrap(),
    );
    let page = std::fs::read_to_string(dir.path().join("report.txt")).unwrap();
    assert!(
        page.contains("log in 2 parts: no scan is missing"),
        "{page}"
    );
    assert_ne!(report.digest, expected.digest);
    expected.digest = report.digest.clone();
    expected.parts = report.parts.clone();
    (expected.wall_s, expected.real_time_factor) = (None, None);
    assert_eq!(report.to_json(), expected.to_json());
}

#[test]
fn a_program_that_was_changed_after_the_run_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    run_directory(dir.path());
    std::fs::write(
        dir.path().join("circle.ngc"),
        PROGRAM.replace("F1000", "F900"),
    )
    .unwrap();
    let report = make_report(dir.path()).unwrap();
    assert_eq!(report.log.program_matches, Some(false));
}

#[test]
fn files_that_do_not_belong_together_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    run_directory(dir.path());
    std::fs::write(dir.path().join("machine.toml"), machine_text(&["X", "Z"])).unwrap();
    let text = make_report(dir.path()).unwrap_err().to_string();
    assert!(text.contains("machine.toml has axes X Z"), "{text}");
    std::fs::write(dir.path().join("machine.toml"), machine_text(&["X", "Y"])).unwrap();
    std::fs::remove_file(dir.path().join("circle.ngc")).unwrap();
    assert!(matches!(
        make_report(dir.path()),
        Err(ReportError::Program(_))
    ));
    std::fs::remove_file(dir.path().join(LOG_FILE)).unwrap();
    assert!(matches!(make_report(dir.path()), Err(ReportError::Log(_))));
}

/// `cargo test -p monitor --release -- --ignored --nocapture evaluation_cost`
#[test]
#[ignore = "a measurement, not a check"]
fn evaluation_cost_per_scan() {
    let dir = tempfile::tempdir().unwrap();
    run_directory(dir.path());
    let start = std::time::Instant::now();
    let scans = evaluate(dir.path()).unwrap().measurements.scans as f64;
    let evaluated_us = start.elapsed().as_secs_f64() * 1e6;
    make_report(dir.path()).unwrap();
    let all_us = start.elapsed().as_secs_f64() * 1e6 - evaluated_us;
    println!(
        "reading and measuring {:.2} µs per scan, with report and plots {:.2} µs per scan ({scans} scans)",
        evaluated_us / scans,
        all_us / scans
    );
}

/// A log damaged in its middle says nothing of what stands behind the damage, also not beforehand.
#[test]
fn a_death_reported_behind_the_damage_of_a_log_is_not_reported() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("machine.toml"), machine_text(&["X", "Y"])).unwrap();
    let machine = machine(&["X", "Y"]);
    std::fs::write(dir.path().join("circle.ngc"), PROGRAM).unwrap();
    let info = RunInfo {
        program: "circle.ngc".into(),
        ..RunInfo::default()
    };
    let mut recorder = Recorder::create_part(dir.path(), &machine, &info, LogLevel::Full).unwrap();
    let log = dir.path().join(LOG_FILE);
    let mut half = 0;
    for scan in 0..2000 {
        let mut feedback: bus::sample::Feedback = bytemuck::Zeroable::zeroed();
        (feedback.scan, feedback.axis_count) = (scan, 2);
        // The program runs: from here on only rosters are looked for.
        feedback.window.sequence = 1;
        recorder.record(SampleRef::Feedback(&feedback)).unwrap();
        if scan == 1000 {
            recorder.flush().unwrap();
            half = std::fs::metadata(&log).unwrap().len() as usize;
        }
        if scan == 1800 {
            let mut roster = bus::sample::Roster {
                version: 1,
                visible_from: scan,
                ..Default::default()
            };
            let died = roster.participants.first_mut().unwrap();
            died.job = bus::sample::Job::Planner as u32;
            (died.incarnation, died.death_scan, died.death_signal) = (1, 700, 9);
            recorder.record(SampleRef::Roster(&roster)).unwrap();
        }
    }
    recorder.finish(&RunEnd::default()).unwrap();
    let faults = || evaluate(dir.path()).unwrap().measurements.faults.len();
    assert_eq!(faults(), 1);
    // Scans 0 to 1000 have been flushed: behind them stands the chunk of the next.
    let mut bytes = std::fs::read(&log).unwrap();
    bytes[half + 100] ^= 0x55;
    std::fs::write(&log, bytes).unwrap();
    let evaluation = evaluate(dir.path()).unwrap();
    assert!(evaluation.cut.is_some());
    let scans = evaluation.measurements.scans;
    assert_eq!(scans, 1001);
    assert_eq!(evaluation.measurements.faults.len(), 0);
    let found = crate::skim::skim(dir.path()).unwrap();
    assert_eq!(found.rosters.len(), 1, "its index still names it");
}
