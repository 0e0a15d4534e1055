//! `docs/python/quadrant_samples.py` is made from the tables of the samples: a change of one makes it again, or this goes red.

use std::fmt::Write;

use bus::layout::{Kind, Wire};
use bus::sample::{
    Answer, Auxiliaries, AxisCommand, AxisFeedback, BusCycle, Feedback, HandCourse, Inputs,
    Instruments, Levels, Participant, PathTag, PlannerStatus, ProgramEvent, Roster, WindowId,
};
use iceoryx2::prelude::ZeroCopySend;

/// What stands for a field in a `ctypes.Structure`.
fn ctype(kind: &Kind) -> String {
    match kind {
        Kind::Number("float64", _) => "c_double".into(),
        Kind::Number(number, _) => format!("c_{number}"),
        Kind::Struct(table) => table.name.into(),
        Kind::Array(element @ Kind::Array(..), count) => format!("({}) * {count}", ctype(element)),
        Kind::Array(element, count) => format!("{} * {count}", ctype(element)),
    }
}

/// One structure, whose table the compiler has held against the sample.
fn class<T: Wire + ZeroCopySend>() -> String {
    let Kind::Struct(table) = T::KIND else {
        panic!("a sample is a struct")
    };
    let (name, bytes) = (table.name, table.bytes);
    // SAFETY: it only tells the name.
    let type_name = unsafe { <T as ZeroCopySend>::type_name() };
    let mut fields = String::new();
    for field in table.fields {
        let (name, ctype, offset) = (field.name, ctype(&field.kind), field.offset);
        let _ = writeln!(fields, "        (\"{name}\", {ctype}),  # at {offset}");
    }
    format!(
        "\n\nclass {name}(ctypes.Structure):\n    \"\"\"{bytes} bytes.\"\"\"\n\n    _fields_ = [\n{fields}    ]\n\n    @staticmethod\n    def type_name() -> str:\n        return \"{type_name}\"\n\n\nassert ctypes.sizeof({name}) == {bytes}\n"
    )
}

const HEAD: &str = "\
\"\"\"The samples of a quadrant cell as ctypes structures, in the layout in which they lie in shared memory.

Made by `UPDATE=1 cargo test -p bus --test python_layout`; do not edit. Units stand in the names; positions are in increments
(`increment_nm` in the machine file, 1 nm or 1 microdegree by default).
\"\"\"

import ctypes
from ctypes import c_double, c_int32, c_int64, c_uint32, c_uint64
";

#[test]
fn the_python_structures_have_the_layout_and_the_names_of_the_samples() {
    let classes = [
        class::<WindowId>(),
        class::<PathTag>(),
        class::<HandCourse>(),
        class::<AxisFeedback>(),
        class::<Levels>(),
        class::<Auxiliaries>(),
        class::<Answer>(),
        class::<Inputs>(),
        class::<Feedback>(),
        class::<Instruments>(),
        class::<BusCycle>(),
        class::<AxisCommand>(),
        class::<ProgramEvent>(),
        class::<PlannerStatus>(),
        class::<Participant>(),
        class::<Roster>(),
    ];
    let text = classes.concat();
    let expected = format!("{HEAD}{text}");
    let file =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/python/quadrant_samples.py");
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&file, &expected).expect("writing it");
    }
    let found = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(
        found == expected,
        "docs/python/quadrant_samples.py is not what the samples are: UPDATE=1 cargo test -p bus --test python_layout"
    );
}
