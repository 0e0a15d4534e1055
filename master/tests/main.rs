//! The master, seen from outside.

mod drives;
mod orders_and_windows;
mod standby;
