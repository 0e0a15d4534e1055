//! The parts of a scan, each by itself, over what the others gave it in a run of a cell in one process: always the same scans of the
//! same program, so that the same instructions are carried out.

mod answers;
mod drives;
mod tape;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use bus::sample::AxisCommand;
use machine::{Machine, machine_file};
use master::{Drives as _, Flow, Master, RunEnd};
use plant_sim::plant_file::PlantFile;
use servo::Servo;

use self::answers::AnswersAgain;
use self::drives::{Exchange, Heard, Played, Shown};
use self::tape::{Scan, Tape};
use super::windows::Windows;
use crate::cell::ServoQueues;
use crate::options::Part;

/// Scans whose samples fit into the cache of a processor.
const WARM_SCANS: usize = 32;
/// The program that all of them run.
const PROGRAM: &str = "programs/circle-r25-f3000.ngc";

/// A machine and its program.
pub(crate) struct Subject {
    pub machine: Machine,
    pub plant: PlantFile,
    name: String,
    text: String,
    path: std::path::PathBuf,
}

impl Subject {
    /// What stands in a folder.
    ///
    /// # Errors
    /// A file that cannot be read, or is wrong.
    pub fn load(folder: &Path) -> anyhow::Result<Subject> {
        let file = machine_file(folder);
        let path = file.with_file_name(PROGRAM);
        Ok(Subject {
            machine: Machine::load(&file)?,
            plant: PlantFile::load(&file.with_file_name("plant.toml"))?,
            text: std::fs::read_to_string(&path).with_context(|| path.display().to_string())?,
            name: path.display().to_string(),
            path,
        })
    }

    /// Its program, name and text.
    pub fn program(&self) -> (&str, &str) {
        (&self.name, &self.text)
    }

    fn master<D: master::Drives>(&self, drives: D) -> Master<D> {
        Master::new(&self.machine, drives, 1, 0, true, RunEnd::AfterProgram)
    }

    /// So many windows from the beginning of the program.
    ///
    /// # Errors
    /// It has fewer.
    pub fn planning(&self, times: usize) -> anyhow::Result<Duration> {
        let start = self.plant.start(&self.machine)?;
        let program = program::load_from(&self.machine, &start, &self.path, &[])?;
        let (mut planner, _) = planner::course(&self.machine, program)?;
        let mut windows = Windows::new(&self.machine, &mut planner);
        let began = Instant::now();
        for _ in 0..times {
            if !windows.go_on()? {
                bail!("{}: has fewer windows than {times}", self.name);
            }
            windows.plan()?;
        }
        Ok(began.elapsed())
    }
}

/// The parts, with all that they are fed with.
pub(crate) struct Scans<'a> {
    subject: &'a Subject,
    is_timed: bool,
    tape: Tape,
    beginning: Shown,
    exchanges: Vec<Exchange>,
}

