//! The numbers that metrics are made of: written as samples come, read by whoever answers a scrape. Each number of an axis or a
//! process is an atomic of its own, and two of them may be a scan apart; what a scan tells of the cell is taken together, since
//! one without the other would be untrue: a program that is loaded and has no name, a machine that is ready and runs.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use bus::member::Pace;
use bus::sample::{BusCycle, Cause, Feedback, Signals};
use machine::{AxisKind, Machine, Process};
use monitor::quantities::OF_AXIS;

/// Upper ends of the buckets of following errors: those of slides, in m, are the first, those of rotary axes, in rad, the last
/// [`ERROR_BUCKETS`].
const ERROR_ENDS: [f64; 16] = [
    1e-7, 2e-7, 5e-7, 1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2,
];
const ERROR_BUCKETS: usize = 13;
/// Upper ends of the buckets of scan intervals, as shares of the scan period.
const INTERVAL_ENDS: [f64; 12] = [
    0.5, 0.8, 0.9, 0.95, 0.98, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 5.0,
];

/// A count.
#[derive(Debug, Default)]
pub struct Count(AtomicU64);

impl Count {
    /// Reads it.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    /// Sets what somebody else counts.
    pub fn set(&self, value: u64) {
        self.0.store(value, Ordering::Relaxed);
    }

