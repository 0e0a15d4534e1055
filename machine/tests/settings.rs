//! How a settings file is checked: everything that is wrong at once, each with its place and what would be right.

use std::path::{Path, PathBuf};

use machine::settings_file::{KeySchema, Kind};
use machine::{Machine, RapidProfile, WithinPeriod, schema};

/// A machine of one axis with what must be there alone.
const SHORTEST: &str = r#"name = "short"

[scan]
period_us = 1000
interpolation_period_scans = 8

[[axis]]
name = "X"
travel_min_mm = -10.0
travel_max_mm = 10
rapid_mm_s = 250.0
acceleration_mm_s2 = 5000.0
quick_stop_mm_s2 = 12000.0
following_error_limit_mm = 2.0
lead_mm = 10.0
motor = { rated_torque_nm = 8.0, peak_torque_nm = 32.0 }
position_loop = { gain_per_s = 50.0 }
velocity_loop = { gain_n_s_per_m = 259400.0, integral_time_ms = 10.0, period_us = 250 }
reversal.method = "none"
"#;

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../machines")
        .join(name)
}

/// What is said of the shortest file with pieces of its text replaced.
fn refused(edits: &[(&str, &str)]) -> Vec<String> {
    let text = edits.iter().fold(SHORTEST.to_string(), |text, (old, new)| {
        assert!(text.contains(old), "{old}");
        text.replace(old, new)
    });
    let error = Machine::parse("m.toml", &text).unwrap_err().to_string();
    error.lines().map(str::to_string).collect()
}

#[test]
fn every_machine_file_that_comes_with_the_product_loads() {
    for name in ["xy", "xy-fast", "xy-torque", "xyz-mill", "xzb-pivot"] {
        let machine = Machine::load(&shipped(name)).unwrap();
        assert_eq!(machine.name, name);
    }
}

#[test]
fn what_a_file_leaves_out_has_its_default() {
    let machine = Machine::parse("m.toml", SHORTEST).unwrap();
    assert_eq!(machine.scan.watchdog_scans, 4);
    assert_eq!(machine.scan.look_ahead_periods, 2);
    assert_eq!(
        (machine.manual.jog_mm_s, machine.restart.restarts_max),
        (10.0, 5)
    );
    assert_eq!(
        machine.positioning.profile,
        RapidProfile::ConstantAcceleration
    );
    assert_eq!(machine.interpolation.within_period, WithinPeriod::Exact);
    let axis = &machine.axes[0];
    assert_eq!((axis.increment_nm, axis.in_position_um), (1.0, 20.0));
    assert!(axis.feed_forward.enabled && !axis.standby && axis.model.is_none());
    assert_eq!(axis.feed_forward.coefficient, 1.0);
    assert_eq!(axis.torque_feed_forward.current_loop_ms, 0.16);
    // A table of which only a part is there.
    let text = format!("{SHORTEST}\n[axis.feed_forward]\nadvance_ms = 2.0\n");
    let machine = Machine::parse("m.toml", &text).unwrap();
    let forward = machine.axes[0].feed_forward;
    assert_eq!((forward.enabled, forward.advance_ms), (true, 2.0));
}

#[test]
fn everything_that_is_wrong_is_said_at_once_in_the_order_of_the_file() {
    let found = refused(&[
        ("period_us = 1000\n", "period_us = 1000.5\n"),
        ("rapid_mm_s = 250.0", "rapid_mm_s = -250.0"),
        ("lead_mm = 10.0\n", ""),
        ("gain_per_s", "gian_per_s"),
        ("\"none\"", "\"noone\""),
    ]);
    assert_eq!(
        found,
        [
            "m.toml:4: scan.period_us = 1000.5: must be a whole number",
            "m.toml:7: axis X: missing field `lead_mm`, or a table `transmission`",
            "m.toml:11: axis X rapid_mm_s = -250 mm/s: must be above 0 and at most 5000 mm/s",
            "m.toml:16: axis X position_loop: unknown field `gian_per_s`, expected `gain_per_s`",
            "m.toml:16: axis X position_loop: missing field `gain_per_s`",
            "m.toml:18: axis X reversal.method: unknown variant `noone`, expected one of `none`, `backlash`, `friction-pulse`, `contact-force`",
        ]
    );
}

