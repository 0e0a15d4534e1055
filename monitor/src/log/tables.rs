//! The fields of every sample, by name. A field that is added to a sample and not here does not compile.

use bus::sample::{
    AxisCommand, AxisFeedback, ControllerState, Feedback, Instruments, ManualState, Participant,
    PathTag, PlannerStatus, Roster, WindowHeader, WindowId, WindowRow,
};

use super::layout::table;

table!(WindowId: checksum, sequence, incarnation);
table!(PathTag: distance_mm, element, dwell_remaining_scans);
table!(WindowRow: position @ Axes, tag);
table!(
    WindowHeader: id, predecessor, first_scan, visible_from, program_hash, epoch, intended_rows, row_count,
    ends_program,
);
table!(
    AxisFeedback: motor_position, scale_position, command_register, jog_target, command_scan, velocity_mm_s,
    velocity_command_mm_s, torque_nm, winding_k, missed_scans, missed_in_a_row, taken_incarnation, taken_role, cause,
    torque_limited, driver, drive_code,
);
table!(
    Feedback: scan, visible_from, window, armed, voided, program_hash, tag, left_at, cause_scan, program_start @ Axes, row, at_rest, epoch, incarnation, mode,
    cause, cause_axis, override_percent, hold, last, overrun_scans, axis_count, load, program, run, reserved, axes @ Axes,
);
table!(
    Instruments: scan, visible_from, motion_digest_high, motion_digest_low, subsamples, axis_count,
    table_mm @ AxesAndSubsamples, motor_mm @ AxesAndSubsamples,
);
table!(
    ControllerState: command_position, feedback_position, command_position_before, scan, period_start,
    period_start_before, backlash_mm, integrator_nm, velocity_mm_s, trigger_speed_mm_s, kick_mm_s,
    kick_trigger_mm_s, kick_distance_mm, observer_n, motor_position, scale_correction_mm, kick_remaining_scans, armed, direction, torque_limited_scans, kicks,
    initialised, cause, kick_direction, torque_feed_forward_nm, inverse_dynamics, manual,
);
table!(
    ManualState: command_position, goal, step, steady_deviation, stored_error, fade_mm_s, return_mm_s, drove, phase,
    settled_scans, waited_scans,
);
table!(
    AxisCommand: scan, visible_from, position, velocity_mm_s, torque_nm, feed_forward_mm_s, following_error_mm,
    stop_deceleration_mm_s2, held, pending, refused, tag, state, axis, role, incarnation, drive_mode, cause, jog_done,
);
table!(
    PlannerStatus: scan, visible_from, program_hash, published, path_length_mm, path_done_mm, incarnation, finished,
    cause, windows, load, reserved,
);
table!(
    Participant: death_scan, job, axis, role, incarnation, live, death_signal, death_status, stalled,
);
table!(Roster: version, visible_from, participants);
