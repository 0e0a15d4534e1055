//! Pick and place through real processes: what a parabola of speed saves of the motor's heat against a triangle.

use std::fs;
use std::path::Path;

use crate::support::{Bench, number, planned, run, text};

/// Distance and time of each move, and the wait after it.
const DISTANCE_MM: f64 = 20.0;
const TRAVEL_S: f64 = 0.2;
const WAIT_S: f64 = 0.2;
const MOVES: u32 = 60;

/// Axis X of the shipped machine, as its plant file has it: mass in kg, Coulomb friction in N, viscous in N·s/m.
const MASS_KG: f64 = 758.0 + 100.0;
const COULOMB_N: f64 = 0.40 * 628.32 + 200.0;
const VISCOUS_N_S_PER_M: f64 = 0.004 * 628.32 * 628.32 + 1000.0;
/// A motor that these moves take to its rating in 199 to 200 ms.
const RATED_TORQUE_NM: f64 = 1.864;
const WINDING_TIME_CONSTANT_MIN: f64 = 4.0;

/// To and fro along X, a wait after each move.
fn pick_and_place() -> String {
    let mut program = "G21 G17 G90 G94\nG4 P0.05\n".to_string();
    for index in 0..MOVES {
        let to = if index % 2 == 0 { DISTANCE_MM } else { 0.0 };
        program += &format!("G0 X{to}\nG4 P{WAIT_S}\n");
    }
    program + "M2\n"
}

/// The shipped two-axis table with a small motor, at an acceleration limit, with rapids of a profile.
fn machine(profile: &str, acceleration_mm_s2: f64) -> Bench {
    let model = format!(
        "[axis.model]\nmass_kg = {MASS_KG}\ncoulomb_n = {COULOMB_N}\nviscous_n_s_per_m = {VISCOUS_N_S_PER_M}\n\n\
         [axis.position_loop]"
    );
    let rated = format!("rated_torque_nm = {RATED_TORQUE_NM}");
    let positioning = format!("[positioning]\nprofile = \"{profile}\"\n\n[scan]");
    let acceleration = format!("acceleration_mm_s2 = {acceleration_mm_s2}");
    let bench = Bench::without_model(
        "xy",
        &[
            ("[scan]", &positioning),
            ("acceleration_mm_s2 = 5000.0", &acceleration),
            ("rated_torque_nm = 8.0", &rated),
            ("[axis.position_loop]", &model),
        ],
    );
    let path = bench.path().join("plant.toml");
    let plant = fs::read_to_string(&path).expect("plant.toml");
    let time_constant = format!("winding_time_constant_min = {WINDING_TIME_CONSTANT_MIN}");
    let plant = plant
        .replace("rated_torque_nm = 8.0", &rated)
        .replace("winding_time_constant_min = 40.0", &time_constant);
    assert!(plant.contains(&rated) && plant.contains(&time_constant));
    fs::write(&path, plant).expect("plant.toml");
    bench
}

/// Scans of a program, and ∫a²dt of X over its setpoints in mm²/s³, from what `quadrant plan --csv` writes.
fn work(bench: &Bench, program: &Path) -> (usize, f64) {
    let rows = planned(bench.path(), program);
    let x_mm: Vec<f64> = rows.iter().map(|row| row[5]).collect();
    let period_s: f64 = 1e-3;
    let squares = x_mm.windows(3).map(|x| {
        let acceleration = (x[2] - 2.0 * x[1] + x[0]) / (period_s * period_s);
        acceleration * acceleration * period_s
    });
    (x_mm.len(), squares.sum())
}

/// Friction's part of ∫F²dt of one move in N²·s, with ∫v²dt = `shape`·b²/r.
fn friction_n2_s(shape: f64) -> f64 {
    let viscous = VISCOUS_N_S_PER_M * 1e-3;
    COULOMB_N * COULOMB_N * TRAVEL_S
        + 2.0 * COULOMB_N * viscous * DISTANCE_MM
        + viscous * viscous * shape * DISTANCE_MM * DISTANCE_MM / TRAVEL_S
}

