//! Parameters by number: those of the program, those of the system, and those that only Fanuc's language has.

use crate::common::{on_mill, refusal};

fn value(parameter: &str, before: &str) -> f64 {
    let program = on_mill(&format!("{before}\n#<_seen>={parameter}\nM2"));
    let program = program.unwrap_or_else(|error| panic!("{parameter}: {error}"));
    program.parameters.named("_seen").unwrap()
}

#[test]
fn parameters_of_the_program_are_0_until_they_are_set() {
    for number in [1, 30, 31, 100, 499, 999, 1036, 1200, 1999, 3100, 5000] {
        assert_eq!(value(&format!("#{number}"), ""), 0.0);
        assert_eq!(value(&format!("#{number}"), &format!("#{number}=7")), 7.0);
    }
}

#[test]
fn parameters_of_the_system_can_be_read_and_those_that_tell_of_the_machine_not_be_set() {
    for number in (5061..=5070)
        .chain(5161..=5169)
        .chain(5210..=5230)
        .chain(5381..=5390)
        .chain([5399, 5599])
    {
        value(&format!("#{number}"), "");
        value(&format!("#{number}"), &format!("#{number}=1"));
    }
    for number in (5400..=5413).chain(5420..=5428) {
        value(&format!("#{number}"), "");
        let error = refusal(&format!("#{number}=1\nM2"));
        assert!(
            error.contains("1:1") && error.contains("read-only"),
            "{error}"
        );
    }
    assert_eq!(value("#5599", ""), 1.0);
}

/// Number, whether a program may use it as its own, and what is said instead.
const FOREIGN: [(u32, bool, &str); 21] = [
    (1000, true, "M66"),
    (1035, true, "M66"),
    (1132, true, "M64"),
    (2001, true, "G10"),
    (2500, true, "G10"),
    (3000, false, "(ABORT, text)"),
    (3001, false, "G4"),
    (3003, false, "M49"),
    (3006, false, "(MSG, text), and M0"),
    (3011, false, "no clock"),
    (3901, true, "parameter file"),
    (4001, true, "#<_motion_mode>"),
    (4120, true, "#<_current_tool>"),
    (5001, false, "#5420"),
    (5021, false, "#<_abs_x>"),
    (5041, false, "#5420"),
    (5101, false, "#5061 to #5070"),
    (5201, false, "#5210 to #5390"),
    (5231, false, "#5210 to #5390"),
    (5600, false, "#5599"),
    (5602, false, "#5599"),
];

#[test]
fn a_system_variable_that_there_is_not_is_refused_with_what_would_be_right() {
    for (number, own, right) in FOREIGN {
        let error = refusal(&format!("G0 X1\nG1 X#{number} F100\nM2"));
        assert!(
            error.contains(&format!("2:5: #{number}, which is")),
            "{error}"
        );
        assert!(error.contains(right), "{error}");
        let set = format!("#{number} = 1 (TEXT)\n#<_seen>=#{number}\nM2");
        match own {
            true => assert_eq!(on_mill(&set).unwrap().parameters.named("_seen"), Some(1.0)),
            false => {
                let error = refusal(&set);
                assert!(
                    error.contains(&format!("1:1: #{number}, which is")),
                    "{error}"
                );
                assert!(error.contains(right), "{error}");
            }
        }
    }
}

#[test]
fn what_would_act_in_fanucs_language_is_noted_where_it_is_set() {
    let notes = on_mill("#1200=1\n#1132=255\n#2001=3\nM2").unwrap().notes;
    assert!(
        notes.iter().any(|note| (note.line, note.count) == (2, 2)),
        "{notes:?}"
    );
}

#[test]
fn names_that_nobody_has_set_are_refused_and_those_of_the_machine_cannot_be_set() {
    for (name, right) in [
        ("#<depth>", "EXISTS"),
        ("#<_depth>", "EXISTS"),
        ("#<_hal[axis.0.pos]>", "M66"),
        ("#<_ini[axis]x>", "parameter of your own"),
    ] {
        let error = refusal(&format!("G0 X{name}\nM2"));
        assert!(
            error.contains("has no value") && error.contains(right),
            "{error}"
        );
    }
    for name in ["#<_metric>", "#<_x>", "#<_current_tool>"] {
        let error = refusal(&format!("{name}=1\nM2"));
        assert!(
            error.contains("1:1") && error.contains("read-only"),
            "{error}"
        );
    }
    assert_eq!(value("#<_depth>", "#<_depth>=3"), 3.0);
    assert_eq!(value("EXISTS[#3000]", ""), 0.0);
}

#[test]
fn what_is_not_known_behind_a_mistake_is_no_second_mistake() {
    let error = refusal("G1 X1\n#1=#4001\n#5021=3\nM2");
    assert!(!error.contains("#4001"), "{error}");
    assert!(error.contains("1:"), "{error}");
}
