#![allow(clippy::indexing_slicing)]

use super::*;
use crate::backlash::{Backlash, BacklashState};
use crate::feed_forward::FeedForward;
use crate::trigger::PositionErrorPart;

/// The command's speed, followed without error.
fn speeds(speed_mm_s: f64) -> Speeds {
    Speeds {
        command_mm_s: speed_mm_s,
        fed_command_mm_s: speed_mm_s,
        feed_forward_mm_s: speed_mm_s,
        proportional_mm_s: 0.0,
    }
}

struct Case {
    scan_s: f64,
    scans_per_period: u32,
    look_ahead_periods: usize,
    lead_s: f64,
}

const XY: Case = Case {
    scan_s: 1e-3,
    scans_per_period: 8,
    look_ahead_periods: 2,
    lead_s: 4e-3,
};

impl Case {
    fn block(&self) -> BacklashAcceleration {
        BacklashAcceleration {
            lead_s: self.lead_s,
            period_s: self.scan_s * f64::from(self.scans_per_period),
            increment_mm: 1e-6,
            scan_s: self.scan_s,
            trigger: Trigger::CommandAcceleration(PositionErrorPart::None),
            shape: PulseShape::Constant,
            pulse_mm_s: 1.0,
            pulse_scans: 10,
        }
    }

    /// Runs a path given in mm over seconds; the times at which pulses started, in s.
    fn pulses(&self, seconds: f64, path: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        let n = self.scans_per_period;
        let block = self.block();
        let backlash = Backlash { step_mm: 0.0 };
        let speed = FeedForward {
            scans_per_period: n,
            coefficient: 1.0,
            advance_scans: 1.0,
        };
        let setpoint = |k: i64| libm::rint(path(k as f64 * self.scan_s) * 1e6) as i64;
        let (mut state, mut sides) = (ReversalState::default(), BacklashState::default());
        let mut pulses = Vec::new();
        for k in 0..(seconds / self.scan_s) as i64 {
            let c = k.rem_euclid(n.into());
            let start = k - c - 1;
            let movement = MovementCommands::gather(
                setpoint(start - i64::from(n)),
                setpoint(start),
                c as u32,
                n,
                self.look_ahead_periods,
                |i| setpoint(k + i),
            );
            let ahead = (1..16).map(|i| setpoint(k + i));
            if backlash.update(&mut sides, setpoint(k - 1), setpoint(k), ahead) {
                block.reversed(&mut state);
            }
            if c == 0 {
                block.announce(&mut state, sides.direction, &movement);
            }
            let v = speed.increments_per_scan(&movement, c as u32) * 1e-6 / self.scan_s;
            let before = state.pulses;
            let pulse = block.update(&mut state, sides.direction, &speeds(v));
            if state.pulses > before {
                pulses.push((k as f64 * self.scan_s, pulse));
            }
        }
        pulses
    }
}

