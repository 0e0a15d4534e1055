//! A circle over drives whose commands act 1, 2 or 4 scans after the feedback that they answer, with the loops that the laws of
//! `quadrant tune` give for that, and with loops that reckon with one scan all the same.
//!
//! `cargo test --release -p lab --test all dead_time:: -- --nocapture` prints the table of docs/developers/measurements.md.

use std::path::Path;

use ::report::measure::Analysis;
use lab::cell::InProcessCell;
use machine::{Axis, Machine};
use monitor::log::Sample;
use path::geometry::AxisVector;
use plant_sim::plant_file::PlantFile;
use program::Setup;
use tune::laws::Timing;

const PROGRAM: &str = "circle-r25-f3000-ccw.ngc";

/// What one run shows.
#[derive(Debug, Clone, Copy)]
struct Shown {
    completed: bool,
    contour_peak_um: f64,
    contour_rms_um: f64,
    following_rms_um: f64,
    reversal_um: f64,
}

/// The machine as `quadrant tune` would write it for drives of this dead time: only what depends on it.
fn tuned(name: &str, dead_time_scans: u32) -> Machine {
    let mut machine = Machine::load(&folder(name)).expect("a machine");
    machine.scan.dead_time_scans = dead_time_scans;
    let known = machine.clone();
    for axis in &mut machine.axes {
        let timing = Timing::of(&known, axis);
        let mass_kg = axis.model.map_or(0.0, |model| model.mass_kg);
        axis.position_loop.gain_per_s = timing.position_gain_per_s();
        axis.velocity_loop.gain_n_s_per_m = timing.velocity_gain_n_s_per_m(mass_kg);
        axis.velocity_loop.integral_time_ms = timing.integral_time_ms();
        axis.feed_forward.advance_ms = timing.advance_with_torque_ms();
        axis.reversal.lead_ms = timing.lead_ms();
        axis.disturbance_observer.bandwidth_rad_s = timing.observer_rad_s();
    }
    machine
}

fn folder(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../machines")
        .join(name)
}

/// A circle on this machine, whose drives have this dead time.
fn circle(machine: &Machine, drives_scans: u32) -> Shown {
    let mut plant = PlantFile::load(&folder(&machine.name)).expect("a plant");
    plant.drive.dead_time_scans = drives_scans;
    let text = std::fs::read_to_string(folder("xy").join("programs").join(PROGRAM)).expect("text");
    let setup = Setup::of(machine);
    let path = program::interpret(PROGRAM, &text, &setup, AxisVector::zeros()).expect("a path");
    let mut analysis = Analysis::new(machine.clone(), path.path);
    let mut cell = InProcessCell::new(machine, &plant, PROGRAM, &text).expect("a cell");
    while let Some(published) = cell.scan() {
        analysis.take(Sample::Feedback(Box::new(*published.feedback)));
        analysis.take(Sample::Instruments(Box::new(*published.instruments)));
        for command in published.commands {
            analysis.take(Sample::Command(Box::new(*command)));
        }
    }
    let measured = analysis.finish();
    let quadrants = measured.arcs.iter().flat_map(|arc| &arc.quadrants);
    let axis = measured.axes.first().expect("an axis");
    Shown {
        completed: measured.is_completed(),
        contour_peak_um: measured.contour_error_mm.peak * 1e3,
        contour_rms_um: measured.contour_error_mm.rms() * 1e3,
        following_rms_um: axis.following_error_mm.rms() * 1e3,
        reversal_um: quadrants
            .map(|quadrant| quadrant.protrusion_um.max(-quadrant.undercut_um))
            .fold(0.0, f64::max),
    }
}

fn print(machine: &Machine, drives_scans: u32, shown: &Shown) {
    let reckoned = machine.scan.dead_time_scans;
    let Some(Axis {
        position_loop,
        feed_forward,
        ..
    }) = machine.axes.first()
    else {
        return;
    };
    println!(
        "| {} | {reckoned} | {drives_scans} | {:.1} | {:.3} | {} | {:.1} / {:.2} | {:.2} | {:.2} |",
        machine.name,
        position_loop.gain_per_s,
        feed_forward.advance_ms,
        if shown.completed { "yes" } else { "**no**" },
        shown.contour_peak_um,
        shown.contour_rms_um,
        shown.following_rms_um,
        shown.reversal_um,
    );
}

fn measure(name: &str, reckoned_scans: u32, drives_scans: u32) -> Shown {
    let machine = tuned(name, reckoned_scans);
    let shown = circle(&machine, drives_scans);
    print(&machine, drives_scans, &shown);
    shown
}

const MACHINES: [&str; 3] = ["xy", "xy-fast", "xy-torque"];

#[test]
fn loops_tuned_for_a_longer_dead_time_keep_the_circle() {
    for name in MACHINES {
        let one = measure(name, 1, 1);
        for scans in [2, 4] {
            let shown = measure(name, scans, scans);
            let case = format!("{name}, {scans} scans: {shown:?} after {one:?}");
            assert!(shown.completed, "{case}");
            assert!(shown.contour_rms_um < 1.4 * one.contour_rms_um, "{case}");
            assert!(shown.contour_peak_um < 20.0, "{case}");
            assert!(
                shown.following_rms_um < 1.3 * one.following_rms_um,
                "{case}"
            );
            assert!(shown.reversal_um < one.reversal_um + 0.5, "{case}");
        }
    }
}

#[test]
fn a_controller_that_does_not_know_of_the_dead_time_is_worse() {
    for name in MACHINES {
        let known = measure(name, 4, 4);
        let unknown = measure(name, 1, 4);
        let case = format!("{name}: {unknown:?} instead of {known:?}");
        assert!(unknown.reversal_um > 2.0 * known.reversal_um, "{case}");
        // In torque mode the servo compares at once: only what is fed forward comes too late.
        if name != "xy-torque" {
            assert!(
                unknown.contour_rms_um > 5.0 * known.contour_rms_um,
                "{case}"
            );
            assert!(
                unknown.contour_peak_um > 5.0 * known.contour_peak_um,
                "{case}"
            );
        }
    }
}
