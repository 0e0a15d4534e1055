//! What several recorders left is read as one.

use machine::LogLevel;
use std::path::Path;

use bus::sample::*;
use bytemuck::Zeroable;

use super::*;
use crate::log::SampleRef;
use crate::test_support::machine;

fn info() -> RunInfo {
    RunInfo {
        quadrant: "0.1.0".into(),
        cell: "test".into(),
        pace: "lockstep".into(),
        program: "circle.ngc".into(),
        ..RunInfo::default()
    }
}

fn begin(dir: &Path) -> Recorder {
    Recorder::create_part(dir, &machine(&["X", "Y"]), &info(), LogLevel::Full).unwrap()
}

/// One scan as a recorder hears it: what was made in the scan before, then the feedback.
fn record(recorder: &mut Recorder, scan: u64) {
    if let Some(before) = scan.checked_sub(1) {
        let mut instruments = Instruments::zeroed();
        (instruments.scan, instruments.visible_from) = (before, scan);
        recorder
            .record(SampleRef::Instruments(&instruments))
            .unwrap();
        for axis in 0..2 {
            let mut command = AxisCommand::zeroed();
            (command.scan, command.visible_from, command.axis) = (before, scan, axis);
            recorder
                .record(SampleRef::Command(axis as usize, &command))
                .unwrap();
        }
    }
    if scan.is_multiple_of(8) {
        let header = WindowHeader {
            id: WindowId {
                checksum: scan,
                sequence: scan as u32 / 8 + 1,
                incarnation: 1,
            },
            visible_from: scan,
            ..WindowHeader::default()
        };
        recorder.record(SampleRef::window(&header, &[])).unwrap();
        let planner = PlannerStatus {
            scan,
            visible_from: scan,
            incarnation: 1,
            ..PlannerStatus::default()
        };
        recorder.record(SampleRef::Planner(&planner)).unwrap();
    }
    let mut feedback = Feedback::zeroed();
    feedback.scan = scan;
    recorder.record(SampleRef::Feedback(&feedback)).unwrap();
}

fn roster(recorder: &mut Recorder, version: u64) {
    let roster = Roster {
        version,
        ..Roster::default()
    };
    recorder.record(SampleRef::Roster(&roster)).unwrap();
}

/// A recorder that is killed: what it has written so far stays, nothing ends it.
fn kill(mut recorder: Recorder) {
    recorder.flush().unwrap();
    std::mem::forget(recorder);
}

fn read(dir: &Path) -> (Vec<Sample>, RunLog) {
    let mut log = RunLog::open(dir).unwrap();
    let samples = log.by_ref().map(Result::unwrap).collect();
    (samples, log)
}

fn feedback_scans(samples: &[Sample]) -> Vec<u64> {
    let of = |sample: &Sample| match sample {
        Sample::Feedback(feedback) => Some(feedback.scan),
        _ => None,
    };
    samples.iter().filter_map(of).collect()
}

/// Scans 0 to 900, then nobody, then 931 to 999; the second part finds the last roster once more.
fn two_parts(dir: &Path) -> String {
    let mut recorder = begin(dir);
    roster(&mut recorder, 1);
    (0..=900).for_each(|scan| record(&mut recorder, scan));
    kill(recorder);
    let mut recorder = begin(dir);
    roster(&mut recorder, 1);
    roster(&mut recorder, 3);
    (931..1000).for_each(|scan| record(&mut recorder, scan));
    recorder
        .finish(&RunEnd {
            wall_s: 0.5,
            queue_losses: 2,
            ..RunEnd::default()
        })
        .unwrap()
}

