//! Takes samples from a running cell into a model; nobody in the cell waits for it.

use std::fs;
use std::iter::from_fn;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::{Duration, Instant};

use bus::drive_page::DrivePage;
use bus::member::Pace;
use bus::messages::MessageReader;
use bus::observer::{Held, Observer};
use bus::sample::{Auxiliaries, Feedback, Levels};
use bus::service::RECORDER_DEPTH_SCANS;
use machine::Machine;

use super::dro::ProgramTimes;
use super::fieldbus;
use super::model::Model;
use super::ports::Ports;
use super::source::Source;
use super::state::Shown;
use super::timing::listen;
use console::exit::Failure;
use launcher::children::children_of;
use launcher::retention::USAGE_FILE;
use operator::{
    Client, held, machine_of_run, modes_behind, next_start, program_behind, shown_alarms,
    shown_signals,
};

/// Time between two looks at `/proc`.
const PROC_EVERY: Duration = Duration::from_millis(500);

/// Messages of the program that an observer who comes later looks back for.
const SAID_BEFORE: u32 = 8;

/// A foot in the cell, and the model it fills.
pub struct Feed {
    /// What is known.
    pub model: Model,
    cell: Rc<Observer>,
    machine: Machine,
    messages: MessageReader,
    ports: Option<Held<Ports>>,
    /// Of a cell with a fieldbus.
    drive_page: Option<DrivePage>,
    program_file: Option<PathBuf>,
    /// Hash of the program that was tried to be read.
    read: Option<u64>,
    /// Tool, offset, modes, spindle and coolant that the state before the next program was made of.
    next_start_of: Option<Auxiliaries>,
    proc_seen: Option<Instant>,
    heard: Instant,
}

impl Feed {
    /// Attaches to the cell that is named, or the only one that runs.
    ///
    /// # Errors
    /// None runs, several do, or it cannot be entered.
    pub fn attach(cell: Option<&str>) -> Result<Feed, Failure> {
        let Client { cell, machine, bus } = Client::find(cell, "monitor")?;
        Ok(Feed {
            ports: Some(held(&cell, Ports::open(bus, &machine, 1))?),
            model: Model::new(cell.place.name(), machine.clone()),
            drive_page: match machine.bus {
                Some(_) => DrivePage::open(&cell.place).ok(),
                None => None,
            },
            messages: MessageReader::new(cell.place.messages()),
            cell,
            machine,
            program_file: None,
            read: None,
            next_start_of: None,
            proc_seen: None,
            heard: Instant::now(),
        })
    }

    fn drain(&mut self, ports: &mut Ports) {
        let mut newest = None;
        for feedback in from_fn(|| ports.feedback.any()).take(RECORDER_DEPTH_SCANS) {
            if newest.is_none() || self.read != Some(feedback.program_hash) {
                self.read_program(&feedback);
            }
            self.name_loaded(&feedback);
            self.hear(&feedback);
            self.model.feedback(&feedback);
            newest = Some(feedback.scan);
        }
        if self.model.ended {
            self.cell.note_last();
        }
        if newest.is_some() {
            self.heard = Instant::now();
            let shown = self.model.feedback.map(|feedback| feedback.auxiliary);
            let key = shown.map(|of| Auxiliaries {
                tool: of.tool,
                tool_offset_of: of.tool_offset_of,
                tool_offset: of.tool_offset,
                modes_of_run: of.modes_of_run,
                levels: Levels {
                    spindle: of.levels.spindle,
                    spindle_rpm: of.levels.spindle_rpm.signum(),
                    coolant: of.levels.coolant,
                    ..Levels::default()
                },
                ..Auxiliaries::default()
            });
            if self.next_start_of != key {
                self.next_start_of = key;
                self.look_at_offsets();
            }
        }
        self.model.feedback_age_s = self.heard.elapsed().as_secs_f64();
        self.model.scarce = monitor::room::scarce(&self.cell.place);
        while let Some(roster) = ports.roster.any() {
            self.model.roster(&roster);
        }
        if let Some(status) = ports.planner.newest(u64::MAX) {
            self.model.planner = Some(status);
        }
        if let Some(signals) = ports
            .signals
            .as_mut()
            .and_then(|reader| reader.newest(u64::MAX))
        {
            self.model.signals = shown_signals(&self.machine, &signals);
            self.model.alarms = shown_alarms(&self.machine, &signals);
        }
        // What belongs to a scan later than the newest feedback waits for the next look.
        let now = self.model.feedback.map_or(0, |feedback| feedback.scan);
        for reader in &mut ports.commands {
            let commands = from_fn(|| reader.next(now)).take(RECORDER_DEPTH_SCANS);
            commands.for_each(|command| self.model.command(&command));
        }
        let samples = from_fn(|| ports.instruments.next(now)).take(RECORDER_DEPTH_SCANS);
        samples.for_each(|sample| self.model.instruments(&sample));
    }

