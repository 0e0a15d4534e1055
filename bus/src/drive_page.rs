//! The drive page: what a master and the process that owns the fieldbus hand each other in every scan.
//!
//! Outputs and inputs are numbered by cycles. The master writes the outputs of a cycle, then asks for it; the fieldbus process notes a
//! frame before it is sent, and answers with inputs. Each lies in the slot of its cycle's parity, so that whoever is killed while
//! writing leaves the cycle before whole. A standby of the fieldbus process reads here how far the one before it came.

use std::marker::PhantomData;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
use std::time::Duration;

use bytemuck::{Pod, Zeroable};

use crate::cell::{CellError, CellPaths};
use crate::mapped_page::{self, MappedPage};
use crate::robust_lock::RobustLock;
use crate::signal_page::Signal;

const MAGIC: u64 = u64::from_le_bytes(*b"QUADDRV3");

/// Most slaves on a segment.
pub const SLAVES_MAX: usize = 16;
/// So often an observer tries to read a cycle that was not overwritten meanwhile.
const LOOKS_MAX: u32 = 16;
/// Most bytes of process data of a segment: what one Ethernet frame carries beside the other datagrams of a cycle.
pub const IMAGE_BYTES_MAX: usize = 1024;

/// Where the process data of a slave lie in the image of its segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SlaveWiring {
    /// Configured station address.
    pub address: u16,
    /// Where its outputs begin, in bytes.
    pub outputs_at: u16,
    /// Size of its outputs, in bytes.
    pub output_bytes: u16,
    /// Where its inputs begin, in bytes.
    pub inputs_at: u16,
    /// Size of its inputs, in bytes.
    pub input_bytes: u16,
    /// What it adds to the working counter of a logical read and write: 2 with outputs, 1 with inputs.
    pub working_counter: u16,
    /// Its serial number; 0 of one that has none.
    pub serial: u32,
    /// 1 if it had lost its power, or was reset, since somebody started it up before.
    pub restarted: u32,
}

/// How a segment is wired: found at start-up, the same until the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Wiring {
    /// Tells the frames of this start-up from those of others.
    pub nonce: u64,
    /// Size of the image, in bytes.
    pub image_bytes: u32,
    /// How many slaves there are.
    pub slave_count: u32,
    /// Working counter of a cycle that everybody took part in.
    pub working_counter: u32,
    /// Station address of the reference clock; 0 without distributed clocks.
    pub reference_clock: u32,
    /// The slaves, in the order of the cable.
    pub slaves: [SlaveWiring; SLAVES_MAX],
}

impl Wiring {
    /// The slaves that there are.
    pub fn slaves(&self) -> &[SlaveWiring] {
        self.slaves
            .get(..self.slave_count as usize)
            .unwrap_or(&self.slaves)
    }
}

/// What goes to the drives in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Outputs {
    /// The image of the segment; where inputs lie it is 0.
    pub image: [u8; IMAGE_BYTES_MAX],
    /// The image that is sent when no other has come for too long: everybody stops.
    pub silent: [u8; IMAGE_BYTES_MAX],
}

/// What a slave said of itself in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SlaveState {
    /// 1 if it answered.
    pub answered: u16,
    /// Its AL status.
    pub al_status: u16,
    /// Its AL status code.
    pub al_status_code: u16,
}

/// What was counted since the start-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Counts {
    /// Cycles that were sent.
    pub sent: u64,
    /// Cycles without an answer in time.
    pub missed: u64,
    /// Cycles that somebody took no part in.
    pub short: u64,
    /// Frames of an earlier cycle, or a second time.
    pub late: u64,
    /// Frames of others, and damaged ones.
    pub foreign: u64,
    /// Cycles in which the master had nothing new.
    pub repeated: u64,
    /// Frames whose time at the reference clock is known.
    pub clocked: u64,
    /// Sum of their distances from the middle between two SYNC0, in ns.
    pub clock_off_sum_ns: u64,
    /// Largest distance, in ns.
    pub clock_off_max_ns: u64,
}

impl Counts {
    /// One more frame, so far from the middle between two SYNC0, in ns.
    pub fn clock(&mut self, late_ns: i64) {
        let off_ns = late_ns.unsigned_abs();
        self.clocked += 1;
        self.clock_off_sum_ns = self.clock_off_sum_ns.saturating_add(off_ns);
        self.clock_off_max_ns = self.clock_off_max_ns.max(off_ns);
    }

