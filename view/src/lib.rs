//! A running cell, seen: live view in the terminal, scope, metrics, page in the browser.

mod drawing;
mod guests;
mod listening;
pub mod live;
pub mod metrics;
pub mod options;
pub mod scope;
mod shown;
#[cfg(test)]
#[path = "../../tests/spoilt.rs"]
mod spoilt;
pub mod web;
