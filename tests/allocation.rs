//! The scan path allocates nothing of its own; what iceoryx2 allocates per send is pinned here.
//!
//! A whole cell is put together in this one process, over real services: what each step of a scan allocates is counted.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;
use std::rc::Rc;
use std::time::Duration;

use bus::cell::CellPaths;
use bus::member::{Member, Pace, Slot};
use bus::realtime::Settings;
use bus::sample::{
    Feedback, Instruments, Job, OperatorRequest, OperatorResponse, Participant, Roster, Setpoint,
    WindowHeader,
};
use bus::service::{Bus, SCAN_DEPTH};
use bus::signal_page::{CellPhase, SignalPage};
use bytemuck::Zeroable;
use machine::Machine;
use master::bus_ports::BusPorts;
use master::saved::Latches;
use master::{Answered, Answers, Drives, Flow, Master, MasterError, MasterPorts, RunEnd};
use planner::{Planner, ProgramText};
use plant_sim::plant_file::PlantFile;
use servo::Servo;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
    static BYTES: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: hands everything to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        let _ = BYTES.try_with(|bytes| bytes.set(bytes.get() + layout.size() as u64));
        // SAFETY: as asked by the caller.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as asked by the caller.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Allocations and bytes of `work`.
fn counted<T>(work: impl FnOnce() -> T) -> (T, u64, u64) {
    let (count, bytes) = (ALLOCATIONS.get(), BYTES.get());
    let result = work();
    (result, ALLOCATIONS.get() - count, BYTES.get() - bytes)
}

/// What iceoryx2 0.10 allocates for one loan: the reference count of the chunk's shared state.
const PER_SEND: (u64, u64) = (1, 48);

/// Slots of the roster: the master, the planner, then the servos.
const FIRST_SERVO: usize = 2;

fn roster(axes: usize) -> Roster {
    let mut roster = Roster::zeroed();
    roster.version = 1;
    let servos = (0..axes).map(|axis| (Job::Servo, axis));
    let jobs = [(Job::Master, 0), (Job::Planner, 0)].into_iter();
    for (slot, (job, axis)) in roster.participants.iter_mut().zip(jobs.chain(servos)) {
        *slot = Participant {
            job: job as u32,
            axis: axis as u32,
            incarnation: 1,
            live: 1,
            ..Participant::zeroed()
        };
    }
    roster
}

/// The ports of the master, with servos and planner behind them that answer in the same thread, each over its own ports.
struct Counted {
    ports: BusPorts,
    servos: Vec<(Servo, servo::BusPorts)>,
    planner: (Planner, planner::BusPorts),
    /// Windows sent, read beside everybody else.
    windows: bus::port::WindowReader,
    /// What the others allocated in this scan, which is not the master's.
    others: (u64, u64),
}

impl Counted {
    /// What one of the others allocates in its scan must be `sends` times what iceoryx2 allocates.
    fn expect(&mut self, what: &str, scan: u64, sends: u64, (count, bytes): (u64, u64)) {
        self.others = (self.others.0 + count, self.others.1 + bytes);
        assert_settled(what, scan, sends, (count, bytes));
    }
}

/// Connections are made and buffers filled in the first scans; then nothing may allocate any more.
fn assert_settled(what: &str, scan: u64, sends: u64, found: (u64, u64)) {
    let expected = (sends * PER_SEND.0, sends * PER_SEND.1);
    assert!(
        scan <= 200 || found == expected,
        "{what} in scan {scan}: (allocations, bytes) are {found:?}, not {expected:?}"
    );
}

impl MasterPorts for Counted {
    type Error = MasterError;

    fn roster(&self) -> &Roster {
        self.ports.roster()
    }

    fn read_roster(&mut self) {
        self.ports.read_roster();
    }

    fn begin_scan(&mut self, feedback: &Feedback, ask_planner: bool) -> Flow {
        self.ports.begin_scan(feedback, ask_planner)
    }

    fn publish_instruments(&mut self, instruments: &Instruments) {
        self.ports.publish_instruments(instruments);
    }

    fn save(&mut self, latches: &Latches, drives: &impl Drives) {
        self.ports.save(latches, drives);
    }

    fn latch(&mut self, latches: &Latches) {
        self.ports.latch(latches);
    }

    fn await_answers(&mut self, scan: u64, ask_planner: bool) -> Result<Answered, MasterError> {
        for index in 0..self.servos.len() {
            let (servo, ports) = &mut self.servos[index];
            let (goes_on, count, bytes) = counted(|| servo::cycle(servo, ports));
            assert!(goes_on);
            self.expect("a servo's cycle", scan, 1, (count, bytes));
        }
        if ask_planner {
            let (planner, ports) = &mut self.planner;
            let (goes_on, count, bytes) = counted(|| planner::cycle(planner, ports));
            assert!(goes_on);
            let mut windows = 0;
            self.windows.each(u64::MAX, |_, _| windows += 1);
            self.expect("the planner's cycle", scan, 1 + windows, (count, bytes));
        }
        self.ports.await_answers(scan, ask_planner)
    }

