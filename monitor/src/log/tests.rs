//! What goes into a log comes out of it, also when its end is missing.

use machine::LogLevel;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use bus::sample::*;
use bytemuck::Zeroable;
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

use super::*;
use crate::standbys::Standbys;
use crate::test_support::machine;

/// A run of some scans in which every field that is in use has a value of its own.
struct Synthetic {
    axes: usize,
    subsamples: usize,
}

fn scrambled<T: bytemuck::Pod>(seed: u64) -> T {
    let mut rng = SplitMix64::seed_from_u64(seed);
    let mut sample = T::zeroed();
    for byte in bytemuck::bytes_of_mut(&mut sample) {
        // Never all ones in an exponent, so that a value equals itself.
        *byte = rng.next_u64() as u8 & 0x3f;
    }
    sample
}

impl Synthetic {
    fn feedback(&self, scan: u64) -> Feedback {
        let mut sample: Feedback = scrambled(scan);
        sample.scan = scan;
        sample.axis_count = self.axes as u32;
        sample.path_axes = self.axes as u32;
        let places = [
            &mut sample.program_start,
            &mut sample.answer.tripped,
            &mut sample.answer.rests,
        ];
        for place in places {
            place[self.axes..].fill(0);
        }
        sample.axes[self.axes..].fill(AxisFeedback::zeroed());
        sample
    }

    fn instruments(&self, scan: u64) -> Instruments {
        let mut sample: Instruments = scrambled(scan + 1_000_000);
        sample.scan = scan;
        sample.subsamples = self.subsamples as u32;
        sample.axes[self.axes..].fill(AxisInstruments::zeroed());
        for axis in &mut sample.axes {
            axis.table_mm[self.subsamples..].fill(0.0);
            axis.motor_mm[self.subsamples..].fill(0.0);
        }
        sample
    }

    fn command(&self, scan: u64, axis: usize, role: u32) -> AxisCommand {
        let mut sample: AxisCommand = scrambled(scan * 8 + axis as u64 + 2_000_000);
        sample.scan = scan;
        sample.axis = axis as u32;
        sample.role = role;
        sample
    }

    fn window(&self, sequence: u32) -> (WindowHeader, Vec<Setpoint>) {
        let mut header: WindowHeader = scrambled(u64::from(sequence));
        header.intended_setpoints = 32;
        header.setpoint_count = 80;
        let setpoints = (0..80)
            .map(|setpoint| {
                let mut sample: Setpoint = scrambled(u64::from(sequence) * 1000 + setpoint);
                sample.position[self.axes..].fill(0);
                sample
            })
            .collect();
        (header, setpoints)
    }

    /// Everything of one scan, in the order it is recorded.
    fn record(&self, recorder: &mut Recorder, scan: u64) {
        recorder
            .record(SampleRef::Feedback(&self.feedback(scan)))
            .unwrap();
        for axis in 0..self.axes {
            recorder
                .record(SampleRef::Command(axis, &self.command(scan, axis, 0)))
                .unwrap();
        }
        recorder
            .record(SampleRef::Instruments(&self.instruments(scan)))
            .unwrap();
        if scan.is_multiple_of(8) {
            let (header, setpoints) = self.window(scan as u32);
            recorder
                .record(SampleRef::window(&header, &setpoints))
                .unwrap();
            recorder
                .record(SampleRef::Planner(&scrambled(scan)))
                .unwrap();
        }
    }
}

const TWO: Synthetic = Synthetic {
    axes: 2,
    subsamples: 4,
};

fn info() -> RunInfo {
    RunInfo {
        quadrant: "0.1.0".into(),
        cell: "test".into(),
        pace: "lockstep".into(),
        program: "circle.ngc".into(),
        settings: [("method".to_string(), "pulse".to_string())].into(),
        files: vec![("circle.ngc".into(), b"G2 X0\n".to_vec())],
    }
}

fn write(path: &Path, scans: u64) -> String {
    let machine = machine(&["X", "Y"]);
    let mut recorder = Recorder::create(path, &machine, &info()).unwrap();
    for scan in 0..scans {
        TWO.record(&mut recorder, scan);
    }
    recorder.record(SampleRef::Roster(&scrambled(7))).unwrap();
    recorder
        .record(SampleRef::Event(&Event {
            scan: 3,
            process: "servo-X".into(),
            text: "killed by signal 9".into(),
        }))
        .unwrap();
    recorder
        .finish(&RunEnd {
            wall_s: 0.25,
            queue_losses: 3,
            ..RunEnd::default()
        })
        .unwrap()
}

