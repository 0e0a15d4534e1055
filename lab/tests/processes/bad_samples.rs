//! Samples that no sound process sends, through the real shared memory: refused and named, and no drive ever sees them.

use bus::cell::CellPaths;
use bus::service::Bus;
use machine::Machine;
use plant_sim::script::faults::Sent;
use serde_json::Value;

use crate::support::{Bench, LiveCell, Run, long_program, number, run, run_with, send, text};

const STANDBY: (&str, &str) = (
    "drive_mode = \"velocity\"",
    "drive_mode = \"velocity\"\nstandby = true",
);

/// An arc, both axes moving from scan 300 on.
const PROGRAM: &str = "G21 G17 G90 G94\nG1 X20 Y0 F3000\nG3 X20 Y0 I-10 J0 F3000\nG1 X0 Y0\nM2\n";
/// In the arc.
const SCAN: u64 = 1004;

fn with_fault(bench: &Bench, process: &str, fault: &str) -> Run {
    let program = bench.file("arc.ngc", PROGRAM);
    let text = format!("[[fault]]\nat = {{ scan = {SCAN} }}\nprocess = \"{process}\"\n{fault}\n");
    let faults = bench.file("faults.toml", &text);
    run_with(
        bench.path(),
        &program,
        &["--faults", &faults.display().to_string()],
    )
}

fn undisturbed(bench: &Bench) -> String {
    let program = bench.file("arc.ngc", PROGRAM);
    text(&run(bench.path(), &program).good_report(), "/motion_digest")
}

#[test]
fn a_command_that_no_drive_may_see_trips_the_axis_by_name_and_nothing_of_it_reaches_the_drive() {
    let bench = Bench::of("xy", &[]);
    for what in ["not-a-number", "infinity", "jump"] {
        let fault = format!("do = \"corrupt\"\nwhat = \"{what}\"");
        let ended = with_fault(&bench, "servo-X", &fault);
        assert_eq!(ended.status(), 1, "{what}");
        let report = ended.report();
        let reason = text(&report, "/outcome/reason");
        assert!(reason.contains("axis X"), "{what}: {reason}");
        assert!(
            reason.contains("not finite or out of range"),
            "{what}: {reason}"
        );
        assert!(
            ended
                .stderr()
                .contains(&format!("tripped in scan {}", SCAN + 1)),
            "{what}: {}",
            ended.stderr()
        );
        // Braked together: 50 mm/s and 12 m/s² are 0.1 mm; the deviation is what two brakes differ by.
        assert!(
            number(&report, "/contour_error_um/peak") < 30.0,
            "{what}: {report}"
        );
        for axis in ["0", "1"] {
            let torque_nm = number(&report, &format!("/axes/{axis}/torque_peak_nm"));
            assert!(torque_nm < 32.0, "{what}: {torque_nm} N·m");
        }
    }
}

#[test]
fn an_answer_that_is_lost_late_or_somebody_elses_is_a_missed_scan_and_the_drive_holds_the_last_one()
{
    let bench = Bench::of("xy", &[]);
    for fault in [
        "do = \"drop\"",
        "do = \"delay\"\nlate_scans = 2",
        "do = \"corrupt\"\nwhat = \"old-scan\"",
        "do = \"corrupt\"\nwhat = \"future-scan\"",
        "do = \"corrupt\"\nwhat = \"never-visible\"",
        "do = \"corrupt\"\nwhat = \"wrong-axis\"",
        "do = \"corrupt\"\nwhat = \"wrong-incarnation\"",
        "do = \"corrupt\"\nwhat = \"replay\"",
    ] {
        let report = with_fault(&bench, "servo-X", &format!("{fault}\nscans = 5")).good_report();
        assert_eq!(number(&report, "/axes/0/missed_scans"), 5.0, "{fault}");
        assert_eq!(number(&report, "/axes/1/missed_scans"), 0.0, "{fault}");
        assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
    }
}

/// Its reader would wait for it, and for all behind it, without end.
#[test]
fn one_sample_that_is_never_visible_loses_one_scan_or_one_window_and_a_standby_goes_on_standing_by()
{
    let never = "do = \"corrupt\"\nwhat = \"never-visible\"";
    let bench = Bench::of("xy", &[]);
    let report = with_fault(&bench, "servo-X", never).good_report();
    assert_eq!(number(&report, "/axes/0/missed_scans"), 1.0);
    let report = with_fault(&bench, "planner", never).good_report();
    assert!(number(&report, "/contour_error_um/peak") < 25.0);
    let with_standby = Bench::of("xy", &[STANDBY]);
    let before = undisturbed(&with_standby);
    let report = with_fault(&with_standby, "servo-X", never).good_report();
    assert_eq!(text(&report, "/motion_digest"), before);
    assert_eq!(number(&report, "/axes/0/missed_scans"), 0.0);
}

