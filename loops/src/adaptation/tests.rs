use proptest::prelude::*;

use super::*;
use crate::maxwell_slip::{ELEMENTS, MaxwellSlip, SlipElement};

const ADAPTATION: Adaptation = Adaptation {
    learns: true,
    scan_s: 1e-3,
    mass_kg: 865.0,
    coulomb_n: 450.0,
    viscous_n_s_per_m: 2600.0,
    table_coulomb_n: 200.0,
    table_mass_kg: 110.0,
    gap_mm: 0.005,
    acceleration_max_mm_s2: 3000.0,
};

fn curve() -> MaxwellSlip {
    let mut elements = [SlipElement::default(); ELEMENTS];
    let all = [(180.0, 0.5), (130.0, 4.0), (90.0, 10.0), (50.0, 60.0)];
    for (element, (slip_n, break_um)) in elements.iter_mut().zip(all) {
        *element = SlipElement {
            slip_n,
            break_distance_mm: break_um * 1e-3,
        };
    }
    MaxwellSlip {
        elements,
        static_excess: 0.0,
        stribeck_velocity_mm_s: 3.0,
    }
}

/// What is true of an axis, over simulated time in s and by direction, beside the friction of the model.
struct Truth<F: Fn(f64, f64) -> f64> {
    level: Level,
    beside_n: F,
}

/// Goes to and fro on a circle of 25 mm at 50 mm/s; the level in force at the end of each turn.
fn turns<F: Fn(f64, f64) -> f64>(
    adaptation: &Adaptation,
    state: &mut AdaptationState,
    count: u32,
    truth: &Truth<F>,
) -> Vec<Level> {
    let curve = curve();
    let (mut model, mut real) = ([0.0; ELEMENTS], [0.0; ELEMENTS]);
    let mut levels = Vec::new();
    let scans = (std::f64::consts::TAU * 25.0 / 50.0 / adaptation.scan_s) as u32;
    let place =
        |scan: u32| 25.0 * libm::sin(f64::from(scan) / f64::from(scans) * std::f64::consts::TAU);
    for scan in 1..=count * scans {
        let travel_mm = place(scan) - place(scan - 1);
        let level = adaptation.belief(state, 1.0).level;
        let fed_n = curve.update(&mut model, travel_mm, 50.0, &level);
        let true_n = curve.update(&mut real, travel_mm, 50.0, &truth.level);
        let now_s = f64::from(scan) * adaptation.scan_s;
        let seen = Seen {
            lacking_n: true_n - fed_n + (truth.beside_n)(now_s, travel_mm.signum()),
            deviation_mm: 0.0,
            friction_n: curve.at_level_1_n(&model, &level),
            level,
            travel_mm,
            counts: true,
            ..Seen::default()
        };
        adaptation.update(state, &seen, 1.0);
        if scan % scans == 0 {
            levels.push(adaptation.belief(state, 1.0).level);
        }
    }
    levels
}

fn of_level(level: f64) -> Truth<impl Fn(f64, f64) -> f64> {
    Truth {
        level: Level::all(level),
        beside_n: |_, _| 0.0,
    }
}

#[test]
fn friction_that_fell_or_rose_is_found_in_two_turns() {
    for level in [0.7, 1.3] {
        let mut state = AdaptationState::default();
        let levels = turns(&ADAPTATION, &mut state, 3, &of_level(level));
        let last = levels[2];
        assert!((last.early - level).abs() < 0.03, "{level}: {levels:?}");
        assert!((last.late - level).abs() < 0.05, "{level}: {levels:?}");
        assert!(state.unexplained < 0.02, "{}", state.unexplained);
    }
}

#[test]
fn what_is_as_tuned_stays_to_the_bit() {
    let mut state = AdaptationState::default();
    for level in turns(&ADAPTATION, &mut state, 4, &of_level(1.0)) {
        assert_eq!(level, Level::TUNED);
    }
}

#[test]
fn a_weight_that_hangs_on_the_axis_is_not_taken_for_friction() {
    let weight = Truth {
        level: Level::TUNED,
        beside_n: |_, _| 300.0,
    };
    let mut state = AdaptationState::default();
    let levels = turns(&ADAPTATION, &mut state, 6, &weight);
    assert!((levels[5].early - 1.0).abs() < 0.02, "{levels:?}");
}

