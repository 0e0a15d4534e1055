use super::*;
use proptest::prelude::*;

fn axis() -> AxisState {
    AxisState {
        command_mm: 1.25,
        feedback_mm: 1.2499,
        velocity_mm_s: 50.0,
        torque_nm: -0.3,
        winding_k: 4.0,
        torque_limited: false,
        missed_scans: 3,
        missed_in_a_row: 0,
        redundancy: 1,
        unsynchronised_scans: 0,
        differences: 0,
        role: 0,
        reference: 0,
        command: Some(CommandState {
            scan: 99,
            position_mm: 1.25,
            velocity_mm_s: 50.1,
            torque_nm: 0.0,
            friction_level: 0.8,
            friction_unexplained: 0.05,
        }),
        error_um: Some(4.5),
        error_peak_since_um: Some(5.0),
        error_peak_um: 9.0,
    }
}

fn snapshot() -> Snapshot {
    Snapshot {
        format: FORMAT,
        session: 7,
        sequence: 1,
        made_us: 1,
        feedback_age_us: 100,
        pace: Some("realtime".into()),
        ended: false,
        machine: Some(MachineState {
            scan: 100,
            mode: 1,
            cause: 0,
            cause_axis: u32::MAX,
            cause_scan: 0,
            override_percent: 100,
            panel: 0,
            overrun_scans: 0,
            incarnation: 1,
            hold: false,
            at_rest: false,
            program: 3,
            run: 1,
            last: false,
            window: true,
            element: 3,
            distance_mm: 0.1,
            dwell_remaining_scans: 0,
            interrupted_at_element: u32::MAX,
            auxiliary: AuxiliaryState {
                spindle_command_rpm: 3000.0,
                spindle_rpm: 2999.5,
                digital: 1 << 63,
                analog: vec![Some(0.5), None],
                at_speed: true,
                ..AuxiliaryState::default()
            },
        }),
        axes: vec![axis(), axis()],
        program: ProgramState {
            name: Some("circle.ngc".into()),
            ..ProgramState::default()
        },
        processes: vec![ProcessState {
            name: "servo-X".into(),
            job: "servo".into(),
            pid: Some(7),
            starts: 1,
            live: true,
            stalled: false,
            redundancy: None,
            drives: Some(true),
            age_scans: Some(1),
            death: None,
        }],
        reversals_count: 1,
        reversals: vec![ReversalState {
            axis: 1,
            direction: -1,
            scan: 50,
            height_um: None,
            undercut_um: None,
            error_peak_um: 2.0,
        }],
        angle_rad: None,
        timing: None,
        events_count: 0,
        scans_seen: 100,
        scans_not_seen: 0,
    }
}

fn circle() -> CircleState {
    CircleState {
        format: FORMAT,
        session: 7,
        plane: "XY".into(),
        radius_mm: 25.0,
        feed_mm_s: Some(50.0),
        line: 3,
        running: true,
        deviation_nm: vec![Some((1, -1, 2)); CIRCLE_BINS],
    }
}

#[test]
fn a_snapshot_comes_back_as_it_was_sent() {
    let sent = snapshot();
    let bytes = encode(&sent).expect("plausible");
    assert_eq!(decode::<Snapshot>(&bytes).expect("believed"), sent);
    let bytes = encode(&circle()).expect("plausible");
    assert_eq!(decode::<CircleState>(&bytes).expect("believed"), circle());
}

#[test]
fn what_is_not_a_number_travels_as_such() {
    let mut sent = snapshot();
    sent.axes[0].torque_nm = f64::NAN;
    sent.axes[0].velocity_mm_s = f64::INFINITY;
    sent.axes[1].feedback_mm = -1e300;
    let got: Snapshot = decode(&encode(&sent).expect("message")).expect("believed");
    assert!(got.axes[0].torque_nm.is_nan() && got.axes[0].velocity_mm_s.is_nan());
    assert!(got.axes[1].feedback_mm.is_nan());
    assert_eq!(got.axes[1].command_mm, 1.25);
}

/// Why a snapshot that was changed is not believed.
fn refused(change: impl FnOnce(&mut Snapshot)) -> String {
    let mut bad = snapshot();
    change(&mut bad);
    let text = serde_json::to_string(&bad).expect("JSON");
    // What no server of ours would send.
    let text = text.replace("\"feedback_mm\":7.0", "\"feedback_mm\":1e300");
    let text = text.replace("\"torque_nm\":7.0", "\"torque_nm\":-1e16");
    let refusal = decode::<Snapshot>(text.as_bytes()).expect_err("it must not be believed");
    refusal.to_string()
}

#[test]
fn each_field_out_of_range_is_refused_by_its_name() {
    let cases: [(&str, String); 12] = [
        ("format 5", refused(|s| s.format = 5)),
        ("pace", refused(|s| s.pace = Some("slow".into()))),
        ("axes", refused(|s| s.axes = vec![axis(); AXES_MAX + 1])),
        ("feedback_mm", refused(|s| s.axes[1].feedback_mm = 7.0)),
        (
            "override_percent",
            refused(|s| s.machine.as_mut().expect("one").override_percent = 201),
        ),
        (
            "cause_axis",
            refused(|s| s.machine.as_mut().expect("one").cause_axis = 2),
        ),
        ("reversal's axis", refused(|s| s.reversals[0].axis = 2)),
        ("direction", refused(|s| s.reversals[0].direction = 0)),
        ("reversals_count", refused(|s| s.reversals_count = 0)),
        (
            "control character",
            refused(|s| s.processes[0].name = "\u{1b}[2Jservo".into()),
        ),
        (
            "401 bytes",
            refused(|s| s.program.name = Some("x".repeat(TEXT_BYTES_MAX + 1))),
        ),
        (
            "commanded torque_nm",
            refused(|s| s.axes[0].command.as_mut().expect("one").torque_nm = 7.0),
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
    short.deviation_nm.pop();
    assert!(encode(&short).is_err());
    let mut upside_down = circle();
    upside_down.deviation_nm[5] = Some((0, 2, 1));
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
    let text = plain_text(&format!("G1 X5\t; \u{1b}[2J{}", "ä".repeat(400)));
    assert!(check_text("text", &text).is_ok());
    assert!(text.starts_with("G1 X5 ;  [2Jä"), "{text}");
}

/// The largest snapshot that can be made fits.
#[test]
fn a_snapshot_of_eight_axes_and_24_processes_fits_into_a_message() {
    let mut full = snapshot();
    full.axes = vec![axis(); AXES_MAX];
    full.processes = vec![full.processes[0].clone(); PROCESSES_MAX];
    full.reversals = vec![full.reversals[0]; REVERSALS_MAX];
    full.reversals_count = 1000;
    let bytes = encode(&full).expect("plausible").len();
    assert!(bytes < 16_000, "{bytes}");
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
            prop_assert!(believed.check().is_ok());
        }
        prop_assert!(decode::<EventReport>(&with).is_err());
    }
}
