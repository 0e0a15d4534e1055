//! Rapids at least heat in whole programs: their times, their heat, and what the operator does to them.

use std::ops::ControlFlow;

use audit::ProgramWalk;
use audit::SetpointAudit;
use path::geometry::{AxisVector, Element, Feed, Path};
use path::limits::{AxisLimits, MotionLimits};
use path::positioning::{MotorLoad, Move, Positioning};
use path::profile::PathState;
use path::window::{PlannedSetpoint, WindowPlanner, WindowRequest, WindowSettings};
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

const TP: f64 = 1e-3;
/// Rounding to whole increments takes this much of an acceleration limit at 1 nm and 1 ms, in mm/s².
const ROUNDING_MM_S2: f64 = 2.5;
const MASS_KG: f64 = 850.0;

fn at(x: f64, y: f64, z: f64) -> AxisVector {
    let mut vector = AxisVector::zeros();
    vector[0] = x;
    vector[1] = y;
    vector[2] = z;
    vector
}

fn limits(velocity_mm_s: f64, acceleration_mm_s2: f64) -> MotionLimits {
    let slide = AxisLimits {
        velocity_mm_s,
        acceleration_mm_s2,
        jerk_mm_s3: f64::INFINITY,
        increment_mm: 1e-6,
    };
    MotionLimits::new(&[slide; 3], TP).unwrap()
}

/// Every motor has this force at its rating, in N.
fn motors(rated_n: f64, coulomb_n: f64) -> Positioning {
    let mut positioning = Positioning::default();
    for load in positioning.loads.iter_mut().take(3) {
        *load = Some(MotorLoad::new(rated_n, MASS_KG, coulomb_n, 0.0).unwrap());
    }
    positioning
}

fn planner(
    elements: &[Element],
    limits: MotionLimits,
    positioning: Option<&Positioning>,
) -> WindowPlanner {
    let path = Path {
        elements: elements.to_vec(),
    };
    let settings = WindowSettings {
        intended_setpoints_max: 4000,
        braking_setpoints_max: 900,
        override_max: 1.0,
        elements_per_s_max: f64::INFINITY,
    };
    WindowPlanner::with_positioning(path, limits, settings, positioning).unwrap()
}

fn setpoints(planner: &mut WindowPlanner, setpoints_per_window: u32) -> Vec<PlannedSetpoint> {
    let mut setpoints = Vec::new();
    let walk = ProgramWalk {
        setpoints_max: u64::MAX,
        feed_override: 1.0,
        setpoints_per_window,
    };
    let totals = walk
        .walk(planner, |_, setpoint| {
            setpoints.push(*setpoint);
            ControlFlow::Continue(())
        })
        .unwrap();
    assert_eq!(totals.fault, None);
    assert!(totals.complete);
    setpoints
}

/// Sum of a²·Tp of one axis over setpoints, in mm²/s³.
fn heat(setpoints: &[PlannedSetpoint], axis: usize) -> f64 {
    let position = |setpoint: &PlannedSetpoint| setpoint.position_increments[axis] as f64 * 1e-6;
    let accelerations = setpoints.windows(3).map(|three| {
        (position(&three[2]) - 2.0 * position(&three[1]) + position(&three[0])) / (TP * TP)
    });
    accelerations.map(|a| a * a * TP).sum()
}

/// To and fro along X, with a wait after each move.
fn shuttle(distance_mm: f64, moves: u32, wait_s: f64) -> Vec<Element> {
    let mut elements = vec![Element::dwell(1, at(0.0, 0.0, 0.0), 0.01)];
    for index in 0..moves {
        let (from, to) = if index % 2 == 0 {
            (0.0, distance_mm)
        } else {
            (distance_mm, 0.0)
        };
        let (from, to) = (at(from, 0.0, 0.0), at(to, 0.0, 0.0));
        elements.push(Element::line(index + 2, from, to, Feed::Rapid));
        elements.push(Element::dwell(index + 2, to, wait_s));
    }
    elements
}

