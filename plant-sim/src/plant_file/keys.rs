//! The keys of the plant file, each declared once with meaning, unit and range (`machine::settings_file` says how).

use bus::sample::{ANALOG_INPUTS, DIGITAL_INPUTS, DIGITAL_OUTPUTS, MAX_AXES};
use machine::transmission::Transmission;
use machine::{AxisKind, DEAD_TIME_SCANS_MAX};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::cutting::PlantCutting;
use crate::friction::{ELEMENTS, PlantLaw};
use crate::holding_brake::PlantBrake;
use crate::lost_motion::JENKINS_ELEMENTS;
use crate::sliding_curve::SIDE_ROWS_MAX;
use crate::variation::PlantVariation;

/// The whole plant file.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct PlantFile {
    /// Integration step of the mechanics: whole nanoseconds, a divisor of every drive period, and short enough for the stiffest spring
    /// and the fastest damping of each mass, else refused with the longest that fits.
    #[schemars(extend("unit" = "µs", "minimum" = 1, "maximum" = 250))]
    pub microstep_us: f64,
    /// Temperature around the machine.
    #[schemars(extend("unit" = "°C", "minimum" = -20, "maximum" = 60))]
    pub ambient_c: f64,
    /// What all drives have in common.
    pub drive: PlantDrive,
    /// The spindle, where the machine file has one.
    pub spindle: Option<PlantSpindle>,
    /// The tool changer, where the machine file has one (`tool_change.by = "changer"`).
    pub tool_changer: Option<PlantToolChanger>,
    /// A touch probe in the spindle, and what it can touch ([probing](../howto/probe.md)). Without this table nothing is ever touched.
    pub probe: Option<PlantProbe>,
    /// When which input changes: of all lines of an input whose time has come, the last one counts. Before, an input shows 0.
    #[serde(rename = "input")]
    #[schemars(length(max = INPUT_LINES_MAX), extend("default" = []))]
    pub inputs: Vec<PlantInput>,
    /// What a simulated drive or terminal shows at a [signal](../howto/signals.md) of the machine file: of all lines of a signal that hold,
    /// the last one counts; where none holds it shows the signal's `default`.
    #[serde(rename = "contact")]
    #[schemars(length(max = INPUT_LINES_MAX), extend("default" = []))]
    pub contacts: Vec<PlantContact>,
    /// An axis: each axis of the machine file has one here.
    #[serde(rename = "axis")]
    #[schemars(length(min = 1, max = MAX_AXES))]
    pub axes: Vec<PlantAxis>,
}

/// What all drives have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct PlantDrive {
    /// Scans from the feedback that a command answers to the scan that it acts in, as on a fieldbus; what the controller reckons
    /// with is `scan.dead_time_scans` of the [machine file](machine-file.md) ([dead time](../methods/dead-time.md)).
    #[schemars(extend("unit" = "scans", "minimum" = 1, "maximum" = DEAD_TIME_SCANS_MAX, "default" = 1))]
    pub dead_time_scans: u32,
}

/// The spindle with its drive.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, JsonSchema)]
pub struct PlantSpindle {
    /// How fast it speeds up and brakes.
    #[schemars(extend("unit" = "rev/min/s", "minimum" = 1, "maximum" = 1_000_000))]
    pub acceleration_rpm_s: f64,
    /// Speed at which it turns to an angle (M19).
    #[schemars(extend("unit" = "rev/min", "minimum" = 1, "maximum" = 1000, "default" = 60.0))]
    pub orientation_rpm: f64,
    /// Counts of its encoder in one turn; 0 for none.
    #[schemars(extend("unit" = "counts", "minimum" = 0, "maximum" = 1_000_000_000, "default" = 0))]
    pub encoder_counts_per_turn: u32,
    /// Inertia of rotor, shaft and chuck or tool. With 0 the speed is always the one on the ramp, whatever the load.
    #[schemars(extend("unit" = "kg·m²", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub inertia_kg_m2: f64,
    /// Torque that the drive has, to accelerate and against the load.
    #[schemars(extend("unit" = "N·m", "minimum" = 0.001, "maximum" = 100_000, "default" = 50.0))]
    pub torque_max_nm: f64,
    /// Bandwidth of the drive's speed loop.
    #[schemars(extend("unit" = "Hz", "minimum" = 0.1, "maximum" = 1000, "default" = 20.0))]
    pub speed_loop_hz: f64,
    /// Torque against the turning spindle, as of a cut: on and off for half of `load_period_s` each.
    #[schemars(extend("unit" = "N·m", "minimum" = 0, "maximum" = 100_000, "default" = 0.0))]
    pub load_torque_nm: f64,
    /// Time from one step of the load to the next but one.
    #[schemars(extend("unit" = "s", "minimum" = 0.002, "maximum" = 3600, "default" = 0.3))]
    pub load_period_s: f64,
}

