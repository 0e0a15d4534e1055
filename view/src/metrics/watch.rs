//! The process that serves metrics: puts what it hears of a cell into the numbers that they are made of.

use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::Duration;

use bus::cell::CellPaths;
use bus::member::Pace;
use bus::sample::{AxisCommand, Cause, Feedback, Job, Mode, PlannerStatus, Roster};
use bus::service::RECORDER_DEPTH_SCANS;
use bus::signal_page::SignalPage;
use console::exit::{Kind, Outcome};
use console::signals::Signals;
use console::{logs, output};
use launcher::children::{Child, children_of};
use machine::{Machine, Process};
use monitor::quantities::OF_AXIS;
use operator::{Client, held, program_behind};
use program::Program;

use super::numbers::{CellNow, Numbers, base_unit};
use super::served::Served;
use super::{interval, server};
use crate::listening::inherited;
use crate::live::model::Model;
use crate::live::ports::Ports;
use crate::options::MetricsOptions;

/// Time between two looks at the cell.
const LOOK: Duration = Duration::from_millis(10);
/// Behind whatever controls the machine, where priorities are ordinary.
const NICE: i32 = 10;

/// `quadrant metrics`: serves those of a cell at the listening socket that standard input is, until it ends.
pub fn serve(options: &MetricsOptions) -> Outcome {
    logs::init_launcher();
    output::never_wait();
    let signals = Signals::catch().environment()?;
    let listener = inherited().input()?;
    let Client { cell, machine, bus } = Client::find(Some(&options.cell), "metrics")?;
    let mut ports = held(&cell, Ports::open(bus, &machine, 1))?;
    let children = children_of(cell.page.launcher_pid());
    let pace = children.iter().find_map(|child| child.pace);
    let served = Served {
        place: cell.place.clone(),
        numbers: Arc::new(Numbers::new(&machine, pace.unwrap_or(Pace::Realtime))),
        recorder: Arc::default(),
    };
    if served.numbers.scan_interval.is_some() {
        interval::start(&cell.place, Arc::clone(&served.numbers));
    }
    // What times the scans stays as prompt as it can be. Whoever may not be nice is served all the same.
    let _ = rustix::process::nice(NICE);
    let mut watch = Watch::new(machine, served.clone());
    watch.find_recorder(&cell.page);
    server::start(listener, served).environment()?;
    while signals.count() == 0 && !cell.is_gone() {
        watch.find_recorder(&cell.page);
        let all = watch.take(&mut ports);
        if watch.model.ended {
            cell.note_last();
        }
        watch.look(&cell.page);
        if all {
            std::thread::sleep(LOOK);
        }
    }
    Ok(())
}

struct Watch {
    model: Model,
    numbers: Arc<Numbers>,
    machine: Machine,
    place: CellPaths,
    recorder: Arc<OnceLock<Child>>,
    /// Hash of the program that was tried to be read.
    read: Option<u64>,
    reading: Option<JoinHandle<Option<Program>>>,
    tripped: bool,
    /// Reversals counted so far, of all axes.
    reversals: u64,
}

impl Watch {
    fn new(machine: Machine, served: Served) -> Watch {
        Watch {
            model: Model::new(served.place.name(), machine.clone()),
            numbers: served.numbers,
            machine,
            place: served.place,
            recorder: served.recorder,
            read: None,
            reading: None,
            tripped: false,
            reversals: 0,
        }
    }

    /// Where the log is, and which program the one run has, is known from the recorder's command line.
    fn find_recorder(&mut self, page: &SignalPage) {
        if self.recorder.get().is_none() {
            let mut children = children_of(page.launcher_pid()).into_iter();
            if let Some(recorder) = children.find(|child| child.out.is_some()) {
                let _ = self.recorder.set(recorder);
            }
        }
    }

