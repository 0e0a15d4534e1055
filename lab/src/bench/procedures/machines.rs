//! The machines that procedures run on.

use std::path::Path;

use anyhow::Context;
use bus::sample::{OperatorRequest, Order};
use machine::{HomingMethod, Machine, SetBy, SignalSource, ToolChanger};
use plant_sim::plant_file::{PlantDriveHoming, PlantFile};

use crate::stock;

/// Height of the plane that the probe touches, in mm of Z.
const SURFACE_MM: f64 = -60.0;
/// Counts of the spindle's encoder in a turn.
const SPINDLE_COUNTS: u32 = 4096;

/// One of them.
#[derive(Debug, Clone, Copy)]
pub enum Stand {
    /// One slide that is homed.
    Homed(HomingMethod),
    /// Two motors and a bridge that are homed.
    Gantry { standby: bool },
    /// Two slides whose encoders know their places.
    Slides { standby: bool },
    /// A mill with spindle, tool changer and probe.
    Mill(ToolChanger),
}

impl Stand {
    /// The machine and what is true of it; the mill is the one in this folder.
    pub fn machine(self, mill: &Path) -> anyhow::Result<(Machine, PlantFile)> {
        let (mut machine, plant) = match self {
            Stand::Homed(method) => homed(method),
            Stand::Gantry { standby } => stock::homed_machine(2, standby),
            Stand::Slides { standby } => {
                let axes = ["X:travel=-100..100,lead=10", "Y:travel=-100..100,lead=10"];
                let (mut machine, plant) = stock::new_machine(&axes);
                let each = machine.axes.iter_mut();
                each.for_each(|axis| axis.standby = standby);
                (machine, plant)
            }
            Stand::Mill(changer) => equipped(mill, changer)?,
        };
        wire(&mut machine);
        Ok((machine, plant))
    }
}

/// What a machine waits for beside its drives: an emergency-stop chain, a door and air. The signal before them does nothing.
fn wire(machine: &mut Machine) {
    let names = [
        "spare",
        Wire::Chain.name(),
        Wire::Door.name(),
        Wire::Air.name(),
    ];
    let by_operator = |name: &str| {
        let from = SignalSource {
            by: Some(SetBy::Operator),
            ..SignalSource::default()
        };
        stock::switch(name, from)
    };
    machine.signals = names.map(by_operator).into();
    machine.functions.emergency_stop = Some(Wire::Chain.name().into());
    machine.functions.door = Some(Wire::Door.name().into());
    machine.functions.ready = vec![Wire::Air.name().into()];
}

/// A signal that the controller acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    Chain = 1,
    Door = 2,
    Air = 3,
}

impl Wire {
    pub const ALL: [Wire; 3] = [Wire::Chain, Wire::Door, Wire::Air];

    fn name(self) -> &'static str {
        match self {
            Wire::Chain => "chain",
            Wire::Door => "door",
            Wire::Air => "air",
        }
    }

    /// The order that opens or closes it.
    pub fn set(self, is_on: bool) -> OperatorRequest {
        OperatorRequest {
            axis: self as u32,
            value: f64::from(u8::from(is_on)),
            ..OperatorRequest::of(Order::Signal)
        }
    }
}

fn homed(method: HomingMethod) -> (Machine, PlantFile) {
    let (mut machine, mut plant) = stock::homed_machine(1, false);
    let homing = machine.axes[0].homing.as_mut().expect("homing");
    homing.method = method;
    if !method.has_switch() {
        homing.switch_input = None;
    }
    if method == HomingMethod::Drive {
        plant.axes[0].drive_homing = Some(PlantDriveHoming {
            speed_mm_s: -30.0,
            switch_at_mm: -190.0,
            position_mm: -190.0,
        });
    }
    (machine, plant)
}

fn equipped(folder: &Path, changer: ToolChanger) -> anyhow::Result<(Machine, PlantFile)> {
    let mut machine = Machine::load(folder)?;
    let plant = folder.join("plant.toml");
    let mut plant = PlantFile::load(&plant).with_context(|| plant.display().to_string())?;
    let letters: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    anyhow::ensure!(
        letters == ["X", "Y", "Z"],
        "{}: axes {letters:?}: must be a mill with X, Y and Z, as machines/xyz-mill",
        folder.display()
    );
    machine.program.work_offset_mm.clear();
    machine
        .axes
        .iter_mut()
        .for_each(|axis| axis.standby = false);
    stock::equip(&mut machine, &mut plant);
    machine.tool_change.by = changer;
    machine.program.probe = true;
    if let (Some(spindle), Some(simulated)) = (&mut machine.spindle, &mut plant.spindle) {
        spindle.encoder_counts_per_turn = SPINDLE_COUNTS;
        spindle.ramp_rpm_s = 3000.0;
        spindle.follow_gain_per_s = 50.0;
        spindle.follow_limit_deg = 45.0;
        simulated.encoder_counts_per_turn = SPINDLE_COUNTS;
    }
    plant.probe = Some(stock::probe_above(SURFACE_MM));
    Ok((machine, plant))
}
