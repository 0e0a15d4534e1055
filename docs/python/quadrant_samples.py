"""The samples of a quadrant cell as ctypes structures, in the layout in which they lie in shared memory.

Made by `UPDATE=1 cargo test -p bus --test python_layout`; do not edit. Units stand in the names; positions are in increments
(`increment_nm` in the machine file, 1 nm or 1 microdegree by default).
"""

import ctypes
from ctypes import c_double, c_int32, c_int64, c_uint32, c_uint64


class WindowId(ctypes.Structure):
    """16 bytes."""

    _fields_ = [
        ("checksum", c_uint64),  # at 0
        ("sequence", c_uint32),  # at 8
        ("incarnation", c_uint32),  # at 12
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/WindowId/1"


assert ctypes.sizeof(WindowId) == 16


class PathTag(ctypes.Structure):
    """16 bytes."""

    _fields_ = [
        ("distance_mm", c_double),  # at 0
        ("element", c_uint32),  # at 8
        ("dwell_remaining_scans", c_uint32),  # at 12
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/PathTag/1"


assert ctypes.sizeof(PathTag) == 16


class HandCourse(ctypes.Structure):
    """88 bytes."""

    _fields_ = [
        ("command", c_int64),  # at 0
        ("lead", c_int64),  # at 8
        ("lead_step", c_int64),  # at 16
        ("step", c_int64),  # at 24
        ("goal", c_int64),  # at 32
        ("step_max", c_int64),  # at 40
        ("next_goal", c_int64),  # at 48
        ("next_step_max", c_int64),  # at 56
        ("step_change_max", c_int64),  # at 64
        ("follows_by", c_double),  # at 72
        ("changes_in", c_uint32),  # at 80
        ("reserved", c_uint32),  # at 84
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/HandCourse/1"


assert ctypes.sizeof(HandCourse) == 88


class AxisFeedback(ctypes.Structure):
    """200 bytes."""

    _fields_ = [
        ("motor_position", c_int64),  # at 0
        ("scale_position", c_int64),  # at 8
        ("command_position", c_int64),  # at 16
        ("hand", HandCourse),  # at 24
        ("command_scan", c_uint64),  # at 112
        ("velocity_mm_s", c_double),  # at 120
        ("velocity_command_mm_s", c_double),  # at 128
        ("torque_nm", c_double),  # at 136
        ("winding_k", c_double),  # at 144
        ("missed_scans", c_uint32),  # at 152
        ("missed_in_a_row", c_uint32),  # at 156
        ("taken_incarnation", c_uint32),  # at 160
        ("taken_role", c_uint32),  # at 164
        ("cause", c_uint32),  # at 168
        ("torque_limited", c_uint32),  # at 172
        ("driver", c_uint32),  # at 176
        ("drive_code", c_uint32),  # at 180
        ("redundancy", c_uint32),  # at 184
        ("unsynchronised_scans", c_uint32),  # at 188
        ("differences", c_uint32),  # at 192
        ("reference", c_uint32),  # at 196
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/AxisFeedback/4"


assert ctypes.sizeof(AxisFeedback) == 200


class Levels(ctypes.Structure):
    """112 bytes."""

    _fields_ = [
        ("spindle_rpm", c_double),  # at 0
        ("orientation_deg", c_double),  # at 8
        ("analog", c_double * 8),  # at 16
        ("digital", c_uint64),  # at 80
        ("spindle", c_uint32),  # at 88
        ("coolant", c_uint32),  # at 92
        ("tool", c_uint32),  # at 96
        ("tool_prepared", c_uint32),  # at 100
        ("followed_axis", c_uint32),  # at 104
        ("blocks_done", c_uint32),  # at 108
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/Levels/3"


assert ctypes.sizeof(Levels) == 112


class Auxiliaries(ctypes.Structure):
    """256 bytes."""

    _fields_ = [
        ("levels", Levels),  # at 0
        ("spindle_rpm", c_double),  # at 112
        ("spindle_turns", c_double),  # at 120
        ("spindle_lag_turns", c_double),  # at 128
        ("events_done", c_uint32),  # at 136
        ("line", c_uint32),  # at 140
        ("waiting", c_uint32),  # at 144
        ("blocked", c_uint32),  # at 148
        ("at_speed", c_uint32),  # at 152
        ("optional_stop", c_uint32),  # at 156
        ("override_disabled", c_uint32),  # at 160
        ("tool", c_uint32),  # at 164
        ("coupled", c_uint32),  # at 168
        ("start_line", c_uint32),  # at 172
        ("tool_offset_of", c_uint32),  # at 176
        ("modes_of_run", c_uint32),  # at 180
        ("tool_offset", c_double * 9),  # at 184
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/Auxiliaries/7"


assert ctypes.sizeof(Auxiliaries) == 256


class Answer(ctypes.Structure):
    """168 bytes."""

    _fields_ = [
        ("value", c_double),  # at 0
        ("scan", c_uint64),  # at 8
        ("tripped", c_int64 * 9),  # at 16
        ("rests", c_int64 * 9),  # at 88
        ("number", c_uint32),  # at 160
        ("outcome", c_uint32),  # at 164
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/Answer/2"


assert ctypes.sizeof(Answer) == 168


class Inputs(ctypes.Structure):
    """80 bytes."""

    _fields_ = [
        ("analog", c_double * 8),  # at 0
        ("digital", c_uint64),  # at 64
        ("contact", c_uint32),  # at 72
        ("panel", c_uint32),  # at 76
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/Inputs/2"


assert ctypes.sizeof(Inputs) == 80


class Feedback(ctypes.Structure):
    """7224 bytes."""

    _fields_ = [
        ("scan", c_uint64),  # at 0
        ("visible_from", c_uint64),  # at 8
        ("window", WindowId),  # at 16
        ("armed", WindowId),  # at 32
        ("voided", WindowId),  # at 48
        ("program_hash", c_uint64),  # at 64
        ("tag", PathTag),  # at 72
        ("interrupted_at", PathTag),  # at 88
        ("cause_scan", c_uint64),  # at 104
        ("program_start", c_int64 * 9),  # at 112
        ("setpoint", c_uint32),  # at 184
        ("at_rest", c_uint32),  # at 188
        ("epoch", c_uint32),  # at 192
        ("incarnation", c_uint32),  # at 196
        ("mode", c_uint32),  # at 200
        ("cause", c_uint32),  # at 204
        ("cause_axis", c_uint32),  # at 208
        ("override_percent", c_uint32),  # at 212
        ("hold", c_uint32),  # at 216
        ("hold_reason", c_uint32),  # at 220
        ("logic_losses", c_uint32),  # at 224
        ("last", c_uint32),  # at 228
        ("overrun_scans", c_uint32),  # at 232
        ("axis_count", c_uint32),  # at 236
        ("load", c_uint32),  # at 240
        ("program", c_uint32),  # at 244
        ("run", c_uint32),  # at 248
        ("messages", c_uint32),  # at 252
        ("rested", c_uint32),  # at 256
        ("path_axes", c_uint32),  # at 260
        ("ended", EndedRun),  # at 264
        ("auxiliary", Auxiliaries),  # at 312
        ("answer", Answer),  # at 568
        ("inputs", Inputs),  # at 736
        ("axes", AxisFeedback * 32),  # at 816
        ("checksum", c_uint64),  # at 7216
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/Feedback/14"


assert ctypes.sizeof(Feedback) == 7224


class Instruments(ctypes.Structure):
    """4136 bytes."""

    _fields_ = [
        ("scan", c_uint64),  # at 0
        ("visible_from", c_uint64),  # at 8
        ("motion_digest_high", c_uint64),  # at 16
        ("motion_digest_low", c_uint64),  # at 24
        ("subsamples", c_uint32),  # at 32
        ("axis_count", c_uint32),  # at 36
        ("axes", AxisInstruments * 32),  # at 40
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/Instruments/2"


assert ctypes.sizeof(Instruments) == 4136


class BusCycle(ctypes.Structure):
    """360 bytes."""

    _fields_ = [
        ("scan", c_uint64),  # at 0
        ("visible_from", c_uint64),  # at 8
        ("sent", c_uint64),  # at 16
        ("missed", c_uint64),  # at 24
        ("short", c_uint64),  # at 32
        ("late", c_uint64),  # at 40
        ("foreign", c_uint64),  # at 48
        ("repeated", c_uint64),  # at 56
        ("round_trip_ns", c_uint64),  # at 64
        ("clock_offset_ns", c_int64),  # at 72
        ("answered", c_uint32),  # at 80
        ("distributed_clocks", c_uint32),  # at 84
        ("slaves_operational", c_uint32),  # at 88
        ("slave_count", c_uint32),  # at 92
        ("axis_count", c_uint32),  # at 96
        ("reserved", c_uint32),  # at 100
        ("inputs", c_uint64 * 32),  # at 104
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/BusCycle/2"


assert ctypes.sizeof(BusCycle) == 360


class AxisCommand(ctypes.Structure):
    """1752 bytes."""

    _fields_ = [
        ("scan", c_uint64),  # at 0
        ("visible_from", c_uint64),  # at 8
        ("position", c_int64),  # at 16
        ("velocity_mm_s", c_double),  # at 24
        ("torque_nm", c_double),  # at 32
        ("feed_forward_mm_s", c_double),  # at 40
        ("following_error_mm", c_double),  # at 48
        ("stop_deceleration_mm_s2", c_double),  # at 56
        ("compensation_mm", c_double),  # at 64
        ("friction_pulse_mm_s", c_double),  # at 72
        ("torque_feed_forward_nm", c_double),  # at 80
        ("torque_cut_nm", c_double),  # at 88
        ("friction_level", c_double),  # at 96
        ("friction_unexplained", c_double),  # at 104
        ("held", WindowId),  # at 112
        ("pending", WindowId),  # at 128
        ("refused", WindowId),  # at 144
        ("tag", PathTag),  # at 160
        ("axis", c_uint32),  # at 176
        ("role", c_uint32),  # at 180
        ("incarnation", c_uint32),  # at 184
        ("drive_mode", c_uint32),  # at 188
        ("cause", c_uint32),  # at 192
        ("hand", c_uint32),  # at 196
        ("ahead_scans", c_uint32),  # at 200
        ("state_words", c_uint32),  # at 204
        ("state", c_uint64 * 192),  # at 208
        ("checksum", c_uint64),  # at 1744
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/AxisCommand/8"


assert ctypes.sizeof(AxisCommand) == 1752


class ProgramEvent(ctypes.Structure):
    """32 bytes."""

    _fields_ = [
        ("value", c_double),  # at 0
        ("number", c_uint32),  # at 8
        ("code", c_uint32),  # at 12
        ("index", c_uint32),  # at 16
        ("line", c_uint32),  # at 20
        ("element", c_uint32),  # at 24
        ("reserved", c_uint32),  # at 28
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/ProgramEvent/1"


assert ctypes.sizeof(ProgramEvent) == 32


class PlannerStatus(ctypes.Structure):
    """384 bytes."""

    _fields_ = [
        ("scan", c_uint64),  # at 0
        ("visible_from", c_uint64),  # at 8
        ("program_hash", c_uint64),  # at 16
        ("published", WindowId),  # at 24
        ("path_length_mm", c_double),  # at 40
        ("path_done_mm", c_double),  # at 48
        ("incarnation", c_uint32),  # at 56
        ("finished", c_uint32),  # at 60
        ("cause", c_uint32),  # at 64
        ("windows", c_uint32),  # at 68
        ("load", c_uint32),  # at 72
        ("line", c_uint32),  # at 76
        ("answered", c_uint32),  # at 80
        ("messages", c_uint32),  # at 84
        ("event", ProgramEvent),  # at 88
        ("outputs_ahead", ProgramEvent * 8),  # at 120
        ("checksum", c_uint64),  # at 376
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/PlannerStatus/6"


assert ctypes.sizeof(PlannerStatus) == 384


class Participant(ctypes.Structure):
    """40 bytes."""

    _fields_ = [
        ("death_scan", c_uint64),  # at 0
        ("job", c_uint32),  # at 8
        ("axis", c_uint32),  # at 12
        ("role", c_uint32),  # at 16
        ("incarnation", c_uint32),  # at 20
        ("live", c_uint32),  # at 24
        ("death_signal", c_int32),  # at 28
        ("death_status", c_int32),  # at 32
        ("stalled", c_uint32),  # at 36
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/Participant/2"


assert ctypes.sizeof(Participant) == 40


class Roster(ctypes.Structure):
    """2904 bytes."""

    _fields_ = [
        ("version", c_uint64),  # at 0
        ("visible_from", c_uint64),  # at 8
        ("participants", Participant * 72),  # at 16
        ("checksum", c_uint64),  # at 2896
    ]

    @staticmethod
    def type_name() -> str:
        return "quadrant/Roster/4"


assert ctypes.sizeof(Roster) == 2904
