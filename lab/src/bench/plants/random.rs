//! A plant drawn at random: any structures of the table together, and every number another one.

use plant_sim::plant_file::{PlantAxis, PlantFile};
use plant_sim::script::rng::Rng;

use super::foreign::{FOREIGN, Foreign};

/// Every number is multiplied by one between these.
const PART: (f64, f64) = (0.6, 1.4);
/// Random numbers that a plant may take: plants of one seed have none in common.
const NUMBERS: u64 = 4096;
/// Most scans by which a torque is shown late.
const TORQUE_DELAY_SCANS_MAX: f64 = 16.0;

/// A plant and what it is made of.
#[derive(Debug, Clone)]
pub(super) struct RandomPlant {
    /// The plant.
    pub file: PlantFile,
    /// Its structures.
    pub structures: Vec<&'static str>,
}

/// All structures that a random plant may have.
pub(super) fn structures() -> impl Iterator<Item = &'static Foreign> {
    FOREIGN.iter().filter(|foreign| foreign.is_structure)
}

/// The plant of this number among those of a seed, from a machine's own: each structure is there or not, all sets of them alike likely.
///
/// What is not a matter of the plant stays: lead, counts, periods and poles of a turn, start, dead time.
pub(super) fn draw(own: &PlantFile, seed: u64, number: u64, scan_s: f64) -> RandomPlant {
    let mut rng = Rng::after(seed, number.wrapping_mul(NUMBERS));
    let mut file = own.clone();
    let mut structures_of = Vec::new();
    for structure in structures() {
        if rng.one_in(2) {
            (structure.edit)(&mut file);
            structures_of.push(structure.name);
        }
    }
    for axis in &mut file.axes {
        vary(axis, &mut rng);
        if let Some(measurement) = &mut axis.measurement {
            let most_ms = TORQUE_DELAY_SCANS_MAX * scan_s * 1e3;
            measurement.torque_delay_ms = measurement.torque_delay_ms.min(most_ms);
        }
    }
    // What is stiffer and lighter needs a finer step.
    while !file.microstep_fits() {
        file.microstep_us *= 0.5;
    }
    RandomPlant {
        file,
        structures: structures_of,
    }
}

/// Every number of an axis.
fn vary(axis: &mut PlantAxis, rng: &mut Rng) {
    let mut part = |value: &mut f64| *value *= rng.between(PART.0, PART.1);
    let motor = &mut axis.motor;
    part(&mut motor.rated_torque_nm);
    part(&mut motor.peak_torque_nm);
    part(&mut motor.inertia_kg_m2);
    part(&mut motor.current_loop_hz);
    part(&mut motor.cogging_torque_nm);
    part(&mut motor.winding_rise_at_rated_k);
    part(&mut motor.winding_time_constant_min);
    motor.peak_torque_nm = motor.peak_torque_nm.max(motor.rated_torque_nm);
    let friction = &mut motor.friction;
    let mut risen_nm = friction.static_torque_nm - friction.coulomb_torque_nm;
    part(&mut risen_nm);
    part(&mut friction.coulomb_torque_nm);
    friction.static_torque_nm = friction.coulomb_torque_nm + risen_nm;
    part(&mut friction.viscous_nm_s_per_rad);
    part(&mut friction.stribeck_velocity_mm_s);
    friction.element_share.iter_mut().for_each(&mut part);
    friction.break_distance_um.iter_mut().for_each(&mut part);
    part(&mut friction.presliding_damping_n_s_per_m);
    part(&mut friction.attraction_ms);
    to_one(&mut friction.element_share);

    let screw = &mut axis.screw;
    part(&mut screw.stiffness_n_per_m);
    part(&mut screw.damping_ratio);
    part(&mut screw.gap_um);
    screw.hysteresis_n.iter_mut().for_each(&mut part);
    screw.hysteresis_um.iter_mut().for_each(&mut part);
    part(&mut axis.table.mass_kg);
    let friction = &mut axis.table.friction;
    let mut risen_n = friction.static_n - friction.coulomb_n;
    part(&mut risen_n);
    part(&mut friction.coulomb_n);
    friction.static_n = friction.coulomb_n + risen_n;
    part(&mut friction.viscous_n_s_per_m);
    part(&mut friction.stribeck_velocity_mm_s);
    friction.element_share.iter_mut().for_each(&mut part);
    friction.break_distance_um.iter_mut().for_each(&mut part);
    part(&mut friction.presliding_damping_n_s_per_m);
    part(&mut friction.attraction_ms);
    to_one(&mut friction.element_share);
    if let Some(scale) = &mut axis.scale {
        part(&mut scale.resolution_nm);
    }
    vary_structures(axis, rng);
}

