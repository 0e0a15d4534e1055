//! One servo, seen from outside.

mod circle;
mod common;
mod guards;
mod manual;
mod shapes;
mod windows;
