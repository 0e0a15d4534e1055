use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use bus::sample::{AxisCommand, Instruments, Job, PlannerStatus, Setpoint, WindowHeader, WindowId};
use bytemuck::Zeroable;

use super::*;
use crate::log::{LoggedWindow, Reader, Sample, SampleRef};
use crate::test_support::machine;

const SETTINGS: Settings = Settings {
    before_s: 0.5,
    after_s: 0.2,
    longest_s: 1.0,
    boxes_max: 3,
    boxes_bytes_max: u64::MAX,
    ring_bytes_max: 64 << 20,
};

struct Bench {
    folder: tempfile::TempDir,
    black_box: BlackBox,
    /// Everything that was fed, in order.
    fed: Vec<Sample>,
    events: Vec<Event>,
    scan: u64,
    mode: Mode,
    died: Option<u64>,
}

fn home(folder: &Path) -> Home {
    Home {
        directory: folder.into(),
        info: RunInfo {
            quadrant: "0".into(),
            cell: "test".into(),
            pace: "lockstep".into(),
            program: "p.ngc".into(),
            files: vec![
                ("machine.toml".into(), b"name = \"x\"".to_vec()),
                ("large.ngc".into(), vec![b' '; FILE_BYTES_MAX + 1]),
            ],
            ..RunInfo::default()
        },
    }
}

impl Bench {
    fn new(settings: Settings) -> Bench {
        let folder = tempfile::tempdir().expect("a folder");
        let machine = machine(&["X", "Y"]);
        let black_box = BlackBox::new(settings, &machine, Some(home(folder.path())));
        Bench {
            folder,
            black_box,
            fed: Vec::new(),
            events: Vec::new(),
            scan: 0,
            mode: Mode::Enabled,
            died: None,
        }
    }

    /// Who takes part.
    fn roster(&mut self, death_scan: Option<u64>) {
        let mut roster = Roster::zeroed();
        roster.version = self.scan + 1;
        roster.visible_from = self.scan;
        let participant = &mut roster.participants[0];
        participant.job = Job::Servo as u32;
        participant.axis = 1;
        participant.incarnation = 1;
        participant.death_scan = death_scan.unwrap_or(u64::MAX);
        participant.death_signal = if death_scan.is_some() { 9 } else { 0 };
        self.black_box.take(SampleRef::Roster(&roster));
        self.fed.push(Sample::Roster(Box::new(roster)));
    }

    /// So many scans, each with everything.
    fn run(&mut self, scans: u64) {
        for _ in 0..scans {
            let scan = self.scan;
            if scan == 0 {
                self.roster(None);
            }
            if let Some(died) = self.died.take() {
                self.roster(Some(died));
            }
            let mut instruments = Instruments::zeroed();
            (instruments.scan, instruments.visible_from) = (scan, scan);
            instruments.axes[1].table_mm[2] = scan as f64;
            self.black_box.take(SampleRef::Instruments(&instruments));
            self.fed.push(Sample::Instruments(Box::new(instruments)));
            for axis in 0..2 {
                let mut command = AxisCommand::zeroed();
                (command.scan, command.visible_from) = (scan, scan);
                command.axis = axis;
                command.state[31] = scan;
                self.black_box
                    .take(SampleRef::Command(axis as usize, &command));
                // Whole states have a channel of their own.
                command.state[31] = 0;
                self.fed.push(Sample::Command(Box::new(command)));
            }
            if scan.is_multiple_of(8) {
                let mut planner = PlannerStatus::zeroed();
                (planner.scan, planner.visible_from) = (scan, scan);
                self.black_box.take(SampleRef::Planner(&planner));
                self.fed.push(Sample::Planner(planner));
                let mut header = WindowHeader::zeroed();
                header.id = WindowId {
                    checksum: scan,
                    sequence: scan as u32 / 8 + 1,
                    incarnation: 1,
                };
                (header.intended_setpoints, header.setpoint_count) = (3, 5);
                header.visible_from = scan;
                let mut setpoints = vec![Setpoint::zeroed(); 5];
                setpoints[4].position[0] = scan as i64;
                self.black_box.take(SampleRef::window(&header, &setpoints));
                self.fed.push(Sample::Window(LoggedWindow {
                    header,
                    setpoints: setpoints[..3].to_vec(),
                    tail_checksum: match SampleRef::window(&header, &setpoints) {
                        SampleRef::Window(_, _, tail_checksum) => tail_checksum,
                        _ => unreachable!(),
                    },
                }));
            }
            let mut feedback = Feedback::zeroed();
            feedback.scan = scan;
            feedback.axis_count = 2;
            feedback.mode = self.mode as u32;
            feedback.cause_axis = u32::MAX;
            if self.mode == Mode::Tripped {
                feedback.cause = Cause::Watchdog as u32;
                feedback.cause_axis = 1;
            }
            let event = self.black_box.take(SampleRef::Feedback(&feedback));
            self.events.extend(event);
            self.fed.push(Sample::Feedback(Box::new(feedback)));
            self.scan += 1;
        }
    }