/// The numbers of what not every axis has.
fn vary_structures(axis: &mut PlantAxis, rng: &mut Rng) {
    let mut part = |value: &mut f64| *value *= rng.between(PART.0, PART.1);
    if let Some(of) = &mut axis.measured_friction {
        // The curve as a whole: as high, and as steep, as the contact may be.
        let mut high = 1.0;
        part(&mut high);
        of.force_n.iter_mut().for_each(|force_n| *force_n *= high);
        let mut wide = 1.0;
        part(&mut wide);
        let speeds = of.speed_mm_s.iter_mut();
        speeds.for_each(|speed_mm_s| *speed_mm_s *= wide);
    }
    if let Some(of) = &mut axis.variation {
        part(&mut of.direction_share);
        part(&mut of.screw_share);
        part(&mut of.wave_share);
        part(&mut of.wave_length_mm);
        part(&mut of.warm_share);
        part(&mut of.warm_time_constant_s);
        part(&mut of.rest_share);
        part(&mut of.rest_time_constant_s);
    }
    if let Some(of) = &mut axis.attached_mass {
        part(&mut of.mass_kg);
        part(&mut of.frequency_hz);
        part(&mut of.damping_ratio);
    }
    if let Some(of) = &mut axis.frame {
        part(&mut of.mass_kg);
        part(&mut of.frequency_hz);
        part(&mut of.damping_ratio);
    }
    for of in &mut axis.cross_talk {
        part(&mut of.squareness_um_per_m);
        part(&mut of.straightness_um);
        part(&mut of.straightness_length_mm);
        part(&mut of.friction_share_per_m);
    }
    if let Some(of) = &mut axis.cutting {
        part(&mut of.force_n);
        part(&mut of.tooth_n);
        part(&mut of.tooth_hz);
        part(&mut of.on_s);
        part(&mut of.off_s);
    }
    if let Some(of) = &mut axis.measurement {
        part(&mut of.period_error_nm);
        part(&mut of.encoder_noise_nm);
        part(&mut of.torque_delay_ms);
        part(&mut of.torque_step_percent);
        part(&mut of.torque_noise_percent);
        of.seed = rng.bits() >> 32;
    }
}

/// Shares whose sum is 1.
fn to_one(shares: &mut [f64]) {
    let sum: f64 = shares.iter().sum();
    shares.iter_mut().for_each(|share| *share /= sum);
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn own() -> PlantFile {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        PlantFile::load(&folder).expect("plant.toml")
    }

    #[test]
    fn a_random_plant_is_the_same_for_its_seed_and_number_and_no_other_is() {
        let draw = |seed, number| draw(&own(), seed, number, 1e-3).file;
        assert_eq!(draw(3, 7), draw(3, 7));
        assert_ne!(draw(3, 7), draw(3, 8));
        assert_ne!(draw(3, 7), draw(4, 7));
    }

    #[test]
    fn every_random_plant_is_one_that_a_plant_file_may_be() {
        let own = own();
        let mut counts = vec![0; structures().count()];
        for number in 0..500 {
            let plant = draw(&own, 11, number, 1e-3);
            for (count, structure) in counts.iter_mut().zip(structures()) {
                *count += usize::from(plant.structures.contains(&structure.name));
            }
            assert!(plant.file.microstep_fits(), "{number}");
            assert!(plant.file.microstep_us >= 5.0, "{number}");
            for axis in &plant.file.axes {
                let (motor, table) = (&axis.motor, &axis.table.friction);
                let friction = &motor.friction;
                assert!(motor.peak_torque_nm >= motor.rated_torque_nm, "{number}");
                assert!(friction.static_torque_nm > friction.coulomb_torque_nm);
                assert!(friction.static_torque_nm < motor.peak_torque_nm);
                assert!(table.static_n > table.coulomb_n, "{number}");
                for shares in [friction.element_share, table.element_share] {
                    assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9);
                }
                if let Some(of) = axis.variation {
                    assert!(of.direction_share.abs() <= 0.9 && of.wave_share <= 0.45);
                }
            }
        }
        assert!(
            counts.iter().all(|count| (200..300).contains(count)),
            "{counts:?}"
        );
    }
}
