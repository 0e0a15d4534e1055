use std::f64::consts::{FRAC_PI_2, PI, TAU};

use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

use super::*;

/// Fastest circle in which causes that come together are told apart within the limits of these tests: a turn in a second. In a
/// faster one the windows of the reversals cover most of it.
const TURN_RAD_S_MAX: f64 = TAU;

/// What a synthetic machine does wrong; written from errors of its axes, not from the marks that are fitted.
#[derive(Debug, Clone, Copy, Default)]
struct Faults {
    centre_um: [f64; 2],
    radius_um: f64,
    /// X too long by half of it, Y too short, in µm/m.
    scaling_um_m: f64,
    squareness_um_m: f64,
    /// X later than Y, in ms.
    lag_ms: f64,
    /// Lost motion of X and Y, in µm.
    lost_um: [f64; 2],
    /// Height of the spikes of X and Y that turn to the negative, in µm, and the way they take, in mm.
    spike_um: [f64; 2],
    /// Amplitude of an error with the lead of X, in µm.
    cyclic_um: f64,
    noise_um: f64,
}

fn setting(radius_mm: f64, feed_mm_s: f64) -> Setting {
    let angular_speed_rad_s = feed_mm_s / radius_mm;
    Setting {
        radius_mm,
        centre_mm: [3.0, -1.0],
        angular_speed_rad_s,
        window_rad: window_rad(angular_speed_rad_s),
        lead_mm: [10.0, 10.0],
    }
}

/// Sawtooth with an exponential tail behind a turn, of no shape that is fitted.
fn late(behind_rad: f64, width_rad: f64) -> f64 {
    let part = behind_rad / width_rad;
    match part {
        ..0.0 => 0.0,
        ..1.0 => part,
        _ => libm::exp(1.0 - part),
    }
}

/// Table of one direction, in mm about the programmed centre.
fn path(
    faults: &Faults,
    setting: &Setting,
    direction: f64,
    seed: u64,
) -> impl Iterator<Item = [f64; 2]> {
    let (faults, setting) = (*faults, *setting);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut noise = move || (rng.next_u64() as f64 / u64::MAX as f64 - 0.5) * libm::sqrt(12.0);
    (0..14_400).map(move |step| {
        let angle_rad = direction * (f64::from(step) + 0.5) * TAU / 14_400.0 * 2.0;
        let (sine, cosine) = (libm::sin(angle_rad), libm::cos(angle_rad));
        let (radius_mm, spin) = (setting.radius_mm, setting.angular_speed_rad_s * direction);
        let (x_mm, y_mm) = (radius_mm * cosine, radius_mm * sine);
        let (vx, vy) = (-spin * y_mm, spin * x_mm);
        let mut x_um = faults.centre_um[0] + faults.radius_um * cosine;
        let mut y_um = faults.centre_um[1] + faults.radius_um * sine;
        x_um += 0.5e-3 * faults.scaling_um_m * x_mm + 1e-3 * faults.squareness_um_m * y_mm;
        y_um -= 0.5e-3 * faults.scaling_um_m * y_mm;
        x_um -= 0.5 * faults.lag_ms * vx;
        y_um += 0.5 * faults.lag_ms * vy;
        // Behind a reversal the table stays until the gap is taken up.
        let since_rad = |turned_rad: f64| (direction * (angle_rad - turned_rad)).rem_euclid(PI);
        let way_um = |turned_rad: f64| 1e3 * radius_mm * (1.0 - libm::cos(since_rad(turned_rad)));
        let [x_lost_um, y_lost_um] = faults.lost_um;
        x_um -= vx.signum() * (way_um(0.0).min(x_lost_um) - 0.5 * x_lost_um);
        y_um -= vy.signum() * (way_um(FRAC_PI_2).min(y_lost_um) - 0.5 * y_lost_um);
        let width_rad = 0.15 * setting.window_rad.1;
        for (axis, (um, height_um)) in [&mut x_um, &mut y_um]
            .into_iter()
            .zip(faults.spike_um)
            .enumerate()
        {
            let side_rad = axis as f64 * FRAC_PI_2;
            let behind_rad = direction * (angle_rad - side_rad);
            let behind_rad = behind_rad - TAU * libm::round(behind_rad / TAU);
            *um += height_um * late(behind_rad, width_rad);
        }
        let place_mm = setting.centre_mm[0] + x_mm;
        x_um += faults.cyclic_um * libm::sin(TAU * place_mm / setting.lead_mm[0] + 0.7);
        let noise_um = faults.noise_um * noise();
        [
            x_mm + 1e-3 * (x_um + noise_um * cosine),
            y_mm + 1e-3 * (y_um + noise_um * sine),
        ]
    })
}

