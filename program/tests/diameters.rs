//! G7: words along X are diameters. A program with all of them doubled moves as it does in G8, whatever else it says.

#[path = "common/diameters.rs"]
mod combinations;

use std::sync::Arc;

use crate::common::everything;
use path::geometry::AxisVector;
use program::{Program, interpret};

fn made(text: &str) -> Result<Program, String> {
    let setup = Arc::unwrap_or_clone(everything());
    interpret("part", text, &setup, AxisVector::zeros()).map_err(|error| error.to_string())
}

#[test]
fn doubled_words_along_x_make_in_g7_what_they_make_in_g8() {
    let pairs = combinations::pairs();
    let mut refused = Vec::new();
    for pair in &pairs {
        let (radii, diameters) = (made(&pair.radii), made(&pair.diameters));
        match (radii, diameters) {
            (Ok(radii), Ok(diameters)) => {
                assert_eq!(diameters.path, radii.path, "{}", pair.diameters);
                assert_eq!(diameters.events, radii.events, "{}", pair.diameters);
            }
            (Err(error), Err(_)) => refused.push(format!("{error}\n{}", pair.radii)),
            (radii, diameters) => panic!(
                "one of two is refused: {:?} {:?}\n{}",
                radii.err(),
                diameters.err(),
                pair.diameters
            ),
        }
    }
    assert!(refused.len() * 10 < pairs.len(), "{}", refused.join("\n"));
}

/// Programs with diameters, and the places that LinuxCNC 2.9 (rs274) makes of them in mm, one after another.
const PLACES: [(&str, &[[f64; 3]]); 6] = [
    (
        "G7 G19 G90 G98 F200\nG0 X20 Y4 Z8\nG81 Y2 Z3 X-4 R8\nX-6 Z5\nM2",
        &[
            [10.0, 4.0, 8.0],
            [10.0, 2.0, 3.0],
            [8.0, 2.0, 3.0],
            [-2.0, 2.0, 3.0],
            [10.0, 2.0, 3.0],
            [10.0, 2.0, 5.0],
            [8.0, 2.0, 5.0],
            [-3.0, 2.0, 5.0],
            [10.0, 2.0, 5.0],
        ],
    ),
    (
        "G7 G19 G90 G98 F200\nG0 X20 Y4 Z8\nG83 Y2 Z3 X4 R6 Q3\nM2",
        &[
            [10.0, 4.0, 8.0],
            [10.0, 2.0, 3.0],
            [6.0, 2.0, 3.0],
            [3.0, 2.0, 3.0],
            [6.0, 2.0, 3.0],
            [3.254, 2.0, 3.0],
            [2.0, 2.0, 3.0],
            [10.0, 2.0, 3.0],
        ],
    ),
    (
        "G7 G19 G91 G99 F200\nG0 X20 Y4 Z8\nG85 Y2 Z3 X-8 R-4 L2\nM2",
        &[
            [10.0, 4.0, 8.0],
            [10.0, 6.0, 11.0],
            [6.0, 6.0, 11.0],
            [2.0, 6.0, 11.0],
            [6.0, 6.0, 11.0],
            [6.0, 8.0, 14.0],
            [2.0, 8.0, 14.0],
            [6.0, 8.0, 14.0],
        ],
    ),
    (
        "G20 G7 G19 G90 G98 F20\nG0 X2 Y1 Z1\nG81 Y2 Z3 X-.4 R.8\nM2",
        &[
            [25.4, 25.4, 25.4],
            [25.4, 50.8, 76.2],
            [20.32, 50.8, 76.2],
            [-5.08, 50.8, 76.2],
            [25.4, 50.8, 76.2],
        ],
    ),
    (
        "G7 G18 G90 F200\nG0 X12 Z8\nG3 X20 Z4 I0 K-4\nG2 X12 Z8 R4\nM2",
        &[[6.0, 0.0, 8.0], [10.0, 0.0, 4.0], [6.0, 0.0, 8.0]],
    ),
    (
        "G7 G19 G90 F200\nG0 X12 Y4 Z8\nG3 X16 Y0 Z12 J-4 K0\nM2",
        &[[6.0, 4.0, 8.0], [8.0, 0.0, 12.0]],
    ),
];

#[test]
fn the_places_of_cycles_and_arcs_with_diameters_are_those_of_linuxcnc() {
    for (text, expected) in PLACES {
        let program = made(text).unwrap_or_else(|error| panic!("{error}"));
        let ways = program.path.elements.iter().filter(|of| of.length_mm > 0.0);
        let places: Vec<AxisVector> = ways.map(|element| element.end()).collect();
        assert_eq!(places.len(), expected.len(), "{text}");
        for (place, expected) in places.iter().zip(expected) {
            let off = (place - crate::common::at(expected)).amax();
            assert!(off < 1e-9, "{text}: {place:?} for {expected:?}");
        }
    }
}
