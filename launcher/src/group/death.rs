//! The death of a process of the group.

use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

use anyhow::anyhow;
use bus::sample::Job;
use rustix::process::Signal;

use super::Member;

/// A death that the launcher has dealt with.
#[derive(Debug, Clone)]
pub struct Death {
    /// Which process.
    pub name: String,
    /// What it did.
    pub job: Job,
    /// How it ended.
    pub status: ExitStatus,
    /// Its place in the roster.
    pub place: usize,
    /// Another process has taken its place, or is to.
    pub replaced: bool,
    /// It had nothing left to do: the last feedback had been published.
    pub after_end: bool,
    /// It took part; it did not die on its way into the cell.
    pub took_part: bool,
    /// Why it gave up, if it said so.
    pub last_words: Option<String>,
}

impl Death {
    pub(super) fn of(member: &Member, place: usize, status: ExitStatus) -> Death {
        Death {
            name: member.role.name.clone(),
            job: member.role.process.job,
            status,
            place,
            replaced: false,
            after_end: false,
            took_part: member.joining.is_none(),
            last_words: None,
        }
    }

    /// Whether something is missing since: nobody took its place, and it was needed.
    pub fn is_loss(&self) -> bool {
        !self.status.success() && !self.replaced && !self.after_end
    }

    /// Notes that it died when the run was over. A log is whole only once the recorder has left in order.
    pub fn note_after_end(&mut self) {
        self.after_end = self.job != Job::Monitor;
    }

    /// How it ended, in words.
    pub fn words(&self) -> String {
        match (self.status.signal(), self.status.code()) {
            (Some(signal), _) if signal == Signal::XCPU.as_raw() => {
                format!(
                    "killed by signal {signal}: it used a processor without a pause for longer than busy_max_ms allows"
                )
            }
            (Some(signal), _) => format!("killed by signal {signal}"),
            (None, Some(code)) => format!("ended with status {code}"),
            (None, None) => "ended".into(),
        }
    }

    /// Why the cell did not come up by it.
    pub(super) fn before_ready(&self) -> anyhow::Error {
        match &self.last_words {
            Some(words) => anyhow!("{}: {words}", self.name),
            None => anyhow!("{} {} before it was ready", self.name, self.words()),
        }
    }
}
