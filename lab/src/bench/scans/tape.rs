//! What a run of a cell in one process has published, scan by scan: what its parts are fed with again, each by itself.

use std::sync::Arc;

use anyhow::{Context, bail};
use bus::sample::{AxisCommand, Feedback, PlannerStatus, Roster};
use bytemuck::Zeroable;
use machine::Machine;
use plant_sim::plant_file::PlantFile;

use crate::cell::{InProcessCell, Window};

/// One scan of it.
#[derive(Debug)]
pub(super) struct Scan {
    pub feedback: Arc<Feedback>,
    /// By axis.
    pub commands: Vec<AxisCommand>,
    /// Where the planner has answered.
    pub status: Option<PlannerStatus>,
    /// Windows that the planner has sent in it.
    pub windows: Vec<Arc<Window>>,
}

impl Scan {
    /// Looks at all of it.
    pub fn touch(&self) {
        let sum = |bytes: &[u8]| bytes.iter().fold(0_u8, |sum, byte| sum ^ byte);
        std::hint::black_box(sum(bytemuck::bytes_of(&*self.feedback)));
        std::hint::black_box(sum(bytemuck::cast_slice(&self.commands)));
        for window in &self.windows {
            std::hint::black_box(sum(bytemuck::cast_slice(&window.setpoints)));
        }
    }
}

/// A run, from its first scan on.
#[derive(Debug)]
pub(super) struct Tape {
    pub scans: Vec<Scan>,
    pub roster: Roster,
}

impl Tape {
    /// So many scans of a program.
    ///
    /// # Errors
    /// The cell cannot be made, or the program ends before.
    pub fn of(
        machine: &Machine,
        plant: &PlantFile,
        (name, text): (&str, &str),
        count: usize,
    ) -> anyhow::Result<Tape> {
        let mut cell = InProcessCell::new(machine, plant, name, text)?;
        let mut tape = Tape {
            scans: Vec::with_capacity(count),
            roster: Roster::zeroed(),
        };
        while tape.scans.len() < count {
            let published = cell.scan().context("the program ends before")?;
            let scan = published.feedback.scan;
            if published.commands.len() != machine.axes.len() {
                bail!("a servo has not answered in scan {scan}");
            }
            tape.roster = *published.roster;
            tape.scans.push(Scan {
                feedback: Arc::new(*published.feedback),
                commands: published.commands.to_vec(),
                status: published
                    .status
                    .filter(|status| status.scan == scan)
                    .copied(),
                windows: published.windows.to_vec(),
            });
        }
        Ok(tape)
    }
}
