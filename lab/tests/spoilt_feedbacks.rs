//! Every invariant of the judges, broken in the record of a run that holds them all: each is seen, and by its own words.

use std::sync::Arc;

use bus::sample::{
    AxisCommand, Cause, Feedback, Instruments, Job, Mode, PlannerStatus, Roster, Setpoint,
};
use lab::cell::{InProcessCell, Published, Script, Window};
use lab::invariants::{Course, Feedbacks, Judge, Violation, Violations};
use lab::liveness::Liveness;
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::{faults, orders};

use crate::common::{going_on, kill, load, waited};

const PROGRAM: &str = "G21 G17 G90 G94\nG1 X20 Y10 F3000\nG1 X0 Y0\nG4 P1.2\nG0 X1 Y7\nM2\n";
/// Scans that the operator thinks before it goes on.
const THINKS_SCANS: u64 = 90;

/// All that was published in a scan.
#[derive(Clone)]
struct Row {
    feedback: Feedback,
    instruments: Instruments,
    commands: Vec<AxisCommand>,
    status: Option<PlannerStatus>,
    windows: Vec<Arc<Window>>,
    roster: Roster,
}

type Run = [Row];

/// A run with these deaths, a hold and an end.
fn recorded(machine: &Machine, plant: &PlantFile, deaths: &str) -> Vec<Row> {
    let hold = "[[order]]\nscan = 60\norder = \"hold\"\n";
    let script = Script {
        faults: Some(faults::parse("faults.toml", deaths, machine).expect("a script")),
        orders: orders::parse("orders.toml", hold, machine).expect("orders"),
        ..Script::default()
    };
    let mut cell =
        InProcessCell::with_script(machine, plant, ("any.ngc", PROGRAM), script).expect("a cell");
    let (mut run, mut scans) = (Vec::new(), 0);
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        run.push(Row {
            feedback,
            instruments: *published.instruments,
            commands: published.commands.to_vec(),
            status: published.status.copied(),
            windows: published.windows.to_vec(),
            roster: *published.roster,
        });
        scans = waited(scans, &feedback);
        if scans == THINKS_SCANS {
            cell.order(&going_on(&feedback));
            scans = 0;
        }
        assert!(feedback.scan < 20_000, "the run does not end");
    }
    run
}

/// What the judges say of a run.
fn said(machine: &Machine, course: &Course, run: &Run) -> String {
    let mut judge = Judge::new(machine, course);
    let mut liveness = Liveness::new(machine);
    for row in run {
        let published = Published {
            feedback: &row.feedback,
            instruments: &row.instruments,
            commands: &row.commands,
            status: row.status.as_ref(),
            windows: &row.windows,
            roster: &row.roster,
            obeyed: &[],
        };
        judge.take(&published, |_, _| row.feedback.scan > 200);
        liveness.take(&published, 0, |_| false);
    }
    words(judge.end().1.into_iter().chain(liveness.end()))
}

/// What the judge of the feedbacks alone says of it.
fn said_of_feedbacks(machine: &Machine, course: &Course, run: &Run) -> String {
    let (mut judge, mut found) = (Feedbacks::new(machine), Violations::default());
    for row in run {
        judge.take(course, &row.feedback, &mut found);
    }
    judge.end(course, &mut found);
    words(found.0.into_iter())
}

fn words(found: impl Iterator<Item = Violation>) -> String {
    found
        .map(|of| format!("scan {}: {}\n", of.scan, of.what))
        .collect()
}

/// The first row that is so.
fn first(run: &Run, is: impl Fn(&Feedback) -> bool) -> usize {
    let mut rows = run.iter();
    let found = rows.position(|row| is(&row.feedback));
    found.expect("such a scan")
}

fn tripped(feedback: &Feedback) -> bool {
    feedback.mode == Mode::Tripped as u32
}

fn disabled(feedback: &Feedback) -> bool {
    feedback.mode == Mode::Disabled as u32
}