    /// What the program has said; of what it said before this observer came, the last.
    fn hear(&mut self, feedback: &Feedback) {
        let is_first = self.model.feedback.is_none();
        if is_first {
            let before = feedback.messages.saturating_sub(SAID_BEFORE);
            self.messages.skip_to(feedback, before);
        } else if self.messages.is_other_run(feedback) {
            self.model.said.clear();
        }
        let heard = self.messages.hear(feedback);
        for message in heard.messages.into_iter().filter(|of| !of.log_only) {
            self.model.said(feedback.scan, message, !is_first);
        }
    }

    fn look_at_processes(&mut self) {
        self.proc_seen = Some(Instant::now());
        self.look_at_offsets();
        let runs = fs::read(self.cell.place.folder().join(USAGE_FILE)).ok();
        self.model.runs = runs.and_then(|runs| serde_json::from_slice(&runs).ok());
        let page = &self.cell.page;
        let children = children_of(page.launcher_pid());
        if let Some(program) = children.iter().find_map(|child| child.program.clone()) {
            self.program_file = Some(program);
        }
        let recorded = page.recorded_scans().checked_sub(1);
        let places = 0..bus::sample::MAX_PARTICIPANTS;
        let answered = places.map(|place| page.answered_scan(place)).collect();
        self.model.processes_seen(children, answered, recorded);
    }

    /// Finds the name of the program that was loaded last.
    fn name_loaded(&mut self, feedback: &Feedback) {
        let before = self.model.feedback.as_ref().map(|before| before.load);
        if before != Some(feedback.load) {
            let file = self.cell.place.program(feedback.load);
            let name = file.as_deref().and_then(|file| file.file_name());
            self.model.loaded = name.map(|name| name.to_string_lossy().into_owned());
        }
    }

    /// Reads the program that the tags of this feedback belong to, once. What cannot be read, is very large or is another
    /// program by now leaves lines and arcs unknown, no more.
    fn read_program(&mut self, feedback: &Feedback) {
        let hash = feedback.program_hash;
        if hash == 0 || self.read == Some(hash) {
            return;
        }
        let loaded = self.cell.place.program(feedback.load);
        let Some(file) = loaded.as_ref().or(self.program_file.as_ref()) else {
            return;
        };
        self.read = Some(hash);
        let machine = machine_of_run(&self.machine, &self.cell.place, feedback);
        self.model.program = program_behind(file, &machine, feedback);
        let path = self.model.program.as_ref().map(|program| &program.path);
        self.model.course = path.and_then(|path| {
            let modes = modes_behind(file, &machine, feedback)?;
            Some(ProgramTimes::new(&machine, path, modes))
        });
    }

    /// What the next program or typed-in block begins with.
    fn look_at_offsets(&mut self) {
        let Some(feedback) = &self.model.feedback else {
            return;
        };
        let shown = &feedback.auxiliary;
        self.model.next_start = next_start(&self.machine, &self.cell.place, shown);
    }

    /// Whether nobody of the cell can be heard any more.
    pub fn is_gone(&self) -> bool {
        self.cell.is_gone()
    }

    /// Text of the cell's machine file.
    #[cfg(feature = "remote")]
    pub fn machine_text(&self) -> std::io::Result<String> {
        fs::read_to_string(self.cell.place.machine_file())
    }
}

impl Source for Feed {
    fn model(&self) -> &Model {
        &self.model
    }

    /// Takes whatever has come since the last look: at most what the queues hold.
    fn look(&mut self) {
        if self
            .proc_seen
            .is_none_or(|then| then.elapsed() > PROC_EVERY)
        {
            self.look_at_processes();
        }
        let Some(mut ports) = self.ports.take() else {
            return;
        };
        self.drain(&mut ports);
        self.model.bus = self
            .drive_page
            .as_ref()
            .map(|page| fieldbus::of(page, &self.machine));
        self.ports = Some(ports);
        self.model.end_of_look();
        self.model.shown = Shown::of(&self.model);
    }

    fn is_whole(&self) -> bool {
        self.model.is_whole()
    }

    /// Whether the cell is gone, or about to go.
    fn has_ended(&self) -> bool {
        self.model.ended || self.cell.is_gone()
    }

    /// In real time: waits at the scan's signal for `budget` and takes the periods between its rings. Elsewhere scans have no
    /// period, and it sleeps.
    fn watch_periods(&mut self, budget: Duration) {
        if self.model.pace != Some(Pace::Realtime) {
            std::thread::sleep(budget);
            return;
        }
        let (page, timing) = (&self.cell.page, &mut self.model.timing);
        listen(page.scan_signal(), budget, |period_ns| {
            timing.take(period_ns)
        });
    }

    /// Where the run is over, goes over to the next cell of that name as soon as there is one.
    fn follow(&mut self) {
        if !self.cell.is_gone() {
            return;
        }
        self.model.ended = true;
        self.model.shown = Shown::of(&self.model);
        self.ports = None;
        if let Ok(feed) = Feed::attach(Some(self.cell.place.name())) {
            *self = feed;
        }
    }

    fn takes_orders(&self) -> bool {
        true
    }
}
