//! The command line of Quadrant: what can be asked for, and the roles of the process group.

pub mod cli;
pub mod manual;
pub mod roles;
