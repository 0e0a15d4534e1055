//! The signal page: one page of futex words that belongs to the cell.
//!
//! iceoryx2 carries the data; waking is done here, because its events can lose wake-ups. A signal is only a hint: whoever
//! waits looks at its ports after every wake and after every timeout, so a lost ring costs time, never progress.

use std::time::Duration;

use rustix::thread::futex;

use crate::cell::{CellError, CellPaths};
use crate::mapped_page::{self, MappedPage};
use crate::sample::{MAX_PARTICIPANTS, OperatorRequest, OperatorResponse, Order};

use atomic::{AtomicU32, AtomicU64, Ordering};
use words::{Outstanding, Requests, Rings, Saved, Urgent};

mod atomic {
    pub use std::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
}
mod words;

const MAGIC: u64 = u64::from_le_bytes(*b"QUADRAN8");
/// Most faults a script of one run can have.
pub const FAULTS_MAX: usize = 1024;
/// Bytes kept for one saved state of the master.
pub const MACHINE_STATE_BYTES: usize = 32768;

/// What the cell is doing, as the launcher sees it. The words are far apart: no slip of a foreign process makes one of another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum CellPhase {
    /// Processes are being started.
    Starting = u32::from_le_bytes(*b"Strt"),
    /// Scans run.
    Running = u32::from_le_bytes(*b"Runs"),
    /// Everybody is to leave at once.
    Ending = u32::from_le_bytes(*b"Ends"),
}

impl CellPhase {
    /// A word that is none of them ends nothing.
    fn from_word(word: u32) -> CellPhase {
        [CellPhase::Starting, CellPhase::Ending]
            .into_iter()
            .find(|phase| *phase as u32 == word)
            .unwrap_or(CellPhase::Running)
    }
}

wire_enum! {
    /// What the master asks of the launcher to carry out a fault.
    pub enum FaultStep {
        /// Kill the process and reap it.
        Kill = 1,
        /// Start its replacement, so that it is ready.
        Restart = 2,
        /// Stop the process (it lives and does nothing).
        Stop = 3,
        /// Say in the roster that the process takes part again.
        Readmit = 4,
        /// Continue the stopped process.
        Continue = 5,
    }
}

/// A request of the master that the launcher has not answered yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultRequest {
    /// Counted from 1; names the request in the answer.
    pub ticket: u64,
    /// Index of the fault in the script.
    pub index: usize,
    /// What is to be done.
    pub step: FaultStep,
    /// The scan it is for.
    pub scan: u64,
}

/// A futex word that some process waits at.
#[repr(transparent)]
#[derive(Debug, Default)]
pub struct Signal(Rings);

impl Signal {
    /// The count of rings; take it before looking at the ports, then wait for it to change.
    pub fn count(&self) -> u32 {
        self.0.count.load(Ordering::Acquire)
    }

    /// Wakes everybody who waits here.
    pub fn raise(&self) {
        if self.0.raise() {
            let _ = futex::wake(&self.0.count, futex::Flags::empty(), i32::MAX as u32);
        }
    }

    /// Waits asleep until the count is no longer `seen`, at most `limit`; may return early.
    pub fn wait(&self, seen: u32, limit: Duration) {
        let limit = futex::Timespec {
            tv_sec: limit.as_secs() as i64,
            tv_nsec: i64::from(limit.subsec_nanos()),
        };
        self.0.sleep();
        let _ = futex::wait(&self.0.count, futex::Flags::empty(), seen, Some(&limit));
        self.0.rise();
    }
}

// SAFETY: atomics only, valid for any bytes.
unsafe impl mapped_page::Layout for Layout {}

#[repr(C)]
struct Layout {
    magic: AtomicU64,
    launcher_pid: AtomicU32,
    phase: AtomicU32,
    answers: Outstanding,
    scan: Signal,
    planner: Signal,
    machine: Signal,
    monitor: Signal,
    launcher: Signal,
    recorded: Recorded,
    urgent: [Urgent<ANSWER_WORDS, ANSWERS_KEPT>; URGENT.len()],
    requests: Requests,
    places: [PlaceWords; MAX_PARTICIPANTS],
    saved: Saved<{ MACHINE_STATE_BYTES / 8 }>,
    /// Per fault of the script: 0 until it fires, then its scan + 1.
    fired: [AtomicU64; FAULTS_MAX],
}

#[repr(C, align(64))]
struct Recorded {
    scans: AtomicU64,
}