    fn answers(&self) -> &Answers {
        self.ports.answers()
    }

    fn serve_orders(
        &mut self,
        scan: u64,
        judge: impl FnMut(&OperatorRequest) -> (OperatorResponse, Latches),
    ) {
        self.ports.serve_orders(scan, judge);
    }

    fn launcher_lives(&mut self, scan: u64) -> Option<bool> {
        self.ports.launcher_lives(scan)
    }

    fn for_each_window(
        &mut self,
        scan: u64,
        offer: impl FnMut(&WindowHeader, &[Setpoint], &Roster),
    ) {
        self.ports.for_each_window(scan, offer);
    }

    fn finish(&mut self, scan: u64) {
        self.ports.finish(scan);
    }

    fn leave(&mut self) {
        self.ports.leave();
    }
}

/// A member of the cell, as a process of its own would be.
fn enter(paths: &CellPaths, folder: &Path, machine: &Machine, index: usize, who: &str) -> Member {
    let slot = Slot {
        cell: paths.name().into(),
        machine: folder.to_owned(),
        index,
        incarnation: 1,
        launcher: std::process::id(),
        pace: Pace::Lockstep,
        processors: Vec::new(),
        realtime: Settings::DEFAULT,
        after_scan: None,
    };
    Member::enter(slot, who, &machine.shape()).expect("a member")
}

#[test]
fn a_scan_allocates_nothing_but_what_iceoryx2_allocates_per_send() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = root.join("machines/xy");
    let machine = Machine::load(&folder).expect("the machine");
    let plant = PlantFile::load(&folder).expect("the plant");
    let program = folder.join("programs/circle-r25-f3000.ngc");
    let program = std::fs::read_to_string(program).expect("a program");
    let program = ProgramText::Here("circle".into(), program.into());
    let paths = CellPaths::new(&format!("alloc-{}", std::process::id())).expect("a name");
    let owned = paths.own(Duration::ZERO).expect("the cell");
    let shape = machine.shape();
    let launcher = Bus::enter(&paths, &shape, "launcher", true).expect("shared memory");
    let services = launcher.create_all().expect("services");
    let page = SignalPage::create(&paths).expect("the signal page");
    let enter = |index, who| enter(&paths, &folder, &machine, index, who);

    let axes = machine.axes.len();
    let drives = plant.drives(&machine).expect("axes");
    let mut master = Master::new(&machine, drives, 1, 0, true, RunEnd::AfterProgram);
    let servo = |axis: usize| {
        let servo = Servo::new(&machine, axis, 0, 1).expect("a servo");
        let member = Rc::new(enter(FIRST_SERVO + axis, "servo"));
        let ports = servo::BusPorts::open(member, axis, 0, false).expect("ports");
        (servo, ports)
    };
    let period_scans = machine.scan.interpolation_period_scans;
    let planner_ports = planner::BusPorts::open(Rc::new(enter(1, "planner")), period_scans, false);
    let limit = Duration::from_secs(30);
    let mut ports = Counted {
        ports: BusPorts::open(enter(0, "master"), &machine, limit).expect("ports"),
        servos: (0..axes).map(servo).collect(),
        planner: (
            Planner::of(&machine, program, 1),
            planner_ports.expect("ports"),
        ),
        windows: launcher.window_reader(SCAN_DEPTH).expect("windows"),
        others: (0, 0),
    };
    let mut roster_out = launcher.roster_writer().expect("the roster");
    roster_out.send(&roster(axes));
    page.set_phase(CellPhase::Running);
    assert!(ports.ports.wait_for_start());

    for scan in 0..6000 {
        ports.others = (0, 0);
        let (flow, count, bytes) = counted(|| master::cycle::cycle(&mut master, &mut ports));
        assert_eq!(flow.expect("answers"), Flow::GoOn);
        let own = (count - ports.others.0, bytes - ports.others.1);
        assert_settled("the master's cycle", scan, 2, own);
    }
    let feedback = master.feedback();
    assert_eq!(feedback.cause, 0);
    assert!(
        feedback.tag.element >= 2,
        "the circle was under way: {:?}",
        feedback.tag
    );
    // The cell's folder goes only once nobody is in it.
    drop((ports, roster_out, page, services));
    drop(launcher);
    drop(owned);
}