/// The source's headline, for the same distance in the same time: 16 b²/r³ against 12 b²/r³ of copper heat.
#[test]
fn a_triangle_heats_the_motor_by_a_third_more_than_the_parabola_in_the_same_time() {
    // 20 mm in 200 ms: the triangle at 2000 mm/s², the parabola from 3000 mm/s² on; rounding takes 2.5 mm/s² of a limit.
    let triangle = machine("constant-acceleration", 2002.6);
    let parabola = machine("minimum-heat", 3010.0);
    let program = parabola.file("pick-and-place.ngc", &pick_and_place());

    let (scans, planned_triangle) = work(&triangle, &program);
    let (same_scans, planned_parabola) = work(&parabola, &program);
    assert_eq!(scans, same_scans, "equal travel times");
    let planned_ratio = planned_triangle / planned_parabola;
    assert!(
        (planned_ratio / (4.0 / 3.0) - 1.0).abs() < 1e-3,
        "{planned_ratio}"
    );

    let rise_k = |bench: &Bench| {
        let report = run(bench.path(), &program).good_report();
        let peak_c = number(&report, "/axes/0/winding_c_peak");
        (
            peak_c - number(&report, "/axes/0/ambient_c"),
            text(&report, "/motion_digest"),
        )
    };
    let (triangle_k, _) = rise_k(&triangle);
    let (parabola_k, digest) = rise_k(&parabola);
    assert_eq!(rise_k(&parabola).1, digest, "the same to the bit");

    // What friction heats in both: its share of the rating, over a warming-up far shorter than the time constant.
    let rated_n = RATED_TORQUE_NM * 628.32;
    let warming = 100.0 / (rated_n * rated_n) / (WINDING_TIME_CONSTANT_MIN * 60.0);
    // Heat from early moves has decayed by the end: on average by half the run's length.
    let length_s = f64::from(MOVES) * (TRAVEL_S + WAIT_S);
    let time_constant_s = WINDING_TIME_CONSTANT_MIN * 60.0;
    let kept = time_constant_s / length_s * (1.0 - (-length_s / time_constant_s).exp());
    let friction_k = |shape| f64::from(MOVES) * friction_n2_s(shape) * warming * kept;
    let inertia_ratio = (triangle_k - friction_k(4.0 / 3.0)) / (parabola_k - friction_k(1.2));
    println!(
        "planned {planned_ratio:.6}; winding {triangle_k:.3} K and {parabola_k:.3} K: {:.4}, less friction ({:.3} K, {:.3} K) {inertia_ratio:.4}",
        triangle_k / parabola_k,
        friction_k(4.0 / 3.0),
        friction_k(1.2)
    );
    assert!(
        inertia_ratio > 1.30 && inertia_ratio < 1.38,
        "{inertia_ratio}"
    );
    // The parabola is at its rating, as planned: 100 K in the end, the share of it that the run's length gives now.
    let rated_k = 100.0 * (1.0 - (-length_s / time_constant_s).exp());
    assert!(
        parabola_k < 1.05 * rated_k && parabola_k > 0.9 * rated_k,
        "{parabola_k} of {rated_k}"
    );
    assert!(triangle_k > 1.1 * rated_k, "{triangle_k} of {rated_k}");
}

#[test]
fn least_heat_without_a_model_of_the_axis_is_refused_before_anything_starts() {
    let bench = Bench::without_model(
        "xy",
        &[(
            "[scan]",
            "[positioning]\nprofile = \"minimum-heat\"\n\n[scan]",
        )],
    );
    let program = bench.file("pick-and-place.ngc", &pick_and_place());
    let run = run(bench.path(), &program);
    assert_eq!(run.status(), 2);
    assert!(
        run.stderr()
            .contains("axis X has no [axis.model]: add its mass_kg"),
        "{}",
        run.stderr()
    );
}
