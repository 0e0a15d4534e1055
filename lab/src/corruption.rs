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

use bus::sample::{AxisCommand, Job, MAX_WINDOW_ROWS, WindowHeader, WindowRow};
use bus::window::checksum;
use plant_sim::script::faults::{Action, Corruption, FaultScript, LATE_SCANS_MAX};
use plant_sim::script::reach::{is_of, meets};

/// How far off a wrong position of a command is, in increments.
const JUMP_INCREMENTS: i64 = 1_000_000_000;
/// How far off a wrong row is, in increments.
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
    rows: Vec<WindowRow>,
}

impl Window {
    /// None yet, with room for this many rows.
    fn with_room(rows: usize) -> Window {
        Window {
            header: WindowHeader::zeroed(),
            rows: Vec::with_capacity(rows),
        }
    }

    /// Keeps what there is room for.
    fn set(&mut self, header: &WindowHeader, rows: &[WindowRow]) {
        self.header = *header;
        self.rows.clear();
        let room = self.rows.capacity();
        self.rows
            .extend_from_slice(rows.get(..room).unwrap_or(rows));
    }

    fn seal(&mut self) {
        self.header.id.checksum = checksum(&self.header, &self.rows);
    }
}

impl Corruptor {
    /// What the script does to the samples of this sender; nothing is allocated after this.
    pub fn new(script: &FaultScript, job: Job, axis: u32, role: u32) -> Corruptor {
        let own = script.faults.iter().enumerate();
        let faults: Vec<(usize, Action)> = own
            .filter(|(_, fault)| is_of(fault, job, axis, role))
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
        let planner = job == Job::Planner;
        let places = |needed: bool| 0..if needed { LATE_SCANS_MAX } else { 0 };
        let window = |needed: bool| Window::with_room(if needed { MAX_WINDOW_ROWS } else { 0 });
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
        planned: Option<(&WindowHeader, &[WindowRow])>,
        fired: impl Fn(usize) -> Option<u64>,
        mut send: impl FnMut(&WindowHeader, &[WindowRow]),
    ) {
        if self.faults.is_empty() {
            if let Some((header, rows)) = planned {
                send(header, rows);
            }
            return;
        }
        while let Some(late) = Late::take_due(&mut self.late_windows, scan) {
            let right = late.header.id.checksum == checksum(&late.header, &late.rows);
            late.header.visible_from = scan.saturating_add(1);
            if right {
                late.seal();
            }
            send(&late.header, &late.rows);
        }
        let Some((header, rows)) = planned else {
            return;
        };
        self.sent.set(header, rows);
        let (mut dropped, mut due) = (false, None);
        for action in active(&self.faults, scan, &fired) {
            match action {
                Action::Corrupt {
                    what: Corruption::Replay,
                    ..
                } => {
                    let before = &self.window_before;
                    dropped |= before.header.id.is_none();
                    self.sent.set(&before.header, &before.rows);
                }
                Action::Corrupt { what, .. } => corrupt_window(&mut self.sent, what),
                Action::Delay { late_scans, .. } => due = due.max(scan.checked_add(late_scans)),
                _ => dropped = true,
            }
        }
        if self.replays {
            self.window_before.set(header, rows);
        }
        let sent = &self.sent;
        match due {
            _ if dropped => {}
            None => send(&sent.header, &sent.rows),
            Some(due) => {
                if let Some(place) = Late::place(&mut self.late_windows, due) {
                    place.set(&sent.header, &sent.rows);
                }
            }
        }
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
        Corruption::WrongAxis => command.axis = command.axis.wrapping_add(1),
        Corruption::WrongIncarnation => command.incarnation = command.incarnation.wrapping_add(1),
        Corruption::Replay | Corruption::Checksum | Corruption::RowJump | Corruption::Cut => {}
    }
}

