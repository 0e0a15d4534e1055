//! A run begins with the tool, the offset and the modes that the run before it has left: a program in pieces is the program.

use std::path::Path;
use std::sync::Arc;

use machine::Machine;
use path::geometry::AxisVector;
use program::{EventKind, Modal, Piece, Progress, Reading, Setup};
use proptest::prelude::*;

/// What a machine and its files hold between two runs.
struct Cell {
    setup: Setup,
    place: AxisVector,
}

/// What a run has made: where its elements end, and the state behind it.
type Made = (Vec<AxisVector>, Modal);

impl Cell {
    fn new() -> Cell {
        let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
        let mut setup = Setup::of(&Machine::load(&machine).unwrap());
        for axis in &mut setup.axes {
            (axis.travel_min, axis.travel_max) = (-1e5, 1e5);
        }
        Cell {
            setup,
            place: AxisVector::zeros(),
        }
    }

    /// Runs these blocks; none if they are refused.
    fn run(&mut self, blocks: &str) -> Option<Made> {
        let setup = Arc::new(self.setup.clone());
        let mut reading = Reading::of_text("blocks", blocks, &setup, self.place).ok()?;
        let mut all = Piece::default();
        while !matches!(reading.read(usize::MAX, &mut all).ok()?, Progress::Ended(_)) {}
        for event in &all.events {
            let beginning = &mut self.setup.beginning;
            match event.kind {
                EventKind::ToolChange(tool) | EventKind::ToolIs(tool) => beginning.tool = tool,
                EventKind::ToolOffsetOf(tool) => beginning.offset_of = tool,
                EventKind::ToolOffset { axis, value } => {
                    let letter = setup.axes[axis as usize].letter.to_string();
                    beginning.offset.insert(letter, value);
                }
                _ => {}
            }
        }
        self.setup.beginning.offset.retain(|_, value| *value != 0.0);
        self.setup.beginning.modes = reading.modes_left();
        self.setup.parameters = reading.kept_parameters();
        self.setup.tools = reading.tools().to_vec();
        let ends: Vec<AxisVector> = all.elements.iter().map(|of| of.end()).collect();
        self.place = ends.last().copied().unwrap_or(self.place);
        Some((ends, reading.modal()))
    }

    fn z_behind(&mut self, runs: &[&str]) -> f64 {
        for blocks in runs {
            self.run(blocks).unwrap();
        }
        self.place[2]
    }
}

#[test]
fn g43_takes_the_tool_in_the_spindle_whatever_run_has_put_it_there() {
    let ways: [&[&str]; 9] = [
        &["T3 M6 G43"],
        &["T3 M6", "G43"],
        &["T3\nM6", "G43", "G21"],
        &["M61 Q3", "G43"],
        &["T3 M6\nM2", "G43\nM2"],
        &["G43 H3"],
        &["G43.1 Z75"],
        &["G43.1 Z35", "G43.2 H1"],
        &["T3 M6", "G43 H1", "G43"],
    ];
    for way in ways {
        for next in [
            "G0 Z0",
            "G21 G90 G0 Z0\nM2",
            "G0 Z[#5083-75]",
            "G43.2 H1\nG0 Z-40",
        ] {
            let runs = [way, &[next]].concat();
            assert_eq!(Cell::new().z_behind(&runs), -25.0, "{runs:?}");
        }
    }
    for runs in [
        &["T3 M6", "G43", "G49", "G0 Z0"],
        &["G43", "G0 Z0", "G49", "Z0"],
        &["T3 M6", "G43", "M61 Q0", "G43\nG0 Z0"],
    ] {
        assert_eq!(Cell::new().z_behind(runs), -100.0, "{runs:?}");
    }
}

#[test]
fn g43_without_a_tool_takes_nothing_off_and_remarks_on_it() {
    let setup = Arc::new(Cell::new().setup);
    let mut reading = Reading::of_text("blocks", "G43\nM2\n", &setup, AxisVector::zeros()).unwrap();
    reading.read(usize::MAX, &mut Piece::default()).unwrap();
    let notes = reading.notes();
    assert!(notes[0].text.contains("without a tool"), "{notes:?}");
}

#[test]
fn m2_leaves_the_modes_that_linuxcnc_leaves_and_the_tool_and_its_offset() {
    let mut cell = Cell::new();
    cell.run("T3 M6 G43\nG20 G91 G18 G55 G95 F0.1 S500 G99 G64 P0.1 G2 M2")
        .unwrap();
    let (_, modal) = cell.run("G4 P0").unwrap();
    let codes = modal.codes.join(" ");
    assert!(
        codes.starts_with("G1 G17 G20 G40 G43 G54 G64 G90 G94 G97 G99"),
        "{codes}"
    );
    assert_eq!((modal.feed, modal.speed, modal.tool), (None, 500.0, 3));
    assert_eq!(modal.tool_length()[2], 75.0);
}

const BLOCKS: [&str; 38] = [
    "T3 M6",
    "T1 M6",
    "T2 M6 G43",
    "M61 Q2",
    "M61 Q0",
    "G43",
    "G43 H1",
    "G43 H3",
    "G43.1 Z12.5",
    "G43.1 X2",
    "G43.2 H1",
    "G49",
    "G10 L1 P3 Z80",
    "G20",
    "G21",
    "G90",
    "G91",
    "G54",
    "G55",
    "G59.1",
    "G10 L2 P2 X5 Z-20",
    "G92 Z3",
    "G92.1",
    "G52 X4",
    "F500",
    "G1",
    "G0",
    "G0 X1",
    "X2",
    "Z1 F100",
    "G1 X3 Z-2",
    "G18",
    "G19",
    "G64 P0.1",
    "G61",
    "G93 G1 X1 F20",
    "G94",
    "S1000 M3",
];

proptest! {
    #[test]
    fn blocks_that_run_one_by_one_go_where_they_go_together(chosen in prop::collection::vec(0..BLOCKS.len(), 1..24)) {
        let chosen: Vec<&str> = chosen.into_iter().map(|index| BLOCKS[index]).collect();
        let mut one_by_one = Cell::new();
        let made: Option<Vec<Made>> = chosen.iter().map(|block| one_by_one.run(block)).collect();
        let together = Cell::new().run(&chosen.join("\n"));
        // F of G93 is a word of its block alone.
        prop_assume!(!chosen.iter().any(|block| block.contains("G93")) || made.is_some());
        let ends = |made: &[Made]| -> Vec<AxisVector> {
            made.iter().flat_map(|(ends, _)| ends.clone()).collect()
        };
        prop_assert_eq!(made.is_some(), together.is_some(), "{:?}", &chosen);
        if let (Some(made), Some((all, modal))) = (made, together) {
            prop_assert_eq!(ends(&made), all, "{:?}", &chosen);
            let last = &made.last().unwrap().1;
            // The spindle stops with each run.
            let codes = |modal: &Modal| -> Vec<String> {
                modal.codes.iter().filter(|code| !code.starts_with('M')).cloned().collect()
            };
            prop_assert_eq!(codes(last), codes(&modal), "{:?}", &chosen);
            prop_assert_eq!(last.tool_length(), modal.tool_length(), "{:?}", &chosen);
            prop_assert_eq!((last.tool, last.speed), (modal.tool, modal.speed), "{:?}", &chosen);
        }
    }
}
