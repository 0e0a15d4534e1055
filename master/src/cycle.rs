//! One scan of a master: publish the feedback, signal everybody, exchange with the drives, await the answers, close the scan.

use crate::drives::Drives;
use crate::master::Master;
use crate::ports::{Answered, Flow, MasterPorts};

/// One scan of a master.
///
/// # Errors
/// Somebody who takes part does not answer.
pub fn cycle<D: Drives, P: MasterPorts>(
    master: &mut Master<D>,
    ports: &mut P,
) -> Result<Flow, P::Error> {
    let scan = master.scan();
    let ask_planner = master.is_period_boundary();
    ports.read_roster();
    if ports.begin_scan(master.tell(), ask_planner) == Flow::Leave {
        return Ok(Flow::Leave);
    }
    if master.is_last() {
        ports.finish(scan);
        return Ok(Flow::Leave);
    }
    master.exchange();
    if let Some(cycle) = master.bus_cycle() {
        ports.publish_bus_cycle(&cycle);
    }
    if let Some(signals) = master.signals() {
        ports.publish_signals(signals);
    }
    ports.publish_instruments(master.instruments());
    ports.follow_drives(master.drives().exchanged_late_ns());
    ports.save(&master.latches(), master.drives());
    let Answered::Scan { overrun_scans } = ports.await_answers(scan, ask_planner)? else {
        return Ok(Flow::Leave);
    };
    master.skip(overrun_scans);
    ports.serve_orders(scan, |request| {
        let answer = master.order(request);
        (answer, master.latches())
    });
    match ports.launcher_lives(scan) {
        None => return Ok(Flow::Leave),
        Some(false) => master.end_after_stop(false),
        Some(true) => {}
    }
    ports.for_each_window(scan, |header, setpoints, roster| {
        master.offer(header, setpoints, roster);
    });
    master.close_scan(ports.answers(), ports.roster());
    if master.take_latched() {
        ports.latch(&master.latches());
    }
    Ok(Flow::GoOn)
}