#[test]
fn the_pulse_starts_the_same_time_ahead_whatever_radius_and_feed_are() {
    // docs/methods/overview.md §2: t = −2·K·Ts², K = 31.25 1/s for a lead of 4 ms at Ts = 8 ms; true lead in (lead − Tp, lead].
    // At the highest accelerations (22 m/s² at R5 F20) the chord of the sine shortens it further, by less than a scan.
    assert!((XY.block().k_per_s() - 31.25).abs() < 1e-9);
    let modern = Case {
        scan_s: 0.25e-3,
        scans_per_period: 4,
        look_ahead_periods: 8,
        lead_s: 4e-3,
    };
    for case in [XY, modern] {
        for radius_mm in [5.0, 10.0, 25.0, 50.0, 100.0, 200.0] {
            for feed_m_min in [0.5, 1.0, 3.0, 10.0, 20.0] {
                let w = feed_m_min * 1000.0 / 60.0 / radius_mm;
                let acceleration = w * w * radius_mm;
                // Widest span of the modern timing: 9 periods of 1 ms; below, the difference says nothing.
                let span_s = if case.scans_per_period == 4 {
                    9e-3 * 1e-3
                } else {
                    2.0 * 64e-6
                };
                if acceleration * span_s < 21e-6 {
                    continue;
                }
                for phase in [0.0, 0.13, 0.41, 0.77] {
                    // Turns at w·t = 1 + phase·Ts·w (+ π).
                    let turn_s = 1.0 / w + phase * 8e-3;
                    let pulses = case.pulses(turn_s + 0.5 / w, |t| {
                        radius_mm * libm::cos(w * (t - turn_s))
                    });
                    assert_eq!(
                        pulses.len(),
                        1,
                        "R{radius_mm} F{feed_m_min} {phase}: {pulses:?}"
                    );
                    let (at_s, pulse) = pulses[0];
                    assert!(pulse < 0.0);
                    let lead_s = turn_s - at_s;
                    // The speed near a turn is a sine, not a line: asin(x) − x of it, later by the chord of |R2 − R0|.
                    let arc_s = 0.2 * w * w * case.lead_s * case.lead_s * case.lead_s + 1e-9;
                    let chord_s = case.lead_s * 0.4 * (w * 12e-3) * (w * 12e-3);
                    // Each of two movement commands is rounded by up to an increment.
                    let period_s = case.scan_s * f64::from(case.scans_per_period);
                    let difference = (acceleration * 2.0 * period_s * period_s * 1e6).max(20.0);
                    let rounding_s = case.lead_s * 2.0 / difference;
                    assert!(
                        lead_s > case.lead_s - case.scan_s - chord_s.min(case.scan_s) - rounding_s
                            && lead_s <= case.lead_s + arc_s + rounding_s,
                        "R{radius_mm} F{feed_m_min} phase {phase} Tp {}: lead {lead_s}",
                        case.scan_s
                    );
                }
            }
        }
    }
}

#[test]
fn a_lead_as_long_as_the_look_ahead_guarantees_is_reached_at_every_phase() {
    // (J − ½)·Ts less the scan in which a period begins: 11 ms of two periods of 8 ms. One period ahead, as in the
    // source, guarantees half a one. Phase 3 turns in the very middle of a period, whose movement command is 0.
    for look_ahead_periods in [1, 2, 4] {
        let case = Case {
            look_ahead_periods,
            lead_s: (look_ahead_periods as f64 - 0.5) * 8e-3 - 1e-3,
            ..XY
        };
        let (radius_mm, w) = (50.0, 1.0);
        for phase in 0..8 {
            let turn_s = 1.0 + f64::from(phase) * 1e-3;
            let pulses = case.pulses(1.5, |t| radius_mm * libm::cos(w * (t - turn_s)));
            assert_eq!(pulses.len(), 1, "{look_ahead_periods} {phase}: {pulses:?}");
            let lead_s = turn_s - pulses[0].0;
            assert!(
                lead_s > case.lead_s - 1.1e-3 && lead_s <= case.lead_s + 1e-4,
                "{look_ahead_periods} periods, phase {phase}: {lead_s}"
            );
        }
    }
}

#[test]
fn a_lead_shorter_than_the_rest_of_the_period_is_kept_at_every_phase() {
    for lead_ms in [1.0, 2.0, 3.0] {
        let case = Case {
            lead_s: lead_ms * 1e-3,
            ..XY
        };
        for phase in 0..16 {
            let turn_s = 1.0 + f64::from(phase) * 0.5e-3;
            let pulses = case.pulses(1.5, |t| 50.0 * libm::cos(t - turn_s));
            assert_eq!(pulses.len(), 1, "{lead_ms} {phase}: {pulses:?}");
            let found_ms = (turn_s - pulses[0].0) * 1e3;
            assert!(
                found_ms > lead_ms - 1.1 && found_ms <= lead_ms + 0.1,
                "{lead_ms} ms, phase {phase}: {found_ms} ms"
            );
        }
    }
}

