//! The families of a fieldbus; without samples in a cell whose drives are simulated.

use std::fmt::Error;

use prometheus_client::encoding::NoLabelSet;
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::Unit;

use super::Families;
use crate::metrics::numbers::BusNumbers;

/// Writes them.
pub(super) fn families(families: &mut Families<'_>, numbers: &BusNumbers) -> Result<(), Error> {
    counts(families, numbers)?;
    let seconds = Some(Unit::Seconds);
    families.gauge(
        "bus_round_trip",
        seconds.clone(),
        "From sending the frame of a scan to its answer.",
        numbers.round_trip_s.get(),
    )?;
    families.gauge(
        "bus_round_trip_peak",
        seconds.clone(),
        "The longest one since this process started.",
        numbers.round_trip_peak_s.get(),
    )?;
    families.gauge(
        "bus_clock_offset",
        seconds.clone(),
        "How much later than in the middle between two SYNC0 the frame passed the reference clock.",
        numbers.clock_offset_s.get(),
    )?;
    families.gauge(
        "bus_clock_offset_peak",
        seconds,
        "Its largest magnitude since this process started.",
        numbers.clock_offset_peak_s.get(),
    )?;
    let newest = numbers.newest();
    families.gauge(
        "bus_slaves",
        None,
        "Slaves on the segment.",
        newest.map(|cycle| f64::from(cycle.slave_count)),
    )?;
    families.gauge(
        "bus_slaves_operational",
        None,
        "Slaves in operation (AL state OP).",
        newest.map(|cycle| f64::from(cycle.slaves_operational)),
    )
}

/// What became of the frames.
fn counts(families: &mut Families<'_>, numbers: &BusNumbers) -> Result<(), Error> {
    let newest = numbers.newest();
    let mut labelled = |name: &str, help: &str, label: &str, of: &[(&str, u64)]| {
        families.family(name, None, MetricType::Counter, help, |encoder| {
            for (word, count) in of {
                let labels = [(label, *word)];
                encoder
                    .encode_family(&labels)?
                    .encode_counter::<NoLabelSet, u64, f64>(count, None)?;
            }
            Ok(())
        })
    };
    let cycles = newest.map(|cycle| {
        let incomplete = cycle.missed.saturating_add(cycle.short);
        [
            ("complete", cycle.sent.saturating_sub(incomplete)),
            ("short", cycle.short),
            ("missed", cycle.missed),
        ]
    });
    let help = "Cycles by what became of their frame.";
    let cycles = cycles.as_ref().map_or(&[][..], |cycles| cycles);
    labelled("bus_cycles", help, "outcome", cycles)?;
    let stray = newest.map(|cycle| [("late", cycle.late), ("foreign", cycle.foreign)]);
    let help = "Frames that came and were no answer to the cycle under way.";
    let stray = stray.as_ref().map_or(&[][..], |stray| stray);
    labelled("bus_stray_frames", help, "kind", stray)?;
    let help = "Cycles sent because the master was silent, with what it had asked for before.";
    families.family(
        "bus_repeated_cycles",
        None,
        MetricType::Counter,
        help,
        |encoder| {
            newest.map_or(Ok(()), |cycle| {
                encoder.encode_counter::<NoLabelSet, u64, f64>(&cycle.repeated, None)
            })
        },
    )
}