    /// One scan tripped, then on again.
    fn trip(&mut self) {
        self.mode = Mode::Tripped;
        self.run(1);
        self.mode = Mode::Enabled;
    }

    fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).expect("the folder");
        let names = entries.map(|entry| entry.expect("an entry").file_name());
        let mut names: Vec<String> = names.map(|n| n.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join(file)
    }
}

/// Everything in a box but events, and first and last scan of its feedbacks.
fn read(path: &Path) -> (Vec<Sample>, u64, u64) {
    let mut reader = Reader::open(path).expect("a log");
    let samples: Vec<Sample> = reader
        .by_ref()
        .map(|sample| sample.expect("a sample"))
        .filter(|sample| !matches!(sample, Sample::Event(_)))
        .collect();
    assert_eq!(reader.cut(), None, "it was ended in order");
    let scans = samples.iter().filter_map(|sample| match sample {
        Sample::Feedback(feedback) => Some(feedback.scan),
        _ => None,
    });
    let scans: Vec<u64> = scans.collect();
    let (first, last) = (scans[0], scans[scans.len() - 1]);
    assert_eq!(scans, (first..=last).collect::<Vec<_>>(), "without a gap");
    (samples, first, last)
}

#[test]
fn a_trip_saves_what_was_before_and_what_came_after_bit_for_bit() {
    let mut bench = Bench::new(SETTINGS);
    bench.run(2000);
    bench.trip();
    bench.run(1000);
    assert_eq!(bench.files(), ["black-box-2000-trip.mcap"]);
    let path = bench.path("black-box-2000-trip.mcap");
    let (samples, first, last) = read(&path);
    assert_eq!((first, last), (1500, 2200));
    // The roster of the time before is at the beginning.
    assert_eq!(samples[0], bench.fed[0]);
    let from = bench
        .fed
        .iter()
        .position(|s| matches!(s, Sample::Instruments(i) if i.scan == 1500))
        .expect("scan 1500");
    assert_eq!(samples[1..], bench.fed[from..from + samples.len() - 1]);
    let info = Reader::open(&path).expect("a log").info().clone();
    let published = &info.settings["black_box"];
    assert!(
        published.contains("trip: Y: commands missing"),
        "{published}"
    );
    assert!(published.contains("scan 2000"), "{published}");
    assert_eq!(bench.events.len(), 1);
    assert!(bench.events[0].text.contains("black-box-2000-trip.mcap"));
    // What is too long is in none of them.
    let files = crate::log::attached_files(&path).expect("files");
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["machine.toml"]);
}

#[test]
fn a_death_is_saved_under_the_name_of_the_process_and_found_in_its_box() {
    let mut bench = Bench::new(SETTINGS);
    bench.run(1000);
    bench.died = Some(997);
    bench.run(1000);
    assert_eq!(bench.files(), ["black-box-997-death-servo-Y.mcap"]);
    let (samples, first, last) = read(&bench.path("black-box-997-death-servo-Y.mcap"));
    assert_eq!((first, last), (500, 1200));
    // The death is in it, as the roster tells it.
    let mut deaths = Deaths::new(&machine(&["X", "Y"]));
    for sample in samples {
        match sample {
            Sample::Feedback(feedback) => deaths.scan(feedback.scan),
            Sample::Roster(roster) => deaths.roster(&roster),
            _ => {}
        }
    }
    let died = deaths.next_new().map(|death| (death.scan, death.name));
    assert_eq!(died, Some((997, "servo-Y".into())));
}

