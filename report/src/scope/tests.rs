use bus::sample::{
    AxisCommand, BusCycle, Cause, Feedback, Instruments, Job, Mode, PathTag, Roster, WindowId,
};
use bytemuck::Zeroable;
use machine::Machine;
use path::geometry::{AxisVector, Element, Feed, Path};

use super::signal::{KnownPath, Signal};
use super::trigger::{Side, Trigger};
use super::*;
use crate::test_support::machine;
use monitor::log::Sample;

/// What the synthetic machine does in a scan: edited by each test.
struct Scan {
    feedback: Feedback,
    commands: [AxisCommand; 2],
    instruments: Instruments,
}

/// X goes to and fro: up by 1 µm a scan to scan 1000, down to 2000, and so on; Y stands.
fn to_and_fro(scan: u64) -> i64 {
    let phase = (scan % 2000) as i64;
    1000 * (1000 - (phase - 1000).abs())
}

fn of(scan: u64) -> Scan {
    let mut feedback = Feedback::zeroed();
    feedback.scan = scan;
    feedback.visible_from = scan;
    feedback.axis_count = 2;
    feedback.mode = Mode::Enabled as u32;
    feedback.override_percent = 100;
    feedback.cause_axis = u32::MAX;
    feedback.axes[0].torque_nm = scan as f64 * 0.01;
    feedback.axes[0].motor_position = to_and_fro(scan) - 2500;
    let mut commands = [AxisCommand::zeroed(); 2];
    for (axis, command) in commands.iter_mut().enumerate() {
        command.scan = scan;
        command.visible_from = scan + 1;
        command.axis = axis as u32;
    }
    commands[0].position = to_and_fro(scan);
    commands[0].following_error_mm = 0.0025;
    let mut instruments = Instruments::zeroed();
    instruments.scan = scan;
    instruments.visible_from = scan + 1;
    instruments.subsamples = 4;
    instruments.axis_count = 2;
    instruments.axes[0].table_mm[3] = 1.5;
    instruments.axes[0].motor_mm[3] = 1.504;
    Scan {
        feedback,
        commands,
        instruments,
    }
}

impl Scan {
    fn samples(self) -> Vec<Sample> {
        let [x, y] = self.commands;
        vec![
            Sample::Feedback(Box::new(self.feedback)),
            Sample::Command(Box::new(x)),
            Sample::Command(Box::new(y)),
            Sample::Instruments(Box::new(self.instruments)),
        ]
    }
}

fn two_axes() -> Machine {
    machine(&["X", "Y"])
}

fn settings(signals: &[&str], trigger: &str) -> Settings {
    let machine = two_axes();
    Settings {
        signals: signals
            .iter()
            .map(|name| Signal::parse(name, &machine).expect("a signal"))
            .collect(),
        trigger: Trigger::parse(trigger, &machine).expect("a trigger"),
        before: 50,
        after: 200,
        from: 0,
        fill_first: false,
    }
}

fn scope(signals: &[&str], trigger: &str) -> Scope {
    Scope::new(&two_axes(), settings(signals, trigger))
}

/// All captures of these scans, each edited.
fn captures_of(
    mut scope: Scope,
    scans: impl Iterator<Item = u64>,
    edit: impl Fn(u64, &mut Scan),
) -> Vec<Capture> {
    for scan in scans {
        let mut made = of(scan);
        edit(scan, &mut made);
        made.samples().into_iter().for_each(|s| scope.take(s));
    }
    scope.finish();
    std::iter::from_fn(|| scope.next_capture()).collect()
}

fn triggers_of(captures: &[Capture]) -> Vec<u64> {
    captures.iter().map(|c| c.trigger_scan).collect()
}

