//! Simulated drives whose commands take longer to arrive.

use std::path::Path;

use machine::Machine;
use master::{DriveCommand, Drives};
use plant_sim::SimulatedDrives;
use plant_sim::plant_file::PlantFile;

fn drives(dead_time_scans: u32) -> SimulatedDrives {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let machine = Machine::load(&folder).expect("the machine");
    let mut plant = PlantFile::load(&folder).expect("the plant");
    plant.drive.dead_time_scans = dead_time_scans;
    plant.drives(&machine).expect("axes")
}

/// A motion that is different in every scan.
fn command(scan: usize) -> [DriveCommand; 2] {
    let velocity_mm_s = (scan as f64 * 0.37).sin() * 40.0;
    [velocity_mm_s, -0.5 * velocity_mm_s].map(|velocity_mm_s| DriveCommand::Velocity {
        velocity_mm_s,
        torque_offset_nm: 0.0,
    })
}

#[test]
fn a_command_acts_as_many_scans_later_as_the_plant_file_says() {
    for dead_time_scans in [1, 2, 4, 8] {
        let later = dead_time_scans as usize - 1;
        let mut prompt = drives(1);
        let mut late = drives(dead_time_scans);
        for _ in 0..later {
            prompt.exchange(&[DriveCommand::Disabled; 2]);
        }
        for scan in 0..later {
            late.exchange(&command(scan));
        }
        for scan in 0..200 {
            prompt.exchange(&command(scan));
            late.exchange(&command(scan + later));
            for axis in 0..2 {
                assert_eq!(prompt.feedback(axis), late.feedback(axis), "scan {scan}");
            }
        }
    }
}

#[test]
fn a_master_that_comes_later_finds_the_drives_at_rest_after_what_was_under_way() {
    let mut before = drives(4);
    for scan in 0..50 {
        before.exchange(&command(scan));
    }
    let mut bytes = vec![0; before.state_bytes()];
    before.save(&mut bytes);
    let mut after = drives(4);
    after.restore(&bytes).expect("a state that was saved");
    // What was under way has moved the axes on, then they braked.
    for axis in 0..2 {
        let (left, found) = (before.feedback(axis), after.feedback(axis));
        assert!(left.velocity_mm_s.abs() > 5.0, "{left:?}");
        assert!(found.velocity_mm_s.abs() < 0.5, "{found:?}");
        let moved_mm = found.motor_position_mm - left.motor_position_mm;
        assert!(
            moved_mm * left.velocity_mm_s > 0.0 && moved_mm.abs() < 1.0,
            "{moved_mm}"
        );
    }
    assert!(after.restore(&bytes[..bytes.len() - 1]).is_err());
}
