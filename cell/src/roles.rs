//! Each role hands its options to its crate.

use std::time::Duration;

use console::exit::{Kind, Outcome};
use console::logs;
use machine::Machine;
use plant_sim::script::orders;
use plant_sim::script::ports::ScriptedPorts;

use crate::options::{
    FieldbusOptions, LogicOptions, MasterOptions, PlannerOptions, PlantSimOptions, RecorderOptions,
    Role, ServoOptions,
};

/// Takes part in a cell until that ends.
///
/// # Errors
/// The process cannot take part, or cannot go on.
pub fn take_part(role: &Role) -> Outcome {
    logs::init_role();
    match role {
        Role::PlantSim(options) => plant_sim(options),
        Role::Master(options) => master(options),
        Role::Fieldbus(options) => fieldbus(options),
        Role::Planner(options) => planner(options),
        Role::Servo(options) => servo(options),
        Role::Logic(options) => logic(options),
        Role::Recorder(options) => recorder(options),
    }
}

/// The master over simulated drives.
fn plant_sim(options: &PlantSimOptions) -> Outcome {
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
fn master(options: &MasterOptions) -> Outcome {
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
fn fieldbus(options: &FieldbusOptions) -> Outcome {
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
fn planner(options: &PlannerOptions) -> Outcome {
    planner::run(&options.options()).environment()
}

/// One servo.
fn servo(options: &ServoOptions) -> Outcome {
    servo::run(&options.options()).environment()
}

/// What asks the logic of the machine.
fn logic(options: &LogicOptions) -> Outcome {
    logic::run(&logic::Options {
        slot: options.slot.slot(),
        answer_limit: Duration::from_secs(options.answer_limit),
    })
    .environment()
}

/// The recorder.
fn recorder(options: &RecorderOptions) -> Outcome {
    monitor::run(&monitor::Options {
        slot: options.slot.slot(),
        out: options.out.clone(),
        program: options.program.clone(),
        level: options.level,
    })
    .environment()
}