#[test]
fn causes_in_a_row_share_a_box_up_to_its_longest_and_the_next_begins_another() {
    let mut bench = Bench::new(SETTINGS);
    bench.run(1000);
    bench.trip();
    bench.run(99);
    // Scan 1100: within the time after.
    bench.trip();
    bench.run(2000);
    assert_eq!(bench.files(), ["black-box-1000-trip.mcap"]);
    let (_, first, last) = read(&bench.path("black-box-1000-trip.mcap"));
    assert_eq!((first, last), (500, 1300));
    assert_eq!(bench.events.len(), 2);
    // A cause every 100 scans for 2 s: cut at the longest, then the next one.
    let started = bench.scan;
    for _ in 0..20 {
        bench.trip();
        bench.run(99);
    }
    bench.run(1000);
    let files = bench.files();
    assert_eq!(files.len(), 3, "{files:?}");
    let (_, first, last) = read(&bench.path(&format!("black-box-{started}-trip.mcap")));
    assert_eq!((first, last), (started - 500, started + 1000));
}

#[test]
fn a_directory_gets_no_more_boxes_than_allowed_also_from_the_next_recorder() {
    let mut bench = Bench::new(SETTINGS);
    for _ in 0..5 {
        bench.run(1000);
        bench.trip();
    }
    bench.run(1000);
    assert_eq!(bench.files().len(), 3);
    assert_eq!(bench.events.len(), 3);
    let machine = machine(&["X", "Y"]);
    bench.black_box = BlackBox::new(SETTINGS, &machine, Some(home(bench.folder.path())));
    bench.trip();
    bench.run(1000);
    assert_eq!(bench.files().len(), 3);
    // Another directory begins again.
    let other = tempfile::tempdir().expect("a folder");
    bench.black_box.move_to(Some(home(other.path())));
    bench.trip();
    bench.black_box.finish();
    assert_eq!(fs::read_dir(other.path()).expect("it").count(), 1);
}

#[test]
fn boxes_of_a_directory_take_no_more_than_their_bytes_and_one_that_was_begun_before() {
    let mut bench = Bench::new(Settings {
        boxes_max: usize::MAX,
        boxes_bytes_max: 1,
        ..SETTINGS
    });
    for _ in 0..3 {
        bench.run(1000);
        bench.trip();
    }
    bench.run(1000);
    assert_eq!(bench.files().len(), 1);
    assert_eq!(bench.events.len(), 1);
}

#[test]
fn a_box_that_is_open_when_the_directory_changes_is_written_to_its_end_where_it_was_started() {
    let mut bench = Bench::new(SETTINGS);
    bench.run(1000);
    bench.trip();
    bench.run(50);
    let other = tempfile::tempdir().expect("a folder");
    bench.black_box.move_to(Some(home(other.path())));
    bench.run(1000);
    let (_, first, last) = read(&bench.path("black-box-1000-trip.mcap"));
    assert_eq!((first, last), (500, 1200));
    assert_eq!(fs::read_dir(other.path()).expect("it").count(), 0);
}

#[test]
fn the_end_of_the_run_cuts_the_time_after_and_saves_all_the_same() {
    let mut bench = Bench::new(SETTINGS);
    bench.run(1000);
    bench.trip();
    bench.run(9);
    bench.black_box.finish();
    let (_, first, last) = read(&bench.path("black-box-1000-trip.mcap"));
    assert_eq!((first, last), (500, 1009));
}

#[test]
fn what_happens_soon_after_the_start_is_saved_from_the_start() {
    let mut bench = Bench::new(SETTINGS);
    bench.run(10);
    bench.trip();
    bench.run(500);
    let (samples, first, last) = read(&bench.path("black-box-10-trip.mcap"));
    assert_eq!((first, last), (0, 210));
    assert_eq!(samples[..], bench.fed[..samples.len()]);
}

#[test]
fn the_ring_is_bounded_in_time_and_in_bytes() {
    let mut bench = Bench::new(SETTINGS);
    bench.run(3000);
    assert_eq!(bench.black_box.held().0, 501);
    let small = Settings {
        ring_bytes_max: 300_000,
        ..SETTINGS
    };
    let mut bench = Bench::new(small);
    bench.run(3000);
    let (scans, bytes) = bench.black_box.held();
    assert!(
        bytes <= 300_000 && scans > 50,
        "{scans} scans, {bytes} bytes"
    );
    bench.trip();
    bench.run(1000);
    let (_, first, last) = read(&bench.path("black-box-3000-trip.mcap"));
    assert!((2501..3000).contains(&first), "{first}");
    assert_eq!(last, 3200);
}