/// Orders that must always come through.
const URGENT: [Order; 5] = [
    Order::Stop,
    Order::Hold,
    Order::Down,
    Order::EmergencyStop,
    Order::Disable,
];
const ANSWER_WORDS: usize = size_of::<OperatorResponse>() / 8;
/// Answers to orders of one kind that are kept for who looks late.
const ANSWERS_KEPT: usize = 4;

/// A line of its own for each: it is written in every scan.
#[repr(C, align(64))]
struct PlaceWords {
    ready_incarnation: AtomicU32,
    /// The last scan it was done with, + 1; 0 before the first.
    answered_scan: AtomicU64,
}

/// The mapped page.
#[derive(Debug)]
pub struct SignalPage {
    layout: MappedPage<Layout>,
}

impl SignalPage {
    /// Makes the cell's page; for the launcher, after it owns the cell.
    ///
    /// # Errors
    /// [`CellError::System`].
    pub fn create(place: &CellPaths) -> Result<SignalPage, CellError> {
        let page = Self::map(place, true)?;
        let (pid, phase) = (std::process::id(), CellPhase::Starting as u32);
        page.layout.launcher_pid.store(pid, Ordering::Release);
        page.layout.phase.store(phase, Ordering::Release);
        page.layout.magic.store(MAGIC, Ordering::Release);
        Ok(page)
    }

    /// Maps the page of a running cell.
    ///
    /// # Errors
    /// [`CellError::System`] if there is none, or none of this version.
    pub fn open(place: &CellPaths) -> Result<SignalPage, CellError> {
        let page = Self::map(place, false)?;
        if page.layout.magic.load(Ordering::Acquire) != MAGIC {
            return Err(CellError::Transport {
                cell: place.name().into(),
                what: "its page is not of this version of quadrant".into(),
            });
        }
        Ok(page)
    }

    fn map(place: &CellPaths, create: bool) -> Result<SignalPage, CellError> {
        let layout = MappedPage::map(place, &place.page(), create)?;
        Ok(SignalPage { layout })
    }

    fn urgent(&self, order: Order) -> Option<&Urgent<ANSWER_WORDS, ANSWERS_KEPT>> {
        let index = URGENT.iter().position(|urgent| *urgent == order)?;
        self.layout.urgent.get(index)
    }

    /// Gives an order that must always come through: stop, hold, down, emergency stop, drives off. Its number, for
    /// [`SignalPage::urgent_answer`]; none for any other order.
    pub fn order_urgently(&self, order: Order) -> Option<u32> {
        let number = self.urgent(order)?.ask();
        self.master_signal().raise();
        Some(number)
    }

    /// The answer to an order of that number, once it is there.
    pub fn urgent_answer(&self, order: Order, number: u32) -> Option<OperatorResponse> {
        self.urgent(order)?.answer(number).map(bytemuck::cast)
    }

    /// Judges the urgent orders that are there; for the master. One that dies between judging and answering leaves the order to
    /// the next: each of them may be given twice.
    pub fn serve_urgent(&self, mut judge: impl FnMut(&OperatorRequest) -> OperatorResponse) {
        for (order, words) in URGENT.iter().zip(&self.layout.urgent) {
            words.serve(|| {
                bytemuck::cast(judge(&OperatorRequest {
                    order: *order as u32,
                    ..OperatorRequest::default()
                }))
            });
        }
    }

    /// Process id of the launcher that made the page.
    pub fn launcher_pid(&self) -> u32 {
        self.layout.launcher_pid.load(Ordering::Acquire)
    }

    /// Rung by the master at the start of each scan; servos wait here.
    pub fn scan_signal(&self) -> &Signal {
        &self.layout.scan
    }

    /// Rung at each interpolation period boundary; the planner waits here.
    pub fn planner_signal(&self) -> &Signal {
        &self.layout.planner
    }

    /// Rung when the last outstanding answer is there; the master waits here.
    pub fn master_signal(&self) -> &Signal {
        &self.layout.machine
    }

    /// Rung now and then while there is something to record; the monitor waits here.
    pub fn recorder_signal(&self) -> &Signal {
        &self.layout.monitor
    }

    /// Rung when something happened that the launcher waits for.
    pub fn launcher_signal(&self) -> &Signal {
        &self.layout.launcher
    }