#[test]
fn a_recorder_never_writes_over_a_part_that_is_there() {
    let dir = tempfile::tempdir().unwrap();
    for expected in ["run.mcap", "run-2.mcap", "run-3.mcap"] {
        let mut recorder = begin(dir.path());
        record(&mut recorder, 0);
        kill(recorder);
        assert!(dir.path().join(expected).exists(), "{expected}");
    }
    // A part that was taken away leaves its number unused: the order stays that of time.
    std::fs::remove_file(dir.path().join("run-2.mcap")).unwrap();
    for other in ["run-02.mcap", "run-1.mcap", "run-x.mcap", "other.mcap"] {
        std::fs::write(dir.path().join(other), b"").unwrap();
    }
    kill(begin(dir.path()));
    let names: Vec<_> = part_files(dir.path())
        .unwrap()
        .iter()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(names, ["run.mcap", "run-3.mcap", "run-4.mcap"]);
    let reader = Reader::open(&dir.path().join("run-4.mcap")).unwrap();
    assert_eq!(reader.info().settings["part"], "4");
}

#[test]
fn ten_parts_are_in_the_order_of_their_numbers() {
    let dir = tempfile::tempdir().unwrap();
    for part in 0..12 {
        let mut recorder = begin(dir.path());
        (part * 10..part * 10 + 10).for_each(|scan| record(&mut recorder, scan));
        kill(recorder);
    }
    let (samples, log) = read(dir.path());
    assert_eq!(feedback_scans(&samples), (0..120).collect::<Vec<_>>());
    assert_eq!(log.parts()[9].file, "run-10.mcap");
    assert_eq!(log.windows_lost(), 0);
}

#[test]
fn a_log_of_one_part_reads_as_that_part() {
    let dir = tempfile::tempdir().unwrap();
    let mut recorder = begin(dir.path());
    (0..50).for_each(|scan| record(&mut recorder, scan));
    let digest = recorder.finish(&RunEnd::default()).unwrap();
    let (samples, log) = read(dir.path());
    let one: Vec<Sample> = Reader::open(&dir.path().join(LOG_FILE))
        .unwrap()
        .map(Result::unwrap)
        .collect();
    assert_eq!(samples, one);
    assert_eq!(log.digest(), Some(digest));
    let part = Part {
        file: LOG_FILE.into(),
        first_scan: Some(0),
        last_scan: Some(49),
        cut: None,
    };
    assert_eq!(log.parts(), [part]);
}

#[test]
fn a_cut_part_and_the_next_are_joined_and_the_gap_is_known() {
    let dir = tempfile::tempdir().unwrap();
    let second = two_parts(dir.path());
    let (samples, log) = read(dir.path());
    let scans: Vec<u64> = (0..=900).chain(931..1000).collect();
    assert_eq!(feedback_scans(&samples), scans);
    let rosters = samples.iter().filter(|s| matches!(s, Sample::Roster(_)));
    assert_eq!(rosters.count(), 2, "the one heard twice is reported once");
    let parts = log.parts();
    assert_eq!(
        (parts[0].first_scan, parts[0].last_scan),
        (Some(0), Some(900))
    );
    assert!(parts[0].cut.is_some() && parts[1].cut.is_none());
    assert_eq!(
        (parts[1].first_scan, parts[1].last_scan),
        (Some(931), Some(999))
    );
    // Windows of scans 904, 912, 920 and 928 were published meanwhile.
    assert_eq!(log.windows_lost(), 4);
    assert_eq!(log.cut(), None);
    let end = log.end().unwrap();
    assert_eq!(end.queue_losses, 2);
    let first = {
        let mut reader = Reader::open(&dir.path().join(LOG_FILE)).unwrap();
        while reader.next_sample().unwrap().is_some() {}
        reader.digest().unwrap()
    };
    assert_eq!(
        log.digest(),
        Some(crate::digest::over_parts([first.as_str(), second.as_str()]))
    );
    assert_ne!(
        log.digest(),
        Some(crate::digest::over_parts([second.as_str(), first.as_str()]))
    );
    assert_eq!(read(dir.path()).1.digest(), log.digest());
}

