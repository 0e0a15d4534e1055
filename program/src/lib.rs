//! Part programs: reading, interpreting and expanding them into path geometry.
//!
//! A program is G-code by RS274/NGC (T. Kramer, F. Proctor, E. Messina, *The NIST RS274NGC Interpreter – Version 3*,
//! NISTIR 6556, 2000; sections are quoted as "NIST §"). [`load`] reads a file, [`interpret`] a text; both give the whole
//! [`Program`] or say, with line and column, everything that is wrong with it. Nothing is skipped in silence: a word that is
//! not understood refuses the program, because a machine that guesses breaks tools.
//!
//! A program of any length is read block by block by a [`Reading`]: what its blocks make comes in [`Piece`]s and is not kept. Its first
//! mistake ends it. [`check_file`] finds all mistakes of a file of any length; [`Reading::snapshot`] is the state between two blocks.
//!
//! # How it is read
//!
//! `text` is a text in memory or a file, of which 256 kB are kept. `straight` reads the blocks of which most programs are made, in one
//! pass from the bytes of a line to an element; all others take the way that follows.
//!
//! `bundle` puts the subroutines of other files behind a program's text. `source` knows its lines and labels; `execution` goes from
//! line to line as the O-words say (`flow`, `frames`); `reader` makes a block of a line, its expressions evaluated (`expression`);
//! `interpreter` does the block in the order of NIST §3.8 and LinuxCNC's manual (*Order of Execution*).
//!
//! A program in Fanuc's language takes the same way with another reader of lines: `fanuc` makes a block of a line and puts LinuxCNC's
//! words in the place of its own; what those have no words for (jumps, macro calls, corners, system variables) is in the `fanuc` files
//! of `execution` and `interpreter`. [`Setup::dialect`] says the language, unless the text does: a copied program begins with a mark.
//!
//! What words mean is in `meaning`: its `State` is what words are read in, of values that own their fields (`in_force`, `offsets`,
//! `tools`, `parameters`). Words change it by calls of their own; all else only looks at it and returns a motion or a list of acts
//! (`act`): a cycle is straight moves and events before any of them is done. `route` does them, by one path for all, and beside the
//! contour where a radius compensation is on. `cycles`, `splines`, `threading`, `compensation`, `roughing` and `polar` are pure.
//!
//! A module names only those below it: at the bottom `refusal`, the one way to say what was found and what would be right, and the types of
//! `program`; then text, words, what words mean, execution; at the top `reading`, `check`, `resume` and what is built on them. All that
//! later blocks depend on is in the interpreter, which can be copied.
//!
//! The language is that of LinuxCNC 2.9; docs/reference/g-code.md and program-flow.md list its words. A program starts in G17 G21 G40
//! G49 G54 G61 G90 G91.1 G94 G98 with no motion mode and no feed. `quadrant-lab linuxcnc` compares programs with what LinuxCNC's
//! interpreter makes of them. Where this differs, or needs choosing:
//!
//! - `/` before a block runs unless [`Setup::block_delete`] says otherwise.
//! - G64 says how far the path may be left (P at corners, Q at chords); who travels the path rounds it (`path::rounding`).
//! - The end of the file ends a program without M2, M30 or closing `%`.
//! - Text after M2, M30 or the closing `%` is ignored as NIST says; so is the axis offset part of M2, since nothing follows.
//! - An F word in the block that changes the unit is read in the unit of before, as LinuxCNC does.
//! - Rotary axes are in degrees in G20 too. A move of rotary axes alone is fed in degrees per minute.
//! - A subroutine may stand behind its calls.
//!
//! What is lenient is reported in [`Program::notes`].
//!
//! # Arcs
//!
//! The programmed end must lie on the circle to 0.002 mm, in G20 to 0.0002 inch (NIST §3.5.3). What rounding
//! remains is taken out by moving the centre onto the perpendicular bisector of start and end, so that every element
//! meets both ends exactly with a true radius. Where a small gap would move the centre far (sweeps over half a turn)
//! the arc becomes two elements that meet half-way.
//!
//! # Canned cycles
//!
//! G73, G74 and G81 to G89 along the axis across the plane (NIST §3.5.16); G80 and every other motion word ends them. Words
//! stay from block to block of the same cycle, levels as they were given: those of G90 in the coordinates of the program,
//! those of G91 from the level that they count from (R: before the first cycle in a row; bottom: R; K of G87: bottom).
//! Where NIST leaves a choice, or LinuxCNC 2.9 is not followed:
//!
//! - A program starts in G98, LinuxCNC in G99; where that makes a difference a note says so.
//! - A hole is reached at the level where the tool is or at R, whichever is higher; LinuxCNC goes there on a slant where R
//!   or the return height changes in a series.
//! - Between pecks of G83 the tool rises to R, also in G98, as LinuxCNC and Fanuc do.
//! - G88: what the operator leaves of the way out, the program makes before the spindle starts again.
//! - G74 and G84 in G18 and G19: LinuxCNC exchanges the axes; here they tap along the axis of the cycle. Without P, they
//!   never wait; LinuxCNC takes the P of any cycle before.
//! - A word that the cycle makes no use of (P in G81, Q in G82) is refused.
//!
//! # Splines and threads
//!
//! G5, G5.1 and G5.2/G5.3 as LinuxCNC reads them; arcs follow the curves to 0.5 µm. G33, G33.1 and G76 make moves whose
//! events say how far they go for each turn of the spindle; what LinuxCNC's manual calls an error of G76 is refused.
//!
//! # Why a reader of our own
//!
//! The `gcode` crate (0.7.0) was judged and not taken. It keeps every number as `f32`: between 128 and 256 mm neighbouring
//! values are 15 nm apart, fifteen increments of a 1 nm machine, and no error is reported. A parenthesis that is not closed
//! swallows the lines after it up to the next one, without a diagnostic. N numbers lose their decimals in silence. The reader
//! here is small and strict.

mod act;
mod along;
mod arc;
mod bundle;
mod check;
mod codes;
mod compensation;
mod cycles;
mod equipment;
mod error;
mod execution;
mod expression;
mod fanuc;
mod file;
mod flat;
mod flow;
mod frames;
mod in_force;
mod interpreter;
mod letters;
mod meaning;
mod modes;
mod number;
mod offsets;
mod parameters;
mod polar;
mod program;
mod question;
mod reader;
mod reading;
mod refusal;
mod resume;
mod roughing;
mod route;
mod setup;
mod snapshot;
mod source;
mod splines;
mod state;
mod straight;
mod surface;
mod text;
mod threading;
mod tilted_plane;
mod tools;
mod words;
mod work;

pub use along::{Along, SHORT_ELEMENTS, load_if_short};
pub use bundle::bundle_to;
pub use check::{Summary, check_file};
pub use error::{ProgramError, ResumeError};
pub use execution::interpret;
pub use file::{FILE_BYTES_MAX, write_text_hash};
pub use machine::{Tool, parse_tools};
pub use meaning::Modal;
pub use modes::{Modes, modal_at_start};
pub use parameters::Parameters;
pub use program::{
    AxisSetup, BLOCKS_MAX, Block, Event, EventKind, Message, Note, Piece, Program, ProgramEnd,
    Setup,
};
pub use question::{Answer, Question};
pub use reading::{Progress, Reading};
pub use resume::{load, load_from, resume_from};
pub use setup::{kinematics_of, tool_at};
pub use surface::SurfaceSpeed;
pub use work::{commanded, ways_to_work, work_place};