    /// Counts one more.
    pub fn add_one(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// A number with a fraction, as the bits of it; none before it was set.
#[derive(Debug)]
pub struct Number(AtomicU64);

impl Default for Number {
    fn default() -> Self {
        Number(AtomicU64::new(f64::NAN.to_bits()))
    }
}

impl Number {
    /// Reads it.
    pub fn get(&self) -> Option<f64> {
        Some(f64::from_bits(self.0.load(Ordering::Relaxed))).filter(|value| !value.is_nan())
    }

    /// Sets it.
    pub fn set(&self, value: f64) {
        self.0.store(value.to_bits(), Ordering::Relaxed);
    }

    /// Keeps the larger one.
    pub fn raise_to(&self, value: f64) {
        if self.get().is_none_or(|before| value > before) {
            self.set(value);
        }
    }
}

/// To the nanosecond: labels are read by people too.
fn whole_ns(seconds: f64) -> f64 {
    (seconds * 1e9).round() / 1e9
}

/// How often a magnitude fell into each bucket.
#[derive(Debug)]
pub struct Distribution {
    ends: Vec<f64>,
    /// The last one has no end.
    counts: Vec<Count>,
    sum: Number,
}

impl Distribution {
    fn new(ends: impl Iterator<Item = f64>) -> Self {
        let ends: Vec<f64> = ends.collect();
        let sum = Number::default();
        sum.set(0.0);
        Distribution {
            counts: (0..=ends.len()).map(|_| Count::default()).collect(),
            ends,
            sum,
        }
    }

    fn of_errors(kind: AxisKind) -> Self {
        let first = match kind {
            AxisKind::Linear => 0,
            AxisKind::Rotary => ERROR_ENDS.len() - ERROR_BUCKETS,
        };
        let ends = ERROR_ENDS.iter().copied();
        Self::new(ends.skip(first).take(ERROR_BUCKETS))
    }

    /// Takes one magnitude; for one writer.
    pub fn take(&self, magnitude: f64) {
        let at = self.ends.partition_point(|end| *end < magnitude);
        if let Some(count) = self.counts.get(at) {
            count.add_one();
        }
        self.sum.set(self.sum.get().unwrap_or(0.0) + magnitude);
    }

    /// Sum, and each bucket's end with its own count.
    pub fn read(&self) -> (f64, Vec<(f64, u64)>) {
        let ends = self.ends.iter().copied().chain([f64::INFINITY]);
        let buckets = ends.zip(self.counts.iter().map(Count::get)).collect();
        (self.sum.get().unwrap_or(0.0), buckets)
    }
}

/// One axis.
#[derive(Debug)]
pub struct AxisNumbers {
    /// Its letter.
    pub name: String,
    /// Slide or rotary.
    pub kind: AxisKind,
    /// Magnitude of its following error in every scan.
    pub following_error: Distribution,
    /// What is known of it now.
    pub values: AxisValues,
}

/// What is known of an axis. Lengths of rotary axes are angles in rad in place of m.
#[derive(Debug, Default)]
pub struct AxisValues {
    /// Where it is.
    pub position_m: Number,
    /// Where it is commanded to be.
    pub command_m: Number,
    /// Following error in the newest scan.
    pub following_error_m: Number,
    /// Its largest magnitude.
    pub following_error_peak_m: Number,
    /// Torque of the motor.
    pub torque_nm: Number,
    /// Its largest magnitude.
    pub torque_peak_nm: Number,
    /// Scans with the torque at its limit.
    pub torque_limited_scans: Count,
    /// Numbers that are shown as the feedback has them, in their order.
    pub quantities: [Number; OF_AXIS.len()],
    /// Scans without a command in time.
    pub missed_scans: Count,
    /// Redundancy on the wire.
    pub redundancy: Number,
    /// How often its two servos have commanded different things.
    pub differences: Count,
    /// Friction that the servo goes by, as a part of that of its model.
    pub friction_level: Number,
    /// Part of Coulomb friction that the last way between two reversals left unexplained.
    pub friction_unexplained: Number,
    /// Reversals.
    pub reversals: Count,
    /// Height of the last one on an arc.
    pub protrusion_m: Number,
    /// Largest following error around the last one.
    pub reversal_error_m: Number,
}

/// One process.
#[derive(Debug)]
pub struct ProcessNumbers {
    /// Its name, as in logs.
    pub name: String,
    /// What it does.
    pub process: Process,
    /// 1 while it lives.
    pub up: Count,
    /// Processes that had this place.
    pub starts: Count,
    /// Scans since it was last done with one.
    pub age_scans: Number,
}

/// What one feedback sample tells of the cell.
#[derive(Debug, Clone, Copy)]
pub struct CellNow {
    /// Scans until now.
    pub scans: u64,
    /// Monotonic time at which it came, in ns.
    pub heard_ns: u64,
    /// Scans that the master overran.
    pub overrun_scans: u32,
    /// Mode on the wire.
    pub mode: u32,
    /// 1 in hold.
    pub hold: u32,
    /// Feed override in percent.
    pub override_percent: u32,
    /// Program state on the wire.
    pub program: u32,
    /// Number of the program that was loaded last.
    pub load: u32,
    /// Programs that were started.
    pub runs: u32,
}

impl CellNow {
    /// Of a sample that came at `heard_ns`.
    pub fn of(sample: &Feedback, heard_ns: u64) -> Self {
        CellNow {
            scans: sample.scan + 1,
            heard_ns,
            overrun_scans: sample.overrun_scans,
            mode: sample.mode,
            hold: sample.hold,
            override_percent: sample.override_percent,
            program: sample.program,
            load: sample.load,
            runs: sample.run,
        }
    }
}

/// The fieldbus; nothing in a cell whose drives are simulated.
#[derive(Debug, Default)]
pub struct BusNumbers {
    /// The newest cycle, whose counts belong together.
    newest: Mutex<Option<BusCycle>>,
    /// From sending to the answer, of the newest cycle that was answered.
    pub round_trip_s: Number,
    /// The longest one.
    pub round_trip_peak_s: Number,
    /// How late the frame was for the clock that the drives share; none without distributed clocks.
    pub clock_offset_s: Number,
    /// Its largest magnitude.
    pub clock_offset_peak_s: Number,
}

impl BusNumbers {
    /// The newest cycle.
    pub fn newest(&self) -> Option<BusCycle> {
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a cycle.
    pub fn take(&self, cycle: &BusCycle) {
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(*cycle);
        if let Some(round_trip_s) = cycle.round_trip_s() {
            self.round_trip_s.set(round_trip_s);
            self.round_trip_peak_s.raise_to(round_trip_s);
        }
        if let Some(offset_s) = cycle.clock_offset_s() {
            self.clock_offset_s.set(offset_s);
            self.clock_offset_peak_s.raise_to(offset_s.abs());
        }
    }
}

/// Everything.
#[derive(Debug)]
pub struct Numbers {
    /// Name of the machine.
    pub machine: String,
    /// The cell's pace.
    pub pace: Pace,
    /// Period of a scan.
    pub scan_period_s: f64,
    /// Times between the beginnings of scans, in s; in real time alone.
    pub scan_interval: Option<Distribution>,
    /// What the newest feedback tells of the cell; none before the first.
    now: Mutex<Option<CellNow>>,
    /// Share of the program's path that is done.
    pub progress_ratio: Number,
    /// Trips by cause on the wire.
    trips: [Count; Cause::ALL.len()],
    /// The fieldbus.
    pub bus: BusNumbers,
    /// Per axis.
    pub axes: Vec<AxisNumbers>,
    /// Per process.
    pub processes: Vec<ProcessNumbers>,
    /// Names of the signals.
    pub signal_names: Vec<String>,
    /// Numbers of the alarms.
    pub alarm_numbers: Vec<String>,
    /// The newest sample of signals; none before the first.
    signals: Mutex<Option<Box<Signals>>>,
}

impl Numbers {
    /// What the newest feedback told of the cell.
    pub fn now(&self) -> Option<CellNow> {
        *self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The newest sample of signals; none before the first.
    pub fn signals(&self) -> Option<Box<Signals>> {
        let signals = self.signals.lock();
        signals.unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Takes a sample of signals.
    pub fn set_signals(&self, sample: Signals) {
        let mut signals = self.signals.lock().unwrap_or_else(PoisonError::into_inner);
        *signals = Some(Box::new(sample));
    }

    /// Takes what a feedback tells of the cell.
    pub fn set_now(&self, now: CellNow) {
        *self.now.lock().unwrap_or_else(PoisonError::into_inner) = Some(now);
    }

    /// Trips of this cause.
    pub fn trips(&self, cause: Cause) -> Option<&Count> {
        let mut all = Cause::ALL.iter().zip(&self.trips);
        all.find(|(of, _)| **of == cause).map(|(_, count)| count)
    }

    /// Of a cell of which nothing has been heard yet.
    pub fn new(machine: &Machine, pace: Pace) -> Self {
        let axes = machine.axes.iter().map(|axis| AxisNumbers {
            name: axis.name.clone(),
            kind: axis.kind,
            following_error: Distribution::of_errors(axis.kind),
            values: AxisValues::default(),
        });
        let mut processes = Process::all(machine);
        processes.sort();
        let processes = processes.into_iter().map(|process| ProcessNumbers {
            name: process.name(machine),
            process,
            up: Count::default(),
            starts: Count::default(),
            age_scans: Number::default(),
        });
        Numbers {
            signals: Mutex::default(),
            signal_names: machine.signals.iter().map(|of| of.name.clone()).collect(),
            alarm_numbers: machine
                .alarms
                .iter()
                .map(|of| of.number.to_string())
                .collect(),
            machine: machine.name.clone(),
            pace,
            scan_period_s: machine.scan_period_s(),
            scan_interval: (pace == Pace::Realtime).then(|| {
                let period_s = machine.scan_period_s();
                Distribution::new(INTERVAL_ENDS.iter().map(|share| whole_ns(share * period_s)))
            }),
            now: Mutex::default(),
            progress_ratio: Number::default(),
            trips: std::array::from_fn(|_| Count::default()),
            bus: BusNumbers::default(),
            axes: axes.collect(),
            processes: processes.collect(),
        }
    }
}

/// A number in mm as one in m, one in degrees as one in rad.
pub fn base_unit(kind: AxisKind, value: f64) -> f64 {
    match kind {
        AxisKind::Linear => value * 1e-3,
        AxisKind::Rotary => value.to_radians(),
    }
}

#[cfg(test)]
mod tests {
    use bus::sample::{Mode, ProgramState};

    use super::*;

    #[test]
    fn a_magnitude_falls_into_the_bucket_whose_end_it_does_not_exceed() {
        let distribution = Distribution::of_errors(AxisKind::Linear);
        for magnitude in [0.0, 1e-6, 1.1e-6, 0.5] {
            distribution.take(magnitude);
        }
        let (sum, buckets) = distribution.read();
        assert!((sum - 0.500_002_1).abs() < 1e-12);
        let count = |end: f64| {
            let bucket = buckets.iter().find(|(e, _)| *e == end);
            bucket.map_or(u64::MAX, |(_, count)| *count)
        };
        assert_eq!((count(1e-7), count(1e-6), count(2e-6)), (1, 1, 1));
        assert_eq!(count(f64::INFINITY), 1);
        let (_, wide) = Distribution::of_errors(AxisKind::Rotary).read();
        assert_eq!(wide.iter().position(|(end, _)| *end == 1e-2), Some(12));
    }

    #[test]
    fn every_cause_and_every_mode_on_the_wire_has_its_number() {
        assert!(
            Cause::ALL
                .iter()
                .all(|c| Cause::from_wire(*c as u32) == Some(*c))
        );
        assert_eq!(Cause::from_wire(u32::MAX), None);
        for (wire, mode) in Mode::ALL.iter().enumerate() {
            assert_eq!(Mode::from_wire(wire as u32), Some(*mode));
        }
        assert_eq!(Mode::from_wire(Mode::ALL.len() as u32), None);
        for (wire, state) in ProgramState::ALL.iter().enumerate() {
            assert_eq!(ProgramState::from_wire(wire as u32), Some(*state));
        }
        assert_eq!(
            ProgramState::from_wire(ProgramState::ALL.len() as u32),
            None
        );
    }

    #[test]
    fn a_cycle_without_an_answer_leaves_the_times_of_the_one_before() {
        let numbers = BusNumbers::default();
        let answered = BusCycle {
            answered: 1,
            round_trip_ns: 80_000,
            clock_offset_ns: -2_000,
            distributed_clocks: 1,
            ..BusCycle::default()
        };
        numbers.take(&answered);
        numbers.take(&BusCycle {
            answered: 0,
            missed: 1,
            ..BusCycle::default()
        });
        assert_eq!(numbers.newest().map(|cycle| cycle.missed), Some(1));
        assert_eq!(numbers.round_trip_s.get(), Some(80e-6));
        assert_eq!(numbers.clock_offset_s.get(), Some(-2e-6));
        assert_eq!(numbers.clock_offset_peak_s.get(), Some(2e-6));
        numbers.take(&BusCycle {
            distributed_clocks: 0,
            clock_offset_ns: 9_000,
            ..answered
        });
        assert_eq!(numbers.clock_offset_peak_s.get(), Some(2e-6));
    }

    #[test]
    fn a_number_is_unknown_until_it_is_set_and_a_peak_only_rises() {
        let number = Number::default();
        assert_eq!(number.get(), None);
        number.raise_to(2.0);
        number.raise_to(1.0);
        assert_eq!(number.get(), Some(2.0));
    }
}
