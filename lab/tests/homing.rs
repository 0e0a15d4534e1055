//! Axes without absolute encoders: homed from anywhere to the same place, whoever is killed meanwhile; and what an axis may do before.

use std::path::Path;

use bus::sample::{Cause, Feedback, Mode, OperatorRequest, Order, Reference, Refused};
use lab::cell::{InProcessCell, Script};
use machine::{DriveMode, HomingMethod, Machine};
use plant_sim::plant_file::{Actuated, PlantDriveHoming, PlantEncoder, PlantFile, PlantHomeSwitch};
use plant_sim::script::faults;
use plant_sim::script::rng::Rng;

const PROGRAM: &str = "G21 G90 G17\nG1 X5 Y5 F3000\nG3 X0 Y10 I-5 J0\nG1 X0 Y0\nM2\n";
/// True place of the switch of X, and of one of its indices.
const SWITCH_MM: f64 = -8.0;
const INDEX_MM: f64 = -5.5;
/// Position that the machine has at the index behind the switch.
const POSITION_MM: f64 = -9.25;
const INPUT: u32 = 3;
/// Place of the index behind the switch: the next one towards lower positions.
const REFERENCE_MM: f64 = INDEX_MM - 10.0;

fn folder() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy")
}

/// The machine of two slides, whose X has to be homed by a method.
fn machine(method: HomingMethod) -> Machine {
    let text = std::fs::read_to_string(folder().join("machine.toml")).expect("machine.toml");
    let word = match method {
        HomingMethod::Switch => "\"switch\"\nswitch_input = 3",
        HomingMethod::SwitchIndex => "\"switch-index\"\nswitch_input = 3",
        HomingMethod::Index => "\"index\"",
        HomingMethod::Drive => "\"drive\"",
    };
    let table = format!(
        "[axis.homing]\nmethod = {word}\nsearch_mm_s = 40\nlatch_mm_s = 5\nposition_mm = {POSITION_MM}\n\
         search_distance_mm = 60\n\n[axis.motor]"
    );
    let text = text.replacen("[axis.motor]", &table, 1);
    let text = text.replacen(
        "name = \"xy\"",
        "name = \"xy\"\n\n[manual]\njog_mm_s = 60",
        1,
    );
    Machine::parse("machine.toml", &text).expect("a machine")
}

/// The plant of it, whose X stands at a place and whose encoder shows another.
fn plant(start_mm: f64, shows_mm: f64) -> PlantFile {
    let mut plant = PlantFile::load(&folder()).expect("plant.toml");
    let x = &mut plant.axes[0];
    x.start_position_mm = start_mm;
    x.encoder = Some(PlantEncoder {
        shows_mm,
        index_at_mm: INDEX_MM,
    });
    x.drive_homing = Some(PlantDriveHoming {
        speed_mm_s: -30.0,
        switch_at_mm: SWITCH_MM,
        position_mm: POSITION_MM,
    });
    x.home_switch = Some(PlantHomeSwitch {
        digital: INPUT,
        at_mm: SWITCH_MM,
        actuated: Actuated::Below,
        normally_closed: false,
        hysteresis_um: 20.0,
        scatter_um: 30.0,
        seed: 9,
    });
    plant
}

struct Bench {
    cell: InProcessCell,
    machine: Machine,
    now: Feedback,
    /// True place of the motor that the feedback shows, and where it is now, in mm.
    motor_mm: [f64; 2],
}

impl Bench {
    fn with(machine: Machine, plant: &PlantFile, script: Script) -> Bench {
        let program = ("program.ngc", PROGRAM);
        let cell = InProcessCell::with_script(&machine, plant, program, script);
        let mut bench = Bench {
            cell: cell.expect("a cell"),
            machine,
            now: bytemuck::Zeroable::zeroed(),
            motor_mm: [0.0; 2],
        };
        bench.scan();
        bench
    }

    /// At a place, showing another.
    fn of(method: HomingMethod, start_mm: f64, shows_mm: f64) -> Bench {
        let plant = plant(start_mm, shows_mm);
        Bench::with(machine(method), &plant, Script::default())
    }

    fn scan(&mut self) -> bool {
        let published = self.cell.scan();
        if let Some(published) = &published {
            self.now = *published.feedback;
            let last = published.instruments.subsamples as usize - 1;
            let now_mm = published.instruments.axes[0].motor_mm[last];
            self.motor_mm = [self.motor_mm[1], now_mm];
        }
        published.is_some()
    }