/// The tool changer.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantToolChanger {
    /// Time of one change.
    #[schemars(extend("unit" = "s", "minimum" = 0, "maximum" = 600, "default" = 3.0))]
    pub change_s: f64,
}

/// The most places of a table of a screw's errors.
pub const PITCH_POINTS_MAX: usize = 100;
/// The most lines of the script of inputs.
pub const INPUT_LINES_MAX: usize = 256;
/// The most bodies of one kind that a probe can touch.
pub const BODIES_MAX: usize = 64;

/// A touch probe. It trips where the ball of its stylus touches a body, from whatever side. Positions are those of the tables of X, Y
/// and Z, in machine coordinates; an axis that the machine does not have is at 0.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct PlantProbe {
    /// Radius of the ball.
    #[schemars(extend("unit" = "mm", "minimum" = 0, "maximum" = 50, "default" = 1.0))]
    pub tip_radius_mm: f64,
    /// From the face of the spindle, which Z counts for, down to the centre of the ball.
    #[schemars(extend("unit" = "mm", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub length_mm: f64,
    /// So far the stylus gives way after the trip. Further it breaks, and shows contact for good.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 100, "default" = 5.0))]
    pub overtravel_mm: f64,
    /// Standard deviation of the place at which it trips.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 100, "default" = 0.0))]
    pub repeatability_um: f64,
    /// Seed of that noise.
    #[schemars(extend("minimum" = 0, "maximum" = 4_294_967_295_u64, "default" = 1))]
    pub seed: u64,
    /// A half-space of material.
    #[serde(rename = "plane")]
    #[schemars(length(max = BODIES_MAX), extend("default" = []))]
    pub planes: Vec<PlantPlane>,
    /// A block with its sides along the axes.
    #[serde(rename = "box")]
    #[schemars(length(max = BODIES_MAX), extend("default" = []))]
    pub boxes: Vec<PlantBox>,
    /// A ball.
    #[serde(rename = "sphere")]
    #[schemars(length(max = BODIES_MAX), extend("default" = []))]
    pub spheres: Vec<PlantSphere>,
    /// A cylinder with flat ends.
    #[serde(rename = "cylinder")]
    #[schemars(length(max = BODIES_MAX), extend("default" = []))]
    pub cylinders: Vec<PlantCylinder>,
    /// A cylinder that is taken out of all the others.
    #[serde(rename = "bore")]
    #[schemars(length(max = BODIES_MAX), extend("default" = []))]
    pub bores: Vec<PlantCylinder>,
}

/// A half-space of material.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantPlane {
    /// A point of its surface.
    #[schemars(inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm"))]
    pub point_mm: [f64; 3],
    /// Direction away from the material; not all of it 0.
    #[schemars(inner(range(min = -1, max = 1)))]
    pub normal: [f64; 3],
}

/// A block.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantBox {
    /// Its corner of the lowest positions.
    #[schemars(inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm"))]
    pub low_mm: [f64; 3],
    /// Its corner of the highest positions; each above the lowest.
    #[schemars(inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm"))]
    pub high_mm: [f64; 3],
}

/// A ball.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantSphere {
    /// Its centre.
    #[schemars(inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm"))]
    pub centre_mm: [f64; 3],
    /// Its radius.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 10_000))]
    pub radius_mm: f64,
}

/// A cylinder.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantCylinder {
    /// Centre of one of its ends.
    #[schemars(inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm"))]
    pub from_mm: [f64; 3],
    /// Centre of the other end; not the same.
    #[schemars(inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm"))]
    pub to_mm: [f64; 3],
    /// Its radius.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 10_000))]
    pub radius_mm: f64,
}

