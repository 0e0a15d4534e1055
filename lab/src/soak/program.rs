//! The part program of a soak: lines, arcs that turn back, full circles, dwells and rapids in X and Y, as long as asked for.

use std::f64::consts::TAU;
use std::fmt::Write;

use plant_sim::script::rng::Rng;

/// Half the side of the square that everything stays in, in mm.
const HALF_MM: f64 = 30.0;
/// Radii of circles, in mm: within the square from anywhere in the inner one.
const RADIUS_MM: (f64, f64) = (4.0, 12.0);
/// Half the side of the square that points lie in, in mm.
const INNER_MM: f64 = HALF_MM - 2.0 * RADIUS_MM.1;

/// First and last block.
const HEAD: &str = "G21 G17 G90 G94\n";
const END: &str = "M2\n";

/// A program that takes about so many seconds undisturbed.
pub fn generate(rng: &mut Rng, seconds: f64) -> String {
    let mut text = String::from(HEAD);
    let (mut x, mut y) = (0.0, 0.0);
    let mut spent_s = 0.0;
    while spent_s < seconds {
        let feed = rng.between(1500.0, 6000.0);
        let speed_mm_s = feed / 60.0;
        let what = rng.below(10);
        let _ = match what {
            0..4 => {
                let (to_x, to_y) = (inner(rng), inner(rng));
                let way_mm = libm::hypot(to_x - x, to_y - y);
                (x, y) = (to_x, to_y);
                spent_s += way_mm / speed_mm_s;
                writeln!(text, "G1 X{x:.3} Y{y:.3} F{feed:.0}")
            }
            4..8 => {
                let radius = rng.between(RADIUS_MM.0, RADIUS_MM.1);
                let angle = rng.between(0.0, TAU);
                let word = if rng.below(2) == 0 { "G2" } else { "G3" };
                spent_s += TAU * radius / speed_mm_s;
                let (i, j) = (radius * libm::cos(angle), radius * libm::sin(angle));
                writeln!(text, "{word} X{x:.3} Y{y:.3} I{i:.4} J{j:.4} F{feed:.0}")
            }
            8 => {
                (x, y) = (inner(rng), inner(rng));
                spent_s += 0.1;
                writeln!(text, "G0 X{x:.3} Y{y:.3}")
            }
            _ => {
                let pause_s = rng.between(0.02, 0.3);
                spent_s += pause_s;
                writeln!(text, "G4 P{pause_s:.3}")
            }
        };
    }
    text + "G1 X5 Y-7 F3000\n" + END
}

/// The same for axes that stand somewhere near 0 when it begins, as real ones do: its first block goes to a point that is the same from
/// everywhere, and it ends where it began.
pub fn from_anywhere(text: &str) -> String {
    let begins = format!("{HEAD}G1 X1 Y1 F3000\nG1 X0 Y0\n");
    let ends = format!("G1 X0 Y0 F3000\n{END}");
    text.replacen(HEAD, &begins, 1).replacen(END, &ends, 1)
}

/// A coordinate in the inner square, in mm.
fn inner(rng: &mut Rng) -> f64 {
    // As it is written, so that a circle begins where its block says it ends.
    libm::round(rng.between(-INNER_MM, INNER_MM) * 1e3) / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_gives_the_same_program_every_time_and_another_seed_another() {
        let of = |seed| generate(&mut Rng::new(seed), 20.0);
        assert_eq!(of(3), of(3));
        assert_ne!(of(3), of(4));
        for word in ["G1 ", "G2 ", "G3 ", "G0 ", "G4 "] {
            assert!(of(3).contains(word), "no {word}");
        }
    }
}