    fn scans(&mut self, count: u64) {
        for _ in 0..count {
            assert!(
                self.scan(),
                "the run has ended in scan {}: {:?} of {} in {}",
                self.now.scan,
                Cause::from_wire(self.now.cause),
                self.now.cause_axis,
                self.now.cause_scan
            );
        }
    }

    fn order(&mut self, order: Order, axis: u32, value: f64) -> Refused {
        let request = OperatorRequest {
            order: order as u32,
            axis,
            value,
            ..OperatorRequest::default()
        };
        Refused::from_wire(self.cell.order(&request).reason).expect("a reason")
    }

    /// Waits until the machine is at rest, as an order wants it.
    fn rest(&mut self) {
        self.scans(200);
    }

    fn mode(&self) -> Mode {
        Mode::from_wire(self.now.mode).expect("a mode")
    }

    fn reference(&self) -> Reference {
        Reference::from_wire(self.now.axes[0].reference).expect("a state")
    }

    fn cause(&self) -> Cause {
        Cause::from_wire(self.now.cause).expect("a cause")
    }

    /// Goes on until the axes move no more by hand; the highest speed on the way, in mm/s.
    fn until_still(&mut self) -> f64 {
        self.scans(2);
        let mut fastest_mm_s = 0.0f64;
        while self.mode() == Mode::Jogging {
            fastest_mm_s = fastest_mm_s.max(self.now.axes[0].velocity_command_mm_s.abs());
            self.scans(1);
            assert!(self.now.scan < 200_000, "it never ends");
        }
        fastest_mm_s
    }

    fn home(&mut self) {
        self.rest();
        assert_eq!(self.order(Order::Home, 0, 0.0), Refused::Not);
        self.until_still();
    }

    fn jog(&mut self, distance_mm: f64) -> f64 {
        self.rest();
        assert_eq!(self.order(Order::Jog, 0, distance_mm), Refused::Not);
        self.until_still()
    }

    /// Goes on to the end of the run.
    fn finish(&mut self) {
        while self.scan() {
            assert!(self.now.scan < 400_000, "the run never ends");
        }
    }

    fn shown_mm(&self) -> f64 {
        self.now.axes[0].motor_position as f64 * self.machine.axes[0].increment_mm()
    }

    /// True place of the count that the encoder shows, less the position of the machine: where its zero is, in mm.
    fn zero_mm(&self) -> f64 {
        (self.motor_mm[0] / COUNT_MM).floor() * COUNT_MM - self.shown_mm()
    }

    fn assert_homed(&self, what: &str) {
        let found = (self.reference(), self.cause());
        assert_eq!(found, (Reference::Known, Cause::None), "{what}");
    }
}

/// One count of the encoder.
const COUNT_MM: f64 = 10.0 / 1_048_576.0;
/// In this scan of a run with a kill it is homed, and on its way to where it is to stand.
const HOMED_BY: u64 = 2_300;
/// One increment of the machine, and what adding numbers makes of it.
const INCREMENT_MM: f64 = 1.001e-6;

/// Zeros of so many starts from anywhere: the lowest and the highest.
fn zeros(method: HomingMethod, starts: u32) -> (f64, f64) {
    let mut random = Rng::new(5);
    let mut all = (f64::MAX, f64::MIN);
    for start in 0..starts {
        let start_mm = random.between(-14.0, 4.0);
        let shows_mm = random.between(-500.0, 500.0);
        let mut plant = plant(start_mm, shows_mm);
        if let Some(switch) = &mut plant.axes[0].home_switch {
            switch.seed = u64::from(start);
        }
        let mut bench = Bench::with(machine(method), &plant, Script::default());
        bench.home();
        bench.assert_homed(&format!("start {start} at {start_mm} showing {shows_mm}"));
        bench.rest();
        let zero_mm = bench.zero_mm();
        all = (all.0.min(zero_mm), all.1.max(zero_mm));
    }
    all
}

#[test]
fn a_hundred_starts_from_anywhere_find_the_same_zero_within_one_increment() {
    let (low_mm, high_mm) = zeros(HomingMethod::SwitchIndex, 100);
    println!("zeros from {low_mm} to {high_mm} mm");
    // Place of the index, which is a whole count, less the position that the machine has there.
    let zero_mm = (REFERENCE_MM / COUNT_MM).round() * COUNT_MM - POSITION_MM;
    for found_mm in [low_mm, high_mm] {
        let off_mm = found_mm - zero_mm;
        assert!(off_mm.abs() <= INCREMENT_MM, "{off_mm} mm off {zero_mm}");
    }
}

