use proptest::prelude::*;

use super::*;

/// Cycles and the moves that LinuxCNC 2.9's interpreter makes of them (its python module `gcode`, full doubles): for each
/// `case CODE Z X …` its words D I R U W, or D E P for G70; `p` the pieces of its profile, `R`, `L` and `A` its moves; points are
/// Z X, of an arc Z X, Z and X of its centre, 1 for G3.
const CASES: &str = include_str!("linuxcnc.txt");

fn numbers(line: &str) -> Vec<f64> {
    line.split(' ')
        .skip(1)
        .map(|word| word.parse().unwrap())
        .collect()
}

fn piece(line: &str) -> Piece {
    let numbers = numbers(line);
    Piece {
        to: Flat::new(numbers[0], numbers[1]),
        arc: (numbers.len() > 2).then(|| (Flat::new(numbers[2], numbers[3]), numbers[4] > 0.0)),
    }
}

fn made(head: &str, pieces: &[Piece]) -> Result<Vec<Cut>, Refusal> {
    let code = head.split(' ').next().unwrap();
    let words = numbers(head);
    let start = Flat::new(words[0], words[1]);
    if code == "70" {
        let words = Finishing {
            start,
            from_mm: words[2],
            to_mm: words[3],
            passes: words[4] as u32,
        };
        return finishing(pieces, &words);
    }
    let words = Roughing {
        start,
        leave_mm: words[2],
        depth_mm: words[3],
        retract_mm: words[4],
        shift: Flat::new(words[6], words[5]),
        pockets: match code.split_once('.') {
            Some((_, "1")) => Pockets::Leave,
            Some((_, "2")) => Pockets::Only,
            _ => Pockets::Cut,
        },
        facing: code.starts_with("72"),
    };
    roughing(pieces, &words)
}

fn numbers_of(cut: &Cut) -> (char, Vec<f64>) {
    match *cut {
        Cut::Rapid(to) => ('R', vec![to.u, to.v]),
        Cut::Feed(to) => ('L', vec![to.u, to.v]),
        Cut::Arc {
            to,
            centre,
            counter_clockwise,
        } => {
            let sign = if counter_clockwise { 1.0 } else { -1.0 };
            ('A', vec![to.u, to.v, centre.u, centre.v, sign])
        }
    }
}

#[test]
fn cycles_make_the_moves_that_linuxcnc_makes() {
    let mut count = 0;
    for case in CASES.split("case ").skip(1) {
        let (head, lines) = case.split_once('\n').unwrap();
        let (pieces, moves): (Vec<&str>, Vec<&str>) =
            lines.lines().partition(|line| line.starts_with('p'));
        let pieces: Vec<Piece> = pieces.into_iter().map(piece).collect();
        let cuts = made(head, &pieces).unwrap_or_else(|refusal| panic!("{refusal:?}: {case}"));
        assert_eq!(cuts.len(), moves.len(), "{case}");
        for (cut, expected) in cuts.iter().zip(moves) {
            let (kind, values) = numbers_of(cut);
            assert!(
                expected.starts_with(kind),
                "{cut:?} for {expected} of {case}"
            );
            for (value, expected_value) in values.iter().zip(numbers(expected)) {
                assert!(
                    (value - expected_value).abs() < 1e-6,
                    "{cut:?} for {expected} of {case}"
                );
            }
        }
        count += 1;
    }
    assert!(count > 30, "{count} cases");
}

#[test]
fn a_profile_that_turns_back_is_refused() {
    let pieces = ["p 0 5", "p -10 5", "p -5 8", "p -20 10"].map(piece);
    let refusal = made("71 2 20 0 1 0.5 0 0", &pieces).unwrap_err();
    assert_eq!(refusal.found, "a profile that turns back");
}

#[test]
fn a_depth_of_nothing_is_refused() {
    let pieces = ["p 0 5", "p -10 5", "p -20 10"].map(piece);
    assert!(made("71 2 20 0 0 0.5 0 0", &pieces).is_err());
    assert!(made("71 2 20 0 1e-9 0.5 0 0", &pieces).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn nothing_panics_and_everything_ends_whatever_comes(
        code in prop_oneof![Just("70"), Just("71"), Just("71.1"), Just("71.2"), Just("72"), Just("72.1")],
        start in (-5.0..5.0_f64, -5.0..20.0_f64),
        words in (-1.0..1.0_f64, 0.05..3.0_f64, 0.0..1.0_f64),
        points in prop::collection::vec(
            ((-20.0..2.0_f64, 0.0..10.0_f64), prop::option::of((-20.0..2.0_f64, 0.0..10.0_f64, any::<bool>()))),
            0..8,
        ),
        sorted: bool,
    ) {
        let mut points = points;
        if sorted {
            points.sort_by(|a, b| b.0.0.total_cmp(&a.0.0));
        }
        let pieces: Vec<Piece> = points
            .into_iter()
            .map(|((z, x), arc)| Piece {
                to: Flat::new(z, x),
                arc: arc.map(|(z, x, ccw)| (Flat::new(z, x), ccw)),
            })
            .collect();
        let head = format!("{code} {} {} {} {} {} 0 0", start.0, start.1, words.0, words.1, if code == "70" { 2.0 } else { words.2 });
        let _ = made(&head, &pieces);
    }
}