#[test]
fn a_directory_that_cannot_be_written_costs_the_box_and_nothing_else() {
    let mut bench = Bench::new(SETTINGS);
    bench
        .black_box
        .move_to(Some(home(Path::new("/nonexistent"))));
    bench.run(1000);
    bench.trip();
    bench.run(500);
    assert_eq!(bench.events, []);
    assert_eq!(bench.black_box.held().0, 501);
}

#[test]
fn a_recorder_that_comes_while_the_machine_is_tripped_saves_nothing_of_it() {
    let mut bench = Bench::new(SETTINGS);
    bench.mode = Mode::Tripped;
    bench.run(500);
    bench.mode = Mode::Enabled;
    bench.run(500);
    assert_eq!(bench.files(), Vec::<String>::new());
}

#[test]
fn without_a_home_nothing_is_saved_and_with_one_later_what_was_before_is_in_it() {
    let mut bench = Bench::new(SETTINGS);
    bench.black_box.move_to(None);
    bench.run(1000);
    bench.trip();
    bench.run(300);
    bench.black_box.move_to(Some(home(bench.folder.path())));
    bench.trip();
    bench.run(500);
    assert_eq!(bench.files(), ["black-box-1301-trip.mcap"]);
    let (_, first, _) = read(&bench.path("black-box-1301-trip.mcap"));
    assert_eq!(first, 801);
}

/// `cargo test -p monitor --release -- --ignored --nocapture black_box_cost`
#[test]
#[ignore = "a measurement, not a check"]
fn black_box_cost_per_scan() {
    let folder = tempfile::tempdir().expect("a folder");
    let letters = ["X", "Y", "Z", "A", "B", "C", "U", "V"];
    for axes in [2usize, 8] {
        let machine = machine(letters.get(..axes).expect("letters"));
        let mut black_box = BlackBox::new(Settings::default(), &machine, Some(home(folder.path())));
        let (mut feedback, mut instruments) = (Feedback::zeroed(), Instruments::zeroed());
        let mut command = AxisCommand::zeroed();
        let mut header = WindowHeader::zeroed();
        (header.intended_setpoints, header.setpoint_count) = (machine.intended_setpoints(), 132);
        let setpoints = vec![Setpoint::zeroed(); 132];
        feedback.axis_count = axes as u32;
        let mut run = |black_box: &mut BlackBox, from: u64, to: u64| {
            let mut slowest_us = 0.0f64;
            let started = Instant::now();
            for scan in from..to {
                let started = Instant::now();
                (feedback.scan, instruments.scan, command.scan) = (scan, scan, scan);
                feedback.axes[0].motor_position = scan as i64 * 7919;
                instruments.axes[0].table_mm[0] = scan as f64 * 1e-3;
                black_box.take(SampleRef::Instruments(&instruments));
                for axis in 0..axes {
                    command.axis = axis as u32;
                    command.position = scan as i64 * 7919;
                    black_box.take(SampleRef::Command(axis, &command));
                }
                if scan.is_multiple_of(8) {
                    black_box.take(SampleRef::window(&header, &setpoints));
                }
                feedback.mode = if scan == 50_000 {
                    Mode::Tripped
                } else {
                    Mode::Enabled
                } as u32;
                black_box.take(SampleRef::Feedback(&feedback));
                slowest_us = slowest_us.max(started.elapsed().as_secs_f64() * 1e6);
            }
            let mean_us = started.elapsed().as_secs_f64() * 1e6 / (to - from) as f64;
            (mean_us, slowest_us)
        };
        run(&mut black_box, 0, 10_000);
        let (quiet_us, quiet_worst_us) = run(&mut black_box, 10_000, 50_000);
        let held = black_box.held();
        let (saving_us, saving_worst_us) = run(&mut black_box, 50_000, 52_001);
        println!(
            "{axes} axes: {quiet_us:.2} µs per scan (worst {quiet_worst_us:.0}), while saving {saving_us:.1} (worst {saving_worst_us:.0}); ring {} scans, {:.1} MB",
            held.0,
            held.1 as f64 / 1e6
        );
    }
}
