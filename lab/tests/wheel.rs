//! An axis follows the running count of a wheel: what was counted is where it stands, whatever comes twice, late, or not at all.

use crate::common::{self, staying::Cell};
use crate::size;
use bus::sample::{Cause, Job, MAX_AXES, Mode, OperatorRequest, OperatorResponse, Order, Refused};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::rng::Rng;

const SESSION: u32 = 40;
/// Speed of a jog, as no machine file says otherwise.
const JOG_MM_S: f64 = 10.0;

/// Both modes of an axis.
const MODES: [u32; 2] = [0, 1];

/// A cell, and a wheel for each axis.
struct Bench {
    cell: Cell,
    /// What each wheel shows.
    count: [i32; MAX_AXES],
    /// Where each axis is to stand, in increments.
    at: [i64; MAX_AXES],
    per_count_mm: f64,
    velocity_mode: u32,
    what: String,
}

impl Bench {
    fn of(
        name: &str,
        (machine, plant): (Machine, PlantFile),
        per_count_mm: f64,
        velocity_mode: u32,
    ) -> Bench {
        let mut cell = Cell::new(machine, plant);
        cell.ready_in_the_middle();
        let mut bench = Bench {
            at: cell.now.axes.map(|axis| axis.command_position),
            cell,
            count: [i32::MAX - 3; MAX_AXES],
            per_count_mm,
            velocity_mode,
            what: format!("{name}, {per_count_mm} mm, mode {velocity_mode}"),
        };
        for axis in 0..2 {
            bench.tell(axis);
        }
        bench
    }

    fn request(&self, axis: usize) -> OperatorRequest {
        OperatorRequest {
            order: Order::Wheel as u32,
            axis: axis as u32,
            value: self.per_count_mm,
            session: SESSION + axis as u32,
            count: self.count[axis],
            velocity_mode: self.velocity_mode,
            latest_scan: self.cell.now.scan + 200,
            ..OperatorRequest::default()
        }
    }

    /// The count that its wheel shows is told; what was taken of it is where the axis is to stand.
    fn tell(&mut self, axis: usize) -> OperatorResponse {
        let request = self.request(axis);
        self.tell_so(axis, &request)
    }

    fn tell_so(&mut self, axis: usize, request: &OperatorRequest) -> OperatorResponse {
        let answer = self.cell.ask(request);
        let increment_mm = self.cell.machine.axes[axis].increment_mm();
        let way = (request.value / increment_mm).round() as i64 * i64::from(answer.counts);
        assert_eq!((answer.jogged_mm / increment_mm).round() as i64, way);
        self.at[axis] += way;
        answer
    }

    fn turn(&mut self, axis: usize, counts: i32) -> OperatorResponse {
        self.count[axis] = self.count[axis].wrapping_add(counts);
        self.tell(axis)
    }

    /// It is turned, and told, and all of it is taken.
    fn turn_all(&mut self, axis: usize, counts: i32) {
        let answer = self.turn(axis, counts);
        let what = &self.what;
        assert_eq!(
            Refused::from_wire(answer.reason),
            Some(Refused::Not),
            "{what}"
        );
        assert_eq!(answer.counts, counts, "{what}");
    }

    fn scan(&mut self) {
        self.cell.scan();
        assert_eq!(self.cell.cause(), Cause::None, "{}", self.what);
        for pair in self.cell.machine.gantries() {
            let [leader, follower] =
                [pair.leader, pair.follower].map(|of| self.cell.now.axes[of].command_position);
            assert_eq!(leader, follower, "{}", self.what);
        }
    }

    fn scans(&mut self, count: u64) {
        for _ in 0..count {
            self.scan();
        }
    }

    fn command(&self, axis: usize) -> i64 {
        self.cell.now.axes[axis].command_position
    }

    /// At rest, the axes stand where their wheels say.
    fn rests_where_it_was_counted(&mut self) {
        self.scans(2);
        for _ in 0..20_000 {
            if self.cell.mode() != Mode::Jogging {
                break;
            }
            self.scan();
        }
        for axis in 0..2 {
            assert_eq!(
                self.command(axis),
                self.at[axis],
                "{}, axis {axis}",
                self.what
            );
        }
    }

    fn scans_in(&self, time_s: f64) -> u64 {
        (time_s / self.cell.machine.scan_period_s()).round() as u64
    }
}

fn gantry() -> (Machine, PlantFile) {
    common::new_machine(&[
        "X:travel=0..600,lead=10,motors=2,encoder=incremental",
        "Y:travel=0..300,lead=10",
    ])
}

