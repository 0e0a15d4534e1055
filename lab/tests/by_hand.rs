//! Motions by hand are exact: at rest the command is where it was, and the increments that were carried out, to the increment; whatever
//! comes between.

mod meanwhile;

use std::collections::BTreeMap;

use crate::common::{self, staying::Cell};
use crate::size;
use bus::sample::{
    Cause, Driver, Feedback, HandCourse, Job, MAX_AXES, Mode, OperatorRequest, Order, Refused,
};

use machine::{DriveMode, Machine, PositionFeedback};
use master::Drives;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::rng::Rng;

const SESSION: u32 = 5;

/// Shipped machines, and some that are newly written: velocity, torque and position drives, motors and scales, standbys.
fn machines() -> Vec<(&'static str, Machine, PlantFile)> {
    let mut all = Vec::new();
    for name in [
        "xy",
        "xy-fast",
        "xy-torque",
        "xyz-mill",
        "xz-lathe",
        "xzb-pivot",
    ] {
        let (machine, plant) = common::load(name);
        all.push((name, machine, plant));
    }
    let (mut machine, plant) = common::load("xy");
    machine
        .axes
        .iter_mut()
        .for_each(|axis| axis.drive_mode = DriveMode::Position);
    all.push(("xy, position drives", machine, plant));
    let (mut machine, plant) = common::load("xy");
    for axis in &mut machine.axes {
        axis.feedback = PositionFeedback::Scale;
    }
    all.push(("xy, by its scales", machine, plant));
    let (mut machine, plant) = common::load("xy");
    for axis in &mut machine.axes {
        axis.jerk_mm_s3 = Some(50_000.0);
        axis.standby = true;
    }
    all.push(("xy, with jerk and standbys", machine, plant));
    for (name, axes) in [
        (
            "gantry",
            &[
                "X:travel=0..1200,rack=2x20,ratio=10,mass=150,motors=2",
                "Y:travel=0..300,lead=10",
            ][..],
        ),
        (
            "leads 4, 5, 16",
            &[
                "X:travel=0..300,lead=16",
                "Y:travel=0..300,lead=5",
                "Z:travel=0..200,lead=4",
            ],
        ),
        ("rotary", &["X:travel=0..300,lead=10", "A:travel=-180..180"]),
    ] {
        let (machine, plant) = common::new_machine(axes);
        all.push((name, machine, plant));
    }
    all
}

/// A machine in the hand, and what it is to show.
struct Bench {
    cell: Cell,
    /// Where each axis is commanded to be at rest, in increments.
    at: [i64; MAX_AXES],
    random: Rng,
    number: u32,
    what: String,
}

/// Whether a program moves the axes.
fn is_program(now: &Feedback) -> bool {
    [Mode::Enabled, Mode::Finished]
        .map(|mode| mode as u32)
        .contains(&now.mode)
}

impl Bench {
    fn of(name: &str, machine: Machine, plant: PlantFile, seed: u64) -> Bench {
        let mut cell = Cell::new(machine, plant);
        cell.ready_and_homed();
        let mut bench = Bench {
            cell,
            at: [0; MAX_AXES],
            random: Rng::new(seed),
            number: 0,
            what: format!("{name}, seed {seed}"),
        };
        bench.look();
        bench
    }

    /// What is shown is where the axes are commanded to be from now on.
    fn look(&mut self) {
        self.at = self.cell.now.axes.map(|axis| axis.command_position);
    }

    /// One scan; the command is that of the course wherever there is one, and stands wherever there is none and no program moves it.
    fn scan(&mut self) {
        let before = self.cell.now;
        self.cell.scan();
        let now = &self.cell.now;
        assert_eq!(
            Cause::from_wire(now.cause),
            Some(Cause::None),
            "{}, scan {}, axis {}",
            self.what,
            now.scan,
            now.cause_axis
        );
        for (index, (axis, was)) in now.axes().iter().zip(before.axes()).enumerate() {
            let rests = match axis.driver == Driver::Manual as u32 {
                true => bytemuck::cast::<_, loops::hand_course::HandCourse>(axis.hand).rests(),
                false => axis.driver == Driver::Program as u32,
            };
            if axis.driver == Driver::Manual as u32 {
                let HandCourse { command, .. } = axis.hand;
                assert_eq!(
                    axis.command_position,
                    (command + 32_768).div_euclid(65_536),
                    "{}",
                    self.what
                );
            } else if axis.driver == was.driver && !is_program(now) && !is_program(&before) {
                assert_eq!(
                    axis.command_position, was.command_position,
                    "{}, scan {}",
                    self.what, now.scan
                );
            }
            if rests && now.mode == Mode::Ready as u32 {
                assert_eq!(
                    axis.command_position, self.at[index],
                    "{}, axis {index} in scan {}",
                    self.what, now.scan
                );
            }
        }
    }