/// What a wire did is in the log of a machine with a bus, and in no digest.
#[test]
fn a_cycle_of_the_bus_is_read_back_and_counts_in_no_digest() {
    let dir = tempfile::tempdir().unwrap();
    let mut on_bus = machine(&["X", "Y"]);
    let cycle: bus::sample::BusCycle = bus::sample::BusCycle {
        axis_count: 2,
        inputs: std::array::from_fn(|axis| [1, 2].get(axis).copied().unwrap_or(0)),
        round_trip_ns: 81_234,
        ..scrambled(3)
    };
    let record = |machine: &machine::Machine, name: &str| {
        let path = dir.path().join(name);
        let mut recorder = Recorder::create(&path, machine, &info()).unwrap();
        recorder
            .record(SampleRef::Feedback(&TWO.feedback(3)))
            .unwrap();
        let recorded = recorder.record(SampleRef::BusCycle(&cycle));
        let digest = recorder.digest();
        recorder.finish(&RunEnd::default()).unwrap();
        (path, recorded, digest)
    };
    let (_, refused, without) = record(&on_bus, "simulated.mcap");
    assert!(refused.unwrap_err().to_string().contains("fieldbus"));
    on_bus.bus = Some(machine::Fieldbus {
        interface: "eth1".into(),
        sync: machine::Sync::Sm,
        watchdog_ms: 10,
        standby: false,
        other_slaves: Vec::new(),
        terminals: Vec::new(),
        spindle: None,
    });
    let (path, recorded, with) = record(&on_bus, "bus.mcap");
    recorded.unwrap();
    assert_eq!(with, without);
    let mut reader = Reader::open(&path).unwrap();
    let samples: Vec<Sample> = reader.by_ref().map(Result::unwrap).collect();
    assert!(samples.contains(&Sample::BusCycle(Box::new(cycle))));
    assert_eq!(reader.digest(), Some(with));
}

#[test]
fn what_is_recorded_is_read_back_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(LOG_FILE);
    let digest = write(&path, 40);
    if let Some(keep) = std::env::var_os("QUADRANT_KEEP_LOG") {
        std::fs::copy(&path, keep).unwrap();
    }
    let mut reader = Reader::open(&path).unwrap();
    assert_eq!(reader.axes(), ["X", "Y"]);
    let mut expected = Vec::new();
    for scan in 0..40 {
        expected.push(Sample::Feedback(Box::new(TWO.feedback(scan))));
        expected.push(Sample::Command(Box::new(TWO.command(scan, 0, 0))));
        expected.push(Sample::Command(Box::new(TWO.command(scan, 1, 0))));
        expected.push(Sample::Instruments(Box::new(TWO.instruments(scan))));
        if scan.is_multiple_of(8) {
            let (header, mut setpoints) = TWO.window(scan as u32);
            let tail = setpoints.split_off(32);
            expected.push(Sample::Window(LoggedWindow {
                header,
                setpoints,
                tail_checksum: xxhash_rust::xxh3::xxh3_64(bytemuck::cast_slice(&tail)),
            }));
            expected.push(Sample::Planner(scrambled(scan)));
        }
    }
    expected.push(Sample::Roster(Box::new(scrambled(7))));
    let event = Event {
        scan: 3,
        process: "servo-X".into(),
        text: "killed by signal 9".into(),
    };
    expected.push(Sample::Event(event));
    let mut read: Vec<Sample> = reader.by_ref().map(Result::unwrap).collect();
    assert_eq!(read.len(), expected.len());
    // These samples become visible in no order: each channel has its own.
    for samples in [&mut read, &mut expected] {
        samples.sort_by_key(|sample| {
            let axis = match sample {
                Sample::Command(command) => command.axis,
                _ => 0,
            };
            (Content::of(&sample.as_ref(0)) as u8, axis)
        });
    }
    for (index, (read, expected)) in read.iter().zip(&expected).enumerate() {
        assert_eq!(read, expected, "sample {index}");
    }
    assert_eq!(reader.digest(), Some(digest));
    assert_eq!(reader.cut(), None);
    let end = reader.end().unwrap();
    assert_eq!((end.wall_s, end.queue_losses), (0.25, 3));
    assert_eq!(reader.info().pace, "lockstep");
    assert_eq!(reader.info().settings["method"], "pulse");
}

