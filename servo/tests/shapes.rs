//! The form of the kick as the machine file asks for it.
#![allow(missing_docs)]

use bus::machine::{KickShape, Machine};
use control::reversal::KickShape as Shape;
use servo::ServoSettings;

/// The reference machine with other lines for the form of the kick.
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
fn a_machine_file_that_names_no_form_gets_the_sources_constant_kick() {
    let machine = machine("").expect("older files stay good");
    assert_eq!(machine.axes[0].reversal.shape, KickShape::Constant);
    let kick = ServoSettings::new(&machine, 0).expect("an axis").kick;
    assert_eq!((kick.shape, kick.kick_scans), (Shape::Constant, 10));
}

#[test]
fn a_decaying_kick_takes_its_decay_and_its_distance_from_the_machine_file() {
    let machine = machine("shape = \"decaying\"\npresliding_um = 8.0").expect("good");
    let kick = ServoSettings::new(&machine, 0).expect("an axis").kick;
    let Shape::Decaying {
        decay_scans,
        presliding_mm,
    } = kick.shape
    else {
        panic!("{kick:?}");
    };
    assert!((decay_scans - 10.0).abs() < 1e-9 && (presliding_mm - 0.008).abs() < 1e-12);
}

#[test]
fn a_constant_kick_with_a_presliding_distance_is_refused_with_its_line() {
    for (lines, said) in [
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
            error.starts_with("machine.toml:") && error.contains(said),
            "{error}"
        );
    }
}
