//! Every order of events, in a small cell and on the signal page.

mod exhaustive;
mod page;