    fn scans(&mut self, count: u64) {
        for _ in 0..count {
            self.scan();
        }
    }

    fn until_rest(&mut self) {
        self.scans(2);
        while matches!(self.cell.mode(), Mode::Jogging | Mode::Stopping) {
            self.scan();
            assert!(
                self.cell.now.scan < 10_000_000,
                "{}: it never rests",
                self.what
            );
        }
    }

    fn increment_mm(&self, axis: usize) -> f64 {
        self.cell.machine.axes[axis].increment_mm()
    }

    /// A numbered increment; whether it was taken, whole or in part.
    fn click(&mut self, axis: usize, way_mm: f64) -> Refused {
        self.number += 1;
        let request = OperatorRequest {
            session: SESSION,
            deadline_scans: self.number,
            latest_scan: self.cell.now.scan + 200,
            ..common::axis_order(Order::Jog, axis, way_mm)
        };
        let answer = self.cell.ask(&request);
        let reason = Refused::from_wire(answer.reason).expect("a reason");
        if reason == Refused::Not {
            let taken = (answer.jogged_mm / self.increment_mm(axis)).round() as i64;
            let asked = (way_mm / self.increment_mm(axis)).round() as i64;
            assert!(
                taken.abs() <= asked.abs() && taken.signum() == asked.signum(),
                "{taken} of {asked}"
            );
            for motor in self.motors(axis) {
                self.at[motor] += taken;
            }
            // Once more it counts for nothing.
            assert_eq!(self.cell.ask(&request).accepted, 1);
        }
        reason
    }

    /// The motors of an axis.
    fn motors(&self, axis: usize) -> Vec<usize> {
        let pair = self
            .cell
            .machine
            .gantries()
            .find(|pair| pair.leader == axis);
        let second = pair.map(|pair| pair.follower);
        [Some(axis), second].into_iter().flatten().collect()
    }

    fn way_mm(&mut self, axis: usize) -> f64 {
        let increment_mm = self.increment_mm(axis);
        let size_mm = 10f64.powf(self.random.between(-3.0, 1.0));
        let way = (size_mm / increment_mm).round() * increment_mm;
        if self.random.between(0.0, 1.0) < 0.5 {
            way
        } else {
            -way
        }
    }

    /// What the machine is commanded to be at rest after what was cut short: as it says.
    fn cut(&mut self) {
        self.until_cut();
        self.look();
    }

    fn until_cut(&mut self) {
        for _ in 0..20_000 {
            self.cell.scan();
            if !matches!(self.cell.mode(), Mode::Jogging | Mode::Stopping) {
                break;
            }
        }
        self.cell.scans(100);
    }

    /// Where the motor is from its command, at rest, in µm: by its own feedback, lost motion that is made up for taken off.
    fn off_um(&self, axis: usize) -> f64 {
        let settings = &self.cell.machine.axes[axis];
        let shown = &self.cell.now.axes[axis];
        let (measured, compensation_um) = match settings.feedback {
            PositionFeedback::Motor => (shown.motor_position, self.compensation_um(axis)),
            PositionFeedback::Scale => (shown.scale_position, 0.0),
        };
        let off = (measured - shown.command_position) as f64 * settings.increment_mm();
        off * 1e3 - compensation_um
    }

