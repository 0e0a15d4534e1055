//! Runs ethercrab's futures on the calling thread, over our own socket: a frame that is late or damaged is dropped and ends nothing.

use std::future::Future;
use std::pin::pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use bus::drive_page::SLAVES_MAX;
use bus::realtime::now_ns;
use ethercrab::error::Error;
use ethercrab::{Command, MainDevice, MainDeviceConfig, PduRx, PduStorage, PduTx, Timeouts};
use ethercrab_wire::EtherCrabWireReadSized;

use crate::link::{FRAME_BYTES_MAX, Origin, Socket};

/// Frames that may be on their way at once.
const FRAMES: usize = 16;
/// Most data of a frame.
const DATA_BYTES: usize = PduStorage::element_size(1100);
/// Longest wait for a frame; ethercrab's timers are looked at in between.
const WAIT_NS: u64 = 500_000;

/// ethercrab's clock.
struct Clock;

impl embassy_time_driver::Driver for Clock {
    fn now(&self) -> u64 {
        let ticks = u128::from(now_ns()) * u128::from(embassy_time_driver::TICK_HZ);
        (ticks / 1_000_000_000) as u64
    }

    /// Futures are polled again and again: nobody has to be woken.
    fn schedule_wake(&self, _at: u64, _waker: &Waker) {}
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock);

/// Storage of the frames of one start-up.
pub(super) type Storage = PduStorage<FRAMES, DATA_BYTES>;

/// Both ends of ethercrab's frame queue, and the socket between them.
pub(super) struct Driver<'a> {
    tx: PduTx<'a>,
    rx: PduRx<'a>,
    socket: Rc<Socket>,
}

/// A master over new storage; `clock_frames` are spent on synchronising the clocks.
pub(super) fn master<'a>(
    storage: &'a Storage,
    socket: &Rc<Socket>,
    mailbox: Duration,
    clock_frames: u32,
) -> Option<(MainDevice<'a>, Driver<'a>)> {
    let (tx, rx, pdu_loop) = storage.try_split().ok()?;
    let timeouts = Timeouts {
        // A busy PC may be late; a frame that is lost is rare, and ends the start-up.
        pdu: Duration::from_millis(250),
        eeprom: Duration::from_millis(250),
        mailbox_echo: mailbox,
        mailbox_response: mailbox,
        wait_loop_delay: Duration::from_micros(100),
        ..Timeouts::default()
    };
    let config = MainDeviceConfig {
        dc_static_sync_iterations: clock_frames,
        ..MainDeviceConfig::default()
    };
    let master = MainDevice::new(pdu_loop, timeouts, config);
    let driver = Driver {
        tx,
        rx,
        socket: Rc::clone(socket),
    };
    Some((master, driver))
}

/// Reads a register of every slave, in the order of the cable, before they have addresses.
pub(super) fn read_everywhere<T: EtherCrabWireReadSized>(
    main: &MainDevice<'_>,
    driver: &mut Driver<'_>,
    register: u16,
) -> Result<Vec<T>, Error> {
    let mut read = Vec::new();
    for place in 0..SLAVES_MAX as u16 {
        match driver.run(Command::aprd(place, register).receive::<T>(main)) {
            Ok(found) => read.push(found),
            // Nobody is at this place.
            Err(Error::WorkingCounter { .. }) => break,
            Err(error) => return Err(error),
        }
    }
    Ok(read)
}

impl Driver<'_> {
    /// Runs a future to its end.
    pub fn run<F: Future>(&mut self, future: F) -> F::Output {
        let mut future = pin!(future);
        let mut context = Context::from_waker(Waker::noop());
        let mut buffer = [0; FRAME_BYTES_MAX];
        loop {
            if let Poll::Ready(done) = future.as_mut().poll(&mut context) {
                return done;
            }
            while let Some(frame) = self.tx.next_sendable_frame() {
                let sent = frame
                    .send_blocking(|bytes| self.socket.send(bytes).map_err(|_| Error::SendFrame));
                if sent.is_err() {
                    // The interface's queue is full, or it is gone: ethercrab's time limit ends the wait.
                    break;
                }
            }
            self.socket.wait(WAIT_NS);
            while let Some((length, origin)) = self.socket.receive(&mut buffer) {
                if origin == Origin::Here {
                    continue;
                }
                // A first slave that does not mark the source address would be taken for an echo.
                buffer[6] |= 2;
                if let Some(frame) = buffer.get(..length) {
                    let _ = self.rx.receive_frame(frame);
                }
            }
        }
    }
}
