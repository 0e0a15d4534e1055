//! The families of a fieldbus; without samples in a cell whose drives are simulated.

use super::{Families, Outcome};
use crate::metrics::numbers::BusNumbers;

/// Writes them.
pub(super) fn families(families: &mut Families<'_>, numbers: &BusNumbers) -> Outcome {
    let newest = numbers.newest();
    let cycles = newest.into_iter().flat_map(|cycle| {
        let incomplete = cycle.missed.saturating_add(cycle.short);
        [
            ("complete", cycle.sent.saturating_sub(incomplete)),
            ("short", cycle.short),
            ("missed", cycle.missed),
        ]
    });
    let help = "Cycles by what became of their frame.";
    families.counters("bus_cycles", help, "outcome", cycles)?;
    let stray = newest.into_iter();
    let stray = stray.flat_map(|cycle| [("late", cycle.late), ("foreign", cycle.foreign)]);
    let help = "Frames that came and were no answer to the cycle under way.";
    families.counters("bus_stray_frames", help, "kind", stray)?;
    let help = "Cycles sent because the master was silent, with what it had asked for before.";
    let repeated = newest.map(|cycle| cycle.repeated);
    families.counter("bus_repeated_cycles", "", help, repeated)?;
    let mut time = |name: &str, help: &str, value_s: Option<f64>| {
        families.gauge(name, "seconds", help, value_s)
    };
    let help = "From sending the frame of a scan to its answer.";
    time("bus_round_trip", help, numbers.round_trip_s.get())?;
    let help = "The longest one since this process started.";
    time("bus_round_trip_peak", help, numbers.round_trip_peak_s.get())?;
    let help =
        "How much later than in the middle between two SYNC0 the frame passed the reference clock.";
    time("bus_clock_offset", help, numbers.clock_offset_s.get())?;
    let help = "Its largest magnitude since this process started.";
    let peak_s = numbers.clock_offset_peak_s.get();
    time("bus_clock_offset_peak", help, peak_s)?;
    let slaves = newest.map(|cycle| f64::from(cycle.slave_count));
    families.gauge("bus_slaves", "", "Slaves on the segment.", slaves)?;
    let operational = newest.map(|cycle| f64::from(cycle.slaves_operational));
    let help = "Slaves in operation (AL state OP).";
    families.gauge("bus_slaves_operational", "", help, operational)
}
