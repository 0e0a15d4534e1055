//! The numbers as text: OpenMetrics 1.0 (<https://prometheus.io/docs/specs/om/open_metrics_spec/>), or the older text format of
//! Prometheus for those who do not ask for it. Base units are in the names; every metric is described in docs/howto/metrics.md.

mod fieldbus;

use std::fmt::Error;
use std::path::Path;

use bus::sample::{Cause, Job, Mode, ProgramState, Redundancy, has_bit};
use machine::AxisKind;
use monitor::quantities::OF_AXIS;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::text::encode;
use prometheus_client::encoding::{DescriptorEncoder, MetricEncoder, NoLabelSet};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::{Registry, Unit};

use super::numbers::{
    AxisNumbers, AxisValues, CellNow, Count, Distribution, Number, Numbers, ProcessNumbers,
};
use super::served::Served;

/// How the text is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dialect {
    /// OpenMetrics 1.0.
    OpenMetrics,
    /// Text format 0.0.4 of Prometheus.
    PrometheusText,
}

impl Dialect {
    /// Its media type.
    pub fn content_type(self) -> &'static str {
        match self {
            Dialect::OpenMetrics => "application/openmetrics-text; version=1.0.0; charset=utf-8",
            Dialect::PrometheusText => "text/plain; version=0.0.4; charset=utf-8",
        }
    }
}

/// Everything that is known, as text.
///
/// # Errors
/// Never in practice: a text takes all that is written to it.
pub fn text(served: &Served, dialect: Dialect) -> Result<String, Error> {
    let name = ("cell".into(), served.place.name().to_string().into());
    let mut registry = Registry::with_prefix_and_labels("quadrant", [name].into_iter());
    let cell = served.numbers.now();
    registry.register_collector(Box::new(Snapshot {
        numbers: std::sync::Arc::clone(&served.numbers),
        cell,
        now_ns: bus::realtime::now_ns(),
        log_bytes: served
            .recorder
            .get()
            .and_then(|of| of.out.as_deref())
            .map_or(0, log_bytes),
        samples_lost: monitor::losses::lost_samples(&served.place),
        room_is_scarce: monitor::room::scarce(&served.place).is_some(),
        program: program(served, cell.as_ref()),
    }));
    let mut text = String::with_capacity(32 << 10);
    encode(&mut text, &registry)?;
    Ok(match dialect {
        Dialect::OpenMetrics => text,
        Dialect::PrometheusText => older(&text),
    })
}

/// Bytes that logs have in their files: that of the run, or those of the programs of a cell that stays up, each in a folder.
fn log_bytes(folder: &Path) -> u64 {
    let bytes_in = |folder: &Path| -> u64 {
        let parts = monitor::log::part_files(folder).unwrap_or_default();
        let sizes = parts.iter().filter_map(|part| part.metadata().ok());
        sizes.map(|file| file.len()).sum()
    };
    let below = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let below = below.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
    bytes_in(folder) + below.map(|entry| bytes_in(&entry.path())).sum::<u64>()
}

/// Name of the program: that of the run, or the one that is loaded.
fn program(served: &Served, cell: Option<&CellNow>) -> String {
    let is_loaded = |cell: &&CellNow| cell.program != ProgramState::None as u32;
    let loaded = || served.place.program(cell.filter(is_loaded)?.load);
    let of_run = served.recorder.get().and_then(|of| of.program.clone());
    let file = of_run.or_else(loaded);
    let name = file.as_deref().and_then(Path::file_name);
    name.map_or(String::new(), |name| name.to_string_lossy().into_owned())
}

/// The same in the older format: counters and infos carry their suffix in their descriptions too, units have no line.
fn older(text: &str) -> String {
    let mut suffixed: Vec<(&str, &str)> = Vec::new();
    for line in text.lines() {
        if let Some((name, kind)) = line
            .strip_prefix("# TYPE ")
            .and_then(|rest| rest.split_once(' '))
        {
            match kind {
                "counter" => suffixed.push((name, "_total")),
                "info" => suffixed.push((name, "_info")),
                _ => {}
            }
        }
    }
    let mut older = String::with_capacity(text.len());
    for line in text.lines() {
        if line.starts_with("# UNIT ") || line == "# EOF" {
            continue;
        }
        let described = line
            .strip_prefix("# ")
            .and_then(|rest| rest.split_once(' '))
            .and_then(|(what, rest)| Some((what, rest.split_once(' ')?)));
        match described {
            Some((what, (name, rest))) => {
                let suffix = suffixed.iter().find(|(known, _)| *known == name);
                let suffix = suffix.map_or("", |(_, suffix)| suffix);
                let rest = match (what, rest) {
                    ("TYPE", "info") => "gauge",
                    (_, rest) => rest,
                };
                older += &format!("# {what} {name}{suffix} {rest}\n");
            }
            None => {
                older += line;
                older.push('\n');
            }
        }
    }
    older
}