    /// What came of the frames, in one line.
    pub fn words(&self) -> String {
        let Counts {
            sent, missed, late, ..
        } = self;
        let mut words = format!("of {sent} frames since the start-up {missed} missed, {late} late");
        if let Some(mean_ns) = self.clock_off_sum_ns.checked_div(self.clocked) {
            let us = |ns: u64| ns as f64 / 1e3;
            let (mean_us, most_us) = (us(mean_ns), us(self.clock_off_max_ns));
            words += &format!(
                ", off the middle between two SYNC0 by {mean_us:.1} µs (mean), {most_us:.1} µs (most)"
            );
        }
        words
    }
}

/// What came back in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Inputs {
    /// The image of the segment.
    pub image: [u8; IMAGE_BYTES_MAX],
    /// 1 if the cycle was answered; otherwise nothing here but `counts` is of this cycle.
    pub answered: u32,
    /// Working counter of the process data.
    pub working_counter: u32,
    /// The slaves, in the order of the cable.
    pub slaves: [SlaveState; SLAVES_MAX],
    /// When the frame was sent, on the monotonic clock, in ns.
    pub sent_at_ns: u64,
    /// From sending to the answer, in ns.
    pub round_trip_ns: u64,
    /// How much later than in the middle between two SYNC0 the frame passed the reference clock, in ns; 0 without distributed clocks.
    pub clock_late_ns: i64,
    /// 1 where no answer came and the interface has no link.
    pub no_link: u64,
    /// What was counted.
    pub counts: Counts,
}

wire_enum! {
    /// What the fieldbus process does.
    pub enum BusState {
        /// Nobody owns the bus.
        Free = 0 => "without an owner",
        /// Cycles are exchanged.
        Cycling = 1 => "in operation",
        /// The last start-up failed: another one must be asked for.
        Down = 2 => "down",
        /// Its owner starts it up.
        Starting = 3 => "starting",
    }
    /// In words.
    pub fn words
}

/// Most bytes that are kept of why a start-up failed.
const FAILURE_BYTES_MAX: usize = 512;

/// Plain data that lie in the page as words.
#[repr(C, align(64))]
struct KeptValue<T, const WORDS: usize> {
    words: [AtomicU64; WORDS],
    of: PhantomData<T>,
}

impl<T: Pod, const WORDS: usize> KeptValue<T, WORDS> {
    const FITS: () = assert!(size_of::<T>() == 8 * WORDS);

    fn store(&self, value: &T) {
        let () = Self::FITS;
        let bytes = bytemuck::bytes_of(value).as_chunks::<8>().0;
        for (word, bytes) in self.words.iter().zip(bytes) {
            word.store(u64::from_le_bytes(*bytes), Ordering::Relaxed);
        }
    }

    fn load(&self, value: &mut T) {
        let bytes = bytemuck::bytes_of_mut(value).as_chunks_mut::<8>().0;
        for (word, bytes) in self.words.iter().zip(bytes) {
            *bytes = word.load(Ordering::Relaxed).to_le_bytes();
        }
    }
}

const WIRING_WORDS: usize = size_of::<Wiring>() / 8;
const OUTPUT_WORDS: usize = size_of::<Outputs>() / 8;
const FAILURE_WORDS: usize = FAILURE_BYTES_MAX / 8;
const INPUT_WORDS: usize = size_of::<Inputs>() / 8;

// SAFETY: atomics only, and a lock of the C library that the kernel and it alone touch.
unsafe impl mapped_page::Layout for Layout {}

#[repr(C)]
struct Layout {
    magic: AtomicU64,
    state: AtomicU32,
    ownership: RobustLock,
    asked: Signal,
    answered: Signal,
    /// Cycles, each + 1: 0 before the first.
    requested_cycle: AtomicU64,
    answered_cycle: AtomicU64,
    /// 1 where another start-up is asked for.
    start_again: AtomicU64,
    /// Number of the last frame, noted before it is sent.
    sent_frame: AtomicU64,
    /// 1 once the master has left in order.
    left: AtomicU64,
    /// Slaves that were found restarted, a bit each, until a master has seen a cycle of the start-up after it.
    restarted: AtomicU64,
    wiring: KeptValue<Wiring, WIRING_WORDS>,
    /// Text, zeros behind it.
    failure: KeptValue<[u8; FAILURE_BYTES_MAX], FAILURE_WORDS>,
    outputs: [KeptValue<Outputs, OUTPUT_WORDS>; 2],
    inputs: [KeptValue<Inputs, INPUT_WORDS>; 2],
}