fn diagnosed(faults: &Faults, setting: &Setting, seed: u64) -> Diagnosis {
    let profiles = [1.0, -1.0].map(|direction| {
        let mut profile = Profile::default();
        for [x, y] in path(faults, setting, direction, seed) {
            let radial_mm = (x * x + y * y).sqrt() - setting.radius_mm;
            profile.take(libm::atan2(y, x), radial_mm * 1e3);
        }
        profile.readings().collect::<Vec<_>>()
    });
    let [one, other] = &profiles;
    diagnose(setting, &[(1.0, one), (-1.0, other)]).unwrap()
}

/// The same of one direction alone.
fn diagnosed_one_way(faults: &Faults, setting: &Setting, direction: f64, seed: u64) -> Diagnosis {
    let mut profile = Profile::default();
    for [x, y] in path(faults, setting, direction, seed) {
        let radial_mm = (x * x + y * y).sqrt() - setting.radius_mm;
        profile.take(libm::atan2(y, x), radial_mm * 1e3);
    }
    let readings: Vec<_> = profile.readings().collect();
    diagnose(setting, &[(direction, &readings)]).unwrap()
}

fn found(diagnosis: &Diagnosis, kind: CauseKind, axis: Option<usize>) -> Vec<Part> {
    let parts = diagnosis.parts.iter();
    parts
        .filter(|part| part.cause.kind == kind && part.cause.axis == axis)
        .copied()
        .collect()
}

fn value(diagnosis: &Diagnosis, kind: CauseKind, axis: Option<usize>) -> f64 {
    let parts = found(diagnosis, kind, axis);
    let sum: f64 = parts.iter().map(|part| part.value).sum();
    sum / parts.len().max(1) as f64
}

/// Every cause but these is below `most_um`.
fn only(diagnosis: &Diagnosis, kinds: &[CauseKind], most_um: f64) {
    for part in &diagnosis.parts {
        let expected = kinds.contains(&part.cause.kind) || part.effect_um < most_um;
        assert!(expected, "{part:?} in {diagnosis:?}");
    }
}

#[test]
fn a_pure_circle_off_its_centre_has_no_cause() {
    let faults = Faults {
        centre_um: [12.0, -7.0],
        ..Faults::default()
    };
    let diagnosis = diagnosed(&faults, &setting(50.0, 50.0), 1);
    assert_eq!(diagnosis.parts, []);
    assert!(diagnosis.deviation_rms_um < 0.03);
}

