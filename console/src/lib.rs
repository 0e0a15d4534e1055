//! What every command stands on: exit statuses, output, logs, signals, and children that end with it.

pub mod child;
pub mod exit;
pub mod logs;
pub mod output;
pub mod signals;