    /// What the cell is doing.
    pub fn phase(&self) -> CellPhase {
        CellPhase::from_word(self.layout.phase.load(Ordering::Acquire))
    }

    /// Sets it and wakes everybody; for the launcher.
    pub fn set_phase(&self, phase: CellPhase) {
        self.layout.phase.store(phase as u32, Ordering::Release);
        self.raise_all();
    }

    /// Wakes everybody of the cell.
    pub fn raise_all(&self) {
        let layout = &self.layout;
        for signal in [
            &layout.scan,
            &layout.planner,
            &layout.machine,
            &layout.monitor,
            &layout.launcher,
        ] {
            signal.raise();
        }
    }

    /// Says how many answers this scan waits for: the last to answer rings. For the master.
    pub fn expect_answers(&self, count: u32) {
        self.layout.answers.expect(count);
    }

    /// From now on in this scan every answer rings: someone died or came back and the count no longer holds.
    pub fn expect_eagerly(&self) {
        self.layout.answers.expect_eagerly();
    }

    /// Says that this process has answered the scan.
    pub fn answered(&self) {
        if self.layout.answers.answered() {
            self.layout.machine.raise();
        }
    }

    /// Scans the recorder has taken from its queue: its credit with the master in lockstep.
    pub fn recorded_scans(&self) -> u64 {
        self.layout.recorded.scans.load(Ordering::Acquire)
    }

    /// Says how many scans have been recorded; for the recorder.
    pub fn set_recorded_scans(&self, scans: u64) {
        self.layout.recorded.scans.store(scans, Ordering::Release);
    }

    /// Says that the process in this place of the roster is ready to take part.
    pub fn set_ready(&self, place: usize, incarnation: u32) {
        if let Some(words) = self.layout.places.get(place) {
            words
                .ready_incarnation
                .store(incarnation, Ordering::Release);
        }
        self.layout.launcher.raise();
    }

    /// The incarnation that last published it was ready in this place.
    pub fn ready_incarnation(&self, place: usize) -> u32 {
        let words = self.layout.places.get(place);
        words.map_or(0, |words| words.ready_incarnation.load(Ordering::Acquire))
    }

    /// Says that the process in this place is done with this scan, whether it has sent an answer that counts or not.
    pub fn set_answered(&self, place: usize, scan: u64) {
        if let Some(words) = self.layout.places.get(place) {
            words
                .answered_scan
                .store(scan.saturating_add(1), Ordering::Release);
        }
    }

    /// The last scan that the process in this place, or one before it there, was done with. What it has sent until then is
    /// there for whoever reads this first. A process whose scan falls behind that of the others hangs.
    pub fn answered_scan(&self, place: usize) -> Option<u64> {
        let words = self.layout.places.get(place)?;
        words.answered_scan.load(Ordering::Acquire).checked_sub(1)
    }

    /// The scan in which the fault of this index in the script fired.
    pub fn fault_fired(&self, index: usize) -> Option<u64> {
        let word = self.layout.fired.get(index)?;
        word.load(Ordering::Acquire).checked_sub(1)
    }

    /// Says that it fires in this scan; for the master, before the feedback of that scan.
    pub fn set_fault_fired(&self, index: usize, scan: u64) {
        if let Some(word) = self.layout.fired.get(index) {
            word.store(scan.saturating_add(1), Ordering::Release);
        }
    }

    /// Asks the launcher for a step of a fault; the ticket to wait for with [`SignalPage::is_done`], at the master's signal.
    /// For the master, one request after the other.
    pub fn ask_launcher(&self, index: usize, step: FaultStep, scan: u64) -> u64 {
        let requests = &self.layout.requests;
        let ticket = requests.ask(index as u32, step as u32, scan);
        self.layout.launcher.raise();
        ticket
    }

    /// What the master asks for and has no answer to; for the launcher.
    pub fn launcher_request(&self) -> Option<FaultRequest> {
        let (ticket, index, step, scan) = self.layout.requests.open()?;
        Some(FaultRequest {
            ticket,
            index: index as usize,
            step: FaultStep::from_wire(step)?,
            scan,
        })
    }

    /// Says that what this ticket asked for is done; for the launcher.
    pub fn launcher_done(&self, ticket: u64) {
        self.layout.requests.answer(ticket);
        self.layout.machine.raise();
    }

    /// Whether the launcher has done what this ticket asked for.
    pub fn is_done(&self, ticket: u64) -> bool {
        self.layout.requests.is_done(ticket)
    }