/// Slowest and fastest step of a scan of an axis, in mm/s, while wheels turn by so many counts every so many seconds; one that turns
/// back ends where it began.
fn turned_steadily(bench: &mut Bench, axes: &[usize], counts: i32, every_s: f64) -> (f64, f64) {
    let every = bench.scans_in(every_s);
    let scan_s = bench.cell.machine.scan_period_s();
    let (mut slowest, mut fastest) = (f64::MAX, 0.0f64);
    for turn in 0..200 {
        let counts = if turn < 100 { counts } else { -counts };
        for axis in axes {
            bench.turn_all(*axis, counts);
        }
        for _ in 0..every {
            let before = bench.cell.now;
            bench.scan();
            for axis in axes.iter().filter(|_| (25..100).contains(&turn)) {
                let step = bench.command(*axis) - before.axes[*axis].command_position;
                let increment_mm = bench.cell.machine.axes[*axis].increment_mm();
                let speed_mm_s = step as f64 * increment_mm / scan_s;
                (slowest, fastest) = (slowest.min(speed_mm_s), fastest.max(speed_mm_s));
            }
        }
    }
    (slowest, fastest)
}

#[test]
fn a_wheel_that_turns_steadily_moves_its_axis_steadily_in_both_modes_on_every_machine() {
    let machines: [(&str, (Machine, PlantFile)); 5] = [
        ("xy-fast", common::load("xy-fast")),
        ("xy", common::load("xy")),
        ("xyz-mill", common::load("xyz-mill")),
        ("gantry", gantry()),
        (
            "rotary",
            common::new_machine(&["X:travel=0..300,lead=10", "A:travel=-180..180"]),
        ),
    ];
    // Counts of a message, and the time between two of them.
    let turns = [
        (0.001, 1, 0.01),
        (0.01, 3, 0.01),
        (0.01, 8, 0.02),
        (0.01, 20, 0.05),
    ];
    let each = |(name, machine)| {
        let modes = MODES
            .into_iter()
            .flat_map(move |mode| turns.map(|turn| (mode, turn)));
        let with = move |(mode, turn)| (name, <(Machine, PlantFile)>::clone(&machine), mode, turn);
        modes.map(with)
    };
    for (name, machine, velocity_mode, (per_count_mm, counts, every_s)) in
        size::one_in(5, machines.into_iter().flat_map(each))
    {
        let mut bench = Bench::of(name, machine, per_count_mm, velocity_mode);
        let found = turned_steadily(&mut bench, &[0, 1], counts, every_s);
        let mean = per_count_mm * f64::from(counts) / every_s;
        let what = format!("{}, {counts} in {every_s} s", bench.what);
        println!("{what}: {:.4} to {:.4} of {mean:.4} mm/s", found.0, found.1);
        assert!(
            found.0 >= 0.8 * mean && found.1 <= 1.2 * mean,
            "{what}: {found:?} of {mean} mm/s"
        );
        bench.rests_where_it_was_counted();
    }
}

#[test]
fn a_wheel_that_turns_too_fast_never_runs_on_and_what_is_not_taken_never_catches_up() {
    for name in ["xy", "xy-fast"] {
        // Where every count is travelled, one count and 0.2 s; else the braking and what counts are spread over.
        for (velocity_mode, most_s) in [(0, 0.2), (1, 0.065)] {
            let mut bench = Bench::of(name, common::load(name), 0.1, velocity_mode);
            let (mut taken, mut turned) = (0, 0);
            let increment_mm = bench.cell.machine.axes[0].increment_mm();
            for turn in 0..150 {
                let answer = bench.turn(0, -10);
                let is_judged = [Refused::Not as u32, Refused::Backlog as u32];
                assert!(is_judged.contains(&answer.reason), "{}", bench.what);
                assert!((-10..=0).contains(&answer.counts), "{}", bench.what);
                (taken, turned) = (taken - answer.counts, turned + 10);
                let left_mm = (bench.command(0) - bench.at[0]) as f64 * increment_mm;
                let most_mm = if turn > 20 {
                    0.1 + most_s * JOG_MM_S
                } else {
                    2.1
                };
                assert!(left_mm <= most_mm + 1e-9, "{}: {left_mm} mm", bench.what);
                bench.scans(20);
            }
            let ended = bench.cell.now.scan;
            bench.rests_where_it_was_counted();
            let rests_s = (bench.cell.now.scan - ended) as f64 * bench.cell.machine.scan_period_s();
            println!(
                "{}: {taken} of {turned}, at rest after {rests_s:.3} s",
                bench.what
            );
            // As many as the axis can go in that time, and what is left to go at the end.
            let counts = 3_000.0 * bench.cell.machine.scan_period_s() * JOG_MM_S / 0.1;
            let is_most = (0.8 * counts..counts + 25.0).contains(&f64::from(taken));
            assert!(is_most, "{}: {taken} of {counts}", bench.what);
            let at = bench.at[0];
            bench.turn_all(0, 1);
            bench.rests_where_it_was_counted();
            assert_eq!(
                bench.at[0] - at,
                (0.1 / increment_mm).round() as i64,
                "{}",
                bench.what
            );
        }
    }
}