/// A change of one input: of a digital or of an analogue one.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantInput {
    /// Number of a digital input.
    #[schemars(extend("minimum" = 0, "maximum" = DIGITAL_INPUTS - 1))]
    pub digital: Option<u32>,
    /// Number of an analogue input.
    #[schemars(extend("minimum" = 0, "maximum" = ANALOG_INPUTS - 1))]
    pub analog: Option<u32>,
    /// What it shows from then on: 0 or 1 of a digital one.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000))]
    pub value: f64,
    /// When: after the first scan of the cell, or after the output of `after_output` was switched on.
    #[schemars(extend("unit" = "s", "minimum" = 0, "maximum" = 1_000_000_000))]
    pub at_s: f64,
    /// Number of a digital output of the program. The line counts only while that output is on.
    #[schemars(extend("minimum" = 0, "maximum" = DIGITAL_OUTPUTS - 1))]
    pub after_output: Option<u32>,
}

/// A contact, sensor or wire at a signal. It holds while all that it names is so.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct PlantContact {
    /// The signal, one whose source is a drive or terminal.
    pub signal: String,
    /// What the signal shows while this holds; without it, the other one of 0 and 1.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000))]
    pub value: Option<f64>,
    /// While this holds the wire is cut, or the device does not answer: the signal is lost.
    #[schemars(extend("default" = false))]
    pub broken: bool,
    /// Signal that must be on (not 0), such as the valve that moves what this contact sees.
    pub follows: Option<String>,
    /// Axis that must be between `from_mm` and `to_mm`.
    pub axis: Option<String>,
    /// Lowest place of the axis.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000))]
    pub from_mm: Option<f64>,
    /// Highest place of the axis.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000))]
    pub to_mm: Option<f64>,
    /// From when on, after the first scan of the cell.
    #[schemars(extend("unit" = "s", "minimum" = 0, "maximum" = 1_000_000_000, "default" = 0.0))]
    pub at_s: f64,
    /// Until when.
    #[schemars(extend("unit" = "s", "minimum" = 0, "maximum" = 1_000_000_000))]
    pub until_s: Option<f64>,
    /// It holds so much later than what it names is so, also after the first scan of the cell.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 1_000_000, "default" = 0.0))]
    pub on_delay_ms: f64,
    /// And ends so much later than that ends.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 1_000_000, "default" = 0.0))]
    pub off_delay_ms: f64,
    /// It comes and goes while it holds, off first: a cam or a pulse of something that turns. 0 for what stays.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 1_000_000, "default" = 0.0))]
    pub period_ms: f64,
    /// For so long after each change it bounces, every other scan.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub bounce_ms: f64,
}