/// Two holes: over them in X and Y, down in rapid, feed, wait, up in rapid.
fn drilling() -> Vec<Element> {
    let mut elements = Vec::new();
    let mut here = at(0.0, 0.0, 20.0);
    let mut go = |to: AxisVector, feed: Feed, wait_s: f64| {
        let line = elements.len() as u32 + 1;
        if wait_s > 0.0 {
            elements.push(Element::dwell(line, here, wait_s));
        }
        elements.push(Element::line(line, here, to, feed));
        here = to;
    };
    for (x, y) in [(40.0, 0.0), (80.0, 30.0)] {
        go(at(x, y, 20.0), Feed::Rapid, 0.0);
        go(at(x, y, 2.0), Feed::Rapid, 0.0);
        go(at(x, y, -10.0), Feed::PathMmS(20.0), 0.0);
        go(at(x, y, 20.0), Feed::Rapid, 0.25);
    }
    elements
}

fn move_of(planner: &WindowPlanner, element: u32) -> Move {
    let moves = planner.speed_map().moves();
    *moves.iter().find(|of| of.element == element).unwrap()
}

#[test]
fn the_rest_after_each_rapid_is_what_the_program_has() {
    let elements = drilling();
    let positioning = motors(2000.0, 400.0);
    let planner = planner(&elements, limits(250.0, 5000.0), Some(&positioning));
    let moves = planner.speed_map().moves();
    let indices: Vec<u32> = moves.iter().map(|of| of.element).collect();
    // 0 over, 1 down, 2 feed, 3 wait, 4 up; 5 over, 6 down, 7 feed, 8 wait, 9 up.
    assert_eq!(indices, [0, 1, 4, 5, 6, 9]);
    let time_s = |element| move_of(&planner, element).profile.travel_time_s;
    // Feeding 12 mm at 20 mm/s under friction of a fifth of the rating counts for 96 % of its time.
    let cutting_s = 12.0 / 20.0 * (1.0 - 0.2f64.powi(2));
    let near =
        |found: f64, expected: f64| assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    near(move_of(&planner, 1).rest_s[2], cutting_s + 0.25);
    near(move_of(&planner, 4).rest_s[2], time_s(5));
    near(
        move_of(&planner, 0).rest_s[0],
        time_s(1) + 0.6 + 0.25 + time_s(4),
    );
    // Y is at rest in the first move, and its only move has the rest of the program behind it.
    assert_eq!(move_of(&planner, 0).rest_s[1], 0.0);
    near(
        move_of(&planner, 5).rest_s[1],
        time_s(6) + 0.6 + 0.25 + time_s(9),
    );
    assert_eq!(
        move_of(&planner, 9).rest_s,
        [0.0; path::geometry::PATH_AXES]
    );
    // The same distance up and down, but less rest after it: it must take longer.
    assert!(time_s(9) > time_s(4));
}

#[test]
fn more_rest_makes_a_rapid_faster_and_none_is_above_the_rating() {
    let mut before_s = f64::INFINITY;
    for wait_s in [0.0015, 0.05, 0.2, 1.0] {
        let positioning = motors(2500.0, 450.0);
        let mut planner = planner(
            &shuttle(30.0, 4, wait_s),
            limits(500.0, 20_000.0),
            Some(&positioning),
        );
        let moves = planner.speed_map().moves().to_vec();
        assert_eq!(moves.len(), 4);
        let first = moves[0];
        assert!(first.profile.travel_time_s < before_s);
        before_s = first.profile.travel_time_s;
        let load = positioning.loads[0].unwrap();
        let share = load.rms_share(&first.profile, first.rest_s[0]);
        assert!(share <= 1.0 && (share - first.rms_share[0]).abs() < 1e-9);
        // The rounding up to whole scans is all that is given away.
        let scans = before_s / TP;
        assert!((scans - scans.round()).abs() < 1e-9);
        // As the setpoints have it: inertia, and friction while it moves.
        let setpoints = setpoints(&mut planner, 8);
        let of_move: Vec<PlannedSetpoint> = setpoints
            .iter()
            .filter(|setpoint| setpoint.state.element <= first.element + 1)
            .copied()
            .collect();
        let inertia_n2_s = (MASS_KG * 1e-3).powi(2) * heat(&of_move, 0);
        let friction_n2_s = 450.0f64.powi(2) * before_s;
        let time_s = before_s + first.rest_s[0];
        let rms_n = ((inertia_n2_s + friction_n2_s) / time_s).sqrt();
        assert!(rms_n <= 2500.0, "{rms_n}");
        assert!(
            rms_n > 0.9 * 2500.0 || scans < 60.0,
            "{rms_n} in {scans} scans"
        );
    }
}

