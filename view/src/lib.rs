//! A running cell, seen: live view in the terminal, scope, metrics, page in the browser.

mod drawing;
mod guests;
pub mod live;
pub mod metrics;
pub mod options;
pub mod scope;
pub mod web;
