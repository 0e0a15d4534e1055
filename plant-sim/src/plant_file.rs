//! The plant file: what is true of the simulated machine, and the controller must not know.
//!
//! `plant.toml` beside `machine.toml`; read once and checked as a whole. Source of the reference values: docs/methods/physics.md §3.

mod keys;
mod load;
mod parameters;
mod rules;
#[cfg(test)]
mod tests;

pub use keys::{
    MotorFriction, PlantAxis, PlantDrive, PlantFile, PlantMotor, PlantScale, PlantScrew,
    PlantSpindle, PlantTable, PlantToolChanger, TableFriction,
};
pub use load::{reference, schema};
