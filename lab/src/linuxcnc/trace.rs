//! What a program makes a machine do, in a form that both interpreters can be brought to, and the comparison of two of them.

use std::fmt;

/// The farthest that our circles lie from a spiral whose radii differ a little, in mm.
const UNEQUAL_MM: f64 = 6e-5;

/// Positions of X Y Z A B C U V W, in mm and degrees.
pub type Place = [f64; 9];

/// The letters of a [`Place`].
pub const LETTERS: &str = "XYZABCUVW";

/// The largest difference of two positions that count as the same, in mm or degrees.
pub const TOLERANCE: f64 = 1e-6;

/// How a move is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    Rapid,
    Feed,
    Probe,
}

/// What stands in a circle's plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Circle {
    /// At the start of the sweep.
    pub centre: Place,
    /// First and second direction of the plane, along X Y Z.
    pub plane: [[f64; 3]; 2],
    /// Positive from the first direction to the second.
    pub sweep_rad: f64,
    /// Radius at the start and at the end.
    pub radii_mm: [f64; 2],
    /// Centre and radius of the elements that it is made of, if there are more.
    pub others: Vec<(Place, f64)>,
}

/// One thing that is done.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "most steps are moves")]
pub enum Step {
    Move {
        way: Way,
        line: u32,
        from: Place,
        to: Place,
        /// In mm/min, or in degrees/min where no slide moves.
        feed: f64,
        circle: Option<Circle>,
    },
    /// A curve between two places that only its ends are compared of.
    Spline {
        line: u32,
        to: Place,
    },
    Dwell {
        seconds: f64,
    },
    Word {
        name: String,
        values: Vec<f64>,
    },
}

/// All that a program does, or why it is refused.
pub type Trace = Result<Vec<Step>, String>;

impl Step {
    pub fn word(name: &str, values: &[f64]) -> Step {
        Step::Word {
            name: name.to_owned(),
            values: values.to_vec(),
        }
    }

    fn is_word(&self, wanted: &str) -> bool {
        matches!(self, Step::Word { name, .. } if name == wanted)
    }

    /// Whether it is a message or a line for the log.
    pub fn is_said(&self) -> bool {
        matches!(self, Step::Word { name, .. } if name.starts_with("message ") || name.starts_with("log "))
    }

    /// Whether the machine moves.
    pub fn moves(&self) -> bool {
        matches!(self, Step::Move { .. } | Step::Spline { .. })
    }
}

impl fmt::Display for Step {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Step::Move {
                way,
                line,
                from,
                to: end,
                feed,
                circle,
            } => {
                write!(to, "line {line}: {way:?}")?;
                for (letter, (start, end)) in LETTERS.chars().zip(from.iter().zip(end)) {
                    if (start - end).abs() > 1e-12 || *end != 0.0 {
                        write!(to, " {letter}{end:.7}")?;
                    }
                }
                if let Some(circle) = circle {
                    let ([x, y, z, ..], [start, end]) = (circle.centre, circle.radii_mm);
                    let [a, b, c] = normal(&circle.plane);
                    write!(
                        to,
                        " about ({x:.7}, {y:.7}, {z:.7}) normal ({a:.3}, {b:.3}, {c:.3}), radius {start:.7} to {end:.7}, {:.7} rad",
                        circle.sweep_rad
                    )?;
                }
                if *way != Way::Rapid {
                    write!(to, " F{feed:.6}")?;
                }
                Ok(())
            }
            Step::Spline { line, to: end } => write!(to, "line {line}: spline to {end:?}"),
            Step::Dwell { seconds } => write!(to, "dwell {seconds} s"),
            Step::Word { name, values } => {
                write!(to, "{name}")?;
                values.iter().try_for_each(|value| write!(to, " {value}"))
            }
        }
    }
}

fn near(a: &Place, b: &Place, tolerance: f64) -> bool {
    a.iter()
        .zip(b)
        .all(|(a, b)| (a - b).abs() <= tolerance * (1.0 + a.abs() * 1e-6))
}

/// In G93 a feed is a time: theirs is that of X Y Z, ours of all slides.
fn length(from: &Place, to: &Place, axes: &[usize]) -> f64 {
    let squares = axes
        .iter()
        .map(|&axis| (component(to, axis) - component(from, axis)).powi(2));
    squares.sum::<f64>().sqrt()
}