#[test]
#[expect(clippy::too_many_lines, reason = "one table of all causes")]
fn each_cause_alone_is_found_with_its_size_and_leads_the_list() {
    use CauseKind::*;
    let setting = setting(50.0, 50.0);
    let none = Faults::default();
    let cases = [
        (
            Radius,
            None,
            -4.0,
            Faults {
                radius_um: -4.0,
                ..none
            },
        ),
        (
            Scaling,
            None,
            90.0,
            Faults {
                scaling_um_m: 90.0,
                ..none
            },
        ),
        (
            Squareness,
            None,
            -60.0,
            Faults {
                squareness_um_m: -60.0,
                ..none
            },
        ),
        (
            ServoMismatch,
            None,
            0.08,
            Faults {
                lag_ms: 0.08,
                ..none
            },
        ),
        (
            LostMotion,
            Some(0),
            6.0,
            Faults {
                lost_um: [6.0, 0.0],
                ..none
            },
        ),
        (
            LostMotion,
            Some(1),
            -3.0,
            Faults {
                lost_um: [0.0, -3.0],
                ..none
            },
        ),
        (
            ReversalSpike,
            Some(0),
            9.0,
            Faults {
                spike_um: [9.0, 0.0],
                ..none
            },
        ),
        (
            ReversalSpike,
            Some(1),
            -5.0,
            Faults {
                spike_um: [0.0, -5.0],
                ..none
            },
        ),
        (
            Cyclic,
            Some(0),
            1.5,
            Faults {
                cyclic_um: 1.5,
                ..none
            },
        ),
    ];
    for (kind, axis, size, faults) in cases {
        let diagnosis = diagnosed(&faults, &setting, 2);
        let got = value(&diagnosis, kind, axis);
        let spike = kind == ReversalSpike;
        let within = if spike { 0.1 } else { 0.02 } * f64::abs(size);
        assert!(
            (got - size).abs() <= within,
            "{kind:?}: {got}, not {size}: {diagnosis:?}"
        );
        let first = diagnosis.parts[0];
        assert_eq!((first.cause.kind, first.cause.axis), (kind, axis));
        // The tip of a spike that is no sum of bumps; the end of the way on which a gap is taken up, within a bin.
        let most_um = match kind {
            ReversalSpike => 0.3 * f64::abs(size),
            LostMotion => f64::max(0.08 * f64::abs(size), 0.25),
            _ => 0.25,
        };
        only(&diagnosis, &[kind], most_um);
        let shares: f64 = diagnosis.parts.iter().map(|part| part.share_percent).sum();
        assert!((shares - 100.0).abs() < 1e-9);
    }
}

#[test]
fn noise_is_vibration_and_nothing_else() {
    let faults = Faults {
        noise_um: 1.0,
        ..Faults::default()
    };
    for seed in 0..10 {
        let diagnosis = diagnosed(&faults, &setting(25.0, 50.0), seed);
        let got_um = value(&diagnosis, CauseKind::Vibration, None);
        // What of it lies in the windows of reversals is not told from other things.
        assert!((0.6..1.1).contains(&got_um), "seed {seed}: {diagnosis:?}");
        assert_eq!(diagnosis.parts[0].cause.kind, CauseKind::Vibration);
        only(
            &diagnosis,
            &[CauseKind::Vibration, CauseKind::Unexplained],
            0.05,
        );
    }
}

#[test]
fn a_circle_narrower_than_two_turns_of_the_screw_has_no_cyclic_error() {
    let faults = Faults {
        cyclic_um: 1.0,
        ..Faults::default()
    };
    let diagnosis = diagnosed(&faults, &setting(6.0, 20.0), 3);
    assert_eq!(found(&diagnosis, CauseKind::Cyclic, Some(0)), []);
}