#[test]
fn the_words_of_a_trigger_are_read_with_units_and_in_any_spacing() {
    let machine = two_axes();
    let parse = |text: &str| Trigger::parse(text, &machine).expect(text);
    assert_eq!(parse("now"), Trigger::Now);
    assert_eq!(parse(" trip "), Trigger::Trip);
    assert_eq!(parse("order"), Trigger::Order);
    assert_eq!(parse("mode"), Trigger::Mode(None));
    assert_eq!(parse("mode stopped"), Trigger::Mode(Some(Mode::Stopped)));
    assert_eq!(parse("block 12"), Trigger::Block(12));
    assert_eq!(parse("scan 2210"), Trigger::Scan(2210));
    assert_eq!(parse("death"), Trigger::Death(None));
    assert!(matches!(parse("death servo-Y"), Trigger::Death(Some(_))));
    let reversal = |axis, direction| Trigger::Reversal { axis, direction };
    assert_eq!(parse("reversal y"), reversal(1, None));
    assert_eq!(parse("reversal X  -"), reversal(0, Some(-1)));
    for (text, name, absolute, side, threshold) in [
        (
            "X.following_error > 5um",
            "X.following_error",
            false,
            Side::Above,
            5.0,
        ),
        (
            "X.following_error>0.005 mm",
            "X.following_error",
            false,
            Side::Above,
            5.0,
        ),
        ("Y.torque < -3.5", "Y.torque", false, Side::Below, -3.5),
        ("abs Y.torque > 3Nm", "Y.torque", true, Side::Above, 3.0),
        (
            "|X.velocity| rising 600 mm/min",
            "X.velocity",
            true,
            Side::Rising,
            10.0,
        ),
        (
            "X.velocity falling 0",
            "X.velocity",
            false,
            Side::Falling,
            0.0,
        ),
        ("override < 100%", "override", false, Side::Below, 100.0),
    ] {
        let Trigger::Level {
            signal,
            absolute: magnitude,
            side: found,
            threshold: value,
        } = parse(text)
        else {
            panic!("{text} is no level");
        };
        assert_eq!(
            (signal.name.as_str(), magnitude, found),
            (name, absolute, side)
        );
        assert!((value - threshold).abs() < 1e-9, "{text}: {value}");
    }
}

#[test]
fn what_does_not_exist_is_refused_with_what_does() {
    let machine = two_axes();
    for (text, right) in [
        ("", "must be one of now, reversal AXIS"),
        ("sometimes", "must be one of now, reversal AXIS"),
        ("trip now", "must be one of now, reversal AXIS"),
        ("reversal Q", "the machine has X, Y"),
        ("reversal X up", "may stand + or -"),
        ("block twelve", "must be a whole number from 0 up"),
        ("block 99999999999", "no program has so many lines"),
        ("scan -1", "must be a whole number from 0 up"),
        ("mode flying", "disabled, enabled, stopping"),
        (
            "death servo-Q",
            "planner, servo-X, servo-Y, plant-sim, monitor",
        ),
        ("Q.torque > 1", "has axes X, Y"),
        (
            "X.speed > 1",
            "an axis has command, feedback, following_error",
        ),
        ("torque > 1", "the cell has contour_error"),
        ("X.torque > heavy", "must be a number in Nm"),
        ("X.torque > 3mm", "must be a number in Nm"),
        ("X.torque > inf", "must be a number in Nm"),
        ("mode > 3Nm", "must be a plain number"),
        ("X.torque", "must be one of now, reversal AXIS"),
    ] {
        let error = Trigger::parse(text, &machine).expect_err(text).to_string();
        assert!(error.contains(right), "{text:?}: {error}");
    }
}

#[test]
fn a_capture_of_a_reversal_has_its_zero_in_the_first_scan_of_the_new_direction() {
    let scope = scope(
        &["X.command", "X.feedback", "X.following_error"],
        "reversal X",
    );
    let captures = captures_of(scope, 0..3000, |_, _| {});
    assert_eq!(triggers_of(&captures), [1001, 2001]);
    let first = &captures[0];
    assert_eq!(first.what, "reversal of X to −");
    assert_eq!(first.missing(), (0, 0, 0));
    assert_eq!(first.rows.len(), 250);
    assert_eq!((first.rows[0].scan, first.rows[249].scan), (951, 1200));
    let about = |value: f64, expected: f64| (value - expected).abs() < 1e-9;
    for (value, expected) in first.rows[50].values.iter().zip([0.999, 0.9965, 2.5]) {
        assert!(about(*value, expected), "{value}, not {expected}");
    }
    assert_eq!(first.time_ms(951), -50.0);
    assert!(first.at_trigger(0).is_some_and(|value| about(value, 0.999)));
}

#[test]
fn only_the_direction_that_was_asked_for_counts() {
    let captures = captures_of(scope(&["X.command"], "reversal X +"), 0..3000, |_, _| {});
    assert_eq!(triggers_of(&captures), [2001]);
}