    /// Where motors and tables are from their commands at rest, and the lost motion of the axis whose table is off most, in µm. The motor is
    /// as close as it is to be, and the table anywhere in its gap.
    fn off_at_rest(&self, axes: &[usize], most_um: f64) -> (f64, f64, f64) {
        let (mut worst_um, mut table_um, mut of_um) = (0.0f64, 0.0, 0.0);
        for axis in axes {
            let (off_um, lost_um) = (self.table_off_um(*axis).abs(), self.lost_motion_um(*axis));
            assert!(
                off_um <= most_um + lost_um,
                "{}: axis {axis}: {off_um} of {lost_um} um",
                self.what
            );
            worst_um = worst_um.max(self.off_um(*axis).abs());
            if off_um > table_um {
                (table_um, of_um) = (off_um, lost_um);
            }
        }
        assert!(worst_um <= most_um, "{}: {worst_um} um", self.what);
        (worst_um, table_um, of_um)
    }

    /// Lost motion of an axis as it truly is, in µm: the gap, and what the friction of the table winds up.
    fn lost_motion_um(&self, axis: usize) -> f64 {
        let name = &self.cell.machine.axes[axis].name;
        let plant = self.cell.plant.axes.iter().find(|of| of.name == *name);
        let plant = plant.expect("its plant");
        let wound_um = 2e6 * plant.table.friction.coulomb_n / plant.screw.stiffness_n_per_m;
        plant.screw.gap_um + wound_um
    }

    /// What of it is made up for by the command of the motor.
    fn compensation_um(&self, axis: usize) -> f64 {
        let mut members = self.cell.members.iter().filter(|of| of.axis == axis);
        let said = members.find_map(|of| of.said);
        said.map_or(0.0, |said| said.compensation_mm * 1e3)
    }

    /// Where the table is from its command, in µm.
    fn table_off_um(&self, axis: usize) -> f64 {
        let samples = self.cell.master.drives().instruments(axis);
        let table_mm = samples.last().map_or(f64::NAN, |of| of.table_mm);
        let command = self.cell.now.axes[axis].command_position as f64;
        (table_mm - command * self.increment_mm(axis)) * 1e3
    }
}

/// What can come between.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Between {
    Ordered(Order),
    Trip,
    Death(Job),
    MasterDies,
}

const BETWEEN: [Between; 9] = [
    Between::Ordered(Order::Hold),
    Between::Ordered(Order::Stop),
    Between::Ordered(Order::EmergencyStop),
    Between::Ordered(Order::Disable),
    Between::Ordered(Order::Home),
    Between::Trip,
    Between::Death(Job::Servo),
    Between::Death(Job::Planner),
    Between::MasterDies,
];

fn comes_between(cell: &mut Cell, what: Between) {
    match what {
        Between::Ordered(order) => drop(cell.order(order)),
        Between::Trip => cell.trips = Some(0),
        Between::Death(job) => cell.dies(job, 0),
        Between::MasterDies => cell.replace_master(),
    }
}

/// The machine is brought to ready, whatever it was.
fn made_ready(cell: &mut Cell, what: &str) {
    let still = |of: &Cell| !matches!(of.mode(), Mode::Jogging | Mode::Stopping);
    assert!(cell.until(20_000, still), "{what}: it moves on");
    cell.scans(300);
    if matches!(cell.mode(), Mode::Tripped | Mode::Disabled) {
        assert_eq!(cell.order(Order::Enable), Refused::Not, "{what}");
        assert!(cell.until(2_000, |of| of.mode() == Mode::Ready), "{what}");
    }
    cell.order(Order::Resume);
    cell.scans(300);
    assert_eq!(cell.mode(), Mode::Ready, "{what}: {:?}", cell.cause());
}

/// Axes that an order may name.
fn jogged(machine: &Machine) -> Vec<usize> {
    let followers: Vec<usize> = machine.gantries().map(|pair| pair.follower).collect();
    (0..machine.axes.len())
        .filter(|axis| !followers.contains(axis))
        .collect()
}

fn into_the_middle(bench: &mut Bench) {
    for axis in jogged(&bench.cell.machine) {
        let settings = &bench.cell.machine.axes[axis];
        let middle_mm = f64::midpoint(settings.travel_min_mm, settings.travel_max_mm);
        let at_mm = bench.at[axis] as f64 * settings.increment_mm();
        let far_mm = (settings.travel_max_mm - settings.travel_min_mm) / 4.0;
        if (middle_mm - at_mm).abs() > far_mm {
            assert_eq!(
                bench.click(axis, middle_mm - at_mm),
                Refused::Not,
                "{}",
                bench.what
            );
            bench.until_rest();
        }
    }
}

