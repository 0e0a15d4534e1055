#![allow(clippy::expect_used)]

use super::reading::random_scan;
use super::*;

use bus::sample::{PathTag, WindowId};
use bytemuck::Zeroable;
use machine::Machine;
use std::path::Path;

fn read(text: &str) -> Result<FaultScript, String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let mut machine = Machine::load(&folder).expect("the machine");
    machine.axes.first_mut().expect("an axis").standby = true;
    parse("faults.toml", text, &machine).map_err(|e| e.to_string())
}

fn feedback(scan: u64, command_positions: [i64; 2]) -> Feedback {
    let mut feedback = Feedback::zeroed();
    feedback.scan = scan;
    feedback.axis_count = 2;
    for (axis, command_position) in feedback.axes.iter_mut().zip(command_positions) {
        axis.command_position = command_position;
    }
    feedback
}

/// Index and scan of what fires, fed with these feedbacks.
fn fires(script: &FaultScript, feedbacks: &[Feedback]) -> Vec<(usize, u64)> {
    let mut state = TriggerState::new(script);
    let mut fired = Vec::new();
    for feedback in feedbacks {
        let before = fired.clone();
        let has_fired = |index| before.iter().any(|(i, _)| *i == index);
        state.due(feedback, has_fired, |index| {
            fired.push((index, feedback.scan));
        });
    }
    fired
}

fn faults(text: &str) -> Vec<(Trigger, Process, Action)> {
    let script = read(text).expect("a script");
    let parts = |f: &Fault| (f.at, f.process, f.action);
    script.faults.iter().map(parts).collect()
}

/// The file of the module's documentation.
fn documented() -> String {
    let lines = include_str!("../faults.rs").lines();
    let inside = lines
        .skip_while(|line| !line.contains("```toml"))
        .skip(1)
        .take_while(|line| !line.contains("```"));
    let lines: Vec<&str> = inside
        .map(|line| line.trim_start_matches("//!").trim_start())
        .collect();
    lines.join("\n")
}

#[test]
fn the_file_in_the_documentation_says_what_it_says_there() {
    let text = documented();
    let script = read(&text).expect("the documented script");
    let restart = RestartOverrides {
        planner: Some(AfterLoss::Resume),
        servo: Some(AfterLoss::Wait),
        master: Some(AfterMaster::Wait),
        monitor: Some(AfterMonitor::Restart),
        restarts_max: Some(400),
        within_s: Some(60.0),
    };
    assert_eq!(script.restart, restart);
    let found = faults(&text);
    assert_eq!(found.len(), 204);
    let kill = Action::Kill {
        restart_after_scans: 30,
    };
    for (n, fault) in (0..200).zip(&found) {
        let at = Trigger::Scan(900 + 37 * n);
        assert_eq!(fault, &(at, Job::Planner.into(), kill));
    }
    let others = [
        (
            Trigger::Block(12),
            Process::servo(0, 0),
            Action::Stop { scans: 40 },
        ),
        (
            Trigger::Element(3),
            Job::Planner.into(),
            Action::Drop { scans: 16 },
        ),
        (
            Trigger::Reversal { axis: 0, count: 2 },
            Process::servo(0, 0),
            Action::Delay {
                scans: 1,
                late_scans: 2,
            },
        ),
    ];
    assert_eq!(found.get(200..203), Some(others.as_slice()));
    let last = found.last().expect("the last");
    assert!(matches!(last.0, Trigger::Scan(500..=4000)), "{last:?}");
    let wrong = Action::Corrupt {
        scans: 1,
        what: Corruption::NotANumber,
    };
    assert_eq!((last.1, last.2), (Process::servo(1, 0), wrong));
}