#[test]
fn captures_do_not_overlap() {
    // Two reversals 100 scans apart: the second lies in the capture of the first.
    let position = |scan: u64| match scan {
        0..500 => scan as i64 * 1000,
        500..600 => (1000 - scan as i64) * 1000,
        _ => (scan as i64 - 200) * 1000,
    };
    let captures = captures_of(
        scope(&["X.command"], "reversal X"),
        0..2000,
        |scan, made| {
            made.commands[0].position = position(scan);
        },
    );
    assert_eq!(triggers_of(&captures), [501]);
}

#[test]
fn who_comes_into_the_middle_waits_until_the_time_before_has_been_seen() {
    let mut live = settings(&["X.command"], "reversal X");
    live.fill_first = true;
    let captures = captures_of(Scope::new(&two_axes(), live), 980..3000, |_, _| {});
    assert_eq!(triggers_of(&captures), [2001]);
    // What does not come again is not let pass.
    let mut live = settings(&["X.command"], "mode tripped");
    live.fill_first = true;
    let captures = captures_of(Scope::new(&two_axes(), live), 980..1500, |scan, made| {
        if scan >= 1000 {
            made.feedback.mode = Mode::Tripped as u32;
        }
    });
    assert_eq!(triggers_of(&captures), [1000]);
    assert_eq!(captures[0].missing(), (30, 0, 0));
}

#[test]
fn earlier_triggers_than_asked_for_do_not_count() {
    let mut later = settings(&["X.command"], "reversal X");
    later.from = 1002;
    let captures = captures_of(Scope::new(&two_axes(), later), 0..3000, |_, _| {});
    assert_eq!(triggers_of(&captures), [2001]);
}

#[test]
fn a_gap_is_reported_and_nothing_is_found_across_it() {
    let gap = |scan: &u64| !(990..1010).contains(scan);
    let captures = captures_of(
        scope(&["X.command"], "reversal X"),
        (0..3000).filter(gap),
        |_, _| {},
    );
    assert_eq!(triggers_of(&captures), [2001]);
    let captures = captures_of(
        scope(&["X.command"], "scan 1000"),
        (0..3000).filter(gap),
        |_, _| {},
    );
    assert_eq!(triggers_of(&captures), [1000]);
    assert_eq!(captures[0].missing(), (0, 20, 0));
    assert!(captures[0].title().contains("20 not seen in between"));
    assert_eq!(captures[0].at_trigger(0), None);
}

#[test]
fn the_order_in_which_channels_come_changes_nothing() {
    let signals = ["X.following_error", "X.table", "Y.command", "mode"];
    let straight = captures_of(scope(&signals, "reversal X"), 0..1500, |_, _| {});
    let mut mixed = scope(&signals, "reversal X");
    // Commands and instruments come behind the feedback by one, three and seven scans.
    let mut late: Vec<(u64, Sample)> = Vec::new();
    for scan in 0..1500 {
        for (index, sample) in of(scan).samples().into_iter().enumerate() {
            match index {
                0 => mixed.take(sample),
                1 => late.push((scan + 1, sample)),
                2 => late.push((scan + 3, sample)),
                _ => late.push((scan + 7, sample)),
            }
        }
        let (due, rest) = late.into_iter().partition(|(at, _)| *at <= scan);
        late = rest;
        due.into_iter().for_each(|(_, sample)| mixed.take(sample));
    }
    mixed.finish();
    let mixed: Vec<Capture> = std::iter::from_fn(|| mixed.next_capture()).collect();
    assert_eq!(triggers_of(&mixed), [1001]);
    assert!(mixed == straight, "the captures differ");
}

#[test]
fn a_servo_that_says_nothing_more_holds_nothing_up_and_leaves_gaps_of_its_own() {
    let mut scope = scope(&["Y.following_error", "X.torque"], "scan 1000");
    let mut whole_at = None;
    for scan in 0..1500 {
        let samples = of(scan).samples().into_iter();
        let silent = |s: &Sample| matches!(s, Sample::Command(c) if c.axis == 1 && scan >= 900);
        samples
            .filter(|sample| !silent(sample))
            .for_each(|sample| scope.take(sample));
        if whole_at.is_none()
            && let Some(capture) = scope.next_capture()
        {
            assert!(capture.rows.iter().all(|row| row.values[0].is_nan()));
            assert!(csv::rows(&capture).starts_with("1,950,-50,,9.5\n"));
            whole_at = Some(scan);
        }
    }
    let last = whole_at.expect("a capture");
    assert!((1199..1199 + 70).contains(&last), "{last}");
}

