//! Windows of setpoints over random programs: every setpoint within the limits, on the path, and at rest at the end.

use std::ops::ControlFlow;

use audit::SetpointAudit;
use audit::{ProgramWalk, Totals};
use path::geometry::{AxisVector, Element, Feed, PATH_AXES, Path, PathTolerance};
use path::kinematics::Kinematics;
use path::limits::{AxisLimits, MotionLimits};
use path::path_part::PathPart;
use path::pivot::{Carries, PivotY};
use path::positioning::{MotorLoad, Positioning};
use path::profile::PathState;
use path::setpoint_settings::{SetpointSettings, StraightLines};
use path::speed_map::MapError;
use path::window::{
    Lead, PlanError, PlannedSetpoint, WindowOutcome, WindowPlanner, WindowRequest, WindowSettings,
};
use proptest::prelude::*;

use crate::size;

const FEED: Feed = Feed::PathMmS(50.0);

fn at(values: &[f64]) -> AxisVector {
    let mut vector = AxisVector::zeros();
    for (component, value) in vector.iter_mut().zip(values) {
        *component = *value;
    }
    vector
}

/// Speed and acceleration of three slides, unequal on purpose.
const SLIDES: [(f64, f64); 3] = [(250.0, 2000.0), (250.0, 2500.0), (100.0, 1500.0)];
/// The same with an arm between the slides, in degrees.
const WITH_ARM: [(f64, f64); 3] = [(250.0, 2000.0), (90.0, 900.0), (100.0, 1500.0)];

fn limits_of_setpoints(
    scan_period_s: f64,
    setpoints: SetpointSettings,
    of_axes: [(f64, f64); 3],
) -> MotionLimits {
    let axes = of_axes.map(|(velocity_mm_s, acceleration_mm_s2)| AxisLimits {
        velocity_mm_s,
        acceleration_mm_s2,
        jerk_mm_s3: f64::INFINITY,
        increment_mm: 1e-6,
    });
    MotionLimits::with_setpoints(&axes, scan_period_s, setpoints).unwrap()
}

/// The slides with a limit of jerk of so many times the acceleration in a second.
fn limits_with_jerk(
    scan_period_s: f64,
    jerk_per_s: f64,
    vibration_hz: Option<f64>,
) -> MotionLimits {
    let axes = SLIDES.map(|(velocity_mm_s, acceleration_mm_s2)| AxisLimits {
        velocity_mm_s,
        acceleration_mm_s2,
        jerk_mm_s3: jerk_per_s * acceleration_mm_s2,
        increment_mm: 1e-8,
    });
    let setpoints = SetpointSettings {
        vibration_hz,
        ..SetpointSettings::default()
    };
    MotionLimits::with_setpoints(&axes, scan_period_s, setpoints).unwrap()
}

fn limits(scan_period_s: f64) -> MotionLimits {
    limits_of_setpoints(scan_period_s, SetpointSettings::default(), SLIDES)
}

/// Motors for the three slides, from far weaker than their limits of acceleration ask for to stronger.
fn loads(rated_n: [f64; 3]) -> Positioning {
    let mut positioning = Positioning::default();
    for (load, rated_n) in positioning.loads.iter_mut().zip(rated_n) {
        *load = MotorLoad::new(rated_n, 850.0, 0.09 * rated_n, 20.0).ok();
    }
    positioning
}

fn settings(intended_setpoints_max: u32) -> WindowSettings {
    WindowSettings {
        intended_setpoints_max,
        braking_setpoints_max: 900,
        override_max: 1.5,
        elements_per_s_max: f64::INFINITY,
    }
}

fn planner(
    elements: Vec<Element>,
    scan_period_s: f64,
    intended_setpoints_max: u32,
) -> WindowPlanner {
    let path = Path { elements };
    WindowPlanner::with_positioning(
        path,
        limits(scan_period_s),
        settings(intended_setpoints_max),
        None,
    )
    .unwrap()
}

fn walk(planner: &mut WindowPlanner, setpoints_per_window: u32) -> (Totals, Vec<PlannedSetpoint>) {
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
    (totals, setpoints)
}

fn polyline(points: &[AxisVector], feed: Feed) -> Vec<Element> {
    let pairs = points.iter().zip(points.iter().skip(1));
    pairs
        .enumerate()
        .map(|(index, (from, to))| Element::line(index as u32 + 1, *from, *to, feed))
        .collect()
}

/// One block of a random program.
#[derive(Debug, Clone)]
enum Block {
    Line([f64; 3]),
    Back,
    Arc {
        radius_mm: f64,
        start_rad: f64,
        sweep_rad: f64,
        plane: [usize; 2],
        axial_mm: f64,
    },
    TangentArc {
        radius_mm: f64,
        sweep_rad: f64,
    },
    Dwell(f64),
    Nothing,
    Kinks {
        count: u32,
        step_mm: f64,
        turn_rad: f64,
    },
}

fn scaled(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.ln()..high.ln()).prop_map(f64::exp)
}