    /// Takes what has come since the last look, scan by scan; whether that was all.
    fn take(&mut self, ports: &mut Ports) -> bool {
        while let Some(roster) = ports.roster.any() {
            self.roster(&roster);
        }
        if let Some(status) = ports.planner.newest(u64::MAX) {
            self.planner(&status);
        }
        let signals = ports.signals.as_mut();
        if let Some(sample) = signals.and_then(|reader| reader.newest(u64::MAX)) {
            self.numbers.set_signals(sample);
        }
        for _ in 0..RECORDER_DEPTH_SCANS {
            let Some(feedback) = ports.feedback.any() else {
                return true;
            };
            self.feedback(&feedback);
            let scan = feedback.scan;
            for reader in &mut ports.commands {
                while let Some(command) = reader.next(scan) {
                    self.command(&command);
                }
            }
            while let Some(sample) = ports.instruments.next(scan) {
                self.model.instruments(&sample);
            }
            if let Some(reader) = &mut ports.bus_cycle {
                while let Some(sample) = reader.next(scan) {
                    self.numbers.bus.take(&sample);
                }
            }
        }
        false
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
        let values = &axis.values;
        // Of two servos of an axis, the one that drives.
        if sample.role == view.now.taken_role && sample.following_error_mm.is_finite() {
            let error_m = base_unit(axis.kind, sample.following_error_mm);
            values.following_error_m.set(error_m);
            values.following_error_peak_m.raise_to(error_m.abs());
            axis.following_error.take(error_m.abs());
        }
        if sample.role == view.now.taken_role && view.friction().is_some() {
            values.friction_level.set(sample.friction_level);
            values.friction_unexplained.set(sample.friction_unexplained);
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
        // Also one that was there before this process: its count goes on from that of the one before, which had seen it.
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
            let values = &axis.values;
            values
                .position_m
                .set(base_unit(axis.kind, view.feedback_mm()));
            values
                .command_m
                .set(base_unit(axis.kind, view.command_mm()));
            values.torque_nm.set(now.torque_nm);
            values.torque_peak_nm.raise_to(now.torque_nm.abs());
            for (number, one) in values.quantities.iter().zip(&OF_AXIS) {
                number.set((one.of)(now));
            }
            values.missed_scans.set(u64::from(now.missed_scans));
            values.redundancy.set(f64::from(now.redundancy));
            values.differences.set(u64::from(now.differences));
            if now.torque_limited == 1 {
                values.torque_limited_scans.add_one();
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
        let of_run = self.recorder.get().and_then(|of| of.program.clone());
        let Some(file) = of_run.or_else(|| self.place.program(sample.load)) else {
            return;
        };
        self.read = Some(hash);
        self.model.program = None;
        let (machine, sample) = (self.machine.clone(), *sample);
        let thread = std::thread::Builder::new().name("qd-program".into());
        self.reading = thread
            .spawn(move || program_behind(&file, &machine, &sample))
            .ok();
    }

    fn look(&mut self, page: &SignalPage) {
        self.model.end_of_look();
        let numbers = &self.numbers;
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
            let values = &axis.values;
            values.reversals.add_one();
            values.reversal_error_m.set(m(reversal.error_peak_um));
            if let Some(height_um) = reversal.height_um {
                values.protrusion_m.set(m(height_um));
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

#[cfg(test)]
mod tests {
    use bus::sample::{BusCycle, Instruments};
    use bytemuck::Zeroable;

    use super::*;
    use crate::live::test_support::{machine, running};
    use crate::metrics::exposition::{Dialect, text};
    use crate::spoilt::{self, Spoiler};

    /// SPOILT_SAMPLES=1000000 takes some 15 s.
    #[test]
    fn no_number_of_any_sample_keeps_the_metrics_from_being_told() {
        let place = CellPaths::new(&format!("spoilt-{}", std::process::id())).expect("a name");
        std::fs::create_dir(place.folder()).expect("the cell's folder");
        let page = SignalPage::create(&place).expect("its page");
        let served = Served {
            place: place.clone(),
            numbers: Arc::new(Numbers::new(&machine(), Pace::Realtime)),
            recorder: Arc::default(),
        };
        let mut watch = Watch::new(machine(), served.clone());
        let mut spoiler = Spoiler::new();
        for number in 0..spoilt::count(20_000) {
            match number % 6 {
                0 => watch.feedback(&spoiler.feedback(&running(number))),
                1 => watch.command(&spoiler.spoilt(&AxisCommand::zeroed())),
                2 => watch
                    .model
                    .instruments(&spoiler.spoilt(&Instruments::zeroed())),
                3 => watch.roster(&spoiler.spoilt(&Roster::zeroed())),
                4 => watch.planner(&spoiler.spoilt(&PlannerStatus::zeroed())),
                _ => watch.numbers.bus.take(&spoiler.spoilt(&BusCycle::zeroed())),
            }
            if number % 100 == 0 {
                watch.look(&page);
                for dialect in [Dialect::OpenMetrics, Dialect::PrometheusText] {
                    let text = text(&served, dialect).expect("metrics");
                    for line in text.lines().filter(|line| !line.starts_with('#')) {
                        let value = line.rsplit(' ').next().map(str::parse::<f64>);
                        assert!(value.is_some_and(|value| value.is_ok()), "{line}");
                    }
                }
            }
        }
        drop(page);
        let _ = std::fs::remove_dir_all(place.folder());
    }
}