#[test]
fn without_the_index_the_zero_is_as_exact_as_the_switch() {
    let (low_mm, high_mm) = zeros(HomingMethod::Switch, 20);
    println!("zeros from {low_mm} to {high_mm} mm");
    let zero_mm = SWITCH_MM - POSITION_MM;
    // 30 µm of the switch to either side, 5 µm in a scan, the screw's lost motion and its wind-up.
    let off_mm = (low_mm - zero_mm).abs().max((high_mm - zero_mm).abs());
    assert!(off_mm <= 0.030 + 0.005 + 0.010, "{low_mm} to {high_mm}");
    assert!(high_mm - low_mm > 0.010, "{low_mm} to {high_mm}");
}

#[test]
fn by_the_index_alone_and_by_a_drive_that_homes_by_itself_it_is_where_they_say() {
    let mut bench = Bench::of(HomingMethod::Index, 1.0, 77.0);
    bench.home();
    bench.assert_homed("by the index");
    bench.rest();
    let off_mm = bench.zero_mm() - (INDEX_MM - POSITION_MM);
    assert!(off_mm.abs() <= COUNT_MM, "{off_mm}");
    // In front of its switch, and on it.
    for start_mm in [-1.0, -20.0] {
        let mut bench = Bench::of(HomingMethod::Drive, start_mm, 77.0);
        assert_eq!(bench.reference(), Reference::Missing);
        bench.home();
        bench.assert_homed("by the drive");
        bench.rest();
        let off_mm = bench.zero_mm() - (SWITCH_MM - POSITION_MM);
        assert!(off_mm.abs() <= COUNT_MM, "{start_mm}: {off_mm}");
    }
}

#[test]
fn before_it_is_homed_no_program_starts_and_jogs_are_slow_and_know_no_travel() {
    let mut bench = Bench::of(HomingMethod::SwitchIndex, 0.0, 5_000.0);
    assert_eq!((bench.mode(), bench.now.hold), (Mode::Enabled, 1));
    assert_eq!(bench.order(Order::Resume, 0, 0.0), Refused::NotReferenced);
    let fastest_mm_s = bench.jog(6.0);
    assert!((39.0..42.0).contains(&fastest_mm_s), "{fastest_mm_s}");
    assert!((bench.shown_mm() - 5_006.0).abs() < 0.02);
    bench.rest();
    assert_eq!(bench.order(Order::Jog, 0, 441.0), Refused::BeyondTravel);
    assert_eq!(bench.order(Order::Home, 0, 2.0), Refused::Absolute);
    assert_eq!(bench.order(Order::Home, 0, 4.0), Refused::UnknownAxis);
    assert_eq!(bench.order(Order::Home, 0, 0.5), Refused::BadValue);
    bench.home();
    bench.assert_homed("after a jog");
    // The travel counts from now on, and jogs are as fast as they are.
    bench.rest();
    assert_eq!(bench.order(Order::Jog, 0, -245.0), Refused::BeyondTravel);
    let fastest_mm_s = bench.jog(10.0);
    assert!((59.0..63.0).contains(&fastest_mm_s), "{fastest_mm_s}");
    // And the program runs, which nobody may home any more.
    assert_eq!(bench.order(Order::Resume, 0, 0.0), Refused::Not);
    bench.scans(500);
    assert_eq!(bench.order(Order::Hold, 0, 0.0), Refused::Not);
    bench.scans(500);
    assert_eq!(bench.order(Order::Home, 0, 0.0), Refused::Running);
    assert_eq!(bench.order(Order::Resume, 0, 0.0), Refused::Not);
    bench.finish();
    assert_eq!(bench.mode(), Mode::Finished);
    let zero_mm = REFERENCE_MM - POSITION_MM;
    assert!(
        (bench.motor_mm[1] - zero_mm).abs() < 0.02,
        "{:?}",
        bench.motor_mm
    );
}

