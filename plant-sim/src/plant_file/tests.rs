use std::path::Path;

use crate::plant_file::PlantFile;

const XY: &str = include_str!("../../../machines/xy/plant.toml");

/// The message for the reference file with one text replaced.
fn message(old: &str, new: &str) -> String {
    assert!(XY.contains(old), "{old:?} is not in the reference file");
    let text = XY.replacen(old, new, 1);
    PlantFile::parse("plant.toml", &text)
        .unwrap_err()
        .to_string()
}

#[test]
fn every_plant_file_that_comes_with_the_product_loads() {
    let machines = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines");
    for (folder, axes) in [
        ("xy", "XY"),
        ("xy-fast", "XY"),
        ("xy-torque", "XY"),
        ("xyz-mill", "XYZ"),
    ] {
        let plant = PlantFile::load(&machines.join(folder)).unwrap();
        let names: String = plant.axes.iter().map(|a| a.name.as_str()).collect();
        assert_eq!(names, axes, "{folder}");
    }
}

#[test]
fn the_reference_axes_have_the_masses_and_forces_they_are_documented_with() {
    let plant = PlantFile::parse("plant.toml", XY).unwrap();
    let x = plant.axis("X").unwrap();
    assert!(
        (x.motor_mass_kg() - 758.0).abs() < 0.5,
        "{}",
        x.motor_mass_kg()
    );
    let m = x.mechanics(25e-6);
    let friction_n = m.motor_friction.coulomb_n + m.table_friction.coulomb_n;
    assert!((friction_n - 451.0).abs() < 1.0, "{friction_n} N");
    assert_eq!(plant.microstep_ns(), 25_000);
}

#[test]
fn a_broken_value_is_named_with_file_line_axis_key_value_unit_and_rule() {
    let text = message("mass_kg = 150.0", "mass_kg = -150.0");
    let line = XY
        .lines()
        .position(|l| l.starts_with("mass_kg = 150"))
        .unwrap()
        + 1;
    assert_eq!(
        text,
        format!(
            "plant.toml:{line}: axis Y table.mass_kg = -150 kg: must be at least 0.1 and at most 100000 kg"
        )
    );
}

#[test]
fn shares_that_do_not_sum_to_one_are_refused() {
    let text = message("[0.35, 0.30, 0.20, 0.15]", "[0.35, 0.30, 0.20, 0.20]");
    assert!(
        text.contains(
            "axis X motor.friction.element_share = [0.35, 0.3, 0.2, 0.2]: the sum must be 1"
        ),
        "{text}"
    );
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    for bad in ["nan", "inf", "-inf"] {
        let text = message("gap_um = 5.0", &format!("gap_um = {bad}"));
        assert!(text.contains("axis X screw.gap_um"), "{text}");
    }
}

#[test]
fn missing_and_misspelt_keys_are_refused_with_line_and_axis() {
    let text = message("mass_kg = 150.0", "");
    assert!(
        text.starts_with("plant.toml:") && text.contains("axis Y") && text.contains("mass_kg"),
        "{text}"
    );
    let text = message("gap_um = 5.0", "gap_mu = 5.0");
    assert!(text.contains("axis X") && text.contains("gap_mu"), "{text}");
}

#[test]
fn an_axis_named_twice_is_refused() {
    let text = message("name = \"Y\"", "name = \"X\"");
    assert!(text.contains("axis X name"), "{text}");
}

#[test]
fn static_friction_below_coulomb_friction_is_refused() {
    let text = message("static_n = 260.0", "static_n = 160.0");
    assert!(
        text.contains("axis X table.friction.static_n = 160 N: must be at least coulomb_n = 200 N"),
        "{text}"
    );
}

#[test]
fn a_microstep_that_cannot_resolve_the_stiffness_is_refused() {
    let text = message("microstep_us = 25.0", "microstep_us = 250.0");
    assert!(text.contains("microstep_us = 250 µs"), "{text}");
    assert!(text.contains("axis X"), "{text}");
    let text = message("stiffness_n_per_m = 1.2e8", "stiffness_n_per_m = 9e9");
    assert!(
        text.contains("axis X") && text.contains("microstep_us"),
        "{text}"
    );
}

