//! The form of the friction pulse as the machine file asks for it.
#![allow(missing_docs)]

use loops::reversal::PulseShape as Shape;
use loops::trigger::{PositionErrorPart, Trigger};
use machine::{Machine, PulseShape};
use servo::ServoSettings;

/// The reference machine with other lines for the form of the friction pulse.
fn machine(shape: &str) -> Result<Machine, String> {
    let text = include_str!("../../machines/xy/machine.toml");
    let kept: Vec<&str> = text
        .lines()
        .filter(|line| !line.starts_with("shape") && !line.starts_with("presliding_um"))
        .collect();
    let text = kept
        .join("\n")
        .replace("[axis.reversal]", &format!("[axis.reversal]\n{shape}"));
    Machine::parse("machine.toml", &text).map_err(|error| error.to_string())
}

#[test]
fn a_machine_file_that_names_no_form_gets_the_sources_constant_pulse() {
    let machine = machine("").expect("older files stay good");
    assert_eq!(machine.axes[0].reversal.shape, PulseShape::Constant);
    let pulse = ServoSettings::new(&machine, 0).expect("an axis").pulse;
    assert_eq!((pulse.shape, pulse.pulse_scans), (Shape::Constant, 10));
}

#[test]
fn a_decaying_pulse_takes_its_decay_and_its_distance_from_the_machine_file() {
    let machine = machine("shape = \"decaying\"\npresliding_um = 8.0").expect("good");
    let pulse = ServoSettings::new(&machine, 0).expect("an axis").pulse;
    let Shape::Decaying {
        decay_scans,
        presliding_mm,
    } = pulse.shape
    else {
        panic!("{pulse:?}");
    };
    assert!((decay_scans - 10.0).abs() < 1e-9 && (presliding_mm - 0.008).abs() < 1e-12);
}

#[test]
fn a_constant_pulse_with_a_presliding_distance_is_refused_with_its_line() {
    for (lines, published) in [
        (
            "presliding_um = 8.0",
            "axis X reversal.presliding_um = 8 µm: needs shape = \"decaying\"",
        ),
        (
            "shape = \"decaying\"\npresliding_um = -1.0",
            "axis X reversal.presliding_um = -1 µm: must be at least 0 and at most 1000 µm",
        ),
        ("shape = \"round\"", "unknown variant `round`"),
    ] {
        let error = machine(lines).expect_err("a broken file");
        assert!(
            error.starts_with("machine.toml:") && error.contains(published),
            "{error}"
        );
    }
}

/// The reference machine with a piece of its text replaced.
fn changed(what: &str, by: &str) -> Result<Machine, String> {
    let text = include_str!("../../machines/xy/machine.toml");
    assert!(text.contains(what));
    Machine::parse("machine.toml", &text.replace(what, by)).map_err(|error| error.to_string())
}

#[test]
fn every_trigger_and_part_of_the_position_error_reaches_the_servo() {
    for (word, expected) in [
        ("position-error", Trigger::PositionError),
        ("feed-forward", Trigger::FeedForward),
        ("velocity-command", Trigger::VelocityCommand),
        (
            "command-acceleration",
            Trigger::CommandAcceleration(PositionErrorPart::None),
        ),
        (
            "command-acceleration\"\nposition_error_part = \"clamped",
            Trigger::CommandAcceleration(PositionErrorPart::Clamped),
        ),
        (
            "command-acceleration\"\nposition_error_part = \"full",
            Trigger::CommandAcceleration(PositionErrorPart::Full),
        ),
    ] {
        let machine = changed("\"command-acceleration\"", &format!("\"{word}\"")).expect("good");
        let pulse = ServoSettings::new(&machine, 1).expect("an axis").pulse;
        assert_eq!(pulse.trigger, expected);
    }
}

#[test]
fn settings_that_do_not_belong_together_are_refused_with_their_line() {
    let trigger = "trigger = \"command-acceleration\"";
    for (what, by, published) in [
        (
            "[axis.reversal]",
            "[axis.prediction]\nm = 0.1\n\n[axis.reversal]",
            "axis X prediction.m = 0.1: must be at least 0.2 and at most 100",
        ),
        (
            trigger,
            "trigger = \"velocity-command\"\nposition_error_part = \"full\"",
            "axis X reversal.position_error_part needs trigger = \"command-acceleration\", \"velocity-command\" does not ask",
        ),
        (trigger, "trigger = \"luck\"", "unknown variant `luck`"),
        (
            "[[axis]]\nname = \"X\"",
            "[interpolation]\nwithin_period = \"odd\"\n\n[[axis]]\nname = \"X\"",
            "unknown variant `odd`",
        ),
    ] {
        let error = changed(what, by).expect_err(by);
        assert!(
            error.starts_with("machine.toml:") && error.contains(published),
            "{error}"
        );
    }
    let text =
        include_str!("../../machines/xy/machine.toml").replace("enabled = true", "enabled = false");
    let text = text
        .replace("method = \"contact-force\"", "method = \"friction-pulse\"")
        .replace("friction = true", "friction = false");
    for (by, published) in [
        (
            "trigger = \"feed-forward\"",
            "axis Y reversal.trigger = \"feed-forward\": needs feed_forward.enabled = true",
        ),
        (
            "trigger = \"command-acceleration\"\nposition_error_part = \"clamped\"",
            "axis Y reversal.position_error_part = \"clamped\": needs feed_forward.enabled = true",
        ),
    ] {
        let error = Machine::parse("machine.toml", &text.replace(trigger, by)).expect_err(by);
        assert!(error.to_string().contains(published), "{error}");
    }
}
