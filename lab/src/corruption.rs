//! What a faulty sender does to its own samples, as a fault script asks: it withholds them, sends them late, or sends
//! wrong ones. Pure: the processes and the simulation of a whole cell within one process use the same.
//!
//! A fault that fired in scan f and lasts n scans meets what is made from the feedbacks of scans f to f + n − 1. The
//! planner's faults meet its windows; its status comes as ever.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bytemuck::Zeroable;

use bus::layout::Leaf;
use bus::sample::{AxisCommand, Job, MAX_WINDOW_SETPOINTS, PlannerStatus, Setpoint, WindowHeader};
use bus::window::checksum;
use machine::Process;
use plant_sim::script::faults::{
    Action, Corruption, FaultScript, Field, LATE_SCANS_MAX, Sent, Spoil,
};
use plant_sim::script::reach::meets;

/// How far off a wrong position of a command is, in increments.
const JUMP_INCREMENTS: i64 = 1_000_000_000;
/// How far off a wrong setpoint is, in increments.
const ROW_JUMP_INCREMENTS: i64 = 1_000_000;
/// How far off a wrong scan is.
const WRONG_SCANS: u64 = 3;

/// What a script does to the samples of one sender.
#[derive(Debug)]
pub struct Corruptor {
    faults: Vec<(usize, Action)>,
    command_before: Option<AxisCommand>,
    /// Commands that wait to be sent late; as many places as can wait, none if none ever does.
    late_commands: Vec<Late<AxisCommand>>,
    window_before: Window,
    late_windows: Vec<Late<Window>>,
    /// The window as it is sent.
    sent: Window,
    replays: bool,
}

/// Something to be sent late.
#[derive(Debug, Clone, Copy)]
struct Late<T> {
    /// In which scan; [`NOTHING_DUE`] for nothing to be sent.
    due: u64,
    what: T,
}

const NOTHING_DUE: u64 = u64::MAX;

impl<T> Late<T> {
    fn none(room: T) -> Late<T> {
        Late {
            due: NOTHING_DUE,
            what: room,
        }
    }

    /// The oldest of those that are due by `now`; it no longer waits.
    fn take_due(waiting: &mut [Late<T>], now: u64) -> Option<&mut T> {
        let due = waiting
            .iter_mut()
            .filter(|late| late.due <= now && late.due != NOTHING_DUE);
        let oldest = due.min_by_key(|late| late.due)?;
        oldest.due = NOTHING_DUE;
        Some(&mut oldest.what)
    }

    /// A free place, now taken until `due`. There is one: what waits is due within [`LATE_SCANS_MAX`] scans, one of each.
    fn place(waiting: &mut [Late<T>], due: u64) -> Option<&mut T> {
        let free = waiting.iter_mut().find(|late| late.due == NOTHING_DUE)?;
        free.due = due;
        Some(&mut free.what)
    }
}

/// A window that was kept.
#[derive(Debug)]
struct Window {
    header: WindowHeader,
    setpoints: Vec<Setpoint>,
}

impl Window {
    /// None yet, with room for this many setpoints.
    fn with_room(setpoints: usize) -> Window {
        Window {
            header: WindowHeader::zeroed(),
            setpoints: Vec::with_capacity(setpoints),
        }
    }

    /// Keeps what there is room for.
    fn set(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        self.header = *header;
        self.setpoints.clear();
        let room = self.setpoints.capacity();
        self.setpoints
            .extend_from_slice(setpoints.get(..room).unwrap_or(setpoints));
    }

    fn seal(&mut self) {
        self.header.id.checksum = checksum(&self.header, &self.setpoints);
    }
}

impl Corruptor {
    /// What the script does to the samples of this sender; nothing is allocated after this.
    pub fn new(script: &FaultScript, process: Process) -> Corruptor {
        let own = script.faults.iter().enumerate();
        let faults: Vec<(usize, Action)> = own
            .filter(|(_, fault)| fault.process == process)
            .map(|(index, fault)| (index, fault.action))
            .filter(|(_, action)| !matches!(action, Action::Kill { .. } | Action::Stop { .. }))
            .collect();
        let delays = faults
            .iter()
            .any(|(_, action)| matches!(action, Action::Delay { .. }));
        let replays = faults.iter().any(|(_, action)| {
            matches!(
                action,
                Action::Corrupt {
                    what: Corruption::Replay,
                    ..
                }
            )
        });
        let planner = process.job == Job::Planner;
        let places = |needed: bool| 0..if needed { LATE_SCANS_MAX } else { 0 };
        let window =
            |needed: bool| Window::with_room(if needed { MAX_WINDOW_SETPOINTS } else { 0 });
        Corruptor {
            command_before: None,
            late_commands: places(delays && !planner)
                .map(|_| Late::none(AxisCommand::zeroed()))
                .collect(),
            window_before: window(planner && replays),
            late_windows: places(delays && planner)
                .map(|_| Late::none(window(true)))
                .collect(),
            sent: window(planner && !faults.is_empty()),
            replays,
            faults,
        }
    }

