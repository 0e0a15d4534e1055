//! The scan path allocates nothing of its own; what iceoryx2 allocates per send is pinned here.
//!
//! A whole cell is put together in this one process, over real services: what each step of a scan allocates is counted.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::Duration;

use bus::cell::CellPlace;
use bus::machine::Machine;
use bus::sample::{Job, Participant, Roster};
use bus::service::{Bus, SCAN_DEPTH};
use bytemuck::Zeroable;
use plant_sim::RunEnd;
use plant_sim::machine_side::{Answers, MachineSide};
use plant_sim::plant_file::PlantFile;

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

fn roster(axes: usize) -> Roster {
    let mut roster = Roster::zeroed();
    roster.version = 1;
    let jobs = std::iter::once((Job::Planner, 0)).chain((0..axes).map(|axis| (Job::Servo, axis)));
    for (place, (job, axis)) in roster.participants.iter_mut().zip(jobs) {
        *place = Participant {
            job: job as u32,
            axis: axis as u32,
            incarnation: 1,
            live: 1,
            ..Participant::zeroed()
        };
    }
    roster
}

#[test]
fn a_scan_allocates_nothing_but_what_iceoryx2_allocates_per_send() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let machine = Machine::load(&root.join("machines/xy")).expect("the machine");
    let plant = PlantFile::load(&root.join("machines/xy")).expect("the plant");
    let program = std::fs::read_to_string(root.join("machines/xy/programs/circle-r25-f3000.ngc"))
        .expect("a program");
    let place = CellPlace::new(&format!("alloc-{}", std::process::id())).expect("a name");
    let owned = place.own(Duration::ZERO).expect("the cell");
    let launcher = Bus::enter(&place, &machine, "launcher", true).expect("shared memory");
    let _services = launcher.create_all().expect("services");

    let axes = machine.axes.len();
    let simulations = plant.simulations(&machine).expect("axes");
    let mut side = MachineSide::new(&machine, simulations, 1, 0, true, RunEnd::AfterProgram);
    let mut servos: Vec<_> = (0..axes)
        .map(|axis| {
            let servo = servo::Servo::new(&machine, axis, 0, 1).expect("a servo");
            let feedback = launcher.feedback_reader(SCAN_DEPTH).expect("feedback");
            let windows = launcher.window_reader(SCAN_DEPTH).expect("windows");
            let out = launcher.command_writer(axis, 0).expect("commands");
            let back = launcher
                .command_reader(axis, 0, SCAN_DEPTH)
                .expect("commands");
            (servo, feedback, windows, out, back)
        })
        .collect();
    let mut planner = planner::Planner::new(&machine, "circle", program, 1);
    let mut feedback_out = launcher.feedback_writer().expect("feedback");
    let mut instruments_out = launcher.instruments_writer().expect("instruments");
    let mut windows_out = launcher.window_writer().expect("windows");
    let mut windows_in = launcher.window_reader(SCAN_DEPTH).expect("windows");
    let mut status_out = launcher.planner_writer().expect("planner");
    let mut status_in = launcher.planner_reader(SCAN_DEPTH).expect("planner");
    let roster = roster(axes);

    // Connections are made and buffers filled in the first scans; then nothing may allocate any more.
    for scan in 0..6000 {
        let settled = scan > 200;
        let expect = |what: &str, (count, bytes): (u64, u64), found: u64, found_bytes: u64| {
            assert!(
                !settled || (found, found_bytes) == (count, bytes),
                "{what} in scan {scan}: {found} allocations of {found_bytes} bytes, not {count} of {bytes}"
            );
        };
        let (feedback, count, bytes) = counted(|| side.feedback());
        expect("the machine side's feedback", (0, 0), count, bytes);
        let ((), count, bytes) = counted(|| feedback_out.send(&feedback));
        expect("sending the feedback", PER_SEND, count, bytes);
        let (instruments, count, bytes) = counted(|| side.simulate());
        expect("the simulation", (0, 0), count, bytes);
        let ((), count, bytes) = counted(|| instruments_out.send(&instruments));
        expect("sending the instruments", PER_SEND, count, bytes);

        let mut answers = Answers::NONE;
        for ((servo, feedback_in, windows, out, back), commands) in
            servos.iter_mut().zip(&mut answers.commands)
        {
            let (command, count, bytes) = counted(|| {
                let feedback = feedback_in.newest(scan).expect("the feedback");
                windows.each(scan, |header, rows| {
                    servo.offer(header, rows, &feedback).expect("a good window");
                });
                servo.scan(&feedback)
            });
            expect("a servo's scan", (0, 0), count, bytes);
            let ((), count, bytes) = counted(|| out.send(&command));
            expect("sending a command", PER_SEND, count, bytes);
            let (read, count, bytes) = counted(|| back.newest(scan + 1));
            expect("reading a command", (0, 0), count, bytes);
            commands[0] = read;
        }
        if side.is_period_boundary() {
            let (decision, count, bytes) = counted(|| planner.scan(&feedback));
            expect("the planner's scan", (0, 0), count, bytes);
            if let Some((header, rows)) = &decision.window {
                let (_, count, bytes) = counted(|| windows_out.send(header, rows));
                expect("sending a window", PER_SEND, count, bytes);
            }
            status_out.send(&decision.status);
            answers.planner = status_in.newest(scan + 1);
        }
        let ((), count, bytes) = counted(|| {
            windows_in.each(scan, |header, rows| side.offer(header, rows, &roster));
            side.close_scan(&answers, &roster);
        });
        expect("closing the scan", (0, 0), count, bytes);
    }
    let feedback = side.feedback();
    assert_eq!(feedback.cause, 0);
    assert!(
        feedback.tag.element >= 2,
        "the circle was under way: {:?}",
        feedback.tag
    );
    drop(owned);
}
