//! Expected values are those of LinuxCNC 2.9.4's interpreter (its python module `gcode`, full doubles).

use path::geometry::axis_unit;
use proptest::prelude::*;

use super::*;

type Path = Compensation<usize, char>;
type Steps = Vec<Step<usize, char>>;

fn start(side: Side, radius_mm: f64) -> Path {
    let start = Start {
        side,
        radius_mm,
        plane: [0, 1],
        across: Some(2),
        tip: Flat::default(),
    };
    Compensation::start(start, at(0.0, 0.0, 5.0))
}

fn at(u: f64, v: f64, w: f64) -> AxisVector {
    axis_unit(0) * u + axis_unit(1) * v + axis_unit(2) * w
}

fn step(to: AxisVector, way: Way, payload: usize) -> Move<usize> {
    Move { to, way, payload }
}

fn arc(centre: (f64, f64), clockwise: bool) -> Way {
    Way::Arc(Bow {
        centre: Flat::new(centre.0, centre.1),
        clockwise,
        turns: 1,
    })
}

/// The moves of a contour, each numbered, with the end of the compensation.
fn followed(mut path: Path, moves: &[(AxisVector, Way)]) -> Result<Steps, Refusal> {
    let mut steps = Vec::new();
    for (index, &(to, way)) in moves.iter().enumerate() {
        path.push(step(to, way, index), &mut steps)?;
    }
    path.finish(&mut steps)?;
    Ok(steps)
}

/// Steps as `L u v w`, `R u v w`, `A cu cv turns u v w`, with six decimals.
fn written(steps: &Steps) -> Vec<String> {
    steps
        .iter()
        .map(|step| {
            let Step::Move(Move { to, way, .. }) = step else {
                return "event".to_owned();
            };
            let end = format!("{:.6} {:.6} {:.6}", to[0], to[1], to[2]);
            match way {
                Way::Rapid => format!("R {end}"),
                Way::Line => format!("L {end}"),
                Way::Arc(Bow {
                    centre,
                    clockwise,
                    turns,
                }) => {
                    let sign = if *clockwise { "-" } else { "" };
                    format!("A {:.6} {:.6} {sign}{turns} {end}", centre.u, centre.v)
                }
            }
        })
        .collect()
}

#[test]
fn lines_arcs_helices_and_rapids_are_followed_as_linuxcnc_does() {
    let line = Way::Line;
    let helix = Way::Arc(Bow {
        centre: Flat::new(60.0, 15.0),
        clockwise: true,
        turns: 2,
    });
    let moves = [
        (at(10.0, 0.0, 5.0), line),
        (at(20.0, 20.0, 5.0), line),
        (at(25.0, 20.0, 5.0), line),
        (at(25.0, 15.0, 5.0), line),
        (at(25.0, 15.0, 2.0), line),
        (at(40.0, 15.0, 2.0), line),
        (at(50.0, 25.0, 2.0), arc((40.0, 25.0), false)),
        (at(60.0, 25.0, 2.0), line),
        (at(60.0, 25.0, 3.0), line),
        (at(70.0, 15.0, 9.0), helix),
        (at(80.0, 15.0, 9.0), Way::Rapid),
        (at(80.0, 0.0, 1.0), Way::Rapid),
    ];
    let steps = followed(start(Side::Left, 2.0), &moves).unwrap();
    let expected = [
        "L 8.763932 2.000000 5.000000",
        "L 18.211146 20.894427 5.000000",
        "A 20.000000 20.000000 -1 20.000000 22.000000 5.000000",
        "L 25.000000 22.000000 5.000000",
        "A 25.000000 20.000000 -1 27.000000 20.000000 5.000000",
        "L 27.000000 17.000000 5.000000",
        "L 27.000000 17.000000 2.000000",
        "L 40.000000 17.000000 2.000000",
        "A 40.000000 25.000000 1 48.000000 25.000000 2.000000",
        "A 50.000000 25.000000 -1 50.000000 27.000000 2.000000",
        "L 60.000000 27.000000 2.000000",
        "L 60.000000 27.000000 3.000000",
        "A 60.000000 15.000000 -2 71.832160 17.000000 9.000000",
        "R 80.000000 17.000000 9.000000",
        "R 82.000000 15.000000 9.000000",
        "R 82.000000 0.000000 1.000000",
    ];
    assert_eq!(written(&steps), expected);
}