#[test]
fn trips_modes_and_orders_are_dated_at_the_feedback_that_says_them() {
    let edit = |scan: u64, made: &mut Scan| {
        if scan >= 300 {
            made.feedback.hold = 1;
        }
        if scan >= 700 {
            made.feedback.mode = Mode::Tripped as u32;
            made.feedback.cause = Cause::Watchdog as u32;
            made.feedback.cause_axis = 1;
        }
    };
    for (trigger, scans, what) in [
        ("order", vec![300, 700], "feed hold"),
        (
            "trip",
            vec![700],
            "trip: Y: commands missing for too many scans",
        ),
        ("mode", vec![700], "mode tripped"),
        ("mode tripped", vec![700], "mode tripped"),
        ("mode stopped", vec![], ""),
    ] {
        let captures = captures_of(scope(&["mode"], trigger), 0..1000, edit);
        assert_eq!(triggers_of(&captures), scans, "{trigger}");
        assert_eq!(captures.first().map_or("", |c| c.what.as_str()), what);
    }
}

#[test]
fn a_machine_that_was_tripped_before_trips_no_more() {
    let tripped = |_: u64, made: &mut Scan| made.feedback.mode = Mode::Tripped as u32;
    let mut scope = scope(&["mode"], "trip");
    for scan in 0..100 {
        let mut made = of(scan);
        tripped(scan, &mut made);
        made.samples().into_iter().for_each(|s| scope.take(s));
    }
    scope.finish();
    assert_eq!(scope.next_capture(), None);
    let seen = scope.seen_instead();
    assert!(
        seen.contains("scans 0 to 99 were seen, the last with mode tripped"),
        "{seen}"
    );
}

fn roster(version: u64, visible_from: u64, death_scan: u64) -> Sample {
    let mut roster = Roster::zeroed();
    roster.version = version;
    roster.visible_from = visible_from;
    let places = [(Job::Planner, 0), (Job::Servo, 0), (Job::Servo, 1)];
    for (participant, (job, axis)) in roster.participants.iter_mut().zip(places) {
        participant.job = job as u32;
        participant.axis = axis;
        participant.incarnation = 1;
        participant.live = 1;
        participant.death_scan = u64::MAX;
    }
    if death_scan != u64::MAX {
        roster.participants[2].death_scan = death_scan;
        roster.participants[2].death_signal = 9;
        roster.participants[2].live = 0;
    }
    Sample::Roster(Box::new(roster))
}

#[test]
fn a_death_is_dated_at_its_own_scan_however_late_the_roster_tells_it() {
    for (trigger, told_after, expected) in [
        ("death", 0, vec![800]),
        ("death servo-Y", 40, vec![800]),
        ("death servo-Y", 400, vec![800]),
        ("death servo-X", 0, vec![]),
    ] {
        let mut scope = scope(&["X.torque"], trigger);
        scope.take(roster(1, 0, u64::MAX));
        for scan in 0..1500 {
            if scan == 800 + told_after {
                scope.take(roster(2, scan, 800));
            }
            of(scan).samples().into_iter().for_each(|s| scope.take(s));
        }
        scope.finish();
        let captures: Vec<Capture> = std::iter::from_fn(|| scope.next_capture()).collect();
        assert_eq!(triggers_of(&captures), expected, "{trigger} {told_after}");
        if let Some(capture) = captures.first() {
            assert_eq!(capture.what, "servo-Y killed by signal 9");
            assert_eq!(capture.missing(), (0, 0, 0));
        } else {
            let seen = scope.seen_instead();
            assert!(
                seen.contains("servo-Y killed by signal 9 in scan 800"),
                "{seen}"
            );
        }
    }
}

#[test]
fn a_death_before_the_scope_came_is_no_news() {
    let mut scope = scope(&["X.torque"], "death");
    scope.take(roster(7, 0, 800));
    for scan in 900..1500 {
        of(scan).samples().into_iter().for_each(|s| scope.take(s));
    }
    scope.finish();
    assert_eq!(scope.next_capture(), None);
}

