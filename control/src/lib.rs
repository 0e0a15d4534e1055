//! Pure control blocks: path geometry, profiles, feed-forward, reversal compensation, loops.
//!
//! Nothing here knows of processes, clocks, files or shared memory.

pub mod audit;
pub mod backlash;
pub mod changeover;
mod course;
mod envelope;
pub mod feed_forward;
pub mod follow_up;
pub mod guards;
pub mod jog;
pub mod limits;
pub mod path;
pub mod profile;
pub mod reversal;
pub mod speed_map;
pub mod totals;
pub mod velocity_loop;
pub mod window;
