//! Pure control blocks: path geometry, profiles, feed-forward, reversal compensation, loops.
//!
//! Nothing here knows of processes, clocks, files or shared memory.

pub mod adaptation;
pub mod audit;
pub mod axis_rates;
pub mod backlash;
pub mod braking;
mod braking_limit;
pub mod changeover;
mod course;
pub mod disturbance_observer;
pub mod dual_feedback;
mod envelope;
pub mod feed_forward;
pub mod follow_up;
pub mod guards;
pub mod inverse_dynamics;
pub mod jog;
pub mod jog_course;
pub mod kinematics;
pub mod learned_table;
pub mod learning;
pub mod limits;
pub mod line;
pub mod maxwell_slip;
pub mod path;
pub mod path_correction;
pub mod path_learning;
pub mod path_part;
pub mod pivot;
pub mod positioning;
pub mod prediction;
pub mod profile;
pub mod reversal;
pub mod rounding;
mod segment;
pub mod setpoint_settings;
pub mod setpoints;
mod smoothing;
pub mod speed_map;
pub mod spindle_following;
pub mod time_use;
pub mod totals;
pub mod trigger;
pub mod velocity_loop;
pub mod window;
pub mod zero_phase;
