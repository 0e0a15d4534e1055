//! The steps of each cycle against the canonical calls of LinuxCNC 2.9's interpreter (`rs274 -g`).

use super::*;

fn place(x: f64, y: f64, z: f64) -> AxisVector {
    let mut place = AxisVector::zeros();
    for (component, value) in place.iter_mut().zip([x, y, z]) {
        *component = value;
    }
    place
}

/// One hole at X1 Y2 from Z10: R2, bottom −10.
fn block(cycle: Cycle, turning: Option<Turning>) -> CycleBlock {
    let series = Series {
        cycle,
        drill_axis: 2,
        initial_mm: 10.0,
        r: Level::At(2.0),
        bottom: Level::At(-10.0),
        dwell_s: 0.5,
        peck_mm: 5.0,
        aside_mm: [1.0, -2.0],
        top: Level::At(-5.0),
    };
    CycleBlock {
        from: place(0.0, 0.0, 10.0),
        hole: place(1.0, 2.0, 10.0),
        pitch: AxisVector::zeros(),
        repeats: 1,
        aside: place(1.0, -2.0, 0.0),
        series,
        levels: series.levels(0.0),
        returns_to_r: false,
        turning,
    }
}

/// `R`apid, `F`eed and `T`ap with where they end, `W`ait, and what the spindle does.
fn printed(steps: &[Step]) -> String {
    let round = |mm: f64| (mm * 1e6).round() / 1e6;
    let at = |place: &AxisVector| {
        let [x, y, z] = [place[0], place[1], place[2]].map(round);
        format!("{x} {y} {z}")
    };
    let all: Vec<String> = steps
        .iter()
        .map(|step| match step {
            Step::Rapid(to) => format!("R {}", at(to)),
            Step::Feed(to) => format!("F {}", at(to)),
            Step::Tap(to) => format!("T {}", at(to)),
            Step::Dwell(seconds) => format!("W {seconds}"),
            Step::SpindleStop => "stop".into(),
            Step::SpindleStart(Turning::Clockwise) => "cw".into(),
            Step::SpindleStart(Turning::CounterClockwise) => "ccw".into(),
            Step::SpindleOrient => "orient".into(),
            Step::ProgramStop => "M0".into(),
        })
        .collect();
    all.join(" | ")
}

fn steps(cycle: Cycle, turning: Option<Turning>) -> String {
    let all = block(cycle, turning).steps();
    assert!(all.len() as f64 <= block(cycle, turning).steps_max());
    printed(&all)
        .replacen("R 1 2 10 | R 1 2 2 | ", "", 1)
        .to_owned()
}

const CW: Option<Turning> = Some(Turning::Clockwise);
const CCW: Option<Turning> = Some(Turning::CounterClockwise);

#[test]
fn each_cycle_makes_the_steps_of_the_reference_interpreter() {
    let table = [
        (
            Cycle::ChipBreak,
            None,
            "F 1 2 -3 | R 1 2 -2.746 | F 1 2 -8 | R 1 2 -7.746 | F 1 2 -10 | R 1 2 10",
        ),
        (
            Cycle::TapLeft,
            CCW,
            "T 1 2 -10 | stop | cw | W 0.5 | T 1 2 10 | stop | ccw",
        ),
        (Cycle::Drill, None, "F 1 2 -10 | R 1 2 10"),
        (Cycle::DrillAndDwell, None, "F 1 2 -10 | W 0.5 | R 1 2 10"),
        (
            Cycle::Peck,
            None,
            "F 1 2 -3 | R 1 2 2 | R 1 2 -2.746 | F 1 2 -8 | R 1 2 2 | R 1 2 -7.746 | F 1 2 -10 | R 1 2 10",
        ),
        (
            Cycle::TapRight,
            CW,
            "T 1 2 -10 | stop | ccw | W 0.5 | T 1 2 10 | stop | cw",
        ),
        (Cycle::Bore, None, "F 1 2 -10 | F 1 2 2 | R 1 2 10"),
        (
            Cycle::BoreAndStop,
            CW,
            "F 1 2 -10 | W 0.5 | stop | R 1 2 10 | cw",
        ),
        (
            Cycle::BackBore,
            CW,
            "R 2 0 2 | stop | orient | R 2 0 -10 | R 1 2 -10 | cw | F 1 2 -5 | F 1 2 -10 | stop | orient | \
             R 2 0 -10 | R 2 0 10 | R 1 2 10 | cw",
        ),
        (
            Cycle::BoreByHand,
            CCW,
            "F 1 2 -10 | W 0.5 | stop | M0 | R 1 2 10 | ccw",
        ),
        (Cycle::BoreAndDwell, None, "F 1 2 -10 | W 0.5 | F 1 2 10"),
    ];
    for (cycle, turning, expected) in table {
        assert_eq!(steps(cycle, turning), expected, "{cycle}");
    }
}

#[test]
fn a_series_places_its_levels_as_it_was_given_them() {
    let mut series = block(Cycle::Drill, None).series;
    let placed = |series: &Series, zero_mm| {
        let Levels {
            r_mm, bottom_mm, ..
        } = series.levels(zero_mm);
        [r_mm, bottom_mm]
    };
    // Given in G90 they go with the program's zero, given in G91 R counts from the level before the series and Z from R.
    assert_eq!(placed(&series, 100.0), [102.0, 90.0]);
    series.bottom = Level::From(-5.0);
    assert_eq!(placed(&series, 100.0), [102.0, 97.0]);
    series.r = Level::From(-3.0);
    assert_eq!(placed(&series, 100.0), [7.0, 2.0]);
}

#[test]
fn a_spindle_that_turns_wrongly_or_stands_is_refused_where_the_cycle_needs_it() {
    for (cycle, allowed) in [
        (Cycle::TapRight, [false, true, false]),
        (Cycle::TapLeft, [false, false, true]),
        (Cycle::BoreAndStop, [false, true, true]),
        (Cycle::BackBore, [false, true, true]),
        (Cycle::BoreByHand, [false, true, true]),
        (Cycle::Drill, [true, true, true]),
        (Cycle::BoreAndDwell, [true, true, true]),
    ] {
        let found = [None, CW, CCW].map(|turning| cycle.refused_spindle(turning).is_none());
        assert_eq!(found, allowed, "{cycle}");
    }
}
