use proptest::prelude::*;

use super::*;

const INCREMENT_MM: f64 = 1e-6;
const PERIOD_S: f64 = 1e-3;

/// What a synthetic machine of two axes does wrong, in mm.
#[derive(Debug, Clone, Copy, Default)]
struct Faults {
    /// Table behind the motor, by axis: half the step.
    half_lost_mm: [f64; 2],
    /// Motor beside the command, across.
    following_mm: f64,
    /// Command beside the programmed path, across.
    command_mm: f64,
    /// Table beside the command in the 50 ms behind a reversal of X, across.
    reversal_mm: f64,
}

fn flat(x: f64, y: f64) -> AxisVector {
    let mut vector = AxisVector::zeros();
    (vector[0], vector[1]) = (x, y);
    vector
}

/// Turns on a circle of 30 mm at 1 rad/s: a lag along it is in all points.
fn parts(faults: &Faults) -> ContourParts {
    let increments_mm = [INCREMENT_MM; 2];
    let mut meter = ContourPartsMeter::new(&Kinematics::Cartesian, &increments_mm, PERIOD_S);
    let mut since_x = 1_000;
    for scan in 0..20_000 {
        let angle_rad = f64::from(scan) * PERIOD_S + 0.3;
        let spoke = flat(libm::cos(angle_rad), libm::sin(angle_rad));
        let tangent = flat(-spoke[1], spoke[0]);
        for axis in 0..2 {
            let position = libm::round(30.0 * spoke[axis] / INCREMENT_MM) as i64;
            meter.command(axis, position);
        }
        let before = angle_rad - PERIOD_S;
        if libm::sin(before) * libm::sin(angle_rad) < 0.0 {
            since_x = 0;
        }
        since_x += 1;
        let across = |mm: f64| spoke * mm;
        let setpoint = across(faults.command_mm);
        let motor = setpoint + across(faults.following_mm);
        let lost = flat(
            -faults.half_lost_mm[0] * tangent[0].signum(),
            -faults.half_lost_mm[1] * tangent[1].signum(),
        );
        let spike_mm = if since_x < 50 {
            faults.reversal_mm
        } else {
            0.0
        };
        let lag = tangent * 0.5;
        let table = motor + lost - tangent * lost.dot(&tangent) + across(spike_mm);
        let nearest = |across_mm: AxisVector| Nearest { across_mm, tangent };
        meter.take(&Reading {
            table: nearest(table),
            motor: nearest(motor),
            setpoint: nearest(setpoint),
            axes: spoke * 30.0 - lag,
        });
    }
    meter.finish()
}

fn of(parts: &ContourParts, cause: ContourCause, axis: Option<usize>) -> Option<ContourPart> {
    let mut all = parts.parts.iter();
    all.find(|part| part.cause == cause && part.axis == axis)
        .copied()
}

#[test]
fn a_table_on_its_path_has_no_parts() {
    assert_eq!(parts(&Faults::default()).parts, []);
}

#[test]
fn each_part_alone_leads_the_list() {
    let none = Faults::default();
    let cases = [
        (
            ContourCause::Command,
            None,
            Faults {
                command_mm: 0.004,
                ..none
            },
        ),
        (
            ContourCause::Following,
            None,
            Faults {
                following_mm: -0.003,
                ..none
            },
        ),
        (
            ContourCause::LostMotion,
            Some(0),
            Faults {
                half_lost_mm: [0.004, 0.0],
                ..none
            },
        ),
        (
            ContourCause::LostMotion,
            Some(1),
            Faults {
                half_lost_mm: [0.0, -0.002],
                ..none
            },
        ),
        (
            ContourCause::Reversal,
            Some(0),
            Faults {
                reversal_mm: 0.01,
                ..none
            },
        ),
    ];
    for (cause, axis, faults) in cases {
        let found = parts(&faults);
        let first = found.parts[0];
        assert_eq!((first.cause, first.axis), (cause, axis), "{found:?}");
        let shares: f64 = found.parts.iter().map(|part| part.share_percent).sum();
        assert!((shares - 100.0).abs() < 1e-9);
        assert!(first.share_percent > 80.0, "{found:?}");
    }
}

#[test]
fn a_lag_along_the_path_is_no_part() {
    let found = parts(&Faults {
        command_mm: 0.001,
        ..Faults::default()
    });
    assert!((found.rms_mm - 0.001).abs() < 1e-9, "{found:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn parts_that_come_together_are_told_apart(
        x_mm in -0.004..0.004f64,
        y_mm in -0.004..0.004f64,
        following_mm in -0.004..0.004f64,
        command_mm in -0.004..0.004f64,
    ) {
        let faults = Faults {
            half_lost_mm: [x_mm, y_mm],
            following_mm,
            command_mm,
            reversal_mm: 0.0,
        };
        let found = parts(&faults);
        // A reversal is one only after 0.1 µm of travel: some scans before that have the old direction.
        let most_mm = 0.02 * x_mm.abs().max(y_mm.abs()) + 1e-6;
        for (axis, half_mm) in [x_mm, y_mm].into_iter().enumerate() {
            let step_mm = of(&found, ContourCause::LostMotion, Some(axis)).and_then(|p| p.step_mm);
            prop_assert!((step_mm.unwrap_or(0.0) - 2.0 * half_mm).abs() < 2.0 * most_mm, "{found:?}");
        }
        let command = of(&found, ContourCause::Command, None).map_or(0.0, |part| part.rms_mm);
        prop_assert!((command - command_mm.abs()).abs() < 1e-9, "{found:?}");
        let rest = of(&found, ContourCause::Rest, None).map_or(0.0, |part| part.rms_mm);
        prop_assert!(rest < 5.0 * most_mm, "{found:?}");
    }
}