fn near_value(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 + 1e-8 * a.abs().max(b.abs())
}

/// Leaves out what makes no difference: moves of no length, what both do at the end of a program, the order of two words for
/// one thing.
pub fn simplified(steps: Vec<Step>) -> Vec<Step> {
    let mut kept: Vec<Step> = Vec::with_capacity(steps.len());
    for step in steps {
        match &step {
            Step::Move {
                from,
                to,
                circle: None,
                ..
            } if near(from, to, TOLERANCE / 10.0) => {}
            Step::Dwell { seconds } if *seconds == 0.0 => {}
            // Switched on again, off again.
            Step::Word { name, values } if name == "mist" || name == "flood" => {
                let before = kept.iter().rev().find(|before| before.is_word(name));
                let off = Step::word(name, &[0.0]);
                if *before.unwrap_or(&off) != step {
                    let last = kept
                        .last()
                        .is_some_and(|last| *last == Step::word("flood", &[0.0]));
                    let at = kept.len() - usize::from(last && name == "mist" && values == &[0.0]);
                    kept.insert(at, step);
                }
            }
            // M60 is a stop, too.
            Step::Word { name, .. }
                if name == "stop" && kept.last().is_some_and(|last| last.is_word("pallet")) => {}
            Step::Word { name, .. } if name == "end" => break,
            Step::Word { name, .. } if IGNORED.contains(&name.as_str()) => {}
            // A spindle is stopped before its tool is changed; whether that is said apart makes no difference.
            Step::Word { name, .. } if name == "change tool" => {
                while kept.last().is_some_and(|last| last.is_word("spindle stop")) {
                    kept.pop();
                }
                kept.push(step);
            }
            // Ours has an override of the feed alone.
            Step::Word { name, values } if name == "feed override" => {
                put_override(&mut kept, Step::word("overrides", values));
            }
            Step::Word { name, .. } if name == "overrides" => put_override(&mut kept, step),
            _ => kept.push(step),
        }
    }
    let mut kept = messages_last(kept);
    let ends = |step: &Step| AT_END.iter().any(|word| step.is_word(word));
    // What is said stands behind it.
    while let Some(at) = kept.iter().rposition(|step| !step.is_said()) {
        if !kept.get(at).is_some_and(ends) {
            break;
        }
        kept.remove(at);
    }
    kept
}

/// Overrides are allowed at the start; saying again what holds makes no difference.
fn put_override(kept: &mut Vec<Step>, both: Step) {
    let before = kept.iter().rev().find(|before| before.is_word("overrides"));
    if *before.unwrap_or(&Step::word("overrides", &[1.0])) != both {
        kept.push(both);
    }
}

/// Between two moves, what is said comes behind what is done.
fn messages_last(steps: Vec<Step>) -> Vec<Step> {
    let (mut sorted, mut said) = (Vec::with_capacity(steps.len()), vec![]);
    for step in steps {
        match &step {
            Step::Word { .. } if step.is_said() => said.push(step),
            Step::Word { .. } => sorted.push(step),
            Step::Move { .. } | Step::Spline { .. } | Step::Dwell { .. } => {
                sorted.append(&mut said);
                sorted.push(step);
            }
        }
    }
    sorted.append(&mut said);
    sorted
}

/// Words that are not compared.
const IGNORED: [&str; 4] = ["adaptive feed", "feed hold", "wait input", "speed override"];

/// What the end of a program does by itself.
const AT_END: [&str; 8] = [
    "pallet",
    "spindle stop",
    "mist",
    "flood",
    "overrides",
    "spindle mode",
    "not synchronised",
    "speed",
];