/// The message for the reference file with more tables of axis X.
fn message_with(tables: &str) -> String {
    message("[axis.scale]", &format!("{tables}\n[axis.scale]"))
}

#[test]
fn a_table_of_friction_of_which_no_curve_can_be_made_is_refused() {
    for (speeds, forces, says) in [
        (
            "-1, 2, 1",
            "-5, 6, 5",
            "speed_mm_s = [-1.0, 2.0, 1.0] mm/s: must rise",
        ),
        (
            "-1, 0, 1",
            "-5, 5, 5",
            "speed_mm_s = [-1.0, 0.0, 1.0] mm/s: must rise, and none must be 0",
        ),
        (
            "1, 2",
            "5, 6",
            "speed_mm_s has 0 speeds in negative direction: must be at least 1 and at most 16",
        ),
        (
            "-1, 1, 2",
            "-5, 5",
            "force_n has 2 values: must have 3, one for each of speed_mm_s",
        ),
        (
            "-1, 1",
            "-5, -6",
            "force_n = -6 N at 1 mm/s: friction must have the sign of the speed",
        ),
    ] {
        let text = message_with(&format!(
            "[axis.measured_friction]\nspeed_mm_s = [{speeds}]\nforce_n = [{forces}]\n"
        ));
        let says = format!("axis X measured_friction.{says}");
        assert!(text.contains(&says), "{text}\n{says}");
    }
}

#[test]
fn a_table_of_a_screw_that_is_none_is_refused() {
    for (places, errors, says) in [
        ("0, 10", "1", "error_um has 1 values: must have 2"),
        (
            "10, 0",
            "1, 2",
            "positions_mm must ascend: 0 comes after 10",
        ),
        ("0, 0", "1, 2", "positions_mm must ascend: 0 comes after 0"),
        ("0, nan", "1, 2", "positions_mm"),
    ] {
        let table = format!("positions_mm = [{places}]\nerror_um = [{errors}]\n");
        let text = message_with(&format!("[axis.pitch_error]\n{table}"));
        let says = format!("axis X pitch_error.{says}");
        assert!(text.contains(&says), "{text}\n{says}");
    }
}

#[test]
fn only_another_axis_of_the_file_disturbs_an_axis_and_each_once() {
    let from = |name: &str| format!("[[axis.cross_talk]]\nfrom = \"{name}\"\n");
    for name in ["X", "Z"] {
        let text = message_with(&from(name));
        let says = format!("cross_talk 1: from = {name:?}: must be another axis of this file");
        assert!(text.contains("axis X ") && text.contains(&says), "{text}");
    }
    let text = message_with(&(from("Y") + &from("Y")));
    assert!(
        text.contains("cross_talk 2: from = \"Y\" is there already"),
        "{text}"
    );
}

#[test]
fn a_microstep_that_cannot_resolve_what_swings_is_refused() {
    let swings = "mass_kg = 200.0\nfrequency_hz = 1000.0\n";
    let text = XY.replace("microstep_us = 25.0", "microstep_us = 50.0");
    let with = |table: &str| {
        let tables = format!("[axis.{table}]\n{swings}\n[axis.scale]");
        PlantFile::parse("plant.toml", &text.replacen("[axis.scale]", &tables, 1))
    };
    for (table, name) in [("frame", "frame"), ("attached_mass", "attached mass")] {
        let refused = with(table).unwrap_err().to_string() + "\n";
        let says = format!("too long for the {name} of axis X");
        assert!(refused.contains(&says), "{refused}");
    }
}

#[test]
fn files_that_are_no_text_or_too_long_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("plant.toml");
    std::fs::write(&file, [b'a', 0xff, 0xfe]).unwrap();
    assert!(
        PlantFile::load(&file)
            .unwrap_err()
            .to_string()
            .contains("not UTF-8")
    );
    std::fs::write(&file, vec![b'#'; (1 << 20) + 1]).unwrap();
    assert!(
        PlantFile::load(&file)
            .unwrap_err()
            .to_string()
            .contains("longer than 1048576 bytes")
    );
    std::fs::write(&file, "").unwrap();
    assert!(PlantFile::load(folder.path()).is_err());
    std::fs::remove_file(&file).unwrap();
    assert!(PlantFile::load(folder.path()).is_err());
}