/// The mapped page.
#[derive(Debug)]
pub struct DrivePage {
    layout: MappedPage<Layout>,
}

/// The bus in the hands of the thread that took it, until this is dropped: what has an owner ends with it, however that ends.
#[derive(Debug)]
pub struct OwnedBus<'a> {
    page: &'a DrivePage,
    /// A lock is given back by the thread that has taken it.
    _of_thread: PhantomData<*const ()>,
}

impl Drop for OwnedBus<'_> {
    fn drop(&mut self) {
        self.page.disown();
        self.page.layout.ownership.release();
    }
}

/// The slot of a cycle.
fn slot<T>(slots: &[T; 2], cycle: u64) -> &T {
    let [even, odd] = slots;
    if cycle.is_multiple_of(2) { even } else { odd }
}

impl DrivePage {
    /// Makes the page; for the launcher, after it owns the cell.
    ///
    /// # Errors
    /// [`CellError`].
    pub fn create(place: &CellPaths) -> Result<DrivePage, CellError> {
        let layout = MappedPage::map(place, &place.drive_page(), true)?;
        let page = DrivePage { layout };
        let made = page.layout.ownership.make();
        made.map_err(|source| CellError::System {
            cell: place.name().into(),
            what: "making the lock of its bus".into(),
            source,
        })?;
        page.layout.magic.store(MAGIC, Ordering::Release);
        Ok(page)
    }

    /// Maps the page of a running cell.
    ///
    /// # Errors
    /// [`CellError`]; a cell of simulated drives has none.
    pub fn open(place: &CellPaths) -> Result<DrivePage, CellError> {
        let layout = MappedPage::map(place, &place.drive_page(), false)?;
        let page = DrivePage { layout };
        if page.layout.magic.load(Ordering::Acquire) != MAGIC {
            return Err(CellError::Transport {
                cell: place.name().into(),
                what: "its drive page is not of this version of quadrant".into(),
            });
        }
        Ok(page)
    }

    /// Rung when a cycle is asked for; the fieldbus process waits here.
    pub fn asked_signal(&self) -> &Signal {
        &self.layout.asked
    }

    /// Rung when a cycle is answered, or never will be; the master waits here.
    pub fn answered_signal(&self) -> &Signal {
        &self.layout.answered
    }

    /// Process id of who owns the bus, which takes it with its first thread; none while nobody that lives does.
    pub fn owner(&self) -> Option<u32> {
        Some(self.layout.ownership.holder()).filter(|holder| *holder != 0)
    }