/// One axis.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct PlantAxis {
    /// Its name, as in the machine file.
    #[schemars(extend("enum" = machine::axis_names()))]
    pub name: String,
    /// Linear or rotary. A rotary axis has the keys of a slide in units of its own: degrees for mm, and torques about the axis.
    #[schemars(extend("default" = "linear"))]
    pub kind: AxisKind,
    /// Where the axis is when the machine is switched on for the first time.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000))]
    pub start_position_mm: f64,
    /// The axis by the few numbers that people know of theirs, in place of `motor`, `screw` and `table`.
    pub simple: Option<PlantSimple>,
    /// Motor with encoder and current loop.
    #[schemars(extend("unless" = "simple"))]
    pub motor: PlantMotor,
    /// Ball screw, rack, belt or gear.
    #[schemars(extend("unless" = "simple"))]
    pub screw: PlantScrew,
    /// Table.
    #[schemars(extend("unless" = "simple"))]
    pub table: PlantTable,
    /// The bridge that joins the table of a second motor (`X2`) to that of its axis (`X`). Each of the two has its own part of the
    /// mass and the friction.
    pub bridge: Option<PlantBridge>,
    /// Weight that pulls the table. Without this table none does.
    pub gravity: Option<PlantGravity>,
    /// The holding brake of the motor. Without this table it has none.
    pub brake: Option<PlantBrake>,
    /// When its drive loses its power, after the first scan, until it is switched on again: a fault to try what the machine does. Without
    /// it never.
    #[schemars(extend("unit" = "s", "minimum" = 0, "maximum" = 1_000_000))]
    pub power_lost_at_s: Option<f64>,
    /// Linear scale, where there is one.
    pub scale: Option<PlantScale>,
    /// The motor encoder is incremental, and begins anywhere. Without this table it is absolute.
    pub encoder: Option<PlantEncoder>,
    /// A switch that shows when the table is at one end ([homing](../howto/home.md)).
    pub home_switch: Option<PlantHomeSwitch>,
    /// How the drive homes by itself, with a switch of its own.
    pub drive_homing: Option<PlantDriveHoming>,
    /// Friction in steady sliding as somebody measured it at the motor, of motor and table together, viscous friction included: in place
    /// of Coulomb, static and viscous friction and the Stribeck velocity of both. They share it as they share Coulomb friction, and are
    /// elastic before they slide as their elements say. Without this table their own keys count.
    pub measured_friction: Option<PlantMeasuredFriction>,
    /// How friction differs by place, direction, temperature and rest; of motor and table alike. Without this table it does not.
    pub variation: Option<PlantVariation>,
    /// A mass that swings on the table. Without this table there is none.
    pub attached_mass: Option<PlantAttachedMass>,
    /// A frame that the axis pushes itself away from: a bed on soft feet, a column. Motor, guideways and scale stand on it; the tool
    /// does not, and sees the table swing. Without this table it stands still.
    pub frame: Option<PlantFrame>,
    /// Error of its screw, which the tool sees, and a scale. Without this table it has none.
    pub pitch_error: Option<PlantPitchError>,
    /// What this axis gets of where another one is: errors of position, which the tool sees and no encoder or scale, and friction.
    #[schemars(length(max = MAX_AXES), extend("default" = []))]
    pub cross_talk: Vec<PlantCrossTalk>,
    /// The cut. Without this table nothing is cut.
    pub cutting: Option<PlantCutting>,
    /// What the drive measures wrongly. Without this table nothing.
    pub measurement: Option<PlantMeasurement>,
}

/// An axis by a few numbers. Half of its friction is at the motor, half at the table; what is not here is as on the machines that come
/// with Quadrant ([typical values](../methods/physics.md)).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantSimple {
    /// Mass that moves, with the workpiece.
    #[schemars(extend("unit" = "kg", "minimum" = 0.1, "maximum" = 100_000))]
    pub mass_kg: f64,
    /// Travel in one turn of the motor.
    #[schemars(extend("unit" = "mm", "minimum" = 0.1, "maximum" = 1000, "unless" = "transmission"))]
    pub lead_mm: f64,
    /// Screw, rack, belt or gear, in place of `lead_mm`.
    pub transmission: Option<Transmission>,
    /// Continuous torque of the motor.
    #[schemars(extend("unit" = "N·m", "minimum" = 0.001, "maximum" = 100_000))]
    pub rated_torque_nm: f64,
    /// Peak torque of the motor, at least the continuous one; without it three times that.
    #[schemars(extend("unit" = "N·m", "minimum" = 0.001, "maximum" = 1_000_000))]
    pub peak_torque_nm: Option<f64>,
    /// Inertia of what turns with the motor: rotor, coupling, screw or gear.
    #[schemars(extend("unit" = "kg·m²", "minimum" = 1e-7, "maximum" = 100))]
    pub rotor_inertia_kg_m2: f64,
    /// Friction in steady sliding, all of it, as felt at the table.
    #[schemars(extend("unit" = "N", "minimum" = 0.001, "maximum" = 100_000))]
    pub coulomb_n: f64,
    /// Break-away friction, at least `coulomb_n`; without it 1.3 times that.
    #[schemars(extend("unit" = "N", "minimum" = 0.001, "maximum" = 100_000))]
    pub static_n: Option<f64>,
    /// Viscous friction.
    #[schemars(extend("unit" = "N·s/m", "minimum" = 0, "maximum" = 1_000_000, "default" = 0.0))]
    pub viscous_n_s_per_m: f64,
    /// Stiffness between motor and table.
    #[schemars(extend("unit" = "N/µm", "minimum" = 0.01, "maximum" = 10_000, "default" = 120.0))]
    pub stiffness_n_per_um: f64,
    /// Backlash gap between them.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub gap_um: f64,
}

