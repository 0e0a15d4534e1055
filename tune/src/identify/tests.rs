use loops::maxwell_slip::{Level, MaxwellSlip, SlipElement};

use super::*;

const SCAN_S: f64 = 1e-3;
const LEAD_MM: f64 = 10.0;

/// Slip elements of these Coulomb forces along a position, without Stribeck effect.
fn friction_n(element_n: [f64; ELEMENTS], positions_mm: &[f64]) -> Vec<f64> {
    let mut slip = MaxwellSlip {
        stribeck_velocity_mm_s: 1.0,
        ..MaxwellSlip::default()
    };
    for ((place, slip_n), um) in slip.elements.iter_mut().zip(element_n).zip(BREAK_UM) {
        *place = SlipElement {
            slip_n,
            break_distance_mm: um * 1e-3,
        };
    }
    let mut state = [0.0; ELEMENTS];
    let mut before = positions_mm[0];
    positions_mm
        .iter()
        .map(|position| {
            let force = slip.update(&mut state, position - before, 0.0, &Level::TUNED);
            before = *position;
            force
        })
        .collect()
}

fn rate(values: &[f64]) -> Vec<f64> {
    let at = |i: usize| values[i.min(values.len() - 1)];
    (0..values.len())
        .map(|i| (at(i + 1) - at(i.saturating_sub(1))) / (2.0 * SCAN_S) * 1e-3)
        .collect()
}

/// A table of 100 kg behind 120 N/µm and a gap of 5 µm, a motor of 700 kg: driven so that the table goes along a sine.
fn recording(amplitude_mm: f64, period_s: f64, scale: bool) -> Recording {
    let table_mm: Vec<f64> = (0..12_000)
        .map(|i| {
            let turns = f64::from(i) * SCAN_S / period_s;
            amplitude_mm * libm::sin(2.0 * core::f64::consts::PI * turns)
        })
        .collect();
    let newton = |mass_kg: f64, viscous: f64, positions_mm: &[f64], friction_n: &[f64]| {
        let speed = rate(positions_mm);
        let at = |i: usize| positions_mm[i.min(positions_mm.len() - 1)];
        let acceleration: Vec<f64> = (0..positions_mm.len())
            .map(|i| (at(i + 1) - 2.0 * at(i) + at(i.saturating_sub(1))) / SCAN_S / SCAN_S * 1e-3)
            .collect();
        (0..positions_mm.len())
            .map(|i| mass_kg * acceleration[i] + viscous * speed[i] + friction_n[i])
            .collect::<Vec<f64>>()
    };
    let slow = friction_n([40.0, 60.0, 60.0, 40.0, 0.0, 0.0], &table_mm);
    let contact_n = newton(100.0, 1000.0, &table_mm, &slow);
    let motor_mm: Vec<f64> = table_mm
        .iter()
        .zip(&contact_n)
        .map(|(x, n)| x + (n / 120.0 + 2.5 * n.signum()) * 1e-3)
        .collect();
    let fast = friction_n([100.0, 80.0, 50.0, 20.0, 0.0, 0.0], &motor_mm);
    let own_n = newton(700.0, 1500.0, &motor_mm, &fast);
    let lever = 2.0 * core::f64::consts::PI / (LEAD_MM * 1e-3);
    Recording {
        scan_s: SCAN_S,
        torque_nm: own_n
            .iter()
            .zip(&contact_n)
            .map(|(own, contact)| (own + contact) / lever)
            .collect(),
        velocity_command_mm_s: vec![0.0; motor_mm.len()],
        torque_command_nm: vec![0.0; motor_mm.len()],
        scale_mm: if scale { table_mm } else { motor_mm.clone() },
        motor_mm,
        dead_time_scans: 1,
        gain_n_s_per_m: 0.0,
    }
}

fn found(scale: bool) -> Found {
    let runs: Vec<Recording> = [(0.5, 1.7), (5.0, 0.9), (20.0, 0.6)]
        .into_iter()
        .map(|(amplitude_mm, period_s)| recording(amplitude_mm, period_s, scale))
        .collect();
    models(
        &runs,
        &recording(15.0, 11.0, scale),
        &Lever::of_lead(LEAD_MM),
    )
    .remove(0)
}

fn near(what: &str, value: f64, right: f64, percent: f64) {
    let off = (value / right - 1.0).abs() * 100.0;
    assert!(off <= percent, "{what} {value}, really {right}");
}

#[test]
fn a_machine_that_is_as_the_model_says_is_found_again() {
    let found = found(true);
    let table = found.table.expect("a table");
    near("mass", found.mass_kg(), 800.0, 2.0);
    near("friction", found.coulomb_n(), 450.0, 3.0);
    near("viscous", found.viscous_n_s_per_m(), 2500.0, 5.0);
    near("table mass", table.mass_kg, 100.0, 10.0);
    near("table friction", table.friction.coulomb_n(), 200.0, 10.0);
    near("stiffness", table.stiffness_n_per_um, 120.0, 10.0);
    near("gap", table.gap_um, 5.0, 6.0);
    near(
        "lost motion",
        found.lost_motion_um(),
        5.0 + 400.0 / 120.0,
        3.0,
    );
}

