//! The numbers as text: OpenMetrics 1.0 (<https://prometheus.io/docs/specs/om/open_metrics_spec/>), or the older text format of
//! Prometheus for those who do not ask for it. Base units are in the names; every metric is described in docs/howto/metrics.md.

mod fieldbus;

use std::fmt::Error;
use std::path::Path;

use bus::sample::{Cause, Job, Mode, ProgramState, Redundancy};
use machine::AxisKind;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::text::encode;
use prometheus_client::encoding::{DescriptorEncoder, MetricEncoder, NoLabelSet};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::{Registry, Unit};

use super::numbers::{AxisNumbers, CellNow, Count, Distribution, Number, Numbers, ProcessNumbers};
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
    program: String,
}

/// Encodes one family after the other.
struct Families<'a>(DescriptorEncoder<'a>);

impl Families<'_> {
    fn family(
        &mut self,
        name: &str,
        unit: Option<Unit>,
        kind: MetricType,
        help: &str,
        fill: impl FnOnce(&mut MetricEncoder<'_>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let mut encoder = self.0.encode_descriptor(name, help, unit.as_ref(), kind)?;
        fill(&mut encoder)
    }

    fn gauge(
        &mut self,
        name: &str,
        unit: Option<Unit>,
        help: &str,
        value: Option<f64>,
    ) -> Result<(), Error> {
        self.family(name, unit, MetricType::Gauge, help, |encoder| {
            value.map_or(Ok(()), |value| encoder.encode_gauge(&value))
        })
    }

    fn counter(
        &mut self,
        name: &str,
        unit: Option<Unit>,
        help: &str,
        value: u64,
    ) -> Result<(), Error> {
        self.family(name, unit, MetricType::Counter, help, |encoder| {
            encoder.encode_counter::<NoLabelSet, u64, f64>(&value, None)
        })
    }

    fn gauge_per_axis(
        &mut self,
        name: &str,
        unit: Unit,
        help: &str,
        axes: &[&AxisNumbers],
        of: impl Fn(&AxisNumbers) -> &Number,
    ) -> Result<(), Error> {
        self.family(name, Some(unit), MetricType::Gauge, help, |encoder| {
            for axis in axes {
                if let Some(value) = of(axis).get() {
                    let labels = [("axis", axis.name.as_str())];
                    encoder.encode_family(&labels)?.encode_gauge(&value)?;
                }
            }
            Ok(())
        })
    }

    fn counter_per_axis(
        &mut self,
        name: &str,
        help: &str,
        axes: &[AxisNumbers],
        of: impl Fn(&AxisNumbers) -> u64,
    ) -> Result<(), Error> {
        self.family(name, None, MetricType::Counter, help, |encoder| {
            for axis in axes {
                let labels = [("axis", axis.name.as_str())];
                encoder
                    .encode_family(&labels)?
                    .encode_counter::<NoLabelSet, u64, f64>(&of(axis), None)?;
            }
            Ok(())
        })
    }
}

impl Collector for Snapshot {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> Result<(), Error> {
        let mut families = Families(encoder);
        self.identity(&mut families)?;
        self.scans(&mut families)?;
        self.state(&mut families)?;
        self.program(&mut families)?;
        self.losses(&mut families)?;
        for kind in [AxisKind::Linear, AxisKind::Rotary] {
            let axes = self.numbers.axes.iter().filter(|axis| axis.kind == kind);
            let axes: Vec<&AxisNumbers> = axes.collect();
            if !axes.is_empty() {
                places(&mut families, kind, &axes)?;
            }
        }
        self.axes(&mut families)?;
        fieldbus::families(&mut families, &self.numbers.bus)?;
        self.processes(&mut families)
    }
}