#[test]
fn ranges_and_relations_of_keys_are_judged_together_each_key_once() {
    let found = refused(&[
        ("travel_max_mm = 10\n", "travel_max_mm = -200_000\n"),
        ("peak_torque_nm = 32.0", "peak_torque_nm = 4.0"),
        ("period_us = 250", "period_us = 300"),
        ("name = \"short\"", "name = \"Short!\""),
    ]);
    assert_eq!(
        found,
        [
            "m.toml:1: name = \"Short!\": must be 1 to 20 lower-case letters, digits or hyphens",
            "m.toml:10: axis X travel_max_mm = -200000 mm: must be above -10 and at most 100000 mm",
            "m.toml:16: axis X motor.peak_torque_nm = 4 N·m: must be at least rated_torque_nm = 8 N·m",
            "m.toml:18: axis X velocity_loop.period_us = 300 µs: must divide scan.period_us = 1000 µs",
        ]
    );
}

#[test]
fn setpoints_that_act_after_the_dead_time_must_be_known_ahead() {
    let scans = |number: &str, look_ahead: &str| {
        let new = format!(
            "interpolation_period_scans = 2\ndead_time_scans = {number}\nlook_ahead_periods = {look_ahead}"
        );
        [("interpolation_period_scans = 8".to_string(), new)]
    };
    let said = |number, look_ahead| {
        let edits = scans(number, look_ahead);
        let edits: Vec<_> = edits
            .iter()
            .map(|(a, b)| (a.as_str(), b.as_str()))
            .collect();
        refused(&edits)
    };
    assert_eq!(
        said("4", "2"),
        [
            "m.toml:6: scan.dead_time_scans = 4 scans: the setpoints of 5 scans must be known ahead, and \
             (look_ahead_periods − ½) · interpolation_period_scans = 3 are"
        ]
    );
    assert_eq!(
        said("9", "16"),
        ["m.toml:6: scan.dead_time_scans = 9 scans: must be at least 1 and at most 8 scans"]
    );
    let [(old, new)] = scans("4", "3");
    Machine::parse("m.toml", &SHORTEST.replace(&old, &new)).expect("five scans are known");
}

#[test]
fn a_file_without_an_axis_or_with_too_many_is_refused() {
    let (head, axis) = SHORTEST.split_at(SHORTEST.find("[[axis]]").unwrap());
    let message = |text: &str| Machine::parse("m.toml", text).unwrap_err().to_string();
    let found = message(head);
    assert!(
        found.starts_with("m.toml:1: missing field `axis`, with name, travel_min_mm"),
        "{found}"
    );
    let many = head.to_string() + &axis.repeat(33);
    let error = message(&many);
    assert!(
        error.contains("m.toml:7: axis has 33 values: must have 1 to 32"),
        "{error}"
    );
}

#[test]
fn text_that_is_no_toml_is_refused_line_by_line() {
    let found = refused(&[
        ("period_us = 1000\n", "period_us = \n"),
        ("lead_mm = 10.0", "lead_mm 10.0"),
    ]);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(
        found[0].starts_with("m.toml:4: ") && found[1].starts_with("m.toml:15: "),
        "{found:?}"
    );
}

#[test]
fn a_value_of_another_type_is_shown_as_the_file_has_it() {
    for (old, new, expected) in [
        (
            "period_us = 1000\n",
            "period_us = \"fast\"\n",
            "m.toml:4: scan.period_us = \"fast\": must be a whole number",
        ),
        (
            "lead_mm = 10.0",
            "lead_mm = true",
            "m.toml:15: axis X lead_mm = true: must be a number",
        ),
        (
            "name = \"short\"",
            "name = 5",
            "m.toml:1: name = 5: must be text in quotes",
        ),
        (
            "\"none\"",
            "3",
            "m.toml:19: axis X reversal.method = 3: must be text in quotes",
        ),
        (
            "position_loop = { gain_per_s = 50.0 }",
            "position_loop = 50.0",
            "m.toml:17: axis X position_loop = 50.0: must be a table",
        ),
        (
            "lead_mm = 10.0",
            "lead_mm = 99999999999999999999",
            "m.toml:15: axis X lead_mm = 99999999999999999999: has too many digits",
        ),
    ] {
        assert_eq!(refused(&[(old, new)]), [expected]);
    }
}

