//! The machine file: what the controller knows of its machine.
//!
//! `machine.toml` is read once, checked as a whole before anything starts, and shared by every process of the cell. What is
//! true of the simulated machine is in `plant.toml`, which only the master reads.
//!
//! Each key is declared once, as a field of a struct with its meaning, unit, range and default ([`settings_file`] says how); the
//! struct of the whole file is [`Machine`]. Rules that relate several keys are in `rules`.
//!
//! Slides are in mm. Rotary axes are in degrees, and share the code of slides: their keys (`rapid_deg_s`) become those of a slide that
//! stands for them (`rapid_mm_s`) when the file is read. What forces and masses mean there: docs/methods/pivot-axis.md.

mod alarms;
mod auxiliary;
mod axis;
mod axis_kind;
mod beginning;
mod begins_with;
mod dialect;
mod error_file;
mod fieldbus;
mod gantry;
mod gantry_pair;
mod geometry;
mod geometry_terms;
mod homing;
mod interpolation;
mod kept;
mod kept_files;
mod kinematics;
pub mod learned;
pub mod learned_path;
mod load;
mod log_keeping;
mod logic;
mod loops;
mod machine;
mod manual;
pub mod model;
pub mod offsets_file;
mod parameter_file;
mod path;
mod positioning;
mod process;
mod processes;
mod renamed;
mod restart;
mod reversal;
mod rotary_line;
mod rules;
pub mod settings_file;
mod signals;
mod tool_table;
pub mod tools_file;
pub mod transmission;
mod weight;
mod whole_file;

pub use alarms::{Alarm, AlarmReaction};
pub use auxiliary::{SPINDLE_RAMP_SHARE, Spindle, ToolChange, ToolChanger};
pub use axis::{
    Axis, Changeover, DriveMode, Motor, PositionFeedback, TURN_DEG, axis_names, is_letter,
};
pub use axis_kind::AxisKind;
pub use beginning::{Beginning, MODES_OF_END, SPINDLE_FILE};
pub use dialect::{DecimalPoint, Dialect};
pub use fieldbus::{
    AXES_OF_DRIVE_MAX, AxisDrive, Fieldbus, ProbeEdge, SpindleDrive, Sync, Terminal,
};
pub use gantry::{Gantry, SECOND_MOTOR};
pub use gantry_pair::GantryPair;
pub use geometry::{
    AxisCompensation, ERROR_POINTS_MAX, ErrorTable, GeometryTerm, Squareness, Steepness,
    Straightness,
};
pub use homing::{Homing, HomingDirection, HomingMethod, INDEX_TURNS, JOG_ACCELERATION_SHARE};
pub use interpolation::{Interpolation, StraightLines, WithinPeriod};
pub use kept::{KeptTexts, OFFSETS_FILE, TOOLS_FILE, keep_tool, update_offsets, update_tools};
pub use kept_files::KeptFiles;
pub use kinematics::{Carries, Kinematics, KinematicsKind};
pub use load::{copy_named_files, machine_file, schema, snapshot, with_kept};
pub use log_keeping::{LogKeeping, LogLevel};
pub use logic::{Logic, OnLogicLoss};
pub use loops::{FeedForward, PREDICTION_M_MIN, PositionLoop, Prediction, VelocityLoop};
pub use machine::{DEAD_TIME_SCANS_MAX, Machine, ProgramSettings, Scan};
pub use manual::{Increment, Manual};
pub use model::{Adaptation, AdaptationMode, AxisModel, DisturbanceObserver, TorqueFeedForward};
pub use parameter_file::{KeptParameters, is_always_kept, parameter_text, parse_parameters};
pub use path::PathSettings;
pub use positioning::{Positioning, RapidProfile};
pub use process::Process;
pub use processes::Processes;
pub use restart::{AfterLoss, AfterMaster, AfterMonitor, AfterStandby, Restart};
pub use reversal::{PositionErrorPart, PulseShape, Reversal, ReversalMethod, Trigger};
pub use rotary_line::{Carried, RotaryLine};
pub use signals::{
    Functions, Handwheel, LimitSwitches, MachineCodes, MachineState, SetBy, Signal, SignalKind,
    SignalSink, SignalSource,
};
pub use tool_table::{Tool, parse_tools};
pub use weight::{Brake, BrakeBy, FREE_FALL_M_S2, Gravity};
pub use whole_file::{replace_file, replace_with};
