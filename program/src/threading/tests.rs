//! The passes of G76 against those of LinuxCNC 2.9's interpreter.

use super::*;

fn place(x: f64, z: f64) -> AxisVector {
    let mut place = AxisVector::zeros();
    (place[0], place[2]) = (x, z);
    place
}

/// `G0 X20 Z2`, `G76 P1.5 Z-20 I-2 J0.4 K1.3`.
fn outside() -> Threading {
    Threading {
        from: place(20.0, 2.0),
        end: place(20.0, -20.0),
        x_axis: 0,
        z_axis: 2,
        pitch_mm: 1.5,
        unit_mm: 1.0,
        crest: -2.0,
        first_cut: 0.4,
        depth: 1.3,
        degression: 1.0,
        slide_deg: 0.0,
        spring_passes: 0,
        taper_mm: 0.0,
        tapers_in: false,
        tapers_out: false,
    }
}

/// X and Z of each move: `R`apid, or `S`ynchronised with its way for each turn.
fn printed(thread: &Threading) -> Vec<String> {
    let round = |mm: f64| (mm * 1e6).round() / 1e6;
    let moves = thread.moves().unwrap();
    let print = |move_: &Move| match move_ {
        Move::Rapid(to) => format!("R {} {}", round(to[0]), round(to[2])),
        Move::Synchronised { to, mm_per_rev } => {
            format!("S {} {} {}", round(to[0]), round(to[2]), round(*mm_per_rev))
        }
    };
    moves.iter().map(print).collect()
}

#[test]
fn passes_go_in_at_equal_steps_and_end_at_the_full_depth() {
    // G76 P1.5 Z-20 I2 J0.4 K1.3, in a bore
    let bore = Threading {
        crest: 2.0,
        ..outside()
    };
    assert_eq!(
        printed(&bore),
        [
            "R 19.1 2",
            "R 22.4 2",
            "S 22.4 -20 1.5",
            "R 19.1 -20",
            "R 19.5 2",
            "R 22.8 2",
            "S 22.8 -20 1.5",
            "R 19.5 -20",
            "R 19.9 2",
            "R 23.2 2",
            "S 23.2 -20 1.5",
            "R 19.9 -20",
            "R 20 2",
            "R 23.3 2",
            "S 23.3 -20 1.5",
            "R 20 -20",
            "R 20 -20"
        ]
    );
    // J0.1 K0.7: the sum of equal steps meets the depth without a further pass.
    let even = Threading {
        first_cut: 0.1,
        depth: 0.7,
        ..outside()
    };
    assert_eq!(printed(&even).len(), 4 * 7 + 1);
    // The same in inches, where six times 0.0104 meet 0.0624 but not in mm.
    let inches = Threading {
        unit_mm: 25.4,
        crest: 0.0436,
        first_cut: 0.0104,
        depth: 0.0624,
        ..outside()
    };
    assert_eq!(printed(&inches).len(), 4 * 6 + 1);
}

#[test]
fn tapers_slides_degression_and_spring_passes_are_those_of_the_reference_interpreter() {
    // G76 P1.5 Z-20 I-2 J0.4 K1.3 Q29.5 H1 E1.5 L3 R1.5
    let all = Threading {
        slide_deg: 29.5,
        spring_passes: 1,
        taper_mm: 1.5,
        tapers_in: true,
        tapers_out: true,
        degression: 1.5,
        ..outside()
    };
    let moves = printed(&all);
    assert_eq!(
        moves[..12],
        [
            "R 20.9 1.773691",
            "S 18.9 1.773691 1.984943",
            "S 17.6 0.273691 1.984943",
            "S 17.6 -17.990804 1.5",
            "S 18.9 -19.490804 1.984943",
            "R 20.9 -19.490804",
            "R 20.66504 1.640757",
            "S 18.66504 1.640757 1.984943",
            "S 17.36504 0.140757 1.984943",
            "S 17.36504 -18.123739 1.5",
            "S 18.66504 -19.623739 1.984943",
            "R 20.66504 -19.623739",
        ]
    );
    assert_eq!(moves[18], "R 20.292063 1.429737");
    assert_eq!(moves[24], "R 20.130393 1.338268");
    // Full depth twice: the spring pass.
    assert_eq!(moves[30..36], moves[36..42]);
    assert_eq!(moves[32], "S 16.7 -0.235505 1.984943");
    assert_eq!(moves[42..], ["R 20 -20"]);
}

#[test]
fn a_thread_towards_larger_z_slides_and_tapers_the_other_way() {
    // G0 X20 Z2, G76 P1.5 Z20 X25 I-2 J0.4 K1.3 Q20 E1 L2
    let away = Threading {
        end: place(25.0, 20.0),
        slide_deg: 20.0,
        taper_mm: 1.0,
        tapers_out: true,
        ..outside()
    };
    let moves = printed(&away);
    assert_eq!(
        moves[..5],
        [
            "R 20.9 2.145588",
            "R 17.6 2.145588",
            "S 17.6 18.672427 1.5",
            "S 18.9 19.672427 2.460183",
            "R 20.9 19.672427",
        ]
    );
    assert_eq!(moves.last().unwrap(), "R 25 20");
}

#[test]
fn what_no_thread_can_be_is_refused_with_the_word_that_says_it() {
    let refused = |thread: Threading| {
        let (letter, Refusal { found, .. }) = thread.moves().unwrap_err();
        format!("{letter}: {found}")
    };
    let base = outside();
    for (thread, expected) in [
        (
            Threading {
                pitch_mm: 0.0,
                ..base
            },
            "P: a thread of pitch 0 mm",
        ),
        (
            Threading { crest: 0.0, ..base },
            "I: a thread whose crest is at the tool",
        ),
        (
            Threading {
                first_cut: 1.3,
                ..base
            },
            "J: a thread 1.3 deep whose first cut is 1.3",
        ),
        (
            Threading {
                slide_deg: 90.0,
                ..base
            },
            "Q: passes that slide along a flank at 90°",
        ),
        (
            Threading {
                taper_mm: 12.0,
                ..base
            },
            "E: tapers of 12 mm on 22 mm of thread",
        ),
        (
            Threading {
                end: base.from,
                ..base
            },
            "Z: a thread without length",
        ),
        (
            Threading {
                degression: 0.5,
                ..base
            },
            "R: a degression of 0.5",
        ),
        (
            Threading {
                degression: 20.0,
                ..base
            },
            "J: a thread of too many passes",
        ),
    ] {
        assert_eq!(refused(thread), expected);
    }
}
