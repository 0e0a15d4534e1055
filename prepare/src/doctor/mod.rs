//! `quadrant doctor`: what this PC offers for real time, what to change, and why.
//!
//! A reader descends so: `facts` and `network` ask the system and judge nothing; `judge`, `judge_processors` and `judge_network` are
//! pure, facts in, findings out; `show` puts findings on a screen or into JSON.

mod facts;
mod finding;
mod judge;
mod judge_network;
mod judge_processors;
mod network;
mod show;
mod trial;

use std::path::Path;

use anyhow::{Context, anyhow};
use machine::{Machine, machine_file};

use crate::options::DoctorOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use facts::Facts;
use finding::{Finding, Grade};
use network::Network;

/// Judges this PC; an environment that must be changed is a failure.
pub fn doctor(options: &DoctorOptions) -> Outcome {
    let interface = options.bus.as_deref().map(interface_of);
    let interface = interface.transpose().input()?;
    let facts = Facts::gather();
    let mut findings = all(&facts);
    if let Some(interface) = interface {
        findings.extend(judge_network::judge(&Network::of(&interface)));
    }
    if options.json {
        say(&show::json(&findings));
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

/// The network interface that is named, or that of the machine that is.
fn interface_of(named: &str) -> anyhow::Result<String> {
    let is_path = named.contains('/') || named.ends_with(".toml");
    if !is_path && !Path::new(named).exists() {
        return Ok(named.into());
    }
    let path = machine_file(Path::new(named));
    let machine = Machine::load(&path)?;
    let bus = machine.bus.with_context(|| {
        let shown = path.display();
        format!("{shown} has no [bus]: its drives are simulated; leave it out")
    })?;
    Ok(bus.interface)
}

/// Every finding, in the order of the subjects.
fn all(facts: &Facts) -> Vec<Finding> {
    let mut findings = judge::judge(facts);
    findings.extend(judge_processors::judge(facts));
    findings
}

/// Says once, for the whole group, what realtime pace has to do without.
pub fn say_what_realtime_lacks() {
    let refused = trial::what_is_refused();
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
