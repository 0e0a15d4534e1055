//! Samples of a running cell, taken in the order in which the recorder writes them. Nobody in the cell waits: queues that are not
//! emptied in time lose their oldest samples, here alone, and the capture says so.

use std::time::{Duration, Instant};

use anyhow::anyhow;
use bus::cell::CellPaths;
use bus::service::RECORDER_DEPTH_SCANS;
use bus::signal_page::{CellPhase, SignalPage};
use machine::Machine;
use monitor::log::Sample;
use monitor::scope::Scope;

use super::path::{Paths, Text, Wanted};
use super::source::Source;
use crate::live::ports::Ports;
use crate::live::proc::children_of;
use launcher::exit::Failure;
use launcher::operator::{Client, page_of};

/// Time between two looks: queues hold a thousand scans.
const LOOK: Duration = Duration::from_millis(3);
/// A cell is gone once it has said nothing for so long and its launcher is not to be seen.
const GONE: Duration = Duration::from_millis(200);

/// A foot in a cell.
pub struct LiveSource {
    place: CellPaths,
    machine: Machine,
    page: SignalPage,
    ports: Option<Ports>,
    paths: Paths,
    heard: Instant,
    last: bool,
}

impl LiveSource {
    /// Attaches to the cell that is named, or the only one that runs.
    ///
    /// # Errors
    /// None runs, several do, or it cannot be entered.
    pub fn attach(cell: Option<&str>) -> Result<LiveSource, Failure> {
        let Client {
            place,
            machine,
            page,
            bus,
        } = Client::find(cell, "scope")?;
        let ports = Ports::open(bus, &machine).map_err(|error| match page_of(&place) {
            Some(_) => Failure::Environment(error.into()),
            None => Failure::Stopped(anyhow!("cell {:?} has just ended", place.name())),
        })?;
        Ok(LiveSource {
            place,
            machine,
            page,
            ports: Some(ports),
            paths: Paths::default(),
            heard: Instant::now(),
            last: false,
        })
    }

    fn is_gone(&self) -> bool {
        self.page.phase() == CellPhase::Ending
            || page_of(&self.place)
                .is_none_or(|page| page.launcher_pid() != self.page.launcher_pid())
    }

    fn drain(
        &mut self,
        ports: &mut Ports,
        scope: &mut Scope,
        wanted: &Wanted,
    ) -> Result<(), Failure> {
        for _ in 0..RECORDER_DEPTH_SCANS {
            let Some(feedback) = ports.feedback.any() else {
                return Ok(());
            };
            self.heard = Instant::now();
            let (pid, place) = (self.page.launcher_pid(), &self.place);
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
            while let Some(sample) = ports.instruments.next(scan) {
                scope.take(Sample::Instruments(Box::new(sample)));
            }
            for reader in &mut ports.commands {
                while let Some(sample) = reader.next(scan) {
                    scope.take(Sample::Command(Box::new(sample)));
                }
            }
            self.last |= feedback.last == 1;
            scope.take(Sample::Feedback(Box::new(feedback)));
        }
        Ok(())
    }
}

impl Drop for LiveSource {
    /// A cell that is over is left without a word: its launcher removes all that is left of it, and a port that is closed in order
    /// would take the files of its service with it by their names, which may be those of the next cell by then.
    fn drop(&mut self) {
        if self.last || self.is_gone() {
            std::mem::forget(self.ports.take());
        }
    }
}

impl Source for LiveSource {
    fn machine(&self) -> &Machine {
        &self.machine
    }

    fn feed(&mut self, scope: &mut Scope, wanted: &Wanted) -> Result<bool, Failure> {
        let Some(mut ports) = self.ports.take() else {
            return Ok(false);
        };
        let drained = self.drain(&mut ports, scope, wanted);
        self.ports = Some(ports);
        drained?;
        if self.last {
            return Ok(false);
        }
        std::thread::sleep(LOOK);
        Ok(self.heard.elapsed() < GONE || !self.is_gone())
    }

    fn name(&self) -> String {
        format!("cell {:?}", self.place.name())
    }

    fn is_live(&self) -> bool {
        true
    }
}
