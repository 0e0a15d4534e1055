use super::*;
use crate::state::{AxisState, Death, ProcessState};
use proptest::prelude::*;

fn snapshot() -> Snapshot {
    let axis = AxisState {
        axis: "X".into(),
        unit: "mm".into(),
        command_mm: 1.25,
        following_error_um: Some(-0.5),
        ..AxisState::default()
    };
    let process = ProcessState {
        process: "servo-x-a".into(),
        job: "servo".into(),
        pid: Some(4711),
        starts: 2,
        live: true,
        stalled: false,
        drives: Some(true),
        standby: None,
        age_scans: Some(1),
        last_death: Some(Death {
            scan: 90,
            signal: 9,
        }),
    };
    let reversal = ReversalState {
        axis: 1,
        direction: -1,
        scan: 77,
        height_um: Some(1.5),
        undercut_um: None,
        error_peak_um: 2.5,
    };
    Snapshot {
        format: FORMAT,
        session: u64::MAX,
        sequence: 1,
        heard_us: 1_750_000_000_000_000,
        state: CellState {
            cell: "mill-3".into(),
            scan: Some(100),
            axes: vec![axis.clone(), axis],
            processes: vec![process],
            ..CellState::default()
        },
        reversals_count: 1,
        reversals: vec![reversal],
        scans_seen: 100,
        ..Snapshot::default()
    }
}

fn circle() -> CircleReport {
    CircleReport {
        format: FORMAT,
        session: 7,
        circle: CircleState {
            plane: "XY".into(),
            radius_mm: 25.0,
            deviation_um: vec![Some([-1.0, 0.5, 2.0]); 360],
            ..CircleState::default()
        },
    }
}

#[test]
fn a_snapshot_comes_back_as_it_was_sent() {
    let sent = snapshot();
    let bytes = encode(&sent).expect("plausible");
    assert_eq!(decode::<Snapshot>(&bytes).expect("believed"), sent);
    let bytes = encode(&circle()).expect("plausible");
    assert_eq!(decode::<CircleReport>(&bytes).expect("believed"), circle());
}

#[test]
fn what_is_not_a_number_travels_as_such() {
    let mut sent = snapshot();
    let axes = &mut sent.state.axes;
    axes[0].torque_nm = f64::NAN;
    axes[0].velocity_mm_s = f64::INFINITY;
    axes[1].feedback_mm = -1e300;
    let got: Snapshot = decode(&encode(&sent).expect("message")).expect("believed");
    let axes = &got.state.axes;
    assert!(axes[0].torque_nm.is_nan() && axes[0].velocity_mm_s.is_nan());
    assert!(axes[1].feedback_mm.is_nan());
    assert_eq!(axes[1].command_mm, 1.25);
}

/// Why a snapshot that was changed is not believed.
fn refused(change: impl FnOnce(&mut Snapshot)) -> String {
    let mut bad = snapshot();
    change(&mut bad);
    let text = serde_json::to_string(&bad).expect("JSON");
    let refusal = decode::<Snapshot>(text.as_bytes()).expect_err("it must not be believed");
    refusal.to_string()
}

#[test]
fn what_no_server_of_ours_would_send_is_refused_by_its_name() {
    let axis = || AxisState::default();
    let cases: [(&str, String); 14] = [
        ("format 7", refused(|s| s.format = 7)),
        ("pace", refused(|s| s.state.pace = Some("slow".into()))),
        (
            "axes",
            refused(|s| s.state.axes = vec![axis(); AXES_MAX + 1]),
        ),
        (
            "feedback_mm: 1e+300",
            refused(|s| s.state.axes[1].feedback_mm = 1e300),
        ),
        (
            "torque_command_nm: -1e+16",
            refused(|s| s.state.axes[0].torque_command_nm = Some(-1e16)),
        ),
        (
            "override_percent",
            refused(|s| s.state.override_percent = Some(201)),
        ),
        (
            "numbers of an axis: 17",
            refused(|s| {
                let more = (0..17).map(|number| (format!("more_{number}"), Some(1.0)));
                s.state.axes[0].quantities = more.collect();
            }),
        ),
        (
            "numbers of an axis: a key that is no name",
            refused(|s| {
                let key = "\u{1b}[2J".to_string();
                s.state.axes[0].quantities.insert(key, Some(1.0));
            }),
        ),
        ("reversal's axis", refused(|s| s.reversals[0].axis = 2)),
        ("direction", refused(|s| s.reversals[0].direction = 0)),
        ("reversals_count", refused(|s| s.reversals_count = 0)),
        (
            "process: a control character",
            refused(|s| s.state.processes[0].process = "\u{1b}[2Jservo".into()),
        ),
        (
            "name: 401 bytes",
            refused(|s| s.state.program.name = Some("x".repeat(TEXT_BYTES_MAX + 1))),
        ),
        (
            "active_codes: 401 items",
            refused(|s| s.state.readout.active_codes = vec!["G1".into(); 401]),
        ),
    ];
    for (expected, message) in cases {
        assert!(message.contains(expected), "{expected}: {message}");
    }
}

