//! How far the table is from where it is to be while it is jogged, and while it returns to its path.

use std::path::Path;

use bus::sample::{Feedback, Hand, Mode, OperatorRequest, Order};
use lab::cell::InProcessCell;
use machine::Machine;
use plant_sim::plant_file::PlantFile;

/// Circle R25 F3000; the tool is at its start.
const CIRCLE: &str = "G21 G90 G17\nG0 X25 Y0\nG3 X25 Y0 I-25 J0 F3000\nM2\n";
/// From a hold in mid-arc, in ms: jogs of both axes, one of them there and back, and the return.
const ORDERS: [(u64, Order, u32, f64); 6] = [
    (1550, Order::Hold, 0, 0.0),
    (2000, Order::Jog, 0, 3.0),
    (3200, Order::Jog, 1, -2.0),
    (4400, Order::Jog, 0, -1.0),
    (5200, Order::Jog, 0, 1.0),
    (6000, Order::Resume, 0, 0.0),
];

fn machine(name: &str, jerk_mm_s3: Option<f64>) -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines");
    let folder = folder.join(name);
    let mut machine = Machine::load(&folder).expect("machine.toml");
    if jerk_mm_s3.is_some() {
        for axis in &mut machine.axes {
            axis.jerk_mm_s3 = jerk_mm_s3;
            axis.increment_nm = 0.1;
        }
    }
    let mut plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    plant.axes[0].start_position_mm = 25.0;
    (machine, plant)
}

/// One scan: what was shown and commanded at its start, and the true places at its end.
struct Row {
    feedback: Feedback,
    /// Where its controller wants the table.
    command_mm: [f64; 2],
    following_um: [f64; 2],
    /// The manual controller follows its course.
    follows: [bool; 2],
    table_mm: [f64; 2],
}

fn run(machine: &Machine, plant: &PlantFile) -> Vec<Row> {
    let mut cell = InProcessCell::new(machine, plant, "circle.ngc", CIRCLE).expect("a cell");
    let scans_per_ms = 1000 / u64::from(machine.scan.period_us);
    let mut rows: Vec<Row> = Vec::new();
    while let Some(published) = cell.scan() {
        let last = published.instruments.subsamples as usize - 1;
        let feedback = *published.feedback;
        let commands = published.commands;
        let mm = |axis: usize, place: i64| place as f64 * machine.axes[axis].increment_mm();
        rows.push(Row {
            feedback,
            command_mm: [0, 1].map(|axis| mm(axis, commands[axis].position)),
            following_um: [0, 1].map(|axis| commands[axis].following_error_mm * 1e3),
            follows: [0, 1].map(|axis| commands[axis].hand >= Hand::Follows as u32),
            table_mm: [0, 1].map(|axis| published.instruments.axes[axis].table_mm[last]),
        });
        for (at_ms, order, axis, value) in ORDERS {
            if feedback.scan == at_ms * scans_per_ms {
                let request = OperatorRequest {
                    order: order as u32,
                    axis,
                    value,
                    ..OperatorRequest::default()
                };
                assert_eq!(cell.order(&request).accepted, 1, "{order:?}");
            }
        }
        assert!(rows.len() < 200_000, "the run does not end");
    }
    let end = rows.last().expect("a row").feedback.mode;
    assert_eq!(Mode::from_wire(end), Some(Mode::Finished));
    rows
}

/// The furthest that each axis was off, in µm. A command acts a scan after the one it is of: there the table is compared with it.
#[derive(Debug, Default)]
struct Off {
    /// Motor from where the jog wants it.
    jog_lag_um: [f64; 2],
    /// Table from the jog's command.
    jog_table_um: [f64; 2],
    /// Table from the setpoints of the return.
    return_table_um: [f64; 2],
}

impl Off {
    fn of(rows: &[Row]) -> Off {
        let mut off = Off::default();
        for axis in 0..2 {
            for pair in rows.windows(2) {
                let [before, row] = pair else { continue };
                let jogged = row.follows[axis];
                let returns = row.feedback.tag.is_off_path() && !row.feedback.window.is_none();
                let table_um = ((before.table_mm[axis] - row.command_mm[axis]) * 1e3).abs();
                if jogged {
                    let lag_um = row.following_um[axis].abs();
                    off.jog_lag_um[axis] = off.jog_lag_um[axis].max(lag_um);
                    off.jog_table_um[axis] = off.jog_table_um[axis].max(table_um);
                }
                if returns {
                    off.return_table_um[axis] = off.return_table_um[axis].max(table_um);
                }
            }
        }
        off
    }
}

#[test]
fn the_table_stays_near_its_command_in_jogs_and_returns_also_where_they_reverse() {
    for name in ["xy", "xy-fast"] {
        for jerk_mm_s3 in [None, Some(100_000.0)] {
            let (machine, plant) = machine(name, jerk_mm_s3);
            let off = Off::of(&run(&machine, &plant));
            println!("{name}, jerk {jerk_mm_s3:?}: {off:.2?}");
            for axis in 0..2 {
                assert!(off.jog_lag_um[axis] <= 2.5, "{name}: {off:?}");
                assert!(off.jog_table_um[axis] <= 3.0, "{name}: {off:?}");
                assert!(off.return_table_um[axis] <= 4.0, "{name}: {off:?}");
            }
        }
    }
}
