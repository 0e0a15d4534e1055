//! The scan path allocates nothing.
#![allow(missing_docs)]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{Rig, answer, machine};

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: hands everything to the system allocator and counts.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn neither_a_window_nor_a_scan_allocates() {
    for name in ["xy", "xy-torque"] {
        let mut rig = Rig::new(machine(name));
        for _ in 0..2_000 {
            let offered = rig.offers();
            let feedback = rig.feedback();
            let before = ALLOCATIONS.get();
            for (axis, servo) in rig.servos.iter_mut().enumerate() {
                rig.commands[axis] = answer(servo, &feedback, &offered);
            }
            assert_eq!(ALLOCATIONS.get(), before, "{name} scan {}", rig.scan);
            for axis in 0..2 {
                assert_eq!(rig.commands[axis].cause, 0);
                assert!(rig.commands[axis].refused.is_none());
                rig.command_position[axis] = rig.commands[axis].position;
                rig.position[axis] = rig.commands[axis].position;
            }
            rig.scan += 1;
        }
    }
}