#[derive(Debug)]
struct Snapshot {
    numbers: std::sync::Arc<Numbers>,
    cell: Option<CellNow>,
    now_ns: u64,
    log_bytes: u64,
    samples_lost: u64,
    room_is_scarce: bool,
    program: String,
}

/// A sample of a family.
enum Sample<'a> {
    Real(f64),
    Whole(u64),
    Count(u64),
    Spread(&'a Distribution),
    Info,
}

impl Sample<'_> {
    fn encode(&self, encoder: &mut MetricEncoder<'_>, labels: &Labels<'_>) -> Result<(), Error> {
        match self {
            Sample::Real(value) => encoder.encode_gauge(value),
            Sample::Whole(value) => encoder.encode_gauge(value),
            Sample::Count(value) => encoder.encode_counter::<NoLabelSet, u64, f64>(value, None),
            Sample::Spread(distribution) => {
                let (sum, buckets) = distribution.read();
                let count = buckets.iter().map(|(_, count)| count).sum();
                encoder.encode_histogram::<NoLabelSet>(sum, count, &buckets, None)
            }
            Sample::Info => encoder.encode_info(labels),
        }
    }
}

type Labels<'a> = Vec<(&'a str, &'a str)>;

/// Encodes one family after the other.
struct Families<'a>(DescriptorEncoder<'a>);

impl Families<'_> {
    /// A family of this kind; a unit that is empty is none, as are labels.
    fn family<'s>(
        &mut self,
        (name, unit): (&str, &str),
        kind: MetricType,
        help: &str,
        samples: impl IntoIterator<Item = (Labels<'s>, Sample<'s>)>,
    ) -> Outcome {
        let unit = (!unit.is_empty()).then(|| Unit::Other(unit.into()));
        let mut encoder = self.0.encode_descriptor(name, help, unit.as_ref(), kind)?;
        for (labels, sample) in samples {
            match sample {
                _ if labels.is_empty() => sample.encode(&mut encoder, &labels)?,
                Sample::Info => sample.encode(&mut encoder, &labels)?,
                _ => sample.encode(&mut encoder.encode_family(&labels)?, &labels)?,
            }
        }
        Ok(())
    }

    fn gauge(&mut self, name: &str, unit: &str, help: &str, value: Option<f64>) -> Outcome {
        let value = value.map(|value| (Labels::new(), Sample::Real(value)));
        self.family((name, unit), MetricType::Gauge, help, value)
    }

    fn counter(&mut self, name: &str, unit: &str, help: &str, value: Option<u64>) -> Outcome {
        let value = value.map(|value| (Labels::new(), Sample::Count(value)));
        self.family((name, unit), MetricType::Counter, help, value)
    }

    /// Counts by a label.
    fn counters<'s>(
        &mut self,
        name: &str,
        help: &str,
        label: &'s str,
        counts: impl IntoIterator<Item = (&'s str, u64)>,
    ) -> Outcome {
        let counts = counts.into_iter();
        let counts = counts.map(|(word, count)| (vec![(label, word)], Sample::Count(count)));
        self.family((name, ""), MetricType::Counter, help, counts)
    }

    /// 1 for the one of some states that is.
    fn states<'s>(
        &mut self,
        name: &str,
        help: &str,
        states: impl IntoIterator<Item = (Labels<'s>, bool)>,
    ) -> Outcome {
        let states = states.into_iter();
        let states = states.map(|(labels, is)| (labels, Sample::Whole(u64::from(is))));
        self.family((name, ""), MetricType::Gauge, help, states)
    }

    fn of_axes(
        &mut self,
        name: &str,
        unit: &str,
        help: &str,
        axes: &[&AxisNumbers],
        of: Of,
    ) -> Outcome {
        let known = axes.iter().filter_map(|axis| {
            let value = of(&axis.values).get()?;
            Some((vec![("axis", axis.name.as_str())], Sample::Real(value)))
        });
        self.family((name, unit), MetricType::Gauge, help, known)
    }
}

