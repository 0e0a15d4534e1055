//! The words of Fanuc's and Haas' controls, translated into those that programs of LinuxCNC are made of (docs/reference/fanuc.md).
//!
//! `labels` finds the lines that others lead to, `lines` reads a line, `arguments` makes variables of the words of a macro call,
//! `variables` says what the number of a variable stands for, `words` puts LinuxCNC's words in the place of a block's own, with `cycles`,
//! `offsets` and `lathe`. None of them does anything: the interpreter and the execution do, by what they do for LinuxCNC's words.
//!
//! Sources: Fanuc Series 0i-D operator's manuals B-64304EN (common) and B-64304EN-2 (machining centres), Haas Mill Operator's Manual.

mod arguments;
mod block;
mod cycles;
mod labels;
mod lathe;
mod lines;
mod offsets;
mod variables;
mod words;

pub use arguments::arguments;
pub use block::{Beside, Modes};
pub use labels::{called_by, is_file_of, label_at, may_jump, may_lead, number_at};
pub use lines::read_line;
pub use variables::Variable;
pub use words::translate;
