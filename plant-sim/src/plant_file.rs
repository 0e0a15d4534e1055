//! The plant file: what is true of the simulated machine, and the controller must not know.
//!
//! `plant.toml` beside `machine.toml`; read once and checked as a whole. Source of the reference values: docs/methods/physics.md §3.

mod keys;
mod load;
mod parameters;
mod rules;
mod simple;
#[cfg(test)]
mod tests;

pub use crate::cutting::PlantCutting;
pub use crate::friction::PlantLaw;
pub use crate::holding_brake::PlantBrake;
pub use crate::variation::PlantVariation;
pub use keys::{
    Actuated, BODIES_MAX, INPUT_LINES_MAX, MotorFriction, PlantAttachedMass, PlantAxis, PlantBox,
    PlantBridge, PlantContact, PlantCrossTalk, PlantCylinder, PlantDrive, PlantDriveHoming,
    PlantEncoder, PlantFile, PlantFrame, PlantGravity, PlantHomeSwitch, PlantInput,
    PlantMeasuredFriction, PlantMeasurement, PlantMotor, PlantPitchError, PlantPlane, PlantProbe,
    PlantScale, PlantScrew, PlantSimple, PlantSphere, PlantSpindle, PlantTable, PlantToolChanger,
    TableFriction,
};
pub use load::schema;
