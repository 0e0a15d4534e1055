//! The spindle of the machines that tests run on.

use machine::Spindle;

pub(crate) fn spindle() -> Spindle {
    Spindle {
        speed_min_rpm: 100.0,
        speed_max_rpm: 6000.0,
        at_speed_percent: 5.0,
        patience_s: 5.0,
        ..Spindle::default()
    }
}
