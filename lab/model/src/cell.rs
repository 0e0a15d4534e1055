//! The state of the model: the processes, what lies between them, and what may still happen.

use std::sync::Arc;

use bus::sample::{Feedback, Job, Order, Participant, Roster, WindowId};
use bytemuck::Zeroable;
use machine::{Machine, Process};
use master::saved::SavedState;
use master::{Master, RunEnd};
use planner::{Planner, ProgramText};
use servo::Servo;

use crate::bench::{Budget, Mistake, PROGRAM, Setting};
use crate::drives::QuietDrives;
use crate::launcher::Launcher;
use crate::members::{Life, Place, PlannerPlace, ServoPlace, Window};
use crate::rules::{Broken, Ghost};

/// The cell's page: what outlives its processes.
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// What the master has saved last.
    pub saved: Option<Arc<SavedState>>,
    /// The scan that was published last.
    pub published: Option<u64>,
    /// The operator's stop waits in the page for a master.
    pub stop: bool,
}

/// What waits at the master's ports; it is lost with the master.
#[derive(Debug, Clone, Default)]
pub struct MasterInbox {
    /// Windows.
    pub windows: Vec<Arc<Window>>,
    /// The launcher's stop.
    pub stop: bool,
    /// What brings a waiting machine on.
    pub go_on: Option<Order>,
}

/// One state of the model.
#[derive(Clone)]
pub struct Cell {
    /// The master, while it lives.
    pub master: Option<Arc<Master<QuietDrives>>>,
    /// Its place.
    pub master_place: Place,
    /// What waits for it.
    pub inbox: MasterInbox,
    /// What outlives everybody.
    pub page: Page,
    /// Who takes part, as everybody reads it.
    pub roster: Roster,
    /// The servos: X, X's standby, Y, Y's standby, as far as there are any.
    pub servos: Vec<ServoPlace>,
    /// The planner.
    pub planner: PlannerPlace,
    /// The launcher.
    pub launcher: Launcher,
    /// Windows that somebody may still name.
    pub windows: Vec<Arc<Window>>,
    /// The newest feedback.
    pub feedback: Option<Feedback>,
    /// What may still happen.
    pub budget: Budget,
    /// What the rules remember.
    pub ghost: Ghost,
    /// Its fingerprint, taken after each step.
    pub name: u64,
}

/// What of the setting every step needs.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The setting.
    pub setting: Setting,
    /// Its machine.
    pub machine: Machine,
}

impl Frame {
    /// Whether this mistake is made.
    pub fn makes(&self, mistake: Mistake) -> bool {
        self.setting.mistake == Some(mistake)
    }

    /// A planner that knows nothing but the program.
    pub fn new_planner(&self, incarnation: u32) -> Arc<Planner> {
        let text = ProgramText::Here("model".into(), PROGRAM.into());
        Arc::new(Planner::of(&self.machine, text, incarnation))
    }

    /// A servo that knows nothing.
    ///
    /// # Panics
    /// The machine has no such axis: a mistake of the model.
    pub fn new_servo(&self, axis: usize, role: usize, incarnation: u32) -> Arc<Servo> {
        let servo = Servo::new(&self.machine, axis, role as u32, incarnation);
        Arc::new(servo.expect("a servo"))
    }

    /// The master that goes on from what the page has: as `master::run` does.
    pub fn new_master(&self, page: &Page, incarnation: u32) -> Arc<Master<QuietDrives>> {
        let mut drives = QuietDrives::default();
        let latches = page.saved.as_ref().map(|saved| {
            let latches = saved.restore(&mut drives);
            latches.expect("what was saved")
        });
        let published = page
            .published
            .filter(|_| !self.makes(Mistake::ScanPublishedTwice));
        let last = latches.map(|latches| latches.scan).max(published);
        let first_scan = last.map_or(0, |scan| scan + 1);
        let end = RunEnd::AfterProgram;
        let machine = &self.machine;
        let mut master = Master::new(machine, drives, incarnation, first_scan, true, end);
        if let Some(mut latches) = latches {
            if self.makes(Mistake::PlaceForgotten) {
                latches.left = master::window_arbiter::WindowArbiter::new().left(0);
            }
            master.resume(&latches);
        }
        Arc::new(master)
    }

