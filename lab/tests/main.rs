//! Whole cells in one process and, in `processes`, by the lab's own command.

// Of these the lab uses a part.
#[allow(dead_code)]
#[path = "../../tests/size.rs"]
mod size;
#[allow(dead_code)]
#[path = "../../tests/support.rs"]
mod support;

mod auxiliary;
mod by_hand;
mod common;
mod continuous_jog;
mod dead_time;
mod end_of_travel;
mod found_by_seeds;
mod homing;
mod in_step;
mod jog_ends;
mod jog_override;
mod limit_switch;
mod linuxcnc;
mod manual_motion;
mod missed_scans;
mod new_machines;
mod overrides;
mod procedures;
mod processes;
mod questions;
mod rounded;
mod run_endings;
mod seeds;
mod short_elements;
mod silent_servo;
mod single_block;
mod spoilt_feedbacks;
mod spoilt_samples;
mod start_at_line;
mod strained_gantry;
mod time_optimal;
mod weight;
mod wheel;
