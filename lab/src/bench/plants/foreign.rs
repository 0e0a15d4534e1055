//! The plants that are not as the model says: each a name and what it changes in the plant file, on every axis.

use plant_sim::plant_file::{
    PlantAttachedMass, PlantAxis, PlantCutting, PlantFile, PlantLaw, PlantMeasurement,
    PlantVariation,
};

/// One plant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foreign {
    /// Its name.
    pub name: &'static str,
    /// What it changes.
    pub edit: fn(&mut PlantFile),
}

/// All of them.
pub(crate) const FOREIGN: &[Foreign] = &[
    Foreign {
        name: "as-modelled",
        edit: |_| {},
    },
    Foreign {
        name: "friction-low",
        edit: |plant| each(plant, |axis| scale_friction(axis, 0.7)),
    },
    Foreign {
        name: "friction-high",
        edit: |plant| each(plant, |axis| scale_friction(axis, 1.3)),
    },
    Foreign {
        name: "direction",
        edit: |plant| each(plant, |axis| vary(axis, |of| of.direction_share = 0.2)),
    },
    Foreign {
        name: "place",
        edit: |plant| {
            each(plant, |axis| {
                vary(axis, |of| (of.screw_share, of.wave_share) = (0.05, 0.10));
            });
        },
    },
    Foreign {
        name: "noise",
        edit: |plant| each(plant, noise),
    },
    Foreign {
        name: "torque-late",
        edit: |plant| each(plant, |axis| axis.measurement = Some(late(3.0))),
    },
    Foreign {
        name: "slow-current-loop",
        edit: |plant| each(plant, |axis| axis.motor.current_loop_hz = 200.0),
    },
    Foreign {
        name: "lugre",
        edit: |plant| each(plant, lugre),
    },
    Foreign {
        name: "lost-motion",
        edit: |plant| each(plant, lost_motion),
    },
    Foreign {
        name: "soft-screw",
        edit: |plant| each(plant, |axis| axis.screw.stiffness_n_per_m *= 0.5),
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
    },
    Foreign {
        name: "cutting",
        edit: |plant| each(plant, |axis| axis.cutting = Some(CUTTING)),
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
    },
    Foreign {
        name: "all-mildly",
        edit: |plant| each(plant, all_mildly),
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

fn noise(axis: &mut PlantAxis) {
    axis.measurement = Some(PlantMeasurement {
        period_error_nm: 20.0,
        encoder_noise_nm: 5.0,
        torque_step_percent: 0.1,
        torque_noise_percent: 0.5,
        ..RIGHT
    });
}

/// A torque that is shown late, in steps of 0.1 % and with noise of 0.5 %.
fn late(torque_delay_ms: f64) -> PlantMeasurement {
    PlantMeasurement {
        torque_delay_ms,
        torque_step_percent: 0.1,
        torque_noise_percent: 0.5,
        ..RIGHT
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
