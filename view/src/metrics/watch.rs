//! Puts what the recorder takes into the numbers that metrics are made of.

use std::net::TcpListener;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;

use bus::cell::CellPaths;
use bus::member::Member;
use bus::sample::{
    AxisCommand, BusCycle, Cause, Feedback, Instruments, Job, Mode, PlannerStatus, Roster,
};
use bus::signal_page::SignalPage;
use machine::{Machine, Process};
use program::Program;

use super::numbers::{CellNow, Numbers, base_unit};
use super::served::Served;
use super::{interval, server};
use crate::live::model::Model;
use operator::program_behind;

/// The recorder's listener for metrics.
pub struct Watch {
    listener: Option<TcpListener>,
    /// Run directory.
    out: PathBuf,
    /// Part program; none in a cell that stays up.
    program: Option<PathBuf>,
    cell: Option<Cell>,
}

struct Cell {
    model: Model,
    numbers: Arc<Numbers>,
    machine: Machine,
    place: CellPaths,
    program: Option<PathBuf>,
    /// Hash of the program that was tried to be read.
    read: Option<u64>,
    reading: Option<JoinHandle<Option<Program>>>,
    tripped: bool,
    /// Reversals counted so far, of all axes.
    reversals: u64,
}

impl Watch {
    /// Serves at `listener` what is recorded into `out`.
    pub fn new(listener: TcpListener, out: PathBuf, program: Option<PathBuf>) -> Self {
        Watch {
            listener: Some(listener),
            out,
            program,
            cell: None,
        }
    }
}

impl monitor::Tap for Watch {
    fn begins(&mut self, member: &Member, machine: &Machine) {
        let slot = member.slot();
        let numbers = Arc::new(Numbers::new(machine, slot.pace));
        // It is a member of a cell of that name.
        let Ok(place) = CellPaths::new(&slot.cell) else {
            return;
        };
        if let Some(listener) = self.listener.take() {
            let served = Served {
                place: place.clone(),
                numbers: Arc::clone(&numbers),
                log: self.out.clone(),
                program: self.program.clone(),
            };
            if let Err(error) = server::start(listener, served) {
                tracing::error!("no metrics: {error}");
            }
        }
        if numbers.scan_interval.is_some() {
            interval::start(&place, Arc::clone(&numbers));
        }
        let model = Model::new(&slot.cell, machine.clone());
        self.cell = Some(Cell::new(model, numbers, place, self.program.clone()));
    }

    fn roster(&mut self, sample: &Roster) {
        if let Some(cell) = &mut self.cell {
            cell.roster(sample);
        }
    }

    fn instruments(&mut self, sample: &Instruments) {
        if let Some(cell) = &mut self.cell {
            cell.model.instruments(sample);
        }
    }

    fn bus_cycle(&mut self, sample: &BusCycle) {
        if let Some(cell) = &mut self.cell {
            cell.numbers.bus.take(sample);
        }
    }

    fn command(&mut self, sample: &AxisCommand) {
        if let Some(cell) = &mut self.cell {
            cell.command(sample);
        }
    }

    fn planner(&mut self, sample: &PlannerStatus) {
        if let Some(cell) = &mut self.cell {
            cell.planner(sample);
        }
    }

    fn feedback(&mut self, sample: &Feedback) {
        if let Some(cell) = &mut self.cell {
            cell.feedback(sample);
        }
    }

    fn look(&mut self, page: &SignalPage, failed: u64) {
        if let Some(cell) = &mut self.cell {
            cell.look(page, failed);
        }
    }
}

impl Cell {
    fn new(
        model: Model,
        numbers: Arc<Numbers>,
        place: CellPaths,
        program: Option<PathBuf>,
    ) -> Self {
        Cell {
            machine: model.machine.clone(),
            model,
            numbers,
            place,
            program,
            read: None,
            reading: None,
            tripped: false,
            reversals: 0,
        }
    }

    fn roster(&mut self, sample: &Roster) {
        self.model.roster(sample);
        for process in &self.numbers.processes {
            let mut all = sample.participants.iter();
            if let Some(found) = all.find(|one| Process::of(one) == Some(process.process)) {
                process.up.set(u64::from(found.live));
                process.starts.set(u64::from(found.incarnation));
            }
        }
    }

