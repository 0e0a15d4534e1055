//! `quadrant runs export`: the rows of a log, a file of their own.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::ops::RangeInclusive;

use anyhow::{Context, bail};
use bus::layout::leaves;
use machine::{AxisKind, Machine};
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Compression, McapError, WriteOptions};
use monitor::log::{AxisRow, ENCAPSULATION, Extent, Layout, RING_SCANS, Rows, RunLog, Sample};

use super::{found, must_be_no_cell, shown};
use crate::evaluation::fits;
use crate::options::ExportOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;
use launcher::progress;

/// Scans that are written at once; then progress is shown, and Ctrl-C heard.
const BLOCK_SCANS: u64 = 1000;

/// `quadrant runs export`.
pub(super) fn export(options: &ExportOptions) -> Outcome {
    let run = options
        .run
        .canonicalize()
        .with_context(|| shown(&options.run));
    let run = run.input()?;
    let name = run.file_name().unwrap_or_default().to_string_lossy();
    let beside = || format!("{name}.{}", options.format).into();
    let out = options.out.clone().unwrap_or_else(beside);
    let signals = Signals::catch().environment()?;
    match machine::replace_with(&out, |file| write(options, file, &signals)) {
        Ok(()) => {
            say(&format!("{}: written", shown(&out)));
            Ok(())
        }
        Err(_) if signals.count() > 0 => Err(Failure::Interrupted),
        Err(error) if error.is::<io::Error>() => Err(Failure::Environment(
            error.context(format!("{}: cannot be written", shown(&out))),
        )),
        Err(error) => Err(Failure::Input(error)),
    }
}

/// Writes what is wanted of the log.
fn write(options: &ExportOptions, file: &mut File, signals: &Signals) -> anyhow::Result<()> {
    must_be_no_cell(&options.run)?;
    let machine = Machine::load(&options.run)?;
    let mut log = RunLog::open(&options.run)?;
    fits(&options.run, &machine, &log)?;
    let wanted = scans(options, log.scan_period_us())?;
    let axes = axes(log.axes(), &options.axes)?;
    let out = BufWriter::new(file);
    let mut sheet = match options.format.as_str() {
        "csv" => csv(out, &machine, &axes)?,
        #[cfg(feature = "parquet")]
        "parquet" => super::parquet::parquet(out, names(&machine, &axes))?,
        #[cfg(not(feature = "parquet"))]
        "parquet" => bail!("--as parquet: not in this build: cargo build --features parquet"),
        _ => mcap(out, &machine, &axes).map_err(io::Error::other)?,
    };
    let count = found::report_of(&options.run)["scans"].as_u64();
    let begins_at = log.info().begins_at();
    let seconds = |scan: u64| scan as f64 * machine.scan_period_s();
    let bar = progress::bar(true);
    let (mut rows, mut made) = (Rows::new(&machine), Vec::new());
    let (mut next_block, mut any) = (0, false);
    while let Some(sample) = log.next_sample()? {
        let axis = match &sample {
            Sample::Command(command) => command.axis as usize,
            _ => 0,
        };
        let taken = sample.as_ref(axis);
        let scan = taken.scan();
        if matches!(sample, Sample::Feedback(_)) && scan >= next_block {
            next_block = scan + BLOCK_SCANS;
            let until = scan.saturating_sub(RING_SCANS as u64);
            rows.rest(until, &mut made);
            any |= put(&mut made, until, &axes, &mut sheet)?;
            if signals.count() > 0 || until > *wanted.end() {
                break;
            }
            let read = scan.saturating_sub(begins_at) * 1000;
            bar.set_position(read / count.unwrap_or(u64::MAX).max(1));
            bar.set_message(format!("{:.1} s of the log", seconds(scan)));
        }
        if wanted.contains(&scan) {
            rows.take(taken, &mut made);
        }
    }
    bar.finish_and_clear();
    rows.rest(u64::MAX, &mut made);
    any |= put(&mut made, u64::MAX, &axes, &mut sheet)?;
    let run = shown(&options.run);
    if let Some(cut) = log.cut() {
        tracing::warn!("{run}: the log ends early: {cut}");
    }
    if !any || signals.count() > 0 {
        let last = log.parts().iter().filter_map(|part| part.last_scan).max();
        let (from_s, to_s) = (seconds(begins_at), seconds(last.unwrap_or(begins_at)));
        bail!("{run}: nothing between --from and --to: read from {from_s:.3} to {to_s:.3} s");
    }
    Ok(sheet(None)?)
}

/// Indices of the axes that were named; of all where none was.
fn axes(all: &[String], named: &[String]) -> anyhow::Result<Vec<usize>> {
    if let Some(other) = named.iter().find(|of| !all.contains(of)) {
        let all = all.join(",");
        bail!("--axes {other}: the run has no such axis: must be of {all}");
    }
    let wanted = |axis: &usize| named.is_empty() || named.contains(&all[*axis]);
    Ok((0..all.len()).filter(wanted).collect())
}