#[test]
fn roles_and_processes_are_found_by_their_names_and_a_kill_has_its_default() {
    for (name, process) in [
        ("planner", Job::Planner.into()),
        ("servo-Y", Process::servo(1, 0)),
        ("servo-Y/a", Process::servo(1, 0)),
        ("servo-X/b", Process::servo(0, 1)),
        ("servo-X-b", Process::servo(0, 1)),
        ("plant-sim", Job::Master.into()),
        ("monitor", Job::Monitor.into()),
    ] {
        let text = format!("[[fault]]\nat = {{ scan = 1 }}\nprocess = \"{name}\"\ndo = \"kill\"\n");
        let kill = Action::Kill {
            restart_after_scans: RESTART_AFTER_SCANS,
        };
        assert_eq!(faults(&text), [(Trigger::Scan(1), process, kill)], "{name}");
    }
    assert_eq!(read("").map(|script| script.faults.len()), Ok(0));
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table of refusals")]
fn what_is_no_fault_is_refused_with_line_and_what_would_be_right() {
    let kill = "process = \"planner\"\ndo = \"kill\"";
    let scan = "at = { scan = 1 }";
    let servo = "at = { scan = 1 }\nprocess = \"servo-X\"";
    let planner = "at = { scan = 1 }\nprocess = \"planner\"";
    for (text, word) in [
        // When.
        (
            format!("at = {{}}\n{kill}"),
            "faults.toml:3: fault 1 at: must have exactly one of scan, block",
        ),
        (
            format!("at = {{ scan = 1, block = 2 }}\n{kill}"),
            "exactly one",
        ),
        (format!("at = {{ scan = -1 }}\n{kill}"), "faults.toml:3"),
        (
            format!("at = {{ scan = 1000000001 }}\n{kill}"),
            "at most 1000000000",
        ),
        (
            format!("at = {{ block = 0 }}\n{kill}"),
            "at.block = 0: must be at least 1",
        ),
        (
            format!("at = {{ element = 4294967295 }}\n{kill}"),
            "at most 4294967294",
        ),
        (
            format!("at = {{ reversal = 1 }}\n{kill}"),
            "reversal and axis go together",
        ),
        (
            format!("at = {{ scan = 1, axis = \"X\" }}\n{kill}"),
            "reversal and axis go together",
        ),
        (
            format!("at = {{ reversal = 0, axis = \"X\" }}\n{kill}"),
            "at least 1",
        ),
        (
            format!("at = {{ reversal = 1, axis = \"Q\" }}\n{kill}"),
            "it has X Y",
        ),
        (
            format!("at = {{ random = [9, 8] }}\n{kill}"),
            "at.random = [9, 8]",
        ),
        (format!("at = {{ when = 3 }}\n{kill}"), "unknown field"),
        // Who.
        (
            format!("{scan}\nprocess = \"plotter\"\ndo = \"kill\""),
            "faults.toml:4: fault 1 process = \"plotter\": must be planner, plant-sim",
        ),
        (
            format!("{scan}\nprocess = \"servo-Q\"\ndo = \"kill\""),
            "it has X Y",
        ),
        (
            format!("{scan}\nprocess = \"servo-X/c\"\ndo = \"kill\""),
            "must be a or b",
        ),
        (
            format!("{scan}\nprocess = \"servo-X/a/a\"\ndo = \"kill\""),
            "must be a or b",
        ),
        // What.
        (
            format!("{servo}\ndo = \"halt\""),
            "faults.toml:5: fault 1 do = \"halt\": must be one of kill, stop, drop, delay, corrupt",
        ),
        (format!("{servo}\ndo = \"stop\""), "stop needs scans"),
        (
            format!("{servo}\ndo = \"kill\"\nscans = 3"),
            "faults.toml:6: fault 1 kill has no scans",
        ),
        (
            format!("{servo}\ndo = \"drop\"\nrestart_after_scans = 3"),
            "drop has no restart_after_scans",
        ),
        (
            format!("{servo}\ndo = \"kill\"\nrestart_after_scans = 0"),
            "must be at least 1 and at most 1000000",
        ),
        (
            format!("{servo}\ndo = \"drop\"\nscans = 0"),
            "scans = 0 scans: must be at least 1",
        ),
        (format!("{servo}\ndo = \"delay\""), "delay needs late_scans"),
        (
            format!("{servo}\ndo = \"delay\"\nlate_scans = 9"),
            "at most 8",
        ),
        (
            format!("{servo}\ndo = \"drop\"\nlate_scans = 2"),
            "drop has no late_scans",
        ),
        (format!("{servo}\ndo = \"corrupt\""), "corrupt needs what"),
        (
            format!("{servo}\ndo = \"drop\"\nwhat = \"jump\""),
            "drop has no what",
        ),
        (
            format!("{servo}\ndo = \"corrupt\"\nwhat = \"cut\""),
            "of servo-X it must be one of not-a-number, infinity, jump",
        ),
        (
            format!("{planner}\ndo = \"corrupt\"\nwhat = \"wrong-axis\""),
            "of planner it must be one of",
        ),
        (
            format!("{scan}\nprocess = \"monitor\"\ndo = \"drop\""),
            "monitor can only be killed or stopped",
        ),
        (
            format!("{scan}\nprocess = \"plant-sim\"\ndo = \"corrupt\"\nwhat = \"jump\""),
            "plant-sim can only be",
        ),
        (
            format!("{scan}\nprocess = \"servo-Y/b\"\ndo = \"kill\""),
            "axis Y has no standby",
        ),
        (
            format!("{scan}\nprocess = \"plant-sim\"\ndo = \"stop\"\nscans = 3"),
            "nobody would say when it goes on",
        ),
        (
            format!("{servo}\ndo = \"kill\"\nloud = true"),
            "unknown field",
        ),
        // How often.
        (
            format!("at = {{ block = 2 }}\n{kill}\nrepeat = {{ times = 2, every_scans = 5 }}"),
            "repeat: goes with",
        ),
        (
            format!(
                "at = {{ random = [1, 2] }}\n{kill}\nrepeat = {{ times = 2, every_scans = 5 }}"
            ),
            "repeat: goes with",
        ),
        (
            format!("{scan}\n{kill}\nrepeat = {{ times = 0, every_scans = 5 }}"),
            "repeat.times = 0",
        ),
        (
            format!("{scan}\n{kill}\nrepeat = {{ times = 1025, every_scans = 5 }}"),
            "at most 1024",
        ),
        (
            format!("{scan}\n{kill}\nrepeat = {{ times = 2, every_scans = 0 }}"),
            "repeat.every_scans = 0",
        ),
    ] {
        let error = read(&format!("seed = 1\n[[fault]]\n{text}\n")).expect_err(&text);
        assert!(error.contains(word), "{text}: {error}");
    }
    for (text, word) in [
        ("planner = \"restart\"", "faults.toml:2"),
        ("monitor = \"end\"", "unknown variant"),
        ("master = \"resume\"", "unknown variant"),
        ("restarts_max = 0", "faults.toml:2: restart.restarts_max"),
        ("within_s = 0.0", "must be above 0"),
        ("within_s = nan", "must be above 0"),
        ("after = 3", "unknown field"),
    ] {
        let error = read(&format!("[restart]\n{text}\n")).expect_err(text);
        assert!(error.contains(word), "{text}: {error}");
    }
}

#[test]
fn every_broken_fault_is_named_in_its_own_line() {
    let good = "[[fault]]\nat = { scan = 1 }\nprocess = \"planner\"\ndo = \"kill\"\n";
    let bad = good.replace("planner", "nobody");
    let error = read(&format!("{good}{bad}{good}{bad}")).expect_err("two are broken");
    let lines: Vec<&str> = error.lines().collect();
    assert_eq!(lines.len(), 2, "{error}");
    for (line, start) in lines
        .iter()
        .zip(["faults.toml:7: fault 2 ", "faults.toml:15: fault 4 "])
    {
        assert!(line.starts_with(start), "{line}");
    }
}

#[test]
fn repetitions_count_towards_the_most_faults_of_a_script() {
    let some = |times: u64| {
        format!(
            "[[fault]]\nat = {{ scan = 1 }}\nprocess = \"planner\"\ndo = \"kill\"\nrepeat = {{ times = {times}, every_scans = 1 }}\n"
        )
    };
    let full = read(&(some(1000) + &some(24))).expect("as many as there can be");
    assert_eq!(full.faults.len(), FAULTS_MAX);
    let error = read(&(some(1000) + &some(25))).expect_err("one too many");
    assert!(error.contains("faults.toml:8"), "{error}");
    assert!(error.contains("1024"), "{error}");
}

#[test]
fn a_random_scan_is_the_same_for_a_seed_and_lies_in_its_range() {
    let script = |seed: u64| {
        let fault =
            "[[fault]]\nat = { random = [500, 520] }\nprocess = \"planner\"\ndo = \"kill\"\n";
        let text = format!("seed = {seed}\n{}", fault.repeat(300));
        faults(&text).iter().map(|f| f.0).collect::<Vec<_>>()
    };
    let found = script(7);
    assert_eq!(found, script(7));
    assert_ne!(found, script(8));
    for scan in 500..=520 {
        assert!(found.contains(&Trigger::Scan(scan)), "{scan} never comes");
    }
    let inside = |t: &Trigger| matches!(t, Trigger::Scan(500..=520));
    assert!(found.iter().all(inside));
    // Part of what a script means: another generator would move its faults.
    assert_eq!(random_scan(0, 0, 0, u64::MAX), 0xE220_A839_7B1D_CDAF);
    assert_eq!(random_scan(0, 1, 0, u64::MAX), 0x6E78_9E6A_A1B9_65F4);
    assert_eq!(random_scan(3, 0, 9, 9), 9);
}

#[test]
fn a_block_becomes_the_first_element_at_or_after_its_line() {
    let text = "[[fault]]\nat = { block = 12 }\nprocess = \"planner\"\ndo = \"kill\"\n";
    let mut script = read(text).expect("a script");
    let on_path = |element| {
        let mut feedback = feedback(5, [0, 0]);
        feedback.window.sequence = 1;
        feedback.tag.element = element;
        feedback
    };
    assert_eq!(fires(&script, &[on_path(9)]), [], "not resolved yet");
    let lines = [3, 11, 14, 15];
    let element_from = |line| {
        let found = lines.iter().position(|l| *l >= line)?;
        Some(found as u32)
    };
    let error = script.clone().resolve_blocks(|_| None).expect_err("none");
    let words = "faults.toml:3: at.block = 12: the program has no motion";
    assert!(error.to_string().starts_with(words), "{error}");
    script.resolve_blocks(element_from).expect("element 2");
    assert_eq!(
        script.faults.first().map(|f| f.at),
        Some(Trigger::Element(2))
    );
    assert_eq!(fires(&script, &[on_path(1), on_path(3)]), [(0, 5)]);
}

#[test]
fn a_fault_fires_once_at_its_scan_or_at_the_first_after_it() {
    let text = "[[fault]]\nat = { scan = 3 }\nprocess = \"planner\"\ndo = \"kill\"\n\
                [[fault]]\nat = { scan = 2 }\nprocess = \"monitor\"\ndo = \"kill\"\n";
    let script = read(text).expect("a script");
    let in_turn: Vec<Feedback> = (0..6).map(|scan| feedback(scan, [0, 0])).collect();
    assert_eq!(fires(&script, &in_turn), [(1, 2), (0, 3)]);
    // A master that was restarted begins later, and what fired in its forerunner stays fired.
    let mut state = TriggerState::new(&script);
    let mut late = Vec::new();
    state.due(&feedback(40, [0, 0]), |index| index == 0, |i| late.push(i));
    assert_eq!(late, [1]);
}

#[test]
fn an_element_is_under_way_only_where_a_window_of_the_path_is_executed() {
    let text = "[[fault]]\nat = { element = 0 }\nprocess = \"planner\"\ndo = \"kill\"\n";
    let script = read(text).expect("a script");
    let idle = feedback(1, [0, 0]);
    let mut returning = feedback(2, [0, 0]);
    returning.window = WindowId {
        checksum: 1,
        sequence: 1,
        incarnation: 1,
    };
    returning.tag = PathTag::OFF_PATH;
    let mut on_path = returning;
    on_path.scan = 3;
    on_path.tag.element = 0;
    assert_eq!(fires(&script, &[idle, returning, on_path]), [(0, 3)]);
}

#[test]
fn a_reversal_is_counted_for_its_axis_where_the_motion_turns_and_standing_is_none() {
    let fault = |count: u32, axis: &str| {
        format!(
            "[[fault]]\nat = {{ reversal = {count}, axis = \"{axis}\" }}\nprocess = \"planner\"\ndo = \"kill\"\n"
        )
    };
    let text = [fault(1, "X"), fault(2, "X"), fault(1, "Y")].concat();
    let script = read(&text).expect("a script");
    let x = [0, 0, 5, 9, 9, 10, 10, 8, 7, 7, 6, 6, 8];
    let motion: Vec<Feedback> = x
        .iter()
        .zip(0..)
        .map(|(x, scan)| feedback(scan, [*x, scan as i64]))
        .collect();
    assert_eq!(fires(&script, &motion), [(0, 7), (1, 12)]);
    // The first motion is none, also not a negative one.
    let down: Vec<Feedback> = (0..9)
        .map(|scan| feedback(scan, [-(scan as i64), 0]))
        .collect();
    assert_eq!(fires(&script, &down), []);
    let far = [i64::MIN, i64::MAX, i64::MIN].map(|x| feedback(0, [x, 0]));
    assert_eq!(fires(&script, &far), [(0, 0)]);
}
