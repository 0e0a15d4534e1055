//! A smooth curve as CAM systems write it: in chords.

use std::fmt::Write as _;

use plant_sim::script::rng::Rng;

/// Runs over the curve take a value of its parameter of this.
const RUN: f64 = 60.0;

/// A curve of radii from 1.7 mm on in an area of 60 × 30 mm, in chords of this length at 6 m/min, so many times to and fro; points are
/// rounded to 0.1 µm, with noise of this size (standard deviation). `mode` stands before everything: `G61`, `G64 P0.01`.
pub fn program(chord_mm: f64, noise_mm: f64, mode: &str, runs: u32) -> String {
    let mut rng = Rng::new(1);
    let mut noise = || {
        (0..12)
            .map(|_| rng.within(0, 1000) as f64 / 1000.0 - 0.5)
            .sum::<f64>()
            * noise_mm
    };
    let mut text = format!("{mode}\nG21 G90 G1 F6000\n");
    for run in 0..runs {
        let mut way = 0.0f64;
        while way < RUN {
            let t = if run % 2 == 0 { way } else { RUN - way };
            let x = t * 0.8 - 24.0 + 6.0 * t.sin() + noise();
            let y = 8.0 * (0.37 * t).sin() + 6.0 * t.cos() + noise();
            let _ = writeln!(text, "X{x:.4} Y{y:.4}");
            let (dx, dy) = (0.8 + 6.0 * t.cos(), 2.96 * (0.37 * t).cos() - 6.0 * t.sin());
            way += chord_mm / dx.hypot(dy);
        }
    }
    text + "M2\n"
}