#[test]
fn a_log_cut_anywhere_is_read_up_to_the_cut_and_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(LOG_FILE);
    let machine = machine(&["X", "Y"]);
    let mut recorder = Recorder::create(&path, &machine, &info()).unwrap();
    let mut flushed = Vec::new();
    for scan in 0..300 {
        TWO.record(&mut recorder, scan);
        if (scan + 1).is_multiple_of(100) {
            recorder.flush().unwrap();
            flushed.push(std::fs::metadata(&path).unwrap().len() as usize);
        }
    }
    drop(recorder);
    let whole = std::fs::read(&path).unwrap();
    let scans_in = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let mut reader = Reader::open(&path).unwrap();
        let scans = reader
            .by_ref()
            .filter(|sample| matches!(sample.as_ref().unwrap(), Sample::Feedback(_)))
            .count();
        (scans, reader.cut().map(str::to_string))
    };
    for (index, &end) in flushed.iter().enumerate() {
        let (scans, cut) = scans_in(&whole[..end]);
        assert_eq!(scans, (index + 1) * 100);
        assert!(cut.is_some());
        let (scans, cut) = scans_in(&whole[..end - 100]);
        assert!(scans >= index * 100 && cut.is_some(), "{scans} {cut:?}");
    }
    let (_, cut) = scans_in(&whole);
    assert_eq!(cut.as_deref(), Some("the recorder did not end it"));
}

#[test]
fn a_recorder_that_is_killed_between_flushes_leaves_whole_chunks_and_a_cut_end() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(LOG_FILE);
    let machine = machine(&["X", "Y"]);
    let mut recorder = Recorder::create(&path, &machine, &info()).unwrap();
    let mut lengths = std::collections::BTreeSet::new();
    for scan in 0..6000 {
        TWO.record(&mut recorder, scan);
        if scan % 500 == 0 {
            let copy = dir.path().join("as-killed.mcap");
            lengths.insert(std::fs::copy(&path, &copy).unwrap());
            let mut reader = Reader::open(&copy).unwrap();
            while reader.next_sample().unwrap().is_some() {}
            let cut = reader.cut().unwrap().to_string();
            let fair = cut.contains("in the middle of a record") || cut.contains("did not end");
            assert!(fair, "scan {scan}: {cut}");
        }
    }
    assert!(lengths.len() > 2, "{lengths:?}");
}

#[test]
fn damaged_and_foreign_files_are_refused_or_cut_but_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(LOG_FILE);
    write(&path, 20);
    let whole = std::fs::read(&path).unwrap();
    for index in (0..whole.len()).step_by(61) {
        let mut damaged = whole.clone();
        damaged[index] ^= 0xff;
        std::fs::write(&path, &damaged).unwrap();
        if let Ok(mut reader) = Reader::open(&path) {
            while let Ok(Some(_)) = reader.next_sample() {}
        }
    }
    std::fs::write(&path, b"G1 X10 F1000\n").unwrap();
    let refusal = Reader::open(&path).err().unwrap().to_string();
    assert!(refusal.contains("is not an MCAP log"), "{refusal}");
    std::fs::write(&path, b"").unwrap();
    assert!(Reader::open(&path).is_err());
    assert!(Reader::open(&dir.path().join("nothing")).is_err());
}

#[test]
fn a_standby_has_a_channel_of_its_own_and_its_order_does_not_matter() {
    let digest = |standby_first: bool| {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(LOG_FILE);
        let machine = machine(&["X", "Y"]);
        let mut recorder = Recorder::create(&path, &machine, &info()).unwrap();
        for scan in 0..10 {
            let roles = if standby_first { [1, 0] } else { [0, 1] };
            for role in roles {
                recorder
                    .record(SampleRef::Command(1, &TWO.command(scan, 1, role)))
                    .unwrap();
            }
            recorder
                .record(SampleRef::Feedback(&TWO.feedback(scan)))
                .unwrap();
        }
        recorder.finish(&RunEnd::default()).unwrap()
    };
    assert_eq!(digest(true), digest(false));
}