#[test]
fn increments_of_any_size_both_ways_and_on_top_of_each_other_are_exact_on_every_machine() {
    let clicks = size::number("CLICKS", 12, 60);
    let mut turn = 0;
    for (name, machine, plant) in machines() {
        let axes = jogged(&machine);
        let mut bench = Bench::of(name, machine, plant, 11);
        into_the_middle(&mut bench);
        let (mut taken, mut not_taken) = (0, 0);
        let (mut deaths, mut between) = (0, BTreeMap::new());
        for click in 0..clicks {
            let axis = axes[bench.random.below(axes.len() as u64) as usize];
            let way_mm = bench.way_mm(axis);
            match bench.click(axis, way_mm) {
                Refused::Not => taken += 1,
                Refused::Backlog | Refused::TravelEnd => not_taken += 1,
                // Behind a program the motors are still coming to rest.
                Refused::NotAtRest => {
                    not_taken += 1;
                    bench.scans(400);
                }
                other => panic!("{}: {other:?}", bench.what),
            }
            match bench.random.below(9) {
                // The next one comes while this one is under way.
                0..3 => {
                    let scans = bench.random.below(150);
                    bench.scans(scans);
                }
                3 if click % 3 == 0 => {
                    bench.scans(40);
                    assert_eq!(bench.cell.order(Order::Hold), Refused::Not);
                    bench.cut();
                    assert_eq!(bench.cell.order(Order::Resume), Refused::Not);
                }
                4 => {
                    // The planner has no part in it; a servo with a standby is replaced by it.
                    let dies = (Job::Servo, axis);
                    let standby = bench.cell.machine.axes[axis].standby;
                    let (job, of) = if standby { dies } else { (Job::Planner, 0) };
                    bench.cell.dies(job, of);
                    deaths += 1;
                    bench.until_rest();
                }
                5 => {
                    bench.until_rest();
                    bench.scans(2_200);
                }
                6 => {
                    // Each in turn, so that the short case has all of them.
                    let what = meanwhile::ALL[turn % meanwhile::ALL.len()];
                    turn += 1;
                    bench.meanwhile(what);
                    *between.entry(format!("{what:?}")).or_insert(0) += 1;
                }
                _ => bench.until_rest(),
            }
        }
        bench.until_rest();
        bench.scans(500);
        let most_um = if name.starts_with('x') { 1.0 } else { 2.0 };
        let (worst_um, table_um, lost_um) = bench.off_at_rest(&axes, most_um);
        println!(
            "{name}: {taken} taken, {not_taken} not, {deaths} deaths; between {between:?}; motor within {worst_um:.3} um, table {table_um:.2} um with {lost_um:.2} um of lost motion"
        );
        assert!(taken > clicks / 2, "{name}");
    }
}

/// Scans after an increment until the command is there, and until the motor is within 1 µm of it from then on.
fn answers(bench: &mut Bench, axis: usize, way_mm: f64) -> [u64; 2] {
    let began = bench.cell.now.scan;
    assert_eq!(bench.click(axis, way_mm), Refused::Not, "{}", bench.what);
    let (mut there, mut within) = (None, began);
    for _ in 0..2_000 {
        bench.scan();
        let scan = bench.cell.now.scan;
        let is_there = bench.cell.now.axes[axis].command_position == bench.at[axis];
        there = there.or(is_there.then_some(scan));
        if bench.off_um(axis).abs() > 1.0 || !is_there {
            within = scan;
        }
    }
    [
        there.expect("it never comes there") - began,
        within + 1 - began,
    ]
}