/// Name of a cause in the label of a trip.
fn cause_label(cause: Cause) -> &'static str {
    match cause {
        Cause::None => "none",
        Cause::FollowingError => "following-error",
        Cause::SoftLimit => "soft-limit",
        Cause::SpeedLimit => "speed-limit",
        Cause::BadValue => "bad-value",
        Cause::BadFeedback => "bad-feedback",
        Cause::WindowMissing => "window-missing",
        Cause::Watchdog => "watchdog",
        Cause::ServoLost => "servo-lost",
        Cause::TorqueLimit => "torque-limit",
        Cause::Planner => "planner",
        Cause::NotInPosition => "not-in-position",
        Cause::MasterLost => "master-lost",
        Cause::Stalled => "stalled",
        Cause::DriveFault => "drive-fault",
        Cause::DriveLost => "drive-lost",
        Cause::DriveOff => "drive-off",
        Cause::NotReferenced => "not-referenced",
        Cause::Spindle => "spindle",
        Cause::ToolChange => "tool-change",
        Cause::ProbeMissed => "probe-missed",
        Cause::ProbeEarly => "probe-early",
        Cause::ProbeLost => "probe-lost",
        Cause::HomeSwitch => "home-switch",
        Cause::HomeIndex => "home-index",
        Cause::HomeDrive => "home-drive",
        Cause::EmergencyStop => "emergency-stop",
        Cause::Skew => "skew",
        Cause::Abort => "abort",
        Cause::GantryTorque => "gantry-torque",
        Cause::ProbeJogged => "probe-jogged",
    }
}

impl Snapshot {
    fn identity(&self, families: &mut Families<'_>) -> Result<(), Error> {
        let numbers = &*self.numbers;
        let info = MetricType::Info;
        families.family(
            "build",
            None,
            info,
            "The program that serves the metrics.",
            |e| e.encode_info(&[("version", env!("CARGO_PKG_VERSION"))]),
        )?;
        let identity = [
            ("machine", numbers.machine.as_str()),
            ("program", self.program.as_str()),
            ("pace", numbers.pace.word()),
        ];
        families.family("cell", None, info, "What the cell runs.", |e| {
            e.encode_info(&identity)
        })
    }

    /// A count of the cell; 0 before the first feedback.
    fn count(&self, of: impl Fn(CellNow) -> u64) -> u64 {
        self.cell.map_or(0, of)
    }

    fn scans(&self, families: &mut Families<'_>) -> Result<(), Error> {
        let numbers = &*self.numbers;
        families.gauge(
            "scan_period",
            Some(Unit::Seconds),
            "Period of a scan.",
            Some(numbers.scan_period_s),
        )?;
        if let Some(interval) = &numbers.scan_interval {
            let help =
                "Time between the beginnings of two scans, as a thread of an observer wakes.";
            let histogram = MetricType::Histogram;
            families.family("scan_interval", Some(Unit::Seconds), histogram, help, |e| {
                encode_distribution(e, interval)
            })?;
        }
        families.counter(
            "scans",
            None,
            "Scans of the cell.",
            self.count(|cell| cell.scans),
        )?;
        families.counter(
            "overrun_scans",
            None,
            "Scans for which the master itself was late.",
            self.count(|cell| u64::from(cell.overrun_scans)),
        )?;
        families.gauge(
            "feedback_age",
            Some(Unit::Seconds),
            "Time since the newest feedback was taken.",
            self.cell
                .map(|cell| self.now_ns.saturating_sub(cell.heard_ns) as f64 * 1e-9),
        )
    }

    fn state(&self, families: &mut Families<'_>) -> Result<(), Error> {
        let gauge = MetricType::Gauge;
        families.family(
            "mode",
            None,
            gauge,
            "1 for the mode the machine is in.",
            |e| {
                let Some(now) = self.cell else {
                    return Ok(());
                };
                Mode::ALL.iter().try_for_each(|mode: &Mode| {
                    let is = u32::from(now.mode == *mode as u32);
                    let labels = [("mode", mode.word())];
                    e.encode_family(&labels)?.encode_gauge(&is)
                })
            },
        )?;
        families.gauge(
            "hold",
            None,
            "1 while feed hold is latched.",
            self.cell.map(|cell| f64::from(cell.hold)),
        )?;
        families.gauge(
            "override",
            Some(Unit::Other("ratio".into())),
            "Feed override, 1 for 100 percent.",
            self.cell
                .map(|cell| f64::from(cell.override_percent) / 100.0),
        )
    }

