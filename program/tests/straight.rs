//! Blocks of straight motion make the same by the short way as by the way of all blocks.

use crate::common::{at, mill, slide};
use program::{Setup, interpret};
use proptest::prelude::*;

fn machines() -> [Setup; 2] {
    let mut five = mill(150.0);
    five.work_offset = at(&[1.5, -2.25, 0.1]);
    five.axes.push(slide('A', -400.0, 400.0));
    five.axes.push(slide('U', -400.0, 400.0));
    if let Some(axis) = five.axes.iter_mut().find(|axis| axis.letter == 'A') {
        axis.rotary = true;
    }
    [mill(1e9), five]
}

fn number() -> impl Strategy<Value = String> {
    "[+-]?([0-9]{1,2}|[0-9]{0,2}[.][0-9]{1,5})"
}

/// Lines of straight motion, many of which are refused.
fn straight() -> impl Strategy<Value = String> {
    let letter = prop::sample::select(vec!["X", "Y", "Z", "A", "U", "x", "B"]);
    let words = prop::collection::vec((letter, number()), 1..4);
    let head = prop::sample::select(vec!["", "", "G1 ", "G0", "N10 G01", "n5 ", "F500 ", "F0"]);
    let blank = prop::sample::select(vec!["", " ", "\t"]);
    (head, words, blank).prop_map(|(head, words, blank)| {
        let words: Vec<String> = words
            .iter()
            .map(|(letter, value)| format!("{letter}{value}"))
            .collect();
        format!("{head}{}", words.join(blank))
    })
}

/// What changes how they are meant.
fn modes() -> impl Strategy<Value = String> {
    prop::sample::select(vec![
        "G90",
        "G91",
        "G20",
        "G21",
        "G7",
        "G8",
        "G92 X1",
        "G92.1",
        "G55",
        "G10 L2 P1 R30",
        "G10 L2 P1 R0",
        "G2 X1 Y1 R50",
        "G17 G81 X1 Y1 Z-1 R1",
        "G80",
        "G5 X1 Y1 I1 J1 P1 Q1",
        "M3 S100",
        "#1=5",
        "G41.1 D1",
        "G40",
        "F200",
        "G1",
        "G0",
        "o1 if [0]",
        "o1 else",
        "o1 endif",
    ])
    .prop_map(str::to_owned)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn both_ways_make_the_same(lines in prop::collection::vec((prop::bool::weighted(0.2), modes(), straight()), 1..25)) {
        let text = |behind: &str| {
            let lines = lines.iter().map(|(is_mode, mode, straight)| {
                if *is_mode { format!("{mode}\n") } else { format!("{straight}{behind}\n") }
            });
            lines.collect::<String>()
        };
        for setup in machines() {
            let short = interpret("part", &text(""), &setup, at(&[0.5]));
            // A word that changes nothing makes a block one of all blocks.
            let long = interpret("part", &text(" G94"), &setup, at(&[0.5]));
            match (short, long) {
                (Ok(short), Ok(long)) => {
                    prop_assert_eq!(format!("{:?}", short.path), format!("{:?}", long.path));
                    prop_assert_eq!((short.events, short.notes), (long.events, long.notes));
                    prop_assert_eq!((short.straight_feeds, short.arc_feeds), (long.straight_feeds, long.arc_feeds));
                }
                (Err(short), Err(long)) => {
                    let told = |error: program::ProgramError| error.problems.into_iter()
                        .map(|problem| (problem.place, problem.found, problem.right))
                        .collect::<Vec<_>>();
                    prop_assert_eq!(told(short), told(long));
                }
                (short, long) => prop_assert!(false, "{:?}\n{:?}\n{}", short.err(), long.err(), text("")),
            }
        }
    }
}
