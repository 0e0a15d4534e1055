//! What can come between.

use bus::sample::{Job, OperatorRequest, Order, Refused};
use machine::Machine;

use super::machines::Wire;
use crate::staying::Cell;

/// Who turns and presses.
pub const SESSION: u32 = 7;

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Interruption {
    /// An order: it may be refused.
    Ordered(Order),
    /// The servo of an axis breaks off.
    Trip(usize),
    /// The drive of an axis has a fault of its own.
    DriveFault(usize),
    /// It does not answer any more.
    DriveLost(usize),
    /// The servo that drives an axis dies.
    ServoDies(usize),
    /// The other one.
    StandbyDies(usize),
    /// Both.
    ServosDie(usize),
    PlannerDies,
    MasterDies,
    /// Both at once.
    MasterAndPlannerDie,
    /// Everybody comes to rest and ends.
    LauncherDies,
    /// A signal that the machine needs goes off.
    Opens(Wire),
}

impl Interruption {
    /// All that can come to this machine.
    pub fn all(machine: &Machine) -> Vec<Interruption> {
        let mut all: Vec<_> = Order::ALL.into_iter().map(Interruption::Ordered).collect();
        for (axis, settings) in machine.axes.iter().enumerate() {
            all.extend([
                Interruption::Trip(axis),
                Interruption::DriveFault(axis),
                Interruption::DriveLost(axis),
                Interruption::ServoDies(axis),
            ]);
            if settings.standby {
                all.extend([
                    Interruption::StandbyDies(axis),
                    Interruption::ServosDie(axis),
                ]);
            }
        }
        all.extend([
            Interruption::PlannerDies,
            Interruption::MasterDies,
            Interruption::MasterAndPlannerDie,
            Interruption::LauncherDies,
        ]);
        all.extend(Wire::ALL.map(Interruption::Opens));
        all
    }

    /// Whether a trip may follow from it; what comes first finds the standbys in step.
    pub fn may_trip(self, machine: &Machine, is_first: bool) -> bool {
        match self {
            Interruption::Ordered(order) => order == Order::EmergencyStop,
            Interruption::Opens(wire) => wire == Wire::Chain,
            Interruption::PlannerDies | Interruption::LauncherDies => false,
            Interruption::ServoDies(axis) | Interruption::StandbyDies(axis) => {
                !(is_first && machine.axes[axis].standby)
            }
            Interruption::Trip(_)
            | Interruption::DriveFault(_)
            | Interruption::DriveLost(_)
            | Interruption::ServosDie(_)
            | Interruption::MasterDies
            | Interruption::MasterAndPlannerDie => true,
        }
    }

    /// It happens to a cell; an order that is refused and changes something.
    pub fn happens(self, cell: &mut Cell) -> Result<(), String> {
        let of_axis = |cell: &Cell, axis: usize| cell.now.axes[axis].taken_role;
        match self {
            Interruption::Ordered(order) => {
                let request = request(cell, order);
                return asked(cell, &request).map(drop);
            }
            Interruption::Trip(axis) => cell.trips = Some(axis),
            Interruption::DriveFault(axis) => cell.master.drives().fault(axis),
            Interruption::DriveLost(axis) => cell.master.drives().lose(axis),
            Interruption::ServoDies(axis) => cell.dies(Job::Servo, axis),
            Interruption::StandbyDies(axis) => {
                cell.one_dies(Job::Servo, axis, 1 - of_axis(cell, axis));
            }
            Interruption::ServosDie(axis) => {
                for role in 0..2 {
                    cell.one_dies(Job::Servo, axis, role);
                }
            }
            Interruption::PlannerDies => cell.one_dies(Job::Planner, 0, 0),
            Interruption::MasterDies => cell.replace_master(),
            Interruption::MasterAndPlannerDie => {
                cell.one_dies(Job::Planner, 0, 0);
                cell.replace_master();
            }
            Interruption::LauncherDies => cell.master.end_after_stop(false),
            Interruption::Opens(wire) => return asked(cell, &wire.set(false)).map(drop),
        }
        Ok(())
    }
}

/// An order, and why it was refused; an order that was refused has changed nothing.
pub fn asked(cell: &mut Cell, request: &OperatorRequest) -> Result<Refused, String> {
    let before = cell.master.feedback();
    let answer = cell.ask(request);
    let reason = Refused::from_wire(answer.reason).ok_or("an unknown reason")?;
    if reason != Refused::Not && cell.master.feedback() != before {
        let word = Order::from_wire(request.order).map_or("?", Order::word);
        return Err(format!(
            "{word} is refused ({reason:?}) and changes something"
        ));
    }
    Ok(reason)
}

/// An order without a value.
pub fn order(order: Order) -> OperatorRequest {
    OperatorRequest::of(order)
}

/// The direction in which an axis has room; off what a probe could touch.
pub fn inwards(cell: &Cell, axis: usize) -> f64 {
    let settings = &cell.machine.axes[axis];
    if cell.machine.program.probe && settings.name == "Z" {
        return 1.0;
    }
    let (way_mm, _) = cell.to_the_middle(axis);
    1f64.copysign(way_mm)
}

/// An order as somebody gives it who does not know what the machine is doing.
fn request(cell: &mut Cell, what: Order) -> OperatorRequest {
    let plain = order(what);
    match what {
        Order::OptionalStop | Order::SingleBlock => OperatorRequest {
            value: 1.0,
            ..plain
        },
        Order::Load => cell.load_of("G21 G91\nG1 X0.5 F3000\nG1 X-0.5\nM2\n"),
        Order::Jog => OperatorRequest {
            value: inwards(cell, 0),
            ..plain
        },
        Order::JogOn => OperatorRequest {
            value: inwards(cell, 0),
            session: SESSION,
            deadline_scans: 100,
            ..plain
        },
        Order::JogRenew => OperatorRequest {
            session: SESSION,
            ..plain
        },
        Order::Wheel => OperatorRequest {
            value: 0.01,
            session: SESSION,
            count: cell.now.scan as i32,
            ..plain
        },
        // Overrides are 0: nothing moves before somebody takes that back.
        _ => plain,
    }
}