    fn program(&self, families: &mut Families<'_>) -> Result<(), Error> {
        let numbers = &*self.numbers;
        let gauge = MetricType::Gauge;
        let help = "1 for how far the cell is with its program.";
        families.family("program_state", None, gauge, help, |e| {
            let Some(now) = self.cell else {
                return Ok(());
            };
            ProgramState::ALL.iter().try_for_each(|state| {
                let is = u32::from(now.program == *state as u32);
                let labels = [("state", state.word())];
                e.encode_family(&labels)?.encode_gauge(&is)
            })
        })?;
        families.counter(
            "runs",
            None,
            "Programs that were started.",
            self.count(|cell| u64::from(cell.runs)),
        )?;
        families.gauge(
            "program_progress",
            Some(Unit::Other("ratio".into())),
            "Share of the program's path that is done.",
            numbers.progress_ratio.get(),
        )
    }

    /// What went wrong or was not heard, and what of it all is in the log.
    fn losses(&self, families: &mut Families<'_>) -> Result<(), Error> {
        let numbers = &*self.numbers;
        let counter = MetricType::Counter;
        families.family("trips", None, counter, "Trips by cause.", |e| {
            let causes = Cause::ALL.into_iter().filter(|c| *c != Cause::None);
            causes.into_iter().try_for_each(|cause| {
                let count = numbers.trips(cause).map_or(0, Count::get);
                let labels = [("cause", cause_label(cause))];
                e.encode_family(&labels)?
                    .encode_counter::<NoLabelSet, u64, f64>(&count, None)
            })
        })?;
        families.counter(
            "recorder_lost_samples",
            None,
            "Scans that the recorder did not get, and receptions that failed.",
            self.samples_lost,
        )?;
        families.counter(
            "log",
            Some(Unit::Bytes),
            "Bytes of the log that are in its files.",
            self.log_bytes,
        )
    }

    fn axes(&self, families: &mut Families<'_>) -> Result<(), Error> {
        let axes = &self.numbers.axes;
        families.counter_per_axis(
            "axis_missed_scans",
            "Scans in which no command came in time.",
            axes,
            |axis| axis.missed_scans.get(),
        )?;
        families.family(
            "axis_standby",
            None,
            MetricType::Gauge,
            "1 for how the standby of the axis is.",
            |e| {
                axes.iter().try_for_each(|axis| {
                    let now = axis.redundancy.get();
                    Redundancy::ALL.iter().try_for_each(|state| {
                        let is = u32::from(now == Some(f64::from(*state as u32)));
                        let labels = [("axis", axis.name.as_str()), ("state", state.words())];
                        e.encode_family(&labels)?.encode_gauge(&is)
                    })
                })
            },
        )?;
        families.counter_per_axis(
            "axis_standby_differences",
            "How often the two servos of the axis have commanded different things after the same.",
            axes,
            |axis| axis.differences.get(),
        )?;
        families.counter_per_axis(
            "axis_torque_limited_scans",
            "Scans with the torque at its limit.",
            axes,
            |axis| axis.torque_limited_scans.get(),
        )?;
        families.counter_per_axis("axis_reversals", "Reversals of the axis.", axes, |axis| {
            axis.reversals.get()
        })?;
        self.torques(families)
    }

    /// Torque of the axes, and what comes of it.
    fn torques(&self, families: &mut Families<'_>) -> Result<(), Error> {
        let all: Vec<&AxisNumbers> = self.numbers.axes.iter().collect();
        let newton_meters = || Unit::Other("newton_meters".into());
        families.gauge_per_axis(
            "axis_torque",
            newton_meters(),
            "Torque of the motor.",
            &all,
            |axis| &axis.torque_nm,
        )?;
        families.gauge_per_axis(
            "axis_torque_peak",
            newton_meters(),
            "Largest magnitude of the torque since this process started.",
            &all,
            |axis| &axis.torque_peak_nm,
        )?;
        families.gauge_per_axis(
            "axis_winding_rise",
            Unit::Other("kelvin".into()),
            "Winding temperature above ambient.",
            &all,
            |axis| &axis.winding_k,
        )?;
        families.gauge_per_axis(
            "axis_friction_level",
            Unit::Other("ratio".into()),
            "Friction that the servo goes by, as a part of that of its model.",
            &all,
            |axis| &axis.friction_level,
        )?;
        families.gauge_per_axis(
            "axis_friction_unexplained",
            Unit::Other("ratio".into()),
            "Part of Coulomb friction that the last way between two reversals left unexplained.",
            &all,
            |axis| &axis.friction_unexplained,
        )
    }