#[test]
fn the_rows_of_a_rapid_lie_on_the_parabola() {
    let positioning = motors(2500.0, 0.0);
    let elements = shuttle(30.0, 2, 0.1);
    let mut planner = planner(&elements, limits(1000.0, 50_000.0), Some(&positioning));
    let of_move = planner.speed_map().moves()[0];
    let r = of_move.profile.travel_time_s;
    let setpoints = setpoints(&mut planner, 8);
    let first = setpoints
        .iter()
        .position(|setpoint| setpoint.state.element == of_move.element)
        .unwrap();
    // One scan of the wait is setpoint 0, ten are waited; the first setpoint on the move is one scan into it.
    for (index, setpoint) in setpoints.iter().enumerate().skip(first) {
        if setpoint.state.element != of_move.element {
            break;
        }
        let tau = (index - first + 1) as f64 * TP / r;
        let x = 30.0 * tau * tau * (3.0 - 2.0 * tau);
        let off_nm = setpoint.position_increments[0] as f64 - x * 1e6;
        assert!(off_nm.abs() <= 0.51, "{index}: {off_nm} nm");
    }
    let arrived = setpoints
        .iter()
        .position(|setpoint| setpoint.position_increments[0] == 30_000_000)
        .unwrap();
    assert_eq!(arrived - (first - 1), (r / TP).round() as usize);
}

/// The source's headline: 16 b²/r³ against 12 b²/r³ for the same distance in the same time.
#[test]
fn constant_acceleration_costs_four_thirds_of_the_parabolas_heat() {
    // A triangle of 100 scans: 10 mm at 4000 mm/s², once rounding is taken off.
    let triangle = limits(500.0, 4000.0 + ROUNDING_MM_S2);
    let parabola = limits(500.0, 6000.0 + ROUNDING_MM_S2);
    let elements = shuttle(10.0, 20, 0.1);
    // The rating that makes the parabola take 99.5 scans, so 100: F² = m²·12b²/(r³(r + c)).
    let r: f64 = 99.5e-3;
    let rated_n = MASS_KG * 1e-3 * (12.0 * 100.0 / (r.powi(3) * (r + 0.1))).sqrt();
    let positioning = motors(rated_n, 0.0);
    let with = setpoints(&mut planner(&elements, parabola, Some(&positioning)), 8);
    let without = setpoints(&mut planner(&elements, triangle, None), 8);
    assert_eq!(with.len(), without.len(), "equal travel times");
    let ratio = heat(&without, 0) / heat(&with, 0);
    println!("triangle : parabola = {ratio:.6}");
    assert!((ratio / (4.0 / 3.0) - 1.0).abs() < 1e-3, "{ratio}");
}

#[test]
fn where_the_limits_leave_no_choice_it_is_as_fast_as_without() {
    // Motors stronger than the acceleration limit asks for: nothing to be gained, nothing lost but whole scans.
    let elements = drilling();
    let positioning = motors(50_000.0, 0.0);
    let limits = limits(250.0, 5000.0);
    let with = setpoints(
        &mut planner(&elements, limits.clone(), Some(&positioning)),
        8,
    )
    .len();
    let without = setpoints(&mut planner(&elements, limits, None), 8).len();
    // Six rapids: up to a scan each for whole scans and for a stop; two feeds from rest that cost up to four scans.
    assert!(with >= without && with <= without + 20, "{with} {without}");
}