    fn command(&mut self, sample: &AxisCommand) {
        self.model.command(sample);
        let index = sample.axis as usize;
        let (Some(axis), Some(view)) = (self.numbers.axes.get(index), self.model.axes.get(index))
        else {
            return;
        };
        // Of two servos of an axis, the one that drives.
        if sample.role == view.role && sample.following_error_mm.is_finite() {
            let error_m = base_unit(axis.kind, sample.following_error_mm);
            axis.following_error_m.set(error_m);
            axis.following_error_peak_m.raise_to(error_m.abs());
            axis.following_error.take(error_m.abs());
        }
        if sample.role == view.role && view.friction().is_some() {
            axis.friction_level.set(sample.friction_level);
            axis.friction_unexplained.set(sample.friction_unexplained);
        }
    }

    fn planner(&mut self, sample: &PlannerStatus) {
        self.model.planner = Some(*sample);
        if let Some(share) = self.model.share_done() {
            self.numbers.progress_ratio.set(share);
        }
    }

    fn feedback(&mut self, sample: &Feedback) {
        self.find_program(sample);
        self.model.feedback(sample);
        let numbers = &self.numbers;
        numbers.set_now(CellNow::of(sample, bus::realtime::now_ns()));
        // Also one that was there before this recorder: its count goes on from that of the one before, which had seen it.
        let tripped = sample.mode == Mode::Tripped as u32;
        if tripped
            && !self.tripped
            && let Some(trips) =
                Cause::from_wire(sample.cause).and_then(|cause| numbers.trips(cause))
        {
            trips.add_one();
        }
        self.tripped = tripped;
        let axes = numbers.axes.iter().zip(sample.axes());
        for ((axis, now), view) in axes.zip(&self.model.axes) {
            axis.position_m.set(base_unit(axis.kind, view.feedback_mm));
            axis.command_m.set(base_unit(axis.kind, view.command_mm));
            axis.torque_nm.set(now.torque_nm);
            axis.torque_peak_nm.raise_to(now.torque_nm.abs());
            axis.winding_k.set(now.winding_k);
            axis.missed_scans.set(u64::from(now.missed_scans));
            axis.redundancy.set(f64::from(now.redundancy));
            axis.differences.set(u64::from(now.differences));
            if now.torque_limited == 1 {
                axis.torque_limited_scans.add_one();
            }
        }
    }

    /// Has the program read by a thread of its own, once per program: what a reversal left on the table is known on arcs only.
    fn find_program(&mut self, sample: &Feedback) {
        if self.reading.as_ref().is_some_and(JoinHandle::is_finished)
            && let Some(reading) = self.reading.take()
        {
            self.model.program = reading.join().ok().flatten();
        }
        let hash = sample.program_hash;
        if hash == 0 || self.read == Some(hash) || self.reading.is_some() {
            return;
        }
        self.read = Some(hash);
        self.model.program = None;
        let (place, file) = (self.place.clone(), self.program.clone());
        let (machine, sample) = (self.machine.clone(), *sample);
        let thread = std::thread::Builder::new().name("qd-program".into());
        self.reading = thread
            .spawn(move || {
                let file = file.or_else(|| place.program(sample.load))?;
                program_behind(&file, &machine, &sample)
            })
            .ok();
    }

    fn look(&mut self, page: &SignalPage, failed: u64) {
        self.model.end_of_look();
        let numbers = &self.numbers;
        let (_, skipped) = self.model.seen_scans;
        numbers.samples_lost.set(skipped + failed);
        let new = self.model.reversals.count - self.reversals;
        self.reversals = self.model.reversals.count;
        let kept = &self.model.reversals.last;
        let newest = kept
            .len()
            .saturating_sub(usize::try_from(new).unwrap_or(usize::MAX));
        for reversal in kept.iter().skip(newest) {
            let Some(axis) = numbers.axes.get(reversal.axis as usize) else {
                continue;
            };
            let m = |um: f64| base_unit(axis.kind, um * 1e-3);
            axis.reversals.add_one();
            axis.reversal_error_m.set(m(reversal.error_peak_um));
            if let Some(height_um) = reversal.height_um {
                axis.protrusion_m.set(m(height_um));
            }
        }
        let Some(now) = numbers.now().map(|now| now.scans - 1) else {
            return;
        };
        for process in &numbers.processes {
            let place = self.model.place_of(process.process);
            let then = match process.process.job {
                Job::Master => Some(now),
                Job::Monitor => page.recorded_scans().checked_sub(1),
                _ => place.and_then(|place| page.answered_scan(place)),
            };
            if let Some(then) = then {
                process.age_scans.set(now.saturating_sub(then) as f64);
            }
        }
    }
}
