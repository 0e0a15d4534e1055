use bytemuck::Zeroable;

use super::*;

fn words(
    alarm: &mut StandbyAlarm,
    unsynchronised_scans: u32,
    differences: u32,
) -> Vec<&'static str> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let machine = Machine::load(&folder).expect("a machine");
    let mut feedback = Feedback::zeroed();
    feedback.axis_count = 2;
    feedback.axes[1].redundancy = Redundancy::Lost as u32;
    feedback.axes[1].unsynchronised_scans = unsynchronised_scans;
    feedback.axes[1].differences = differences;
    let said = alarm.look(&feedback, &machine);
    said.into_iter().map(|alarm| alarm.event).collect()
}

#[test]
fn a_standby_that_is_missing_for_a_second_is_an_alarm_once_and_said_to_be_back_once() {
    let mut alarm = StandbyAlarm::default();
    assert!(
        words(&mut alarm, 1000, 0).is_empty(),
        "a replacement is there sooner"
    );
    assert_eq!(words(&mut alarm, 1001, 0), ["standby-alarm"]);
    assert!(words(&mut alarm, 5000, 0).is_empty());
    assert_eq!(words(&mut alarm, 0, 0), ["standby-back"]);
    assert!(words(&mut alarm, 0, 0).is_empty());
}

#[test]
fn two_servos_that_differ_are_reported_each_time() {
    let mut alarm = StandbyAlarm::default();
    assert_eq!(words(&mut alarm, 0, 1), ["standby-differs"]);
    assert!(words(&mut alarm, 0, 1).is_empty());
    assert_eq!(words(&mut alarm, 0, 3), ["standby-differs"]);
}