fn any_block() -> impl Strategy<Value = (Block, Feed)> {
    let direction = [-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64];
    let line = (direction, scaled(1e-4, 60.0), 0..3usize).prop_map(|(mut to, scale, flat)| {
        // Straight along an axis or in a plane as often as anywhere.
        to[2] *= if flat > 0 { 0.0 } else { 1.0 };
        to[1] *= if flat > 1 { 0.0 } else { 1.0 };
        Block::Line(to.map(|component| (component * scale * 1e4).round() / 1e4))
    });
    let sweep = || prop_oneof![0.01..7.0f64, -7.0..-0.01f64];
    let arc = (
        scaled(2e-3, 60.0),
        -3.1..3.1f64,
        sweep(),
        prop_oneof![Just([0, 1]), Just([2, 0]), Just([1, 2])],
        prop_oneof![Just(0.0), -5.0..5.0f64],
    )
        .prop_map(
            |(radius_mm, start_rad, sweep_rad, plane, axial_mm)| Block::Arc {
                radius_mm,
                start_rad,
                sweep_rad,
                plane,
                axial_mm,
            },
        );
    let tangent_arc =
        (scaled(1e-3, 60.0), sweep()).prop_map(|(radius_mm, sweep_rad)| Block::TangentArc {
            radius_mm,
            sweep_rad,
        });
    let kinks =
        (1..200u32, scaled(1e-4, 1.0), -0.2..0.2f64).prop_map(|(count, step_mm, turn_rad)| {
            Block::Kinks {
                count,
                step_mm,
                turn_rad,
            }
        });
    let block = prop_oneof![
        4 => line,
        1 => Just(Block::Back),
        2 => arc,
        2 => tangent_arc,
        1 => (0.0..0.02f64).prop_map(Block::Dwell),
        1 => Just(Block::Nothing),
        2 => kinks,
    ];
    let feed = prop_oneof![
        1 => Just(Feed::Rapid),
        3 => scaled(2.0, 400.0).prop_map(Feed::PathMmS),
    ];
    (block, feed)
}

fn any_tolerance() -> impl Strategy<Value = PathTolerance> {
    let corner_mm = prop_oneof![1 => Just(0.0), 4 => scaled(1e-4, 1.0)];
    let chord_mm = prop_oneof![1 => Just(0.0), 1 => scaled(1e-4, 1.0)];
    (corner_mm, chord_mm).prop_map(|(corner_mm, chord_mm)| PathTolerance {
        corner_mm,
        chord_mm,
        ..PathTolerance::EXACT
    })
}

fn elements_of(blocks: &[(Block, Feed)]) -> Vec<Element> {
    let mut elements: Vec<Element> = Vec::new();
    let mut here = at(&[12.345_678, -3.0, 7.5]);
    for (index, (block, feed)) in blocks.iter().enumerate() {
        let line = index as u32 + 1;
        let direction = elements
            .iter()
            .rev()
            .find(|element| element.length_mm > 0.0)
            .map_or(at(&[1.0]), |element| element.tangent(element.length_mm));
        let heading_rad = libm::atan2(direction[1], direction[0]);
        match block {
            Block::Line(by) => elements.push(Element::line(line, here, here + at(by), *feed)),
            Block::Nothing => elements.push(Element::line(line, here, here, *feed)),
            Block::Dwell(seconds) => elements.push(Element::dwell(line, here, *seconds)),
            Block::Back => {
                let from = elements.last().map_or(here, Element::start);
                elements.push(Element::line(line, here, from, *feed));
            }
            Block::Arc {
                radius_mm,
                start_rad,
                sweep_rad,
                plane,
                axial_mm,
            } => elements.push(arc(
                line, here, *radius_mm, *start_rad, *sweep_rad, *plane, *axial_mm, *feed,
            )),
            Block::TangentArc {
                radius_mm,
                sweep_rad,
            } => {
                let start_rad = heading_rad - sweep_rad.signum() * std::f64::consts::FRAC_PI_2;
                elements.push(arc(
                    line,
                    here,
                    *radius_mm,
                    start_rad,
                    *sweep_rad,
                    [0, 1],
                    0.0,
                    *feed,
                ));
            }
            Block::Kinks {
                count,
                step_mm,
                turn_rad,
            } => {
                let mut heading_rad = heading_rad;
                for _ in 0..*count {
                    heading_rad += turn_rad;
                    let step = at(&[libm::cos(heading_rad), libm::sin(heading_rad)]) * *step_mm;
                    elements.push(Element::line(line, here, here + step, *feed));
                    here += step;
                }
            }
        }
        here = elements.last().map_or(here, Element::end);
    }
    elements
}

#[allow(clippy::too_many_arguments)]
fn arc(
    line: u32,
    from: AxisVector,
    radius_mm: f64,
    start_rad: f64,
    sweep_rad: f64,
    plane: [usize; 2],
    axial_mm: f64,
    feed: Feed,
) -> Element {
    let spoke = |angle_rad: f64| {
        let mut spoke = AxisVector::zeros();
        spoke[plane[0]] = radius_mm * libm::cos(angle_rad);
        spoke[plane[1]] = radius_mm * libm::sin(angle_rad);
        spoke
    };
    let centre = from - spoke(start_rad);
    let mut to = centre + spoke(start_rad + sweep_rad);
    to[3 - plane[0] - plane[1]] += axial_mm;
    Element::arc(line, from, to, centre, plane, sweep_rad, feed)
}

/// What happens at one period boundary of a random run.
#[derive(Debug, Clone)]
enum Event {
    Nothing,
    Override(f64),
    Hold(bool),
    /// No new window for so many setpoints.
    Silence(usize),
    SingleBlock(bool),
    Start,
}

