use ratatui::Terminal;
use ratatui::backend::TestBackend;

use super::*;
use crate::live::model::Model;
use crate::live::test_support::{look, machine, running, take_spoilt, with_program};
use crate::live::words::Tone;
use crate::spoilt::{self, Spoiler};
use bus::member::Pace;
use bus::sample::{
    AxisCommand, Cause, Job, Mode, Participant, ProgramState, Roster, SpindleCommand, Waiting,
};
use bytemuck::Zeroable;
use launcher::children::Child;

fn shown(screen: &Screen<'_>, width: u16, height: u16) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a terminal");
    terminal.draw(|frame| draw(frame, screen)).expect("drawn");
    let buffer = terminal.backend().buffer();
    let rows = buffer.content().chunks(width as usize);
    rows.map(|row| row.iter().map(|cell| cell.symbol()).collect())
        .collect()
}

fn plain(model: &mut Model) -> Screen<'_> {
    look(model);
    Screen::plain(model)
}

/// A cell in motion, all kinds of numbers at their longest.
fn model() -> Model {
    let mut model = Model::new("mill-3", machine());
    let mut roster = Roster::zeroed();
    let jobs = [
        Job::Monitor,
        Job::Servo,
        Job::Servo,
        Job::Planner,
        Job::Master,
    ];
    for (place, job) in jobs.into_iter().enumerate() {
        roster.participants[place] = Participant {
            death_scan: u64::MAX,
            job: job as u32,
            axis: u32::from(place == 2),
            incarnation: 1,
            live: 1,
            ..Participant::default()
        };
    }
    model.roster(&roster);
    for scan in 100_000..100_010u64 {
        let mut feedback = running(scan);
        feedback.axes[0].command_position = -299_123_456;
        feedback.axes[0].motor_position = -299_123_956;
        feedback.axes[1].missed_scans = 12_345;
        feedback.axes[1].torque_limited = 1;
        feedback.axes[1].torque_nm = 5.9;
        model.feedback(&feedback);
        for axis in 0..2 {
            model.command(&AxisCommand {
                scan,
                axis,
                following_error_mm: 0.0123,
                ..AxisCommand::zeroed()
            });
        }
        model.end_of_look();
    }
    let children = vec![Child {
        pid: 4_194_301,
        place: 3,
        incarnation: 1,
        pace: Some(Pace::Realtime),
        program: None,
        out: None,
    }];
    model.processes_seen(children, vec![Some(100_008); 24], Some(100_000));
    model
}

#[test]
fn the_screen_has_everything_at_80_by_24_and_at_160_by_50() {
    let mut model = model();
    for (width, height) in [(80, 24), (160, 50)] {
        let lines = shown(&plain(&mut model), width, height);
        let all = lines.join("\n");
        for part in [
            "▶ RUNS",
            "mill-3 realtime 100.0 s",
            "-299.1235",
            "-299.1240",
            "+12.3",
            "12345",
            "!",
            "reversals",
            "processes",
            "plant-sim",
            "servo-Y",
            "4194301",
            "scan period seen from here",
            "events",
            "h hold",
        ] {
            assert!(
                all.contains(part),
                "no {part:?} at {width}×{height}:\n{all}"
            );
        }
        // Whatever is at the right edge ends there: the active servo, last of its row.
        let row = lines.iter().find(|line| line.starts_with(" Y")).expect("Y");
        assert!(row.trim_end().ends_with(" a"), "{row:?}");
    }
}

#[test]
fn a_trip_is_reported_with_axis_and_cause_and_what_to_do() {
    let mut model = model();
    let mut feedback = running(100_020);
    feedback.mode = Mode::Tripped as u32;
    feedback.cause = Cause::FollowingError as u32;
    feedback.cause_axis = 1;
    feedback.cause_scan = 100_015;
    model.feedback(&feedback);
    let all = shown(&plain(&mut model), 80, 24).join("\n");
    assert!(all.contains("✖ TRIPPED"), "{all}");
    assert!(
        all.contains("axis Y: following error beyond its limit, in scan 100015"),
        "{all}"
    );
    assert!(all.contains("quadrant enable"), "{all}");
    assert!(all.contains("▲ 100.02 s TRIP Y: following"), "{all}");
}

