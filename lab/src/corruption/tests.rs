#![allow(clippy::expect_used)]

use super::*;
use plant_sim::script::faults::{Fault, RestartOverrides, Trigger};
use plant_sim::script::reach::excuses;

fn script(process: Process, actions: &[Action]) -> FaultScript {
    let fault = |action: &Action| Fault {
        at: Trigger::Scan(0),
        process,
        action: *action,
        line: 1,
    };
    FaultScript {
        name: "faults.toml".into(),
        restart: RestartOverrides::default(),
        faults: actions.iter().map(fault).collect(),
    }
}

fn corrupt(what: Corruption) -> Action {
    Action::Corrupt { scans: 2, what }
}

fn command(scan: u64) -> AxisCommand {
    AxisCommand {
        scan,
        visible_from: scan + 1,
        position: 100 * scan as i64,
        velocity_mm_s: 2.5,
        torque_nm: 0.5,
        axis: 1,
        incarnation: 3,
        ..AxisCommand::zeroed()
    }
}

/// What is sent in scans 8 to 15, each by the scan it is sent in, if every fault fires in scan 10.
fn commands(actions: &[Action]) -> Vec<(u64, AxisCommand)> {
    let script = script(Process::servo(1, 0), actions);
    let mut corruptor = Corruptor::new(&script, Process::servo(1, 0));
    let mut sent = Vec::new();
    for scan in 8..16 {
        let fired = |_| (scan >= 10).then_some(10);
        corruptor.command(&command(scan), fired, |c| sent.push((scan, *c)));
    }
    sent
}

fn as_made() -> Vec<(u64, AxisCommand)> {
    (8..16).map(|scan| (scan, command(scan))).collect()
}

#[test]
fn without_faults_of_its_own_a_sender_sends_what_it_made() {
    assert_eq!(commands(&[]), as_made());
    let kill = Action::Kill {
        restart_after_scans: 3,
    };
    assert_eq!(commands(&[kill, Action::Stop { scans: 9 }]), as_made());
    let of_another = script(Process::servo(1, 0), &[Action::Drop { scans: 100 }]);
    for process in [
        Process::servo(0, 0),
        Process::servo(1, 1),
        Job::Planner.into(),
        Process {
            axis: 1,
            ..Job::Planner.into()
        },
    ] {
        let mut corruptor = Corruptor::new(&of_another, process);
        let mut sent = 0;
        corruptor.command(&command(10), |_| Some(10), |_| sent += 1);
        assert_eq!(sent, 1, "{process:?}");
    }
    // A fault that has not fired does nothing.
    let mut corruptor = Corruptor::new(&of_another, Process::servo(1, 0));
    let mut sent = 0;
    corruptor.command(&command(10), |_| None, |_| sent += 1);
    assert_eq!(sent, 1);
}

#[test]
fn dropped_commands_are_not_sent_for_as_many_scans_as_asked() {
    let mut left = as_made();
    left.retain(|(scan, _)| !(10..13).contains(scan));
    assert_eq!(commands(&[Action::Drop { scans: 3 }]), left);
}

#[test]
fn late_commands_keep_their_scan_and_come_before_the_one_of_the_scan_they_are_sent_in() {
    let delay = Action::Delay {
        scans: 3,
        late_scans: 2,
    };
    let found: Vec<_> = commands(&[delay])
        .iter()
        .map(|(at, c)| (*at, c.scan, c.visible_from))
        .collect();
    let expected = [
        (8, 8, 9),
        (9, 9, 10),
        (12, 10, 13),
        (13, 11, 14),
        (13, 13, 14),
        (14, 12, 15),
        (14, 14, 15),
        (15, 15, 16),
    ];
    assert_eq!(found, expected);
}

#[test]
fn the_longest_delay_loses_nothing_and_a_sleeper_sends_all_that_is_due() {
    let delay = Action::Delay {
        scans: 1000,
        late_scans: LATE_SCANS_MAX,
    };
    let script = script(Process::servo(1, 0), &[delay]);
    let mut corruptor = Corruptor::new(&script, Process::servo(1, 0));
    let mut sent = Vec::new();
    for scan in 0..40 {
        corruptor.command(&command(scan), |_| Some(0), |c| sent.push((scan, c.scan)));
    }
    let late: Vec<_> = (0..32).map(|scan| (scan + 8, scan)).collect();
    assert_eq!(sent, late);
    sent.clear();
    corruptor.command(&command(100), |_| Some(0), |c| sent.push((100, c.scan)));
    let rest: Vec<_> = (32..40).map(|scan| (100, scan)).collect();
    assert_eq!(sent, rest);
}