#[test]
fn a_lead_in_arc_becomes_one_that_is_tangent_beside_its_end() {
    let moves = [
        (at(20.0, 0.0, 5.0), arc((10.0, 0.0), false)),
        (at(20.0, 0.0, 5.0), arc((0.0, 0.0), false)),
    ];
    let steps = followed(start(Side::Left, 6.0), &moves).unwrap();
    let expected = [
        "A 7.000000 0.000000 1 14.000000 0.000000 5.000000",
        "A 0.000000 0.000000 1 14.000000 0.000000 5.000000",
    ];
    assert_eq!(written(&steps), expected);
}

#[test]
fn events_stay_between_the_moves_they_were_written_between() {
    let mut path = start(Side::Right, 1.0);
    let mut steps = Vec::new();
    path.push_event('a', &mut steps);
    path.push(step(at(10.0, 0.0, 5.0), Way::Line, 0), &mut steps)
        .unwrap();
    path.push_event('b', &mut steps);
    assert_eq!(steps, [Step::Event('a')]);
    path.push(step(at(10.0, 10.0, 5.0), Way::Line, 1), &mut steps)
        .unwrap();
    let programmed = path.finish(&mut steps).unwrap();
    assert_eq!(programmed, at(10.0, 10.0, 5.0));
    let order: Vec<bool> = steps
        .iter()
        .map(|step| matches!(step, Step::Event(_)))
        .collect();
    assert_eq!(order, [true, false, true, false, false]);
}

#[test]
fn a_tool_radius_below_0_is_on_the_other_side() {
    let moves = [
        (at(10.0, 0.0, 5.0), Way::Line),
        (at(20.0, 0.0, 5.0), Way::Line),
    ];
    assert_eq!(
        followed(start(Side::Left, -2.0), &moves),
        followed(start(Side::Right, 2.0), &moves)
    );
}

#[test]
fn a_short_lead_in_is_refused() {
    let refusal = followed(start(Side::Left, 6.0), &[(at(6.0, 0.0, 5.0), Way::Line)]).unwrap_err();
    assert_eq!(refusal.found, "a lead-in of 6 mm for a tool radius of 6 mm");
}

#[test]
fn inside_corners_and_arcs_that_the_tool_does_not_fit_are_refused() {
    let lead_in = (at(20.0, 0.0, 5.0), Way::Line);
    let short = [
        lead_in,
        (at(20.0, 20.0, 5.0), Way::Line),
        (at(10.0, 20.0, 5.0), Way::Line),
        (at(10.0, 0.0, 5.0), Way::Line),
    ];
    let refusal = followed(start(Side::Left, 6.0), &short).unwrap_err();
    assert_eq!(
        refusal.found,
        "the tool radius 6 mm does not fit the inside corner before this block"
    );
    let tight = [lead_in, (at(20.0, 10.0, 5.0), arc((20.0, 5.0), false))];
    let refusal = followed(start(Side::Left, 6.0), &tight).unwrap_err();
    assert_eq!(
        refusal.found,
        "the tool radius 6 mm does not fit inside an arc of radius 5 mm"
    );
    followed(start(Side::Left, 4.0), &tight).unwrap();
}