#[test]
fn unknown_and_missing_fields_too_much_and_too_little_are_refused() {
    let bytes = encode(&snapshot()).expect("plausible");
    let text = String::from_utf8(bytes).expect("text");
    let more = text.replacen('{', "{\"order\":\"stop\",", 1);
    assert!(decode::<Snapshot>(more.as_bytes()).is_err());
    let less = text.replacen("\"scans_seen\":100,", "", 1);
    assert!(decode::<Snapshot>(less.as_bytes()).is_err());
    assert!(decode::<Snapshot>(&text.as_bytes()[..text.len() - 1]).is_err());
    let large = format!("{text}{}", " ".repeat(MESSAGE_BYTES_MAX));
    assert!(matches!(
        decode::<Snapshot>(large.as_bytes()),
        Err(Refusal::Size(_))
    ));
    let deep = "[".repeat(100_000);
    assert!(decode::<Snapshot>(deep.as_bytes()).is_err());
    let mut short = circle();
    short.circle.deviation_um.pop();
    assert!(encode(&short).is_err());
    let mut upside_down = circle();
    upside_down.circle.deviation_um[5] = Some([2.0, 0.0, 1.0]);
    assert!(encode(&upside_down).is_err());
}

#[test]
fn a_history_with_a_hole_or_of_two_servers_is_refused() {
    let event = |number: u64, session: u64| EventReport {
        format: FORMAT,
        session,
        number,
        scan: 1,
        warning: false,
        text: "hold".into(),
    };
    let history = |events: Vec<EventReport>| {
        let history = EventHistory {
            format: FORMAT,
            session: 7,
            oldest: 1,
            events,
        };
        history.check()
    };
    assert!(history(vec![event(4, 7), event(5, 7)]).is_ok());
    assert!(history(vec![event(4, 7), event(6, 7)]).is_err());
    assert!(history(vec![event(4, 7), event(5, 8)]).is_err());
    assert!(history(vec![event(u64::MAX, 7), event(1, 7)]).is_err());
    assert!(history(vec![event(0, 7)]).is_err());
}

#[test]
fn a_text_of_the_cell_is_made_fit_to_travel() {
    let mut sent = snapshot();
    sent.state.program.block = Some(format!("G1 X5\t; \u{1b}[2J{}", "ä".repeat(400)));
    let got: Snapshot = decode(&encode(&sent).expect("message")).expect("believed");
    let block = got.state.program.block.expect("a block");
    assert!(block.starts_with("G1 X5 ;  [2Jä"), "{block}");
    let machine = MachineReport {
        format: FORMAT,
        session: 7,
        cell: "mill-3".into(),
        machine_toml: format!("[scan]\n{}", "# long\n".repeat(100)),
    };
    let got: MachineReport = decode(&encode(&machine).expect("message")).expect("believed");
    assert_eq!(got, machine);
}

/// The largest snapshot that can be made fits.
#[test]
fn a_snapshot_of_eight_axes_and_24_processes_fits_into_a_message() {
    let mut full = snapshot();
    full.state.axes = vec![full.state.axes[0].clone(); AXES_MAX];
    full.state.processes = vec![full.state.processes[0].clone(); PROCESSES_MAX];
    full.reversals = vec![full.reversals[0]; REVERSALS_MAX];
    full.reversals_count = 1000;
    let bytes = encode(&full).expect("plausible").len();
    assert!(bytes < 20_000, "{bytes}");
}

proptest! {
    /// Any bytes, and any message with some bytes changed, are a value or a refusal, never a panic.
    #[test]
    fn garbled_messages_are_judged(
        place in 0usize..2000,
        with in prop::collection::vec(any::<u8>(), 1..20),
    ) {
        let mut bytes = encode(&snapshot()).expect("plausible");
        let place = place % bytes.len();
        let end = (place + with.len()).min(bytes.len());
        bytes.splice(place..end, with.iter().copied());
        if let Ok(believed) = decode::<Snapshot>(&bytes) {
            let again = serde_json::to_value(&believed).expect("JSON");
            prop_assert!(check("message", &again).is_ok() && believed.check().is_ok());
        }
        prop_assert!(decode::<EventReport>(&with).is_err());
    }
}