fn any_event() -> impl Strategy<Value = Event> {
    prop_oneof![
        20 => Just(Event::Nothing),
        3 => (0.0..1.6f64).prop_map(Event::Override),
        1 => any::<bool>().prop_map(Event::Hold),
        1 => (1..60usize).prop_map(Event::Silence),
        1 => (200..900usize).prop_map(Event::Silence),
        1 => any::<bool>().prop_map(Event::SingleBlock),
        3 => Just(Event::Start),
    ]
}

/// A machine that executes windows, and checks all that must hold for each.
struct Cell {
    planner: WindowPlanner,
    audit: SetpointAudit,
    window: Vec<PlannedSetpoint>,
    outcome: WindowOutcome,
    /// Setpoints of the window executed so far.
    executed: usize,
    last: PlannedSetpoint,
    leads: Vec<Lead>,
    place: (u32, f64),
}

impl Cell {
    fn start(mut planner: WindowPlanner, intended_setpoints: u32) -> (Self, WindowRequest) {
        let request = WindowRequest {
            intended_setpoints,
            repeats_start: true,
            ..WindowRequest::default()
        };
        let mut window = Vec::new();
        let start = planner.setpoint(&PathState::default()).unwrap();
        let outcome = planner.plan(&start.state, &request, &mut window).unwrap();
        assert_eq!(window[0].position_increments, start.position_increments);
        let audit = SetpointAudit::at_rest(planner.limits().clone(), start.position_increments);
        let cell = Self {
            planner,
            audit,
            window,
            outcome,
            executed: 0,
            last: start,
            leads: vec![start.lead],
            place: (0, 0.0),
        };
        let request = WindowRequest {
            repeats_start: false,
            ..request
        };
        (cell, request)
    }

    fn execute(&mut self, setpoints: usize) -> Result<(), TestCaseError> {
        for _ in 0..setpoints {
            // Past its end a window is on its last setpoint.
            let index = self.executed.min(self.window.len() - 1);
            let setpoint = self.window[index];
            self.executed += 1;
            self.audit
                .setpoint(&setpoint.position_increments)
                .and_then(|()| {
                    self.audit.place(
                        self.planner.path(),
                        setpoint.state.element,
                        setpoint.state.distance_mm,
                    )
                })
                .map_err(|fault| TestCaseError::fail(format!("{fault} at {setpoint:?}")))?;
            let place = (setpoint.state.element, setpoint.state.distance_mm);
            prop_assert!(place >= self.place, "{place:?} after {:?}", self.place);
            self.place = place;
            self.last = setpoint;
            self.leads.push(setpoint.lead);
        }
        Ok(())
    }

    /// The rest of the window in force, were it executed to its end.
    fn check_tail(&self) -> Result<(), TestCaseError> {
        let mut audit = self.audit.clone();
        for setpoint in self.window.iter().skip(self.executed) {
            audit
                .setpoint(&setpoint.position_increments)
                .map_err(|fault| TestCaseError::fail(format!("tail: {fault} at {setpoint:?}")))?;
        }
        prop_assert!(audit.end().is_ok());
        let [before, last] = &self.window[self.window.len() - 2..] else {
            unreachable!()
        };
        prop_assert_eq!(before.position_increments, last.position_increments);
        prop_assert!(last.state.is_at_rest());
        Ok(())
    }

    fn replan(&mut self, request: &WindowRequest, unchanged: bool) -> Result<(), TestCaseError> {
        let old = std::mem::take(&mut self.window);
        let from = self.last.state;
        self.outcome = self
            .planner
            .plan_behind(&from, &self.leads, request, &mut self.window)
            .map_err(|error| TestCaseError::fail(error.to_string()))?;
        prop_assert!(self.window.len() <= self.planner.setpoints_max());
        if unchanged {
            let intended = self.outcome.intended_setpoints as usize;
            let overlap = old
                .iter()
                .take(old.len().min(request.intended_setpoints as usize))
                .skip(self.executed);
            for (old, new) in overlap.zip(self.window.iter().take(intended)) {
                prop_assert_eq!(old, new);
            }
        }
        self.executed = 0;
        self.check_tail()
    }
}

