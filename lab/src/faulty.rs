//! Ports that send wrong, late or not at all, as a fault script asks: the same servo and planner over them behave as ever, and
//! everybody else meets what they send.

use std::path::Path;

use bus::messages::ProgramMessage;
use bus::sample::{Auxiliaries, AxisCommand, Feedback, Job, PlannerStatus, Setpoint, WindowHeader};
use bus::user_codes::UserCall;
use machine::settings_file::SettingsFileError;
use machine::{KeptTexts, Machine, Process};
use planner::ports::UserCode;
use planner::questions::KeptAnswer;
use planner::{Left, Place, PlannerError, PlannerPorts, ProgramText};
use plant_sim::script::faults::{self, FaultScript};
use servo::{ServoError, ServoPorts};

use crate::corruption::Corruptor;

/// Ports of one sender, whose samples the faults of a script meet.
#[derive(Debug)]
pub struct Faulty<P, F> {
    ports: P,
    /// None where the run has no script.
    corruptor: Option<Corruptor>,
    /// Scan in which a fault of the script fired, by its index.
    fired: F,
    /// The scan that is being answered.
    scan: u64,
    /// A window has been published in it.
    planned: bool,
    /// The command as its servo made it.
    made: Option<AxisCommand>,
}

impl<P, F: Fn(usize) -> Option<u64>> Faulty<P, F> {
    /// The ports of one sender.
    pub fn new(ports: P, script: Option<&FaultScript>, process: Process, fired: F) -> Faulty<P, F> {
        let corruptor = script.map(|s| Corruptor::new(s, process));
        Faulty {
            ports,
            corruptor,
            fired,
            scan: 0,
            planned: false,
            made: None,
        }
    }

    /// The ports behind.
    pub fn inner(&mut self) -> &mut P {
        &mut self.ports
    }

    /// The last command as its servo made it, whatever was sent in its place.
    pub fn made(&self) -> Option<&AxisCommand> {
        self.made.as_ref()
    }
}

impl<P: ServoPorts, F: Fn(usize) -> Option<u64>> ServoPorts for Faulty<P, F> {
    type Feedback = P::Feedback;

    fn next_feedback(&mut self) -> Option<P::Feedback> {
        self.ports.next_feedback()
    }

    fn for_each_window(&mut self, scan: u64, offer: impl FnMut(&WindowHeader, &[Setpoint])) {
        self.ports.for_each_window(scan, offer);
    }

    fn peer_command(&mut self, scan: u64) -> Option<AxisCommand> {
        self.ports.peer_command(scan)
    }

    fn publish(&mut self, command: &AxisCommand) {
        self.made = Some(*command);
        let ports = &mut self.ports;
        match &mut self.corruptor {
            None => ports.publish(command),
            Some(corruptor) => {
                corruptor.command(command, &self.fired, |sent| ports.publish(sent));
            }
        }
    }

    fn answered(&mut self, scan: u64) {
        self.ports.answered(scan);
    }
}

impl<P: PlannerPorts, F: Fn(usize) -> Option<u64>> Faulty<P, F> {
    fn window(&mut self, planned: Option<(&WindowHeader, &[Setpoint])>) {
        let ports = &mut self.ports;
        let mut send = |header: &WindowHeader, setpoints: &[Setpoint]| {
            ports.publish_window(header, setpoints);
        };
        match (&mut self.corruptor, planned) {
            (Some(corruptor), planned) => {
                corruptor.window(self.scan, planned, &self.fired, send);
            }
            (None, Some((header, setpoints))) => send(header, setpoints),
            (None, None) => {}
        }
    }
}

impl<P: PlannerPorts, F: Fn(usize) -> Option<u64>> PlannerPorts for Faulty<P, F> {
    fn next_feedback(&mut self) -> Option<Feedback> {
        let feedback = self.ports.next_feedback()?;
        self.scan = feedback.scan;
        self.planned = false;
        Some(feedback)
    }

    fn program(&mut self, load: u32) -> Option<ProgramText> {
        self.ports.program(load)
    }

    fn place_before(&mut self, program_hash: u64, element: u32) -> Option<Place> {
        self.ports.place_before(program_hash, element)
    }

    fn keep_place(&mut self, place: &Place, tool: u32) {
        self.ports.keep_place(place, tool);
    }

    fn answers(&mut self, load: u32, run: u32) -> Vec<KeptAnswer> {
        self.ports.answers(load, run)
    }

    fn keep_answer(&mut self, load: u32, run: u32, answer: &KeptAnswer) -> bool {
        self.ports.keep_answer(load, run, answer)
    }

    fn parameters(
        &mut self,
        run: Option<(u32, u32)>,
        machine: &Machine,
        shown: &Auxiliaries,
    ) -> Result<Option<KeptTexts>, SettingsFileError> {
        self.ports.parameters(run, machine, shown)
    }

    fn keep_modes(&mut self, run: u32, modes: &str) -> Result<(), String> {
        self.ports.keep_modes(run, modes)
    }

    fn keep_tool(&mut self, machine: &Machine, tool: u32) {
        self.ports.keep_tool(machine, tool);
    }

    fn keep(&mut self, machine: &Machine, left: &Left) -> Result<(), String> {
        self.ports.keep(machine, left)
    }

    fn user_code(&mut self, call: &UserCall) -> UserCode {
        self.ports.user_code(call)
    }

    fn write_messages(&mut self, load: u32, run: u32, messages: &[ProgramMessage]) {
        self.ports.write_messages(load, run, messages);
    }

    fn publish_window(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        self.planned = true;
        self.window(Some((header, setpoints)));
    }

    fn publish_status(&mut self, status: &PlannerStatus) {
        if !self.planned {
            // A window that was held back may be due.
            self.window(None);
        }
        let sent = match &self.corruptor {
            Some(corruptor) => corruptor.status(status, &self.fired),
            None => *status,
        };
        self.ports.publish_status(&sent);
    }

    fn answered(&mut self, scan: u64) {
        self.ports.answered(scan);
    }
}

/// Runs a servo process over ports that the faults of this script meet.
///
/// # Errors
/// [`ServoError`], also where the script cannot be read.
pub fn servo(options: &servo::Options, script: Option<&Path>) -> Result<(), ServoError> {
    servo::run_over(options, |ports, member, machine| {
        let script = load(script, machine)?;
        let axis = machine.axes.iter().position(|a| a.name == options.axis);
        let process = Process::servo(axis.unwrap_or(0), options.role as usize);
        let member = std::rc::Rc::clone(member);
        let fired = move |index| member.page.fault_fired(index);
        Ok(Faulty::new(ports, script.as_ref(), process, fired))
    })
}

/// Runs a planner process over ports that the faults of this script meet.
///
/// # Errors
/// [`PlannerError`], also where the script cannot be read.
pub fn planner(options: &planner::Options, script: Option<&Path>) -> Result<(), PlannerError> {
    planner::run_over(options, |ports, member, machine| {
        let script = load(script, machine)?;
        let member = std::rc::Rc::clone(member);
        let fired = move |index| member.page.fault_fired(index);
        let process = Job::Planner.into();
        Ok(Faulty::new(ports, script.as_ref(), process, fired))
    })
}

fn load(
    script: Option<&Path>,
    machine: &machine::Machine,
) -> Result<Option<FaultScript>, SettingsFileError> {
    script.map(|path| faults::load(path, machine)).transpose()
}