#[test]
fn too_many_lost_answers_in_a_row_are_the_drives_watchdog() {
    let bench = Bench::of("xy", &[]);
    let ended = with_fault(&bench, "servo-Y", "do = \"drop\"\nscans = 60");
    assert_eq!(ended.status(), 1);
    let reason = text(&ended.report(), "/outcome/reason");
    assert!(
        reason.contains("commands missing for too many scans"),
        "{reason}"
    );
    assert!(reason.contains("axis Y"), "{reason}");
}

#[test]
fn none_of_it_changes_a_bit_where_a_standby_takes_over() {
    let bench = Bench::of("xy", &[STANDBY]);
    let undisturbed = undisturbed(&bench);
    for fault in [
        "do = \"corrupt\"\nwhat = \"not-a-number\"",
        "do = \"corrupt\"\nwhat = \"jump\"",
        "do = \"corrupt\"\nwhat = \"wrong-axis\"",
        "do = \"corrupt\"\nwhat = \"replay\"",
        "do = \"drop\"\nscans = 100",
        "do = \"stop\"\nscans = 100",
    ] {
        let report = with_fault(&bench, "servo-X", fault).good_report();
        assert_eq!(text(&report, "/motion_digest"), undisturbed, "{fault}");
        assert_eq!(number(&report, "/axes/0/missed_scans"), 0.0, "{fault}");
    }
}

#[test]
fn windows_that_lie_are_refused_and_the_planner_plans_again_on_the_path() {
    let bench = Bench::of("xy", &[]);
    for what in [
        "checksum",
        "cut",
        "setpoint-jump",
        "old-scan",
        "future-scan",
        "wrong-incarnation",
        "replay",
        "not-a-number",
        "infinity",
    ] {
        let fault = format!("do = \"corrupt\"\nwhat = \"{what}\"\nscans = 40");
        let report = with_fault(&bench, "planner", &fault).good_report();
        assert!(number(&report, "/windows_voided") > 0.0, "{what}: {report}");
        for limit in ["velocity", "acceleration", "travel"] {
            assert_eq!(number(&report, &format!("/limits/{limit}_exceeded")), 0.0);
        }
        assert!(number(&report, "/contour_error_um/peak") < 25.0, "{what}");
    }
}

/// Whoever may open the cell's shared memory, its owner, still finds every writer's place taken.
/// One fault for each of these numbers, so many scans apart, by the processes in turn.
fn spoilt(sent: Sent, processes: &[&str], (every, scans): (u64, u64), leave: &[&str]) -> String {
    let names = sent.leaves().iter().map(|leaf| leaf.name.as_str());
    let names = names.filter(|name| !leave.iter().any(|left| name.starts_with(left)));
    let mut text = String::new();
    let mut at = 200;
    for name in names {
        for (process, what) in processes.iter().zip(["all-bits", "most"].iter().cycle()) {
            text += &format!(
                "[[fault]]\nat = {{ scan = {at} }}\nprocess = \"{process}\"\ndo = \"corrupt\"\nscans = {scans}\nfield = \"{}.{name}\"\nwhat = \"{what}\"\n",
                sent.word()
            );
            at += every;
        }
    }
    text
}

fn with_faults(bench: &Bench, faults: &str) -> Run {
    let program = bench.file("arc.ngc", PROGRAM);
    let faults = bench.file("faults.toml", faults);
    let faults = faults.display().to_string();
    run_with(bench.path(), &program, &["--faults", &faults])
}

/// One number after the other, of either servo in turn: nobody waits for an answer that is none, and the other servo goes on.
#[test]
fn any_number_of_a_command_wrong_changes_no_bit_where_a_standby_takes_over() {
    let bench = Bench::of("xy", &[STANDBY]);
    let undisturbed = undisturbed(&bench);
    // Where the drive is to go is believed; the window that waits is said by whoever drives.
    let leave = ["position", "velocity_mm_s", "torque_nm", "pending"];
    let servos = ["servo-X/a", "servo-X/b"];
    let leave_all: Vec<&str> = leave.into_iter().chain(["state"]).collect();
    let faults = spoilt(Sent::Command, &servos, (20, 1), &leave_all);
    let report = with_faults(&bench, &faults).good_report();
    assert_eq!(text(&report, "/motion_digest"), undisturbed);
    assert_eq!(number(&report, "/axes/0/missed_scans"), 0.0);
    nobody_died(&report);
}

