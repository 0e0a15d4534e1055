//! The machine file, seen from outside.

mod geometry;
mod own_units;
mod positioning;
mod processes;
mod settings;
