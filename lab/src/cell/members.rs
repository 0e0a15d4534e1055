//! The processes that answer, and what a script does to them: what each remembers goes when it is killed.

use std::cell::RefCell;
use std::rc::Rc;

use bus::sample::Job;
use machine::{Machine, Process};
use planner::{Planner, ProgramText};
use plant_sim::script::faults::FaultScript;
use servo::{Servo, ServoSettingsError};

use super::ports::{PlannerQueues, ServoQueues};
use crate::faulty::Faulty;

/// Scans in which the faults of the script have fired, by index; shared by all who need to know.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fired(Rc<RefCell<Vec<Option<u64>>>>);

impl Fired {
    /// Of so many faults, none of which has fired.
    pub fn none_of(faults: usize) -> Fired {
        Fired(Rc::new(RefCell::new(vec![None; faults])))
    }

    pub fn get(&self, index: usize) -> Option<u64> {
        self.0.borrow().get(index).copied().flatten()
    }

    pub fn set(&self, index: usize, scan: u64) {
        if let Some(fired) = self.0.borrow_mut().get_mut(index) {
            *fired = Some(scan);
        }
    }
}

type FiredBy = Box<dyn Fn(usize) -> Option<u64>>;

fn fired_by(fired: &Fired) -> FiredBy {
    let fired = fired.clone();
    Box::new(move |index| fired.get(index))
}

/// Whether a process takes part.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Life {
    pub incarnation: u32,
    pub lives: bool,
    /// It has been stopped: it lives and does nothing.
    pub stopped: bool,
}

impl Life {
    /// The first process in a slot.
    pub const FIRST: Life = Life {
        incarnation: 1,
        lives: true,
        stopped: false,
    };

    /// The process that follows this one.
    pub fn next(self) -> Life {
        Life {
            incarnation: self.incarnation + 1,
            ..Life::FIRST
        }
    }

    pub fn answers(self) -> bool {
        self.lives && !self.stopped
    }
}

/// One servo process. Its pure part is kept beside it, so that tests can prepare it.
pub(crate) struct ServoMember {
    pub axis: usize,
    pub role: usize,
    pub life: Life,
    pub ports: Faulty<ServoQueues, FiredBy>,
}

impl ServoMember {
    /// The servo of an axis in a role; `standby` where the axis has two.
    pub fn new(
        (axis, role, standby): (usize, usize, bool),
        life: Life,
        script: Option<&FaultScript>,
        fired: &Fired,
    ) -> ServoMember {
        let sender = Process::servo(axis, role);
        ServoMember {
            axis,
            role,
            life,
            ports: Faulty::new(ServoQueues::new(standby), script, sender, fired_by(fired)),
        }
    }

    pub fn servo(&self, machine: &Machine) -> Result<Servo, ServoSettingsError> {
        Servo::new(machine, self.axis, self.role as u32, self.life.incarnation)
    }

    /// Another process in its slot.
    pub fn replacement(&mut self, script: Option<&FaultScript>, fired: &Fired) -> ServoMember {
        let standby = self.ports.inner().peer.is_some();
        let which = (self.axis, self.role, standby);
        ServoMember::new(which, self.life.next(), script, fired)
    }
}

/// The planner process.
pub(crate) struct PlannerMember {
    pub planner: Planner,
    pub life: Life,
    pub ports: Faulty<PlannerQueues, FiredBy>,
}

impl PlannerMember {
    /// A planner of this program (name and text).
    pub fn new(
        machine: &Machine,
        (name, text): (&str, &str),
        life: Life,
        script: Option<&FaultScript>,
        fired: &Fired,
    ) -> PlannerMember {
        let sender = Job::Planner.into();
        let program = ProgramText::Here(name.into(), text.into());
        PlannerMember {
            planner: Planner::of(machine, program, life.incarnation),
            life,
            ports: Faulty::new(PlannerQueues::default(), script, sender, fired_by(fired)),
        }
    }
}