#[test]
fn an_inside_curve_of_short_lines_that_is_tighter_than_the_tool_is_refused() {
    // 1.8 degrees from line to line on a radius of 5 mm: LinuxCNC joins them as tangent and cuts into the contour.
    let curve = |radius_mm: f64| {
        let lead_in = std::iter::once((at(20.0, 0.0, 5.0), Way::Line));
        let points = (1..=50).map(move |index| {
            let (sin, cos) = (f64::from(index) * 0.0314).sin_cos();
            let to = at(20.0 + radius_mm * sin, radius_mm * (1.0 - cos), 5.0);
            (to, Way::Line)
        });
        lead_in.chain(points).collect::<Vec<_>>()
    };
    assert!(followed(start(Side::Left, 6.0), &curve(5.0)).is_err());
    followed(start(Side::Left, 6.0), &curve(7.0)).unwrap();
    followed(start(Side::Right, 6.0), &curve(5.0)).unwrap();
}

#[test]
fn a_line_behind_an_inside_corner_does_not_run_back_before_it_goes_straight_on() {
    let contour = |length_mm: f64| {
        [
            (at(20.0, 0.0, 5.0), Way::Line),
            (at(20.0, length_mm, 5.0), Way::Line),
            (at(20.0, 30.0, 5.0), Way::Line),
        ]
    };
    // LinuxCNC runs back here, and cuts into the first line.
    assert!(followed(start(Side::Left, 6.0), &contour(5.9999)).is_err());
    followed(start(Side::Left, 6.0), &contour(6.0)).unwrap();
}

#[test]
fn what_waits_is_bounded() {
    let mut path = start(Side::Left, 1.0);
    let mut steps = Vec::new();
    path.push(step(at(10.0, 0.0, 5.0), Way::Line, 0), &mut steps)
        .unwrap();
    let refusal = (0..=WAITING_MAX).find_map(|index| {
        let up = at(10.0, 0.0, index as f64);
        path.push(step(up, Way::Line, index), &mut steps).err()
    });
    assert!(refusal.is_some());
}

/// One element of a contour: a turn before it, then a line, or an arc of this radius to one side.
#[derive(Debug, Clone)]
struct Piece {
    turn_rad: f64,
    length_mm: f64,
    arc: Option<(f64, bool)>,
}

impl Piece {
    /// Its turns, whichever way.
    fn bent_rad(&self) -> f64 {
        let around_rad = self
            .arc
            .map_or(0.0, |(radius_mm, _)| (self.length_mm / radius_mm).min(1.0));
        self.turn_rad.abs() + around_rad
    }
}

fn piece() -> impl Strategy<Value = Piece> {
    let turn = prop_oneof![Just(0.0), 0.06..1.7_f64, -1.7..-0.06_f64];
    let arc = prop_oneof![Just(None), (0.5..20.0_f64, any::<bool>()).prop_map(Some)];
    (turn, 0.5..20.0_f64, arc).prop_map(|(turn_rad, length_mm, arc)| Piece {
        turn_rad,
        length_mm,
        arc,
    })
}

/// The programmed moves of pieces behind a lead-in; arcs go round by at most 60 degrees, so no piece comes back to its
/// neighbour.
fn contour(pieces: &[Piece]) -> Vec<(AxisVector, Way)> {
    let mut moves = vec![(at(30.0, 0.0, 5.0), Way::Line)];
    let (mut here, mut heading_rad) = (Flat::new(30.0, 0.0), 0.0_f64);
    let direction = |angle_rad: f64| Flat::new(angle_rad.cos(), angle_rad.sin());
    for piece in pieces {
        heading_rad += piece.turn_rad;
        let way = if let Some((radius_mm, clockwise)) = piece.arc {
            let sweep_rad = (piece.length_mm / radius_mm).min(1.0);
            let sign = if clockwise { -1.0 } else { 1.0 };
            let centre = here + direction(heading_rad).left() * (sign * radius_mm);
            heading_rad += sign * sweep_rad;
            here = centre - direction(heading_rad).left() * (sign * radius_mm);
            arc((centre.u, centre.v), clockwise)
        } else {
            here = here + direction(heading_rad) * piece.length_mm;
            Way::Line
        };
        moves.push((at(here.u, here.v, 5.0), way));
    }
    moves
}