#[test]
fn a_search_that_finds_nothing_stops_with_its_cause_and_can_be_ordered_again() {
    let mut plant = plant(0.0, 0.0);
    if let Some(switch) = &mut plant.axes[0].home_switch {
        switch.at_mm = -100.0;
    }
    let of_switch = machine(HomingMethod::SwitchIndex);
    let mut bench = Bench::with(of_switch, &plant, Script::default());
    for _ in 0..2 {
        let before_mm = bench.motor_mm[1];
        bench.home();
        let found = (bench.mode(), bench.reference(), bench.cause());
        let none = (Mode::Enabled, Reference::Missing, Cause::HomeSwitch);
        assert_eq!(found, none);
        assert_eq!(bench.now.cause_axis, 0);
        let way_mm = before_mm - bench.motor_mm[1];
        assert!((59.9..60.1).contains(&way_mm), "{way_mm}");
        assert_eq!(bench.order(Order::Resume, 0, 0.0), Refused::NotReferenced);
        // On the second search it meets the switch, and its limit before: 0, -60, -120.
        if let Some(switch) = &mut plant.axes[0].home_switch {
            switch.at_mm = -200.0;
        }
        bench.jog(60.0);
    }
    let mut short = machine(HomingMethod::Index);
    let homing = short.axes[0].homing.as_mut().expect("homing");
    homing.search_distance_mm = Some(2.0);
    let mut bench = Bench::with(short, &plant, Script::default());
    bench.home();
    let found = (bench.mode(), bench.reference(), bench.cause());
    assert_eq!(found, (Mode::Enabled, Reference::Missing, Cause::HomeIndex));
    // A drive that takes too long.
    let mut hasty = machine(HomingMethod::Drive);
    hasty.axes[0].homing.as_mut().expect("homing").patience_s = 0.1;
    let mut bench = Bench::with(hasty, &plant, Script::default());
    bench.home();
    let found = (bench.mode(), bench.reference(), bench.cause());
    assert_eq!(found, (Mode::Tripped, Reference::Missing, Cause::HomeDrive));
}

#[test]
fn homing_that_is_held_ends_at_rest_not_homed_wherever_it_was() {
    let methods = [HomingMethod::SwitchIndex, HomingMethod::Drive];
    for (method, after) in methods
        .into_iter()
        .flat_map(|m| (1..12).map(move |n| (m, n)))
    {
        let mut bench = Bench::of(method, 0.0, 12.0);
        bench.rest();
        assert_eq!(bench.order(Order::Home, 0, 0.0), Refused::Not);
        bench.scans(after * 60);
        if bench.mode() != Mode::Jogging {
            continue;
        }
        assert_eq!(bench.order(Order::Hold, 0, 0.0), Refused::Not);
        bench.until_still();
        bench.scans(50);
        let found = (bench.mode(), bench.reference(), bench.cause());
        assert!(bench.now.axes[0].velocity_mm_s.abs() < 0.5);
        if method == HomingMethod::Drive && bench.reference() == Reference::Known {
            // It had found its place, and says so.
            continue;
        }
        let still = (Mode::Enabled, Reference::Missing, Cause::None);
        assert_eq!(found, still, "{method:?} after {after}");
        bench.home();
        bench.assert_homed(&format!("{method:?} held after {after}"));
    }
}

#[test]
fn drives_in_torque_mode_and_drives_with_a_dead_time_are_homed_alike() {
    let zero_mm = REFERENCE_MM - POSITION_MM;
    for (torque, dead_time_scans) in [(true, 1), (false, 3)] {
        let mut machine = machine(HomingMethod::SwitchIndex);
        let mut plant = plant(0.0, 123.0);
        if torque {
            for axis in &mut machine.axes {
                axis.drive_mode = DriveMode::Torque;
                axis.velocity_loop.period_us = machine.scan.period_us;
                // The loop is closed once a scan, and is slower for it.
                axis.velocity_loop.gain_n_s_per_m *= 0.5;
                axis.position_loop.gain_per_s *= 0.5;
                axis.torque_feed_forward.friction = false;
            }
        }
        machine.scan.dead_time_scans = dead_time_scans;
        machine.scan.look_ahead_periods = 2;
        plant.drive.dead_time_scans = dead_time_scans;
        let mut bench = Bench::with(machine, &plant, Script::default());
        bench.home();
        bench.assert_homed(&format!("torque {torque}, {dead_time_scans} scans"));
        bench.scans(1_000);
        assert_eq!(bench.mode(), Mode::Enabled);
        let off_mm = bench.zero_mm() - zero_mm;
        assert!(off_mm.abs() <= 2.0 * COUNT_MM, "{torque}: {off_mm}");
    }
}

#[test]
fn a_standby_goes_on_with_homing_where_the_other_servo_was_killed() {
    for scan in [260, 400, 900, 1_500, 2_200, 2_500] {
        let mut machine = machine(HomingMethod::SwitchIndex);
        machine.axes[0].standby = true;
        let text = format!(
            "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"servo-X/a\"\ndo = \"kill\"\n"
        );
        let faults = faults::parse("faults.toml", &text, &machine).expect("a script");
        let script = Script {
            faults: Some(faults),
            ..Script::default()
        };
        let mut bench = Bench::with(machine, &plant(0.0, -321.0), script);
        bench.home();
        bench.assert_homed(&format!("killed in scan {scan}"));
        assert!(bench.now.scan > scan && bench.now.axes[0].taken_role == 1);
    }
}

