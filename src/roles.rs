//! The roles as subcommands: each hands its options to its crate.

use std::time::Duration;

use crate::cli::{PlannerOptions, PlantSimOptions, RecorderOptions, ServoOptions};
use crate::exit::{Failure, Kind, Outcome};
use crate::{logs, metrics};

/// The machine side.
pub fn plant_sim(options: &PlantSimOptions) -> Outcome {
    logs::init_role();
    let run_end = if options.end_after_program {
        plant_sim::RunEnd::AfterProgram
    } else {
        plant_sim::RunEnd::WhenTold
    };
    plant_sim::run(&plant_sim::Options {
        seat: options.seat.seat(),
        plant: options.plant.clone(),
        enabled: options.enabled,
        run_end,
        orders: options.orders.clone(),
        faults: options.faults.clone(),
        fault_blocks: fault_blocks(&options.fault_block),
        answer_limit: Duration::from_secs(options.answer_limit),
    })
    .environment()
}

/// Pairs of a block's line and its first element.
fn fault_blocks(pairs: &[String]) -> Vec<(u32, u32)> {
    let pair = |text: &String| {
        let (line, element) = text.split_once('=')?;
        Some((line.parse().ok()?, element.parse().ok()?))
    };
    pairs.iter().filter_map(pair).collect()
}

/// The planner.
pub fn planner(options: &PlannerOptions) -> Outcome {
    logs::init_role();
    planner::run(&planner::Options {
        seat: options.seat.seat(),
        program: options.program.clone(),
        faults: options.faults.clone(),
    })
    .environment()
}

/// One servo.
pub fn servo(options: &ServoOptions) -> Outcome {
    logs::init_role();
    servo::run(&servo::Options {
        seat: options.seat.seat(),
        axis: options.axis.clone(),
        role: u32::from(options.role == "b"),
        faults: options.faults.clone(),
    })
    .map_err(|e| Failure::Environment(e.into()))
}

/// The recorder.
pub fn recorder(options: &RecorderOptions) -> Outcome {
    logs::init_role();
    let mut watch = None;
    if options.metrics {
        let listener = metrics::inherited().environment()?;
        let (out, program) = (options.out.clone(), options.program.clone());
        watch = Some(metrics::Watch::new(listener, out, program));
    }
    let options = monitor::Options {
        seat: options.seat.seat(),
        out: options.out.clone(),
        program: options.program.clone(),
    };
    let tap = watch.as_mut().map(|watch| watch as &mut dyn monitor::Tap);
    monitor::run(&options, tap).environment()
}
