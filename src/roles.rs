//! The roles as subcommands: each hands its options to its crate.

use std::time::Duration;

use console::exit::{Kind, Outcome};
use console::logs;
use machine::Machine;
use plant_sim::script::orders;
use plant_sim::script::ports::ScriptedPorts;
use view::metrics;

use crate::cli::{
    FieldbusOptions, MasterOptions, PlannerOptions, PlantSimOptions, RecorderOptions, ServoOptions,
};

/// The master over simulated drives.
///
/// # Errors
/// It cannot take part, or cannot go on.
pub fn plant_sim(options: &PlantSimOptions) -> Outcome {
    logs::init_role();
    plant_sim::run(&plant_sim::Options {
        plant: options.plant.clone(),
        master: options.master.options(),
        orders: options.master.orders.clone(),
        faults: options.master.faults.clone(),
        fault_blocks: fault_blocks(&options.master.fault_block),
    })
    .environment()
}

/// The master over drives on a fieldbus.
///
/// # Errors
/// It cannot take part, or cannot go on.
pub fn master(options: &MasterOptions) -> Outcome {
    logs::init_role();
    let mut machine = Machine::load(&options.slot.slot().machine).environment()?;
    let blocks = fault_blocks(&options.fault_block);
    let faults = options.faults.as_deref();
    let faults = plant_sim::run::load_faults(faults, &blocks, &mut machine).environment()?;
    let orders = options.orders.as_deref();
    let orders = orders.map(|path| orders::load(path, &machine));
    let orders = orders.transpose().environment()?.unwrap_or_default();
    fieldbus::master_process::run(&options.options(), &machine, |ports, first_scan| {
        ScriptedPorts::new(ports, faults, orders, first_scan)
    })
    .environment()
}

/// The owner of the fieldbus, or its standby.
///
/// # Errors
/// It cannot take part, or the drives do not.
pub fn fieldbus(options: &FieldbusOptions) -> Outcome {
    logs::init_role();
    fieldbus::process::run(&fieldbus::process::Options {
        slot: options.slot.slot(),
        answer_limit: Duration::from_secs(options.answer_limit),
    })
    .environment()
}

impl MasterOptions {
    fn options(&self) -> master::Options {
        master::Options {
            slot: self.slot.slot(),
            enabled: self.enabled,
            run_end: if self.end_after_program {
                master::RunEnd::AfterProgram
            } else {
                master::RunEnd::WhenOrdered
            },
            beginning: master::Beginning {
                single_block: self.single_block,
                start_line: self.start_line,
            },
            answer_limit: Duration::from_secs(self.answer_limit),
        }
    }
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
        records: !options.no_log,
    };
    let tap = watch.as_mut().map(|watch| watch as &mut dyn monitor::Tap);
    monitor::run(&options, tap).environment()
}