/// A scan in the middle of the first motion.
const MOVES: usize = 40;

fn rows(run: &mut Run, is: fn(&Feedback) -> bool, change: fn(&mut Row)) {
    run.iter_mut()
        .filter(|row| is(&row.feedback))
        .for_each(change);
}

/// Changes the setpoints that are executed from a scan on, and what the feedback says of them.
fn setpoints(run: &mut Run, change: fn(&mut Setpoint)) {
    for row in run {
        for window in &mut row.windows {
            let mut setpoints = window.setpoints.clone();
            for (setpoint, scan) in setpoints.iter_mut().zip(window.header.first_scan..) {
                if scan >= MOVES as u64 {
                    change(setpoint);
                }
            }
            *window = Arc::new(Window {
                header: window.header,
                setpoints,
            });
        }
    }
}

/// Name of an invariant, words by which its loss is told, and how it is lost.
type Loss = (&'static str, &'static str, fn(&mut Run));

const FEEDBACKS: &[Loss] = &[
    ("order", "it comes after scan", |run| {
        run[MOVES].feedback.scan -= 1;
    }),
    ("order", "mode 99 does not exist", |run| {
        run[MOVES].feedback.mode = 99;
    }),
    ("steps", "increments a scan, limit", |run| {
        run[MOVES..]
            .iter_mut()
            .for_each(|row| row.feedback.axes[1].command_position += 1_000_000);
    }),
    ("steps", "step changes by", |run| {
        run[MOVES..]
            .iter_mut()
            .for_each(|row| row.feedback.axes[1].command_position += 6_000);
    }),
    ("steps", "increments without a command", |run| {
        run[MOVES].feedback.axes[0].command_scan -= 5;
    }),
    ("path", "is commanded 2.8 increments off the path", |run| {
        run[MOVES].feedback.axes[0].command_position += 3;
    }),
    ("travel", "is commanded out of its travel", |run| {
        let at = first(run, tripped);
        run[at].feedback.axes[0].command_position = i64::from(i32::MAX);
    }),
    ("encoders", "off its encoder", |run| {
        let at = first(run, tripped) + 1;
        run[at].feedback.axes[0].command_position += 1;
    }),
    ("encoders", "off its encoder", |run| {
        let at = first(run, disabled);
        run[at].feedback.axes[0].command_position += 1;
    }),
    ("encoders", "off its encoder", |run| {
        let at = first(run, disabled) + 1;
        run[at].feedback.axes[0].command_position += 1;
    }),
    ("drives off", "µm with the drives off", |run| {
        let at = first(run, disabled) + 10;
        let axis = &mut run[at].feedback.axes[0];
        axis.motor_position += 30_000;
        axis.scale_position += 30_000;
        axis.command_position += 30_000;
    }),
    ("speeds", "mm/s, commanded", |run| {
        run[MOVES].feedback.axes[1].velocity_mm_s = 268.0;
    }),
    ("speeds", "mm/s, commanded", |run| {
        run[MOVES].feedback.axes[1].velocity_command_mm_s = f64::NAN;
    }),
    ("hold", "the command moves in hold", |run| {
        let rests = |f: &Feedback| f.hold == 1 && f.at_rest == 1;
        let at = first(run, rests) + 35;
        run[at].feedback.axes[0].command_position += 1;
    }),
    ("braking", "an axis still moves after a trip", |run| {
        rows(run, tripped, |row| row.feedback.axes[0].velocity_mm_s = 1.0);
    }),
    ("end", "off the programmed end", |run| {
        let last = run.len() - 1;
        run[last].feedback.axes[0].command_position += 1;
    }),
];