/// Weight that pulls the table ([equations](../methods/physics.md#weight-and-holding-brake)).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantGravity {
    /// What no counterweight holds; above 0 it pulls towards lower positions.
    #[schemars(extend("unit" = "N", "minimum" = -1_000_000, "maximum" = 1_000_000))]
    pub force_n: f64,
}

/// The bridge of a gantry ([equations](../methods/physics.md#a-bridge-between-two-motors)).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantBridge {
    /// Force between its two ends for each µm that one is ahead of the other.
    #[schemars(extend("unit" = "N/µm", "minimum" = 0.01, "maximum" = 10_000, "default" = 20.0))]
    pub stiffness_n_per_um: f64,
    /// Damping of the two ends against each other.
    #[schemars(extend("minimum" = 0, "maximum" = 1, "default" = 0.05))]
    pub damping_ratio: f64,
}

/// An incremental encoder. It keeps its position as long as the simulation runs, whoever is killed.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantEncoder {
    /// What it shows when the machine is switched on, wherever the axis is then.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000))]
    pub shows_mm: f64,
    /// True place of one of its indices; the others are whole turns of the motor from it.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000, "default" = 0.0))]
    pub index_at_mm: f64,
}

/// On which side a switch is actuated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Actuated {
    /// Where the table is below its place.
    Below,
    /// Where the table is above its place.
    Above,
}

/// A home switch.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantHomeSwitch {
    /// Number of the digital input that it is wired to.
    #[schemars(extend("minimum" = 0, "maximum" = DIGITAL_INPUTS - 1))]
    pub digital: u32,
    /// True place of the table at which it is actuated.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000))]
    pub at_mm: f64,
    /// On which side it is actuated.
    #[schemars(extend("default" = "below"))]
    pub actuated: Actuated,
    /// Its input shows 0 while it is actuated.
    #[schemars(extend("default" = false))]
    pub normally_closed: bool,
    /// So much further back it is free again.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 10_000, "default" = 20.0))]
    pub hysteresis_um: f64,
    /// It is up to so much off, and differently with each change.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 10_000, "default" = 0.0))]
    pub scatter_um: f64,
    /// Seed of that.
    #[schemars(extend("minimum" = 0, "maximum" = 4_294_967_295_u64, "default" = 1))]
    pub seed: u64,
}

/// How a drive homes by itself: it moves until its switch is actuated, and brakes. If it is at the beginning, it first moves off it.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantDriveHoming {
    /// Speed towards the switch; negative towards lower positions. Not 0.
    #[schemars(extend("unit" = "mm/s", "minimum" = -1000, "maximum" = 1000))]
    pub speed_mm_s: f64,
    /// True place of the switch.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000))]
    pub switch_at_mm: f64,
    /// Position that the drive gives that place.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000, "default" = 0.0))]
    pub position_mm: f64,
}

/// Friction as measured.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct PlantMeasuredFriction {
    /// Speeds, rising, none of them 0: at least one in each direction, at most 16.
    #[schemars(length(min = 2, max = 2 * SIDE_ROWS_MAX), inner(range(min = -10_000, max = 10_000)), extend("unit" = "mm/s"))]
    pub speed_mm_s: Vec<f64>,
    /// Force that is needed at each of these speeds, of its sign. By line from speed to speed; slower than the slowest as there, faster
    /// than the fastest on the line through the last two, as far as it rises.
    #[schemars(length(min = 2, max = 2 * SIDE_ROWS_MAX), inner(range(min = -100_000, max = 100_000)), extend("unit" = "N"))]
    pub force_n: Vec<f64>,
}

/// A mass that swings on the table: a fixture, a column, a tall workpiece. Scale and instruments see the table.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantAttachedMass {
    /// Its mass, beside that of the table.
    #[schemars(extend("unit" = "kg", "minimum" = 0.1, "maximum" = 100_000))]
    pub mass_kg: f64,
    /// Frequency at which it rings on a table that is held.
    #[schemars(extend("unit" = "Hz", "minimum" = 1, "maximum" = 1000))]
    pub frequency_hz: f64,
    /// Its damping ratio.
    #[schemars(extend("minimum" = 0.001, "maximum" = 1, "default" = 0.03))]
    pub damping_ratio: f64,
}

