//! The plants that are not as the model says: each a name and what it changes in the plant file, on every axis.

use plant_sim::plant_file::{
    PlantAttachedMass, PlantAxis, PlantCrossTalk, PlantCutting, PlantFile, PlantFrame, PlantLaw,
    PlantMeasuredFriction, PlantMeasurement, PlantVariation,
};

/// One plant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foreign {
    /// Its name.
    pub name: &'static str,
    /// What it changes.
    pub edit: fn(&mut PlantFile),
    /// Whether it is a structure that the model does not have: what random plants are made of, beside other numbers.
    pub is_structure: bool,
}

/// A plant with other numbers.
const OTHER_NUMBERS: Foreign = Foreign {
    name: "",
    edit: |_| {},
    is_structure: false,
};

/// A plant of another structure.
const STRUCTURE: Foreign = Foreign {
    is_structure: true,
    ..OTHER_NUMBERS
};

/// All of them.
pub(crate) const FOREIGN: &[Foreign] = &[
    Foreign {
        name: "as-modelled",
        edit: |_| {},
        ..OTHER_NUMBERS
    },
    Foreign {
        name: "friction-low",
        edit: |plant| each(plant, |axis| scale_friction(axis, 0.7)),
        ..OTHER_NUMBERS
    },
    Foreign {
        name: "friction-high",
        edit: |plant| each(plant, |axis| scale_friction(axis, 1.3)),
        ..OTHER_NUMBERS
    },
    Foreign {
        name: "direction",
        edit: |plant| each(plant, |axis| vary(axis, |of| of.direction_share = 0.2)),
        ..STRUCTURE
    },
    Foreign {
        name: "place",
        edit: |plant| {
            each(plant, |axis| {
                vary(axis, |of| (of.screw_share, of.wave_share) = (0.05, 0.10));
            });
        },
        ..STRUCTURE
    },
    Foreign {
        name: "noise",
        edit: |plant| each(plant, noise),
        ..STRUCTURE
    },
    Foreign {
        name: "torque-late",
        edit: |plant| each(plant, |axis| late(axis, 3.0)),
        ..STRUCTURE
    },
    Foreign {
        name: "slow-current-loop",
        edit: |plant| each(plant, |axis| axis.motor.current_loop_hz = 200.0),
        ..OTHER_NUMBERS
    },
    Foreign {
        name: "lugre",
        edit: |plant| each(plant, lugre),
        ..STRUCTURE
    },
    Foreign {
        name: "lost-motion",
        edit: |plant| each(plant, lost_motion),
        ..STRUCTURE
    },
    Foreign {
        name: "soft-screw",
        edit: |plant| each(plant, |axis| axis.screw.stiffness_n_per_m *= 0.5),
        ..OTHER_NUMBERS
    },
    Foreign {
        name: "mode",
        edit: |plant| {
            each(plant, |axis| {
                axis.attached_mass = Some(PlantAttachedMass {
                    mass_kg: 0.25 * axis.table.mass_kg,
                    frequency_hz: 80.0,
                    damping_ratio: 0.03,
                });
            });
        },
        ..STRUCTURE
    },
    Foreign {
        name: "frame",
        edit: |plant| each(plant, |axis| axis.frame = Some(frame(axis))),
        ..STRUCTURE
    },
    Foreign {
        name: "cross-talk",
        edit: cross_talk,
        ..STRUCTURE
    },
    Foreign {
        name: "measured-friction",
        edit: |plant| {
            each(plant, |axis| {
                axis.measured_friction = Some(measured_friction(axis));
            });
        },
        ..STRUCTURE
    },
    Foreign {
        name: "rest",
        edit: |plant| {
            each(plant, |axis| {
                vary(axis, |of| {
                    (of.rest_share, of.rest_time_constant_s) = (0.3, 5.0)
                });
            });
        },
        ..STRUCTURE
    },
    Foreign {
        name: "cutting",
        edit: |plant| each(plant, |axis| axis.cutting = Some(CUTTING)),
        ..STRUCTURE
    },
    Foreign {
        name: "warming-up",
        edit: |plant| {
            each(plant, |axis| {
                vary(axis, |of| {
                    (of.warm_share, of.warm_time_constant_s) = (0.7, 200.0);
                });
            });
        },
        ..STRUCTURE
    },
    Foreign {
        name: "all-mildly",
        edit: |plant| each(plant, all_mildly),
        ..OTHER_NUMBERS
    },
];

/// A tool that is in the material for 0.7 s and out of it for 0.3 s.
const CUTTING: PlantCutting = PlantCutting {
    force_n: 120.0,
    tooth_n: 40.0,
    tooth_hz: 133.0,
    on_s: 0.7,
    off_s: 0.3,
};

/// Friction that varies in nothing.
const STEADY: PlantVariation = PlantVariation {
    direction_share: 0.0,
    screw_share: 0.0,
    wave_share: 0.0,
    wave_length_mm: 300.0,
    warm_share: 1.0,
    warm_time_constant_s: 600.0,
    rest_share: 0.0,
    rest_time_constant_s: 5.0,
};

/// A drive that measures rightly.
const RIGHT: PlantMeasurement = PlantMeasurement {
    period_error_nm: 0.0,
    periods_per_turn: 2048,
    encoder_noise_nm: 0.0,
    torque_delay_ms: 0.0,
    torque_step_percent: 0.0,
    torque_noise_percent: 0.0,
    seed: 1,
    slip_um: 0.0,
    slip_at_s: 0.0,
};

fn each(plant: &mut PlantFile, edit: impl Fn(&mut PlantAxis)) {
    for (index, axis) in (1..).zip(&mut plant.axes) {
        edit(axis);
        // Two drives do not make the same noise.
        if let Some(measurement) = &mut axis.measurement {
            measurement.seed = index;
        }
    }
}