/// A run in which a process is killed in a scan, and another one takes its place.
fn killed(process: &str, scan: u64) -> Bench {
    let machine = machine(HomingMethod::SwitchIndex);
    let text = format!(
        "[restart]\nplanner = \"resume\"\nservo = \"wait\"\nmaster = \"wait\"\n\
         [[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{process}\"\ndo = \"kill\"\n"
    );
    let faults = faults::parse("faults.toml", &text, &machine).expect("a script");
    let script = Script {
        faults: Some(faults),
        ..Script::default()
    };
    Bench::with(machine, &plant(0.0, -321.0), script)
}

#[test]
fn a_kill_while_it_homes_ends_at_rest_and_homing_can_be_ordered_again() {
    let zero_mm = REFERENCE_MM - POSITION_MM;
    for process in ["planner", "servo-X", "servo-Y", "plant-sim"] {
        // The motions begin in scan 201 and take three seconds; then the axis is homed, and goes to where it is to stand.
        for scan in [205, 260, 400, 900, 1_500, 2_200, 2_500] {
            let what = format!("{process} killed in scan {scan}");
            let mut bench = killed(process, scan);
            bench.rest();
            assert_eq!(bench.order(Order::Home, 0, 0.0), Refused::Not, "{what}");
            bench.until_still();
            if bench.now.scan < scan {
                // It was homed before.
                continue;
            }
            bench.scans(300);
            assert!(bench.now.axes[0].velocity_mm_s.abs() < 0.5, "{what}");
            if process == "planner" {
                bench.assert_homed(&what);
            } else {
                let homed = scan >= HOMED_BY;
                assert_eq!(bench.reference() == Reference::Known, homed, "{what}");
                let mode = if process == "plant-sim" {
                    Mode::Disabled
                } else {
                    Mode::Tripped
                };
                assert_eq!(bench.mode(), mode, "{what}");
                assert_eq!(bench.order(Order::Enable, 0, 0.0), Refused::Not, "{what}");
                if !homed {
                    bench.home();
                    bench.assert_homed(&what);
                }
            }
            bench.rest();
            let off_mm = bench.zero_mm() - zero_mm;
            assert!(off_mm.abs() <= COUNT_MM, "{what}: {off_mm}");
        }
    }
}

#[test]
fn an_axis_that_is_homed_stays_so_whoever_is_killed() {
    let zero_mm = REFERENCE_MM - POSITION_MM;
    for process in ["planner", "servo-X", "plant-sim"] {
        // In the scan that says first that it is homed, behind it, at rest, and while the program runs.
        let mut bench = killed(process, 100_000);
        bench.home();
        let homed = bench.now.scan;
        for scan in [homed, homed + 1, homed + 100, homed + 900] {
            let what = format!("{process} killed in scan {scan}, homed in {homed}");
            let mut bench = killed(process, scan);
            bench.home();
            bench.rest();
            assert_eq!(bench.now.axes[0].reference, 0, "{what}");
            let off_mm = bench.zero_mm() - zero_mm;
            assert!(off_mm.abs() <= COUNT_MM, "{what}: {off_mm}");
            let needed = bench.mode() != Mode::Enabled;
            if needed {
                assert_eq!(bench.order(Order::Enable, 0, 0.0), Refused::Not, "{what}");
                bench.rest();
            }
            assert_eq!(bench.order(Order::Resume, 0, 0.0), Refused::Not, "{what}");
            while bench.scan() {
                let stands = matches!(bench.mode(), Mode::Disabled | Mode::Tripped);
                if stands && bench.now.scan > scan + 400 {
                    assert_eq!(bench.order(Order::Enable, 0, 0.0), Refused::Not, "{what}");
                    assert_eq!(bench.order(Order::Resume, 0, 0.0), Refused::Not, "{what}");
                }
                assert!(bench.now.scan < 100_000, "{what}: the run never ends");
            }
            assert_eq!(bench.mode(), Mode::Finished, "{what}");
            let end_mm = bench.motor_mm[1] - zero_mm;
            assert!(end_mm.abs() < 0.02, "{what}: {end_mm}");
        }
    }
}
