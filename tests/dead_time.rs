//! A dead time of the drives that is longer than a scan, through the real processes.

use lab::cell::InProcessCell;
use machine::Machine;
use plant_sim::plant_file::PlantFile;

use crate::support::{Bench, circle_program, quadrant, root, run};

/// `xy` whose controller reckons with one number and whose drives have another.
fn bench(reckoned: u32, drives: u32) -> Bench {
    let scan = "[scan]\n";
    let with = format!("{scan}dead_time_scans = {reckoned}\n");
    let bench = Bench::of("xy", &[(scan, &with)]);
    let plant = std::fs::read_to_string(root().join("machines/xy/plant.toml")).expect("a plant");
    let drive = format!("[drive]\ndead_time_scans = {drives}\n\n[[axis]]");
    bench.file("plant.toml", &plant.replacen("[[axis]]", &drive, 1));
    bench
}

#[test]
fn the_real_processes_move_as_one_process_does_over_drives_with_a_dead_time_of_four_scans() {
    let bench = bench(4, 4);
    let text = circle_program(12.0, 5000.0, (1.0, 2.0), 30.0);
    let program = bench.file("circle.ngc", &text);
    let real = run(bench.path(), &program).good_report();
    let machine = Machine::load(bench.path()).expect("machine.toml");
    let plant = PlantFile::load(bench.path()).expect("plant.toml");
    let shown = program.display().to_string();
    let mut cell = InProcessCell::new(&machine, &plant, &shown, &text).expect("a cell");
    let mut digest = String::new();
    while let Some(published) = cell.scan() {
        digest = format!("{:032x}", published.instruments.motion_digest());
    }
    assert_eq!(real["motion_digest"], digest.as_str());
}

#[test]
fn check_notes_where_the_controller_reckons_with_another_dead_time_than_its_simulated_drives_have()
{
    for (reckoned, drives, noted) in [(1, 1, false), (4, 4, false), (1, 4, true), (4, 1, true)] {
        let bench = bench(reckoned, drives);
        let output = quadrant().arg("check").arg(bench.path()).output();
        let output = output.expect("quadrant check");
        assert!(output.status.success(), "{output:?}");
        let shown = String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr);
        let words = format!("reckons with {reckoned} scans");
        assert_eq!(shown.contains(&words), noted, "{shown}");
    }
}