#[test]
fn a_key_or_word_that_had_another_name_is_told_its_present_one() {
    let found = refused(&[
        ("interpolation_period_scans", "distribution_period_scans"),
        (
            "reversal.method = \"none\"",
            "reversal = { method = \"kick\", kick_mm_s = 3.5, kick_ms = 10.0 }",
        ),
        (
            "[scan]",
            "[restart]\nmachine_side = \"wait\"\n[interpolation]\nrows = \"even\"\n[scan]",
        ),
    ]);
    assert_eq!(
        found,
        [
            "m.toml:4: restart.machine_side: is now called master",
            "m.toml:6: interpolation.rows: is now called within_period",
            "m.toml:9: scan.distribution_period_scans: is now called interpolation_period_scans",
            "m.toml:23: axis X reversal.kick_mm_s: is now called pulse_mm_s",
            "m.toml:23: axis X reversal.kick_ms: is now called pulse_ms",
            "m.toml:23: axis X reversal.method = \"kick\": is now called \"friction-pulse\"",
        ]
    );
    let found = refused(&[(
        "[scan]",
        "[interpolation]\nwithin_period = \"even\"\n[scan]",
    )]);
    assert_eq!(
        found,
        ["m.toml:4: interpolation.within_period = \"even\": is now called \"linear\""]
    );
}

#[test]
fn a_setting_that_nothing_would_act_on_is_refused() {
    let found = refused(&[("lead_mm = 10.0", "lead_mm = 10.0\ndual_feedback_ms = 5")]);
    let expected = "m.toml:16: axis X dual_feedback_ms = 5 ms: needs feedback = \"scale\"";
    assert!(found[0].starts_with(expected), "{found:?}");
}

/// Whoever adds a key without its range or its meaning hears it here.
#[test]
fn every_key_has_a_meaning_and_every_number_a_range() {
    fn judge(of_key: KeySchema<'_>, path: &str) {
        assert!(!of_key.meaning().is_empty(), "{path} has no meaning");
        let range = of_key.range();
        match of_key.kind() {
            Kind::Number | Kind::Whole => {
                assert!(
                    range.from.is_some() && range.high.is_some(),
                    "{path} has no range"
                );
            }
            Kind::Table => of_key
                .keys()
                .for_each(|(key, inner)| judge(inner, &format!("{path}.{key}"))),
            Kind::List => {
                let items = of_key.items().unwrap();
                let range = items.range();
                let has = matches!(items.kind(), Kind::Table | Kind::Text)
                    || (range.from.is_some() && range.high.is_some());
                assert!(has, "{path} has no range");
                items
                    .keys()
                    .for_each(|(key, inner)| judge(inner, &format!("{path}.{key}")));
            }
            Kind::Text | Kind::Flag => {}
        }
    }
    let schema = schema();
    for (key, of_key) in schema.root().keys() {
        judge(of_key, key);
    }
}

#[test]
fn an_axis_is_homed_by_what_it_has() {
    let with = |homing: &str| {
        let table = format!("homing = {{ {homing} }}\nreversal.method");
        refused(&[("reversal.method", &table)]).join("\n")
    };
    for (homing, says) in [
        (
            "method = \"switch\"",
            "homing.switch_input is missing: this method needs",
        ),
        (
            "method = \"drive\", switch_input = 3",
            "homing.switch_input = 3: this method looks at no switch",
        ),
        (
            "method = \"drive\", rest_mm = 9000.0",
            "homing.rest_mm = 9000 mm: must be at least -10 and at most 10 mm",
        ),
        (
            "method = \"index\", search_mm_s = 0.5",
            "homing.search_mm_s = 0.5 mm/s: must be at least 1 and at most 250 mm/s",
        ),
        (
            "method = \"switch\", switch_input = 64",
            "homing.switch_input = 64: must be at least 0 and at most 63",
        ),
        (
            "method = \"drive\", order = 0",
            "homing.order = 0: must be at least 1 and at most 8",
        ),
    ] {
        let said = with(homing);
        assert!(said.contains(says), "{homing}: {said}");
    }
    let by_scale = refused(&[(
        "reversal.method",
        "feedback = \"scale\"\nhoming = { method = \"index\" }\nreversal.method",
    )]);
    assert!(
        by_scale[0].contains("needs feedback = \"motor\""),
        "{by_scale:?}"
    );
    let text = SHORTEST.replace("reversal.", "homing.method = \"index\"\nreversal.");
    let machine = Machine::parse("m.toml", &text).unwrap();
    assert_eq!(machine.axes[0].search_distance_mm(), 22.0);
}
