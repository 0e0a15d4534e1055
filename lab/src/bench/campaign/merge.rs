//! `quadrant-lab bench merge`: the lines of all parts, added up.

use anyhow::{Context, anyhow};

use super::lines::{self, Line};
use crate::bench::{faults, plants, procedures};
use crate::options::MergeOptions;
use console::exit::{Kind, Outcome};
use console::output::say;

/// Missing numbers that are named.
const NAMED: usize = 10;

/// Adds them up and prints the totals.
///
/// # Errors
/// What is no line of one campaign, a violation in it, or a number that is missing.
pub fn merge(options: &MergeOptions) -> Outcome {
    let lines = lines::read(&options.files).input()?;
    let campaign = lines.first().map(|line| line.campaign.clone());
    let campaign = campaign.context("no line in these files").input()?;
    let missing = missing(&lines, campaign.from, campaign.count);
    if !missing.is_empty() {
        let named: Vec<String> = missing.iter().take(NAMED).map(u64::to_string).collect();
        let more = if missing.len() > NAMED { " …" } else { "" };
        say(&format!("missing: {}{more}", named.join(", ")));
    }
    match campaign.bench.as_str() {
        faults::NAME => faults::merge(&campaign, lines)?,
        procedures::NAME => procedures::merge(&campaign, lines)?,
        plants::NAME => plants::merge(&campaign, lines, options.out.as_deref())?,
        other => return Err(anyhow!("there is no campaign {other:?}")).input(),
    }
    let Some(first) = missing.first() else {
        return Ok(());
    };
    let (all, count) = (campaign.count, missing.len());
    let what = anyhow!("{count} of {all} are missing, {first} is the first: a part was not run");
    Err(what).input()
}

/// Numbers that have no line.
fn missing(lines: &[Line], from: u64, count: u64) -> Vec<u64> {
    let mut there = lines.iter().map(|line| line.number).peekable();
    let numbers = from..from.saturating_add(count);
    numbers
        .filter(|number| there.next_if_eq(number).is_none())
        .collect()
}