#[test]
fn an_increment_of_a_micrometre_is_done_at_once_while_the_hand_is_on() {
    // Of the command, then of the motor, in ms.
    for (name, first_ms, next_ms) in [
        ("xy-fast", [120.0, 180.0], [30.0, 90.0]),
        ("xy", [150.0, 250.0], [40.0, 120.0]),
    ] {
        let (machine, plant) = common::load(name);
        let ms = machine.scan_period_s() * 1e3;
        let mut bench = Bench::of(name, machine, plant, 1);
        let [first, next, back] = [0.001, 0.001, -0.001]
            .map(|way_mm| answers(&mut bench, 0, way_mm).map(|scans| scans as f64 * ms));
        println!("{name}: first {first:?}, next {next:?}, back {back:?} ms");
        for (found, most) in [(first, first_ms), (next, next_ms), (back, next_ms)] {
            assert!(
                found[0] <= most[0] && found[1] <= most[1],
                "{name}: {found:?} ms"
            );
        }
    }
}

#[test]
fn a_wheel_that_turns_steadily_moves_its_axis_steadily_and_every_increment_counts() {
    for name in ["xy-fast", "xy"] {
        for way_mm in [0.001, 0.01, 0.1] {
            let (machine, plant) = common::load(name);
            let scan_s = machine.scan_period_s();
            let every = (0.01 / scan_s).round() as u64;
            let increment_mm = machine.axes[0].increment_mm();
            let mut bench = Bench::of(name, machine, plant, 1);
            let from = bench.at[0];
            let (mut slowest, mut fastest) = (f64::MAX, 0.0f64);
            for click in 0..1_000 {
                // Half of them back.
                let way_mm = if click < 500 { way_mm } else { -way_mm };
                assert_eq!(
                    bench.click(0, way_mm),
                    Refused::Not,
                    "{name} by {way_mm}, click {click}"
                );
                for _ in 0..every {
                    let before = bench.cell.now.axes[0].command_position;
                    bench.scan();
                    let step = bench.cell.now.axes[0].command_position - before;
                    if (100..500).contains(&click) {
                        let speed = step as f64 * increment_mm / scan_s;
                        (slowest, fastest) = (slowest.min(speed), fastest.max(speed));
                    }
                }
            }
            let last = bench.cell.now.scan;
            while bench.cell.now.axes[0].command_position != bench.at[0] {
                bench.scan();
            }
            let rests_s = (bench.cell.now.scan - last) as f64 * scan_s;
            let mean = way_mm.abs() / 0.01;
            println!(
                "{name} by {way_mm}: {slowest:.4} to {fastest:.4} of {mean} mm/s, at rest after {rests_s:.3} s"
            );
            assert!(
                slowest >= 0.8 * mean && fastest <= 1.2 * mean,
                "{name} by {way_mm}: {slowest} to {fastest}"
            );
            assert!(rests_s <= 0.25, "{name} by {way_mm}: {rests_s} s");
            assert_eq!(bench.at[0], from, "{name} by {way_mm}");
            bench.until_rest();
        }
    }
}

#[test]
fn a_key_that_repeats_never_runs_on_and_what_is_not_taken_is_said() {
    let (machine, plant) = common::load("xy");
    let mut bench = Bench::of("xy", machine, plant, 1);
    let (mut taken, mut not_taken) = (0, 0);
    for _ in 0..200 {
        match bench.click(0, 1.0) {
            Refused::Not => taken += 1,
            Refused::Backlog => not_taken += 1,
            other => panic!("{other:?}"),
        }
        bench.scans(10);
    }
    // One increment and 0.2 s at the speed of the jog, 10 mm/s.
    let left_mm = (bench.at[0] - bench.cell.now.axes[0].command_position) as f64 * 1e-6;
    assert!((0.0..=1.0 + 0.2 * 10.0).contains(&left_mm), "{left_mm}");
    assert!(
        taken >= 20 && not_taken > 50,
        "{taken} taken, {not_taken} not"
    );
    bench.until_rest();
    // A late one is not taken either.
    let request = OperatorRequest {
        session: SESSION,
        deadline_scans: 10_000,
        latest_scan: bench.cell.now.scan - 1,
        ..common::axis_order(Order::Jog, 0, 1.0)
    };
    let reason = bench.cell.ask(&request).reason;
    assert_eq!(Refused::from_wire(reason), Some(Refused::TooLate));
}

