//! `ended.json`: how a run ended, as the master has said it. The recorder writes it when it sees the end; the launcher, where no recorder
//! lived to see it or no master to say it. Reports, lists and events read it here.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

use bus::files::{open_regular, open_to_read};
use bus::sample::{Cause, EndedRun, Feedback, Order, RunOutcome};
use machine::Machine;
use rustix::fs::{FallocateFlags, fallocate};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::words::StopCause;

/// Its name in a run directory.
pub const ENDED_FILE: &str = "ended.json";
/// The most that is read of it.
const BYTES_MAX: u64 = 64 << 10;
/// Room on the disk that is reserved for it: a page.
const RESERVED_BYTES: u64 = 4 << 10;

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ended {
    /// Its number in its cell.
    pub run: u32,
    /// The last scan that is of it.
    pub scan: u64,
    /// How, in one word.
    #[serde(serialize_with = "as_word", deserialize_with = "of_word")]
    pub outcome: RunOutcome,
    /// Number of the [`Cause`]; 0 for none.
    pub cause: u32,
    /// Why; empty where there is nothing to say.
    pub text: String,
}

impl Ended {
    /// What a master says of a run that is over; none if it says nothing of this one.
    pub fn told(machine: &Machine, feedback: &Feedback, run: u32) -> Option<Ended> {
        let (outcome, ended) = feedback.end_of(run)?;
        Some(Ended {
            run,
            scan: ended.scan,
            outcome,
            cause: ended.cause,
            text: why(machine, outcome, ended),
        })
    }

    /// Whether it says all that there is to say; the launcher knows more where a process was lost.
    pub fn is_whole(&self) -> bool {
        self.outcome != RunOutcome::Stopped || self.cause != Cause::None as u32
    }

    /// Takes room on the disk for it: where the log fills the disk, it is noted all the same. Not every file system can do that.
    pub fn reserve(run_dir: &Path) {
        if let Ok(file) = open(run_dir) {
            let _ = fallocate(&file, FallocateFlags::KEEP_SIZE, 0, RESERVED_BYTES);
        }
    }

    /// Notes it in the run directory, unless it stands there: recorder and launcher have it from the same feedback.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn note(&self, run_dir: &Path) -> io::Result<()> {
        let mut file = open(run_dir)?;
        if file.metadata()?.len() > 0 {
            return Ok(());
        }
        let text = serde_json::to_string(self)? + "\n";
        file.write_all(text.as_bytes())
    }

    /// What was noted in a run directory.
    pub fn read(run_dir: &Path) -> Option<Ended> {
        let mut text = String::new();
        let file = open_to_read(&run_dir.join(ENDED_FILE)).ok()?;
        file.take(BYTES_MAX).read_to_string(&mut text).ok()?;
        serde_json::from_str(&text).ok()
    }
}

fn open(run_dir: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.create(true).truncate(false).write(true);
    open_regular(&run_dir.join(ENDED_FILE), &mut options)
}

fn why(machine: &Machine, outcome: RunOutcome, ended: &EndedRun) -> String {
    let cause = Cause::from_wire(ended.cause);
    let words = match (outcome, cause, Order::from_wire(ended.order)) {
        (RunOutcome::Completed, ..) => "",
        (RunOutcome::Interrupted, _, Some(Order::Reset)) => "ended by the order reset",
        (RunOutcome::Interrupted, _, Some(Order::Load)) => "ended by the order load",
        (RunOutcome::Interrupted, ..) => "",
        (RunOutcome::Stopped, Some(Cause::None), _) => "a process that it needs was lost",
        _ => {
            let (axis, code) = (ended.cause_axis as usize, ended.drive_code);
            return StopCause::named(machine, cause, axis, code).to_string();
        }
    };
    words.into()
}

/// Serialises the word for an outcome.
///
/// # Errors
/// The serialiser cannot write it.
pub fn as_word<S: Serializer>(outcome: &RunOutcome, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(outcome.word())
}

fn of_word<'de, D: Deserializer<'de>>(from: D) -> Result<RunOutcome, D::Error> {
    let word = String::deserialize(from)?;
    let known = RunOutcome::ALL.into_iter().find(|of| of.word() == word);
    known.ok_or_else(|| serde::de::Error::custom("must be completed, interrupted or stopped"))
}