fn any_run(
    elements: Vec<Element>,
    events: &[Event],
    limits: MotionLimits,
    period_setpoints: usize,
    braking_setpoints_max: u32,
    positioning: Option<&Positioning>,
) -> Result<(), TestCaseError> {
    let last = elements.last().cloned();
    let intended_setpoints = 4 * period_setpoints as u32;
    let planner = match WindowPlanner::with_positioning(
        Path { elements },
        limits,
        WindowSettings {
            braking_setpoints_max,
            ..settings(intended_setpoints)
        },
        positioning,
    ) {
        Ok(planner) => planner,
        Err(PlanError::Map(MapError::OutOfReach(_))) => {
            return Err(TestCaseError::reject("out of the arm's reach"));
        }
        Err(error) => return Err(TestCaseError::fail(error.to_string())),
    };
    let (mut cell, mut request) = Cell::start(planner, intended_setpoints);
    cell.check_tail()?;
    let mut events = events.iter();
    // The slowest of the random programs are left before their end.
    let mut at_end = false;
    for _ in 0..40_000 {
        let event = events.next().unwrap_or(&Event::Nothing);
        let mut unchanged =
            cell.executed + period_setpoints <= cell.outcome.intended_setpoints as usize;
        request.start = false;
        match event {
            Event::Nothing => {}
            Event::Override(share) => request.feed_override = *share,
            Event::Hold(hold) => request.hold = *hold,
            Event::Silence(setpoints) => {
                cell.execute(*setpoints)?;
                unchanged = false;
            }
            Event::SingleBlock(on) => request.single_block = *on,
            Event::Start => request.start = true,
        }
        if events.len() == 0 {
            request.hold = false;
            request.start = true;
            request.feed_override = 1.0;
            unchanged = false;
        }
        unchanged &= matches!(event, Event::Nothing);
        cell.execute(period_setpoints)?;
        if cell.outcome.ends_program
            && cell.last.state.is_at_rest()
            && cell.executed >= cell.outcome.intended_setpoints as usize
        {
            at_end = true;
            break;
        }
        cell.replan(&request, unchanged)?;
    }
    if let Some(last) = last.filter(|_| at_end) {
        let end = cell
            .planner
            .limits()
            .setpoints()
            .kinematics
            .axes(&last.end());
        prop_assert_eq!(
            cell.last.position_increments,
            cell.planner.limits().increments(&end)
        );
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: size::number("CASES", 100, 400) as u32, ..ProptestConfig::default() })]

    #[test]
    fn no_axis_is_over_a_limit_at_any_scan_whatever_the_operator_and_the_planner_do(
        blocks in prop::collection::vec(any_block(), 1..14),
        events in prop::collection::vec(any_event(), 0..400),
        fast in any::<bool>(),
        long_period in any::<bool>(),
        braking_setpoints_max in prop_oneof![Just(900u32), 12..200u32],
        straight_lines in prop_oneof![Just(StraightLines::Rounded), Just(StraightLines::MasterAxis)],
    ) {
        let scan_period_s = if fast { 250e-6 } else { 1e-3 };
        let setpoints = SetpointSettings { straight_lines, ..SetpointSettings::default() };
        let limits = limits_of_setpoints(scan_period_s, setpoints, SLIDES);
        any_run(elements_of(&blocks), &events, limits, if long_period { 8 } else { 4 }, braking_setpoints_max, None)?;
    }

    #[test]
    fn rapids_at_least_heat_keep_every_limit_whatever_the_operator_and_the_planner_do(
        blocks in prop::collection::vec((any_block(), any::<bool>()), 1..14),
        events in prop::collection::vec(any_event(), 0..400),
        fast in any::<bool>(),
        long_period in any::<bool>(),
        braking_setpoints_max in prop_oneof![3 => Just(900u32), 1 => 12..200u32],
        rated_n in prop::array::uniform3(100.0..4000.0f64),
    ) {
        let scan_period_s = if fast { 250e-6 } else { 1e-3 };
        let blocks: Vec<(Block, Feed)> = blocks
            .into_iter()
            .map(|((block, feed), rapid)| (block, if rapid { Feed::Rapid } else { feed }))
            .collect();
        any_run(elements_of(&blocks), &events, limits(scan_period_s), if long_period { 8 } else { 4 }, braking_setpoints_max, Some(&loads(rated_n)))?;
    }

    #[test]
    fn rounded_paths_keep_every_limit_whatever_the_operator_and_the_planner_do(
        blocks in prop::collection::vec((any_block(), any_tolerance()), 1..14),
        events in prop::collection::vec(any_event(), 0..400),
        fast in any::<bool>(),
        braking_setpoints_max in prop_oneof![3 => Just(900u32), 1 => 12..200u32],
    ) {
        let scan_period_s = if fast { 250e-6 } else { 1e-3 };
        let (blocks, tolerances): (Vec<_>, Vec<PathTolerance>) = blocks.into_iter().unzip();
        let mut elements = elements_of(&blocks);
        for element in &mut elements {
            element.tolerance = tolerances[element.line as usize - 1];
        }
        any_run(elements, &events, limits(scan_period_s), 8, braking_setpoints_max, None)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: size::number("CASES", 30, 60) as u32, ..ProptestConfig::default() })]

    #[test]
    fn no_axis_is_over_its_jerk_at_any_scan_whatever_the_operator_and_the_planner_do(
        blocks in prop::collection::vec((any_block(), any_tolerance()), 1..14),
        events in prop::collection::vec(any_event(), 0..400),
        fast in any::<bool>(),
        jerk_per_s in scaled(12.0, 400.0),
        vibration_hz in prop::option::of(20.0..200.0f64),
        braking_setpoints in prop_oneof![3 => Just(900u32), 1 => 12..200u32],
    ) {
        let scan_period_s = if fast { 250e-6 } else { 1e-3 };
        let limits = limits_with_jerk(scan_period_s, jerk_per_s, vibration_hz);
        let braking_setpoints_max = braking_setpoints + limits.smoothing_scans();
        let (blocks, tolerances): (Vec<_>, Vec<PathTolerance>) = blocks.into_iter().unzip();
        let mut elements = elements_of(&blocks);
        for element in &mut elements {
            element.tolerance = tolerances[element.line as usize - 1];
        }
        any_run(elements, &events, limits, 8, braking_setpoints_max, None)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 200,
        max_global_rejects: 100_000,
        ..ProptestConfig::default()
    })]

    /// The same where an arm is in for Y: its speed and acceleration, and those of the slide with its correction.
    #[test]
    fn no_axis_of_a_machine_with_an_arm_is_over_a_limit_at_any_scan(
        blocks in prop::collection::vec(any_block(), 1..8),
        events in prop::collection::vec(any_event(), 0..200),
        fast in any::<bool>(),
        arm_length_mm in 40.0..300.0f64,
        carries in prop_oneof![Just(Carries::Arm), Just(Carries::Work)],
    ) {
        let scan_period_s = if fast { 250e-6 } else { 1e-3 };
        let pivot = PivotY {
            slide: 0,
            arm: 1,
            arm_length_mm,
            arm_min_deg: -75.0,
            arm_max_deg: 75.0,
            carries,
        };
        let setpoints = SetpointSettings {
            kinematics: Kinematics::PivotY(pivot),
            ..SetpointSettings::default()
        };
        let limits = limits_of_setpoints(scan_period_s, setpoints, WITH_ARM);
        any_run(elements_of(&blocks), &events, limits, 8, 900, None)?;
    }
}