#[test]
fn levels_fire_when_they_come_to_hold_and_edges_only_when_they_are_crossed() {
    // The torque rises by 0.01 N·m a scan, from 0.
    for (trigger, expected) in [
        ("X.torque > 5", vec![501]),
        ("X.torque rising 5", vec![500]),
        ("X.torque < 5", vec![0]),
        ("X.torque falling 5", vec![]),
        ("abs X.torque > 5", vec![501]),
        ("X.torque > -1", vec![0]),
        ("X.torque rising -1", vec![]),
    ] {
        let captures = captures_of(scope(&["X.torque"], trigger), 0..1000, |_, _| {});
        assert_eq!(triggers_of(&captures), expected, "{trigger}");
    }
    let mut never = scope(&["X.torque"], "X.torque > 50");
    for scan in 0..100 {
        of(scan).samples().into_iter().for_each(|s| never.take(s));
    }
    never.finish();
    let seen = never.seen_instead();
    assert!(seen.contains("X.torque from 0.000 to 0.990 N·m"), "{seen}");
}

#[test]
fn what_the_end_cuts_off_is_reported() {
    let captures = captures_of(scope(&["X.command"], "reversal X"), 0..1100, |_, _| {});
    assert_eq!(triggers_of(&captures), [1001]);
    assert_eq!(captures[0].missing(), (0, 0, 101));
    assert!(captures[0].title().contains("101 after the last"));
}

/// A straight line of 10 mm in line 3 and one of 5 mm in line 7.
fn two_lines() -> KnownPath {
    let at = |x: f64| {
        let mut point = AxisVector::zeros();
        point[0] = x;
        point
    };
    let path = Path {
        elements: vec![
            Element::line(3, at(0.0), at(10.0), Feed::Rapid),
            Element::line(7, at(10.0), at(15.0), Feed::Rapid),
        ],
    };
    KnownPath::new(77, path)
}

#[test]
fn a_line_is_reached_once_and_the_way_along_the_path_goes_on_from_element_to_element() {
    let travel = |scan: u64, made: &mut Scan| {
        made.feedback.program_hash = 77;
        let along = scan as f64 * 0.015;
        let second = along > 10.0;
        if scan >= 10 {
            made.feedback.window = WindowId {
                checksum: 1,
                sequence: 1,
                incarnation: 1,
            };
        }
        made.feedback.tag = PathTag {
            element: u32::from(second),
            distance_mm: if second { along - 10.0 } else { along },
            dwell_remaining_scans: 0,
        };
        made.instruments.axes[0].table_mm[3] = along.min(15.0);
        made.instruments.axes[1].table_mm[3] = 0.002;
    };
    for (trigger, expected) in [
        ("block 7", vec![667]),
        ("block 5", vec![667]),
        ("block 3", vec![10]),
        ("block 8", vec![]),
    ] {
        let mut scope = scope(&["path_distance", "line", "contour_error"], trigger);
        scope.set_path(two_lines());
        let captures = captures_of(scope, 0..1000, travel);
        assert_eq!(triggers_of(&captures), expected, "{trigger}");
        if trigger == "block 7" {
            let [distance_mm, line, error_um] = captures[0].rows[50].values[..] else {
                panic!("three values");
            };
            assert!((distance_mm - 10.005).abs() < 1e-9, "{distance_mm}");
            assert_eq!(line, 7.0);
            assert!((error_um - 2.0).abs() < 1e-6, "{error_um}");
        }
    }
    // Tags of another program have no place on this path.
    let mut other = scope(&["line"], "block 7");
    other.set_path(two_lines());
    let captures = captures_of(other, 0..1000, |scan, made| {
        travel(scan, made);
        made.feedback.program_hash = 78;
    });
    assert_eq!(captures, []);
}

#[test]
fn the_ring_stays_as_long_as_it_was_asked_to_be() {
    let mut scope = scope(&["X.torque"], "trip");
    for scan in 0..20_000 {
        of(scan).samples().into_iter().for_each(|s| scope.take(s));
    }
    assert_eq!(scope.ring.len(), 250 + LATE_SCANS as usize);
    let mut large = settings(&["X.torque"], "trip");
    large.before = 100_000_000;
    let error = large.check().expect_err("too much").to_string();
    assert!(error.contains("at most"), "{error}");
    large.before = 0;
    large.after = 0;
    assert!(large.check().is_err());
    large.after = 1;
    assert!(large.check().is_ok());
    large.signals.clear();
    assert!(large.check().is_err());
}

/// The same machine with its drives on a fieldbus.
fn on_a_bus() -> Machine {
    Machine {
        bus: Some(machine::Fieldbus {
            interface: "eth1".into(),
            sync: machine::Sync::Dc,
            watchdog_ms: 10,
            standby: false,
            other_slaves: Vec::new(),
            terminals: Vec::new(),
            spindle: None,
        }),
        ..two_axes()
    }
}