#[test]
fn a_corruption_changes_what_it_names_and_nothing_else() {
    for (what, change) in [
        (
            Corruption::Infinity,
            (|c| {
                c.velocity_mm_s = f64::INFINITY;
                c.torque_nm = f64::INFINITY;
            }) as fn(&mut AxisCommand),
        ),
        (Corruption::Jump, |c| {
            c.position += 1_000_000_000;
            c.velocity_mm_s = 2500.0;
        }),
        (Corruption::OldScan, |c| c.scan -= 3),
        (Corruption::FutureScan, |c| c.scan += 3),
        (Corruption::NeverVisible, |c| c.visible_from = u64::MAX),
        (Corruption::WrongAxis, |c| c.axis = 2),
        (Corruption::WrongIncarnation, |c| c.incarnation = 4),
        (Corruption::Replay, |c| *c = command(c.scan - 1)),
    ] {
        let mut expected = as_made();
        for (scan, command) in &mut expected {
            if (10..12).contains(scan) {
                change(command);
            }
        }
        assert_eq!(commands(&[corrupt(what)]), expected, "{what:?}");
    }
    for (scan, command) in commands(&[corrupt(Corruption::NotANumber)]) {
        let met = (10..12).contains(&scan);
        assert_eq!(command.velocity_mm_s.is_nan(), met);
        assert_eq!(command.torque_nm.is_nan(), met);
        assert_eq!(command.scan, scan);
    }
}

#[test]
fn the_first_command_of_all_has_none_before_it_to_be_replayed() {
    let script = script(Process::servo(1, 0), &[corrupt(Corruption::Replay)]);
    let mut corruptor = Corruptor::new(&script, Process::servo(1, 0));
    let mut sent = Vec::new();
    for scan in [10, 11] {
        corruptor.command(&command(scan), |_| Some(10), |c| sent.push(c.scan));
    }
    assert_eq!(sent, [10]);
}

#[test]
fn lockstep_is_excused_from_waiting_where_no_answer_that_counts_can_come() {
    let late = Action::Delay {
        scans: 2,
        late_scans: 1,
    };
    for (action, excused) in [
        (Action::Drop { scans: 2 }, true),
        (late, true),
        (corrupt(Corruption::OldScan), true),
        (corrupt(Corruption::NeverVisible), true),
        (corrupt(Corruption::WrongIncarnation), true),
        (corrupt(Corruption::Replay), true),
        (corrupt(Corruption::WrongAxis), true),
        (corrupt(Corruption::NotANumber), false),
        (corrupt(Corruption::Infinity), false),
        (corrupt(Corruption::Jump), false),
        (corrupt(Corruption::FutureScan), false),
        (Action::Stop { scans: 2 }, false),
    ] {
        let script = script(Process::servo(1, 0), &[action]);
        let of =
            |axis, role, scan| excuses(&script, |_| Some(10), Process::servo(axis, role), scan);
        for scan in 8..14 {
            let met = excused && (10..12).contains(&scan);
            assert_eq!(of(1, 0, scan), met, "{action:?} {scan}");
        }
        assert!(!of(1, 1, 10), "the other role");
        assert!(!of(0, 0, 10), "another axis");
        assert!(!excuses(&script, |_| None, Process::servo(1, 0), 10));
        // Where lockstep is not excused, what is sent is taken for an answer to this scan.
        if !matches!(action, Action::Stop { .. }) {
            let sent = commands(&[action]);
            let answer = |(at, c): &&(u64, AxisCommand)| {
                let counts = c.incarnation == 3 && c.axis == 1 && c.visible_from == 11;
                *at == 10 && c.scan >= 10 && counts
            };
            assert_eq!(sent.iter().find(answer).is_none(), excused, "{action:?}");
        }
    }
    let script = script(Job::Planner.into(), &[Action::Drop { scans: 2 }]);
    assert!(!excuses(&script, |_| Some(10), Job::Planner.into(), 10));
}

fn window(scan: u64) -> (WindowHeader, Vec<Setpoint>) {
    let setpoint = |n: i64| {
        let mut setpoint = Setpoint::zeroed();
        setpoint.position = [n; bus::sample::PATH_AXES];
        setpoint
    };
    let setpoints: Vec<Setpoint> = (0..10).map(|n| setpoint(n + scan as i64)).collect();
    let mut header = WindowHeader {
        first_scan: scan + 8,
        visible_from: scan + 1,
        intended_setpoints: 6,
        setpoint_count: 10,
        ..WindowHeader::zeroed()
    };
    header.id.sequence = scan as u32 / 8;
    header.id.incarnation = 3;
    header.id.checksum = checksum(&header, &setpoints);
    (header, setpoints)
}

type Sent = (u64, WindowHeader, Vec<Setpoint>);

/// What is sent at the period boundaries 8, 16, 24, 32 and 40 if every fault fires in scan 16; none is planned in 32.
fn windows(actions: &[Action]) -> Vec<Sent> {
    let script = script(Job::Planner.into(), actions);
    let mut corruptor = Corruptor::new(&script, Job::Planner.into());
    let mut sent = Vec::new();
    for scan in [8, 16, 24, 32, 40] {
        let (header, setpoints) = window(scan);
        let planned = (scan != 32).then_some((&header, setpoints.as_slice()));
        let fired = |_| (scan >= 16).then_some(16);
        corruptor.window(scan, planned, fired, |header, setpoints| {
            sent.push((scan, *header, setpoints.to_vec()));
        });
    }
    sent
}

