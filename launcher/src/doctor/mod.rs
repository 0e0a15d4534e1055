//! `quadrant doctor`: what this PC offers for real time, what to change, and why.
//!
//! A reader descends so: `facts` asks the system and judges nothing; `judge` and `judge_processors` are pure, facts in,
//! findings out; `show` puts findings on a screen or into JSON.

mod facts;
mod finding;
mod judge;
mod judge_processors;
mod show;
mod trial;

use anyhow::anyhow;

use crate::exit::{Failure, Outcome};
use crate::options::DoctorOptions;
use crate::output::say;
use facts::Facts;
use finding::{Finding, Grade};

/// Judges this PC; an environment that must be changed is a failure.
pub fn doctor(options: &DoctorOptions) -> Outcome {
    let facts = Facts::gather();
    let findings = all(&facts);
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