#[test]
fn rapids_that_run_into_one_another_keep_their_speed() {
    // Two rapids in one line, and a rapid that a contour takes up at speed: no stop between them.
    let points = [at(0.0, 0.0, 0.0), at(30.0, 0.0, 0.0), at(60.0, 0.0, 0.0)];
    let elements = [
        Element::line(1, points[0], points[1], Feed::Rapid),
        Element::line(2, points[1], points[2], Feed::Rapid),
    ];
    let positioning = motors(2500.0, 0.0);
    let with = planner(&elements, limits(250.0, 5000.0), Some(&positioning));
    assert_eq!(with.speed_map().moves(), []);
}

/// Executes a program in windows of 8 setpoints, each of which may be asked for anything; checks limits, path and tails.
struct Run {
    planner: WindowPlanner,
    audit: SetpointAudit,
    window: Vec<PlannedSetpoint>,
    last: PlannedSetpoint,
    request: WindowRequest,
}

impl Run {
    fn start(mut planner: WindowPlanner) -> Self {
        let last = planner.setpoint(&PathState::default()).unwrap();
        let audit = SetpointAudit::at_rest(planner.limits().clone(), last.position_increments);
        let request = WindowRequest {
            intended_setpoints: 32,
            ..WindowRequest::default()
        };
        let mut window = Vec::new();
        planner.plan(&last.state, &request, &mut window).unwrap();
        Self {
            planner,
            audit,
            window,
            last,
            request,
        }
    }

    /// Executes 8 setpoints of the next window, and looks at where its tail would end. Whether the program is done.
    fn period(&mut self) -> bool {
        let outcome = self
            .planner
            .plan(&self.last.state, &self.request, &mut self.window)
            .unwrap();
        for setpoint in self.window.iter().take(8) {
            self.audit.setpoint(&setpoint.position_increments).unwrap();
            let state = &setpoint.state;
            self.audit
                .place(self.planner.path(), state.element, state.distance_mm)
                .unwrap();
            self.last = *setpoint;
        }
        let mut tail = self.audit.clone();
        for setpoint in self.window.iter().skip(8) {
            tail.setpoint(&setpoint.position_increments).unwrap();
        }
        tail.end().unwrap();
        assert!(self.window.last().unwrap().state.is_at_rest());
        outcome.ends_program && outcome.intended_setpoints <= 8
    }

    fn finish(&mut self) {
        for _ in 0..2000 {
            if self.period() {
                let end = self.planner.path().last().unwrap().end();
                assert_eq!(
                    self.last.position_increments,
                    self.planner.limits().increments(&end)
                );
                return;
            }
        }
        panic!("never done: {:?}", self.last);
    }
}

#[test]
fn a_hold_anywhere_in_a_parabola_stops_on_the_path_and_a_release_goes_on_finish() {
    let positioning = motors(2500.0, 300.0);
    for periods in 0..40 {
        let mut run = Run::start(planner(
            &drilling(),
            limits(250.0, 5000.0),
            Some(&positioning),
        ));
        for _ in 0..periods {
            run.period();
        }
        run.request.hold = true;
        for _ in 0..30 {
            run.period();
        }
        assert!(run.last.state.is_at_rest());
        run.request.hold = false;
        run.finish();
    }
}

#[test]
fn the_override_slows_a_parabola_down_in_proportion_and_may_change_within_it() {
    let positioning = motors(2500.0, 300.0);
    let elements = shuttle(60.0, 1, 0.02);
    let of = || planner(&elements, limits(250.0, 5000.0), Some(&positioning));
    let scans_at = |feed_override: f64| {
        let mut setpoints_on_move = 0;
        let walk = ProgramWalk {
            setpoints_max: u64::MAX,
            feed_override,
            setpoints_per_window: 8,
        };
        let totals = walk.walk(&mut of(), |_, setpoint| {
            setpoints_on_move += u32::from(setpoint.state.element == 1);
            ControlFlow::Continue(())
        });
        assert_eq!(totals.unwrap().fault, None);
        f64::from(setpoints_on_move)
    };
    let full = scans_at(1.0);
    assert!((scans_at(0.5) - 2.0 * full).abs() <= 2.0);
    assert!((scans_at(0.1) - 10.0 * full).abs() <= 10.0);
    // Every period another override, up and down, holds among them.
    for seed in 1..40u64 {
        let mut run = Run::start(planner(
            &drilling(),
            limits(250.0, 5000.0),
            Some(&positioning),
        ));
        let mut rng = SplitMix64::seed_from_u64(seed);
        for _ in 0..150 {
            run.request.feed_override = f64::from(rng.next_u32()) / f64::from(u32::MAX) * 1.2;
            run.request.hold = rng.next_u32().is_multiple_of(7);
            run.period();
        }
        run.request.feed_override = 1.0;
        run.request.hold = false;
        run.finish();
    }
}