/// A frame that swings.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantFrame {
    /// Mass that swings in the direction of the axis, without that of its table.
    #[schemars(extend("unit" = "kg", "minimum" = 1, "maximum" = 1_000_000))]
    pub mass_kg: f64,
    /// Frequency at which that mass rings on the ground.
    #[schemars(extend("unit" = "Hz", "minimum" = 1, "maximum" = 1000))]
    pub frequency_hz: f64,
    /// Its damping ratio.
    #[schemars(extend("minimum" = 0.001, "maximum" = 1, "default" = 0.03))]
    pub damping_ratio: f64,
}

/// The error of a screw: how much further the table is than the motor's turns say.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct PlantPitchError {
    /// Progressive error for each metre of travel, from 0 on.
    #[schemars(extend("unit" = "µm/m", "minimum" = -10_000, "maximum" = 10_000, "default" = 0.0))]
    pub progressive_um_per_m: f64,
    /// Amplitude of the periodic error.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub periodic_um: f64,
    /// Length of a period, usually the lead.
    #[schemars(extend("unit" = "mm", "minimum" = 0.1, "maximum" = 100_000, "default" = 10.0))]
    pub periodic_length_mm: f64,
    /// Places of a table of errors beside that, ascending.
    #[schemars(length(max = PITCH_POINTS_MAX), inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm", "default" = []))]
    pub positions_mm: Vec<f64>,
    /// Error at each of them; by line from place to place, beyond the ends as there.
    #[schemars(length(max = PITCH_POINTS_MAX), inner(range(min = -10_000, max = 10_000)), extend("unit" = "µm", "default" = []))]
    pub error_um: Vec<f64>,
}

/// What an axis gets of where another one is.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
// A list within an axis has no keys of a rotary one: they are refused here.
#[serde(deny_unknown_fields)]
pub struct PlantCrossTalk {
    /// The other axis.
    #[schemars(extend("enum" = ["X", "Y", "Z", "A", "B", "C", "U", "V", "W"]))]
    pub from: String,
    /// Squareness: error of this table's position for each metre of the other's, from 0 on.
    #[schemars(extend("unit" = "µm/m", "minimum" = -10_000, "maximum" = 10_000, "default" = 0.0))]
    pub squareness_um_per_m: f64,
    /// Straightness: amplitude of a wave of that error over the other's travel.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub straightness_um: f64,
    /// Length of that wave.
    #[schemars(extend("unit" = "mm", "minimum" = 1, "maximum" = 100_000, "default" = 300.0))]
    pub straightness_length_mm: f64,
    /// Share by which friction of this axis is higher for each metre of the other's position; never below a tenth of it.
    #[schemars(extend("unit" = "1/m", "minimum" = -100, "maximum" = 100, "default" = 0.0))]
    pub friction_share_per_m: f64,
}

/// What the drive measures wrongly, and passes on.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantMeasurement {
    /// Amplitude of the encoder's error within a signal period, of travel.
    #[schemars(extend("unit" = "nm", "minimum" = 0, "maximum" = 100_000, "default" = 0.0))]
    pub period_error_nm: f64,
    /// Signal periods of the encoder in one turn.
    #[schemars(extend("unit" = "per turn", "minimum" = 1, "maximum" = 1_000_000, "default" = 2048))]
    pub periods_per_turn: u32,
    /// Standard deviation of the encoder's noise, of travel.
    #[schemars(extend("unit" = "nm", "minimum" = 0, "maximum" = 100_000, "default" = 0.0))]
    pub encoder_noise_nm: f64,
    /// Time by which the torque is shown late, in whole scans, at most 16.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 16, "default" = 0.0))]
    pub torque_delay_ms: f64,
    /// Steps of the torque that is shown, of the continuous torque.
    #[schemars(extend("unit" = "%", "minimum" = 0, "maximum" = 10, "default" = 0.0))]
    pub torque_step_percent: f64,
    /// Standard deviation of its noise, of the continuous torque.
    #[schemars(extend("unit" = "%", "minimum" = 0, "maximum" = 10, "default" = 0.0))]
    pub torque_noise_percent: f64,
    /// Seed of the noise.
    #[schemars(extend("minimum" = 0, "maximum" = 4_294_967_295_u64, "default" = 1))]
    pub seed: u64,
    /// The encoder's coupling slips once: from then on it shows so much more, of travel. A fault to try what the machine does.
    #[schemars(extend("unit" = "µm", "minimum" = -100_000, "maximum" = 100_000, "default" = 0.0))]
    pub slip_um: f64,
    /// When it slips, from the first scan on.
    #[schemars(extend("unit" = "s", "minimum" = 0, "maximum" = 1_000_000, "default" = 0.0))]
    pub slip_at_s: f64,
}

