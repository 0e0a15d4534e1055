//! The ports of a master whose run follows a script: in lockstep it withholds the feedback of a scan until the launcher has
//! done what the script wants in it, so that everybody sees the same on every run.

use bus::member::Pace;
use bus::sample::{
    BusCycle, Feedback, Instruments, OperatorRequest, OperatorResponse, Order, Participant,
    Refused, Roster, Setpoint, Signals, WindowHeader,
};
use bus::signal_page::FaultStep;
use master::bus_ports::{BusPorts, WAIT_STEP};
use master::saved::Latches;
use master::{Answered, Answers, Drives, Flow, MasterError, MasterPorts};

use super::faults::FaultScript;
use super::injector::FaultInjector;
use super::orders::ScriptedOrder;

/// A process's ports with a script beside them.
pub struct ScriptedPorts {
    ports: BusPorts,
    injector: Option<FaultInjector>,
    orders: std::vec::IntoIter<ScriptedOrder>,
    /// The last request to the launcher in the script's name.
    asked: u64,
}

impl ScriptedPorts {
    /// These ports, from `first_scan` on.
    pub fn new(
        ports: BusPorts,
        faults: Option<FaultScript>,
        mut orders: Vec<ScriptedOrder>,
        first_scan: u64,
    ) -> ScriptedPorts {
        orders.retain(|order| order.scan >= first_scan);
        let page = &ports.member.page;
        let fired = |index| page.fault_fired(index);
        ScriptedPorts {
            injector: faults.map(|script| FaultInjector::new(script, fired, first_scan)),
            orders: orders.into_iter(),
            asked: 0,
            ports,
        }
    }

    /// Has the launcher do what the fault script wants in this scan, before its feedback is published or after. In lockstep
    /// it is done when this returns; in realtime nobody waits, and one thing is asked for after the other.
    fn inject(&mut self, scan: u64, published: bool) -> Flow {
        let realtime = self.ports.pace() == Pace::Realtime;
        loop {
            let member = &self.ports.member;
            if realtime && !member.page.is_done(self.asked) {
                return Flow::GoOn;
            }
            let due = self.injector.as_mut();
            let Some((index, step)) = due.and_then(|i| i.next(scan, published)) else {
                return Flow::GoOn;
            };
            if !realtime && step == FaultStep::Kill {
                // Or the log would miss a process that was replaced and killed before the recorder had seen it.
                self.ports.await_log(scan);
            }
            let member = &self.ports.member;
            self.asked = member.page.ask_launcher(index, step, scan);
            if realtime {
                continue;
            }
            while !member.page.is_done(self.asked) {
                let seen = member.page.master_signal().count();
                if member.page.is_done(self.asked) {
                    break;
                }
                if member.ending() || !member.launcher_lives() {
                    return Flow::Leave;
                }
                member.page.master_signal().wait(seen, WAIT_STEP);
            }
            self.ports.read_roster();
        }
    }
}

impl MasterPorts for ScriptedPorts {
    type Error = MasterError;

    fn roster(&self) -> &Roster {
        self.ports.roster()
    }

    fn read_roster(&mut self) {
        self.ports.read_roster();
    }

    fn follow_drives(&mut self, late_ns: i64) {
        self.ports.follow_drives(late_ns);
    }

    fn begin_scan(&mut self, feedback: &Feedback, ask_planner: bool) -> Flow {
        let scan = feedback.scan;
        if let Some(injector) = &mut self.injector {
            let page = &self.ports.member.page;
            injector.look(feedback, |index| page.set_fault_fired(index, scan));
        }
        if self.inject(scan, false) == Flow::Leave
            || self.ports.begin_scan(feedback, ask_planner) == Flow::Leave
        {
            return Flow::Leave;
        }
        self.inject(scan, true)
    }

    fn publish_instruments(&mut self, instruments: &Instruments) {
        self.ports.publish_instruments(instruments);
    }

    fn publish_signals(&mut self, signals: &Signals) {
        self.ports.publish_signals(signals);
    }

    fn publish_bus_cycle(&mut self, cycle: &BusCycle) {
        self.ports.publish_bus_cycle(cycle);
    }

    fn save(&mut self, latches: &Latches, drives: &impl Drives) {
        self.ports.save(latches, drives);
    }

    fn latch(&mut self, latches: &Latches) {
        self.ports.latch(latches);
    }

    fn await_answers(&mut self, scan: u64, ask_planner: bool) -> Result<Answered, MasterError> {
        if self.injector.is_some() || !self.orders.as_slice().is_empty() {
            self.ports.expect_order();
        }
        let injector = self.injector.as_ref();
        let excused = |who: &Participant| injector.is_some_and(|i| i.excuses(who, scan));
        self.ports.await_answers_except(scan, ask_planner, &excused)
    }

    fn answers(&self) -> &Answers {
        self.ports.answers()
    }

    fn serve_orders(
        &mut self,
        scan: u64,
        mut judge: impl FnMut(&OperatorRequest) -> (OperatorResponse, Latches),
    ) {
        while let Some(order) = self.orders.as_slice().first().filter(|o| o.scan <= scan) {
            report(order, &judge(&order.request).0);
            self.orders.next();
        }
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

/// Reports what became of a scripted order; runs with a script are no production.
fn report(order: &ScriptedOrder, answer: &OperatorResponse) {
    let word = Order::from_wire(order.request.order).map_or("order", Order::word);
    match Refused::from_wire(answer.reason) {
        Some(Refused::Not) => tracing::info!("scan {}: {word}", order.scan),
        reason => {
            let why = reason.map_or("for an unknown reason", Refused::words);
            tracing::warn!("scan {}: {word} refused: {why}", order.scan);
        }
    }
}