#[test]
fn after_a_hold_the_rest_of_the_way_is_the_parabola_again() {
    let positioning = motors(2000.0, 300.0);
    let mut run = Run::start(planner(
        &shuttle(60.0, 1, 0.02),
        limits(250.0, 5000.0),
        Some(&positioning),
    ));
    let profile = run.planner.speed_map().moves()[0].profile;
    for _ in 0..8 {
        run.period();
    }
    run.request.hold = true;
    for _ in 0..20 {
        run.period();
    }
    let held_mm = run.last.state.distance_mm;
    assert!(held_mm > 1.0 && held_mm < 30.0, "{held_mm}");
    run.request.hold = false;
    let mut met = false;
    for _ in 0..100 {
        run.period();
        let state = run.last.state;
        if state.element != 1 || state.distance_mm >= 60.0 {
            break;
        }
        let off_mm_s = state.speed_mm_s - profile.velocity_at_mm_s(state.distance_mm);
        met |= off_mm_s.abs() < 1e-6;
        assert!(off_mm_s < 1e-6, "faster than the profile: {state:?}");
        assert!(!met || off_mm_s.abs() < 1e-6, "left the profile: {state:?}");
    }
    assert!(met);
    run.finish();
}

#[test]
fn a_planner_restarted_goes_on_from_the_tag_of_any_setpoint() {
    let positioning = motors(2500.0, 300.0);
    let mut planner = planner(&drilling(), limits(250.0, 5000.0), Some(&positioning));
    let all = setpoints(&mut planner, 8);
    let mut window = Vec::new();
    for setpoint in all.iter().step_by(7) {
        let tag = setpoint.state;
        let from = PathState::resume(
            planner.path(),
            tag.element,
            tag.distance_mm,
            tag.dwell_remaining_scans,
        )
        .unwrap();
        let request = WindowRequest {
            intended_setpoints: 4000,
            repeats_start: true,
            ..WindowRequest::default()
        };
        let outcome = planner.plan(&from, &request, &mut window).unwrap();
        assert!(outcome.ends_program);
        let mut audit =
            SetpointAudit::at_rest(planner.limits().clone(), setpoint.position_increments);
        for setpoint in &window {
            audit.setpoint(&setpoint.position_increments).unwrap();
        }
        audit.end().unwrap();
        assert_eq!(
            window.last().unwrap().position_increments,
            all.last().unwrap().position_increments
        );
    }
}

#[test]
fn the_number_of_setpoints_in_a_window_changes_no_setpoint() {
    let positioning = motors(2500.0, 300.0);
    let of = |setpoints_per_window| {
        setpoints(
            &mut planner(&drilling(), limits(250.0, 5000.0), Some(&positioning)),
            setpoints_per_window,
        )
    };
    assert_eq!(of(1), of(8));
    assert_eq!(of(8), of(4000));
}

#[test]
fn single_block_waits_at_the_end_of_each_rapid() {
    let positioning = motors(2500.0, 300.0);
    let mut run = Run::start(planner(
        &drilling(),
        limits(250.0, 5000.0),
        Some(&positioning),
    ));
    run.request.single_block = true;
    for block in 1..=7 {
        for _ in 0..200 {
            run.period();
            run.request.start = false;
        }
        let state = run.last.state;
        assert!(state.waits_for_start, "block {block}: {state:?}");
        let on = run.planner.path().get(state.element).unwrap();
        assert_eq!(state.distance_mm, on.length_mm);
        run.request.start = true;
    }
}
