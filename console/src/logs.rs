//! Logs: every process writes lines to its standard error; the launcher forwards its children's with their names.

use std::io::{BufRead, BufReader, IsTerminal, Read, Write};
use std::process::ChildStderr;
use std::sync::OnceLock;

use anyhow::bail;
use indicatif::ProgressBar;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::layer;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::registry;
use tracing_subscriber::util::SubscriberInitExt;

use crate::output::{self, Stream};

/// Variable with the filter of all processes, in the syntax of `tracing` (info, debug, servo=trace, …).
pub const FILTER_VARIABLE: &str = "QUADRANT_LOG";

fn filter() -> Targets {
    let set = std::env::var(FILTER_VARIABLE).unwrap_or_default();
    match set.parse() {
        Ok(filter) if !set.trim().is_empty() => filter,
        _ => Targets::new().with_default(LevelFilter::INFO),
    }
}

/// What may be named in the filter: the parts of quadrant and the libraries that log.
const TARGETS: &str = "bus, console, fieldbus, iceoryx2, lab, launcher, loops, machine, master, model, monitor, path, planner, \
 plant_sim, program, quadrant, remote, servo, tune, view, zenoh, ethercrab";

/// Whether the filter that is set can be obeyed.
///
/// # Errors
/// It names a level or a part that there is not, or is no filter.
pub fn check_filter() -> anyhow::Result<()> {
    let Ok(filter) = std::env::var(FILTER_VARIABLE) else {
        return Ok(());
    };
    let mut directives = filter.split(',').map(str::trim);
    match directives.find(|directive| !is_directive(directive)) {
        Some(wrong) if !filter.trim().is_empty() => bail!(
            "{FILTER_VARIABLE}={filter}: {wrong:?}: must be off, error, warn, info, debug or trace, for one part alone PART=LEVEL, such as \
   info,servo=trace; parts are {TARGETS}"
        ),
        _ => Ok(()),
    }
}

fn is_directive(directive: &str) -> bool {
    let is_level = |word: &str| word.parse::<LevelFilter>().is_ok();
    let is_target = |word: &str| {
        let part = word.split("::").next().unwrap_or_default();
        TARGETS.split(", ").any(|known| known == part)
    };
    match directive.rsplit_once('=') {
        Some((target, level)) => is_target(target) && is_level(level),
        None => is_level(directive) || is_target(directive),
    }
}

/// The progress bar that stands below the log, once there is one.
static BAR: OnceLock<ProgressBar> = OnceLock::new();

/// Keeps this bar out of the way of log lines.
pub fn write_above(bar: &ProgressBar) {
    let _ = BAR.set(bar.clone());
}

/// Standard error, with the progress bar taken away while a line is written.
struct AboveTheBar;

impl Write for AboveTheBar {
    fn write(&mut self, buffer: &[u8]) -> std::io::Result<usize> {
        // A terminal that is gone is no reason to lose the run: what cannot be written is dropped.
        match BAR.get() {
            Some(bar) => bar.suspend(|| output::print(Stream::Err, buffer)),
            None => output::print(Stream::Err, buffer),
        }
        Ok(buffer.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Logging of the launcher and of commands that run alone.
pub fn init_launcher() {
    let lines = layer().with_writer(|| AboveTheBar);
    let lines = lines.with_ansi(std::io::stderr().is_terminal());
    let lines = lines.with_target(false).without_time();
    let _ = registry().with(filter()).with(lines).try_init();
}

/// Logging of a child: plain lines that the launcher understands.
pub fn init_role() {
    let lines = layer().with_writer(std::io::stderr).with_ansi(false);
    let lines = lines.with_target(false).without_time();
    let _ = registry().with(filter()).with(lines).try_init();
}

/// Bytes of a child's line; a longer one is passed on in pieces.
const LINE_MAX: u64 = 4 << 10;

/// With this a process begins to say why it gives up: the last that it says.
const LAST_WORDS: &str = "quadrant: ";

/// Passes a child's lines on until it closes its standard error; why it gave up is kept for whoever waits for the thread. It is read
/// whether anybody takes the lines or not: a child that prints never waits for a terminal.
///
/// # Errors
/// There can be no thread for it.
pub fn forward(
    process: String,
    stderr: ChildStderr,
) -> std::io::Result<std::thread::JoinHandle<Option<String>>> {
    let thread = std::thread::Builder::new().name("qd-lines".into());
    thread.spawn(move || {
        let mut lines = BufReader::new(stderr);
        let mut line = Vec::new();
        let mut last_words: Option<String> = None;
        while let Ok(1..) = (&mut lines).take(LINE_MAX).read_until(b'\n', &mut line) {
            let text = String::from_utf8_lossy(&line);
            let text = text.trim();
            match (text.strip_prefix(LAST_WORDS), &mut last_words) {
                (_, Some(words)) if words.len() < LINE_MAX as usize => {
                    words.push('\n');
                    words.push_str(text);
                }
                (Some(words), None) => last_words = Some(words.into()),
                _ => pass_on(&process, text),
            }
            line.clear();
        }
        last_words
    })
}

/// Passes one line on.
fn pass_on(process: &str, text: &str) {
    match text.split_once(' ') {
        Some(("ERROR", rest)) => tracing::error!("{process}: {}", rest.trim_start()),
        Some(("WARN", rest)) => tracing::warn!("{process}: {}", rest.trim_start()),
        Some(("INFO", rest)) => tracing::info!("{process}: {}", rest.trim_start()),
        Some(("DEBUG", rest)) => tracing::debug!("{process}: {}", rest.trim_start()),
        Some(("TRACE", rest)) => tracing::trace!("{process}: {}", rest.trim_start()),
        _ if text.is_empty() => {}
        // Not a log line: a panic message or a library's complaint.
        _ => tracing::error!("{process}: {text}"),
    }
}

/// Passes a child's lines on, why it gives up among them.
///
/// # Errors
/// There can be no thread for it.
pub fn forward_all(process: String, stderr: ChildStderr) -> std::io::Result<()> {
    let lines = forward(process.clone(), stderr)?;
    let thread = std::thread::Builder::new().name("qd-last".into());
    thread.spawn(move || {
        if let Ok(Some(words)) = lines.join() {
            tracing::error!("{process}: {words}");
        }
    })?;
    Ok(())
}
