//! What an operator asks of the master, and what it answers.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::MAX_AXES;

use crate::table;

/// Value of [`Order::Down`] from a launcher that ends the cell because a process is lost that it needs.
pub const DOWN_FOR_LOSS: f64 = 1.0;

/// What an operator, or the launcher for him, asks of the master.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/OperatorRequest/6")]
#[repr(C)]
pub struct OperatorRequest {
    /// What: see [`Order`].
    pub order: u32,
    /// Index of the axis, of orders to one axis; of `load` of typed-in blocks, 1 where M2 or M30 ends them.
    pub axis: u32,
    /// Its value: override in percent, distance of a jog in mm, direction of a continuous jog, mm of a wheel's count, number of a program
    /// to load, line to start at (0: the beginning), axes to home as bits, [`DOWN_FOR_LOSS`].
    pub value: f64,
    /// Speed of a jog, in mm/s; 0 for that of the machine file.
    pub speed_mm_s: f64,
    /// The last scan in which it may be obeyed, and until which a held jog goes on; 0 for any.
    pub latest_scan: u64,
    /// Names a held jog, so that what was meant for one that is over begins no other; of increments, who gives them: 0 is nobody who
    /// would repeat one; of a wheel, who counts. Of `start`, the number of the program that is meant, or 0 for any; of `load` of
    /// typed-in blocks, the number that is loaded before them and 1, else 0.
    pub session: u32,
    /// Scans that a held jog goes on without being renewed; 0 ends it. Of increments, their number in the session, going up. Of `load`
    /// of typed-in blocks, the number under which a copy of the program that is loaded before them lies; 0 where none is.
    pub deadline_scans: u32,
    /// Running count of a wheel, up and down; behind the largest number comes the smallest.
    pub count: i32,
    /// Of a wheel: 1 where its axis is to rest as soon as it does, 0 where every count is to be travelled.
    pub velocity_mode: u32,
    /// Ways of a jog along a straight line, by axis, in mm or degrees; all 0 of a jog of one axis.
    pub line_mm: [f64; MAX_AXES],
}
table!(
    OperatorRequest: order, axis, value, speed_mm_s, latest_scan, session, deadline_scans, count, velocity_mode,
    line_mm @ Axes,
);

wire_enum! {
    /// The orders. Numbers stay what they are: they travel on the wire and are in logs.
    pub enum Order {
        /// Come to rest on the path and stay.
        Stop = 1 => "stop",
        /// Feed hold.
        Hold = 2 => "hold",
        /// End a feed hold or a stop; off the path, return to it first.
        Resume = 3 => "resume",
        /// Override of the feed.
        Override = 4 => "override",
        /// Drives off.
        Disable = 5 => "disable",
        /// Drives on, in hold.
        Enable = 6 => "enable",
        /// Move one axis by hand.
        Jog = 7 => "jog",
        /// Take a program that lies in the cell's folder under this number; one that was started is discarded. Typed-in blocks begin once they
        /// are read.
        Load = 8 => "load",
        /// Begin the program that is loaded.
        Start = 9 => "start",
        /// Come to rest and end the cell.
        Down = 10 => "down",
        /// Optional stops (M1) are obeyed (value 1) or passed (value 0).
        OptionalStop = 11 => "optional-stop",
        /// Home axes, one after another: the value has a bit for each, and is 0 for all that can be homed.
        Home = 12 => "home",
        /// The machine comes to rest at the end of every block (value 1), or only where the program says so (value 0).
        SingleBlock = 13 => "single-block",
        /// Override of rapids and planned returns.
        RapidOverride = 14 => "rapid-override",
        /// Discard the rest of the program: it is loaded, from its beginning.
        Reset = 15 => "reset",
        /// Move one axis by hand as long as the order is renewed.
        JogOn = 18 => "jog-on",
        /// Renew or end the continuous jog of this session.
        JogRenew = 19 => "jog-renew",
        /// Brake at the limits and switch off, whatever the machine is doing.
        EmergencyStop = 20 => "estop",
        /// The running count of a wheel that moves one axis.
        Wheel = 21 => "wheel",
        /// Override of jogs, those under way too.
        JogOverride = 22 => "jog-override",
        /// A signal that the operator sets, named by its index in `axis`, to this value.
        Signal = 23 => "signal",
        /// Hold any signal at this value, whatever its source says.
        SignalForce = 24 => "signal-force",
        /// A signal that is forced follows its source again.
        SignalRelease = 25 => "signal-release",
        /// Alarms are acknowledged: the one of this number, or all (value 0), and then that an axis whose drive came back elsewhere is there.
        Acknowledge = 26 => "acknowledge",
    }
    /// The word for it on the command line and in files.
    pub fn word
}