fn as_planned() -> Vec<Sent> {
    [8, 16, 24, 40]
        .map(|scan| {
            let (header, setpoints) = window(scan);
            (scan, header, setpoints)
        })
        .into()
}

fn is_sealed((_, header, setpoints): &Sent) -> bool {
    header.id.checksum == checksum(header, setpoints)
}

#[test]
fn windows_are_dropped_or_sent_late_under_their_right_name() {
    assert_eq!(windows(&[]), as_planned());
    let mut left = as_planned();
    left.retain(|(scan, ..)| ![16, 24].contains(scan));
    assert_eq!(windows(&[Action::Drop { scans: 9 }]), left);

    let delay = Action::Delay {
        scans: 9,
        late_scans: 3,
    };
    let sent = windows(&[delay]);
    let found: Vec<_> = sent
        .iter()
        .map(|(at, h, _)| (*at, h.first_scan, h.visible_from, h.id.sequence))
        .collect();
    // The one of 24 is due in 27 and sent when the planner next wakes, though it has nothing new then.
    let expected = [
        (8, 16, 9, 1),
        (24, 24, 25, 2),
        (32, 32, 33, 3),
        (40, 48, 41, 5),
    ];
    assert_eq!(found, expected);
    assert!(sent.iter().all(is_sealed));
}

#[test]
fn a_wrong_window_is_found_out_by_what_is_wrong_with_it_and_not_by_its_checksum() {
    for (what, sealed, change) in [
        (
            Corruption::Infinity,
            true,
            (|h, setpoints| {
                let _ = h;
                if let Some(setpoint) = setpoints.first_mut() {
                    setpoint.tag.distance_mm = f64::INFINITY;
                }
            }) as fn(&mut WindowHeader, &mut Vec<Setpoint>),
        ),
        (Corruption::OldScan, true, |h, _| h.first_scan -= 3),
        (Corruption::FutureScan, true, |h, _| h.first_scan += 3),
        (Corruption::NeverVisible, true, |h, _| {
            h.visible_from = u64::MAX
        }),
        (Corruption::WrongIncarnation, true, |h, _| {
            h.id.incarnation = 4
        }),
        (Corruption::SetpointJump, true, |_, setpoints| {
            if let Some(setpoint) = setpoints.get_mut(3) {
                setpoint.position[0] += 1_000_000;
            }
        }),
        (Corruption::Checksum, false, |h, _| h.id.checksum ^= 1),
        (Corruption::Cut, false, |_, setpoints| setpoints.truncate(5)),
    ] {
        let mut expected = as_planned();
        let met = expected.iter_mut().filter(|(scan, ..)| *scan == 16);
        for (_, header, setpoints) in met {
            change(header, setpoints);
            if sealed {
                header.id.checksum = checksum(header, setpoints);
            }
        }
        let found = windows(&[corrupt(what)]);
        assert_eq!(found, expected, "{what:?}");
        assert_eq!(found.iter().all(is_sealed), sealed, "{what:?}");
    }
    let sent = windows(&[corrupt(Corruption::NotANumber)]);
    let nan = |(scan, _, setpoints): &Sent| {
        let first = setpoints.first().expect("a setpoint");
        (*scan, first.tag.distance_mm.is_nan())
    };
    let found: Vec<_> = sent.iter().map(nan).collect();
    assert_eq!(found, [(8, false), (16, true), (24, false), (40, false)]);
    assert!(sent.iter().all(is_sealed));
}

#[test]
fn a_replayed_window_is_the_one_before_as_it_was() {
    let sent = windows(&[corrupt(Corruption::Replay)]);
    let (header, setpoints) = window(8);
    let mut expected = as_planned();
    if let Some(second) = expected.get_mut(1) {
        *second = (16, header, setpoints);
    }
    assert_eq!(sent, expected);
}

#[test]
fn the_longest_window_is_kept_whole_and_a_longer_one_breaks_nothing() {
    let delay = Action::Delay {
        scans: 1,
        late_scans: 1,
    };
    let script = script(Job::Planner.into(), &[delay]);
    let mut corruptor = Corruptor::new(&script, Job::Planner.into());
    for setpoints in [MAX_WINDOW_SETPOINTS, MAX_WINDOW_SETPOINTS + 1] {
        let setpoints = vec![Setpoint::zeroed(); setpoints];
        let header = WindowHeader::zeroed();
        let mut sent = 0;
        for scan in [0, 8] {
            let planned = (scan == 0).then_some((&header, setpoints.as_slice()));
            corruptor.window(
                scan,
                planned,
                |_| Some(0),
                |_, setpoints| sent = setpoints.len(),
            );
        }
        assert_eq!(sent, MAX_WINDOW_SETPOINTS);
    }
}
