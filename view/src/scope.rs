//! `quadrant scope`: signals around a trigger, from a running cell or from a log.
//!
//! What is shown and when is decided in [`report::scope`], the same for both; here are its two sources, `live` and `log`, the
//! `path` of the program for those who need it, and where captures go: files, or a `chart` in the terminal.

mod chart;
mod live;
mod log;
mod path;
mod source;

use std::fs::OpenOptions;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use machine::Machine;
use report::scope::signal::Signal;
use report::scope::trigger::Trigger;
use report::scope::{Capture, Scope, Settings, csv};

use crate::options::ScopeOptions;
use console::exit::{Failure, Kind, Outcome};
use console::logs;
use console::output::{self, say};
use console::signals::Signals;
use path::Wanted;
use source::Source;

/// Columns where there is no terminal that says how many it has.
const COLUMNS: usize = 80;
/// Nobody is told of a wait that is over by then.
const TELL_AFTER: Duration = Duration::from_secs(1);
/// So long a capture that has started is waited for beyond the time limit and its own length.
const GRACE: Duration = Duration::from_secs(5);

/// `quadrant scope`.
pub fn scope(options: &ScopeOptions) -> Outcome {
    logs::init_launcher();
    for file in options.csv.iter().chain(&options.svg) {
        can_be_written(file)?;
    }
    if options.signal.is_empty() && !options.list {
        return Err(Failure::Input(anyhow!(
            "no signal is named: --signal X.following_error; --list shows all"
        )));
    }
    let source: Box<dyn Source> = match &options.log {
        Some(path) => Box::new(log::LogSource::open(path)?),
        None => Box::new(live::LiveSource::attach(options.cell.as_deref())?),
    };
    let machine = source.machine().clone();
    if options.list {
        say(list(&machine).trim_end());
        return Ok(());
    }
    let signals = options.signal.iter().flat_map(|names| names.split(','));
    let signals = signals.map(|name| Signal::parse(name, &machine));
    let trigger = Trigger::parse(&options.trigger, &machine).input()?;
    let period_us = machine.scan.period_us;
    let settings = Settings {
        signals: signals.collect::<Result<Vec<_>, _>>().input()?,
        before: options.before.scans(period_us),
        after: options.after.scans(period_us),
        from: options.from.unwrap_or(0),
        fill_first: source.is_live(),
        trigger,
    };
    settings.check().input()?;
    capture(options, source, &machine, settings)
}

/// Captures until there are as many as were asked for, the source ends, the time is over or somebody interrupts.
fn capture(
    options: &ScopeOptions,
    mut source: Box<dyn Source>,
    machine: &Machine,
    settings: Settings,
) -> Outcome {
    let period_us = machine.scan.period_us;
    let wanted = Wanted::of(&settings);
    let mut scope = Scope::new(machine, settings);
    let mut sink = Sink::new(options);
    let interrupted = Signals::catch().environment()?;
    let limit = options
        .timeout
        .map(|span| Duration::from_secs_f64(span.seconds(period_us)));
    let patience = Duration::from_secs_f64(options.after.seconds(period_us)) + GRACE;
    let started = Instant::now();
    let mut told = !source.is_live();
    let wanted_captures = if options.every {
        u64::MAX
    } else {
        options.count
    };
    loop {
        let more = source.feed(&mut scope, &wanted)?;
        if !more {
            scope.finish();
        }
        while let Some(capture) = scope.next_capture() {
            sink.put(&capture)?;
            if sink.count >= wanted_captures {
                return Ok(());
            }
        }
        if !more {
            let why = format!("{} ended", source.name());
            return ended(&sink, options, &scope, &why);
        }
        if interrupted.count() > 0 {
            return Err(Failure::Interrupted);
        }
        if !told && !scope.is_capturing() && sink.count == 0 && started.elapsed() > TELL_AFTER {
            told = true;
            tracing::info!(
                "waiting for trigger {:?} (Ctrl-C ends it, --timeout limits it)",
                options.trigger
            );
        }
        let Some(limit) = limit else {
            continue;
        };
        let over = started.elapsed().saturating_sub(limit);
        if over > patience && scope.is_capturing() {
            // Its last scans do not come: the master is silent.
            scope.finish();
            while let Some(capture) = scope.next_capture() {
                sink.put(&capture)?;
            }
        }
        if over > Duration::ZERO && !scope.is_capturing() {
            let why = format!("{:.1} s have passed", limit.as_secs_f64());
            return ended(&sink, options, &scope, &why);
        }
    }
}

