//! Samples of a running cell, taken in the order in which the recorder writes them. Nobody in the cell waits: queues that are not
//! emptied in time lose their oldest samples, here alone, and the capture reports it.

use std::rc::Rc;
use std::time::{Duration, Instant};

use bus::observer::{Held, Observer};
use bus::service::RECORDER_DEPTH_SCANS;
use machine::Machine;
use monitor::log::Sample;
use report::scope::Scope;

use super::path::{Paths, Text, Wanted};
use super::source::Source;
use crate::live::ports::Ports;
use console::exit::Failure;
use launcher::children::children_of;
use operator::{Client, held};

/// Time between two looks: queues hold a thousand scans.
const LOOK: Duration = Duration::from_millis(3);
/// A cell is gone once it has reported nothing for so long and its launcher is not to be seen.
const GONE: Duration = Duration::from_millis(200);

/// A foot in a cell.
pub struct LiveSource {
    cell: Rc<Observer>,
    machine: Machine,
    ports: Held<Ports>,
    paths: Paths,
    heard: Instant,
    /// A feedback has come.
    listens: bool,
    last: bool,
}

impl LiveSource {
    /// Attaches to the cell that is named, or the only one that runs.
    ///
    /// # Errors
    /// None runs, several do, or it cannot be entered.
    pub fn attach(cell: Option<&str>) -> Result<LiveSource, Failure> {
        let Client { cell, machine, bus } = Client::find(cell, "scope")?;
        Ok(LiveSource {
            ports: held(&cell, Ports::open(bus, &machine, RECORDER_DEPTH_SCANS))?,
            cell,
            machine,
            paths: Paths::default(),
            heard: Instant::now(),
            listens: false,
            last: false,
        })
    }

    fn drain(&mut self, scope: &mut Scope, wanted: &Wanted) -> Result<(), Failure> {
        let ports = &mut *self.ports;
        for _ in 0..RECORDER_DEPTH_SCANS {
            let Some(feedback) = ports.feedback.any() else {
                return Ok(());
            };
            self.heard = Instant::now();
            let (pid, place) = (self.cell.page.launcher_pid(), &self.cell.place);
            let text = || {
                let started_with = || children_of(pid).into_iter().find_map(|c| c.program);
                Text::File(place.program(feedback.load).or_else(started_with))
            };
            self.paths
                .look(&feedback, &self.machine, scope, wanted, text)?;
            let scan = feedback.scan;
            while let Some(sample) = ports.roster.next(scan) {
                scope.take(Sample::Roster(Box::new(sample)));
            }
            if let Some(reader) = &mut ports.bus_cycle {
                while let Some(sample) = reader.next(scan) {
                    scope.take(Sample::BusCycle(Box::new(sample)));
                }
            }
            if let Some(reader) = &mut ports.signals {
                while let Some(sample) = reader.next(scan) {
                    scope.take(Sample::Signals(Box::new(sample)));
                }
            }
            while let Some(sample) = ports.instruments.next(scan) {
                scope.take(Sample::Instruments(Box::new(sample)));
            }
            for reader in &mut ports.commands {
                while let Some(sample) = reader.next(scan) {
                    scope.take(Sample::Command(Box::new(sample)));
                }
            }
            if feedback.last == 1 {
                self.last = true;
                self.cell.note_last();
            }
            // What is sent before the feedback of its scan may have been sent before anybody listened.
            if std::mem::replace(&mut self.listens, true) {
                scope.take(Sample::Feedback(Box::new(feedback)));
            }
        }
        Ok(())
    }
}

impl Source for LiveSource {
    fn machine(&self) -> &Machine {
        &self.machine
    }

    fn feed(&mut self, scope: &mut Scope, wanted: &Wanted) -> Result<bool, Failure> {
        self.drain(scope, wanted)?;
        if self.last {
            return Ok(false);
        }
        std::thread::sleep(LOOK);
        Ok(self.heard.elapsed() < GONE || !self.cell.is_gone())
    }

    fn name(&self) -> String {
        format!("cell {:?}", self.cell.place.name())
    }

    fn is_live(&self) -> bool {
        true
    }
}