/// Motor with encoder and current loop.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantMotor {
    /// Continuous torque.
    #[schemars(extend("unit" = "N·m", "minimum" = 0.001, "maximum" = 100_000))]
    pub rated_torque_nm: f64,
    /// Peak torque, at least the continuous one.
    #[schemars(extend("unit" = "N·m", "minimum" = 0.001, "maximum" = 1_000_000))]
    pub peak_torque_nm: f64,
    /// Inertia of rotor, coupling and screw.
    #[schemars(extend("unit" = "kg·m²", "minimum" = 1e-7, "maximum" = 100))]
    pub inertia_kg_m2: f64,
    /// Bandwidth of the current loop.
    #[schemars(extend("unit" = "Hz", "minimum" = 10, "maximum" = 100_000))]
    pub current_loop_hz: f64,
    /// Amplitude of the cogging torque, at most the continuous torque.
    #[schemars(extend("unit" = "N·m", "minimum" = 0, "maximum" = 100_000))]
    pub cogging_torque_nm: f64,
    /// Cogging periods in one turn.
    #[schemars(extend("unit" = "per turn", "minimum" = 1, "maximum" = 1000))]
    pub cogging_per_turn: u32,
    /// Encoder counts in one turn.
    #[schemars(extend("unit" = "counts", "minimum" = 16, "maximum" = u32::MAX))]
    pub encoder_counts_per_turn: u32,
    /// Rise of the winding over the ambient at continuous torque.
    #[schemars(extend("unit" = "K", "minimum" = 1, "maximum" = 300))]
    pub winding_rise_at_rated_k: f64,
    /// Thermal time constant of the winding.
    #[schemars(extend("unit" = "min", "minimum" = 0.1, "maximum" = 1000))]
    pub winding_time_constant_min: f64,
    /// Friction of bearings, nut and seals, in torques at the motor: generalised Maxwell slip with four elements
    /// ([equations](../methods/physics.md#2-friction-generalized-maxwell-slip-gms)).
    pub friction: MotorFriction,
}

/// Friction at the motor, in torques.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct MotorFriction {
    /// Its law ([equations](../methods/physics.md#2-friction-generalized-maxwell-slip-gms)).
    #[schemars(extend("default" = "maxwell-slip"))]
    pub law: PlantLaw,
    /// Friction in steady sliding, without the viscous part; at most the peak torque.
    #[schemars(extend("unit" = "N·m", "minimum" = 1e-6, "maximum" = 1_000_000))]
    pub coulomb_torque_nm: f64,
    /// Break-away friction, at least the Coulomb friction and at most the peak torque.
    #[schemars(extend("unit" = "N·m", "minimum" = 1e-6, "maximum" = 1_000_000))]
    pub static_torque_nm: f64,
    /// Viscous friction.
    #[schemars(extend("unit" = "N·m·s/rad", "minimum" = 0, "maximum" = 10))]
    pub viscous_nm_s_per_rad: f64,
    /// Velocity vs of the Stribeck curve, of travel.
    #[schemars(extend("unit" = "mm/s", "minimum" = 0.001, "maximum" = 1000))]
    pub stribeck_velocity_mm_s: f64,
    /// Share of each element; the sum is 1.
    #[schemars(inner(range(min = 0, max = 1)))]
    pub element_share: [f64; ELEMENTS],
    /// Distance of travel at which each element breaks.
    #[schemars(inner(range(min = 0.001, max = 10_000)), extend("unit" = "µm"))]
    pub break_distance_um: [f64; ELEMENTS],
    /// Damping while an element sticks σ1, of travel.
    #[schemars(extend("unit" = "N·s/m", "minimum" = 0, "maximum" = 10_000_000))]
    pub presliding_damping_n_s_per_m: f64,
    /// Time constant of attraction to the Stribeck curve.
    #[schemars(extend("unit" = "ms", "minimum" = 0.01, "maximum" = 100))]
    pub attraction_ms: f64,
}