    /// Takes the bus for the calling thread as soon as nobody has it; none if another one still has it after this time. An owner is
    /// gone when its thread is: it cannot send any more.
    ///
    /// # Errors
    /// The lock is damaged.
    pub fn own(&self, limit: Duration) -> std::io::Result<Option<OwnedBus<'_>>> {
        let owned = self.layout.ownership.take(limit)?;
        Ok(owned.then(|| OwnedBus {
            page: self,
            _of_thread: PhantomData,
        }))
    }

    /// Whoever owned the bus has ended, and nobody stands by: the bus is free, and whoever waits for an answer is told. For the
    /// launcher.
    pub fn disown(&self) {
        self.set_state(BusState::Free);
    }

    /// What the fieldbus process does; of one that was killed, what it did, until another one says something else.
    pub fn state(&self) -> BusState {
        let state = self.layout.state.load(Ordering::Acquire);
        BusState::from_wire(state).unwrap_or(BusState::Free)
    }

    /// Says what the fieldbus process does.
    pub fn set_state(&self, state: BusState) {
        self.layout.state.store(state as u32, Ordering::Release);
        self.layout.answered.raise();
    }

    /// Notes slaves that have restarted; all that are noted, a bit each. A start-up that fails gives them their addresses too, so that the
    /// next one finds nothing.
    pub fn note_restarted(&self, slaves: u64) -> u64 {
        self.layout.restarted.fetch_or(slaves, Ordering::AcqRel) | slaves
    }

    /// A master has seen what the start-up has found.
    pub fn forget_restarted(&self) {
        self.layout.restarted.store(0, Ordering::Release);
    }

    /// Says why the last start-up failed, or that it did not; before the state.
    pub fn set_failure(&self, why: &str) {
        let mut kept = [0; FAILURE_BYTES_MAX];
        for (to, byte) in kept.iter_mut().zip(why.bytes()) {
            *to = byte;
        }
        self.layout.failure.store(&kept);
    }

    /// Why the last start-up failed; empty if it did not.
    pub fn failure(&self) -> String {
        let mut kept = [0; FAILURE_BYTES_MAX];
        self.layout.failure.load(&mut kept);
        let end = kept.iter().position(|byte| *byte == 0);
        let text = kept.get(..end.unwrap_or(kept.len())).unwrap_or(&kept);
        String::from_utf8_lossy(text).into_owned()
    }

    /// Asks for another start-up, because drives have been lost; for the master.
    pub fn ask_to_start_again(&self) {
        self.layout.start_again.store(1, Ordering::Release);
        self.layout.asked.raise();
    }

    /// Whether another start-up has been asked for since this was asked last; for the fieldbus process.
    pub fn take_start_again(&self) -> bool {
        self.layout.start_again.swap(0, Ordering::AcqRel) == 1
    }

    /// How the segment is wired; for whoever sees that cycles are exchanged.
    pub fn wiring(&self) -> Wiring {
        let mut wiring = Wiring::zeroed();
        self.layout.wiring.load(&mut wiring);
        wiring
    }

    /// Says how the segment is wired; before cycles are exchanged.
    pub fn set_wiring(&self, wiring: &Wiring) {
        self.layout.wiring.store(wiring);
    }

    /// Asks for a cycle with these outputs; for the master.
    pub fn request(&self, cycle: u64, outputs: &Outputs) {
        slot(&self.layout.outputs, cycle).store(outputs);
        let next = cycle.saturating_add(1);
        self.layout.requested_cycle.store(next, Ordering::Release);
        self.layout.asked.raise();
    }

    /// The cycle that was asked for last.
    pub fn requested(&self) -> Option<u64> {
        let next = self.layout.requested_cycle.load(Ordering::Acquire);
        next.checked_sub(1)
    }

    /// The outputs of a cycle that was asked for.
    pub fn outputs(&self, cycle: u64, outputs: &mut Outputs) {
        slot(&self.layout.outputs, cycle).load(outputs);
    }

    /// Notes that a frame of this number is about to be sent.
    pub fn note_sent(&self, frame: u64) {
        self.layout.sent_frame.store(frame, Ordering::Release);
    }

    /// The number of the frame that was noted last.
    pub fn sent(&self) -> u64 {
        self.layout.sent_frame.load(Ordering::Acquire)
    }

    /// The master has left in order: the bus is to be put to rest. For the master.
    pub fn set_left(&self) {
        self.layout.left.store(1, Ordering::Release);
        self.layout.asked.raise();
    }

    /// Whether the master has left in order.
    pub fn has_left(&self) -> bool {
        self.layout.left.load(Ordering::Acquire) == 1
    }

    /// Answers a cycle.
    pub fn answer(&self, cycle: u64, inputs: &Inputs) {
        // Whoever sees a word of them sees too that the cycle before was answered.
        fence(Ordering::Release);
        slot(&self.layout.inputs, cycle).store(inputs);
        let next = cycle.saturating_add(1);
        self.layout.answered_cycle.store(next, Ordering::Release);
        self.layout.answered.raise();
    }

    /// The cycle that was answered last.
    pub fn answered(&self) -> Option<u64> {
        let next = self.layout.answered_cycle.load(Ordering::Acquire);
        next.checked_sub(1)
    }

    /// What came back in a cycle that was answered; it is overwritten two cycles later.
    pub fn inputs(&self, cycle: u64, inputs: &mut Inputs) {
        slot(&self.layout.inputs, cycle).load(inputs);
    }

    /// What came back in the cycle that was answered last, whole; for observers, for whom nobody waits. None before the first one,
    /// and where cycles follow each other so fast that none could be read.
    pub fn newest_inputs(&self) -> Option<Inputs> {
        let mut inputs = Inputs::zeroed();
        for _ in 0..LOOKS_MAX {
            let cycle = self.answered()?;
            self.inputs(cycle, &mut inputs);
            fence(Ordering::Acquire);
            // Its slot is written to only after the next one was answered.
            if self.answered() == Some(cycle) {
                return Some(inputs);
            }
        }
        None
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn place(name: &str) -> CellPaths {
        CellPaths::new(&format!("drv-{name}-{}", std::process::id() % 100_000)).unwrap()
    }

    fn with_page(name: &str, test: impl FnOnce(&DrivePage, &DrivePage)) {
        let place = place(name);
        let cell = place.own(std::time::Duration::ZERO).unwrap();
        let page = DrivePage::create(&place).unwrap();
        let other = DrivePage::open(&place).unwrap();
        test(&page, &other);
        drop(cell);
        assert!(!place.drive_page().exists());
    }

    #[test]
    fn of_many_one_owns_the_bus_and_the_next_one_as_soon_as_its_thread_has_ended() {
        with_page("own", |page, other| {
            const SHORT: Duration = Duration::from_millis(2);
            std::thread::scope(|scope| {
                let (sender, owned) = std::sync::mpsc::channel();
                let (end, ends) = std::sync::mpsc::channel::<()>();
                scope.spawn(move || {
                    // As if it were killed: nothing of it runs any more.
                    std::mem::forget(page.own(SHORT).unwrap().unwrap());
                    page.set_state(BusState::Cycling);
                    sender.send(rustix::thread::gettid()).unwrap();
                    let _ = ends.recv();
                });
                let owner = owned.recv().unwrap().as_raw_nonzero().get();
                assert!(other.own(SHORT).unwrap().is_none());
                assert_eq!(other.owner(), Some(owner as u32));
                end.send(()).unwrap();
                let heir = other.own(Duration::from_secs(10)).unwrap();
                assert!(heir.is_some());
                // It learns what the one before did.
                assert_eq!(page.state(), BusState::Cycling);
            });
            assert_eq!((page.state(), page.owner()), (BusState::Free, None));
        });
    }

    /// A lock that is unmapped while it is held is nobody's for ever: the kernel looks for it when the holder dies, and finds nothing.
    #[test]
    fn an_owner_that_ends_by_itself_leaves_a_bus_that_the_next_one_takes() {
        with_page("leave", |page, other| {
            std::thread::spawn(|| {
                let page = DrivePage::open(&place("leave")).unwrap();
                let _bus = page.own(Duration::ZERO).unwrap().unwrap();
                page.set_state(BusState::Down);
            })
            .join()
            .unwrap();
            assert_eq!((other.state(), other.owner()), (BusState::Free, None));
            assert!(page.own(Duration::ZERO).unwrap().is_some());
        });
    }

    #[test]
    fn a_cycle_is_read_as_it_was_written_and_the_one_before_stays_whole() {
        with_page("cycle", |master, bus| {
            assert_eq!(bus.requested(), None);
            let mut outputs = Outputs::zeroed();
            for cycle in 0..3 {
                outputs.image[3] = cycle as u8;
                master.request(cycle, &outputs);
            }
            assert_eq!(bus.requested(), Some(2));
            let mut read = Outputs::zeroed();
            for cycle in 1..3 {
                bus.outputs(cycle, &mut read);
                assert_eq!(read.image[3], cycle as u8);
            }
            let mut inputs = Inputs::zeroed();
            inputs.counts.sent = 5;
            bus.note_sent(77);
            bus.answer(2, &inputs);
            let mut seen = Inputs::zeroed();
            master.inputs(2, &mut seen);
            assert_eq!((master.answered(), master.sent()), (Some(2), 77));
            assert_eq!(seen, inputs);
        });
    }

    #[test]
    fn an_observer_reads_a_cycle_as_a_whole_while_others_are_answered() {
        with_page("seen", |bus, observer| {
            const CYCLES: u64 = 20_000;
            assert_eq!(observer.newest_inputs(), None);
            std::thread::scope(|scope| {
                scope.spawn(move || {
                    let mut inputs = Inputs::zeroed();
                    for cycle in 0..CYCLES {
                        inputs.image.fill(cycle as u8);
                        inputs.counts.sent = cycle;
                        bus.answer(cycle, &inputs);
                    }
                });
                while observer.answered() != Some(CYCLES - 1) {
                    if let Some(seen) = observer.newest_inputs() {
                        assert_eq!(seen.image, [seen.counts.sent as u8; IMAGE_BYTES_MAX]);
                    }
                }
            });
            let last = observer.newest_inputs().map(|seen| seen.counts.sent);
            assert_eq!(last, Some(CYCLES - 1));
        });
    }
}
