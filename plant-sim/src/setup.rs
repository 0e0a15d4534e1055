//! The simulated axes of a machine: machine file and plant file put together, and checked against each other.

use bus::sample::PATH_AXES;
use machine::{Axis, ErrorTable, HomingMethod, Machine, PositionFeedback, ToolChanger};

use crate::auxiliary::SimulatedAuxiliaries;
use crate::axis::{AxisSettings, AxisSimulation};
use crate::bridge::Bridge;
use crate::contacts::SimulatedContacts;
use crate::cross_talk::CrossTalk;
use crate::drive::DriveParameters;
use crate::drives::{BridgedAxes, SimulatedDrives};
use crate::homing::SimulatedHoming;
use crate::inputs::SimulatedInputs;
use crate::pitch_error::PitchError;
use crate::plant_file::{PlantAxis, PlantFile};
use crate::probe::SimulatedProbe;

/// Machine file and plant file do not fit each other.
pub use crate::axis::SetupError;

fn wrong_axis<T>(axis: &str, what: &str) -> Result<T, SetupError> {
    Err(SetupError(format!("axis {axis}: {what}")))
}

/// A table that the machine file makes necessary.
fn missing<T>(what: &str, table: &str) -> Result<T, SetupError> {
    Err(SetupError(format!(
        "the machine file has {what}, but the plant file has no [{table}]"
    )))
}

/// A screw is no nearer to its nominal lead than this.
const LEAD_TOLERANCE: f64 = 1e-3;

fn drive_parameters(axis: &Axis) -> DriveParameters {
    DriveParameters {
        velocity_gain_n_s_per_m: axis.velocity_loop.gain_n_s_per_m,
        integral_time_ms: axis.velocity_loop.integral_time_ms,
        position_gain_per_s: axis.position_loop.gain_per_s,
        period_us: axis.velocity_loop.period_us,
        torque_limit_nm: axis.motor.peak_torque_nm,
        quick_stop_mm_s2: axis.quick_stop_mm_s2,
        weight_nm: axis.weight_nm(),
        brake: axis.brake.map(|brake| brake.by),
    }
}