type Outcome = Result<(), Error>;

/// One of the numbers of an axis.
type Of = fn(&AxisValues) -> &Number;

/// Where an axis is, before the distribution of its following error.
#[rustfmt::skip] // a table
const PLACES: [(&str, &str, Of); 4] = [
 ("axis_position", "Where the axis is.", |of| &of.position_m),
 ("axis_command", "Where the axis is commanded to be.", |of| &of.command_m),
 ("axis_following_error", "Command less feedback in the newest scan.", |of| &of.following_error_m),
 ("axis_following_error_peak", "Largest magnitude of the following error since this process started.", |of| &of.following_error_peak_m),
];

/// What the last reversal of an axis left.
#[rustfmt::skip] // a table
const REVERSALS: [(&str, &str, Of); 2] = [
 ("axis_reversal_protrusion", "Height that the last reversal on an arc left on the table.", |of| &of.protrusion_m),
 ("axis_reversal_following_error", "Largest magnitude of the following error around the last reversal.", |of| &of.reversal_error_m),
];

/// Torque of an axis.
#[rustfmt::skip] // a table
const TORQUES: [(&str, &str, Of); 2] = [
 ("axis_torque", "Torque of the motor.", |of| &of.torque_nm),
 ("axis_torque_peak", "Largest magnitude of the torque since this process started.", |of| &of.torque_peak_nm),
];

/// Friction of an axis.
#[rustfmt::skip] // a table
const FRICTION: [(&str, &str, Of); 2] = [
 ("axis_friction_level", "Friction that the servo goes by, as a part of that of its model.", |of| &of.friction_level),
 ("axis_friction_unexplained", "Part of Coulomb friction that the last way between two reversals left unexplained.", |of| &of.friction_unexplained),
];

impl Collector for Snapshot {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> Result<(), Error> {
        let mut families = Families(encoder);
        self.identity(&mut families)?;
        self.scans(&mut families)?;
        self.state(&mut families)?;
        self.losses(&mut families)?;
        for (kind, unit) in [(AxisKind::Linear, "meters"), (AxisKind::Rotary, "radians")] {
            let axes = self.numbers.axes.iter().filter(|axis| axis.kind == kind);
            let axes: Vec<&AxisNumbers> = axes.collect();
            if !axes.is_empty() {
                places(&mut families, unit, &axes)?;
            }
        }
        self.axes(&mut families)?;
        self.torques(&mut families)?;
        fieldbus::families(&mut families, &self.numbers.bus)?;
        self.signals(&mut families)?;
        self.processes(&mut families)
    }
}

/// Name of a cause in the label of a trip: `following-error`.
fn cause_label(cause: Cause) -> String {
    let mut label = String::new();
    for letter in format!("{cause:?}").chars() {
        if letter.is_uppercase() && !label.is_empty() {
            label.push('-');
        }
        label.push(letter.to_ascii_lowercase());
    }
    label
}

impl Snapshot {
    fn identity(&self, families: &mut Families<'_>) -> Outcome {
        let numbers = &*self.numbers;
        let version = vec![("version", env!("CARGO_PKG_VERSION"))];
        let help = "The program that serves the metrics.";
        let info = MetricType::Info;
        families.family(("build", ""), info, help, [(version, Sample::Info)])?;
        let identity = vec![
            ("machine", numbers.machine.as_str()),
            ("program", self.program.as_str()),
            ("pace", numbers.pace.word()),
        ];
        let help = "What the cell runs.";
        families.family(("cell", ""), info, help, [(identity, Sample::Info)])
    }

    /// A count of the cell; 0 before the first feedback.
    fn count(&self, of: impl Fn(CellNow) -> u64) -> Option<u64> {
        Some(self.cell.map_or(0, of))
    }

