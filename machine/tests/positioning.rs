//! Rapids at least heat, and the model that they are computed from.

use machine::settings_file::read_text;
use machine::{Machine, RapidProfile};

/// A shipped machine without what it knows of its axes.
fn plain() -> String {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy/machine.toml");
    let mut document: toml_edit::DocumentMut = read_text(&path).unwrap().parse().unwrap();
    let axes = document["axis"].as_array_of_tables_mut().unwrap();
    for axis in axes.iter_mut() {
        axis.remove("model");
        axis.remove("torque_feed_forward");
        axis.remove("adaptation");
        axis["reversal"]["method"] = toml_edit::value("backlash");
    }
    document.to_string()
}

/// The shipped machine with a model for each axis and a profile.
fn with(profile: &str, model: &str) -> Result<Machine, String> {
    let text = plain()
        .replace(
            "[scan]",
            &format!("[positioning]\nprofile = \"{profile}\"\n\n[scan]"),
        )
        .replace(
            "[axis.position_loop]",
            &format!("{model}\n[axis.position_loop]"),
        );
    Machine::parse("m.toml", &text).map_err(|error| error.to_string())
}

#[test]
fn without_the_table_rapids_are_as_fast_as_the_limits() {
    let machine = Machine::parse("m.toml", &plain()).unwrap();
    assert_eq!(
        machine.positioning.profile,
        RapidProfile::ConstantAcceleration
    );
    assert_eq!(machine.axes[0].model, None);
}

#[test]
fn least_heat_without_a_model_says_what_to_add() {
    let error = with("minimum-heat", "").unwrap_err();
    assert!(
        error.contains(
            "positioning.profile = \"minimum-heat\": axis X has no [axis.model]: add its mass_kg"
        ),
        "{error}"
    );
    assert!(error.contains("axis Y has no [axis.model]"), "{error}");
    assert!(with("constant-acceleration", "").is_ok());
    assert!(with("fast", "").unwrap_err().contains("minimum-heat"));
}

#[test]
fn a_model_is_read_and_its_numbers_are_judged() {
    let good = "[axis.model]\nmass_kg = 858.0\ncoulomb_n = 451.0\nviscous_n_s_per_m = 2580.0\n";
    let machine = with("minimum-heat", good).unwrap();
    let axis = &machine.axes[0];
    assert_eq!(axis.model.unwrap().mass_kg, 858.0);
    assert!((axis.rated_force_n() - 5026.5).abs() < 0.1);
    for (bad, message) in [
        (
            "[axis.model]\nmass_kg = 0.0\ncoulomb_n = 1.0\n",
            "axis X model.mass_kg = 0 kg: must be above 0",
        ),
        (
            "[axis.model]\nmass_kg = nan\ncoulomb_n = 1.0\n",
            "model.mass_kg = NaN kg",
        ),
        (
            "[axis.model]\nmass_kg = 1.0\ncoulomb_n = -1.0\n",
            "model.coulomb_n = -1 N: must be at least 0",
        ),
        (
            "[axis.model]\nmass_kg = 1.0\ncoulomb_n = 5027.0\n",
            "model.coulomb_n = 5027 N: must be below 5027 N",
        ),
        ("[axis.model]\nmass_kg = 1.0\n", "missing field `coulomb_n`"),
        (
            "[axis.model]\nmass_kg = 1.0\ncoulomb_n = 1.0\nweight = 1\n",
            "unknown field",
        ),
    ] {
        let error = with("minimum-heat", bad).unwrap_err();
        assert!(error.contains(message), "{error}");
    }
}
