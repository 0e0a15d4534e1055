//! Part programs: reading, interpreting and expanding them into path geometry.
//!
//! A program is G-code by RS274/NGC (T. Kramer, F. Proctor, E. Messina, *The NIST RS274NGC Interpreter – Version 3*,
//! NISTIR 6556, 2000; sections are quoted as "NIST §"). [`load`] reads a file, [`interpret`] a text; both give the whole
//! [`Program`] or say, with line and column, everything that is wrong with it. Nothing is skipped in silence: a word that is
//! not understood refuses the program, because a machine that guesses breaks tools.
//!
//! # Supported
//!
//! G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G40 G49 G54 G61 G64 G80 G81 G82 G83 G90 G91 G90.1 G91.1 G94 G98 G99,
//! M2 M3 M4 M5 M30, the axis letters the machine has, I J K L R P Q F S N, comments, `%`. A program starts in G17 G21 G40
//! G49 G54 G61 G90 G91.1 G94 G98 with no motion mode and no feed. Where this differs from NIST or needs choosing:
//!
//! - `/` before a block (block delete): there is no such switch, the block runs.
//! - G61 and G64 both follow the exact path; the tolerance words of G64 (P, Q) are read and not used.
//! - The end of the file ends a program without M2, M30 or closing `%`. All three leniencies are reported in [`Program::notes`].
//! - Text after M2, M30 or the closing `%` is ignored as NIST says; so is the axis offset part of M2, since nothing follows.
//! - A number may not hold spaces, an axis word needs a motion mode, a comment ends on its line.
//! - An F word in the very block that changes the unit is refused: NIST reads it in the old unit, people mean the new one.
//! - Rotary axes are in degrees in G20 too. A move of rotary axes alone is fed in degrees per minute.
//!
//! # Arcs
//!
//! The programmed end must lie on the circle to 0.002 mm, in G20 to 0.0002 inch (NIST §3.5.3). What rounding
//! remains is taken out by moving the centre onto the perpendicular bisector of start and end, so that every element
//! meets both ends exactly with a true radius. Where a small gap would move the centre far (sweeps over half a turn)
//! the arc becomes two elements that meet half-way.
//!
//! # Drilling cycles
//!
//! `G81 X Y Z R L` drills, `G82` with `P` (seconds) waits at the bottom, `G83` with `Q` pecks; G80 and every other motion
//! word ends them (NIST §3.5.16). Each block that names X, Y or Z drills `L` holes (1 if absent). Z, R, P and Q stay from
//! block to block of the same cycle. In G91 X and Y are steps from hole to hole, R counts from where Z is and Z from R.
//! After a hole the tool returns to R (G99), or to where Z was before the first cycle in a row (G98), if that is higher.
//! Where NIST leaves a choice, or is not followed:
//!
//! - Between pecks the tool rises to R, also in G98, as LinuxCNC and Fanuc do; back down it stops 0.254 mm (0.01 inch)
//!   above the bottom.
//! - Levels that stay are kept as places: a later G91 block without R and Z drills between the same levels.
//! - Cycles run along Z: G18 and G19 are refused, and so are words of other axes in a cycle.
//! - A word that the cycle makes no use of (P in G81, Q in G82) is refused.
//!
//! # Why a reader of our own
//!
//! The `gcode` crate (0.7.0) was judged and not taken. It keeps every number as `f32`: between 128 and 256 mm neighbouring
//! values are 15 nm apart, fifteen increments of a 1 nm machine, and no error is reported. A parenthesis that is not closed
//! swallows the lines after it up to the next one, without a diagnostic. N numbers lose their decimals in silence. The reader
//! here is small and strict.

mod arc;
mod cycles;
mod error;
mod file;
mod interpreter;
mod letters;
mod program;
mod reader;
mod resume;
mod setup;
mod words;

pub use error::{Problem, ProgramError, ResumeError};
pub use file::{FILE_BYTES_MAX, load, read_text};
pub use interpreter::{BLOCKS_MAX, interpret};
pub use program::{AxisSetup, Block, Event, EventKind, Note, Program, ProgramEnd, Setup};
pub use resume::{load_from, resume_from, tool_at};
pub use setup::kinematics_of;
