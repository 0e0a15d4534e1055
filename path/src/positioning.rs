//! High-frequency positioning: single rapids from rest to rest at the least copper heat their time allows.
//!
//! Source: Okuma, JP S59-13044 B2 (docs/methods/positioning.md). For the distance `b` in the time `r` the speed follows a
//! parabola; `r` is the time in which the motor runs exactly at its continuous rating, given the rest `c` until it moves
//! again:
//!
//! ```text
//! v(t) = (6b/r³)·t·(r − t)      ∫a²dt = 12·b²/r³      r⁴ + c·r³ = K·b²,  K = 12/A²
//! ```
//!
//! `A` is the acceleration that the rated torque gives the axis. Beyond the source: limits of speed and acceleration
//! ([`Profile`]), friction ([`MotorLoad`]), and the rest that the program really has (the planner's part of this module).

mod profile;
pub(crate) mod rapids;
mod travel_time;

pub use profile::{Profile, minimum_travel_time_s};
pub use rapids::{Move, Positioning};
pub use travel_time::{Halving, MotorLoad, RatingError, TravelTimeLaw, halve, travel_time_s};