/// Points along a move from `from`, its ends among them.
fn samples(from: Flat, to: Flat, way: Way) -> Vec<Flat> {
    (0..=40)
        .map(|index| {
            let share = f64::from(index) / 40.0;
            let Way::Arc(Bow {
                centre,
                clockwise,
                turns,
            }) = way
            else {
                return from + (to - from) * share;
            };
            let sweep = sweep_rad(from, to, centre, clockwise, turns);
            let (sin, cos) = (if clockwise { -sweep } else { sweep } * share).sin_cos();
            let spoke = from - centre;
            centre + spoke * cos + spoke.left() * sin
        })
        .collect()
}

/// How near a point is to a programmed move.
fn distance_mm(point: Flat, from: Flat, to: Flat, way: Way) -> f64 {
    let ends_mm = (point - from).length().min((point - to).length());
    match way {
        Way::Arc(Bow {
            centre,
            clockwise,
            turns,
        }) => {
            let along = sweep_rad(from, point, centre, clockwise, 1);
            if along <= sweep_rad(from, to, centre, clockwise, turns) {
                ends_mm.min(((point - centre).length() - (from - centre).length()).abs())
            } else {
                ends_mm
            }
        }
        _ => {
            let chord = to - from;
            let share = (point - from).dot(chord) / chord.dot(chord);
            if (0.0..=1.0).contains(&share) {
                (point - from - chord * share).length()
            } else {
                ends_mm
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn the_tool_keeps_its_radius_from_the_contour(
        pieces in prop::collection::vec(piece(), 1..8),
        left: bool,
        radius_mm in 0.2..8.0_f64,
    ) {
        let moves = contour(&pieces);
        let side = if left { Side::Left } else { Side::Right };
        let Ok(steps) = followed(start(side, radius_mm), &moves) else {
            return Ok(());
        };
        let flat = |index: usize| Flat::of(&moves[index].0, [0, 1]);
        // A contour that turns back within three moves crosses itself, which no control that looks one move ahead sees.
        let bent_rad = |index: usize| -> f64 {
            pieces.iter().skip(index.saturating_sub(2)).take(3).map(Piece::bent_rad).sum()
        };
        let mut here = Flat::default();
        for step in &steps {
            let Step::Move(step) = step else { continue };
            let to = Flat::of(&step.to, [0, 1]);
            if step.payload > 0 {
                let reach = usize::from(bent_rad(step.payload) < 3.0);
                let beside = (step.payload - reach).max(1)..=(step.payload + reach).min(moves.len() - 1);
                for (point, index) in samples(here, to, step.way).into_iter().flat_map(|p| beside.clone().map(move |i| (p, i))) {
                    let near_mm = distance_mm(point, flat(index - 1), flat(index), moves[index].1);
                    prop_assert!(
                        near_mm >= radius_mm - 1e-6,
                        "{:?} of move {} is {near_mm} mm from move {index}", point, step.payload
                    );
                }
            }
            here = to;
        }
    }

    #[test]
    fn nothing_panics_whatever_comes(
        radius_mm in prop_oneof![-10.0..10.0_f64, any::<f64>()],
        moves in prop::collection::vec(
            (prop_oneof![Just(0.0), -5.0..5.0_f64, any::<f64>()], -5.0..5.0_f64, 0..4_u8, -5.0..5.0_f64),
            0..20,
        ),
    ) {
        let mut path = start(Side::Left, radius_mm);
        let mut steps = Vec::new();
        for (index, (u, v, way, other)) in moves.into_iter().enumerate() {
            let way = match way {
                0 => Way::Rapid,
                1 => Way::Line,
                which => arc((other, v), which == 2),
            };
            let _ = path.push(step(at(u, v, other), way, index), &mut steps);
        }
        let _ = path.finish(&mut steps);
        for step in &steps {
            if let Step::Move(step) = step {
                prop_assert!(step.to.iter().all(|value| !value.is_nan()));
            }
        }
    }
}
