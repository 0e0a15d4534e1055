//! `docs/python/quadrant_samples.py` is made from the samples themselves: whoever changes one makes it again, or this goes red.

use std::fmt::Write;
use std::mem::offset_of;

use bus::sample::{
    Answer, Auxiliaries, AxisCommand, AxisFeedback, BusCycle, Feedback, HandCourse, Inputs,
    Instruments, Levels, Participant, PathTag, PlannerStatus, ProgramEvent, Roster, WindowId,
};
use iceoryx2::prelude::ZeroCopySend;

/// What stands for a type in a `ctypes.Structure`.
trait Ctype {
    fn python() -> String;
}

macro_rules! ctypes {
    ($($type:ty => $name:literal),*) => {$(
        impl Ctype for $type {
            fn python() -> String {
                $name.into()
            }
        }
    )*};
}
ctypes!(u64 => "c_uint64", i64 => "c_int64", f64 => "c_double", u32 => "c_uint32", i32 => "c_int32");

impl<T: Ctype, const N: usize> Ctype for [T; N] {
    fn python() -> String {
        let of = T::python();
        match of.contains('*') {
            true => format!("({of}) * {N}"),
            false => format!("{of} * {N}"),
        }
    }
}

/// Size and ctype of a field, taken from the field itself.
fn of_field<S, T: Ctype>(_: fn(&S) -> &T) -> (usize, String) {
    (size_of::<T>(), T::python())
}

/// One structure: its fields in order, held against what the compiler laid out.
macro_rules! structure {
    ($text:ident, $type:ident { $($field:ident),* $(,)? }) => {
        impl Ctype for $type {
            fn python() -> String {
                stringify!($type).into()
            }
        }
        fn $text() -> String {
            let mut fields = String::new();
            let mut end = 0;
            $(
                let (size, ctype) = of_field(|sample: &$type| &sample.$field);
                let name = stringify!($field);
                assert_eq!(offset_of!($type, $field), end, "{}.{name} does not come next: is the table in order?", stringify!($type));
                let _ = writeln!(fields, "        (\"{name}\", {ctype}),  # at {end}");
                end += size;
            )*
            assert_eq!(end, size_of::<$type>(), "{}: a field is missing in the table", stringify!($type));
            // SAFETY: it only tells the name.
            let type_name = unsafe { <$type as ZeroCopySend>::type_name() };
            format!(
                "\n\nclass {0}(ctypes.Structure):\n    \"\"\"{end} bytes.\"\"\"\n\n    _fields_ = [\n{fields}    ]\n\n    @staticmethod\n    def type_name() -> str:\n        return \"{type_name}\"\n\n\nassert ctypes.sizeof({0}) == {end}\n",
                stringify!($type)
            )
        }
    };
}

structure!(
    window_id,
    WindowId {
        checksum,
        sequence,
        incarnation
    }
);
structure!(
    path_tag,
    PathTag {
        distance_mm,
        element,
        dwell_remaining_scans
    }
);
structure!(
    hand_course,
    HandCourse {
        command,
        lead,
        lead_step,
        step,
        goal,
        step_max,
        next_goal,
        next_step_max,
        step_change_max,
        follows_by,
        changes_in,
        reserved,
    }
);
structure!(
    axis_feedback,
    AxisFeedback {
        motor_position,
        scale_position,
        command_position,
        hand,
        command_scan,
        velocity_mm_s,
        velocity_command_mm_s,
        torque_nm,
        winding_k,
        missed_scans,
        missed_in_a_row,
        taken_incarnation,
        taken_role,
        cause,
        torque_limited,
        driver,
        drive_code,
        redundancy,
        unsynchronised_scans,
        differences,
        reference,
    }
);
structure!(
    levels,
    Levels {
        spindle_rpm,
        orientation_deg,
        analog,
        digital,
        spindle,
        coolant,
        tool,
        tool_prepared,
        followed_axis,
        blocks_done,
    }
);
structure!(
    auxiliaries,
    Auxiliaries {
        levels,
        spindle_rpm,
        spindle_turns,
        spindle_lag_turns,
        events_done,
        line,
        waiting,
        blocked,
        at_speed,
        optional_stop,
        override_disabled,
        tool,
        coupled,
        start_line,
        tool_offset_of,
        modes_of_run,
        tool_offset,
    }
);
structure!(
    program_event,
    ProgramEvent {
        value,
        number,
        code,
        index,
        line,
        element,
        reserved,
    }
);
structure!(
    feedback,
    Feedback {
        scan,
        visible_from,
        window,
        armed,
        voided,
        program_hash,
        tag,
        interrupted_at,
        cause_scan,
        program_start,
        setpoint,
        at_rest,
        epoch,
        incarnation,
        mode,
        cause,
        cause_axis,
        override_percent,
        hold,
        last,
        overrun_scans,
        axis_count,
        load,
        program,
        run,
        messages,
        rested,
        reserved,
        auxiliary,
        answer,
        inputs,
        axes,
        checksum,
    }
);
structure!(
    instruments,
    Instruments {
        scan,
        visible_from,
        motion_digest_high,
        motion_digest_low,
        subsamples,
        axis_count,
        table_mm,
        motor_mm,
    }
);
structure!(
    bus_cycle,
    BusCycle {
        scan,
        visible_from,
        sent,
        missed,
        short,
        late,
        foreign,
        repeated,
        round_trip_ns,
        clock_offset_ns,
        inputs,
        answered,
        distributed_clocks,
        slaves_operational,
        slave_count,
    }
);
structure!(
    answer,
    Answer {
        value,
        scan,
        tripped,
        rests,
        number,
        outcome,
    }
);
structure!(
    inputs,
    Inputs {
        analog,
        digital,
        contact,
        panel,
    }
);
structure!(
    axis_command,
    AxisCommand {
        scan,
        visible_from,
        position,
        velocity_mm_s,
        torque_nm,
        feed_forward_mm_s,
        following_error_mm,
        stop_deceleration_mm_s2,
        compensation_mm,
        friction_pulse_mm_s,
        torque_feed_forward_nm,
        torque_cut_nm,
        friction_level,
        friction_unexplained,
        held,
        pending,
        refused,
        tag,
        state,
        axis,
        role,
        incarnation,
        drive_mode,
        cause,
        hand,
        ahead_scans,
        reserved,
        checksum,
    }
);
structure!(
    planner_status,
    PlannerStatus {
        scan,
        visible_from,
        program_hash,
        published,
        path_length_mm,
        path_done_mm,
        incarnation,
        finished,
        cause,
        windows,
        load,
        line,
        answered,
        messages,
        event,
        outputs_ahead,
        checksum,
    }
);
structure!(
    participant,
    Participant {
        death_scan,
        job,
        axis,
        role,
        incarnation,
        live,
        death_signal,
        death_status,
        stalled,
    }
);
structure!(
    roster,
    Roster {
        version,
        visible_from,
        participants,
        checksum,
    }
);

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
    let structures = [
        window_id,
        path_tag,
        hand_course,
        axis_feedback,
        levels,
        auxiliaries,
        answer,
        inputs,
        feedback,
        instruments,
        bus_cycle,
        axis_command,
        program_event,
        planner_status,
        participant,
        roster,
    ];
    let text: String = structures.iter().map(|structure| structure()).collect();
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
