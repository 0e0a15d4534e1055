//! What goes wrong on the cable: frames that are damaged, late, sent twice or of somebody else, cables that break while a frame is on them.

use crate::runs::{Done, Run, run};
use crate::segment::Network;

/// How many frames the bus process counted that were so; it tells at its end.
fn counted(done: &Done, what: &str) -> u64 {
    let printed = done.printed();
    let line = printed
        .lines()
        .find_map(|line| line.split_once(" frames: "));
    let (_, line) = line.unwrap_or_else(|| panic!("no counts in {printed}"));
    let part = line.split(", ").find(|part| part.contains(what));
    let part = part.unwrap_or_else(|| panic!("no {what:?} in {line}"));
    let number = part.split_whitespace().find_map(|word| word.parse().ok());
    number.unwrap_or_else(|| panic!("no number in {part}"))
}

#[test]
fn frames_of_others_damaged_ones_and_answers_that_come_twice_change_nothing_beside_the_true_ones() {
    let Some(network) = Network::new() else {
        return;
    };
    let undisturbed = run(&network, &[], None);
    let disturbed = run(
        &network,
        &[
            "--at",
            "enabled+200 trouble stray 60",
            "--at",
            "enabled+300 trouble foreign 60",
            "--at",
            "enabled+400 trouble duplicate 60",
        ],
        None,
    );
    assert_eq!(disturbed.text("/outcome/kind"), "completed");
    assert_eq!(
        disturbed.text("/motion_digest"),
        undisturbed.text("/motion_digest")
    );
    assert_eq!(counted(&undisturbed, "foreign or damaged"), 0);
    // A frame of another protocol does not get so far.
    assert_eq!(counted(&disturbed, "foreign or damaged"), 60 + 45);
    assert_eq!(counted(&disturbed, "late"), 60);
    assert_eq!(counted(&disturbed, "without an answer"), 0);
}

/// The axes go on along their windows meanwhile.
#[test]
fn answers_that_are_lost_late_or_damaged_are_missed_and_the_program_goes_on() {
    let Some(network) = Network::new() else {
        return;
    };
    let troubles = [
        "--at",
        "enabled+250 trouble lost 1",
        "--at",
        "enabled+300 trouble late 1",
        "--at",
        "enabled+350 trouble damaged 8",
    ];
    let runs = [(); 2].map(|()| {
        Run {
            segment: &troubles,
            options: &["--answer-limit", "1"],
            ..Run::default()
        }
        .run(&network)
    });
    for done in &runs {
        assert_eq!(
            done.text("/outcome/kind"),
            "completed",
            "{}",
            done.printed()
        );
        // Of the damaged ones two have a wrong working counter only.
        assert_eq!(counted(done, "without an answer"), 1 + 1 + 6);
        assert_eq!(counted(done, "took no part"), 2);
        assert_eq!(counted(done, "late"), 1);
        assert_eq!(counted(done, "foreign or damaged"), 6);
    }
    let [first, again] = runs;
    assert_eq!(first.text("/digest"), again.text("/digest"));
}

/// The frame has a datagram for its number, one for the process data, and one for the state of each drive.
#[test]
fn a_drive_whose_cable_breaks_while_a_frame_is_on_it_stops_the_others_whichever_part_still_came_through()
 {
    let Some(network) = Network::new() else {
        return;
    };
    let mut scans = Vec::new();
    for datagrams in 0..=5 {
        let order = format!("enabled+900 drop 1 {datagrams}");
        let done = run(&network, &["--at", &order], None);
        let printed = done.printed();
        assert_eq!(done.output.status.code(), Some(1), "{order}: {printed}");
        let says = printed.split_once("the machine tripped in scan ");
        let (_, says) = says.unwrap_or_else(|| panic!("{order}: {printed}"));
        let (scan, why) = says.split_once(": ").expect("a cause");
        // Where the state of Y was still in the frame, Z is the first that is missed.
        let named = if datagrams == 4 { "Z" } else { "Y" };
        assert!(
            why.starts_with("drive does not answer (others on the bus do"),
            "{order}: {why}"
        );
        assert!(why.contains(&format!("axis {named}")), "{order}: {why}");
        assert!(
            why.contains(" frames since the start-up "),
            "{order}: {why}"
        );
        scans.push(scan.parse::<u64>().expect("a scan"));
        // What the others did is measured from the path.
        let peak_um = done.report.pointer("/contour_error_um/peak");
        let peak_um = peak_um
            .and_then(serde_json::Value::as_f64)
            .expect("a number");
        assert!(peak_um < 40.0, "{order}: {peak_um} µm");
    }
    // Where all answers were still in the frame, the next one shows that it is gone.
    assert_eq!(scans, [905, 905, 905, 905, 905, 906]);
}
