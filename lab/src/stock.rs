//! Machines that cells in one process are made of.

use machine::{Machine, Signal, SignalKind, SignalSource, Spindle, ToolChange, ToolChanger};
use plant_sim::plant_file::{PlantFile, PlantPlane, PlantProbe, PlantSpindle, PlantToolChanger};
use tune::options::NewMachineOptions;

/// Of the spindle that [`equip`] gives a machine.
pub const AT_SPEED_SHARE: f64 = 0.05;

/// As `quadrant new machine` writes it from these axes.
///
/// # Panics
/// No machine has such axes.
pub fn new_machine(axes: &[&str]) -> (Machine, PlantFile) {
    let folder = tempfile::tempdir().expect("a folder");
    let written = folder.path().join("new");
    let options = NewMachineOptions {
        folder: written.clone(),
        axis: axes.iter().map(|axis| (*axis).to_owned()).collect(),
        name: None,
        scan_us: 1000,
    };
    tune::new_machine::written(&options).expect("such a machine");
    let machine = Machine::load(&written).expect("machine.toml");
    let plant = PlantFile::load(&written.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

/// True places of the home switches of the two motors of [`homed_machine`], and of the indices behind them, in mm.
const SWITCHES_MM: [f64; 2] = [-190.0, -189.6];
const INDICES_MM: [f64; 2] = [-191.0, -191.3];

/// A machine as `quadrant new machine` writes it, whose X is homed by switch and index: on one motor or two, with standbys or without.
///
/// # Panics
/// Never: its axes are as they are written.
pub fn homed_machine(motors: u32, standby: bool) -> (Machine, PlantFile) {
    let axis = format!(
        "X:travel=-200..200,lead=10,mass=200,motors={motors},encoder=incremental,start=-188"
    );
    let (mut machine, mut plant) = new_machine(&[&axis]);
    for (index, axis) in machine.axes.iter_mut().enumerate() {
        axis.standby = standby;
        let homing = axis.homing.as_mut().expect("homing");
        homing.position_mm = INDICES_MM[index];
        (homing.search_mm_s, homing.latch_mm_s) = (40.0, 10.0);
    }
    for (index, axis) in plant.axes.iter_mut().enumerate() {
        let encoder = axis.encoder.as_mut().expect("an encoder");
        encoder.index_at_mm = INDICES_MM[index];
        encoder.shows_mm = [400.0, -77.7][index];
        let switch = axis.home_switch.as_mut().expect("a switch");
        switch.at_mm = SWITCHES_MM[index];
    }
    (machine, plant)
}

/// A switch, on until its source says something else.
pub fn switch(name: &str, from: SignalSource) -> Signal {
    Signal {
        name: name.into(),
        kind: SignalKind::Bool,
        unit: String::new(),
        default: 1.0,
        lost: None,
        keeps: false,
        inverted: false,
        from,
        to: None,
    }
}

/// Gives a machine a spindle and a tool changer.
pub fn equip(machine: &mut Machine, plant: &mut PlantFile) {
    machine.spindle = Some(Spindle {
        speed_min_rpm: 100.0,
        speed_max_rpm: 8000.0,
        at_speed_percent: 100.0 * AT_SPEED_SHARE,
        patience_s: 4.0,
        ..Spindle::default()
    });
    machine.tool_change = ToolChange {
        by: ToolChanger::Changer,
        patience_s: 3.0,
    };
    plant.spindle = Some(PlantSpindle {
        acceleration_rpm_s: 6000.0,
        orientation_rpm: 120.0,
        ..PlantSpindle::default()
    });
    plant.tool_changer = Some(PlantToolChanger { change_s: 0.25 });
}

/// A probe with a ball of 2 mm above a plane at this height of Z, in mm.
pub fn probe_above(surface_mm: f64) -> PlantProbe {
    PlantProbe {
        tip_radius_mm: 2.0,
        length_mm: 0.0,
        overtravel_mm: 5.0,
        repeatability_um: 0.0,
        seed: 1,
        planes: vec![PlantPlane {
            point_mm: [0.0, 0.0, surface_mm],
            normal: [0.0, 0.0, 1.0],
        }],
        boxes: vec![],
        spheres: vec![],
        cylinders: vec![],
        bores: vec![],
    }
}