/// What is not for windows the script refuses.
fn corrupt_window(window: &mut Window, what: Corruption) {
    let header = &mut window.header;
    match what {
        Corruption::NotANumber | Corruption::Infinity => {
            if let Some(row) = window.rows.first_mut() {
                row.tag.distance_mm = wrong_value(what);
            }
        }
        Corruption::OldScan => header.first_scan = header.first_scan.saturating_sub(WRONG_SCANS),
        Corruption::FutureScan => header.first_scan = header.first_scan.saturating_add(WRONG_SCANS),
        Corruption::WrongIncarnation => {
            header.id.incarnation = header.id.incarnation.wrapping_add(1);
        }
        Corruption::RowJump => {
            let row = window.rows.get_mut(header.intended_rows as usize / 2);
            if let Some(position) = row.and_then(|row| row.position.first_mut()) {
                *position = position.saturating_add(ROW_JUMP_INCREMENTS);
            }
        }
        Corruption::Checksum => {
            header.id.checksum ^= 1;
            return;
        }
        Corruption::Cut => {
            window.rows.truncate(window.rows.len() / 2);
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
#[allow(clippy::expect_used)]
mod tests {
    use super::*;
    use plant_sim::script::faults::{Fault, RestartOverrides, Trigger};
    use plant_sim::script::reach::excuses;

    fn script(job: Job, actions: &[Action]) -> FaultScript {
        let fault = |action: &Action| Fault {
            at: Trigger::Scan(0),
            job,
            axis: u32::from(job == Job::Servo),
            role: 0,
            action: *action,
            line: 1,
        };
        FaultScript {
            name: "faults.toml".into(),
            restart: RestartOverrides::default(),
            faults: actions.iter().map(fault).collect(),
        }
    }

    fn corrupt(what: Corruption) -> Action {
        Action::Corrupt { scans: 2, what }
    }

    fn command(scan: u64) -> AxisCommand {
        AxisCommand {
            scan,
            visible_from: scan + 1,
            position: 100 * scan as i64,
            velocity_mm_s: 2.5,
            torque_nm: 0.5,
            axis: 1,
            incarnation: 3,
            ..AxisCommand::zeroed()
        }
    }

    /// What is sent in scans 8 to 15, each by the scan it is sent in, if every fault fires in scan 10.
    fn commands(actions: &[Action]) -> Vec<(u64, AxisCommand)> {
        let script = script(Job::Servo, actions);
        let mut tamper = Corruptor::new(&script, Job::Servo, 1, 0);
        let mut sent = Vec::new();
        for scan in 8..16 {
            let fired = |_| (scan >= 10).then_some(10);
            tamper.command(&command(scan), fired, |c| sent.push((scan, *c)));
        }
        sent
    }

    fn as_made() -> Vec<(u64, AxisCommand)> {
        (8..16).map(|scan| (scan, command(scan))).collect()
    }

    #[test]
    fn without_faults_of_its_own_a_sender_sends_what_it_made() {
        assert_eq!(commands(&[]), as_made());
        let kill = Action::Kill {
            restart_after_scans: 3,
        };
        assert_eq!(commands(&[kill, Action::Stop { scans: 9 }]), as_made());
        let of_another = script(Job::Servo, &[Action::Drop { scans: 100 }]);
        for (job, axis, role) in [
            (Job::Servo, 0, 0),
            (Job::Servo, 1, 1),
            (Job::Planner, 0, 0),
            (Job::Planner, 1, 0),
        ] {
            let mut tamper = Corruptor::new(&of_another, job, axis, role);
            let mut sent = 0;
            tamper.command(&command(10), |_| Some(10), |_| sent += 1);
            assert_eq!(sent, 1, "{job:?} {axis} {role}");
        }
        // A fault that has not fired does nothing.
        let mut tamper = Corruptor::new(&of_another, Job::Servo, 1, 0);
        let mut sent = 0;
        tamper.command(&command(10), |_| None, |_| sent += 1);
        assert_eq!(sent, 1);
    }

    #[test]
    fn dropped_commands_are_not_sent_for_as_many_scans_as_asked() {
        let mut left = as_made();
        left.retain(|(scan, _)| !(10..13).contains(scan));
        assert_eq!(commands(&[Action::Drop { scans: 3 }]), left);
    }

    #[test]
    fn late_commands_keep_their_scan_and_come_before_the_one_of_the_scan_they_are_sent_in() {
        let delay = Action::Delay {
            scans: 3,
            late_scans: 2,
        };
        let found: Vec<_> = commands(&[delay])
            .iter()
            .map(|(at, c)| (*at, c.scan, c.visible_from))
            .collect();
        let expected = [
            (8, 8, 9),
            (9, 9, 10),
            (12, 10, 13),
            (13, 11, 14),
            (13, 13, 14),
            (14, 12, 15),
            (14, 14, 15),
            (15, 15, 16),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn the_longest_delay_loses_nothing_and_a_sleeper_sends_all_that_is_due() {
        let delay = Action::Delay {
            scans: 1000,
            late_scans: LATE_SCANS_MAX,
        };
        let script = script(Job::Servo, &[delay]);
        let mut tamper = Corruptor::new(&script, Job::Servo, 1, 0);
        let mut sent = Vec::new();
        for scan in 0..40 {
            tamper.command(&command(scan), |_| Some(0), |c| sent.push((scan, c.scan)));
        }
        let late: Vec<_> = (0..32).map(|scan| (scan + 8, scan)).collect();
        assert_eq!(sent, late);
        sent.clear();
        tamper.command(&command(100), |_| Some(0), |c| sent.push((100, c.scan)));
        let rest: Vec<_> = (32..40).map(|scan| (100, scan)).collect();
        assert_eq!(sent, rest);
    }

    #[test]
    fn a_corruption_changes_what_it_names_and_nothing_else() {
        for (what, change) in [
            (
                Corruption::Infinity,
                (|c| {
                    c.velocity_mm_s = f64::INFINITY;
                    c.torque_nm = f64::INFINITY;
                }) as fn(&mut AxisCommand),
            ),
            (Corruption::Jump, |c| {
                c.position += 1_000_000_000;
                c.velocity_mm_s = 2500.0;
            }),
            (Corruption::OldScan, |c| c.scan -= 3),
            (Corruption::FutureScan, |c| c.scan += 3),
            (Corruption::WrongAxis, |c| c.axis = 2),
            (Corruption::WrongIncarnation, |c| c.incarnation = 4),
            (Corruption::Replay, |c| *c = command(c.scan - 1)),
        ] {
            let mut expected = as_made();
            for (scan, command) in &mut expected {
                if (10..12).contains(scan) {
                    change(command);
                }
            }
            assert_eq!(commands(&[corrupt(what)]), expected, "{what:?}");
        }
        for (scan, command) in commands(&[corrupt(Corruption::NotANumber)]) {
            let met = (10..12).contains(&scan);
            assert_eq!(command.velocity_mm_s.is_nan(), met);
            assert_eq!(command.torque_nm.is_nan(), met);
            assert_eq!(command.scan, scan);
        }
    }

    #[test]
    fn the_first_command_of_all_has_none_before_it_to_be_replayed() {
        let script = script(Job::Servo, &[corrupt(Corruption::Replay)]);
        let mut tamper = Corruptor::new(&script, Job::Servo, 1, 0);
        let mut sent = Vec::new();
        for scan in [10, 11] {
            tamper.command(&command(scan), |_| Some(10), |c| sent.push(c.scan));
        }
        assert_eq!(sent, [10]);
    }

    #[test]
    fn lockstep_is_excused_from_waiting_where_no_answer_that_counts_can_come() {
        let late = Action::Delay {
            scans: 2,
            late_scans: 1,
        };
        for (action, excused) in [
            (Action::Drop { scans: 2 }, true),
            (late, true),
            (corrupt(Corruption::OldScan), true),
            (corrupt(Corruption::WrongIncarnation), true),
            (corrupt(Corruption::Replay), true),
            (corrupt(Corruption::WrongAxis), true),
            (corrupt(Corruption::NotANumber), false),
            (corrupt(Corruption::Infinity), false),
            (corrupt(Corruption::Jump), false),
            (corrupt(Corruption::FutureScan), false),
            (Action::Stop { scans: 2 }, false),
        ] {
            let script = script(Job::Servo, &[action]);
            let of = |job, axis, role, scan| excuses(&script, |_| Some(10), job, axis, role, scan);
            for scan in 8..14 {
                let met = excused && (10..12).contains(&scan);
                assert_eq!(of(Job::Servo, 1, 0, scan), met, "{action:?} {scan}");
            }
            assert!(!of(Job::Servo, 1, 1, 10), "the other role");
            assert!(!of(Job::Servo, 0, 0, 10), "another axis");
            assert!(!excuses(&script, |_| None, Job::Servo, 1, 0, 10));
            // Where lockstep is not excused, what is sent is taken for an answer to this scan.
            if !matches!(action, Action::Stop { .. }) {
                let sent = commands(&[action]);
                let answer = |(at, c): &&(u64, AxisCommand)| {
                    *at == 10 && c.scan >= 10 && c.incarnation == 3 && c.axis == 1
                };
                assert_eq!(sent.iter().find(answer).is_none(), excused, "{action:?}");
            }
        }
        let script = script(Job::Planner, &[Action::Drop { scans: 2 }]);
        assert!(!excuses(&script, |_| Some(10), Job::Planner, 0, 0, 10));
    }

    fn window(scan: u64) -> (WindowHeader, Vec<WindowRow>) {
        let row = |n: i64| {
            let mut row = WindowRow::zeroed();
            row.position = [n; bus::sample::MAX_AXES];
            row
        };
        let rows: Vec<WindowRow> = (0..10).map(|n| row(n + scan as i64)).collect();
        let mut header = WindowHeader {
            first_scan: scan + 8,
            visible_from: scan + 1,
            intended_rows: 6,
            row_count: 10,
            ..WindowHeader::zeroed()
        };
        header.id.sequence = scan as u32 / 8;
        header.id.incarnation = 3;
        header.id.checksum = checksum(&header, &rows);
        (header, rows)
    }

    type Sent = (u64, WindowHeader, Vec<WindowRow>);

    /// What is sent at the period boundaries 8, 16, 24, 32 and 40 if every fault fires in scan 16; none is planned in 32.
    fn windows(actions: &[Action]) -> Vec<Sent> {
        let script = script(Job::Planner, actions);
        let mut tamper = Corruptor::new(&script, Job::Planner, 0, 0);
        let mut sent = Vec::new();
        for scan in [8, 16, 24, 32, 40] {
            let (header, rows) = window(scan);
            let planned = (scan != 32).then_some((&header, rows.as_slice()));
            let fired = |_| (scan >= 16).then_some(16);
            tamper.window(scan, planned, fired, |header, rows| {
                sent.push((scan, *header, rows.to_vec()));
            });
        }
        sent
    }

    fn as_planned() -> Vec<Sent> {
        [8, 16, 24, 40]
            .map(|scan| {
                let (header, rows) = window(scan);
                (scan, header, rows)
            })
            .into()
    }

    fn is_sealed((_, header, rows): &Sent) -> bool {
        header.id.checksum == checksum(header, rows)
    }

    #[test]
    fn windows_are_dropped_or_sent_late_under_their_right_name() {
        assert_eq!(windows(&[]), as_planned());
        let mut left = as_planned();
        left.retain(|(scan, ..)| ![16, 24].contains(scan));
        assert_eq!(windows(&[Action::Drop { scans: 9 }]), left);

        let delay = Action::Delay {
            scans: 9,
            late_scans: 3,
        };
        let sent = windows(&[delay]);
        let found: Vec<_> = sent
            .iter()
            .map(|(at, h, _)| (*at, h.first_scan, h.visible_from, h.id.sequence))
            .collect();
        // The one of 24 is due in 27 and sent when the planner next wakes, though it has nothing new then.
        let expected = [
            (8, 16, 9, 1),
            (24, 24, 25, 2),
            (32, 32, 33, 3),
            (40, 48, 41, 5),
        ];
        assert_eq!(found, expected);
        assert!(sent.iter().all(is_sealed));
    }

    #[test]
    fn a_wrong_window_is_found_out_by_what_is_wrong_with_it_and_not_by_its_checksum() {
        for (what, sealed, change) in [
            (
                Corruption::Infinity,
                true,
                (|h, rows| {
                    let _ = h;
                    if let Some(row) = rows.first_mut() {
                        row.tag.distance_mm = f64::INFINITY;
                    }
                }) as fn(&mut WindowHeader, &mut Vec<WindowRow>),
            ),
            (Corruption::OldScan, true, |h, _| h.first_scan -= 3),
            (Corruption::FutureScan, true, |h, _| h.first_scan += 3),
            (Corruption::WrongIncarnation, true, |h, _| {
                h.id.incarnation = 4
            }),
            (Corruption::RowJump, true, |_, rows| {
                if let Some(row) = rows.get_mut(3) {
                    row.position[0] += 1_000_000;
                }
            }),
            (Corruption::Checksum, false, |h, _| h.id.checksum ^= 1),
            (Corruption::Cut, false, |_, rows| rows.truncate(5)),
        ] {
            let mut expected = as_planned();
            let met = expected.iter_mut().filter(|(scan, ..)| *scan == 16);
            for (_, header, rows) in met {
                change(header, rows);
                if sealed {
                    header.id.checksum = checksum(header, rows);
                }
            }
            let found = windows(&[corrupt(what)]);
            assert_eq!(found, expected, "{what:?}");
            assert_eq!(found.iter().all(is_sealed), sealed, "{what:?}");
        }
        let sent = windows(&[corrupt(Corruption::NotANumber)]);
        let nan = |(scan, _, rows): &Sent| {
            let first = rows.first().expect("a row");
            (*scan, first.tag.distance_mm.is_nan())
        };
        let found: Vec<_> = sent.iter().map(nan).collect();
        assert_eq!(found, [(8, false), (16, true), (24, false), (40, false)]);
        assert!(sent.iter().all(is_sealed));
    }

    #[test]
    fn a_replayed_window_is_the_one_before_as_it_was() {
        let sent = windows(&[corrupt(Corruption::Replay)]);
        let (header, rows) = window(8);
        let mut expected = as_planned();
        if let Some(second) = expected.get_mut(1) {
            *second = (16, header, rows);
        }
        assert_eq!(sent, expected);
    }

    #[test]
    fn the_longest_window_is_kept_whole_and_a_longer_one_breaks_nothing() {
        let delay = Action::Delay {
            scans: 1,
            late_scans: 1,
        };
        let script = script(Job::Planner, &[delay]);
        let mut tamper = Corruptor::new(&script, Job::Planner, 0, 0);
        for rows in [MAX_WINDOW_ROWS, MAX_WINDOW_ROWS + 1] {
            let rows = vec![WindowRow::zeroed(); rows];
            let header = WindowHeader::zeroed();
            let mut sent = 0;
            for scan in [0, 8] {
                let planned = (scan == 0).then_some((&header, rows.as_slice()));
                tamper.window(scan, planned, |_| Some(0), |_, rows| sent = rows.len());
            }
            assert_eq!(sent, MAX_WINDOW_ROWS);
        }
    }
}