#[test]
fn below_twenty_increments_the_pulse_starts_at_the_change_of_sign() {
    let coarse = Case {
        scan_s: 0.25e-3,
        scans_per_period: 4,
        look_ahead_periods: 1,
        lead_s: 0.5e-3,
    };
    // R200 F0.5: 0.35 mm/s², less than one increment per period squared.
    let (w, radius_mm) = (8.333 / 200.0, 200.0);
    let pulses = coarse.pulses(1.2, |t| radius_mm * libm::cos(w * (t - 1.0)));
    // Rounded to one increment the turn is flat for ±2.4 ms, and a reversal counts after ten of them ahead.
    assert_eq!(pulses.len(), 1);
    assert!((pulses[0].0 - 1.0).abs() < 0.010, "{pulses:?}");
}

#[test]
fn after_a_dwell_the_difference_is_no_acceleration() {
    // 10 mm/s forward, 40 ms at rest, 10 mm/s back.
    let path = |t: f64| {
        if t < 0.1 {
            10.0 * t
        } else {
            1.0 - 10.0 * (t - 0.14).max(0.0)
        }
    };
    let pulses = XY.pulses(0.3, path);
    assert_eq!(pulses.len(), 1, "{pulses:?}");
    assert!((0.132..0.150).contains(&pulses[0].0), "{pulses:?}");
    let mut state = ReversalState::default();
    let movement = MovementCommands::gather(-80_000, 0, 7, 8, 3, |i| {
        [0, 0, 0, -80_000][((i / 8) as usize).min(3)]
    });
    XY.block().announce(&mut state, 1, &movement);
    assert_eq!(
        (state.announcement(), state.trigger_speed_mm_s),
        (Announcement::Ahead, 0.0)
    );
}

#[test]
fn a_reversal_that_a_new_window_no_longer_has_is_disarmed() {
    let block = XY.block();
    let mut state = ReversalState::default();
    let turning = MovementCommands::gather(-800, 0, 0, 8, 2, |i| (100 - i) * i);
    let turning_back = MovementCommands::gather(0, 800, 7, 8, 2, |i| 800 - 100 * i);
    block.announce(&mut state, 1, &turning_back);
    assert_eq!(state.announcement(), Announcement::Ahead);
    block.announce(&mut state, 1, &turning);
    assert_eq!(state.announcement(), Announcement::None);
    assert_eq!(block.update(&mut state, 1, &speeds(0.0)), 0.0);
}

#[test]
fn a_running_pulse_runs_out_and_ends_at_rest() {
    let block = XY.block();
    let mut state = ReversalState::default();
    block.reversed(&mut state);
    let pulses: Vec<f64> = (0..12)
        .map(|_| block.update(&mut state, -1, &speeds(-0.1)))
        .collect();
    assert_eq!(pulses[..10], [-1.0; 10]);
    assert_eq!(pulses[10..], [0.0; 2]);
    assert_eq!(state.pulse_mm_s, 0.0);
}

fn decaying(presliding_mm: f64) -> BacklashAcceleration {
    BacklashAcceleration {
        shape: PulseShape::Decaying {
            decay_scans: 10.0,
            presliding_mm,
        },
        pulse_mm_s: 3.5,
        ..XY.block()
    }
}

/// Pulses of a reversal with this acceleration, whose trigger is reached in the first scan.
fn reversal(block: &BacklashAcceleration, acceleration_mm_s2: f64) -> Vec<f64> {
    let trigger_speed_mm_s = acceleration_mm_s2 * block.lead_s;
    let mut state = ReversalState {
        announcement: Announcement::Ahead as u32,
        trigger_speed_mm_s,
        ..ReversalState::default()
    };
    let mut pulses = Vec::new();
    for k in 0..1500 {
        let direction = if f64::from(k) * block.scan_s < block.lead_s {
            -1
        } else {
            1
        };
        let speed = acceleration_mm_s2 * f64::from(k) * block.scan_s - trigger_speed_mm_s;
        pulses.push(block.update(&mut state, direction, &speeds(speed)));
    }
    assert_eq!(state.pulses, 1);
    assert_eq!((state.pulse_mm_s, state.pulse_remaining_scans), (0.0, 0));
    pulses
}