/// The first difference of two traces, if there is one.
pub fn first_difference(theirs: &[Step], ours: &[Step]) -> Option<String> {
    let (mut there, mut here) = (theirs.iter().peekable(), ours.iter().peekable());
    while let Some(step) = there.next() {
        if let Step::Spline { line, to } = step {
            // All that the curve has become.
            let mut end = None;
            while let Some(Step::Move { line: at, to, .. }) = here.peek() {
                if at != line {
                    break;
                }
                end = Some(*to);
                here.next();
            }
            if !end.is_some_and(|end| near(&end, to, TOLERANCE)) {
                return Some(told(Some(step), None));
            }
            continue;
        }
        let Some(mut mine) = here.next().cloned() else {
            return Some(told(Some(step), None));
        };
        // An arc whose radii differ may be two elements; so may the way to a hole, where theirs goes down on the way.
        while !same(step, &mine) {
            let Some(one) = here.peek().and_then(|next| joined(&mine, next)) else {
                return Some(told(Some(step), Some(&mine)));
            };
            // Theirs goes down to R before it goes over the hole.
            let down_first = there
                .peek()
                .is_some_and(|next| is_rapid(step) && is_rapid(&mine) && same(next, &one));
            if down_first {
                there.next();
                here.next();
                break;
            }
            mine = one;
            here.next();
        }
    }
    here.next().map(|left| told(None, Some(left)))
}

fn is_rapid(step: &Step) -> bool {
    matches!(
        step,
        Step::Move {
            way: Way::Rapid,
            ..
        }
    )
}

fn told(theirs: Option<&Step>, ours: Option<&Step>) -> String {
    let text = |step: Option<&Step>| step.map_or("nothing".to_owned(), ToString::to_string);
    format!("theirs: {} | ours: {}", text(theirs), text(ours))
}

/// Two arcs of one block as one.
fn joined(first: &Step, second: &Step) -> Option<Step> {
    if let (
        Step::Move {
            way: Way::Rapid,
            line,
            from,
            feed,
            circle: None,
            to: over,
        },
        Step::Move {
            way: Way::Rapid,
            line: line_after,
            to,
            circle: None,
            ..
        },
    ) = (first, second)
    {
        let moved =
            |axis: &usize| (component(over, *axis) - component(to, *axis)).abs() > TOLERANCE;
        let one_axis = (0..9).filter(moved).count() == 1;
        let (way, circle) = (Way::Rapid, None);
        return (line == line_after && one_axis).then_some(Step::Move {
            way,
            line: *line,
            from: *from,
            to: *to,
            feed: *feed,
            circle,
        });
    }
    let (
        Step::Move {
            line,
            from,
            feed,
            way,
            circle: Some(circle),
            ..
        },
        Step::Move {
            line: line_after,
            to,
            circle: Some(after),
            ..
        },
    ) = (first, second)
    else {
        return None;
    };
    let one_way = circle.sweep_rad.signum() == after.sweep_rad.signum();
    (line == line_after && one_way).then(|| Step::Move {
        way: *way,
        line: *line,
        from: *from,
        to: *to,
        feed: *feed,
        circle: Some(Circle {
            sweep_rad: circle.sweep_rad + after.sweep_rad,
            radii_mm: [circle.radii_mm[0], after.radii_mm[1]],
            others: [
                circle.others.clone(),
                vec![(after.centre, after.radii_mm[0])],
            ]
            .concat(),
            ..circle.clone()
        }),
    })
}

fn same(theirs: &Step, ours: &Step) -> bool {
    match (theirs, ours) {
        (
            Step::Move {
                way,
                from,
                to,
                feed,
                circle,
                ..
            },
            Step::Move {
                way: our_way,
                to: our_to,
                feed: our_feed,
                circle: our_circle,
                ..
            },
        ) => {
            let circles = match (circle, our_circle) {
                (None, None) => true,
                (Some(circle), Some(our_circle)) => same_circle(circle, our_circle, from),
                (None, Some(_)) | (Some(_), None) => false,
            };
            let feeds = *way == Way::Rapid
                || (feed.is_nan() && our_feed.is_nan())
                || near_value(*feed, *our_feed)
                || (circle
                    .as_ref()
                    .is_some_and(|circle| circle.radii_mm[0] != circle.radii_mm[1])
                    && (feed - our_feed).abs() < 1e-6 * feed)
                || near_value(
                    feed / length(from, to, &[0, 1, 2]),
                    our_feed / length(from, to, &[0, 1, 2, 6, 7, 8]),
                );
            // A probing move is a feed that the probe ends.
            let rapid = |way: &Way| *way == Way::Rapid;
            rapid(way) == rapid(our_way) && near(to, our_to, TOLERANCE) && circles && feeds
        }
        (Step::Dwell { seconds }, Step::Dwell { seconds: ours }) => near_value(*seconds, *ours),
        (
            Step::Word { name, values },
            Step::Word {
                name: our_name,
                values: ours,
            },
        ) => {
            let all = values.iter().zip(ours).all(|(a, b)| near_value(*a, *b));
            let named = name == our_name || (theirs.is_said() && same_text(name, our_name));
            named && values.len() == ours.len() && all
        }
        (Step::Move { .. } | Step::Spline { .. } | Step::Dwell { .. } | Step::Word { .. }, _) => {
            false
        }
    }
}