    fn processes(&self, families: &mut Families<'_>) -> Result<(), Error> {
        let processes = &self.numbers.processes;
        let labels = |process: &ProcessNumbers| {
            let role = match process.process.job {
                Job::Master => "master",
                job => job.word(),
            };
            [
                ("process", process.name.clone()),
                ("role", role.to_string()),
            ]
        };
        let gauge = MetricType::Gauge;
        families.family(
            "process_up",
            None,
            gauge,
            "1 while the process lives.",
            |e| {
                processes.iter().try_for_each(|process| {
                    e.encode_family(&labels(process))?
                        .encode_gauge(&process.up.get())
                })
            },
        )?;
        let help = "Processes that have had this place.";
        families.family("process_starts", None, MetricType::Counter, help, |e| {
            processes.iter().try_for_each(|process| {
                e.encode_family(&labels(process))?
                    .encode_counter::<NoLabelSet, u64, f64>(&process.starts.get(), None)
            })
        })?;
        let help = "Time in scan periods since the process was last done with a scan.";
        families.family("process_age", Some(Unit::Seconds), gauge, help, |e| {
            processes.iter().try_for_each(|process| {
                let Some(age_scans) = process.age_scans.get() else {
                    return Ok(());
                };
                e.encode_family(&labels(process))?
                    .encode_gauge(&(age_scans * self.numbers.scan_period_s))
            })
        })
    }
}

fn encode_distribution(
    encoder: &mut MetricEncoder<'_>,
    distribution: &Distribution,
) -> Result<(), Error> {
    let (sum, buckets) = distribution.read();
    let count = buckets.iter().map(|(_, count)| count).sum();
    encoder.encode_histogram::<NoLabelSet>(sum, count, &buckets, None)
}

/// Families with a length or angle in them: one metric has one unit, so slides and rotary axes have their own.
fn places(families: &mut Families<'_>, kind: AxisKind, axes: &[&AxisNumbers]) -> Result<(), Error> {
    let unit = || match kind {
        AxisKind::Linear => Unit::Meters,
        AxisKind::Rotary => Unit::Other("radians".into()),
    };
    families.gauge_per_axis(
        "axis_position",
        unit(),
        "Where the axis is.",
        axes,
        |axis| &axis.position_m,
    )?;
    families.gauge_per_axis(
        "axis_command",
        unit(),
        "Where the axis is commanded to be.",
        axes,
        |axis| &axis.command_m,
    )?;
    families.gauge_per_axis(
        "axis_following_error",
        unit(),
        "Command less feedback in the newest scan.",
        axes,
        |axis| &axis.following_error_m,
    )?;
    families.gauge_per_axis(
        "axis_following_error_peak",
        unit(),
        "Largest magnitude of the following error since this process started.",
        axes,
        |axis| &axis.following_error_peak_m,
    )?;
    let help = "Magnitude of the following error, every scan.";
    families.family(
        "axis_following_error_magnitude",
        Some(unit()),
        MetricType::Histogram,
        help,
        |encoder| {
            for axis in axes {
                let labels = [("axis", axis.name.as_str())];
                encode_distribution(&mut encoder.encode_family(&labels)?, &axis.following_error)?;
            }
            Ok(())
        },
    )?;
    families.gauge_per_axis(
        "axis_reversal_protrusion",
        unit(),
        "Height that the last reversal on an arc left on the table.",
        axes,
        |axis| &axis.protrusion_m,
    )?;
    families.gauge_per_axis(
        "axis_reversal_following_error",
        unit(),
        "Largest magnitude of the following error around the last reversal.",
        axes,
        |axis| &axis.reversal_error_m,
    )
}