#[test]
fn a_decaying_pulse_has_the_same_area_at_every_acceleration_and_ends_at_rest() {
    for presliding_mm in [0.0, 0.008] {
        // R150 F0.5 to R10 F10.
        for acceleration_mm_s2 in [0.46, 2.8, 100.0, 2800.0] {
            let pulses = reversal(&decaying(presliding_mm), acceleration_mm_s2);
            let area_um: f64 = pulses.iter().sum();
            assert!(
                (34.0..=35.0).contains(&area_um),
                "{presliding_mm} mm, {acceleration_mm_s2} mm/s²: {area_um}"
            );
            assert!(pulses.iter().all(|k| *k >= 0.0));
        }
    }
}

#[test]
fn a_decaying_pulse_lasts_as_long_as_friction_takes_to_turn_round() {
    let height = |acceleration: f64| {
        let pulses = reversal(&decaying(0.008), acceleration);
        let peak = pulses.iter().copied().fold(0.0, f64::max);
        (peak, pulses.iter().filter(|k| **k > 0.2 * peak).count())
    };
    let (fast_mm_s, fast_scans) = height(2800.0);
    let (slow_mm_s, slow_scans) = height(2.8);
    // At once, it would be 3.33 mm/s (h, mean over a scan) and 16 scans (ln 5 · τ).
    assert!((2.4..3.33).contains(&fast_mm_s), "{fast_mm_s}");
    assert!((16..22).contains(&fast_scans), "{fast_scans}");
    // sqrt(2·8 µm/a) is 76 ms.
    assert!((0.2..0.5).contains(&slow_mm_s), "{slow_mm_s}");
    assert!((76..152).contains(&slow_scans), "{slow_scans}");
}

#[test]
fn friction_that_turns_at_once_gets_a_plain_exponential() {
    let pulses = reversal(&decaying(0.0), 100.0);
    assert!((pulses[0] - 3.5 * 10.0 * (1.0 - libm::exp(-0.1))).abs() < 1e-12);
    for pair in pulses.windows(2).filter(|pair| pair[1] > 0.0) {
        assert!((pair[1] / pair[0] - libm::exp(-0.1)).abs() < 1e-12);
    }
    assert_eq!(pulses[50..], [0.0; 1450]);
}

#[test]
fn a_decaying_pulse_whose_command_stops_or_turns_away_ends_at_rest() {
    let block = decaying(0.008);
    for (acceleration_mm_s2, speed_mm_s) in
        [(100.0, 0.0), (0.0, 0.0), (100.0, -50.0), (100.0, f64::NAN)]
    {
        let mut state = ReversalState {
            announcement: Announcement::Ahead as u32,
            trigger_speed_mm_s: acceleration_mm_s2 * block.lead_s,
            ..ReversalState::default()
        };
        block.update(&mut state, -1, &speeds(1.0));
        assert_eq!((state.pulses, state.pulse_direction), (1, 1));
        for _ in 0..1000 {
            let pulse = block.update(&mut state, 1, &speeds(speed_mm_s));
            assert!((0.0..3.5).contains(&pulse), "{speed_mm_s}: {pulse}");
        }
        assert_eq!((state.pulse_mm_s, state.pulse_remaining_scans), (0.0, 0));
    }
}

#[test]
fn a_second_reversal_adds_its_pulse_to_what_is_left_of_the_first() {
    let block = decaying(0.0);
    let mut state = ReversalState::default();
    block.reversed(&mut state);
    let first = block.update(&mut state, 1, &speeds(0.1));
    block.reversed(&mut state);
    let second = block.update(&mut state, -1, &speeds(-0.1));
    assert!((second - first * (libm::exp(-0.1) - 1.0)).abs() < 1e-12);
}

#[test]
fn a_speed_that_is_not_a_number_starts_nothing() {
    let mut state = ReversalState::default();
    XY.block().reversed(&mut state);
    assert_eq!(XY.block().update(&mut state, 1, &speeds(f64::NAN)), 0.0);
    assert_eq!(state.pulses, 0);
}