    /// Saves the master's mechanical state into the older of two slots, so that a kill in the middle of it leaves
    /// the other one whole. Bytes beyond [`MACHINE_STATE_BYTES`] are not kept: the caller's state must fit.
    pub fn save_machine_state(&self, bytes: &[u8]) {
        self.layout.saved.save(bytes.chunks(8).map(|chunk| {
            let mut value = [0; 8];
            for (to, from) in value.iter_mut().zip(chunk) {
                *to = *from;
            }
            u64::from_le_bytes(value)
        }));
    }

    /// The last whole state that was saved, if any: `bytes` is filled from its start.
    pub fn load_machine_state(&self, bytes: &mut [u8]) -> bool {
        let Some(words) = self.layout.saved.load() else {
            return false;
        };
        for (chunk, word) in bytes.chunks_mut(8).zip(words) {
            for (to, from) in chunk.iter_mut().zip(word.to_le_bytes()) {
                *to = from;
            }
        }
        true
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;

    /// A page of its own, seen by the one who made it and by a member.
    fn with_page(test: &str, look: impl Fn(&SignalPage, &SignalPage)) {
        let name = format!("p{}-{test}", std::process::id());
        let place = CellPaths::new(&name).expect("a name");
        let owner = place.own(Duration::ZERO).expect("the cell");
        let page = SignalPage::create(&place).expect("the page");
        look(&page, &SignalPage::open(&place).expect("the page"));
        drop(owner);
    }

    #[test]
    fn a_fault_that_fired_is_seen_with_its_scan_by_every_process() {
        with_page("fired", |launcher, member| {
            for index in [0, 7, FAULTS_MAX - 1] {
                assert_eq!(member.fault_fired(index), None);
                launcher.set_fault_fired(index, index as u64);
                assert_eq!(member.fault_fired(index), Some(index as u64));
            }
            assert_eq!(member.fault_fired(1), None);
            // Beyond the most a script can have: nothing, rather than another's word.
            launcher.set_fault_fired(FAULTS_MAX, 3);
            assert_eq!(member.fault_fired(FAULTS_MAX), None);
        });
    }

    #[test]
    fn the_launcher_finds_each_request_once_and_its_answer_wakes_the_master() {
        with_page("ask", |launcher, machine| {
            assert_eq!(launcher.launcher_request(), None);
            let steps = [
                FaultStep::Kill,
                FaultStep::Restart,
                FaultStep::Stop,
                FaultStep::Readmit,
                FaultStep::Continue,
            ];
            for (index, step) in steps.into_iter().enumerate() {
                let rung = launcher.launcher_signal().count();
                let ticket = machine.ask_launcher(index, step, 900 + index as u64);
                assert_ne!(launcher.launcher_signal().count(), rung);
                assert!(!machine.is_done(ticket));
                let asked = FaultRequest {
                    ticket,
                    index,
                    step,
                    scan: 900 + index as u64,
                };
                assert_eq!(launcher.launcher_request(), Some(asked));
                let rung = machine.master_signal().count();
                launcher.launcher_done(ticket);
                assert_ne!(machine.master_signal().count(), rung);
                assert!(machine.is_done(ticket));
                assert_eq!(launcher.launcher_request(), None);
            }
        });
    }

    #[test]
    fn an_answer_to_an_earlier_request_does_not_answer_a_later_one() {
        with_page("late", |launcher, machine| {
            let first = machine.ask_launcher(1, FaultStep::Kill, 5);
            // The master died and its replacement asks again.
            let second = machine.ask_launcher(2, FaultStep::Stop, 6);
            launcher.launcher_done(first);
            assert!(!machine.is_done(second));
            let open = launcher.launcher_request().map(|r| (r.ticket, r.index));
            assert_eq!(open, Some((second, 2)));
        });
    }

    #[test]
    fn how_far_each_place_is_stands_in_the_page() {
        with_page("answered", |launcher, member| {
            assert_eq!(launcher.answered_scan(3), None);
            member.set_answered(3, 0);
            assert_eq!(launcher.answered_scan(3), Some(0));
            member.set_answered(3, 41);
            assert_eq!(launcher.answered_scan(3), Some(41));
            assert_eq!(launcher.answered_scan(2), None);
            member.set_answered(MAX_PARTICIPANTS, 1);
            assert_eq!(launcher.answered_scan(MAX_PARTICIPANTS), None);
        });
    }
}