#[test]
fn help_question_and_answer_lie_over_the_screen() {
    let mut model = model();
    let mut screen = plain(&mut model);
    screen.prompt = Prompt::ConfirmStop;
    assert!(shown(&screen, 80, 24)[23].contains("stop?"));
    screen.prompt = Prompt::Answer(Tone::Bad, "hold refused: the machine has tripped".into());
    assert!(shown(&screen, 80, 24)[23].contains("hold refused"));
    screen.help = true;
    let help = shown(&screen, 80, 24).join("\n");
    let last = HELP.lines().last().expect("a line").trim();
    assert!(help.contains(last), "{help}");
}

#[test]
fn with_room_for_three_columns_no_list_is_cut() {
    let mut model = model();
    let mut roster = Roster::zeroed();
    roster.participants[0] = Participant {
        death_scan: u64::MAX,
        job: Job::Master as u32,
        incarnation: 1,
        live: 1,
        ..Participant::default()
    };
    model.roster(&roster);
    for width in [120, 132, 160] {
        let all = shown(&plain(&mut model), width, 36).join("\n");
        for part in ["height µm  error µm", "starts   age state", " machine"] {
            assert!(all.contains(part), "no {part:?} at {width}:\n{all}");
        }
    }
}

#[test]
fn any_size_and_a_model_of_nothing_are_drawn_without_a_panic() {
    let empty = Model::new("t", machine());
    let full = model();
    for (width, height) in [
        (1, 1),
        (59, 40),
        (60, 16),
        (80, 17),
        (119, 30),
        (120, 16),
        (300, 90),
    ] {
        for model in [&empty, &full] {
            let mut screen = Screen::plain(model);
            shown(&screen, width, height);
            screen.help = true;
            shown(&screen, width, height);
        }
    }
}

#[test]
fn a_view_from_another_machine_says_how_old_it_is_that_it_is_read_only_and_when_the_link_is_lost() {
    use crate::live::picture::{from_afar, tell_link};
    use remote::state::LinkState;
    let mut model = model();
    look(&mut model);
    let mut link = LinkState {
        server: "tcp/192.168.0.7:7447".into(),
        data_age_s_min: Some(0.012),
        data_age_s_max: Some(0.0731),
        ..LinkState::default()
    };
    from_afar(&mut model.shown.state);
    tell_link(&mut model.shown.state, &link);
    for (width, height) in [(80, 24), (160, 50)] {
        let lines = shown(&Screen::plain(&model), width, height);
        assert!(
            lines[2].trim_end().ends_with("data ≤ 73 ms old"),
            "{}",
            lines[2]
        );
        assert!(
            lines[2].contains("on the controller PC: `quadrant hold`"),
            "{}",
            lines[2]
        );
        let bottom = lines.last().expect("a line");
        assert!(
            bottom.contains("read only") && !bottom.contains("s stop"),
            "{bottom}"
        );
    }
    link.link_lost = true;
    link.silent_s = 3.2;
    link.data_age_s_max = Some(3.27);
    tell_link(&mut model.shown.state, &link);
    let lines = shown(&Screen::plain(&model), 80, 24);
    assert!(
        lines[0].contains("NO LINK  link lost for 3.2 s"),
        "{}",
        lines[0]
    );
    assert!(
        lines[2].trim_end().ends_with("data ≤ 3.3 s old"),
        "{}",
        lines[2]
    );
    assert!(lines[2].contains("comes back by itself"), "{}", lines[2]);
}

/// Numbers in a text that have more than four decimals.
fn overlong(text: &str) -> Vec<&str> {
    let numbers = text.split(|letter: char| !letter.is_ascii_digit() && letter != '.');
    let long = |number: &&str| {
        let decimals = number.split_once('.').map_or("", |(_, decimals)| decimals);
        decimals.trim_end_matches('.').len() > 4
    };
    numbers.filter(long).collect()
}