#[test]
fn a_spike_is_named_by_its_axis_and_the_direction_behind_it() {
    let faults = Faults {
        spike_um: [7.0, 0.0],
        ..Faults::default()
    };
    let diagnosis = diagnosed(&faults, &setting(100.0, 50.0), 4);
    let cause = diagnosis.parts[0].cause;
    assert_eq!((cause.axis, cause.new_direction), (Some(0), Some(-1)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn causes_that_come_together_are_told_apart(
        radius_mm in 12.0..100.0f64,
        feed_mm_s in 15.0..150.0f64,
        radius_um in -5.0..5.0f64,
        scaling_um_m in -100.0..100.0f64,
        squareness_um_m in -100.0..100.0f64,
        servo_um in -3.0..3.0f64,
        x_lost_um in -8.0..8.0f64,
        y_lost_um in -8.0..8.0f64,
        x_spike_um in 0.0..10.0f64,
        y_spike_um in 0.0..10.0f64,
        cyclic_um in 0.0..1.5f64,
        noise_um in 0.0..0.3f64,
        seed: u64,
    ) {
        let feed_mm_s = feed_mm_s.min(TURN_RAD_S_MAX * radius_mm);
        let setting = setting(radius_mm, feed_mm_s);
        let lag_ms = 2.0 * servo_um / feed_mm_s;
        let faults = Faults {
            centre_um: [4.0, 9.0],
            radius_um,
            scaling_um_m,
            squareness_um_m,
            lag_ms,
            lost_um: [x_lost_um, y_lost_um],
            spike_um: [x_spike_um, y_spike_um],
            cyclic_um,
            noise_um,
        };
        let diagnosis = diagnosed(&faults, &setting, seed);
        let near = |kind, axis, size: f64, within: f64| {
            let got = value(&diagnosis, kind, axis);
            prop_assert!((got - size).abs() <= within, "{kind:?} {axis:?}: {got}, not {size}: {diagnosis:?}");
            Ok(())
        };
        near(CauseKind::Radius, None, radius_um, 0.6)?;
        near(CauseKind::Scaling, None, scaling_um_m, 2.0 * 600.0 / radius_mm)?;
        near(CauseKind::Squareness, None, squareness_um_m, 2.0 * 500.0 / radius_mm)?;
        near(CauseKind::ServoMismatch, None, lag_ms, 2.0 * 0.5 / feed_mm_s)?;
        near(CauseKind::LostMotion, Some(0), x_lost_um, 1.2)?;
        near(CauseKind::LostMotion, Some(1), y_lost_um, 1.2)?;
        near(CauseKind::Cyclic, Some(0), cyclic_um, 0.5)?;
    }
}

#[test]
fn both_directions_of_one_circle_give_g_of_b_and_h() {
    let setting = setting(50.0, 50.0);
    let faults = Faults {
        centre_um: [2.0, 1.0],
        lost_um: [6.0, 0.0],
        ..Faults::default()
    };
    let mut one = Profile::default();
    let mut other = Profile::default();
    for (profile, direction) in [(&mut one, 1.0), (&mut other, -1.0)] {
        for [x, y] in path(&faults, &setting, direction, 5) {
            profile.take(libm::atan2(y, x), 1e3 * ((x * x + y * y).sqrt() - 50.0));
        }
    }
    let ranges = [&one, &other].map(|profile| profile.range_um([2.0, 1.0]));
    assert!(
        ranges
            .iter()
            .all(|range| (range.1 - range.0 - 6.0).abs() < 0.02)
    );
    let (apart_um, at_deg) = profile::hysteresis(&one, &other).unwrap();
    assert!((apart_um - 6.0).abs() < 0.1, "{apart_um}");
    let from_reversal_rad = at_deg.to_radians() % PI;
    assert!(from_reversal_rad.min(PI - from_reversal_rad) < 0.02);
}

#[test]
fn a_cyclic_error_is_named_with_its_pitch_also_where_that_is_half_the_lead() {
    let faults = Faults {
        cyclic_um: 1.5,
        ..Faults::default()
    };
    let of_lead = setting(50.0, 50.0);
    let pitch_mm = |diagnosis: &Diagnosis| {
        let parts = found(diagnosis, CauseKind::Cyclic, Some(0));
        assert!((parts[0].value - 1.5).abs() < 0.05, "{diagnosis:?}");
        parts[0].pitch_mm.expect("a pitch")
    };
    assert!((pitch_mm(&diagnosed(&faults, &of_lead, 6)) - 10.0).abs() < 1e-9);
    let profiles = [1.0, -1.0].map(|direction| {
        let mut profile = Profile::default();
        for [x, y] in path(&faults, &of_lead, direction, 6) {
            profile.take(libm::atan2(y, x), 1e3 * ((x * x + y * y).sqrt() - 50.0));
        }
        profile.readings().collect::<Vec<_>>()
    });
    let of_half = Setting {
        lead_mm: [20.0, 20.0],
        ..of_lead
    };
    let [one, other] = &profiles;
    let diagnosis = diagnose(&of_half, &[(1.0, one), (-1.0, other)]).unwrap();
    assert!((pitch_mm(&diagnosis) - 10.0).abs() < 1e-9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn one_direction_alone_does_not_tell_squareness_from_servo_mismatch_and_says_so(
        radius_mm in 20.0..100.0f64,
        feed_mm_s in 15.0..100.0f64,
        scaling_um_m in -100.0..100.0f64,
        squareness_um in -4.0..4.0f64,
        servo_um in -4.0..4.0f64,
        x_lost_um in -8.0..8.0f64,
        y_lost_um in -8.0..8.0f64,
        clockwise: bool,
        seed: u64,
    ) {
        let feed_mm_s = feed_mm_s.min(TURN_RAD_S_MAX * radius_mm);
        let setting = setting(radius_mm, feed_mm_s);
        let faults = Faults {
            scaling_um_m,
            // Each by its amplitude: R·α/2 and v·τ/2.
            squareness_um_m: 2.0 * squareness_um / radius_mm * 1e3,
            lag_ms: 2.0 * servo_um / feed_mm_s,
            lost_um: [x_lost_um, y_lost_um],
            ..Faults::default()
        };
        let direction = if clockwise { -1.0 } else { 1.0 };
        let diagnosis = diagnosed_one_way(&faults, &setting, direction, seed);
        for kind in [CauseKind::Squareness, CauseKind::ServoMismatch] {
            prop_assert!(found(&diagnosis, kind, None).is_empty(), "{diagnosis:?}");
        }
        let near = |kind, axis, size: f64, within: f64| {
            let got = value(&diagnosis, kind, axis);
            prop_assert!((got - size).abs() <= within, "{kind:?} {axis:?}: {got}, not {size}: {diagnosis:?}");
            Ok(())
        };
        let either_um = squareness_um + direction * servo_um;
        near(CauseKind::SquarenessOrServoMismatch, None, either_um, 0.5)?;
        near(CauseKind::Scaling, None, scaling_um_m, 2.0 * 500.0 / radius_mm)?;
        near(CauseKind::LostMotion, Some(0), x_lost_um, 1.2)?;
        near(CauseKind::LostMotion, Some(1), y_lost_um, 1.2)?;
    }
}

#[test]
fn a_circle_with_one_direction_has_no_h_and_no_g_of_b_and_an_arc_is_no_circle() {
    let setting = setting(50.0, 50.0);
    let faults = Faults {
        lost_um: [6.0, 0.0],
        ..Faults::default()
    };
    let mut arc = crate::measure::arc::plots::tests::arc(50.0, 360.0);
    arc.circle.clockwise = true;
    let all = path(&faults, &setting, -1.0, 7);
    let bars = |samples: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut meter = BallBarMeter::default();
        meter.take(&arc, samples);
        meter.finish(|_| Some(10.0))
    };
    let found = bars(&mut all.into_iter());
    let bar = &found[0];
    assert!(bar.counter_clockwise.is_none() && bar.clockwise.is_some());
    assert_eq!((bar.bidirectional_um, bar.hysteresis), (None, None));
    let diagnosis = bar.diagnosis.as_ref().expect("causes");
    assert!((value(diagnosis, CauseKind::LostMotion, Some(0)) - 6.0).abs() < 0.2);
    // 200° of it.
    let part = path(&faults, &setting, -1.0, 7).take(4000);
    assert!(bars(&mut part.into_iter()).is_empty());
}