#[test]
fn what_the_bus_did_is_shown_in_its_scan_and_a_scan_without_an_answer_has_no_time() {
    let machine = on_a_bus();
    let names = [
        "bus.round_trip",
        "bus.clock_offset",
        "bus.missed",
        "Y.inputs",
    ];
    let mut settings = settings(&["mode"], "now");
    let signals = names.iter().map(|name| Signal::parse(name, &machine));
    settings.signals = signals.collect::<Result<_, _>>().expect("signals");
    settings.trigger = Trigger::parse("bus.missed rising 0.5", &machine).expect("a trigger");
    let mut scope = Scope::new(&machine, settings);
    for scan in 0..400 {
        let answered = scan != 100;
        let cycle = BusCycle {
            scan,
            visible_from: scan + 1,
            answered: answered.into(),
            missed: u64::from(scan >= 100),
            round_trip_ns: 80_000 + scan,
            clock_offset_ns: -500,
            distributed_clocks: 1,
            inputs: std::array::from_fn(|axis| 4 * u64::from(axis == 1)),
            axis_count: 2,
            ..BusCycle::default()
        };
        // In the order of the recorder: what was made in a scan comes before the feedback of the next.
        let mut samples = of(scan).samples();
        samples.insert(1, Sample::BusCycle(Box::new(cycle)));
        samples.into_iter().for_each(|sample| scope.take(sample));
    }
    scope.finish();
    let capture = scope.next_capture().expect("a capture");
    assert_eq!(capture.trigger_scan, 100);
    let row = |scan: u64| {
        let row = capture.rows.iter().find(|row| row.scan == scan);
        row.expect("a row").values.clone()
    };
    assert_eq!(row(99), [80.099, -0.5, 0.0, 4.0]);
    assert!(row(100)[0].is_nan() && row(100)[1].is_nan());
    assert_eq!(row(100)[2..], [1.0, 4.0]);
    let head = csv::header(&capture);
    assert!(head.contains("bus.round_trip_us,bus.clock_offset_us,bus.missed,Y.inputs"));
}

#[test]
fn a_machine_has_signals_of_a_bus_where_it_has_a_bus() {
    let refusal = |name: &str, machine: &Machine| {
        let refused = Signal::parse(name, machine).expect_err(name);
        refused.to_string()
    };
    let simulated = refusal("bus.missed", &two_axes());
    assert!(simulated.contains("has no bus"), "{simulated}");
    let unknown = refusal("bus.speed", &on_a_bus());
    assert!(unknown.contains("the bus has round_trip"), "{unknown}");
    assert!(Signal::parse("X.inputs", &two_axes()).is_err());
    let more = Signal::all(&on_a_bus()).len() - Signal::all(&two_axes()).len();
    assert_eq!(more, 2 + 9);
}

#[test]
fn units_of_rotary_axes_are_degrees() {
    let mut machine = two_axes();
    machine.axes[1].kind = machine::AxisKind::Rotary;
    let unit = |name: &str| {
        let signal = Signal::parse(name, &machine).expect("a signal");
        (signal.unit.shown, signal.column())
    };
    assert_eq!(
        unit("Y.following_error"),
        ("mdeg", "Y.following_error_mdeg".into())
    );
    assert_eq!(unit("Y.velocity"), ("deg/s", "Y.velocity_deg_s".into()));
    assert_eq!(unit("x.TABLE"), ("mm", "X.table_mm".into()));
    let error = Signal::parse("Y.table", &machine)
        .and_then(|signal| signal.value("3mm"))
        .expect_err("not of a rotary axis");
    assert!(error.to_string().contains("deg, mdeg"), "{error}");
}

#[test]
fn a_table_has_a_row_per_scan_and_units_in_its_head() {
    let captures = captures_of(
        scope(&["X.following_error", "X.wind_up", "mode"], "scan 500"),
        0..1000,
        |_, _| {},
    );
    let text = csv::header(&captures[0]) + &csv::rows(&captures[0]);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 251);
    assert_eq!(
        lines[0],
        "capture,scan,time_ms,X.following_error_um,X.wind_up_um,mode"
    );
    let zero: Vec<&str> = lines[51].split(',').collect();
    assert_eq!(zero[..4], ["1", "500", "0", "2.5"]);
    let wind_up_um: f64 = zero[4].parse().expect("a number");
    assert!((wind_up_um - 4.0).abs() < 1e-9, "{wind_up_um}");
}