const BESIDE: &[Loss] = &[
    ("setpoints", "mm/s²: at most", |run| {
        setpoints(run, |setpoint| setpoint.position[0] += 20_000);
    }),
    ("tags", "increments off the path", |run| {
        setpoints(run, |setpoint| setpoint.position[0] += 3);
    }),
    ("windows", "the feedback's tag is not", |run| {
        run[MOVES].feedback.tag.distance_mm += 1e-9;
    }),
    ("windows", "that nobody sent", |run| {
        run.iter_mut().for_each(|row| row.windows.clear());
    }),
    ("windows", "is not in its window", |run| {
        run[MOVES].feedback.setpoint = 60_000;
    }),
    ("windows", "begins off the command positions", |run| {
        let at = first(run, |f| !f.window.is_none());
        run[at].feedback.axes[0].command_position += 1;
    }),
    ("executed", "off what was executed", |run| {
        run[MOVES].feedback.axes[0].command_position += 1;
    }),
    ("missed scans", "that no fault explains", |run| {
        run[MOVES].feedback.axes[0].missed_scans += 1;
    }),
    ("lost servo", "has not tripped at rest", |run| {
        let at = first(run, |f| f.hold == 1 && f.at_rest == 1);
        let places = run[at].roster.participants.iter_mut();
        places
            .filter(|place| place.job == Job::Servo as u32)
            .for_each(|place| place.live = 0);
    }),
    ("deviation", "mm from the path after a trip", |run| {
        let at = first(run, tripped) + 3;
        run[at].instruments.axes[0]
            .table_mm
            .iter_mut()
            .for_each(|mm| *mm += 5.0);
    }),
    ("table", "µm off the end", |run| {
        let last = run.len() - 1;
        let table_mm = &mut run[last].instruments.axes[0].table_mm;
        table_mm.iter_mut().for_each(|mm| *mm += 0.1);
    }),
    ("cause", "which has not happened", |run| {
        run[MOVES].feedback.cause = Cause::SoftLimit as u32;
    }),
    ("cause", "cause 999 is none", |run| {
        run[MOVES].feedback.cause = 999;
    }),
];

#[test]
fn every_invariant_that_is_broken_is_seen_and_told_by_its_words() {
    let (machine, plant) = load("xy");
    let course = Course::of(&machine, &plant, "any.ngc", PROGRAM).expect("a course");
    let restart = "[restart]\nservo = \"wait\"\nmaster = \"wait\"\n".to_string();
    let deaths = restart + &kill("servo-X", 240, 30) + &kill("plant-sim", 900, 30);
    let run = recorded(&machine, &plant, &deaths);
    assert_eq!(said(&machine, &course, &run), "");
    assert_eq!(said_of_feedbacks(&machine, &course, &run), "");
    let mut unseen = Vec::new();
    let mut look = |losses: &[Loss], judge: fn(&Machine, &Course, &Run) -> String| {
        for (name, words, spoil) in losses {
            let mut spoilt = run.clone();
            spoil(&mut spoilt);
            let said = judge(&machine, &course, &spoilt);
            if !said.contains(words) {
                unseen.push(format!("{name}: {words:?} is not in {said:?}"));
            }
        }
    };
    look(FEEDBACKS, said_of_feedbacks);
    look(FEEDBACKS, said);
    look(BESIDE, said);
    assert!(unseen.is_empty(), "{}", unseen.join("\n"));
}

#[test]
fn a_standby_that_commands_something_else_is_seen() {
    let (mut machine, plant) = load("xy");
    machine.axes.iter_mut().for_each(|axis| axis.standby = true);
    let course = Course::of(&machine, &plant, "any.ngc", PROGRAM).expect("a course");
    let mut run = recorded(&machine, &plant, "");
    assert_eq!(said(&machine, &course, &run), "");
    let commands = run.iter_mut().skip(MOVES).flat_map(|row| &mut row.commands);
    commands
        .filter(|command| command.role == 1)
        .for_each(|command| command.velocity_mm_s += 1.0);
    let said = said(&machine, &course, &run);
    assert!(said.contains("has not come into step"), "{said:?}");
}