#[test]
fn a_count_that_jumps_moves_the_axis_by_one_count_and_a_fifth_of_a_second_at_most() {
    for velocity_mode in MODES {
        let mut bench = Bench::of("xy", common::load("xy"), 0.1, velocity_mode);
        for jump in [5_000, -100_000, i32::MIN] {
            let answer = bench.turn(0, jump);
            assert_eq!(answer.counts.abs(), 21, "{} by {jump}", bench.what);
            bench.rests_where_it_was_counted();
        }
    }
}

#[test]
fn counts_that_come_twice_too_late_or_not_at_all_cost_nothing_and_the_largest_is_followed_by_the_smallest()
 {
    for velocity_mode in MODES {
        for seed in 0..size::number("SEEDS", 2, 6) {
            let mut random = Rng::new(seed);
            let mut bench = Bench::of("xy", common::load("xy"), 0.01, velocity_mode);
            bench.what = format!("{}, seed {seed}", bench.what);
            let from = bench.at;
            let mut turned = [0i64; 2];
            let mut earlier = bench.request(0);
            for _ in 0..300 {
                let axis = random.below(2) as usize;
                // Both ways, no faster than the jog.
                let counts = random.below(9) as i32 - 4;
                turned[axis] += i64::from(counts);
                bench.count[axis] = bench.count[axis].wrapping_add(counts);
                match random.below(6) {
                    0 => {}
                    1 => {
                        let late = OperatorRequest {
                            latest_scan: bench.cell.now.scan.saturating_sub(1),
                            ..bench.request(axis)
                        };
                        let answer = bench.tell_so(axis, &late);
                        assert_eq!(answer.reason, Refused::TooLate as u32);
                    }
                    2 => {
                        // Out of order: there and back.
                        let request = bench.request(0);
                        for request in [request, earlier, request] {
                            bench.tell_so(0, &request);
                        }
                    }
                    _ => {
                        assert_eq!(bench.tell(axis).reason, Refused::Not as u32);
                        assert_eq!(bench.tell(axis).counts, 0);
                    }
                }
                earlier = bench.request(0);
                earlier.latest_scan = 0;
                let scans = random.below(60);
                bench.scans(scans);
            }
            for axis in 0..2 {
                bench.tell(axis);
            }
            bench.rests_where_it_was_counted();
            for (axis, turned) in turned.into_iter().enumerate() {
                let increment_mm = bench.cell.machine.axes[axis].increment_mm();
                let gone = (bench.at[axis] - from[axis]) as f64 * increment_mm / 0.01;
                assert_eq!(gone.round() as i64, turned, "{}, axis {axis}", bench.what);
            }
        }
    }
}

/// What keeps an axis from being jogged, and the answer to its wheel meanwhile.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Keeps {
    Disabled,
    Tripped,
    Held,
    Homing,
    OtherJog,
    MasterDies,
}

fn kept(bench: &mut Bench, keeps: Keeps) -> Refused {
    let cell = &mut bench.cell;
    match keeps {
        Keeps::Disabled => {
            assert_eq!(cell.order(Order::Disable), Refused::Not);
            Refused::DrivesOff
        }
        Keeps::Tripped => {
            cell.trips = Some(0);
            cell.scans(2);
            Refused::Tripped
        }
        Keeps::Held => {
            bench.turn(0, 20);
            bench.scans(30);
            assert_eq!(bench.cell.order(Order::Stop), Refused::Not);
            Refused::NotAtRest
        }
        Keeps::Homing => {
            assert_eq!(cell.order(Order::Home), Refused::Not);
            Refused::Jogging
        }
        Keeps::OtherJog => {
            let on = OperatorRequest {
                value: 1.0,
                session: 3,
                deadline_scans: 60,
                ..common::order(Order::JogOn, 1.0)
            };
            assert_eq!(cell.ask(&on).reason, Refused::Not as u32);
            Refused::Jogging
        }
        Keeps::MasterDies => {
            cell.dies(Job::Planner, 0);
            cell.replace_master();
            Refused::DrivesOff
        }
    }
}

/// Ready again, from wherever.
fn freed(bench: &mut Bench) {
    let cell = &mut bench.cell;
    let moves = |of: &Cell| matches!(of.mode(), Mode::Jogging | Mode::Stopping);
    cell.scans(2);
    assert!(cell.until(60_000, |of| !moves(of)), "{}", bench.what);
    cell.scans(300);
    if matches!(cell.mode(), Mode::Disabled | Mode::Tripped) {
        assert_eq!(cell.order(Order::Enable), Refused::Not, "{}", bench.what);
        assert!(cell.until(2_000, |of| of.mode() == Mode::Ready));
    }
    cell.scans(300);
    let now = cell.now.axes.map(|axis| axis.command_position);
    bench.at = now;
}

