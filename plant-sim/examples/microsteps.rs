//! What one axis-microstep costs: both axes of `machines/xy` on a circle R25 F3000, at F10000 and at rest.
//!
//! `cargo run --release -p plant-sim --example microsteps`

use std::path::Path;
use std::time::Instant;

use master::{DriveCommand, InstrumentSample};
use plant_sim::axis::{AxisSettings, AxisSimulation};
use plant_sim::drive::DriveParameters;
use plant_sim::plant_file::PlantFile;

const SCAN_US: u32 = 1_000;

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let plant = match PlantFile::load(&folder) {
        Ok(plant) => plant,
        Err(error) => {
            eprintln!("{error}");
            std::process::exit(2);
        }
    };
    let drive = DriveParameters {
        velocity_gain_n_s_per_m: 257_400.0,
        integral_time_ms: 10.0,
        position_gain_per_s: 50.0,
        period_us: 250,
        torque_limit_nm: 32.0,
        quick_stop_mm_s2: 5_000.0,
        weight_nm: 0.0,
        brake: None,
    };
    for (what, speed_mm_s, w_rad_s) in [
        ("R25 F3000", 50.0, 2.0),
        ("R10 F10000", 166.7, 16.67),
        ("at rest", 0.0, 1.0),
    ] {
        let mut axes: Vec<AxisSimulation> = ["X", "Y"]
            .into_iter()
            .filter_map(|name| AxisSettings::new(&plant, name, &drive, SCAN_US).ok())
            .map(AxisSimulation::new)
            .collect();
        let mut best_us = f64::INFINITY;
        let mut scan = 0_u32;
        let mut samples = [InstrumentSample::default(); 4];
        for _ in 0..20 {
            let scans = 3_142;
            let start = Instant::now();
            for _ in 0..scans {
                let angle = w_rad_s * f64::from(scan) * 1e-3;
                scan += 1;
                for (axis, speed) in axes.iter_mut().zip([-libm::sin(angle), libm::cos(angle)]) {
                    let command = DriveCommand::Velocity {
                        velocity_mm_s: speed_mm_s * speed,
                        torque_offset_nm: 0.0,
                    };
                    axis.scan(&command, &mut samples);
                }
            }
            best_us = best_us.min(start.elapsed().as_secs_f64() * 1e6 / f64::from(scans));
        }
        let microsteps = 2.0 * f64::from(SCAN_US) / plant.microstep_us;
        println!(
            "{what}: {best_us:.2} µs per scan of two axes, {:.1} ns per axis-microstep (sample {:.3} mm)",
            best_us * 1e3 / microsteps,
            samples[3].table_mm
        );
    }
}