#[test]
fn an_arm_goes_there_and_back_on_an_arc_of_a_micrometre() {
    let arc = Block::TangentArc {
        radius_mm: 0.0014440074103410324,
        sweep_rad: 2.5352639218610435,
    };
    let kinks = Block::Kinks {
        count: 1,
        step_mm: 1.0,
        turn_rad: -0.10811223450500149,
    };
    let blocks = [arc, Block::Back, kinks].map(|block| (block, Feed::Rapid));
    let pivot = PivotY {
        slide: 0,
        arm: 1,
        arm_length_mm: 63.55527576305522,
        arm_min_deg: -75.0,
        arm_max_deg: 75.0,
        carries: Carries::Arm,
    };
    let setpoints = SetpointSettings {
        kinematics: Kinematics::PivotY(pivot),
        ..SetpointSettings::default()
    };
    let limits = limits_of_setpoints(1e-3, setpoints, WITH_ARM);
    any_run(elements_of(&blocks), &[], limits, 8, 900, None).unwrap();
}

fn increments_of(position: &AxisVector) -> [i64; PATH_AXES] {
    limits(1e-3).increments(position)
}

#[test]
fn a_long_line_takes_the_time_of_its_trapezoid() {
    for scan_period_s in [250e-6, 1e-3] {
        let mut planner = planner(
            vec![Element::line(
                1,
                at(&[]),
                at(&[200.0]),
                Feed::PathMmS(100.0),
            )],
            scan_period_s,
            64,
        );
        let (totals, setpoints) = walk(&mut planner, 64);
        // Rounding to increments takes 2.5 of them per scan² from the acceleration: 2 % at 250 µs and 1 nm.
        let bearable_mm_s2 = 2000.0 - 2.5e-6 / (scan_period_s * scan_period_s);
        let ideal_s = 200.0 / 100.0 + 100.0 / bearable_mm_s2;
        let late_scans = (totals.time_s - ideal_s) / scan_period_s;
        assert!((-1e-6..=1.0).contains(&late_scans), "{late_scans}");
        assert_eq!(
            setpoints.last().unwrap().position_increments[0],
            200_000_000
        );
        assert!((totals.distance_mm - 200.0).abs() < 1e-9);
    }
}

#[test]
fn a_circle_runs_at_its_feed_and_ends_where_it_began() {
    for scan_period_s in [250e-6, 1e-3] {
        let turn_rad = std::f64::consts::TAU;
        let circle = Element::arc(1, at(&[25.0]), at(&[25.0]), at(&[]), [0, 1], turn_rad, FEED);
        let mut planner = planner(vec![circle], scan_period_s, 64);
        let (totals, setpoints) = walk(&mut planner, 64);
        assert_eq!(
            setpoints.last().unwrap().position_increments,
            increments_of(&at(&[25.0]))
        );
        let ideal_s = turn_rad * 25.0 / 50.0;
        assert!(totals.time_s - ideal_s < 0.05, "{totals:?}");
    }
}

#[test]
fn rounding_of_tangent_junctions_costs_no_time() {
    // 1 mm lines whose ends are off by half of the last place that a post-processor writes.
    for scan_period_s in [250e-6, 1e-3] {
        let points: Vec<AxisVector> = (0..=100)
            .map(|index| at(&[f64::from(index), if index % 2 == 0 { 0.0 } else { 5e-5 }]))
            .collect();
        let mut rough = planner(polyline(&points, FEED), scan_period_s, 64);
        let mut smooth = planner(polyline(&[points[0], points[100]], FEED), scan_period_s, 64);
        let (rough, smooth) = (walk(&mut rough, 64).0, walk(&mut smooth, 64).0);
        assert!(
            rough.time_s - smooth.time_s <= 3.0 * scan_period_s,
            "{} {}",
            rough.time_s,
            smooth.time_s
        );
    }
}

