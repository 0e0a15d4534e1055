//! From SAFE-OP to OP: slaves want process data before they go there.

use std::rc::Rc;

use bus::drive_codes::{al_state, al_status};
use bus::drive_page::{Counts, IMAGE_BYTES_MAX, Inputs, Wiring};
use bus::realtime::{now_ns, sleep_until_ns};
use bytemuck::Zeroable;

use super::SegmentPlan;
use super::error::StartUpError;
use crate::link::{Cycle, OPERATIONAL, Socket, Tag, request_state};

/// Bit of the AL status that says that it could not.
const REFUSED: u16 = 0x10;
/// A cycle without an answer in this time is missed.
const ANSWER_NS: u64 = 250_000_000;
/// So long slaves may take.
const LIMIT_NS: u64 = 5_000_000_000;

/// Exchanges outputs that move nothing until all slaves are in OP.
pub(super) fn into_operation(
    socket: &Rc<Socket>,
    plan: &SegmentPlan,
    wiring: &Wiring,
) -> Result<(), StartUpError> {
    // Its cycles are none of the master's.
    let nonce = !wiring.nonce;
    let mut cycle = Cycle::new(
        Rc::clone(socket),
        &Wiring { nonce, ..*wiring },
        u64::from(plan.period_us) * 1000,
        Counts::zeroed(),
    );
    let image = [0; IMAGE_BYTES_MAX];
    let started = now_ns();
    let mut next_ns = started;
    let mut inputs = Inputs::zeroed();
    let period_ns = i64::from(plan.period_us) * 1000;
    // Where they have clocks, frames come in the middle between two SYNC0 before slaves are asked to act at them.
    let mut asked = None;
    for number in 0_u64.. {
        let tag = Tag {
            frame: number,
            cycle: number,
        };
        cycle.send(tag, &image);
        inputs = *cycle.receive(number, now_ns() + ANSWER_NS, || true);
        let late_ns = inputs.clock_late_ns;
        let waits_for_clock = !plan.is_without_watchdog() && late_ns.abs() > period_ns / 8;
        let asks = asked.is_none() && !waits_for_clock;
        if asks {
            asked = Some(number);
            for slave in wiring.slaves() {
                request_state(socket, slave.address, OPERATIONAL);
            }
        }
        let slaves = inputs.slaves.iter().take(wiring.slaves().len());
        if inputs.answered == 1 && slaves.clone().all(|slave| slave.al_status == OPERATIONAL) {
            return Ok(());
        }
        let refused = slaves.clone().any(|slave| slave.al_status & REFUSED != 0);
        if !asks && asked.is_some() && refused || now_ns() - started > LIMIT_NS {
            break;
        }
        if !plan.is_without_watchdog() {
            let step_ns = period_ns - (late_ns / 4).clamp(-period_ns / 8, period_ns / 8);
            next_ns += step_ns as u64;
            sleep_until_ns(next_ns);
        }
    }
    let slaves = inputs.slaves.iter().take(wiring.slaves().len());
    let mut late = slaves
        .enumerate()
        .filter(|(_, slave)| slave.al_status != OPERATIONAL);
    let (slave, what) = match late.next() {
        None => (plan.bus.interface.clone(), "no frame comes back".into()),
        Some((place, slave)) => {
            let (is, why) = (al_state(slave.al_status), al_status(slave.al_status_code));
            (plan.name(place), format!("it stays in {is}: {why}"))
        }
    };
    Err(StartUpError::at(&slave, "going from SAFE-OP to OP", &what))
}
