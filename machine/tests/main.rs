//! The machine file, seen from outside.

mod fresh;
mod own_units;
mod positioning;
mod reference;
mod settings;