#[test]
fn axes_that_are_jogged_together_go_along_a_straight_line_whoever_misses_scans_and_where_it_is_stopped()
 {
    let all = machines()
        .into_iter()
        .filter(|(_, machine, _)| jogged(machine).len() > 1);
    for (name, machine, plant) in all {
        for (speed_mm_s, stops) in [(0.0, false), (20.0, true)] {
            let axes = jogged(&machine);
            let mut bench = Bench::of(name, machine.clone(), plant.clone(), 3);
            into_the_middle(&mut bench);
            let from = bench.at;
            let ways_mm = [24.0, -7.123_456];
            let mut request = common::axis_order(Order::Jog, 0, 0.0);
            request.speed_mm_s = speed_mm_s;
            let ways = [0, 1].map(|of| {
                let increment_mm = bench.increment_mm(axes[of]);
                request.line_mm[axes[of]] = ways_mm[of];
                let way = (ways_mm[of] / increment_mm).round() as i64;
                for motor in bench.motors(axes[of]) {
                    bench.at[motor] += way;
                }
                way as f64
            });
            assert_eq!(
                bench.cell.ask(&request).reason,
                Refused::Not as u32,
                "{name}"
            );
            let mut most = 0.0f64;
            for scan in 0..20_000 {
                if bench.random.one_in(30) {
                    bench.cell.misses = Some(axes[bench.random.below(2) as usize]);
                }
                if stops && scan == 700 {
                    assert_eq!(bench.cell.order(Order::Hold), Refused::Not);
                }
                bench.cell.scan();
                let now = &bench.cell.now;
                assert_eq!(now.cause, 0, "{name}");
                let gone =
                    [0, 1].map(|of| (now.axes[axes[of]].command_position - from[axes[of]]) as f64);
                most = most.max((gone[1] - gone[0] * ways[1] / ways[0]).abs());
                for pair in bench.cell.machine.gantries() {
                    let [leader, follower] =
                        [pair.leader, pair.follower].map(|axis| now.axes[axis].command_position);
                    assert_eq!(leader, follower, "{name}");
                }
                if scan > 2 && bench.cell.mode() == Mode::Ready {
                    break;
                }
            }
            let now = bench.cell.now.axes.map(|axis| axis.command_position);
            println!("{name}: at most {most:.2} increments beside its line");
            assert!(most <= 2.0, "{name}: {most} increments");
            assert_eq!(now == bench.at, !stops, "{name}: {now:?}");
        }
    }
}

#[test]
fn after_the_death_of_its_sender_a_held_jog_goes_no_further_than_its_deadline_and_its_braking() {
    const DEADLINE: u32 = 200;
    const SPEED_MM_S: f64 = 25.0;
    let (machine, plant) = common::load("xy");
    let scan_s = machine.scan_period_s();
    let acceleration_mm_s2 = 0.2 * machine.axes[0].acceleration_mm_s2;
    let mut bench = Bench::of("xy", machine, plant, 9);
    let mut furthest = 0.0f64;
    for death in 0..size::number("DEATHS", 12, 40) {
        let direction = if death % 2 == 0 { 1.0 } else { -1.0 };
        let on = OperatorRequest {
            speed_mm_s: SPEED_MM_S,
            session: 100 + death as u32,
            deadline_scans: DEADLINE,
            latest_scan: bench.cell.now.scan + u64::from(DEADLINE),
            ..common::axis_order(Order::JogOn, 0, direction)
        };
        assert_eq!(bench.cell.ask(&on).reason, Refused::Not as u32);
        // Renewals come late by what the network takes, and name what was seen when they were sent.
        let late = bench.random.below(100);
        let dies = bench.cell.now.scan + 100 + bench.random.below(900);
        let (mut seen_mm, mut seen) = (0.0, 0);
        let at_mm =
            |bench: &Bench| bench.cell.now.axes[0].command_position as f64 * bench.increment_mm(0);
        while bench.cell.now.scan < dies {
            if bench.cell.now.scan.is_multiple_of(50) {
                (seen_mm, seen) = (at_mm(&bench), bench.cell.now.scan);
                for _ in 0..late {
                    bench.cell.scan();
                }
                let renewed = OperatorRequest {
                    order: Order::JogRenew as u32,
                    latest_scan: seen + u64::from(DEADLINE),
                    ..on
                };
                assert_eq!(bench.cell.ask(&renewed).reason, Refused::Not as u32);
            }
            bench.cell.scan();
        }
        if seen == 0 {
            continue;
        }
        bench.until_cut();
        let ahead = bench.cell.members[0]
            .said
            .map_or(0, |said| said.ahead_scans);
        let time_s = f64::from(DEADLINE + ahead + 4) * scan_s;
        let most_mm = SPEED_MM_S * time_s + SPEED_MM_S * SPEED_MM_S / (2.0 * acceleration_mm_s2);
        let way_mm = (at_mm(&bench) - seen_mm).abs();
        furthest = furthest.max(way_mm / most_mm);
        assert!(way_mm <= most_mm, "death {death}: {way_mm} of {most_mm} mm");
    }
    println!("at most {furthest:.4} of the way that the formula has");
    assert!(furthest > 0.9);
}