#[test]
fn a_part_cut_in_the_middle_of_a_chunk_is_read_up_to_its_last_whole_one() {
    let dir = tempfile::tempdir().unwrap();
    let mut recorder = begin(dir.path());
    (0..300).for_each(|scan| record(&mut recorder, scan));
    recorder.flush().unwrap();
    let first = dir.path().join(LOG_FILE);
    let flushed = std::fs::metadata(&first).unwrap().len() as usize;
    (300..600).for_each(|scan| record(&mut recorder, scan));
    kill(recorder);
    let mut recorder = begin(dir.path());
    (650..700).for_each(|scan| record(&mut recorder, scan));
    recorder.finish(&RunEnd::default()).unwrap();
    // The killed writer was in the middle of a chunk: those before it stay, and so does the second part.
    let whole = std::fs::read(&first).unwrap();
    std::fs::write(&first, &whole[..flushed + 50]).unwrap();
    let (samples, log) = read(dir.path());
    let scans: Vec<u64> = (0..300).chain(650..700).collect();
    assert_eq!(feedback_scans(&samples), scans);
    assert_eq!(log.parts()[0].last_scan, Some(299));
    assert!(log.parts()[0].cut.is_some());
}

#[test]
fn scans_that_an_earlier_part_had_are_not_reported_twice() {
    let dir = tempfile::tempdir().unwrap();
    let mut recorder = begin(dir.path());
    (0..=100).for_each(|scan| record(&mut recorder, scan));
    kill(recorder);
    let mut recorder = begin(dir.path());
    (90..=200).for_each(|scan| record(&mut recorder, scan));
    recorder.finish(&RunEnd::default()).unwrap();
    let once = tempfile::tempdir().unwrap();
    let mut recorder = begin(once.path());
    (0..=200).for_each(|scan| record(&mut recorder, scan));
    recorder.finish(&RunEnd::default()).unwrap();
    let ((joined, log), (whole, _)) = (read(dir.path()), read(once.path()));
    assert_eq!(joined, whole);
    assert_eq!(log.windows_lost(), 0);
    assert_eq!(log.parts()[1].first_scan, Some(90));
}

#[test]
fn a_recorder_that_died_before_it_wrote_anything_leaves_an_empty_part() {
    let dir = tempfile::tempdir().unwrap();
    two_parts(dir.path());
    std::fs::write(dir.path().join("run-3.mcap"), b"").unwrap();
    let (samples, log) = read(dir.path());
    assert_eq!(feedback_scans(&samples).len(), 970);
    let last = log.parts().last().unwrap();
    assert_eq!((last.first_scan, last.last_scan), (None, None));
    assert!(log.cut().unwrap().contains("before it had written"));
    // The same with the first one.
    std::fs::write(dir.path().join(LOG_FILE), b"").unwrap();
    let (samples, log) = read(dir.path());
    assert_eq!(feedback_scans(&samples).len(), 69);
    assert_eq!(log.parts().len(), 3);
}

#[test]
fn parts_of_other_runs_foreign_files_and_missing_logs_are_refused() {
    let refusal = |dir: &Path| {
        let failed = |log: RunLog| log.into_iter().find_map(Result::err);
        let error = match RunLog::open(dir) {
            Ok(log) => failed(log).unwrap(),
            Err(error) => error,
        };
        error.to_string()
    };
    let dir = tempfile::tempdir().unwrap();
    assert!(refusal(dir.path()).contains("run.mcap"));
    std::fs::write(dir.path().join(LOG_FILE), b"").unwrap();
    assert!(refusal(dir.path()).contains("ends before metadata"));
    std::fs::remove_file(dir.path().join(LOG_FILE)).unwrap();
    two_parts(dir.path());
    let foreign = dir.path().join("run-3.mcap");
    std::fs::write(&foreign, b"G1 X10 F1000 this is no log\n").unwrap();
    assert!(refusal(dir.path()).contains("run-3.mcap: is not an MCAP log"));
    std::fs::remove_file(&foreign).unwrap();
    let other =
        Recorder::create_part(dir.path(), &machine(&["X", "Z"]), &info(), LogLevel::Full).unwrap();
    other.finish(&RunEnd::default()).unwrap();
    let text = refusal(dir.path());
    assert!(
        text.contains("axes X Z") && text.contains("not of one run"),
        "{text}"
    );
}