/// The scans that are wanted.
fn scans(options: &ExportOptions, period_us: u32) -> anyhow::Result<RangeInclusive<u64>> {
    let (from, to) = (options.from.unwrap_or(0.0), options.to.unwrap_or(f64::MAX));
    if !(from >= 0.0 && to >= from) {
        bail!("--from {from} s, --to {to} s: must be times from 0 s up, the later one last");
    }
    // A time that was copied from a row is the time of its scan.
    let scans = |time_s: f64, more: f64| time_s * 1e6 / f64::from(period_us) + more;
    Ok(scans(from, -1e-3).ceil() as u64..=scans(to, 1e-3).floor() as u64)
}

/// Rows of one scan: index of the axis, scan, row.
pub(super) type ScanRows = [(usize, u64, AxisRow)];

pub(super) type Out<'f> = BufWriter<&'f mut File>;

/// Takes scan by scan; none ends the file.
pub(super) type Sheet<'f> = Box<dyn FnMut(Option<&ScanRows>) -> io::Result<()> + 'f>;

/// Hands the rows of these axes before the scan `until` on, in order of scan; whether there were any.
fn put(
    made: &mut Vec<(usize, u64, AxisRow)>,
    until: u64,
    axes: &[usize],
    sheet: &mut Sheet<'_>,
) -> io::Result<bool> {
    made.sort_by_key(|(axis, scan, _)| (*scan, *axis));
    let ready = made.partition_point(|(_, scan, _)| *scan < until);
    let ready = made.drain(..ready).filter(|row| axes.contains(&row.0));
    let ready: Vec<_> = ready.collect();
    for rows in ready.chunk_by(|one, next| one.1 == next.1) {
        sheet(Some(rows))?;
    }
    Ok(!ready.is_empty())
}

/// The names of the columns of these axes, behind scan and time.
fn names(machine: &Machine, axes: &[usize]) -> Vec<String> {
    let axes = axes.iter().map(|&axis| &machine.axes[axis]);
    let of_axis = axes.flat_map(|axis| {
        let leaves = leaves::<AxisRow>().into_iter().skip(1);
        leaves.map(|leaf| match axis.kind {
            AxisKind::Linear => format!("{}.{}", axis.name, leaf.name),
            AxisKind::Rotary => {
                let name = leaf.name.replace("_mm", "_deg").replace("_um", "_mdeg");
                format!("{}.{name}", axis.name)
            }
        })
    });
    of_axis.collect()
}

/// A line each scan, below the names of the columns.
fn csv<'f>(mut out: Out<'f>, machine: &Machine, axes: &[usize]) -> io::Result<Sheet<'f>> {
    writeln!(out, "scan,time_s,{}", names(machine, axes).join(","))?;
    Ok(Box::new(move |rows| {
        let Some(rows @ [(_, scan, first), ..]) = rows else {
            return out.flush();
        };
        write!(out, "{scan},{}", first.time_s)?;
        for (.., row) in rows {
            let [_, values @ ..]: &[f64; 9] = bytemuck::cast_ref(row);
            for value in values {
                let known = value.is_finite().then(|| value.to_string());
                write!(out, ",{}", known.unwrap_or_default())?;
            }
        }
        writeln!(out)
    }))
}

/// A message each scan and axis, as the log has them.
fn mcap<'f>(out: Out<'f>, machine: &Machine, axes: &[usize]) -> Result<Sheet<'f>, McapError> {
    let mut writer = WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .profile("ros2")
        .library(concat!("quadrant ", env!("CARGO_PKG_VERSION")))
        .disable_seeking(true)
        .create(NoSeek::new(out))?;
    let layout = Layout::of::<AxisRow>(&Extent::of(machine));
    let schema = layout.schema.as_bytes();
    let schema = writer.add_schema(&layout.schema_name, "ros2msg", schema)?;
    let metadata = [("offered_qos_profiles".to_string(), String::new())].into();
    let channels = axes.iter().map(|&axis| {
        let topic = format!("/axis/{}", machine.axes[axis].name);
        writer.add_channel(schema, &topic, "cdr", &metadata)
    });
    let channels = channels.collect::<Result<Vec<_>, _>>()?;
    let period_ns = u64::from(machine.scan.period_us) * 1000;
    let mut sequence = 0;
    Ok(Box::new(move |rows| {
        let Some(rows) = rows else {
            return writer.finish().map(drop).map_err(io::Error::other);
        };
        for (&channel_id, (_, scan, row)) in channels.iter().zip(rows) {
            let log_time = scan.saturating_mul(period_ns);
            let header = MessageHeader {
                channel_id,
                sequence,
                log_time,
                publish_time: log_time,
            };
            let message = [&ENCAPSULATION, bytemuck::bytes_of(row)].concat();
            let sent = writer.write_to_known_channel(&header, &message);
            sent.map_err(io::Error::other)?;
        }
        sequence += 1;
        Ok(())
    }))
}