impl<'a> Scans<'a> {
    /// The first scans of the program, so many.
    ///
    /// # Errors
    /// It has fewer, or a master that is fed with what was answered does not do the same again.
    pub fn of(subject: &'a Subject, count: usize) -> anyhow::Result<Scans<'a>> {
        let Subject { machine, plant, .. } = subject;
        let tape = Tape::of(machine, plant, subject.program(), count)?;
        let drives = plant.drives(machine)?;
        let beginning = Shown::by(&drives);
        let exchanges = Vec::with_capacity(count);
        let mut master = subject.master(Heard { drives, exchanges });
        let mut ports = AnswersAgain::new(&tape);
        (0..count).try_for_each(|_| cycle(&mut master, &mut ports))?;
        let exchanges = master.drives().exchanges.clone();
        Ok(Scans {
            subject,
            is_timed: false,
            tape,
            beginning,
            exchanges,
        })
    }

    /// The same, where times count and not instructions.
    ///
    /// # Errors
    /// As [`Scans::of`].
    pub fn timed(subject: &'a Subject, count: usize) -> anyhow::Result<Scans<'a>> {
        Ok(Scans {
            is_timed: true,
            ..Scans::of(subject, count)?
        })
    }

    /// A part of the first scans, so many; how long it took.
    ///
    /// # Errors
    /// It cannot be made, or does not do what it did.
    pub fn run(&self, part: Part, times: usize) -> anyhow::Result<Duration> {
        match part {
            Part::Servo => self.servos(times),
            Part::Master => self.master(times),
            Part::Physics => self.physics(times),
            Part::Planning => self.subject.planning(times),
        }
    }

    /// How many of them there are in a scan, to which [`run`](Scans::run) adds them up.
    pub fn in_a_scan(machine: &Machine, part: Part) -> usize {
        match part {
            Part::Servo => machine.axes.len(),
            Part::Master | Part::Physics | Part::Planning => 1,
        }
    }

    /// Takes a step for each of the first scans. Where time counts, what they were fed with is looked at before, some scans at a time: in
    /// a cell it comes warm from whoever made it.
    fn each(
        &self,
        times: usize,
        mut step: impl FnMut(&Scan) -> anyhow::Result<()>,
    ) -> anyhow::Result<Duration> {
        let mut all = Duration::ZERO;
        let first = self.tape.scans.get(..times).context("a longer tape")?;
        for scans in first.chunks(WARM_SCANS) {
            if self.is_timed {
                scans.iter().for_each(Scan::touch);
            }
            let began = Instant::now();
            scans.iter().try_for_each(&mut step)?;
            all += began.elapsed();
        }
        Ok(all)
    }

    /// The servos of all axes, one after the other.
    fn servos(&self, times: usize) -> anyhow::Result<Duration> {
        let mut all = Duration::ZERO;
        for axis in 0..self.subject.machine.axes.len() {
            let mut servo = Servo::new(&self.subject.machine, axis, 0, 1)?;
            let mut ports = ServoQueues::new(false);
            let mut last: Option<AxisCommand> = None;
            all += self.each(times, |scan| {
                ports.feedback = Some(Arc::clone(&scan.feedback));
                servo::cycle(&mut servo, &mut ports);
                last = ports.sent.last().copied();
                for window in &scan.windows {
                    ports.windows.push(Arc::clone(window));
                }
                Ok(())
            })?;
            let on_tape = times.checked_sub(1).and_then(|at| self.tape.scans.get(at));
            let on_tape = on_tape.and_then(|scan| scan.commands.get(axis));
            if last.as_ref() != on_tape {
                bail!("the servo of axis {axis} does not do again what it did");
            }
        }
        Ok(all)
    }

    /// The master, over drives that show what they showed.
    fn master(&self, times: usize) -> anyhow::Result<Duration> {
        let subsamples = self.subject.machine.subsamples();
        let drives = Played::new(&self.beginning, &self.exchanges, subsamples);
        let mut master = self.subject.master(drives);
        let mut ports = AnswersAgain::new(&self.tape);
        self.each(times, |_| cycle(&mut master, &mut ports))
    }

    /// The simulated drives.
    fn physics(&self, times: usize) -> anyhow::Result<Duration> {
        let mut drives = self.subject.plant.drives(&self.subject.machine)?;
        let began = Instant::now();
        for exchange in self.exchanges.iter().take(times) {
            drives.exchange(&exchange.commands);
        }
        let took = began.elapsed();
        std::hint::black_box(drives.feedback(0));
        Ok(took)
    }
}

/// A scan of a master whose cell answers as on the tape.
fn cycle<D: master::Drives>(
    master: &mut Master<D>,
    ports: &mut AnswersAgain<'_>,
) -> anyhow::Result<()> {
    let Ok(flow) = master::cycle::cycle(master, ports);
    if flow == Flow::Leave || !ports.agrees {
        bail!("the master does not do again what it did");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_does_again_what_it_did_in_the_run() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let subject = Subject::load(&folder).expect("xy");
        let scans = Scans::of(&subject, 600).expect("scans");
        for part in [Part::Servo, Part::Master, Part::Physics] {
            scans.run(part, 600).expect("the whole tape");
        }
        scans.run(Part::Planning, 60).expect("windows");
        assert!(subject.planning(100_000).is_err());
    }
}
