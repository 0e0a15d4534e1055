//! The fields of every sample, by name. A field that is added to a sample and not here does not compile.

use crate::sample::{
    Answer, Auxiliaries, AxisCommand, AxisFeedback, BusCycle, Feedback, HandCourse, Inputs,
    Instruments, Levels, OperatorRequest, Participant, PathTag, PlannerStatus, ProgramEvent,
    Roster, Setpoint, WindowHeader, WindowId,
};
use crate::table;

table!(WindowId: checksum, sequence, incarnation);
table!(PathTag: distance_mm, element, dwell_remaining_scans);
table!(Setpoint: position @ Axes, tag);
table!(
    WindowHeader: id, predecessor, first_scan, visible_from, program_hash, epoch, intended_setpoints, setpoint_count,
    ends_program,
);
table!(
    HandCourse: command, lead, lead_step, step, goal, step_max, next_goal, next_step_max, step_change_max, follows_by,
    changes_in, reserved,
);
table!(
    AxisFeedback: motor_position, scale_position, command_position, hand, command_scan, velocity_mm_s,
    velocity_command_mm_s, torque_nm, winding_k, missed_scans, missed_in_a_row, taken_incarnation, taken_role, cause,
    torque_limited, driver, drive_code, redundancy, unsynchronised_scans, differences, reference,
);
table!(
    Feedback: scan, visible_from, window, armed, voided, program_hash, tag, interrupted_at, cause_scan, program_start @ Axes, setpoint, at_rest, epoch, incarnation, mode,
    cause, cause_axis, override_percent, hold, last, overrun_scans, axis_count, load, program, run, messages, rested, reserved, auxiliary, answer, inputs, axes @ Axes, checksum,
);
table!(
    Instruments: scan, visible_from, motion_digest_high, motion_digest_low, subsamples, axis_count,
    table_mm @ AxesAndSubsamples, motor_mm @ AxesAndSubsamples,
);
table!(
    BusCycle: scan, visible_from, sent, missed, short, late, foreign, repeated, round_trip_ns, clock_offset_ns,
    inputs @ Axes, answered, distributed_clocks, slaves_operational, slave_count,
);
table!(
    AxisCommand: scan, visible_from, position, velocity_mm_s, torque_nm, feed_forward_mm_s, following_error_mm,
    stop_deceleration_mm_s2, compensation_mm, friction_pulse_mm_s, torque_feed_forward_nm, torque_cut_nm, friction_level, friction_unexplained, held, pending, refused, tag, state, axis, role, incarnation, drive_mode, cause, hand, ahead_scans, reserved, checksum,
);
table!(
    PlannerStatus: scan, visible_from, program_hash, published, path_length_mm, path_done_mm, incarnation, finished,
    cause, windows, load, line, answered, messages, event, outputs_ahead, checksum,
);
table!(ProgramEvent: value, number, code, index, line, element, reserved);
table!(
    Levels: spindle_rpm, orientation_deg, analog, digital, spindle, coolant, tool, tool_prepared, followed_axis,
    blocks_done,
);
table!(
    Auxiliaries: levels, spindle_rpm, spindle_turns, spindle_lag_turns, events_done, line, waiting, blocked, at_speed,
    optional_stop, override_disabled, tool, coupled, start_line,
    tool_offset_of, modes_of_run, tool_offset,
);
table!(Answer: value, scan, tripped @ Axes, rests @ Axes, number, outcome);
table!(Inputs: analog, digital, contact, panel);
table!(
    Participant: death_scan, job, axis, role, incarnation, live, death_signal, death_status, stalled,
);
table!(Roster: version, visible_from, participants, checksum);
table!(
    OperatorRequest: order, axis, value, speed_mm_s, latest_scan, session, deadline_scans, count, velocity_mode,
    line_mm @ Axes,
);