#[test]
fn a_tool_that_cuts_on_and_off_teaches_nothing_wrong() {
    let cut = Truth {
        level: Level::TUNED,
        beside_n: |now_s: f64, _| {
            let on = (now_s * 1.7) % 1.0 < 0.5;
            let tooth_n = 40.0 * libm::sin(now_s * std::f64::consts::TAU * 133.0);
            if on { 120.0 + tooth_n } else { 0.0 }
        },
    };
    let mut state = AdaptationState::default();
    for level in turns(&ADAPTATION, &mut state, 20, &cut) {
        assert!((level.early - 1.0).abs() < 0.08, "{level:?}");
    }
}

#[test]
fn frozen_it_stays_where_it_was_and_an_axis_at_rest_teaches_nothing() {
    let frozen = Adaptation {
        learns: false,
        ..ADAPTATION
    };
    let mut state = AdaptationState::default();
    turns(&frozen, &mut state, 2, &of_level(0.7));
    assert_eq!(state, AdaptationState::default());
    assert_eq!(frozen.belief(&state, 0.9).level, Level::all(0.9));
    turns(&ADAPTATION, &mut state, 3, &of_level(0.7));
    let before = ADAPTATION.belief(&state, 1.0).level;
    for _ in 0..5000 {
        let at_rest = Seen {
            lacking_n: 500.0,
            counts: true,
            ..Seen::default()
        };
        ADAPTATION.update(&mut state, &at_rest, 1.0);
    }
    assert_eq!(ADAPTATION.belief(&state, 1.0).level, before);
}

#[test]
fn what_was_learned_stays_when_the_loop_opens() {
    let mut state = AdaptationState::default();
    turns(&ADAPTATION, &mut state, 3, &of_level(0.7));
    let believed = state.believed;
    state.leave();
    assert_eq!(state.believed, believed);
    let level = ADAPTATION.belief(&state, 1.0).level;
    assert!((level.early - 0.7).abs() < 0.03);
}

proptest! {
    /// Whatever is seen, numbers or none: what is believed keeps within its bounds, and goes by steps that are bounded.
    #[test]
    fn whatever_is_seen_it_stays_bounded(
        seeds in prop::collection::vec((any::<f64>(), -1e4..1e4_f64, -1.0..1.0_f64, -600.0..600.0_f64, any::<bool>()), 1..60),
        lengths in prop::collection::vec(1_u32..200, 60),
    ) {
        let mut state = AdaptationState::default();
        for ((wild, lacking_n, travel_mm, friction_n, counts), length) in seeds.into_iter().zip(lengths) {
            for scan in 0..length {
                let seen = Seen {
                    lacking_n: if scan == 0 { wild } else { lacking_n },
                    deviation_mm: 0.01 * travel_mm,
                    friction_n: [friction_n, 0.2 * friction_n],
                    level: ADAPTATION.belief(&state, 1.0).level,
                    travel_mm,
                    compensation_mm: 0.3 * travel_mm,
                    wind_mm: 1e-5 * lacking_n,
                    counts,
                };
                let before = state.believed;
                let began = state.begun == 1;
                ADAPTATION.update(&mut state, &seen, 1.0);
                let [all, late, constant] = state.believed;
                if state.begun == 1 {
                    prop_assert!((LEVEL_MIN..=LEVEL_MAX).contains(&all), "{all}");
                    prop_assert!((-LATE_MAX..=LATE_MAX).contains(&late), "{late}");
                    prop_assert!((-CONSTANT_MAX..=CONSTANT_MAX).contains(&constant), "{constant}");
                }
                if began {
                    for (now, before) in state.believed.iter().zip(before) {
                        prop_assert!((now - before).abs() <= CHANGE_MAX + 1e-12);
                    }
                }
                let level = ADAPTATION.belief(&state, 1.0).level;
                prop_assert!(level.early.is_finite() && level.late.is_finite());
                let belief = ADAPTATION.belief(&state, 1.0);
                prop_assert!(belief.load_n.abs() <= 0.6 * 200.0);
                prop_assert!((-0.005..=0.005).contains(&belief.gap_mm), "{}", belief.gap_mm);
            }
        }
    }
}