#[test]
fn a_contour_of_ten_thousand_short_lines_runs_near_the_speed_of_its_curve() {
    for scan_period_s in [250e-6, 1e-3] {
        // Circle of 20 mm in chords of 0.05 mm; the curve itself would bear sqrt(0.8·2000·20) = 179 mm/s.
        let step_rad = 0.05 / 20.0;
        let points: Vec<AxisVector> = (0..=10_000)
            .map(|index| {
                let angle_rad = step_rad * f64::from(index);
                at(&[20.0 * libm::cos(angle_rad), 20.0 * libm::sin(angle_rad)])
            })
            .collect();
        let mut planner = planner(polyline(&points, Feed::PathMmS(200.0)), scan_period_s, 64);
        let (totals, setpoints) = walk(&mut planner, 64);
        let mean_mm_s = totals.distance_mm / totals.time_s;
        println!(
            "{scan_period_s} s: mean {mean_mm_s:.1} mm/s, {} segments, shares {:.3?}",
            planner.speed_map().segment_count(),
            &totals.shares.acceleration[..2]
        );
        assert!(mean_mm_s > 100.0, "{mean_mm_s}");
        let places = setpoints
            .windows(2)
            .map(|pair| (pair[0].state, pair[1].state));
        assert!(
            places
                .clone()
                .all(|(a, b)| (a.element, a.distance_mm) <= (b.element, b.distance_mm))
        );
    }
}

#[test]
fn a_dwell_waits_at_least_its_time_exactly_at_its_place() {
    let elements = vec![
        Element::line(1, at(&[]), at(&[10.0]), FEED),
        Element::dwell(2, at(&[10.0]), 0.0205),
        Element::line(3, at(&[10.0]), at(&[20.0]), FEED),
    ];
    let (_, setpoints) = walk(&mut planner(elements, 1e-3, 64), 16);
    let waiting = setpoints
        .iter()
        .filter(|setpoint| setpoint.position_increments[0] == 10_000_000);
    let remaining: Vec<u32> = waiting
        .map(|setpoint| setpoint.state.dwell_remaining_scans)
        .collect();
    assert_eq!(remaining, (0..=21).rev().collect::<Vec<u32>>());
}

#[test]
fn the_number_of_setpoints_in_a_window_changes_no_setpoint() {
    let blocks = [
        (Block::Line([30.0, 5.0, 0.0]), FEED),
        (
            Block::TangentArc {
                radius_mm: 3.0,
                sweep_rad: 2.0,
            },
            Feed::Rapid,
        ),
        (
            Block::Kinks {
                count: 150,
                step_mm: 0.02,
                turn_rad: 0.01,
            },
            FEED,
        ),
        (Block::Back, FEED),
    ];
    let setpoints = |setpoints_per_window| {
        walk(
            &mut planner(elements_of(&blocks), 1e-3, 1000),
            setpoints_per_window,
        )
        .1
    };
    assert_eq!(setpoints(1), setpoints(4));
    assert_eq!(setpoints(4), setpoints(1000));
}

#[test]
fn single_block_waits_exactly_at_the_end_of_each_block_until_it_is_started() {
    // A corner, and blocks in one line.
    let points = [
        at(&[]),
        at(&[5.0]),
        at(&[5.0, 5.0]),
        at(&[5.0, 7.0]),
        at(&[5.0, 9.0]),
    ];
    let mut planner = planner(polyline(&points, FEED), 1e-3, 2000);
    let mut audit = SetpointAudit::at_rest(planner.limits().clone(), increments_of(&points[0]));
    let mut setpoints = Vec::new();
    let mut state = PathState::default();
    for (index, end) in points.iter().enumerate().skip(1) {
        let mut request = WindowRequest {
            intended_setpoints: 2000,
            single_block: true,
            ..WindowRequest::default()
        };
        if index > 1 {
            planner.plan(&state, &request, &mut setpoints).unwrap();
            assert!(
                setpoints.iter().all(|setpoint| setpoint.state == state),
                "it waits"
            );
        }
        request.start = true;
        let outcome = planner.plan(&state, &request, &mut setpoints).unwrap();
        let last_block = index + 1 == points.len();
        assert_eq!(outcome.ends_program, last_block);
        for setpoint in &setpoints {
            audit.setpoint(&setpoint.position_increments).unwrap();
        }
        let last = setpoints.last().unwrap();
        assert_eq!(last.position_increments, increments_of(end));
        assert_eq!(last.state.waits_for_start, !last_block);
        state = last.state;
    }
}

#[test]
fn a_hold_brakes_at_once_and_a_release_goes_on_to_the_end() {
    let mut planner = planner(
        vec![Element::line(1, at(&[]), at(&[100.0]), FEED)],
        1e-3,
        400,
    );
    let mut setpoints = Vec::new();
    let mut request = WindowRequest {
        intended_setpoints: 400,
        ..WindowRequest::default()
    };
    planner
        .plan(&PathState::default(), &request, &mut setpoints)
        .unwrap();
    let moving = setpoints[299].state;
    assert_eq!(moving.speed_mm_s, 50.0);
    request.hold = true;
    planner.plan(&moving, &request, &mut setpoints).unwrap();
    let at_rest = setpoints
        .iter()
        .position(|setpoint| setpoint.state.is_at_rest())
        .unwrap();
    assert!((25..=26).contains(&at_rest), "{at_rest}");
    request.hold = false;
    let held = setpoints[399].state;
    request.intended_setpoints = 400;
    let mut from = held;
    for _ in 0..10 {
        if planner
            .plan(&from, &request, &mut setpoints)
            .unwrap()
            .ends_program
        {
            break;
        }
        from = setpoints[399].state;
    }
    assert_eq!(
        setpoints.last().unwrap().position_increments[0],
        100_000_000
    );
}