impl OperatorRequest {
    /// An order that has nothing but its name.
    pub fn of(order: Order) -> OperatorRequest {
        OperatorRequest {
            order: order as u32,
            ..OperatorRequest::default()
        }
    }
}

impl Order {
    /// The order of this word.
    pub fn from_word(word: &str) -> Option<Order> {
        Self::ALL.into_iter().find(|order| order.word() == word)
    }
}

wire_enum! {
    /// Why an order was refused.
    pub enum Refused {
        /// It was not.
        Not = 0 => "not refused",
        /// There is no such order.
        UnknownOrder = 1 => "there is no such order",
        /// Its value is not a number or out of range.
        BadValue = 2 => "its value is out of range: an override is 0 to 100 %, a jog any distance but 0, optional stops and single block on or off",
        /// The machine has no such axis.
        UnknownAxis = 3 => "the machine has no such axis",
        /// Something moves, or stopped moving just now.
        NotAtRest = 4 => "the machine is not at rest: hold or stop it first and wait until it stands",
        /// The machine is neither held nor stopped.
        NotHeld = 5 => "the machine is not in hold: hold or stop it first",
        /// The drives are off.
        DrivesOff = 6 => "the drives are off: enable them first",
        /// The machine has tripped.
        Tripped = 7 => "the machine has tripped: look at its cause, then enable acknowledges it",
        /// The program is done.
        Finished = 8 => "the program is done",
        /// An axis is being jogged.
        Jogging = 9 => "an axis is being jogged: wait until it stands, or hold it",
        /// The target is outside the travel; the answer carries the distances that are allowed.
        BeyondTravel = 10 => "the target is outside the travel",
        /// An axis is outside its travel: only a jog inwards moves it.
        OutsideTravel = 11 => "an axis is outside its travel: jog it inwards",
        /// The machine was stopped by a fault that lasts.
        Faulted = 12 => "the machine was stopped by a fault that lasts",
        /// The machine cannot be driven: a servo is missing, an axis is not at rest yet, or a drive has a fault or does not answer.
        NotReady = 13 => "an axis is not at rest yet or a servo is missing (wait a moment), or a drive has a fault or does not answer (see to it first)",
        /// The cell runs one program and ends with it.
        OneProgram = 14 => "this cell runs one program and ends with it: `quadrant up` starts one that stays",
        /// No program is loaded.
        NoProgram = 15 => "no program is loaded: load one first",
        /// The planner has not read the program yet.
        Loading = 16 => "the program is still being read: wait a moment",
        /// The program was started and is not done.
        Running = 17 => "a program is running: resume goes on with it; stop, then load or reset, discards it",
        /// No program was started: there is nothing to go on with.
        NotRunning = 18 => "no program is running: start runs the one that is loaded",
        /// The cell is about to end.
        Ending = 19 => "the cell is about to end",
        /// An axis has no reference: it must be homed, or its encoder be set.
        NotReferenced = 20 => "an axis has no reference: home it first",
        /// A tap is in its thread.
        InThread = 21 => "a tap is in its thread: resume goes on in step; after another program is loaded the axes are free",
        /// The axis has an absolute encoder: there is nothing to home.
        Absolute = 22 => "the axis has an absolute encoder, or the machine file has no [axis.homing] for it: there is nothing to home",
        /// The continuous jog of this session is over: a late order does not begin it again.
        JogOver = 23 => "this jog is over",
        /// No jog of the axis may be so fast; the answer carries the speeds that are allowed.
        JogSpeed = 24 => "a jog may not be so fast",
        /// It came after the last scan in which it was to be obeyed.
        TooLate = 25 => "it came too late to be obeyed: give it again",
        /// The axis is at the end of its travel.
        TravelEnd = 26 => "the axis is at the end of its travel: jog it the other way",
        /// The axis has more to go than this increment, or a count of its wheel, and a fifth of a second.
        Backlog = 27 => "the axis still goes by the increments before: it would run on after the hand is off",
        /// The emergency-stop chain is open.
        EmergencyStopOpen = 28 => "the emergency-stop chain is open: close it first",
        /// An input keeps the drives off.
        DrivesNotAllowed = 29 => "an input keeps the drives off ([functions] drives_may)",
        /// A door or guard is open.
        DoorOpen = 30 => "a door or guard is open: close it first",
        /// A signal that must be on for a program is off; the answer carries its index as its axis.
        SignalOff = 31 => "a signal that must be on for a program is off",
        /// An axis is on a limit switch, and would go further onto it.
        OnLimitSwitch = 32 => "an axis is on its limit switch: jog it off",
        /// The machine has no such signal.
        UnknownSignal = 33 => "the machine has no such signal",
        /// It is not the operator who sets this signal.
        NotOperators = 34 => "this signal has another source: only forcing holds it at a value",
        /// As many signals as may be are set or forced.
        SignalsHeld = 35 => "as many signals are set or forced as may be at a time: release one first",
        /// The logic of the machine is lost.
        LogicLost = 36 => "the machine's own logic does not answer: wait until it is there again",
        /// The logic of the machine does not allow it now.
        LogicInhibits = 37 => "the machine's own logic does not allow it now",
        /// An alarm of the machine is there that does not allow it.
        AlarmThere = 38 => "an alarm of the machine does not allow it (`quadrant alarms`)",
        /// The machine has no alarm of this number.
        UnknownAlarm = 39 => "the machine has no alarm of this number",
        /// The drive of an axis was lost and came back elsewhere.
        Displaced = 40 => "an axis came back elsewhere than its drive was lost (`quadrant status`): see where it is, then `quadrant alarms acknowledge`",
    }
    /// Why, and what would be right.
    pub fn words
}

