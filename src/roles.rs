//! The roles as subcommands: each hands its options to its crate.

use std::time::Duration;

use launcher::exit::{Kind, Outcome};
use launcher::logs;
use view::metrics;

use crate::cli::{PlannerOptions, PlantSimOptions, RecorderOptions, ServoOptions};

/// The master over simulated drives.
///
/// # Errors
/// It cannot take part, or cannot go on.
pub fn plant_sim(options: &PlantSimOptions) -> Outcome {
    logs::init_role();
    let run_end = if options.end_after_program {
        master::RunEnd::AfterProgram
    } else {
        master::RunEnd::WhenOrdered
    };
    plant_sim::run(&plant_sim::Options {
        slot: options.slot.slot(),
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
///
/// # Errors
/// It cannot take part.
pub fn planner(options: &PlannerOptions) -> Outcome {
    logs::init_role();
    planner::run(&options.options()).environment()
}

/// One servo.
///
/// # Errors
/// It cannot take part.
pub fn servo(options: &ServoOptions) -> Outcome {
    logs::init_role();
    servo::run(&options.options()).environment()
}

/// The recorder.
///
/// # Errors
/// It cannot take part, or cannot write its log.
pub fn recorder(options: &RecorderOptions) -> Outcome {
    logs::init_role();
    let mut watch = None;
    if options.metrics {
        let listener = metrics::inherited().environment()?;
        let (out, program) = (options.out.clone(), options.program.clone());
        watch = Some(metrics::Watch::new(listener, out, program));
    }
    let options = monitor::Options {
        slot: options.slot.slot(),
        out: options.out.clone(),
        program: options.program.clone(),
    };
    let tap = watch.as_mut().map(|watch| watch as &mut dyn monitor::Tap);
    monitor::run(&options, tap).environment()
}