#[test]
fn samples_that_this_machine_cannot_have_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let machine = machine(&["X", "Y"]);
    let mut recorder = Recorder::create(&dir.path().join(LOG_FILE), &machine, &info()).unwrap();
    let refusal = recorder.record(SampleRef::Command(2, &TWO.command(0, 2, 0)));
    assert_eq!(
        refusal.unwrap_err().to_string(),
        "command for axis 2: this machine has 2 axes"
    );
    assert!(
        recorder
            .record(SampleRef::Command(1, &TWO.command(0, 1, 2)))
            .is_err()
    );
}

#[test]
fn a_file_that_cannot_be_created_is_named() {
    let machine = machine(&["X"]);
    let refusal = Recorder::create(Path::new("/nonexistent/run.mcap"), &machine, &info());
    let text = refusal.err().unwrap().to_string();
    assert!(text.starts_with("/nonexistent/run.mcap: "), "{text}");
}

/// `cargo test -p monitor --release -- --ignored --nocapture recording_cost`
#[test]
#[ignore = "a measurement, not a check"]
fn recording_cost_per_scan() {
    let dir = tempfile::tempdir().unwrap();
    for axes in [2usize, 3] {
        let path = dir.path().join(LOG_FILE);
        let letters: Vec<&str> = ["X", "Y", "Z"].into_iter().take(axes).collect();
        let machine = machine(&letters);
        let shape = Synthetic {
            axes,
            subsamples: 4,
        };
        let mut recorder = Recorder::create(&path, &machine, &info()).unwrap();
        let smooth = |scan: u64, base: f64| base + libm::sin(scan as f64 * 1e-3);
        let mut feedback: Feedback = shape.feedback(0);
        let mut instruments = shape.instruments(0);
        let mut command = shape.command(0, 0, 0);
        let windows = shape.window(1);
        let scans = 200_000;
        let start = Instant::now();
        for scan in 0..scans {
            feedback.scan = scan;
            instruments.scan = scan;
            command.scan = scan;
            for axis in 0..axes {
                let at = smooth(scan, axis as f64);
                feedback.axes[axis].motor_position = (at * 1e6) as i64;
                feedback.axes[axis].torque_nm = at * 0.1;
                feedback.axes[axis].velocity_mm_s = at * 3.0;
                for sub in 0..4 {
                    instruments.axes[axis].table_mm[sub] = at + sub as f64 * 1e-5;
                    instruments.axes[axis].motor_mm[sub] = at - sub as f64 * 1e-5;
                }
            }
            recorder.record(SampleRef::Feedback(&feedback)).unwrap();
            for axis in 0..axes {
                command.axis = axis as u32;
                command.position = feedback.axes[axis].motor_position + 5;
                command.velocity_mm_s = feedback.axes[axis].velocity_mm_s;
                command.state[8] = command.velocity_mm_s.to_bits();
                recorder.record(SampleRef::Command(axis, &command)).unwrap();
            }
            recorder
                .record(SampleRef::Instruments(&instruments))
                .unwrap();
            if scan.is_multiple_of(8) {
                recorder
                    .record(SampleRef::window(&windows.0, &windows.1))
                    .unwrap();
                recorder
                    .record(SampleRef::Planner(&scrambled(scan)))
                    .unwrap();
            }
        }
        recorder.finish(&RunEnd::default()).unwrap();
        let wall_us = start.elapsed().as_secs_f64() * 1e6;
        let bytes = std::fs::metadata(&path).unwrap().len();
        println!(
            "{axes} axes: {:.2} µs and {} file bytes per scan",
            wall_us / scans as f64,
            bytes / scans
        );
        let start = Instant::now();
        let mut reader = Reader::open(&path).unwrap();
        let samples = reader.by_ref().filter(|s| s.is_ok()).count();
        println!(
            "{axes} axes: read back in {:.2} µs per scan ({samples} samples, digest {:?})",
            start.elapsed().as_secs_f64() * 1e6 / scans as f64,
            reader.digest()
        );
    }
}