/// What is said, but for the last printed digit of its numbers.
fn same_text(theirs: &str, ours: &str) -> bool {
    let number = |word: &str| word.parse::<f64>().ok();
    let near = |theirs: &str, ours: &str| {
        theirs == ours
            || number(theirs)
                .zip(number(ours))
                .is_some_and(|(theirs, ours)| (theirs - ours).abs() <= 1.5e-6)
    };
    let (there, here) = (theirs.split(' '), ours.split(' '));
    there.clone().count() == here.clone().count() && there.zip(here).all(|(a, b)| near(a, b))
}

/// The normal of a plane, along X Y Z.
fn normal([u, v]: &[[f64; 3]; 2]) -> [f64; 3] {
    [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ]
}

/// How far a place lies in a direction.
fn in_direction(place: &Place, direction: &[f64; 3]) -> f64 {
    place
        .iter()
        .zip(direction)
        .map(|(place, direction)| place * direction)
        .sum()
}

fn component(place: &Place, axis: usize) -> f64 {
    place.get(axis).copied().unwrap_or_default()
}

fn same_circle(theirs: &Circle, ours: &Circle, from: &Place) -> bool {
    let unequal_mm = (theirs.radii_mm[0] - theirs.radii_mm[1]).abs();
    let radius_mm = theirs.radii_mm[0].max(1e-9);
    let (there, here) = (normal(&theirs.plane), normal(&ours.plane));
    if there.iter().zip(here).any(|(a, b)| (a - b).abs() > 1e-9) {
        return false;
    }
    if unequal_mm > 1e-8 {
        return near_spiral(theirs, ours, from);
    }
    // What lies along the normal makes no difference.
    let centres = theirs.plane.iter().all(|direction| {
        let apart = in_direction(&theirs.centre, direction) - in_direction(&ours.centre, direction);
        apart.abs() <= TOLERANCE * (1.0 + radius_mm * 1e-6)
    });
    centres && (theirs.sweep_rad - ours.sweep_rad).abs() <= 1e-6 + 2.0 * TOLERANCE / radius_mm
}

/// LinuxCNC makes a spiral of an arc whose radii differ; we move the centre. No point of the spiral lies farther from our
/// circles than the radii differ.
fn near_spiral(theirs: &Circle, ours: &Circle, from: &Place) -> bool {
    let [start_mm, end_mm] = theirs.radii_mm;
    let in_plane = |place: &Place| {
        theirs
            .plane
            .map(|direction| in_direction(place, &direction))
    };
    let (of_centre, at_start) = (in_plane(&theirs.centre), in_plane(from));
    let start_rad = f64::atan2(at_start[1] - of_centre[1], at_start[0] - of_centre[0]);
    let unequal_mm = (start_mm - end_mm).abs();
    let allowed_mm = TOLERANCE + unequal_mm.max((unequal_mm * 20.0).min(UNEQUAL_MM));
    let mut circles: Vec<([f64; 2], f64)> = ours
        .others
        .iter()
        .map(|(centre, radius)| (in_plane(centre), *radius))
        .collect();
    circles.push((in_plane(&ours.centre), ours.radii_mm[0]));
    let off_mm = |share: f64| {
        let (angle, radius) = (
            start_rad + theirs.sweep_rad * share,
            start_mm + (end_mm - start_mm) * share,
        );
        let point = [
            of_centre[0] + radius * angle.cos(),
            of_centre[1] + radius * angle.sin(),
        ];
        let from_each = circles.iter().map(|(centre, radius)| {
            (f64::hypot(point[0] - centre[0], point[1] - centre[1]) - radius).abs()
        });
        from_each.fold(f64::INFINITY, f64::min)
    };
    let near = (0..=32).all(|sample| off_mm(f64::from(sample) / 32.0) <= allowed_mm);
    near && (theirs.sweep_rad - ours.sweep_rad).abs() <= 0.5
}
