//! Rotary axes in their own units, and transmissions in place of a lead.

use machine::Machine;

/// A machine of a rotary axis in its own units.
const TABLE: &str = include_str!("own-units.toml");

/// What one unit about the axis is of the slide that travels 1 mm per degree.
const N_PER_NM: f64 = 1000.0 * std::f64::consts::PI / 180.0;

fn refused(edits: &[(&str, &str)]) -> String {
    let text = edits.iter().fold(TABLE.to_string(), |text, (old, new)| {
        assert!(text.contains(old), "{old}");
        text.replace(old, new)
    });
    Machine::parse("m.toml", &text)
        .expect_err("a bad file")
        .to_string()
}

#[test]
fn a_rotary_axis_in_its_own_units_is_the_slide_that_stands_for_it() {
    let axis = Machine::parse("m.toml", TABLE)
        .expect("a good file")
        .axes
        .remove(0);
    assert_eq!(
        (axis.travel_min_mm, axis.travel_max_mm, axis.rapid_mm_s),
        (-360.0, 360.0, 120.0)
    );
    assert_eq!((axis.lead_mm, axis.in_position_um), (4.0, 5.0));
    let near = |is: f64, must: f64| assert!((is / must - 1.0).abs() < 1e-12, "{is} {must}");
    near(
        axis.velocity_loop.gain_n_s_per_m,
        240.5 * N_PER_NM * N_PER_NM,
    );
    let model = axis.model.expect("a model");
    near(model.mass_kg, 0.8 * N_PER_NM * N_PER_NM);
    near(model.coulomb_n, 10.0 * N_PER_NM);
    near(model.viscous_n_s_per_m, 0.5 * N_PER_NM * N_PER_NM);
    assert_eq!(model.friction.expect("a curve").stribeck_mm_s, 2.0);
}

#[test]
fn what_is_wrong_is_said_by_the_names_and_in_the_units_of_the_axis() {
    let said = refused(&[("rapid_deg_s = 120.0", "rapid_deg_s = -1")]);
    assert_eq!(
        said,
        "m.toml:12: axis A rapid_deg_s = -1 °/s: must be above 0 and at most 5000 °/s"
    );
    let said = refused(&[("travel_max_deg = 360", "travel_max_deg = -400")]);
    assert!(
        said.starts_with("m.toml:11: axis A travel_max_deg = -400 °: must be above -360"),
        "{said}"
    );
    let said = refused(&[("inertia_kg_m2 = 0.8", "inertia_kg_m2 = -1")]);
    assert!(
        said.starts_with("m.toml:28: axis A model.inertia_kg_m2 = -1 kg·m²: must be"),
        "{said}"
    );
    let said = refused(&[("rapid_deg_s = 120.0\n", "")]);
    assert_eq!(said, "m.toml:7: axis A: missing field `rapid_deg_s`");
    let said = refused(&[(
        "rapid_deg_s = 120.0",
        "rapid_deg_s = 120.0\nrapid_mm_s = 3.0",
    )]);
    assert!(
        said.contains("rapid_deg_s: is there as `rapid_mm_s` too"),
        "{said}"
    );
    let said = refused(&[("kind = \"rotary\"\n", "")]);
    assert!(said.contains("travel_min_deg: is a key of a rotary axis (kind = \"rotary\"); of this one it is `travel_min_mm`"), "{said}");
}

#[test]
fn a_transmission_is_one_thing_and_goes_without_a_lead() {
    let other = |of: &str| refused(&[("{ gear_ratio = 90 }", of)]);
    let said = other("{ screw_lead_mm = 5.0 }");
    assert!(
        said.contains("axis A transmission of a rotary axis has gear_ratio alone"),
        "{said}"
    );
    let said = refused(&[("transmission =", "lead_deg = 4.0\ntransmission =")]);
    assert!(
        said.contains("transmission goes without `lead_mm`"),
        "{said}"
    );
    let said = refused(&[("transmission = { gear_ratio = 90 }\n", "")]);
    assert!(
        said.contains("missing field `lead_deg`, or a table `transmission`"),
        "{said}"
    );
}