#[test]
fn a_speed_whose_braking_does_not_fit_the_window_is_limited_and_named() {
    let fast = vec![Element::line(1, at(&[]), at(&[200.0]), Feed::Rapid)];
    let short = WindowSettings {
        intended_setpoints_max: 16,
        braking_setpoints_max: 63,
        override_max: 1.0,
        elements_per_s_max: f64::INFINITY,
    };
    let mut planner =
        WindowPlanner::with_positioning(Path { elements: fast }, limits(1e-3), short, None)
            .unwrap();
    let limited = planner.speed_map().speed_limited_by_window_mm_s().unwrap();
    // 60 scans of braking at 2000 mm/s².
    assert!((limited - 120.0).abs() < 0.5, "{limited}");
    let (totals, _) = walk(&mut planner, 16);
    assert_eq!(totals.speed_limited_by_window_mm_s, Some(limited));
}

#[test]
fn a_restarted_planner_goes_on_from_the_tag_of_any_setpoint() {
    let elements = vec![
        Element::line(1, at(&[]), at(&[10.0]), FEED),
        Element::dwell(2, at(&[10.0]), 0.02),
        Element::line(3, at(&[10.0]), at(&[10.0, 8.0]), FEED),
    ];
    let mut planner = planner(elements, 1e-3, 4000);
    let (_, setpoints) = walk(&mut planner, 8);
    let mut window = Vec::new();
    for setpoint in &setpoints {
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
        assert_eq!(window[0].position_increments, setpoint.position_increments);
        assert_eq!(
            window.last().unwrap().position_increments,
            setpoints.last().unwrap().position_increments
        );
    }
    assert_eq!(PathState::resume(planner.path(), 3, 0.0, 0), None);
    assert_eq!(PathState::resume(planner.path(), 0, 10.1, 0), None);
    assert_eq!(PathState::resume(planner.path(), 0, f64::NAN, 0), None);
}

#[test]
fn states_off_the_path_are_refused() {
    let mut planner = planner(vec![Element::line(1, at(&[]), at(&[10.0]), FEED)], 1e-3, 40);
    let mut setpoints = Vec::new();
    let request = WindowRequest {
        intended_setpoints: 40,
        ..WindowRequest::default()
    };
    for (element, distance_mm, speed_mm_s) in [
        (1, 0.0, 0.0),
        (0, -1.0, 0.0),
        (0, f64::NAN, 0.0),
        (0, 1.0, f64::NAN),
    ] {
        let from = PathState {
            element,
            distance_mm,
            speed_mm_s,
            ..PathState::default()
        };
        assert!(matches!(
            planner.plan(&from, &request, &mut setpoints),
            Err(PlanError::State { .. })
        ));
    }
}

#[test]
fn the_audit_sees_a_row_one_increment_over_a_limit() {
    let slide = AxisLimits {
        velocity_mm_s: 1.0005,
        acceleration_mm_s2: 1000.5,
        jerk_mm_s3: f64::INFINITY,
        increment_mm: 1e-6,
    };
    let mut audit =
        SetpointAudit::at_rest(MotionLimits::new(&[slide], 1e-3).unwrap(), [0; PATH_AXES]);
    assert!(audit.setpoint(&[1000, 0, 0, 0, 0, 0, 0, 0, 0]).is_ok());
    assert!(audit.setpoint(&[2001, 0, 0, 0, 0, 0, 0, 0, 0]).is_err());
    let mut audit =
        SetpointAudit::at_rest(MotionLimits::new(&[slide], 1e-3).unwrap(), [0; PATH_AXES]);
    assert!(audit.setpoint(&[600, 0, 0, 0, 0, 0, 0, 0, 0]).is_ok());
    assert!(audit.setpoint(&[-401, 0, 0, 0, 0, 0, 0, 0, 0]).is_err());
    let path = Path {
        elements: vec![Element::line(1, at(&[]), at(&[10.0]), FEED)],
    };
    let limits = MotionLimits::new(&[slide], 1e-3).unwrap();
    let path = PathPart::whole(&path, &limits, 1.0).unwrap();
    let mut audit = SetpointAudit::at_rest(limits, [500; PATH_AXES]);
    audit.setpoint(&[500; PATH_AXES]).unwrap();
    assert!(audit.place(&path, 0, 500.9e-6).is_ok());
    assert!(audit.place(&path, 0, 501.1e-6).is_err());
    assert!(audit.place(&path, 1, 0.0).is_err());
}