    fn scans(&self, families: &mut Families<'_>) -> Outcome {
        let numbers = &*self.numbers;
        let period_s = Some(numbers.scan_period_s);
        families.gauge("scan_period", "seconds", "Period of a scan.", period_s)?;
        if let Some(interval) = &numbers.scan_interval {
            let help =
                "Time between the beginnings of two scans, as a thread of an observer wakes.";
            let samples = [(Labels::new(), Sample::Spread(interval))];
            let of = ("scan_interval", "seconds");
            families.family(of, MetricType::Histogram, help, samples)?;
        }
        let scans = self.count(|cell| cell.scans);
        families.counter("scans", "", "Scans of the cell.", scans)?;
        let help = "Scans for which the master itself was late.";
        let overrun = self.count(|cell| u64::from(cell.overrun_scans));
        families.counter("overrun_scans", "", help, overrun)?;
        let help = "Time since the newest feedback was taken.";
        let cell = self.cell.as_ref();
        let age_s = cell.map(|cell| self.now_ns.saturating_sub(cell.heard_ns) as f64 * 1e-9);
        families.gauge("feedback_age", "seconds", help, age_s)
    }

    fn state(&self, families: &mut Families<'_>) -> Outcome {
        let cell = self.cell.as_ref();
        let modes = cell.into_iter().flat_map(|now| {
            let modes = Mode::ALL.iter();
            modes.map(|mode| (vec![("mode", mode.word())], now.mode == *mode as u32))
        });
        families.states("mode", "1 for the mode the machine is in.", modes)?;
        let hold = cell.map(|cell| f64::from(cell.hold));
        families.gauge("hold", "", "1 while feed hold is latched.", hold)?;
        let share = cell.map(|cell| f64::from(cell.override_percent) / 100.0);
        let help = "Feed override, 1 for 100 percent.";
        families.gauge("override", "ratio", help, share)?;
        let states = cell.into_iter().flat_map(|now| {
            let states = ProgramState::ALL.iter();
            states.map(|of| (vec![("state", of.word())], now.program == *of as u32))
        });
        let help = "1 for how far the cell is with its program.";
        families.states("program_state", help, states)?;
        let runs = self.count(|cell| u64::from(cell.runs));
        families.counter("runs", "", "Programs that were started.", runs)?;
        let help = "Share of the program's path that is done.";
        let share = self.numbers.progress_ratio.get();
        families.gauge("program_progress", "ratio", help, share)
    }

    /// What went wrong or was not heard, and what of it all is in the log.
    fn losses(&self, families: &mut Families<'_>) -> Outcome {
        let causes = Cause::ALL.into_iter().filter(|c| *c != Cause::None);
        let trips = causes.map(|cause| {
            let count = self.numbers.trips(cause).map_or(0, Count::get);
            (cause_label(cause), count)
        });
        let trips: Vec<(String, u64)> = trips.collect();
        let trips = trips.iter().map(|(label, count)| (label.as_str(), *count));
        families.counters("trips", "Trips by cause.", "cause", trips)?;
        let help = "Scans that the recorder did not get, and receptions that failed.";
        let lost = Some(self.samples_lost);
        families.counter("recorder_lost_samples", "", help, lost)?;
        let help = "1 while less is recorded than was asked for, because the disk is almost full.";
        let scarce = Some(f64::from(self.room_is_scarce));
        families.gauge("recorder_room_scarce", "", help, scarce)?;
        let help = "Bytes of the log that are in its files.";
        families.counter("log", "bytes", help, Some(self.log_bytes))
    }

    fn axes(&self, families: &mut Families<'_>) -> Outcome {
        let axes = || self.numbers.axes.iter();
        let counts = |of: fn(&AxisValues) -> &Count| {
            axes().map(move |axis| (axis.name.as_str(), of(&axis.values).get()))
        };
        let help = "Scans in which no command came in time.";
        let missed = counts(|axis| &axis.missed_scans);
        families.counters("axis_missed_scans", help, "axis", missed)?;
        let standby = axes().flat_map(|axis| {
            let now = axis.values.redundancy.get();
            Redundancy::ALL.iter().map(move |state| {
                let labels = vec![("axis", axis.name.as_str()), ("state", state.words())];
                (labels, now == Some(f64::from(*state as u32)))
            })
        });
        let help = "1 for how the standby of the axis is.";
        families.states("axis_standby", help, standby)?;
        let help =
            "How often the two servos of the axis have commanded different things after the same.";
        let differences = counts(|axis| &axis.differences);
        families.counters("axis_standby_differences", help, "axis", differences)?;
        let help = "Scans with the torque at its limit.";
        let limited = counts(|axis| &axis.torque_limited_scans);
        families.counters("axis_torque_limited_scans", help, "axis", limited)?;
        let reversals = counts(|axis| &axis.reversals);
        let help = "Reversals of the axis.";
        families.counters("axis_reversals", help, "axis", reversals)
    }