    /// Sends a servo's command of one scan as the faults want it: first what is late and due, which was made before, then
    /// this one, if it is to be sent now. Late ones keep their scan; they become visible one scan after they are sent.
    pub fn command(
        &mut self,
        command: &AxisCommand,
        fired: impl Fn(usize) -> Option<u64>,
        mut send: impl FnMut(&AxisCommand),
    ) {
        if self.faults.is_empty() {
            send(command);
            return;
        }
        let now = command.scan;
        while let Some(late) = Late::take_due(&mut self.late_commands, now) {
            late.visible_from = now.saturating_add(1);
            send(late);
        }
        let before = self.command_before.replace(*command);
        let (mut sent, mut dropped, mut due) = (Some(*command), false, None);
        for action in active(&self.faults, now, &fired) {
            match action {
                Action::Corrupt {
                    what: Corruption::Replay,
                    ..
                } => sent = before,
                Action::Corrupt { what, .. } => {
                    if let Some(sent) = &mut sent {
                        corrupt_command(sent, what);
                    }
                }
                Action::Spoil { field, how, .. } => {
                    if let Some(sent) = &mut sent {
                        spoil(sent, field, how);
                    }
                }
                Action::Delay { late_scans, .. } => due = due.max(now.checked_add(late_scans)),
                _ => dropped = true,
            }
        }
        let Some(sent) = sent.filter(|_| !dropped) else {
            return;
        };
        match due {
            None => send(&sent),
            Some(due) => {
                if let Some(place) = Late::place(&mut self.late_commands, due) {
                    *place = sent;
                }
            }
        }
    }

    /// Sends what the planner has for one scan as the faults want it: first windows that are late and due, then the one
    /// planned in this scan, if there is one and it is to be sent now. To be called also when nothing was planned: a late
    /// window is sent when the planner next wakes.
    ///
    /// Every corruption but `checksum`, `cut` and `replay`, and the later `visible_from` of a late window, comes under a
    /// right checksum, so that it is not by the checksum that it is found out.
    pub fn window(
        &mut self,
        scan: u64,
        planned: Option<(&WindowHeader, &[Setpoint])>,
        fired: impl Fn(usize) -> Option<u64>,
        mut send: impl FnMut(&WindowHeader, &[Setpoint]),
    ) {
        if self.faults.is_empty() {
            if let Some((header, setpoints)) = planned {
                send(header, setpoints);
            }
            return;
        }
        while let Some(late) = Late::take_due(&mut self.late_windows, scan) {
            let right = late.header.id.checksum == checksum(&late.header, &late.setpoints);
            late.header.visible_from = scan.saturating_add(1);
            if right {
                late.seal();
            }
            send(&late.header, &late.setpoints);
        }
        let Some((header, setpoints)) = planned else {
            return;
        };
        self.sent.set(header, setpoints);
        let (mut dropped, mut due) = (false, None);
        for action in active(&self.faults, scan, &fired) {
            match action {
                Action::Corrupt {
                    what: Corruption::Replay,
                    ..
                } => {
                    let before = &self.window_before;
                    dropped |= before.header.id.is_none();
                    self.sent.set(&before.header, &before.setpoints);
                }
                Action::Corrupt { what, .. } => corrupt_window(&mut self.sent, what),
                Action::Spoil { field, how, .. } => spoil_window(&mut self.sent, field, how),
                Action::Delay { late_scans, .. } => due = due.max(scan.checked_add(late_scans)),
                _ => dropped = true,
            }
        }
        if self.replays {
            self.window_before.set(header, setpoints);
        }
        let sent = &self.sent;
        match due {
            _ if dropped => {}
            None => send(&sent.header, &sent.setpoints),
            Some(due) => {
                if let Some(place) = Late::place(&mut self.late_windows, due) {
                    place.set(&sent.header, &sent.setpoints);
                }
            }
        }
    }
}

impl Corruptor {
    /// What is sent in the place of a status.
    pub fn status(
        &self,
        status: &PlannerStatus,
        fired: impl Fn(usize) -> Option<u64>,
    ) -> PlannerStatus {
        let mut sent = *status;
        for action in active(&self.faults, status.scan, &fired) {
            if let Action::Spoil { field, how, .. } = action
                && field.sent == Sent::Status
            {
                spoil(&mut sent, field, how);
            }
        }
        sent
    }
}