#[test]
fn what_a_wheel_counts_while_its_axis_may_not_be_jogged_moves_nothing_then_or_later() {
    let all = [
        Keeps::Disabled,
        Keeps::Tripped,
        Keeps::Held,
        Keeps::Homing,
        Keeps::OtherJog,
        Keeps::MasterDies,
    ];
    let each = |keeps| [(0, false), (0, true), (1, false), (1, true)].map(|of| (keeps, of));
    // Each of them at least once.
    for (keeps, (velocity_mode, told)) in size::one_in(5, all.into_iter().flat_map(each)) {
        let mut bench = Bench::of("gantry", gantry(), 0.01, velocity_mode);
        bench.what = format!("{}, {keeps:?}, told: {told}", bench.what);
        let why = kept(&mut bench, keeps);
        bench.count[0] = bench.count[0].wrapping_add(40);
        if told {
            for _ in 0..3 {
                let answer = bench.turn(0, 7);
                assert_eq!(
                    Refused::from_wire(answer.reason),
                    Some(why),
                    "{}",
                    bench.what
                );
            }
        }
        freed(&mut bench);
        // With the drives off the wheel is forgotten: the first count says where it is now.
        let forgets = matches!(keeps, Keeps::Disabled | Keeps::Tripped | Keeps::MasterDies);
        if !told && !forgets {
            bench.count[0] = bench.count[0].wrapping_sub(40);
        }
        if forgets {
            assert_eq!(bench.turn(0, 25).counts, 0, "{}", bench.what);
        }
        let inwards = bench.cell.to_the_middle(0).0.signum() as i32;
        bench.turn_all(0, 3 * inwards);
        bench.rests_where_it_was_counted();
    }
}

#[test]
fn the_first_count_of_a_session_an_axis_or_a_step_only_says_where_the_wheel_is() {
    let mut bench = Bench::of("xy", common::load("xy"), 0.01, 0);
    bench.turn_all(0, 2);
    // Another step.
    bench.per_count_mm = 0.1;
    assert_eq!(bench.turn(0, 5).counts, 0);
    bench.turn_all(0, 2);
    bench.rests_where_it_was_counted();
    // Another session.
    let other = OperatorRequest {
        session: 90,
        count: 7,
        ..bench.request(0)
    };
    assert_eq!(bench.tell_so(0, &other).counts, 0);
    // The same one goes to another axis and comes back.
    for (axis, count, counts) in [(1, 9, 0), (1, 12, 3), (0, 15, 0), (0, 17, 2), (1, 20, 0)] {
        let request = OperatorRequest {
            axis: axis as u32,
            count,
            ..other
        };
        assert_eq!(
            bench.tell_so(axis, &request).counts,
            counts,
            "{axis} {count}"
        );
        bench.rests_where_it_was_counted();
    }
}

#[test]
fn at_the_end_of_the_travel_a_wheel_takes_whole_counts_and_turns_back_at_once() {
    let mut bench = Bench::of("xy", common::load("xy"), 0.3, 0);
    let settings = bench.cell.machine.axes[0].clone();
    for _ in 0..4_000 {
        let answer = bench.turn(0, 2);
        if answer.reason == Refused::TravelEnd as u32 {
            break;
        }
        bench.scans(60);
    }
    let left_mm = settings.travel_max_mm - bench.at[0] as f64 * settings.increment_mm();
    assert!((0.0..0.3).contains(&left_mm), "{left_mm} mm");
    bench.turn_all(0, -1);
    bench.rests_where_it_was_counted();
}

#[test]
fn wheels_that_make_no_sense_are_refused() {
    let mut bench = Bench::of("gantry", gantry(), 0.01, 0);
    let right = bench.request(0);
    for (wrong, why) in [
        (
            OperatorRequest {
                value: 0.0,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                value: f64::NAN,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                value: f64::INFINITY,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                value: 1e-9,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                session: 0,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                velocity_mode: 2,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                speed_mm_s: -1.0,
                ..right
            },
            Refused::JogSpeed,
        ),
        (OperatorRequest { axis: 2, ..right }, Refused::UnknownAxis),
        (OperatorRequest { axis: 9, ..right }, Refused::UnknownAxis),
    ] {
        let reason = bench.cell.ask(&wrong).reason;
        assert_eq!(Refused::from_wire(reason), Some(why), "{wrong:?}");
    }
    bench.turn_all(0, 1);
}
