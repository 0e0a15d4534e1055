//! Pure control blocks: path geometry, profiles, feed-forward, reversal compensation, loops.
//!
//! Nothing here knows of processes, clocks, files or shared memory.

pub mod audit;
pub mod backlash;
mod course;
mod envelope;
pub mod feed_forward;
pub mod guards;
pub mod kinematics;
pub mod limits;
pub mod line;
pub mod path;
pub mod pivot;
pub mod profile;
pub mod reversal;
pub mod rows;
pub mod speed_map;
pub mod totals;
pub mod velocity_loop;
pub mod window;
