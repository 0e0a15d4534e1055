//! Logs: every process writes lines to its standard error; the launcher forwards its children's with their names.

use std::io::{BufRead, BufReader, IsTerminal, Write};
use std::process::ChildStderr;
use std::sync::{Mutex, OnceLock, PoisonError};

use indicatif::ProgressBar;

use tracing_subscriber::EnvFilter;

/// Variable with the filter of all processes, in the syntax of `tracing` (info, debug, servo=trace, …).
pub const FILTER_VARIABLE: &str = "QUADRANT_LOG";

fn filter(default: &str) -> EnvFilter {
    EnvFilter::try_from_env(FILTER_VARIABLE).unwrap_or_else(|_| EnvFilter::new(default))
}

/// The progress bar that stands below the log, once there is one.
static BAR: OnceLock<ProgressBar> = OnceLock::new();

/// Keeps this bar out of the way of log lines.
pub fn write_above(bar: &ProgressBar) {
    let _ = BAR.set(bar.clone());
}

/// Lines that wait until the terminal is free again.
static HELD: Mutex<Option<Vec<u8>>> = Mutex::new(None);
/// The most bytes that wait; of more, the first are kept.
const HELD_BYTES_MAX: usize = 256 << 10;

/// Keeps log lines back: the terminal shows something else.
pub fn hold_back() {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    held.get_or_insert_with(Vec::new);
}

/// Writes what was kept back, and all else as it comes.
pub fn release() {
    let held = HELD.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let Some(lines) = held {
        let _ = std::io::stderr().write_all(&lines);
    }
}

/// Standard error, with the progress bar taken away while a line is written.
struct AboveTheBar;

impl Write for AboveTheBar {
    fn write(&mut self, buffer: &[u8]) -> std::io::Result<usize> {
        if let Some(held) = &mut *HELD.lock().unwrap_or_else(PoisonError::into_inner) {
            if held.len() + buffer.len() <= HELD_BYTES_MAX {
                held.extend_from_slice(buffer);
            }
            return Ok(buffer.len());
        }
        // A terminal that is gone is no reason to lose the run: what cannot be written is dropped.
        let written = match BAR.get() {
            Some(bar) => bar.suspend(|| std::io::stderr().write_all(buffer)),
            None => std::io::stderr().write_all(buffer),
        };
        drop(written);
        Ok(buffer.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let _ = std::io::stderr().flush();
        Ok(())
    }
}

/// Logging of the launcher and of commands that run alone.
pub fn init_launcher() {
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter("info"))
        .with_writer(|| AboveTheBar)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .try_init();
}

/// Logging of a child: plain lines that the launcher understands.
pub fn init_role() {
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter("info"))
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .with_target(false)
        .without_time()
        .try_init();
}

/// Passes a child's lines on until it closes its standard error.
pub fn forward(process: String, stderr: ChildStderr) -> std::thread::JoinHandle<()> {
    std::thread::spawn(move || {
        let mut lines = BufReader::new(stderr);
        let mut line = Vec::new();
        while let Ok(1..) = lines.read_until(b'\n', &mut line) {
            let text = String::from_utf8_lossy(&line);
            let text = text.trim();
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
            line.clear();
        }
    })
}
