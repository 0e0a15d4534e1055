//! A cell in one process gives what the real processes give, to the bit.

use lab::cell::InProcessCell;
use machine::Machine;
use plant_sim::plant_file::PlantFile;

use crate::support::{Bench, circle_program, run};

#[test]
fn an_in_process_cell_has_the_motion_digest_of_the_real_run() {
    for name in ["xy", "xy-torque"] {
        let bench = Bench::of(name, &[]);
        let text = circle_program(12.0, 5000.0, (1.0, 2.0), 30.0);
        let program = bench.file("circle.ngc", &text);
        let real = run(bench.path(), &program).good_report();
        let machine = Machine::load(bench.path()).expect("machine.toml");
        let plant = PlantFile::load(&bench.path().join("plant.toml")).expect("plant.toml");
        let shown = program.display().to_string();
        let mut cell = InProcessCell::new(&machine, &plant, &shown, &text).expect("a cell");
        let (mut scans, mut digest) = (0u64, 0);
        while let Some(printed) = cell.scan() {
            scans = printed.feedback.scan;
            digest = printed.instruments.motion_digest();
        }
        let hex = format!("{digest:032x}");
        assert_eq!(real["motion_digest"], hex.as_str(), "{name}, {scans} scans");
    }
}
