//! How long motions by hand take beside the shortest that there are: rsruckig, another planner of time-optimal motions, is the judge.

use loops::hand_course::{Aim, FINE, HandCourse, fine};
use loops::jog::JogProfile;
use plant_sim::script::rng::Rng;
use rsruckig::prelude::*;

/// Increments in a scan, and in a scan per scan, of 1 nm in 1 ms: 10 mm/s and 400 mm/s².
const STEP_MAX: f64 = 10_000.0;
const CHANGE_MAX: f64 = 400.0;

/// Scans of the shortest motion from a place at a speed to a goal at rest.
fn shortest(place: f64, speed: f64, acceleration: f64, goal: f64, jerk: f64) -> f64 {
    let mut planner = Ruckig::<1, ThrowErrorHandler>::new(None, 1.0);
    let mut input = InputParameter::new(None);
    input.current_position[0] = place;
    input.current_velocity[0] = speed;
    input.current_acceleration[0] = acceleration;
    input.target_position[0] = goal;
    input.max_velocity[0] = STEP_MAX;
    input.max_acceleration[0] = CHANGE_MAX;
    input.max_jerk[0] = jerk;
    let mut trajectory = Trajectory::new(None);
    planner
        .calculate(&input, &mut trajectory)
        .expect("a motion");
    trajectory.get_duration()
}

/// Ours: the most that it took longer, in scans, and in shares of the shortest time for ways of more than 100 scans.
fn longer(jerk: Option<f64>, aims: u64) -> (f64, f64) {
    let mut random = Rng::new(3);
    let mut course = HandCourse::at(0);
    let part = FINE as f64;
    let limit = JogProfile::new(1, (CHANGE_MAX * part) as i64, jerk.map(|jerk| jerk * part));
    course.limit(&limit);
    let mut most = (0.0f64, 0.0f64);
    for _ in 0..aims {
        let goal = random.between(-2e6, 2e6).round() as i64;
        let before = course;
        let step_max = (STEP_MAX * part) as i64;
        course.change(
            Aim {
                goal: fine(goal),
                step_max,
            },
            1,
        );
        let last = before.advanced();
        let acceleration = (last.step - before.step) as f64 / part;
        let [place, speed] = [before.motion.command, before.step].map(|of| of as f64 / part);
        // Without a limit of jerk there is no acceleration to be led down.
        let acceleration = jerk.map_or(0.0, |_| acceleration.clamp(-CHANGE_MAX, CHANGE_MAX));
        let best = shortest(
            place,
            speed,
            acceleration,
            goal as f64,
            jerk.unwrap_or(f64::INFINITY),
        );
        // Half of them are changed on the way.
        let mut changed = course;
        let mut scans = 0.0;
        while !changed.rests() {
            changed = changed.advanced();
            scans += 1.0;
        }
        assert_eq!(changed.place(), goal);
        most.0 = most.0.max(scans - best);
        if best > 100.0 {
            most.1 = most.1.max(scans / best - 1.0);
        }
        let stays = random.below(2 * scans as u64 + 1);
        for _ in 0..stays {
            course = course.advanced();
        }
    }
    most
}

#[test]
fn without_a_limit_of_jerk_motions_by_hand_are_the_shortest_that_there_are() {
    let (scans, share) = longer(None, 2_000);
    println!("at most {scans:.1} scans, {:.1} % longer", 100.0 * share);
    assert!(scans <= 3.0, "{scans}");
}

#[test]
fn with_a_limit_of_jerk_they_take_twelve_time_constants_longer_at_most() {
    for jerk in [20.0, 80.0, 400.0] {
        let (scans, share) = longer(Some(jerk), 1_000);
        println!(
            "jerk {jerk}: at most {scans:.1} scans, {:.1} % longer",
            100.0 * share
        );
        // The filter behind the trapezoid has a time constant of 2·a/j, and comes to within a part of an increment in twelve of them.
        assert!(scans <= 24.0 * CHANGE_MAX / jerk + 4.0, "{jerk}: {scans}");
    }
}
