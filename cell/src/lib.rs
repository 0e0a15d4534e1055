//! The processes of a running cell, as subcommands of any command that starts one.

mod options;
mod roles;

pub use options::{
    FieldbusOptions, LogicOptions, MasterOptions, PlannerOptions, PlantSimOptions, RecorderOptions,
    Role, ServoOptions, SlotOptions,
};
pub use roles::take_part;
