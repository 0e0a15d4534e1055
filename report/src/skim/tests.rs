//! What is skimmed of a log is what reading it from end to end finds.

use bytemuck::Zeroable;
use machine::LogLevel;
use monitor::log::{LOG_FILE, Recorder, RunEnd, RunInfo, RunLog, SampleRef};

use super::*;
use crate::test_support::machine;

fn begin(dir: &Path) -> Recorder {
    Recorder::create_part(
        dir,
        &machine(&["X", "Y"]),
        &RunInfo::default(),
        LogLevel::Full,
    )
    .unwrap()
}

fn roster(recorder: &mut Recorder, version: u64) {
    let roster = Roster {
        version,
        ..Roster::default()
    };
    recorder.record(SampleRef::Roster(&roster)).unwrap();
}

/// What is known of a log beforehand, found by reading all of it.
fn prescan(dir: &Path) -> Prescan {
    let mut prescan = Prescan::default();
    for sample in RunLog::open(dir).unwrap() {
        prescan.take(&sample.unwrap());
    }
    prescan
}

#[test]
fn skimming_a_log_in_parts_finds_what_reading_it_finds() {
    let dir = tempfile::tempdir().unwrap();
    for versions in [&[1][..], &[1, 3]] {
        let mut recorder = begin(dir.path());
        versions
            .iter()
            .for_each(|version| roster(&mut recorder, *version));
        recorder.finish(&RunEnd::default()).unwrap();
    }
    let found = skim(dir.path()).unwrap();
    assert_eq!(found, prescan(dir.path()));
    let versions: Vec<u64> = found.rosters.iter().map(|r| r.version).collect();
    assert_eq!((versions, found.start), (vec![1, 3], None));
}

/// Rosters here and there among many chunks, and a program that begins in the third.
fn many_chunks(dir: &Path) {
    let mut recorder = begin(dir);
    for scan in 0..4000 {
        if [0, 1700, 1701, 3900].contains(&scan) {
            roster(&mut recorder, scan + 1);
        }
        let mut feedback = Feedback::zeroed();
        feedback.scan = scan;
        if scan >= 1200 {
            feedback.window.sequence = 1;
            feedback.program_start = [scan as i64; PATH_AXES];
            feedback.program_hash = 77;
        }
        recorder.record(SampleRef::Feedback(&feedback)).unwrap();
        if scan % 400 == 0 {
            recorder.flush().unwrap();
        }
    }
    recorder.finish(&RunEnd::default()).unwrap();
}

#[test]
fn skimming_passes_over_chunks_and_finds_the_programs_start_and_every_roster() {
    let dir = tempfile::tempdir().unwrap();
    many_chunks(dir.path());
    let found = skim(dir.path()).unwrap();
    assert_eq!(found, prescan(dir.path()));
    let versions: Vec<u64> = found.rosters.iter().map(|r| r.version).collect();
    assert_eq!(versions, [1, 1701, 1702, 3901]);
    let start = found.start.unwrap();
    assert_eq!((start.command_positions[0], start.program_hash), (1200, 77));
}

#[test]
fn a_log_cut_anywhere_is_skimmed_as_far_as_it_reads() {
    let dir = tempfile::tempdir().unwrap();
    many_chunks(dir.path());
    let log = dir.path().join(LOG_FILE);
    let whole = std::fs::read(&log).unwrap();
    let cut = tempfile::tempdir().unwrap();
    for share in 1..40 {
        let length = whole.len() * share / 40;
        std::fs::write(cut.path().join(LOG_FILE), &whole[..length]).unwrap();
        if RunLog::open(cut.path()).is_ok() {
            let (found, read) = (skim(cut.path()).unwrap(), prescan(cut.path()));
            assert_eq!(found, read, "cut to {length} bytes");
        }
    }
}