/// All that is said of a cell in words: by `status`, on the screen and its readout, in its events, and on the page.
fn read_by_people(model: &mut Model) -> Vec<String> {
    look(model);
    let mut texts = vec![crate::live::text::status(
        &model.shown.state,
        &model.machine,
    )];
    for (width, height) in [(80, 24), (160, 50)] {
        for readout in [false, true] {
            let mut screen = Screen::plain(model);
            screen.readout = readout;
            texts.extend(shown(&screen, width, height));
        }
    }
    texts.extend(model.events.last.iter().map(|event| event.text.clone()));
    let mut values = vec![serde_json::json!(crate::live::json::state(
        &model.shown.state
    ))];
    while let Some(value) = values.pop() {
        match value {
            serde_json::Value::String(text) => texts.push(text),
            serde_json::Value::Array(inner) => values.extend(inner),
            serde_json::Value::Object(inner) => values.extend(inner.into_values()),
            _ => {}
        }
    }
    texts
}

#[test]
fn no_number_that_is_shown_has_more_than_four_decimals() {
    assert_eq!(
        overlong("at 1.2345 of 201.60007995844867."),
        ["201.60007995844867."]
    );
    let mut model = model();
    let mut next_start = program::modal_at_start(&model.machine);
    next_start.feed = Some(1000.0 / 3.0);
    next_start.speed = 2000.0 / 3.0;
    model.next_start = Some(next_start);
    let spindles = [
        SpindleCommand::Turn,
        SpindleCommand::Orient,
        SpindleCommand::Follow,
        SpindleCommand::Stop,
    ];
    for (case, waiting) in (1u32..).zip(Waiting::ALL.repeat(spindles.len())) {
        let mut odd = f64::from(case) / 7.0;
        let mut next = || {
            odd += 100.0 / 3.0;
            odd
        };
        let mut feedback = running(100_010 + u64::from(case));
        feedback.program = [ProgramState::Running, ProgramState::Loaded][case as usize % 2] as u32;
        let auxiliary = &mut feedback.auxiliary;
        auxiliary.waiting = waiting as u32;
        auxiliary.levels.spindle = spindles[case as usize % spindles.len()] as u32;
        auxiliary.levels.spindle_rpm = next();
        auxiliary.levels.orientation_deg = next();
        auxiliary.levels.analog = auxiliary.levels.analog.map(|_| next());
        auxiliary.spindle_rpm = next();
        auxiliary.spindle_turns = next();
        auxiliary.spindle_lag_turns = next();
        auxiliary.tool_offset = auxiliary.tool_offset.map(|_| next());
        feedback.inputs.analog = feedback.inputs.analog.map(|_| next());
        for axis in &mut feedback.axes {
            axis.command_position = (1e6 * next()) as i64;
            axis.motor_position = (1e6 * next()) as i64;
            axis.velocity_mm_s = next();
            axis.velocity_command_mm_s = next();
            axis.torque_nm = next();
            axis.winding_k = next();
        }
        model.feedback(&feedback);
        for text in read_by_people(&mut model) {
            assert_eq!(overlong(&text), [] as [&str; 0], "{text}");
        }
    }
}

/// SPOILT_SAMPLES=1000000 takes some 15 s.
#[test]
fn no_number_of_any_sample_keeps_the_terminal_from_its_next_picture() {
    let (mut model, mut spoiler) = (model(), Spoiler::new());
    for number in 0..spoilt::count(20_000) {
        if number % 10_000 == 5_000 {
            with_program(&mut model);
        }
        take_spoilt(&mut model, number, &mut spoiler);
        if number % 100 == 0 {
            model.end_of_look();
            look(&mut model);
            let width = 1 + (spoiler.draw() % 200) as u16;
            let height = 1 + (spoiler.draw() % 60) as u16;
            let screen = Screen {
                readout: number % 200 == 0,
                ..Screen::plain(&model)
            };
            shown(&screen, width, height);
            crate::live::text::status(&model.shown.state, &model.machine);
        }
    }
}