/// Ball screw.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantScrew {
    /// Travel in one turn of the motor.
    #[schemars(extend("unit" = "mm", "minimum" = 0.1, "maximum" = 1000, "unless" = "transmission"))]
    pub lead_mm: f64,
    /// Screw, rack, belt or gear, in place of `lead_mm`.
    pub transmission: Option<Transmission>,
    /// Axial stiffness between motor and table.
    #[schemars(extend("unit" = "N/m", "minimum" = 10_000, "maximum" = 10_000_000_000_u64))]
    pub stiffness_n_per_m: f64,
    /// Damping ratio of motor against table (reduced mass).
    #[schemars(extend("minimum" = 0, "maximum" = 1))]
    pub damping_ratio: f64,
    /// Backlash gap.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 1000))]
    pub gap_um: f64,
    /// Forces at which bearings and nut slip, beside the screw: a lost motion with hysteresis.
    #[schemars(inner(range(min = 0, max = 100_000)), extend("unit" = "N", "default" = [0.0, 0.0, 0.0]))]
    pub hysteresis_n: [f64; JENKINS_ELEMENTS],
    /// Ways of motor against table after which they do.
    #[schemars(inner(range(min = 0.01, max = 1000)), extend("unit" = "µm", "default" = [1.0, 3.0, 8.0]))]
    pub hysteresis_um: [f64; JENKINS_ELEMENTS],
}

/// Table.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantTable {
    /// Mass, with the workpiece.
    #[schemars(extend("unit" = "kg", "minimum" = 0.1, "maximum" = 100_000))]
    pub mass_kg: f64,
    /// Friction of the guideways, in forces: generalised Maxwell slip with four elements
    /// ([equations](../methods/physics.md#2-friction-generalized-maxwell-slip-gms)).
    pub friction: TableFriction,
}

/// Friction of the guideways, in forces.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct TableFriction {
    /// Its law ([equations](../methods/physics.md#2-friction-generalized-maxwell-slip-gms)).
    #[schemars(extend("default" = "maxwell-slip"))]
    pub law: PlantLaw,
    /// Friction in steady sliding, without the viscous part.
    #[schemars(extend("unit" = "N", "minimum" = 0.001, "maximum" = 100_000))]
    pub coulomb_n: f64,
    /// Break-away friction, at least the Coulomb friction.
    #[schemars(extend("unit" = "N", "minimum" = 0.001, "maximum" = 100_000))]
    pub static_n: f64,
    /// Viscous friction.
    #[schemars(extend("unit" = "N·s/m", "minimum" = 0, "maximum" = 1_000_000))]
    pub viscous_n_s_per_m: f64,
    /// Velocity vs of the Stribeck curve.
    #[schemars(extend("unit" = "mm/s", "minimum" = 0.001, "maximum" = 1000))]
    pub stribeck_velocity_mm_s: f64,
    /// Share of each element; the sum is 1.
    #[schemars(inner(range(min = 0, max = 1)))]
    pub element_share: [f64; ELEMENTS],
    /// Distance at which each element breaks.
    #[schemars(inner(range(min = 0.001, max = 10_000)), extend("unit" = "µm"))]
    pub break_distance_um: [f64; ELEMENTS],
    /// Damping while an element sticks σ1.
    #[schemars(extend("unit" = "N·s/m", "minimum" = 0, "maximum" = 10_000_000))]
    pub presliding_damping_n_s_per_m: f64,
    /// Time constant of attraction to the Stribeck curve.
    #[schemars(extend("unit" = "ms", "minimum" = 0.01, "maximum" = 100))]
    pub attraction_ms: f64,
}

/// Linear scale.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantScale {
    /// Measuring step.
    #[schemars(extend("unit" = "nm", "minimum" = 0.01, "maximum" = 1_000_000))]
    pub resolution_nm: f64,
}