#[test]
fn without_a_scale_the_sums_are_found_and_no_table() {
    let found = found(false);
    assert!(found.table.is_none());
    near("mass", found.mass_kg(), 800.0, 3.0);
    near("friction", found.coulomb_n(), 450.0, 5.0);
}

#[test]
fn a_torque_that_is_shown_late_is_brought_into_step() {
    let late = |recording: Recording| {
        let mut torque_nm = vec![0.0; 3];
        torque_nm.extend(&recording.torque_nm);
        torque_nm.truncate(recording.torque_nm.len());
        Recording {
            torque_nm,
            ..recording
        }
    };
    let runs = [(5.0, 0.9), (20.0, 0.6)]
        .map(|(amplitude_mm, period_s)| late(recording(amplitude_mm, period_s, true)));
    let steady = late(recording(15.0, 11.0, true));
    let found = models(&runs, &steady, &Lever::of_lead(LEAD_MM)).remove(0);
    assert_eq!((found.torque_late_s * 1e3).round(), 3.0);
    near("mass", found.mass_kg(), 800.0, 2.0);
    let said = crate::judge::remarks(&found).join("\n");
    assert!(said.contains("3.00 ms late"), "{said}");
    assert_eq!(self::found(true).torque_late_s, 0.0);
}

#[test]
fn a_constant_force_and_friction_by_direction_are_found_and_told() {
    let uneven = |mut recording: Recording| {
        let lever = crate::newtons_per_nm(LEAD_MM);
        let speeds = rate(&recording.motor_mm);
        for (torque_nm, speed_m_s) in recording.torque_nm.iter_mut().zip(speeds) {
            *torque_nm += (90.0 + 800.0 * speed_m_s.abs()) / lever;
        }
        recording
    };
    let runs: Vec<Recording> = [(0.5, 1.7), (5.0, 0.9), (20.0, 0.6)]
        .into_iter()
        .map(|(amplitude_mm, period_s)| uneven(recording(amplitude_mm, period_s, true)))
        .collect();
    let steady = uneven(recording(15.0, 11.0, true));
    let found = models(&runs, &steady, &Lever::of_lead(LEAD_MM)).remove(0);
    near(
        "constant force",
        found.whole_structure().constant_n,
        90.0,
        10.0,
    );
    near(
        "by direction",
        found.whole_structure().viscous_n_s_per_m,
        800.0,
        10.0,
    );
    near("mass", found.mass_kg(), 800.0, 2.0);
    let said = crate::judge::remarks(&found).join("\n");
    assert!(said.contains("forward") && said.contains("back"), "{said}");
}

#[test]
fn noise_is_told_from_what_is_not_explained() {
    let mut state = 1u64;
    let mut noise = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        // Uniform, of standard deviation 1.
        ((state >> 40) as f64 / 16_777_216.0 - 0.5) * 12f64.sqrt()
    };
    let mut noisy = |mut recording: Recording| {
        for torque_nm in &mut recording.torque_nm {
            *torque_nm += 0.05 * noise();
        }
        recording
    };
    let runs: Vec<Recording> = [(0.5, 1.7), (5.0, 0.9), (20.0, 0.6)]
        .into_iter()
        .map(|(amplitude_mm, period_s)| noisy(recording(amplitude_mm, period_s, true)))
        .collect();
    let steady = noisy(recording(15.0, 11.0, true));
    let found = models(&runs, &steady, &Lever::of_lead(LEAD_MM)).remove(0);
    // 0.05 N·m are 31 N; two running means over five leave a third of it: √(51/375).
    near(
        "noise",
        found.noise_n,
        31.4 * (51.0_f64 / 375.0).sqrt(),
        25.0,
    );
    let clean = self::found(true);
    assert!(clean.noise_n < 2.0, "{}", clean.noise_n);
    assert_eq!(crate::judge::refusal(Some(5000.0), &found), None);
}

#[test]
fn a_torque_that_has_nothing_to_do_with_the_motion_is_refused() {
    let strange = |mut recording: Recording| {
        for (index, torque_nm) in recording.torque_nm.iter_mut().enumerate() {
            *torque_nm = libm::sin(0.37 * index as f64) + libm::sin(0.011 * index as f64);
        }
        recording
    };
    let runs = [strange(recording(5.0, 0.9, false))];
    let found = models(
        &runs,
        &strange(recording(15.0, 11.0, false)),
        &Lever::of_lead(LEAD_MM),
    );
    let why = crate::judge::refusal(Some(5000.0), &found[0]).expect("refused");
    assert!(why.contains("torque"), "{why}");
}

#[test]
fn a_scale_that_does_not_follow_the_motor_is_left_alone_and_told() {
    let lost = |mut recording: Recording| {
        recording.scale_mm = recording.scale_mm.iter().map(|_| 0.001).collect();
        recording
    };
    let runs = [lost(recording(5.0, 0.9, true))];
    let steady = lost(recording(15.0, 11.0, true));
    let found = &models(&runs, &steady, &Lever::of_lead(LEAD_MM))[0];
    let refused = crate::judge::refusal(Some(5000.0), found);
    assert!(found.table.is_none() || refused.is_some(), "{found:?}");
}