    /// Torque of the axes, and what comes of it.
    fn torques(&self, families: &mut Families<'_>) -> Outcome {
        let axes: &[&AxisNumbers] = &self.numbers.axes.iter().collect::<Vec<_>>();
        for (name, help, of) in TORQUES {
            families.of_axes(name, "newton_meters", help, axes, of)?;
        }
        for (index, one) in OF_AXIS.iter().enumerate() {
            let (name, unit) = one.metric;
            let name = format!("axis_{name}");
            let known = axes.iter().filter_map(|axis| {
                let value = axis.values.quantities.get(index)?.get()?;
                Some((vec![("axis", axis.name.as_str())], Sample::Real(value)))
            });
            families.family((&name, unit), MetricType::Gauge, one.help, known)?;
        }
        for (name, help, of) in FRICTION {
            families.of_axes(name, "ratio", help, axes, of)?;
        }
        Ok(())
    }

    fn signals(&self, families: &mut Families<'_>) -> Outcome {
        let numbers = &*self.numbers;
        let sample = numbers.signals();
        let sample = sample.as_deref();
        let signals = numbers.signal_names.iter().enumerate();
        let signals = signals.filter_map(|(index, name)| {
            let labels = vec![("signal", name.as_str())];
            Some((labels, *sample?.values.get(index)?, sample?.lost.has(index)))
        });
        let signals: Vec<_> = signals.collect();
        let values = signals.iter();
        let values = values.map(|(labels, value, _)| (labels.clone(), Sample::Real(*value)));
        let (gauge, help) = (MetricType::Gauge, "What a named input or output shows.");
        families.family(("signal_value", ""), gauge, help, values)?;
        let lost = signals.iter();
        let lost = lost.map(|(labels, _, lost)| (labels.clone(), *lost));
        families.states(
            "signal_lost",
            "1 while the source of a signal is lost.",
            lost,
        )?;
        let alarms = numbers.alarm_numbers.iter().enumerate();
        let alarms = alarms.filter_map(|(index, number)| {
            let labels = vec![("alarm", number.as_str())];
            Some((labels, has_bit(sample?.alarms, index)))
        });
        families.states("alarm_active", "1 while an alarm is there.", alarms)
    }

    fn processes(&self, families: &mut Families<'_>) -> Outcome {
        // Nothing is known of a process before a roster has named it.
        let named = |of: &&ProcessNumbers| of.starts.get() > 0;
        let processes = || self.numbers.processes.iter().filter(named);
        let gauge = MetricType::Gauge;
        let up = processes().map(|of| (labels(of), Sample::Whole(of.up.get())));
        let help = "1 while the process lives.";
        families.family(("process_up", ""), gauge, help, up)?;
        let starts = processes().map(|of| (labels(of), Sample::Count(of.starts.get())));
        let help = "Processes that have had this place.";
        families.family(("process_starts", ""), MetricType::Counter, help, starts)?;
        let ages = processes().filter_map(|of| {
            let age_s = of.age_scans.get()? * self.numbers.scan_period_s;
            Some((labels(of), Sample::Real(age_s)))
        });
        let help = "Time in scan periods since the process was last done with a scan.";
        families.family(("process_age", "seconds"), gauge, help, ages)
    }
}

fn labels(process: &ProcessNumbers) -> Labels<'_> {
    let role = match process.process.job {
        Job::Master => "master",
        job => job.word(),
    };
    vec![("process", process.name.as_str()), ("role", role)]
}

/// Families with a length or angle in them: one metric has one unit, so slides and rotary axes have their own.
fn places(families: &mut Families<'_>, unit: &str, axes: &[&AxisNumbers]) -> Outcome {
    for (name, help, of) in PLACES {
        families.of_axes(name, unit, help, axes, of)?;
    }
    let spread = axes.iter().map(|axis| {
        let labels = vec![("axis", axis.name.as_str())];
        (labels, Sample::Spread(&axis.following_error))
    });
    let help = "Magnitude of the following error, every scan.";
    let of = ("axis_following_error_magnitude", unit);
    families.family(of, MetricType::Histogram, help, spread)?;
    for (name, help, of) in REVERSALS {
        families.of_axes(name, unit, help, axes, of)?;
    }
    Ok(())
}