fn vary(axis: &mut PlantAxis, edit: impl Fn(&mut PlantVariation)) {
    edit(axis.variation.get_or_insert(STEADY));
}

/// Coulomb and static friction of motor and table.
fn scale_friction(axis: &mut PlantAxis, part: f64) {
    let (motor, table) = (&mut axis.motor.friction, &mut axis.table.friction);
    motor.coulomb_torque_nm *= part;
    motor.static_torque_nm *= part;
    table.coulomb_n *= part;
    table.static_n *= part;
}

fn measure(axis: &mut PlantAxis, edit: impl Fn(&mut PlantMeasurement)) {
    edit(axis.measurement.get_or_insert(RIGHT));
}

fn noise(axis: &mut PlantAxis) {
    measure(axis, |of| {
        of.period_error_nm = 20.0;
        of.encoder_noise_nm = 5.0;
    });
    coarse_torque(axis);
}

/// A torque in steps of 0.1 % and with noise of 0.5 %.
fn coarse_torque(axis: &mut PlantAxis) {
    measure(axis, |of| {
        of.torque_step_percent = 0.1;
        of.torque_noise_percent = 0.5;
    });
}

/// A torque that is shown late, in steps and with noise.
fn late(axis: &mut PlantAxis, torque_delay_ms: f64) {
    measure(axis, |of| of.torque_delay_ms = torque_delay_ms);
    coarse_torque(axis);
}

/// A bed of ten times the table's mass on soft feet.
fn frame(axis: &PlantAxis) -> PlantFrame {
    PlantFrame {
        mass_kg: 10.0 * axis.table.mass_kg,
        frequency_hz: 35.0,
        damping_ratio: 0.05,
    }
}

/// Each axis gets of the next one: 20 µm/m out of square, 1 µm out of straight, friction that is 5 % higher 100 mm from the middle.
fn cross_talk(plant: &mut PlantFile) {
    let names: Vec<String> = plant.axes.iter().map(|axis| axis.name.clone()).collect();
    for (axis, from) in plant.axes.iter_mut().zip(names.iter().cycle().skip(1)) {
        if axis.name != *from {
            axis.cross_talk = vec![PlantCrossTalk {
                from: from.clone(),
                squareness_um_per_m: 20.0,
                straightness_um: 1.0,
                straightness_length_mm: 150.0,
                friction_share_per_m: 0.5,
            }];
        }
    }
}

/// Friction of EMPS, a motor with ball screw and carriage, over speed: in mm/s and N. Its `DATA_EMPS` less 95.109 kg times acceleration,
/// both behind two running means of 21 samples, by mean of the samples within bounds of speed. Source of the data: A. Janot,
/// M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Nonlinear System Identification Benchmarks, 2019.
const EMPS: [(f64, f64); 20] = [
    (-124.64, -50.49),
    (-110.57, -47.41),
    (-83.03, -40.48),
    (-70.42, -38.07),
    (-52.20, -34.39),
    (-41.30, -31.05),
    (-25.14, -25.76),
    (-16.02, -23.13),
    (-10.03, -21.20),
    (-6.38, -19.81),
    (6.39, 18.01),
    (9.96, 19.26),
    (15.91, 21.04),
    (25.09, 23.45),
    (41.32, 27.48),
    (52.27, 30.15),
    (70.41, 32.08),
    (83.03, 34.37),
    (110.59, 38.38),
    (124.64, 40.63),
];
/// Coulomb friction of EMPS as published there, in N.
const EMPS_COULOMB_N: f64 = 20.394;

/// Friction of the axis as that of EMPS goes, as high as its own Coulomb friction.
fn measured_friction(axis: &PlantAxis) -> PlantMeasuredFriction {
    let radius_m = axis.radius_m();
    let coulomb_n =
        axis.motor.friction.coulomb_torque_nm / radius_m + axis.table.friction.coulomb_n;
    let part = coulomb_n / EMPS_COULOMB_N;
    PlantMeasuredFriction {
        speed_mm_s: EMPS.map(|(speed_mm_s, _)| speed_mm_s).to_vec(),
        force_n: EMPS.map(|(_, force_n)| part * force_n).to_vec(),
    }
}

fn lugre(axis: &mut PlantAxis) {
    axis.motor.friction.law = PlantLaw::Lugre;
    axis.table.friction.law = PlantLaw::Lugre;
}

/// Half of the gap's width is no gap, but bearings and nut that give way and slip.
fn lost_motion(axis: &mut PlantAxis) {
    let force_n = axis.table.friction.coulomb_n;
    axis.screw.gap_um *= 0.5;
    axis.screw.hysteresis_n = [0.15, 0.15, 0.10].map(|part| part * force_n);
    axis.screw.hysteresis_um = [1.0, 3.0, 8.0];
}

fn all_mildly(axis: &mut PlantAxis) {
    scale_friction(axis, 0.85);
    vary(axis, |of| {
        of.direction_share = 0.08;
        (of.screw_share, of.wave_share) = (0.03, 0.05);
        (of.rest_share, of.rest_time_constant_s) = (0.3, 5.0);
    });
    noise(axis);
    axis.table.friction.law = PlantLaw::Lugre;
    let force_n = axis.table.friction.coulomb_n;
    axis.screw.hysteresis_n = [0.05, 0.05, 0.05].map(|part| part * force_n);
    axis.screw.hysteresis_um = [1.0, 3.0, 8.0];
    axis.screw.stiffness_n_per_m *= 0.9;
    axis.motor.current_loop_hz = 600.0;
    axis.attached_mass = Some(PlantAttachedMass {
        mass_kg: 0.1 * axis.table.mass_kg,
        frequency_hz: 95.0,
        damping_ratio: 0.05,
    });
}