#[test]
fn whatever_comes_in_whatever_step_of_a_jog_the_next_one_is_exact_again() {
    let (mut machine, plant) = common::load("xy");
    machine.axes[0].standby = true;
    let standby = Cell::new(machine, plant);
    let (machine, plant) = common::load("xy");
    let (gantry, of_gantry) = common::new_machine(&[
        "X:travel=0..300,lead=10,motors=2",
        "Y:travel=0..300,lead=10",
    ]);
    let cells = [
        ("with a standby", standby),
        ("alone", Cell::new(machine, plant)),
        ("gantry", Cell::new(gantry, of_gantry)),
    ];
    // Settling, the change to come, under way, braking, settling again, in the hand, out of it.
    let moments: &[u64] = match size::is_full() {
        false => &[0, 30, 66, 75, 250, 340, 2_600],
        true => &[0, 1, 30, 62, 66, 69, 75, 120, 250, 290, 340, 900, 2_600],
    };
    let each = |moment: &u64| BETWEEN.map(|between| (*moment, between));
    // Each of what can come, in different moments.
    let cases = size::one_in(7, moments.iter().flat_map(each));
    let mut count = 0;
    for (name, mut cell) in cells {
        cell.scans(5);
        cell.ready();
        let centre = cell.now.axes.map(|axis| axis.command_position);
        let inwards = if centre[0] * 2 > 300_000_000 {
            -1.0
        } else {
            1.0
        };
        let line = {
            let mut line = common::axis_order(Order::Jog, 0, 0.0);
            (line.line_mm[0], line.line_mm[1]) = (2.0 * inwards, 1.0);
            line
        };
        let held = OperatorRequest {
            session: 3,
            deadline_scans: 150,
            ..common::axis_order(Order::JogOn, 0, inwards)
        };
        for asked in [common::axis_order(Order::Jog, 0, 2.0 * inwards), held, line] {
            for &(moment, between) in &cases {
                let what = format!(
                    "{name}: order {} by {}, {between:?} after {moment} scans",
                    asked.order, asked.value
                );
                let mut cell = cell.clone();
                assert_eq!(cell.ask(&asked).reason, Refused::Not as u32, "{what}");
                cell.scans(moment);
                // The second time as well.
                for _ in 0..2 {
                    comes_between(&mut cell, between);
                    made_ready(&mut cell, &what);
                    let from = cell.now.axes.map(|axis| axis.command_position);
                    let again = common::axis_order(Order::Jog, 0, 0.5 * inwards);
                    assert_eq!(cell.ask(&again).reason, Refused::Not as u32, "{what}");
                    cell.scans(2);
                    assert!(cell.until(5_000, |of| of.mode() != Mode::Jogging), "{what}");
                    let now = cell.now.axes.map(|axis| axis.command_position);
                    let increments =
                        (0.5 * inwards / cell.machine.axes[0].increment_mm()).round() as i64;
                    assert_eq!(now[0] - from[0], increments, "{what}: {:?}", cell.cause());
                    assert_eq!(now[1], from[1], "{what}");
                    assert_eq!(cell.mode(), Mode::Ready, "{what}");
                    count += 1;
                    cell.ask(&asked);
                    cell.scans(moment);
                }
            }
        }
    }
    println!("{count} interruptions");
}
