//! A cycle allocates nothing: commands to outputs, the frame there and back, inputs to feedback.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use bus::drive_page::{Inputs, Outputs, SlaveWiring, Wiring};
use bytemuck::Zeroable;
use fieldbus::drives::{Cia402Drives, Wire, WireAnswer};
use fieldbus::link::{CycleFrame, Received, Tag};
use fieldbus::setups;
use machine::Machine;
use master::{DriveCommand, DriveState, Drives};

struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: everything is left to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as the caller's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as the caller's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const OUTPUT_BYTES: u16 = 20;
const INPUT_BYTES: u16 = 24;
const SLAVES: u16 = 3;
/// Ethernet and frame header, header of a datagram, its counter (ETG.1000.4); the tag.
const HEAD: usize = 16;
const DATAGRAM: usize = 10;
const COUNTER: usize = 2;
const TAG: usize = 24;
const STATUS: usize = 6;

/// Slaves in OP whose drives are in the state that they were asked for, behind a frame as it comes back.
struct Loop {
    wiring: Wiring,
    frame: CycleFrame,
    number: u64,
    answer: [u8; 1514],
}

impl Loop {
    fn new() -> Loop {
        let mut wiring = Wiring::zeroed();
        wiring.image_bytes = u32::from(SLAVES * (INPUT_BYTES + OUTPUT_BYTES));
        wiring.slave_count = SLAVES.into();
        wiring.working_counter = 3 * u32::from(SLAVES);
        for (place, slave) in (0..SLAVES).zip(&mut wiring.slaves) {
            *slave = SlaveWiring {
                serial: 0,
                restarted: 0,
                address: 0x1000 + place,
                outputs_at: SLAVES * INPUT_BYTES + place * OUTPUT_BYTES,
                output_bytes: OUTPUT_BYTES,
                inputs_at: place * INPUT_BYTES,
                input_bytes: INPUT_BYTES,
                working_counter: 3,
            };
        }
        Loop {
            frame: CycleFrame::new(&wiring),
            wiring,
            number: 0,
            answer: [0; 1514],
        }
    }

    /// What the slaves make of the frame.
    fn pass(&mut self) {
        let image_at = HEAD + DATAGRAM + TAG + COUNTER + DATAGRAM;
        let counter = image_at + self.wiring.image_bytes as usize;
        self.answer[counter] = self.wiring.working_counter as u8;
        let statuses = counter + COUNTER;
        for (place, slave) in self.wiring.slaves().iter().enumerate() {
            let status = statuses + place * (DATAGRAM + STATUS + COUNTER) + DATAGRAM;
            self.answer[status] = 8;
            self.answer[status + STATUS] = 1;
            let control = self.answer[image_at + usize::from(slave.outputs_at)];
            let statusword: u16 = match control & 0x0F {
                0x0F => 0x1237,
                0x07 => 0x0233,
                0x06 => 0x0231,
                _ => 0x0250,
            };
            let inputs = image_at + usize::from(slave.inputs_at);
            self.answer[inputs..inputs + 2].copy_from_slice(&statusword.to_le_bytes());
            self.answer[inputs + 2] = 9;
        }
    }
}

impl Wire for Loop {
    fn wiring(&self) -> &Wiring {
        &self.wiring
    }

    fn exchange(&mut self, outputs: &Outputs, inputs: &mut Inputs) -> WireAnswer {
        self.number += 1;
        let frame = self.number;
        let sent = self.frame.fill(
            Tag {
                frame,
                cycle: frame,
            },
            &outputs.image,
        );
        let length = sent.len();
        self.answer[..length].copy_from_slice(sent);
        self.pass();
        let taken = self.frame.take(&self.answer[..length], frame, inputs);
        assert_eq!(taken, Received::Answer { clock_ns: None });
        WireAnswer::Answered
    }

    fn start_again(&mut self) {}

    fn pause(&self) {}
}

#[test]
fn a_cycle_allocates_nothing() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy-ethercat");
    let machine = Machine::load(&folder).expect("machine.toml");
    let setups = setups::load(&machine, &folder.join("machine.toml"));
    let setups = setups.expect("drive files").expect("[bus]");
    let drives = Cia402Drives::new(&machine, &setups, Loop::new());
    let mut drives = drives.expect("drives");
    let velocity = DriveCommand::Velocity {
        velocity_mm_s: 12.5,
        torque_offset_nm: 0.3,
    };
    let brake = DriveCommand::Brake {
        deceleration_mm_s2: 0.0,
    };
    let commands = [
        DriveCommand::SwitchOn,
        velocity,
        brake,
        DriveCommand::Disabled,
    ];
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    for command in commands {
        for _ in 0..1000 {
            drives.exchange(&[command; 3]);
        }
        let ready = drives.feedback(1).state == DriveState::Ready;
        assert_eq!(ready, command != DriveCommand::Disabled, "{command:?}");
    }
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed) - before, 0);
}
