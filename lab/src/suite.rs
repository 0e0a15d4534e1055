//! `quadrant-lab suite`: the project's tests, and where their time goes.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, anyhow, ensure};
use clap::Args;
use console::exit::{Failure, Kind, Outcome};
use serde_json::Value;

use crate::processor_time;

/// Number of the longest modules and tests that are shown.
const SHOWN: usize = 20;
/// A test that took longer is told of as soon as it is over.
const LONG_S: f64 = 5.0;

/// What `quadrant-lab suite` takes.
#[derive(Debug, Clone, Args)]
pub struct SuiteOptions {
    /// Only tests whose names hold this
    pub filter: Option<String>,
    /// Heavy tests in their full size (docs/developers/tests.md)
    #[arg(long)]
    pub full: bool,
}

/// A test executable, its main source, and the manifest of its package.
#[derive(Debug, PartialEq)]
struct Executable {
    file: PathBuf,
    source: PathBuf,
    manifest: PathBuf,
}

/// A test that is over: `ok`, `failed` or `ignored`, and what it printed if it failed.
#[derive(Debug, PartialEq)]
struct Ended {
    name: String,
    event: String,
    seconds: f64,
    said: String,
}

/// Builds all tests, runs each executable as `cargo test` does, and prints what took how long. Examples in documentation are left out.
///
/// # Errors
/// A test failed, or the tests cannot be built.
pub fn suite(options: &SuiteOptions) -> Outcome {
    let here = std::env::current_dir().environment()?;
    let executables = build().environment()?;
    let (mut modules, mut tests) = (BTreeMap::<String, f64>::new(), Vec::new());
    let (mut ignored, mut failed) = (0, Vec::new());
    let (begun, processors_s) = (Instant::now(), children_s());
    println!("wall, s  processors, s  tests  executable");
    for executable in &executables {
        let name = executable.source.strip_prefix(&here);
        let name = name.unwrap_or(&executable.source).display();
        let (begun, processors_s) = (Instant::now(), children_s());
        let ended = run(executable, options).environment()?;
        let (wall_s, count) = (begun.elapsed().as_secs_f64(), ended.len());
        let processors_s = children_s() - processors_s;
        if count > 0 {
            println!("{wall_s:7.1}  {processors_s:13.1}  {count:5}  {name}");
        }
        for test in ended {
            let module = test.name.split("::").next().unwrap_or_default();
            *modules.entry(format!("{name} {module}")).or_default() += test.seconds;
            let shown = format!("{name} {}", test.name);
            ignored += u32::from(test.event == "ignored");
            failed.extend((test.event == "failed").then(|| shown.clone()));
            tests.push((shown, test.seconds));
        }
    }
    let (wall_s, processors_s) = (begun.elapsed().as_secs_f64(), children_s() - processors_s);
    let (count, seconds) = (tests.len(), tests.iter().map(|of| of.1).sum::<f64>());
    print_longest("modules", modules.into_iter().collect());
    print_longest("tests", tests);
    println!(
        "\n{count} tests, {} failed, {ignored} ignored: {seconds:.1} s of tests in {wall_s:.1} s, {processors_s:.1} s of processor time",
        failed.len()
    );
    match failed.is_empty() {
        true => Ok(()),
        false => Err(Failure::Stopped(anyhow!("failed:\n{}", failed.join("\n")))),
    }
}

/// The test executables of the workspace, in Cargo's order.
fn build() -> anyhow::Result<Vec<Executable>> {
    let mut cargo = Command::new("cargo");
    cargo.args(["test", "--release", "--workspace", "--no-run"]);
    cargo.arg("--message-format=json-render-diagnostics");
    let built = cargo.stderr(Stdio::inherit()).output().context("cargo")?;
    ensure!(built.status.success(), "the tests cannot be built");
    let text = String::from_utf8(built.stdout)?;
    Ok(text.lines().filter_map(executable).collect())
}

/// Of a line of Cargo about a test executable.
fn executable(line: &str) -> Option<Executable> {
    let of: Value = serde_json::from_str(line).ok()?;
    let path = |value: &Value| value.as_str().map(PathBuf::from);
    (of["profile"]["test"] == true).then_some(Executable {
        file: path(&of["executable"])?,
        source: path(&of["target"]["src_path"])?,
        manifest: path(&of["manifest_path"])?,
    })
}

fn run(executable: &Executable, options: &SuiteOptions) -> anyhow::Result<Vec<Ended>> {
    let Executable { file, manifest, .. } = executable;
    let mut command = Command::new(file);
    command.args(["-Zunstable-options", "--format=json", "--report-time"]);
    command.args(&options.filter).stdout(Stdio::piped());
    command.current_dir(manifest.parent().context("a folder")?);
    // libtest tells the times of single tests to its own developers alone.
    command.env("RUSTC_BOOTSTRAP", "1");
    if options.full {
        command.env("QUADRANT_TESTS", "full");
    }
    let mut child = command.spawn().with_context(|| format!("{file:?}"))?;
    let printed = BufReader::new(child.stdout.take().context("a pipe")?);
    let mut tests = Vec::new();
    for line in printed.split(b'\n') {
        let Some(test) = ended(&String::from_utf8_lossy(&line?)) else {
            continue;
        };
        if test.seconds > LONG_S || test.event == "failed" {
            let Ended { name, event, .. } = &test;
            eprintln!("{:7.1} s  {event}  {name}\n{}", test.seconds, test.said);
        }
        tests.push(test);
    }
    let status = child.wait()?;
    let failed = tests.iter().any(|test| test.event == "failed");
    ensure!(status.success() || failed, "{file:?}: {status}");
    Ok(tests)
}

/// Of a line of libtest about a test that is over; what tests and their children print stands between such lines.
fn ended(line: &str) -> Option<Ended> {
    let of: Value = serde_json::from_str(line).ok()?;
    let text = |key: &str| of[key].as_str().map(str::to_string);
    let event = text("event").filter(|event| event != "started" && event != "timeout")?;
    (of["type"] == "test").then_some(Ended {
        name: text("name")?,
        event,
        seconds: of["exec_time"].as_f64().unwrap_or_default(),
        said: text("stdout").unwrap_or_default(),
    })
}

/// Processor time of children that have ended, and of theirs.
fn children_s() -> f64 {
    processor_time::stat(std::process::id()).map_or(0.0, |stat| stat.children_s)
}

fn print_longest(what: &str, mut all: Vec<(String, f64)>) {
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    println!("\nthe longest {what}, s");
    for (name, seconds) in all.iter().take(SHOWN) {
        println!("{seconds:7.1}  {name}");
    }
}