/// Nothing more is waited for: well, if anything was captured that can be all there is.
fn ended(sink: &Sink, options: &ScopeOptions, scope: &Scope, why: &str) -> Outcome {
    let asked = &options.trigger;
    if sink.count > 0 && options.every {
        return Ok(());
    }
    let message = if sink.count > 0 {
        format!(
            "{why} after {} of {} captures of {asked:?}",
            sink.count, options.count
        )
    } else {
        format!("{why} without trigger {asked:?}: {}", scope.seen_instead())
    };
    Err(Failure::Stopped(anyhow!(message)))
}

/// All signals of a machine, as a table.
fn list(machine: &Machine) -> String {
    let all = Signal::all(machine);
    let width = all
        .iter()
        .map(|signal| signal.name.len())
        .max()
        .unwrap_or(0);
    let mut text = String::new();
    for signal in &all {
        let (name, unit) = (&signal.name, signal.unit.shown);
        text += &format!("{name:width$}  {unit:6}  {}\n", signal.about);
    }
    text
}

/// Refuses a file that cannot be made before anything is waited for.
fn can_be_written(file: &Path) -> Result<(), Failure> {
    if file == Path::new("-") {
        return Ok(());
    }
    let shown = file.display();
    let wrong = |what: &str| Err(Failure::Input(anyhow!("{shown}: {what}")));
    if file.is_dir() {
        return wrong("is a folder: must be the name of a file");
    }
    let folder = match file.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return wrong("its folder does not exist");
    }
    let made = !file.exists();
    OpenOptions::new()
        .append(true)
        .create(true)
        .open(file)
        .with_context(|| format!("{shown}: cannot be written"))
        .input()?;
    if made {
        // Nobody is to find an empty table where nothing was captured.
        let _ = std::fs::remove_file(file);
    }
    Ok(())
}

/// Where captures go.
struct Sink<'a> {
    csv: Option<&'a Path>,
    svg: Option<&'a Path>,
    columns: usize,
    count: u64,
}

impl<'a> Sink<'a> {
    fn new(options: &'a ScopeOptions) -> Sink<'a> {
        let size = ratatui::crossterm::terminal::size();
        let terminal = std::io::stdout().is_terminal();
        let columns = size.ok().filter(|_| terminal);
        Sink {
            csv: options.csv.as_deref(),
            svg: options.svg.as_deref(),
            columns: columns.map_or(COLUMNS, |(columns, _)| usize::from(columns)),
            count: 0,
        }
    }

    fn put(&mut self, capture: &Capture) -> Result<(), Failure> {
        self.count += 1;
        if self.csv.is_none() && self.svg.is_none() {
            if self.count > 1 {
                say("");
            }
            say(chart::text(capture, self.columns).trim_end());
            return Ok(());
        }
        let mut written = Vec::new();
        if let Some(file) = self.csv {
            let first = self.count == 1;
            let mut text = if first {
                csv::header(capture)
            } else {
                String::new()
            };
            text += &csv::rows(capture);
            if file == Path::new("-") {
                // Nothing else may be in it.
                let mut out = std::io::stdout().lock();
                if let Err(error) = out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
                    output::note_failure(error);
                }
            } else {
                append(file, first, &text)
                    .with_context(|| format!("{}: cannot be written", file.display()))
                    .environment()?;
                written.push(file.display().to_string());
            }
        }
        if let Some(file) = self.svg {
            let file = numbered(file, self.count);
            report::scope_picture::write(&file, capture).environment()?;
            written.push(file.display().to_string());
        }
        let words = format!("{}: {}", capture.title(), written.join(", "));
        if self.csv == Some(Path::new("-")) {
            tracing::info!("{words}");
        } else {
            say(&words);
        }
        Ok(())
    }
}

fn append(file: &Path, first: bool, text: &str) -> std::io::Result<()> {
    let mut options = OpenOptions::new();
    options.create(true);
    if first {
        options.write(true).truncate(true);
    } else {
        options.append(true);
    }
    options.open(file)?.write_all(text.as_bytes())
}

/// The name of the picture of a capture: that of the first is the one that was asked for.
fn numbered(file: &Path, number: u64) -> PathBuf {
    if number <= 1 {
        return file.to_path_buf();
    }
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let extension = file.extension().unwrap_or_default().to_string_lossy();
    file.with_file_name(format!("{stem}-{number}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_further_captures_are_numbered() {
        let file = Path::new("plots/x.svg");
        assert_eq!(numbered(file, 1), file);
        assert_eq!(numbered(file, 2), Path::new("plots/x-2.svg"));
    }
}
