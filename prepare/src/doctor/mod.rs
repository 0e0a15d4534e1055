//! `quadrant doctor`: what this PC offers for real time, what to change, and why.
//!
//! A reader descends so: `facts`, `measured` and `network` ask the system and judge nothing; `judge`, `judge_processors` and `judge_network` are
//! pure, facts in, findings out; `show` puts findings on a screen or into JSON.

mod facts;
mod finding;
mod judge;
mod judge_network;
mod judge_processors;
mod lateness;
mod measured;
mod network;
mod show;

use std::path::Path;

use anyhow::anyhow;
use bus::realtime::Refused;
use machine::{Machine, machine_file};

use crate::options::DoctorOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use facts::Facts;
use finding::{Finding, Grade};
use measured::measured;
use network::Network;

/// Judges this PC; an environment that must be changed is a failure.
pub fn doctor(options: &DoctorOptions) -> Outcome {
    let (machine, interface) = subject(options.of.as_deref()).input()?;
    let machine = machine.as_ref();
    let processors = machine.map_or(Ok(()), |one| one.processes.check_here());
    processors.map_err(anyhow::Error::msg).environment()?;
    let measured = measured(machine, options.seconds).environment()?;
    let facts = Facts::gather(measured);
    let mut findings = all(&facts);
    if let Some(interface) = interface {
        findings.extend(judge_network::judge(&Network::of(&interface)));
    }
    if options.json {
        say(&show::json(&findings, &facts.measured));
    } else {
        say(&show::text(&findings, &facts.host));
    }
    let musts = findings.iter().filter(|f| f.grade == Grade::Must);
    let musts: Vec<&str> = musts.map(|finding| finding.what).collect();
    if musts.is_empty() {
        return Ok(());
    }
    Err(Failure::Environment(anyhow!(
        "must be changed before a cell runs in real time: {}",
        musts.join(", ")
    )))
}

/// The machine that is named, with its network interface if it has one, or the interface that is.
fn subject(named: Option<&str>) -> anyhow::Result<(Option<Machine>, Option<String>)> {
    let is_path = |named: &str| named.contains('/') || named.ends_with(".toml");
    match named {
        Some(named) if is_path(named) || Path::new(named).exists() => {
            let machine = Machine::load(&machine_file(Path::new(named)))?;
            let interface = machine.bus.as_ref().map(|bus| bus.interface.clone());
            Ok((Some(machine), interface))
        }
        interface => Ok((None, interface.map(str::to_string))),
    }
}

/// Every finding, in the order of the subjects.
fn all(facts: &Facts) -> Vec<Finding> {
    let mut findings = judge::judge(facts);
    findings.extend(judge_processors::judge(facts));
    findings
}

/// Says once, for the whole group, what realtime pace has to do without.
pub fn say_what_realtime_lacks() {
    let refused = Refused::by_trying();
    if let Some(error) = refused.priority {
        tracing::warn!(
            "realtime without SCHED_FIFO ({error}): scans will be missed when this PC is busy; see quadrant doctor"
        );
    }
    if let Some(error) = refused.memory {
        tracing::warn!(
            "realtime without locked memory ({error}): a page fault can cost a scan; see quadrant doctor"
        );
    }
}