/// The topics of a log, and how many samples each has.
fn rows_by_topic(path: &Path) -> BTreeMap<String, u32> {
    let file = std::fs::read(path).unwrap();
    let mut rows = BTreeMap::new();
    for message in mcap::MessageStream::new(&file).unwrap() {
        let message = message.unwrap();
        let first = message.data[4..8].try_into().unwrap();
        *rows.entry(message.channel.topic.clone()).or_default() += u32::from_le_bytes(first);
    }
    rows
}

/// A standby that says the same is not worth a byte; one that says something else is the first thing to look at.
#[test]
fn a_level_leaves_out_what_it_says_and_notes_the_digest_of_all() {
    let dir = tempfile::tempdir().unwrap();
    let machine = machine(&["X", "Y"]);
    let record = |level: LogLevel| {
        let folder = dir.path().join(level.to_string());
        std::fs::create_dir(&folder).unwrap();
        let mut recorder = Recorder::create_part(&folder, &machine, &info(), level).unwrap();
        let mut standbys = Standbys::default();
        for scan in 0..1500u64 {
            for axis in 0..2 {
                for role in 0..2 {
                    let mut command = AxisCommand::zeroed();
                    (command.scan, command.visible_from) = (scan, scan);
                    (command.axis, command.role) = (axis, role);
                    command.state[7] = scan;
                    command.state_words = 8;
                    // In one scan the standby of Y differs.
                    command.position = i64::from(scan == 300 && axis == 1 && role == 1);
                    let axis = axis as usize;
                    let taken = match standbys.repeats(axis, &command) {
                        true => recorder.repeat(axis, &command),
                        false => recorder.record(SampleRef::Command(axis, &command)),
                    };
                    taken.unwrap();
                }
            }
            let mut instruments = Instruments::zeroed();
            (instruments.scan, instruments.visible_from) = (scan, scan);
            instruments.motion_digest_low = 7 + scan;
            recorder
                .record(SampleRef::Instruments(&instruments))
                .unwrap();
            let mut feedback = Feedback::zeroed();
            feedback.scan = scan;
            // The machine trips in one.
            feedback.mode = u32::from(scan >= 700);
            recorder.record(SampleRef::Feedback(&feedback)).unwrap();
        }
        let digest = recorder.finish(&RunEnd::default()).unwrap();
        let path = folder.join(LOG_FILE);
        let mut reader = Reader::open(&path).unwrap();
        let commands = reader
            .by_ref()
            .filter(|sample| matches!(sample, Ok(Sample::Command(command)) if command.role == 1));
        let of_standby = commands.count();
        let end = reader.end().unwrap().clone();
        assert_eq!(reader.digest(), Some(digest.clone()));
        assert_eq!(end.motion_digest, Some(crate::digest::hex(1506)));
        (digest, of_standby, end.commands_alike, rows_by_topic(&path))
    };
    let (full, of_standby, alike, rows) = record(LogLevel::Full);
    assert_eq!((of_standby, alike), (3000, 0));
    assert!(!rows.contains_key("/servo_state/X"));
    for (level, instruments) in [(LogLevel::Control, Some(&1500)), (LogLevel::Axes, None)] {
        let (digest, of_standby, alike, rows) = record(level);
        // The first of each axis, and the one that differs.
        assert_eq!((of_standby, alike), (3, 2997), "{level}");
        assert_eq!(digest, full, "{level}");
        assert_eq!(rows["/feedback"], 1500);
        assert_eq!(rows["/command/X"], 1500);
        assert_eq!(rows.get("/instruments"), instruments, "{level}");
        if level == LogLevel::Control {
            // Of both at the beginning, behind the trip, and every thousand scans.
            assert_eq!(rows["/servo_state/X"], 4);
        }
    }
}

#[test]
fn a_recorder_that_gives_up_leaves_all_that_it_had_taken() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut recorder = Recorder::create(&path, &machine(&["X", "Y"]), &info()).unwrap();
    for scan in 0..100 {
        TWO.record(&mut recorder, scan);
    }
    drop(recorder);
    let mut reader = Reader::open(&path).unwrap();
    let samples = reader.by_ref().map(Result::unwrap);
    let feedbacks = samples.filter(|sample| matches!(sample, Sample::Feedback(_)));
    assert_eq!(feedbacks.count(), 100);
    assert!(reader.end().is_none());
}