/// Who only watches counts what is wrong and goes on: the log has every scan.
fn nobody_died(report: &Value) {
    for process in report["processes"].as_array().expect("processes") {
        assert_eq!(process["starts"], 1, "{process}");
    }
    assert_eq!(report["missing_scans"].as_array().map_or(0, Vec::len), 0);
}

#[test]
fn any_number_of_a_window_or_a_status_wrong_ends_no_run_and_keeps_the_path() {
    let bench = Bench::of("xy", &[]);
    for sent in [Sent::Window, Sent::Status] {
        let leave = ["program_hash", "ends_program"];
        let leave = if sent == Sent::Window {
            &leave[..]
        } else {
            &[]
        };
        let faults = spoilt(sent, &["planner"], (60, 8), leave);
        let report = with_faults(&bench, &faults).good_report();
        for limit in ["velocity", "acceleration", "travel"] {
            assert_eq!(number(&report, &format!("/limits/{limit}_exceeded")), 0.0);
        }
        assert!(
            number(&report, "/contour_error_um/peak") < 40.0,
            "{sent:?}: {report}"
        );
        nobody_died(&report);
    }
}

#[test]
fn a_foreign_process_gets_no_writer_of_a_service_whose_own_lives() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(50);
    let machine = Machine::load(bench.path()).expect("the machine");
    let place = CellPaths::new(&cell.cell).expect("a name");
    let bus =
        Bus::enter(&place, &machine.shape(), "foreign", false).expect("entering as the owner");
    assert!(bus.command_writer(0, 0).is_err());
    assert!(bus.feedback_writer().is_err());
    assert!(bus.window_writer().is_err());
    assert!(bus.planner_writer().is_err());
    assert!(bus.roster_writer().is_err());
    assert!(bus.instruments_writer().is_err());
    drop(bus);
    cell.wait_for_scan(100);
}

/// A foreign process in the place of one that was lost: nothing it says has an incarnation that the roster knows.
#[test]
fn a_foreign_process_in_a_dead_servos_place_drives_nothing() {
    let bench = Bench::patient(
        "xy",
        &[
            STANDBY,
            (
                "[scan]\n",
                "[restart]\nservo = \"wait\"\nrestarts_max = 1\n\n[scan]\n",
            ),
        ],
    );
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(600);
    // One restart is allowed, so the second death leaves the place empty; the other servo of the axis goes on until it dies too.
    for _ in 0..2 {
        send(
            cell.pid_of("quadrant servo --axis X --role a"),
            libc::SIGKILL,
        );
        let scan = cell.wait_for_scan(0).scan;
        cell.wait_for_scan(scan + 300);
    }
    send(
        cell.pid_of("quadrant servo --axis X --role b"),
        libc::SIGKILL,
    );
    let scan = cell
        .wait_for(|f| f.mode == bus::sample::Mode::Tripped as u32)
        .scan;
    cell.wait_for_scan(scan + 100);
    let machine = Machine::load(bench.path()).expect("the machine");
    let place = CellPaths::new(&cell.cell).expect("a name");
    let bus =
        Bus::enter(&place, &machine.shape(), "foreign", false).expect("entering as the owner");
    let mut writer = bus.command_writer(0, 0).expect("the place is empty");
    let before = cell.wait_for_scan(0);
    for ahead in 0..300 {
        for incarnation in [1, 2, 3] {
            writer.send(&bus::sample::AxisCommand {
                scan: before.scan + ahead,
                visible_from: before.scan + ahead,
                position: 5_000_000,
                velocity_mm_s: 100.0,
                torque_nm: 10.0,
                incarnation,
                ..bytemuck::Zeroable::zeroed()
            });
        }
        std::thread::sleep(std::time::Duration::from_micros(300));
    }
    let after = cell.wait_for_scan(before.scan + 100);
    assert_eq!(after.mode, bus::sample::Mode::Tripped as u32);
    let moved = after.axes[0].motor_position - before.axes[0].motor_position;
    assert!(moved.abs() < 1000, "moved by {moved} increments");
    assert_eq!(
        after.axes[0].taken_incarnation,
        before.axes[0].taken_incarnation
    );
}
