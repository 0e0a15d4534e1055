//! What a servo computes in a scan: position and velocity loop, feed-forward, compensation of reversals, adaptation, motions by hand.
//!
//! Nothing here knows of processes, clocks, files or shared memory.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod adaptation;
pub mod backlash;
pub mod braking;
pub mod changeover;
pub mod disturbance_observer;
pub mod dual_feedback;
pub mod feed_forward;
pub mod follow_up;
pub mod guards;
pub mod hand_course;
pub mod inverse_dynamics;
pub mod jog;
pub mod learned_table;
pub mod maxwell_slip;
pub mod path_correction;
pub mod prediction;
pub mod reversal;
pub mod trigger;
pub mod velocity_loop;