impl PlantFile {
    /// The simulated drives of a machine, in the order of its axes.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn drives(&self, machine: &Machine) -> Result<SimulatedDrives, SetupError> {
        let simulations = self.simulations(machine)?;
        let dead_time_scans = self.drive.dead_time_scans;
        let scan_s = machine.scan_period_s();
        let auxiliary = SimulatedAuxiliaries::new(self.spindle, self.tool_changer, scan_s);
        let auxiliary = auxiliary.with_tool(machine.beginning.tool);
        if machine.spindle.is_some() && self.spindle.is_none() {
            return missing("[spindle]", "spindle");
        }
        let counts = machine
            .spindle
            .as_ref()
            .map_or(0, |of| of.encoder_counts_per_turn);
        if let Some(spindle) = self.spindle.filter(|_| counts != 0)
            && counts != spindle.encoder_counts_per_turn
        {
            return Err(SetupError(format!(
                "[spindle] encoder_counts_per_turn is {counts} in the machine file, but {} in the plant file",
                spindle.encoder_counts_per_turn
            )));
        }
        let by_signal = machine.functions.tool_in_spindle.is_some();
        let by_changer = machine.tool_change.by == ToolChanger::Changer && !by_signal;
        if by_changer && self.tool_changer.is_none() {
            return missing("tool_change.by = \"changer\"", "tool_changer");
        }
        if machine.program.probe && self.probe.is_none() {
            return missing("program.probe = true", "probe");
        }
        let slide = |letter: &str| machine.axes.iter().position(|axis| axis.name == letter);
        let slides = ["X", "Y", "Z"].map(slide);
        let probe = self.probe.as_ref();
        let probe = probe.map(|probe| SimulatedProbe::new(probe.clone(), slides));
        let inputs = SimulatedInputs::new(self.inputs.clone(), scan_s);
        let mut drives = SimulatedDrives::with_dead_time(simulations, dead_time_scans);
        self.judge_homing(machine)?;
        drives.bridges = self.bridges(machine)?;
        drives.cross_talk = self.cross_talk(machine);
        drives.bend_screws(|index| self.pitch_error(&machine.axes.get(index)?.name));
        drives.contacts = SimulatedContacts::new(&self.contacts, machine)?;
        drives.auxiliaries = auxiliary;
        let drives = drives.with_homing(|index, simulation| {
            let axis = self.axis(&machine.axes.get(index)?.name)?;
            Some(SimulatedHoming::new(axis, simulation, scan_s))
        });
        Ok(drives.with_inputs(probe, inputs))
    }

    /// Each axis has what it is homed by, and is homed if it has to be.
    fn judge_homing(&self, machine: &Machine) -> Result<(), SetupError> {
        for axis in &machine.axes {
            let Some(plant) = self.axis(&axis.name) else {
                continue;
            };
            let Some(homing) = &axis.homing else {
                if plant.encoder.is_some() {
                    let what = "[axis.encoder] makes the encoder incremental, but the machine file has no [axis.homing] for the axis";
                    return wrong_axis(&axis.name, what);
                }
                continue;
            };
            let wired = plant.home_switch.map(|switch| switch.digital);
            let table = if plant.encoder.is_none() {
                "[axis.encoder] for it"
            } else if homing.method == HomingMethod::Drive && plant.drive_homing.is_none() {
                "[axis.drive_homing] for it"
            } else if homing.method.has_switch() && wired != homing.switch_input {
                "[axis.home_switch] for it at the same digital input"
            } else {
                continue;
            };
            let method = homing.method;
            let what = format!(
                "homing.method = {method:?} in the machine file, but the plant file has no {table}"
            );
            return wrong_axis(&axis.name, &what);
        }
        Ok(())
    }

    /// What opens a brake, and the brake, are both there or neither.
    fn judge_brake(&self, axis: &Axis) -> Result<(), SetupError> {
        let brake = self.axis(&axis.name).is_some_and(|of| of.brake.is_some());
        match (axis.brake.is_some(), brake) {
            (true, false) => missing(&format!("[axis.brake] for {}", axis.name), "axis.brake"),
            (false, true) => wrong_axis(
                &axis.name,
                "[axis.brake] in the plant file, but the machine file has none: nothing opens it",
            ),
            _ => Ok(()),
        }
    }

    /// What joins the motors of the machine's gantries.
    fn bridges(&self, machine: &Machine) -> Result<Vec<BridgedAxes>, SetupError> {
        let mut bridges = Vec::new();
        for (index, axis) in machine.axes.iter().enumerate() {
            let plant = self.axis(&axis.name);
            let pair = machine.gantries().find(|pair| pair.follower == index);
            let of_plant = plant.and_then(|plant| Some((plant, plant.bridge?)));
            match (pair, of_plant) {
                (None, None) => {}
                (None, Some(_)) => {
                    let what = "[axis.bridge] joins it to another motor, but the machine file has no [axis.gantry] for it";
                    return wrong_axis(&axis.name, what);
                }
                (Some(_), None) => {
                    let what = "is the second motor of a gantry in the machine file, but the plant file has no [axis.bridge] for it";
                    return wrong_axis(&axis.name, what);
                }
                (Some(pair), Some((second, bridge))) => {
                    let first = self.bridged(second);
                    let mass_kg = first.map_or(second.table.mass_kg, |axis| axis.table.mass_kg);
                    bridges.push(BridgedAxes {
                        first: pair.leader,
                        second: pair.follower,
                        bridge: Bridge::new(
                            bridge.stiffness_n_per_um * 1e6,
                            bridge.damping_ratio,
                            [mass_kg, second.table.mass_kg],
                        ),
                    });
                }
            }
        }
        Ok(bridges)
    }

    /// The error of the screw of an axis; none where the file says nothing of it.
    fn pitch_error(&self, axis: &str) -> Option<PitchError> {
        let of = self.axis(axis)?.pitch_error.as_ref()?;
        Some(PitchError {
            progressive_mm_per_mm: of.progressive_um_per_m * 1e-6,
            periodic_mm: of.periodic_um * 1e-3,
            periodic_length_mm: of.periodic_length_mm,
            table: ErrorTable::new(&of.positions_mm, of.error_um.iter().copied()),
        })
    }

    /// What axes get of each other, by their indices in the machine file.
    fn cross_talk(&self, machine: &Machine) -> Vec<CrossTalk> {
        let index = |name: &str| machine.axes.iter().position(|axis| axis.name == name);
        let of_axis = |axis: &PlantAxis| {
            let of = index(&axis.name);
            let talks = axis.cross_talk.iter().filter_map(move |talk| {
                Some(CrossTalk {
                    of: of?,
                    from: index(&talk.from)?,
                    squareness_mm_per_mm: talk.squareness_um_per_m * 1e-6,
                    straightness_mm: talk.straightness_um * 1e-3,
                    straightness_length_mm: talk.straightness_length_mm,
                    friction_share_per_mm: talk.friction_share_per_m * 1e-3,
                })
            });
            talks.collect::<Vec<_>>()
        };
        self.axes.iter().flat_map(of_axis).collect()
    }

    /// Each axis starts within its travel. One that is homed may start anywhere: where it is nobody knows before.
    ///
    /// # Errors
    /// The first that does not.
    pub fn starts_within(&self, machine: &Machine) -> Result<(), SetupError> {
        for axis in machine.axes.iter().filter(|axis| axis.homing.is_none()) {
            let (low, high) = (axis.travel_min_mm, axis.travel_max_mm);
            let start = self.axis(&axis.name).map(|of| of.start_position_mm);
            if let Some(start) = start.filter(|start| !(low..=high).contains(start)) {
                let unit = axis.kind.unit();
                let what = format!(
                    "start_position_mm = {start} {unit} in the plant file: must be within the travel of the machine file, {low} to {high} {unit}"
                );
                return wrong_axis(&axis.name, &what);
            }
        }
        Ok(())
    }

    /// Where machine file and plant file differ in what should be one number, in words: a test of robustness, or a mistake.
    pub fn disagreements(&self, machine: &Machine) -> Vec<String> {
        let mut words = Vec::new();
        let (reckoned, simulated) = (machine.scan.dead_time_scans, self.drive.dead_time_scans);
        if reckoned != simulated {
            words.push(format!(
                "dead time: the controller reckons with {reckoned} scans ([scan] dead_time_scans), the simulated drives have {simulated} \
                 ([drive] dead_time_scans in plant.toml)"
            ));
        }
        if machine.program.probe && self.probe.is_none() && machine.functions.probe.is_none() {
            words.push(
                "probe: programs may probe ([program] probe), and plant.toml has no [probe]: nothing is ever touched"
                    .into(),
            );
        }
        for axis in &machine.axes {
            let Some(screw) = self.axis(&axis.name).map(|of| &of.screw) else {
                continue;
            };
            if (screw.lead_mm / axis.lead_mm - 1.0).abs() > LEAD_TOLERANCE {
                words.push(format!(
                    "axis {}: the controller reckons with {} {unit} a turn of the motor (lead_mm), the simulated screw has {} {unit} \
                     ([axis.screw] lead_mm in plant.toml): torque, gains and model are off by their ratio",
                    axis.name,
                    axis.lead_mm,
                    screw.lead_mm,
                    unit = axis.kind.unit()
                ));
            }
        }
        for contact in &self.contacts {
            let name = &contact.signal;
            let alone = self.contacts.iter().filter(|of| of.signal == *name).count() == 1;
            let index = machine.signal(name);
            let signal = index.and_then(|index| machine.signals.get(index));
            let same = signal.is_some_and(|of| contact.value == Some(of.default));
            if alone && same && !contact.broken {
                words.push(format!(
                    "signal {name}: its only [[contact]] in plant.toml shows its default: it never changes"
                ));
            }
        }
        words
    }

    /// Command positions of the axes of the path with which the simulated machine starts, in increments: where its encoders are.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn start(&self, machine: &Machine) -> Result<[i64; PATH_AXES], SetupError> {
        let mut start = [0; PATH_AXES];
        let axes = start.iter_mut().zip(machine.program_axes());
        for ((increments, axis), simulation) in axes.zip(&self.simulations(machine)?) {
            *increments = libm::round(simulation.motor_position_mm() / axis.increment_mm()) as i64;
        }
        Ok(start)
    }

    /// The simulated axes in the order of the machine file, each at its start position.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn simulations(&self, machine: &Machine) -> Result<Vec<AxisSimulation>, SetupError> {
        for axis in &self.axes {
            if !machine.axes.iter().any(|known| known.name == axis.name) {
                let what = "is in the plant file but not in the machine file";
                return wrong_axis(&axis.name, what);
            }
        }
        self.bridges(machine)?;
        machine
            .axes
            .iter()
            .map(|axis| {
                let settings = AxisSettings::new(
                    self,
                    &axis.name,
                    &drive_parameters(axis),
                    machine.scan.period_us,
                )?;
                self.judge_brake(axis)?;
                let has_scale = self.axis(&axis.name).is_some_and(|a| a.scale.is_some());
    if axis.feedback == PositionFeedback::Scale && !has_scale {
     let what = "feedback = \"scale\" in the machine file, but the plant file has no [axis.scale]";
     return wrong_axis(&axis.name, what);
    }
                Ok(AxisSimulation::new(settings))
            })
            .collect()
    }
}