    /// The cell about to run its program.
    pub fn start(&self) -> Cell {
        let mut servos = Vec::new();
        for axis in 0..2 {
            for role in 0..=usize::from(self.setting.standby[axis]) {
                servos.push(ServoPlace {
                    axis,
                    role,
                    place: Place::FIRST,
                    servo: self.new_servo(axis, role, 1),
                    windows: Vec::new(),
                    peer: None,
                    last: None,
                });
            }
        }
        let mut roster = Roster {
            version: 1,
            ..Roster::zeroed()
        };
        let of_servos = servos.iter().map(|s| Process::servo(s.axis, s.role));
        let all = of_servos.chain([Job::Planner.into(), Job::Master.into()]);
        for (place, process) in roster.participants.iter_mut().zip(all) {
            *place = process.first();
        }
        let page = Page::default();
        Cell {
            master: Some(self.new_master(&page, 1)),
            master_place: Place::FIRST,
            inbox: MasterInbox::default(),
            page,
            roster,
            servos,
            planner: PlannerPlace {
                place: Place::FIRST,
                planner: self.new_planner(1),
                answered: None,
            },
            launcher: Launcher::default(),
            windows: Vec::new(),
            feedback: None,
            budget: self.setting.budget,
            ghost: Ghost::default(),
            name: 0,
        }
    }
}

/// Who can be killed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Who {
    /// This servo of the list.
    Servo(usize),
    /// The planner.
    Planner,
    /// The master.
    Master,
}

impl Cell {
    /// The place of a process.
    pub fn place(&self, who: Who) -> Place {
        match who {
            Who::Servo(index) => self.servos[index].place,
            Who::Planner => self.planner.place,
            Who::Master => self.master_place,
        }
    }

    /// The same, to be changed.
    pub fn place_mut(&mut self, who: Who) -> &mut Place {
        match who {
            Who::Servo(index) => &mut self.servos[index].place,
            Who::Planner => &mut self.planner.place,
            Who::Master => &mut self.master_place,
        }
    }

    /// Everybody.
    pub fn everybody(&self) -> impl Iterator<Item = Who> + use<> {
        let servos = (0..self.servos.len()).map(Who::Servo);
        servos.chain([Who::Planner, Who::Master])
    }

    /// The entry of a process in the roster.
    pub fn participant(&mut self, who: Who) -> &mut Participant {
        let servos = self.servos.len();
        let index = match who {
            Who::Servo(index) => index,
            Who::Planner => servos,
            Who::Master => servos + 1,
        };
        &mut self.roster.participants[index]
    }

    /// It dies between two scans.
    pub fn kill(&mut self, who: Who) {
        self.place_mut(who).life = Life::Dead;
        if who == Who::Master {
            self.master = None;
            self.inbox = MasterInbox::default();
        }
    }

    /// The scan that is to be published next.
    pub fn next_scan(&self) -> u64 {
        match &self.master {
            Some(master) => master.scan(),
            None => self.page.published.map_or(0, |scan| scan + 1),
        }
    }

    /// The window of this name.
    pub fn window(&self, id: WindowId) -> Option<&Arc<Window>> {
        self.windows.iter().find(|window| window.header.id == id)
    }

    /// Forgets windows that nobody names any more.
    pub fn forget_windows(&mut self) {
        let mut named = Vec::new();
        if let Some(feedback) = &self.feedback {
            named.push(feedback.window);
        }
        if let Some(master) = &self.master {
            let inner = master.inner();
            named.extend([master.feedback().window, inner.pending]);
            named.extend(inner.axes.iter().map(|axis| axis.pending));
        }
        for servo in self.servos.iter().filter(|servo| servo.place.life.lives()) {
            named.extend(servo.servo.windows().map(|header| header.id));
            named.extend(servo.windows.iter().map(|window| window.header.id));
        }
        let planner = self.planner.planner.inner();
        named.extend(planner.windows.map(|(id, _)| id));
        named.extend(self.inbox.windows.iter().map(|window| window.header.id));
        self.windows
            .retain(|window| named.contains(&window.header.id));
    }

    /// A rule is broken; the first one counts.
    pub fn broken(&mut self, rule: Broken) {
        self.ghost.broken.get_or_insert(rule);
    }
}