/// `cargo test -p path --release windows -- --ignored --nocapture`
#[test]
#[ignore = "measures, proves nothing"]
fn time_of_planning_one_window() {
    let turn_rad = 10.0 * std::f64::consts::TAU;
    let circle = vec![Element::arc(
        1,
        at(&[25.0]),
        at(&[25.0]),
        at(&[]),
        [0, 1],
        turn_rad,
        Feed::PathMmS(150.0),
    )];
    let line = vec![Element::line(1, at(&[]), at(&[450.0]), Feed::Rapid)];
    let chords: Vec<AxisVector> = (0..=200_000)
        .map(|index| {
            at(&[
                20.0 * libm::cos(0.0025 * f64::from(index)),
                20.0 * libm::sin(0.0025 * f64::from(index)),
            ])
        })
        .collect();
    let contour = polyline(&chords, Feed::PathMmS(150.0));
    for (name, elements) in [("circle", circle), ("line", line), ("contour", contour)] {
        for (scan_period_s, intended_setpoints) in [(1e-3, 32u32), (250e-6, 32)] {
            let elements = elements.clone();
            let before = std::time::Instant::now();
            let mut planner = planner(elements, scan_period_s, intended_setpoints);
            let build_ms = before.elapsed().as_secs_f64() * 1e3;
            let mut setpoints = Vec::with_capacity(planner.setpoints_max());
            let mut from = PathState::default();
            let request = WindowRequest {
                intended_setpoints,
                ..WindowRequest::default()
            };
            let (mut windows, mut planned, mut worst_us) = (0u32, 0u64, 0.0f64);
            let start = std::time::Instant::now();
            loop {
                let one = std::time::Instant::now();
                let outcome = planner.plan(&from, &request, &mut setpoints).unwrap();
                worst_us = worst_us.max(one.elapsed().as_secs_f64() * 1e6);
                windows += 1;
                planned += u64::from(outcome.setpoint_count);
                if outcome.ends_program || windows > 2000 {
                    break;
                }
                from = setpoints[7].state;
            }
            let mean_us = start.elapsed().as_secs_f64() * 1e6 / f64::from(windows);
            println!(
                "{name} at {scan_period_s} s: map {build_ms:.2} ms of {} segments; {windows} windows of {} setpoints: mean {mean_us:.1} µs, worst {worst_us:.1} µs",
                planner.speed_map().segment_count(),
                planned / u64::from(windows),
            );
        }
    }
}

#[test]
fn the_time_to_the_end_is_known_without_planning_every_scan() {
    let slow = Feed::PathMmS(1e-5);
    let elements = vec![
        Element::line(1, at(&[]), at(&[30.0, 10.0]), Feed::Rapid),
        Element::dwell(2, at(&[30.0, 10.0]), 0.3),
        arc(
            3,
            at(&[30.0, 10.0]),
            5.0,
            2.0,
            1.0,
            [0, 1],
            0.0,
            Feed::PathMmS(50.0),
        ),
    ];
    let end = elements[2].end();
    let mut quick = planner(elements.clone(), 1e-3, 64);
    let scan_by_scan = walk(&mut quick, 8).0;
    let time_s = quick.time_to_end_s(&quick.start_state(), 1.0).unwrap();
    let off_s = (time_s - scan_by_scan.time_s).abs();
    assert!(off_s < 4e-3, "{time_s} {}", scan_by_scan.time_s);
    let mut long = elements;
    long.push(Element::dwell(4, end, 4e6));
    long.push(Element::line(5, end, end + at(&[10.0]), slow));
    let mut planner = planner(long, 1e-3, 64);
    let walk = ProgramWalk {
        setpoints_max: 1000,
        feed_override: 1.0,
        setpoints_per_window: 8,
    };
    let totals = walk
        .walk(&mut planner, |_, _| ControlFlow::Continue(()))
        .unwrap();
    assert!(
        (totals.time_s - 5e6 - time_s).abs() < 1.0,
        "{}",
        totals.time_s
    );
    assert!(totals.complete && totals.judged_setpoints < 1100);
}

/// What a move leaves of a vibration without damping, in mm: of a mass on a spring that the setpoints move.
fn left_vibration_mm(positions_mm: &[f64], scan_period_s: f64, frequency_hz: f64) -> f64 {
    let angular = std::f64::consts::TAU * frequency_hz;
    let (mut cosine, mut sine) = (0.0, 0.0);
    for (index, three) in positions_mm.windows(3).enumerate() {
        // An impulse of acceleration leaves a vibration of its own phase.
        let impulse_mm_s = (three[2] - 2.0 * three[1] + three[0]) / scan_period_s;
        let phase = angular * index as f64 * scan_period_s;
        cosine += impulse_mm_s * phase.cos();
        sine += impulse_mm_s * phase.sin();
    }
    f64::hypot(cosine, sine) / angular
}

#[test]
fn a_move_along_a_line_does_not_excite_the_frequency_that_is_to_be_spared() {
    for scan_period_s in [1e-3, 250e-6] {
        let mut left = Vec::new();
        for vibration_hz in [None, Some(65.0)] {
            let line = vec![Element::line(1, at(&[]), at(&[20.0, 0.0]), Feed::Rapid)];
            let limits = limits_with_jerk(scan_period_s, f64::INFINITY, vibration_hz);
            let path = Path { elements: line };
            let mut planner =
                WindowPlanner::with_positioning(path, limits, settings(32), None).unwrap();
            let (_, setpoints) = walk(&mut planner, 8);
            let places = setpoints.iter().map(|of| of.position_increments[0] as f64);
            let last = setpoints.last().unwrap().position_increments[0] as f64;
            let places: Vec<f64> = [0.0, 0.0]
                .into_iter()
                .chain(places)
                .chain([last, last])
                .map(|increments| increments * 1e-8)
                .collect();
            left.push(left_vibration_mm(&places, scan_period_s, 65.0));
        }
        // A whole number of scans is near a period of 15.4 ms, not one.
        let most = if scan_period_s > 5e-4 { 0.05 } else { 0.02 };
        assert!(left[1] < most * left[0], "{left:?} at {scan_period_s} s");
    }
}