fn spoil<T: bytemuck::Pod>(sample: &mut T, field: Field, how: Spoil) {
    if let Some(leaf) = field.leaf() {
        spoil_number(sample, leaf, how);
    }
}

/// Makes one number of a sample wrong.
pub fn spoil_number<T: bytemuck::Pod>(sample: &mut T, leaf: &Leaf, how: Spoil) {
    let place = leaf.offset..leaf.offset.saturating_add(leaf.bytes);
    let Some(bytes) = bytemuck::bytes_of_mut(sample).get_mut(place) else {
        return;
    };
    let mut whole = [0; 8];
    for (to, from) in whole.iter_mut().zip(bytes.iter()) {
        *to = *from;
    }
    let spoilt = how.of(u64::from_le_bytes(whole), leaf).to_le_bytes();
    for (to, from) in bytes.iter_mut().zip(spoilt) {
        *to = from;
    }
}

/// A number of the header, or of a setpoint in the middle.
fn spoil_window(window: &mut Window, field: Field, how: Spoil) {
    match field.sent {
        Sent::Window => spoil(&mut window.header, field, how),
        Sent::Setpoint => {
            let middle = window.header.intended_setpoints as usize / 2;
            if let Some(setpoint) = window.setpoints.get_mut(middle) {
                spoil(setpoint, field, how);
            }
        }
        Sent::Command | Sent::Status => return,
    }
    let is_checksum = field.leaf().is_some_and(|leaf| leaf.name == "id.checksum");
    if field.sealed && !is_checksum {
        window.seal();
    }
}

/// The faults that meet what is sent in this scan.
fn active(
    faults: &[(usize, Action)],
    scan: u64,
    fired: &impl Fn(usize) -> Option<u64>,
) -> impl Iterator<Item = Action> {
    faults.iter().filter_map(move |(index, action)| {
        let fired = fired(*index)?;
        meets(action, fired, scan).then_some(*action)
    })
}

/// What is not for commands the script refuses.
fn corrupt_command(command: &mut AxisCommand, what: Corruption) {
    match what {
        Corruption::NotANumber | Corruption::Infinity => {
            let value = wrong_value(what);
            command.velocity_mm_s = value;
            command.torque_nm = value;
        }
        Corruption::Jump => {
            command.position = command.position.saturating_add(JUMP_INCREMENTS);
            command.velocity_mm_s *= 1e3;
        }
        Corruption::OldScan => command.scan = command.scan.saturating_sub(WRONG_SCANS),
        Corruption::FutureScan => command.scan = command.scan.saturating_add(WRONG_SCANS),
        Corruption::NeverVisible => command.visible_from = u64::MAX,
        Corruption::WrongAxis => command.axis = command.axis.wrapping_add(1),
        Corruption::WrongIncarnation => command.incarnation = command.incarnation.wrapping_add(1),
        Corruption::Replay | Corruption::Checksum | Corruption::SetpointJump | Corruption::Cut => {}
    }
}

/// What is not for windows the script refuses.
fn corrupt_window(window: &mut Window, what: Corruption) {
    let header = &mut window.header;
    match what {
        Corruption::NotANumber | Corruption::Infinity => {
            if let Some(setpoint) = window.setpoints.first_mut() {
                setpoint.tag.distance_mm = wrong_value(what);
            }
        }
        Corruption::OldScan => header.first_scan = header.first_scan.saturating_sub(WRONG_SCANS),
        Corruption::FutureScan => header.first_scan = header.first_scan.saturating_add(WRONG_SCANS),
        Corruption::NeverVisible => header.visible_from = u64::MAX,
        Corruption::WrongIncarnation => {
            header.id.incarnation = header.id.incarnation.wrapping_add(1);
        }
        Corruption::SetpointJump => {
            let setpoint = window
                .setpoints
                .get_mut(header.intended_setpoints as usize / 2);
            if let Some(position) = setpoint.and_then(|setpoint| setpoint.position.first_mut()) {
                *position = position.saturating_add(ROW_JUMP_INCREMENTS);
            }
        }
        Corruption::Checksum => {
            header.id.checksum ^= 1;
            return;
        }
        Corruption::Cut => {
            window.setpoints.truncate(window.setpoints.len() / 2);
            return;
        }
        Corruption::Replay | Corruption::Jump | Corruption::WrongAxis => return,
    }
    window.seal();
}

fn wrong_value(what: Corruption) -> f64 {
    if what == Corruption::Infinity {
        f64::INFINITY
    } else {
        f64::NAN
    }
}

#[cfg(test)]
mod tests;