/// The answer: done or not, and the state it was judged in.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/OperatorResponse/5")]
#[repr(C)]
pub struct OperatorResponse {
    /// Scan in which it was latched.
    pub scan: u64,
    /// Distances in mm that a jog of the axis may have, of an order refused as beyond the travel; speeds in mm/s of one that is too fast.
    pub allowed_min_mm: f64,
    /// The upper one.
    pub allowed_max_mm: f64,
    /// What was taken of an increment, in mm: less than was asked for where it is cut at the end of the travel.
    pub jogged_mm: f64,
    /// Where the axis will stand whose motion by hand was cut short, in increments.
    pub rests: i64,
    /// 1 if accepted.
    pub accepted: u32,
    /// [`Mode`](super::Mode) after it.
    pub mode: u32,
    /// [`Refused`]: why it was not accepted.
    pub reason: u32,
    /// 1 while feed hold is latched.
    pub hold: u32,
    /// Override in percent.
    pub override_percent: u32,
    /// The program that was started last, counted.
    pub run: u32,
    /// Index of the axis that a jog was refused for, or of the first one whose motion by hand was cut short.
    pub axis: u32,
    /// What was taken of a wheel's counts, signed.
    pub counts: i32,
    /// 1 where a motion by hand was cut short.
    pub cut: u32,
    /// Kept zero.
    pub reserved: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_words_of_orders_and_reasons_are_read_back() {
        assert!(Order::ALL.is_sorted_by_key(|order| *order as u32));
        for order in Order::ALL {
            assert_eq!(Order::from_wire(order as u32), Some(order));
            assert_eq!(Order::from_word(order.word()), Some(order));
        }
        assert!(Refused::ALL.is_sorted_by_key(|reason| *reason as u32));
        for reason in Refused::ALL {
            assert_eq!(Refused::from_wire(reason as u32), Some(reason));
        }
        assert_eq!(Order::from_wire(0), None);
        assert_eq!(Order::from_wire(u32::MAX), None);
        assert_eq!(Refused::from_wire(u32::MAX), None);
    }
}
